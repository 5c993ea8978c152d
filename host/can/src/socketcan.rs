//! A `Bus` over a CAN interface of Linux (`SocketBus`, by `SocketCAN`): a thread reads the frames
//! into memory, the kernel filters for the 32 identifiers of a machine, and an interface that was
//! removed is opened again.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use loadtwin_common::io::frame::IDS_PER_MACHINE;
use socketcan::{
    CanAnyFrame, CanDataFrame, CanFdFrame, CanFdSocket, CanFilter, CanRemoteFrame, EmbeddedFrame,
    ExtendedId, Frame, Id, ShouldRetry, Socket, SocketOptions, StandardId, id::FdFlags,
};

use super::CanError;
use super::bus::{Backoff, Bus, BusError, Received, next_within};
use super::bus_frame::{BusFrame, ERROR_FLAG, FrameKind};

/// Level of the options of any socket, Linux on every architecture that has `SocketCAN` here.
const SOL_SOCKET: i32 = 1;

/// Option: receive buffer (bytes), up to the limit of the system.
const SO_RCVBUF: i32 = 8;

/// Option: the same beyond that limit, for privileged users.
const SO_RCVBUFFORCE: i32 = 33;
/// Receive buffer (bytes): ten thousand frames while the reader is not scheduled.
const RECEIVE_BUFFER: i32 = 8 << 20;
/// How often the reader looks whether it is to end.
const POLL: Duration = Duration::from_millis(50);

/// Bit of an identifier: it has 29 bits (`CAN_EFF_FLAG`).
const EXTENDED: u32 = 0x8000_0000;

// Numbers of Linux on every architecture that has SocketCAN here.
const ENXIO: i32 = 6;
const ENODEV: i32 = 19;
const ENETDOWN: i32 = 100;
const ENOBUFS: i32 = 105;

/// A CAN interface.
///
/// One thread does nothing but empty the socket into memory, so that nothing
/// the bus delivers is lost while a sample is computed. With a block of
/// identifiers the kernel holds back everything else; a second socket counts it.
pub struct SocketBus {
    interface: String,
    socket: CanFdSocket,
    received: Receiver<Result<Received, BusError>>,
    foreign: Arc<AtomicU64>,
    stop: Arc<AtomicBool>,
    start: Instant,
}

/// Opens a socket; with a block, for it alone, or for all but it.
fn open(interface: &str, block: Option<u16>, inverted: bool) -> io::Result<CanFdSocket> {
    let socket = CanFdSocket::open(interface)?;
    if let Some(base) = block {
        let mask = u32::from(0x7FF & !(IDS_PER_MACHINE - 1)) | EXTENDED;
        let filter = if inverted {
            CanFilter::new_inverted
        } else {
            CanFilter::new
        };
        socket.set_filters(&[filter(base.into(), mask)])?;
    }
    if !inverted {
        socket.set_error_filter_accept_all()?;
        socket.set_recv_timestamp(true)?;
        // The second is limited by the system; the first needs a privilege.
        socket
            .set_socket_option_int(SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER)
            .or_else(|_| socket.set_socket_option_int(SOL_SOCKET, SO_RCVBUF, RECEIVE_BUFFER))?;
    }
    socket.set_read_timeout(POLL)?;
    Ok(socket)
}

fn is_removed(error: &io::Error) -> bool {
    matches!(error.raw_os_error(), Some(ENODEV | ENXIO))
}

fn classify(error: io::Error) -> BusError {
    match error.raw_os_error() {
        Some(ENETDOWN | ENODEV | ENXIO) => BusError::Down,
        Some(ENOBUFS) => BusError::Full,
        _ if error.should_retry() => BusError::Full,
        _ => BusError::Io(error),
    }
}

impl SocketBus {
    /// Opens `interface`; with `block`, for the 32 identifiers from there.
    ///
    /// # Errors
    /// When there is no such interface, or no CAN in this kernel.
    pub fn open(interface: &str, block: Option<u16>) -> Result<Self, CanError> {
        let opened = |result: io::Result<CanFdSocket>| {
            result.map_err(|source| CanError::Open {
                interface: interface.to_owned(),
                source,
            })
        };
        let socket = opened(open(interface, block, false))?;
        socket.set_filter_drop_all().map_err(BusError::Io)?;
        socket.set_nonblocking(true).map_err(BusError::Io)?;
        let reader = opened(open(interface, block, false))?;
        let (sender, received) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let foreign = Arc::new(AtomicU64::new(0));
        {
            let (stop, interface) = (Arc::clone(&stop), interface.to_owned());
            thread::spawn(move || read(reader, &interface, block, &sender, &stop));
        }
        if block.is_some() {
            let others = opened(open(interface, block, true))?;
            let (stop, foreign) = (Arc::clone(&stop), Arc::clone(&foreign));
            let interface = interface.to_owned();
            thread::spawn(move || count(others, &interface, block, &foreign, &stop));
        }
        let start = Instant::now();
        Ok(Self {
            interface: interface.to_owned(),
            socket,
            received,
            foreign,
            stop,
            start,
        })
    }
}

