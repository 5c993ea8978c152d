//! Controls the application on an emulated Cortex-M4F (QEMU): flash, serial line of the bus,
//! serial line of the sensors, end.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpListener;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{OnceLock, mpsc};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use std::{fs, io};

use defmt_decoder::{DecodeError, Table};
use loadtwin::can;
use loadtwin::can::bus::{BusError, Received};
use loadtwin::can::bus_frame::BusFrame;
use loadtwin::key::SigningKey;
use loadtwin::seal::seal;
use loadtwin::upload_protocol::{Next, UploadError, Uploader};
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::raw::RawSample;
use loadtwin_common::io::signed_image::KEY_PAGE_LEN;
use loadtwin_common::io::uds;
use loadtwin_firmware::ram_flash::{self, KEY_AT, LAYOUT, RamFlash};
use loadtwin_firmware::slcan;
use loadtwin_firmware::store::Store;
use tempfile::TempDir;

use crate::sensor_line::{Sensors, stored_messages};

/// The machine that every emulated board is on.
pub const MACHINE_ID: &str = "test bench";

/// 8 ns an instruction, and the time between two samples is skipped.
const SKIPPED_TIME: &str = "shift=3,sleep=off";

/// The board while it runs.
pub struct Emulator {
    qemu: Child,
    place: TempDir,
    log: JoinHandle<String>,
    sensors: UnixStream,
}

/// How a run ended.
#[derive(Debug)]
pub struct End {
    /// Success only where the test asked for the end.
    pub status: ExitStatus,
    /// What the firmware logged, a line a message, and what the emulator said.
    pub log: String,
}

/// What every emulated board is.
pub const MACHINE: [&str; 10] = [
    "-M",
    "mps2-an386",
    "-cpu",
    "cortex-m4",
    "-display",
    "none",
    "-monitor",
    "none",
    "-semihosting-config",
    "enable=on,target=native",
];

/// The emulated board's binary.
pub fn binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| crate::firmware::build("emulated", "emulated"))
}

/// A flash for models with `key` in its page that has taken `images`, one after
/// the other.
///
/// # Panics
/// Where an image is refused.
pub fn flash(key: &SigningKey, images: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = vec![0xFF; ram_flash::LEN];
    bytes[KEY_AT..KEY_AT + KEY_PAGE_LEN].copy_from_slice(&key.identity(MACHINE_ID).to_page());
    for image in images {
        let mut store = Store::boot(
            RamFlash(bytes),
            LAYOUT,
            Some(key.identity(MACHINE_ID)),
            |_, _, _| Ok(()),
        )
        .expect("the layout fits");
        store
            .begin(image, |_| Ok(()))
            .expect("it is signed, and newer");
        while !store.install_page(image).expect("the flash is whole") {}
        store.finish().expect("it is whole");
        bytes = store.release().0;
    }
    bytes
}

/// Runs one of the emulated board's programs that needs no line, to its end.
///
/// # Panics
/// Where the rig does not start.
pub fn run(program: &str) -> End {
    let binary = crate::firmware::build("emulated", program);
    let output = Command::new("qemu-system-arm")
        .args(MACHINE)
        .args(["-serial", "none"])
        .arg("-kernel")
        .arg(&binary)
        .output()
        .expect("qemu-system-arm starts; tests/run installs it");
    let elf = fs::read(&binary).expect("the binary was built");
    let mut log = decode(&elf, &output.stdout);
    log += &String::from_utf8_lossy(&output.stderr);
    End {
        status: output.status,
        log,
    }
}

impl Emulator {
    /// Starts the board with a model, sealed by a key of its own; it waits until
    /// [`Self::bus`] or somebody else listens on its bus.
    ///
    /// # Panics
    /// Where the rig does not start.
    pub fn start(model: &[u8]) -> Self {
        Self::start_stored(model, &[])
    }

    /// As [`Self::start`], with `samples` in the board's memory for [`Sensors::send_stored`]: over the line
    /// they take five times the processor time: each byte is a turn of the emulator's main loop.
    ///
    /// # Panics
    /// Where the rig does not start.
    pub fn start_stored(model: &[u8], samples: &[RawSample]) -> Self {
        let key = SigningKey::generate().expect("random numbers");
        let image = seal(model, MACHINE_ID, 1, None, Some(&key)).expect("a model of that length");
        Self::start_timed(&flash(&key, &[image]), samples, SKIPPED_TIME)
    }

    /// As [`Self::start`], with the whole content of the flash for models.
    ///
    /// # Panics
    /// Where the rig does not start.
    pub fn start_flash(flash: &[u8]) -> Self {
        Self::start_timed(flash, &[], SKIPPED_TIME)
    }

