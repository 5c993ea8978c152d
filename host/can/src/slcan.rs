//! A `Bus` over a serial adapter that speaks slcan (LAWICEL), as `CANable` and `USBtin`
//! (`SlcanBus`): opens the adapter at a bit rate, encodes frames as its lines of text, and decodes
//! those that it sends. Frames that it refuses are counted.
//!
//! `tIIILDD..` and a carriage return is a classic frame, `T` one of 29 bits, `r` and `R` a request;
//! `d`, `D`, `b`, `B` are the FD frames of `CANable` 2.0, the last two sent at two rates.

use std::io::{ErrorKind, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use serialport::SerialPort;

use super::CanError;
use super::bus::{Bus, BusError, Received, next_within};
use super::bus_frame::{BusFrame, FrameKind};

/// Bit rates of the commands `S0` to `S8` (bit/s).
const BIT_RATES: [u32; 9] = [
    10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000,
];

/// Rate of the serial line (bit/s); adapters on USB ignore it.
const LINE_RATE: u32 = 115_200;

/// The answer that refuses a command or a frame.
const BELL: u8 = 7;

/// How often the reader looks whether it is to end.
const POLL: Duration = Duration::from_millis(50);

/// Longest time for which the adapter may take no bytes.
const PATIENCE: Duration = Duration::from_secs(1);

/// Within this an adapter answers a command; some never do.
const ANSWER: Duration = Duration::from_millis(300);

/// Longest line: an FD frame of 64 bytes with its stamp (bytes).
const LONGEST: usize = 160;

/// A serial adapter.
pub struct SlcanBus {
    port: Box<dyn SerialPort>,
    received: Receiver<Result<Received, BusError>>,
    stop: Arc<AtomicBool>,
    start: Instant,
    /// Frames that the adapter refused.
    refused: Arc<AtomicU64>,
    /// Whether it answered the commands that open the bus.
    answers: bool,
}

impl SlcanBus {
    /// Opens the adapter at `port` and its bus with `bit_rate` (bit/s).
    ///
    /// # Errors
    /// When there is no such port, slcan has no such bit rate, or the adapter refuses it.
    pub fn open(port: &str, bit_rate: u32) -> Result<Self, CanError> {
        let failed = |source: std::io::Error| CanError::Open {
            interface: port.to_owned(),
            source,
        };
        let code = BIT_RATES
            .iter()
            .position(|rate| *rate == bit_rate)
            .ok_or_else(|| {
                let allowed: Vec<_> = BIT_RATES.iter().map(u32::to_string).collect();
                let allowed = allowed.join(", ");
                let message = format!("{bit_rate} bit/s; allowed for slcan: {allowed}");
                failed(std::io::Error::new(ErrorKind::InvalidInput, message))
            })?;
        let mut serial = serialport::new(port, LINE_RATE)
            .timeout(POLL)
            .open()
            .map_err(|error| failed(error.into()))?;
        let reader = serial.try_clone().map_err(|error| failed(error.into()))?;
        // An adapter whose bus is closed already refuses to close it, an open one still has frames.
        command(serial.as_mut(), "C").map_err(failed)?;
        let mut answers = true;
        for (text, what) in [
            (format!("S{code}"), format!("{bit_rate} bit/s")),
            ("O".to_owned(), "to open its bus".to_owned()),
        ] {
            match command(serial.as_mut(), &text).map_err(failed)? {
                Some(true) => {}
                Some(false) => {
                    let message = format!("the adapter refuses {what} (`{text}`)");
                    return Err(failed(std::io::Error::other(message)));
                }
                None => answers = false,
            }
        }
        let (sender, received) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let refused = Arc::new(AtomicU64::new(0));
        let (stopped, refusals) = (Arc::clone(&stop), Arc::clone(&refused));
        thread::spawn(move || read(reader, &sender, &stopped, &refusals));
        Ok(Self {
            port: serial,
            received,
            stop,
            start: Instant::now(),
            refused,
            answers,
        })
    }

    fn write(&mut self, mut bytes: &[u8]) -> Result<(), BusError> {
        let deadline = Instant::now() + PATIENCE;
        while !bytes.is_empty() {
            match self.port.write(bytes) {
                Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
                Err(error) if is_wait(error.kind()) && Instant::now() < deadline => {}
                Err(error) if is_wait(error.kind()) => return Err(BusError::Down),
                Err(error) => return Err(gone_or(error)),
            }
        }
        Ok(())
    }
}

/// Sends a command and waits for its answer: true for a carriage return, false for a bell, none
/// where none comes in time.
fn command(port: &mut dyn SerialPort, text: &str) -> std::io::Result<Option<bool>> {
    port.write_all(format!("{text}\r").as_bytes())?;
    let deadline = Instant::now() + ANSWER;
    // One at a time: behind the answer come frames.
    let mut byte = [0];
    while Instant::now() < deadline {
        match port.read(&mut byte) {
            Ok(0) => break,
            Ok(_) if byte == [b'\r'] => return Ok(Some(true)),
            Ok(_) if byte == [BELL] => return Ok(Some(false)),
            Ok(_) => {}
            Err(error) if is_wait(error.kind()) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(None)
}

/// What an error of the port means: another side that was closed is an adapter that is gone.
fn gone_or(error: std::io::Error) -> BusError {
    match error.kind() {
        ErrorKind::BrokenPipe | ErrorKind::NotFound => BusError::Gone,
        _ => error.into(),
    }
}

fn is_wait(kind: ErrorKind) -> bool {
    matches!(
        kind,
        ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
    )
}

/// Passes on the frames that come until stopped.
fn read(
    mut port: Box<dyn SerialPort>,
    sender: &Sender<Result<Received, BusError>>,
    stop: &AtomicBool,
    refused: &AtomicU64,
) {
    let mut line = Vec::with_capacity(LONGEST);
    let mut bytes = [0; 4096];
    while !stop.load(Ordering::Relaxed) {
        let count = match port.read(&mut bytes) {
            // The other side of a terminal is closed.
            Ok(0) => {
                let _ = sender.send(Err(BusError::Gone));
                return;
            }
            Ok(count) => count,
            Err(error) if is_wait(error.kind()) => continue,
            Err(error) => {
                let _ = sender.send(Err(gone_or(error)));
                return;
            }
        };
        let since = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default();
        let t_us = since.as_micros() as u64;
        for byte in bytes.iter().take(count) {
            if *byte == BELL {
                refused.fetch_add(1, Ordering::Relaxed);
            }
            if !matches!(*byte, b'\r' | BELL) {
                if line.len() < LONGEST {
                    line.push(*byte);
                }
                continue;
            }
            let frame = std::str::from_utf8(&line).ok().and_then(decode);
            line.clear();
            if let Some(frame) = frame
                && sender.send(Ok(Received { t_us, frame })).is_err()
            {
                return;
            }
        }
    }
}

/// The frame of a line; none of an answer, or where the line is damaged.
fn decode(line: &str) -> Option<BusFrame> {
    let kind = line.get(..1)?;
    let rest = line.get(1..)?;
    let is_extended = kind.chars().all(char::is_uppercase);
    let digits = if is_extended { 8 } else { 3 };
    let hex = |text: &str| {
        let is_hex = text.bytes().all(|b| b.is_ascii_hexdigit());
        u32::from_str_radix(text, 16).ok().filter(|_| is_hex)
    };
    let frame_kind = match kind.to_ascii_lowercase().as_str() {
        "t" => FrameKind::Data,
        "r" => FrameKind::Remote,
        "d" => FrameKind::Fd { flags: 0 },
        "b" => FrameKind::Fd { flags: 1 },
        _ => return None,
    };
    let id = hex(rest.get(..digits)?)?;
    let code = hex(rest.get(digits..=digits)?)? as u8;
    let data = rest.get(digits + 1..)?;
    if frame_kind == FrameKind::Remote {
        return BusFrame::remote(id, is_extended, code);
    }
    let length = usize::from(BusFrame::length_of_code(code)?);
    // A stamp of four digits may follow.
    if data.len() != 2 * length && data.len() != 2 * length + 4 {
        return None;
    }
    let bytes: Option<Vec<u8>> = (0..length)
        .map(|i| Some(hex(data.get(2 * i..2 * i + 2)?)? as u8))
        .collect();
    BusFrame::new(frame_kind, id, is_extended, &bytes?)
}

/// The line of a frame; none of what no adapter sends.
fn encode(frame: &BusFrame) -> Option<String> {
    let kind = match frame.kind() {
        FrameKind::Data => 't',
        FrameKind::Remote => 'r',
        FrameKind::Fd { flags } if flags & 1 != 0 => 'b',
        FrameKind::Fd { .. } => 'd',
        FrameKind::Error => return None,
    };
    let code = (0..16).find(|code| BusFrame::length_of_code(*code) == Some(frame.length()))?;
    let mut line = if frame.is_extended() {
        format!("{}{:08X}{code:X}", kind.to_ascii_uppercase(), frame.id())
    } else {
        format!("{kind}{:03X}{code:X}", frame.id())
    };
    for byte in frame.data() {
        line += &format!("{byte:02X}");
    }
    line.push('\r');
    Some(line)
}

impl Drop for SlcanBus {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // Nothing is left to be done where the adapter is gone.
        let _ = self.port.write_all(b"C\r");
    }
}

impl Bus for SlcanBus {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Received>, BusError> {
        next_within(&self.received, timeout)
    }

    fn send(&mut self, frame: &BusFrame) -> Result<(), BusError> {
        match encode(frame) {
            Some(line) => self.write(line.as_bytes()),
            None => Ok(()),
        }
    }

    fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    fn remark(&self) -> Option<&'static str> {
        (!self.answers).then_some(
            "the adapter does not answer commands; where no frames come, check that it speaks slcan and is free",
        )
    }

    /// The adapter restarts the controller by itself.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_its_line() {
        for (line, shown) in [
            ("t7AF8DEADBEEF0001027F", "7AF#DEADBEEF0001027F"),
            ("T18FF00010", "18FF0001#"),
            ("r1238", "123#R8"),
            (
                "d1239000102030405060708090A0B",
                "123##0000102030405060708090A0B",
            ),
            ("b1231AB", "123##1AB"),
        ] {
            let frame = decode(line).expect(line);
            assert_eq!(frame.to_string(), shown);
            assert_eq!(encode(&frame).expect(line), format!("{line}\r"));
        }
        let stamped = decode("t1232AABB1234").expect("a stamp");
        assert_eq!(stamped.to_string(), "123#AABB");
        for line in [
            "",
            "z",
            "Z",
            "t12",
            "t1232AAB",
            "t8000",
            "t1239",
            "t12G0",
            "V1013",
            "t123é",
            "t1232AABBC",
        ] {
            assert_eq!(decode(line), None, "{line}");
        }
    }
}