/// The frame of the socket as a bus has it.
fn received(frame: &CanAnyFrame) -> Option<BusFrame> {
    let (id, is_extended) = (frame.raw_id(), frame.is_extended());
    match frame {
        CanAnyFrame::Normal(frame) => BusFrame::new(FrameKind::Data, id, is_extended, frame.data()),
        CanAnyFrame::Fd(frame) => {
            let flags = frame.flags().bits() & 3;
            BusFrame::new(FrameKind::Fd { flags }, id, is_extended, frame.data())
        }
        CanAnyFrame::Remote(frame) => BusFrame::remote(id, is_extended, frame.dlc() as u8),
        CanAnyFrame::Error(frame) => {
            BusFrame::new(FrameKind::Error, id & !ERROR_FLAG, false, frame.data())
        }
    }
}

/// The frame as the socket takes it; none of what no socket sends.
fn to_send(frame: &BusFrame) -> Option<CanAnyFrame> {
    let id: Id = if frame.is_extended() {
        ExtendedId::new(frame.id())?.into()
    } else {
        StandardId::new(u16::try_from(frame.id()).ok()?)?.into()
    };
    match frame.kind() {
        FrameKind::Data => CanDataFrame::new(id, frame.data()).map(CanAnyFrame::Normal),
        FrameKind::Fd { flags } => {
            let flags = FdFlags::from_bits_truncate(flags);
            CanFdFrame::with_flags(id, frame.data(), flags).map(CanAnyFrame::Fd)
        }
        FrameKind::Remote => {
            CanRemoteFrame::new_remote(id, usize::from(frame.length())).map(CanAnyFrame::Remote)
        }
        FrameKind::Error => None,
    }
}

/// Empties the socket until stopped; opens it again when the interface was replaced.
fn read(
    mut socket: CanFdSocket,
    interface: &str,
    block: Option<u16>,
    sender: &Sender<Result<Received, BusError>>,
    stop: &AtomicBool,
) {
    let mut backoff = Backoff::new(Duration::from_millis(10), Duration::from_millis(200));
    while !stop.load(Ordering::Relaxed) {
        let message = match socket.read_frame_with_timestamp() {
            Ok((frame, time)) => {
                backoff.reset();
                let since = time
                    .duration_since(SystemTime::UNIX_EPOCH)
                    .unwrap_or_default();
                let Some(frame) = received(&frame) else {
                    continue;
                };
                Ok(Received {
                    t_us: since.as_micros() as u64,
                    frame,
                })
            }
            Err(error) if error.should_retry() => continue,
            // A frame that is none: malformed by who sent it, not our fault.
            Err(error) if error.kind() == io::ErrorKind::InvalidData => continue,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => {
                thread::sleep(backoff.delay());
                // Only down: the same socket goes on, with what it holds.
                if is_removed(&error)
                    && let Ok(again) = open(interface, block, false)
                {
                    socket = again;
                }
                Err(classify(error))
            }
        };
        if sender.send(message).is_err() {
            return;
        }
    }
}

/// Counts what passes by.
fn count(
    mut socket: CanFdSocket,
    interface: &str,
    block: Option<u16>,
    foreign: &AtomicU64,
    stop: &AtomicBool,
) {
    while !stop.load(Ordering::Relaxed) {
        match socket.read_frame() {
            Ok(_) => {
                foreign.fetch_add(1, Ordering::Relaxed);
            }
            Err(error) if error.should_retry() => {}
            Err(error) => {
                thread::sleep(POLL);
                if is_removed(&error)
                    && let Ok(again) = open(interface, block, true)
                {
                    socket = again;
                }
            }
        }
    }
}

impl Drop for SocketBus {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

impl Bus for SocketBus {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
        next_within(&self.received, timeout)
    }

    fn send(&mut self, frame: &BusFrame) -> Result<(), BusError> {
        let Some(frame) = to_send(frame) else {
            return Ok(());
        };
        self.socket.write_frame(&frame).map_err(|error| {
            // The index of a removed interface is not taken again: look the name up.
            if is_removed(&error)
                && let Ok(again) = open(&self.interface, None, false)
                && again
                    .set_filter_drop_all()
                    .and_then(|()| again.set_nonblocking(true))
                    .is_ok()
            {
                self.socket = again;
            }
            classify(error)
        })
    }

    /// The kernel restarts the controller by itself (`ip link set .. restart-ms`).
    fn restart(&mut self) -> Result<(), BusError> {
        Ok(())
    }

    fn now(&self) -> Duration {
        self.start.elapsed()
    }

    fn wait(&mut self, time: Duration) {
        thread::sleep(time);
    }

    fn foreign(&self) -> u64 {
        self.foreign.load(Ordering::Relaxed)
    }
}