    /// As [`Self::start_flash`]; the board's clock does not run ahead of ours, so that
    /// an upload meets the same time-outs on both sides.
    ///
    /// # Panics
    /// Where the rig does not start.
    pub fn start_paced(flash: &[u8]) -> Self {
        Self::start_timed(flash, &[], "shift=3,sleep=on")
    }

    fn start_timed(flash: &[u8], samples: &[RawSample], icount: &str) -> Self {
        let binary = binary();
        let place = TempDir::new().expect("a temporary directory");
        let slot = place.path().join("model");
        fs::write(&slot, flash).expect("the flash is written");
        let stored = place.path().join("stored");
        fs::write(&stored, stored_messages(samples)).expect("the samples are written");
        let line = |name: &str| {
            let path = place.path().join(name);
            format!("unix:{},server=on,wait=on", path.display())
        };
        let mut qemu = Command::new("qemu-system-arm")
            .args(MACHINE)
            .args(["-icount", icount])
            .args(["-serial", &line("sensors"), "-serial", &line("bus")])
            .arg("-device")
            .arg(format!(
                "loader,file={},addr=0x300000,force-raw=on",
                slot.display()
            ))
            .arg("-device")
            .arg(format!(
                "loader,file={},addr=0x21100000,force-raw=on",
                stored.display()
            ))
            .arg("-kernel")
            .arg(binary)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("qemu-system-arm starts; tests/run installs it");
        let elf = fs::read(binary).expect("the binary was built");
        let mut logged = qemu.stdout.take().expect("piped");
        let mut said = qemu.stderr.take().expect("piped");
        let log = thread::spawn(move || {
            let mut bytes = Vec::new();
            logged.read_to_end(&mut bytes).expect("a pipe");
            let mut text = decode(&elf, &bytes);
            said.read_to_string(&mut text).expect("text");
            text
        });
        let sensors = connect(&place.path().join("sensors"));
        Self {
            qemu,
            place,
            log,
            sensors,
        }
    }

    /// Path of the socket on which one other program finds the board's bus.
    pub fn bus_socket(&self) -> PathBuf {
        self.place.path().join("bus")
    }

    /// Puts the board's bus through to who connects to `listener` first.
    ///
    /// Whatever that one is too slow to take is kept, so that the board finds the
    /// line as free as a bus: where it had to wait, its queue would run over.
    ///
    /// # Panics
    /// In a thread of its own, where the board does not offer its bus.
    pub fn relay(&self, listener: TcpListener) {
        let bus = self.bus_socket();
        thread::spawn(move || {
            let (mut peer, _) = listener.accept().expect("a socket of ours");
            let mut board = connect(&bus);
            let (kept, taken) = mpsc::channel::<Vec<u8>>();
            let mut to_peer = peer.try_clone().expect("a socket");
            thread::spawn(move || {
                for bytes in taken {
                    if to_peer.write_all(&bytes).is_err() {
                        return;
                    }
                }
            });
            let mut to_board = board.try_clone().expect("a socket");
            thread::spawn(move || io::copy(&mut peer, &mut to_board));
            let mut buffer = [0; 4096];
            while let Ok(n @ 1..) = board.read(&mut buffer) {
                // A peer that has gone makes the board wait no more than one that is slow.
                let _ = kept.send(buffer[..n].to_vec());
            }
        });
    }

    /// The board's bus.
    ///
    /// # Panics
    /// Where the board does not offer it.
    pub fn bus(&self) -> Bus {
        let stream = connect(&self.bus_socket());
        Bus {
            reader: BufReader::new(stream.try_clone().expect("a socket")),
            writer: stream,
        }
    }

    /// The line to the sensors; write to it from a thread of its own, for it
    /// takes no more than the board has room for.
    ///
    /// # Panics
    /// Where the socket cannot be cloned.
    pub fn sensors(&self) -> Sensors {
        Sensors(self.sensors.try_clone().expect("a socket"))
    }

    /// Waits for the end, `within` at most.
    ///
    /// # Panics
    /// Where the board still runs after that time.
    pub fn end(mut self, within: Duration) -> End {
        let latest = Instant::now() + within;
        loop {
            if let Some(status) = self.qemu.try_wait().expect("the emulator is ours") {
                let log = self.log.join().expect("the log is text");
                return End { status, log };
            }
            if Instant::now() > latest {
                self.qemu.kill().expect("the emulator is ours");
                let log = self.log.join().expect("the log is text");
                panic!("the emulated board still runs after {within:?}; its log:\n{log}");
            }
            thread::sleep(Duration::from_millis(5));
        }
    }
}

/// The board's bus as this process sees it.
pub struct Bus {
    reader: BufReader<UnixStream>,
    writer: UnixStream,
}

impl Bus {
    /// Puts a frame on the bus.
    ///
    /// # Panics
    /// Where the board is gone.
    pub fn send(&mut self, frame: &Frame) {
        assert!(self.try_send(frame), "the board is gone");
    }

    /// As [`Self::send`]; gives whether the board is still there.
    pub fn try_send(&mut self, frame: &Frame) -> bool {
        self.writer.write_all(&slcan::encode(frame)).is_ok()
    }

    /// Uploads an image with the host's own uploader; gives what came of it and
    /// the frames that were no answers.
    ///
    /// # Panics
    /// Where the board is gone.
    pub fn upload(&mut self, image: Vec<u8>) -> (Result<(), UploadError>, Vec<Frame>) {
        let start = Instant::now();
        let mut others = Vec::new();
        let mut uploader = match Uploader::new(image) {
            Ok(uploader) => uploader,
            Err(error) => return (Err(error), others),
        };
        loop {
            match uploader.poll(start.elapsed().as_micros() as u32) {
                Next::Frame(data) => self.send(&Frame {
                    id: uds::REQUEST_ID,
                    data,
                }),
                Next::Wait(_) => {
                    let frame = self.next().expect("the board runs");
                    if frame.id == uds::ANSWER_ID {
                        uploader.on_frame(&frame.data, start.elapsed().as_micros() as u32);
                    } else {
                        others.push(frame);
                    }
                }
                Next::Accepted => return (Ok(()), others),
                Next::Failed(error) => return (Err(error), others),
            }
        }
    }
}

impl Iterator for Bus {
    type Item = Frame;

    /// The next frame; none after the end.
    fn next(&mut self) -> Option<Frame> {
        let mut line = Vec::new();
        self.reader.read_until(b'\r', &mut line).ok()?;
        let mut decoder = slcan::Decoder::default();
        match line.iter().find_map(|byte| decoder.push(*byte))? {
            slcan::Line::Frame(frame) => Some(frame),
            other => panic!(
                "the board sent {other:?}: {:?}",
                String::from_utf8_lossy(&line)
            ),
        }
    }
}

/// The board's bus as the host's programs use one.
pub struct CanBus {
    bus: Bus,
    /// The line that has come so far.
    line: Vec<u8>,
    start: Instant,
}

impl CanBus {
    /// `bus` from now on.
    pub fn new(bus: Bus) -> Self {
        let (line, start) = (Vec::new(), Instant::now());
        Self { bus, line, start }
    }

    /// The bus below.
    ///
    /// # Panics
    /// Where the socket refuses a time limit.
    pub fn into_inner(self) -> Bus {
        let socket = self.bus.reader.get_ref();
        socket.set_read_timeout(None).expect("a socket");
        self.bus
    }
}

impl can::bus::Bus for &mut CanBus {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
        let limit = Some(timeout.max(Duration::from_millis(1)));
        self.bus.reader.get_ref().set_read_timeout(limit)?;
        match self.bus.reader.read_until(b'\r', &mut self.line) {
            Ok(0) => return Err(BusError::Ended),
            Ok(_) => {}
            // What has come of the line stays.
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
            Err(error) => return Err(error.into()),
        }
        let mut decoder = slcan::Decoder::default();
        let line = std::mem::take(&mut self.line);
        let found = line.iter().find_map(|byte| decoder.push(*byte));
        let t_us = self.start.elapsed().as_micros() as u64;
        Ok(match found {
            Some(slcan::Line::Frame(frame)) => Some(Received {
                t_us,
                frame: can::to_bus(&frame),
            }),
            _ => None,
        })
    }

    fn send(&mut self, frame: &BusFrame) -> Result<(), BusError> {
        let (id, data) = can::standard(frame).ok_or(BusError::Down)?;
        let data = data.try_into().map_err(|_| BusError::Down)?;
        Ok(self
            .bus
            .writer
            .write_all(&slcan::encode(&Frame { id, data }))?)
    }

    fn restart(&mut self) -> Result<(), BusError> {
        Ok(())
    }

    fn now(&self) -> Duration {
        self.start.elapsed()
    }

    fn wait(&mut self, time: Duration) {
        thread::sleep(time);
    }
}

fn connect(path: &Path) -> UnixStream {
    let latest = Instant::now() + Duration::from_secs(20);
    loop {
        match UnixStream::connect(path) {
            Ok(stream) => return stream,
            Err(error) if Instant::now() > latest => {
                panic!("{}: {error}", path.display());
            }
            Err(_) => thread::sleep(Duration::from_millis(5)),
        }
    }
}

fn decode(elf: &[u8], bytes: &[u8]) -> String {
    let Ok(Some(table)) = Table::parse(elf) else {
        return "(no log in this binary)\n".into();
    };
    let mut decoder = table.new_stream_decoder();
    decoder.received(bytes);
    let mut text = String::new();
    loop {
        match decoder.decode() {
            Ok(frame) => {
                text += &frame.display(false).to_string();
                text.push('\n');
            }
            Err(DecodeError::UnexpectedEof) => return text,
            Err(DecodeError::Malformed) => text += "(damaged log)\n",
        }
    }
}
