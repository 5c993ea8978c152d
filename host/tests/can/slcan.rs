//! Serial adapter (slcan) over a pseudo-terminal: a minute of a machine is received and compared to
//! the bit; an adapter that refuses, is gone or does not answer is reported.
#![cfg(unix)]

use std::fmt::Write as _;
use std::io::{Read, Write};
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::Duration;

use loadtwin::can::CanError;
use loadtwin::can::bus::{Bus, BusError, Link};
use loadtwin::can::bus_frame::{BusFrame, FrameKind};
use loadtwin::can::frame_comparison::Verdict;
use loadtwin::can::frame_source::Source;
use loadtwin::can::live_display::Quiet;
use loadtwin::can::twin_and_prove::{self, TwinArgs};
use loadtwin::can::{Model, standard};
use serialport::{SerialPort, TTYPort};

use crate::machine::{image, samples, traffic};

/// The line that an adapter sends for a frame of the machine.
fn line(frame: &BusFrame) -> String {
    let (id, data) = standard(frame).expect("a standard frame");
    let kind = if matches!(frame.kind(), FrameKind::Fd { .. }) {
        'd'
    } else {
        't'
    };
    let code = match data.len() {
        8 => 8,
        64 => 15,
        other => panic!("{other} bytes"),
    };
    let bytes = data.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02X}");
        text
    });
    format!("{kind}{id:03X}{code:X}{bytes}\r")
}

#[test]
fn a_minute_of_a_machine_over_a_terminal_is_identical() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    for is_fd in [false, true] {
        let taken = samples(60 * model.image.rate_hz as u32, |_| false);
        let frames = traffic(&model, &taken, is_fd);
        let (mut adapter, terminal) = TTYPort::pair().expect("a pseudo-terminal");
        let name = format!("slcan:{}@500000", terminal.name().expect("a name"));
        adapter
            .set_timeout(Duration::from_secs(10))
            .expect("a time");
        let bus = Source::of(&name)
            .expect("a name")
            .open(None, None)
            .expect("opened");
        let mut opening = [0; 7];
        adapter.read_exact(&mut opening).expect("commands");
        assert_eq!(&opening, b"C\rS6\rO\r");
        let args = TwinArgs {
            interface: name,
            log: None,
            idle: Some(Duration::from_secs(2)),
            samples: None,
            burst: None,
            share: 50,
            fd: false,
        };
        let summary = thread::scope(|scope| {
            scope.spawn(|| {
                // The adapter answers the commands, then passes on what the bus carries.
                adapter.write_all(b"\r\r\r").expect("written");
                for frame in &frames {
                    adapter
                        .write_all(line(&frame.frame).as_bytes())
                        .expect("written");
                }
            });
            twin_and_prove::run(&model, bus, &args, &mut Quiet, &AtomicBool::new(false))
                .expect("ran")
        });
        assert_eq!(summary.verdict, Verdict::Identical);
        let figures = summary.figures;
        assert_eq!(figures.samples, taken.len() as u64);
        assert_eq!((figures.lost_frames, figures.differing_bits), (0, 0));
    }
}

/// A pseudo-terminal, and an adapter at its end that answers each command or frame with what `answer`
/// says, until that says nothing.
fn adapter(
    mut answer: impl FnMut(&str) -> Option<&'static [u8]> + Send + 'static,
) -> (String, thread::JoinHandle<()>, TTYPort) {
    let (mut adapter, terminal) = TTYPort::pair().expect("a pseudo-terminal");
    adapter.set_timeout(Duration::from_secs(5)).expect("a time");
    let name = format!("slcan:{}@500000", terminal.name().expect("a name"));
    let thread = thread::spawn(move || {
        let (mut line, mut byte) = (String::new(), [0]);
        while adapter.read_exact(&mut byte).is_ok() {
            if byte != *b"\r" {
                line.push(char::from(byte[0]));
                continue;
            }
            let Some(bytes) = answer(&line) else { return };
            adapter.write_all(bytes).expect("written");
            line.clear();
        }
    });
    (name, thread, terminal)
}

fn open(name: &str) -> Result<Box<dyn Bus>, CanError> {
    Source::of(name).expect("a name").open(None, None)
}

#[test]
fn a_bit_rate_that_the_adapter_refuses_is_an_error() {
    // A bus that is closed already cannot be closed, which is no error.
    let (name, _adapter, _terminal) =
        adapter(|line| Some(if line == "O" { b"\r" } else { b"\x07" }));
    let error = open(&name).err().expect("refused").to_string();
    assert!(error.contains("refuses 500000 bit/s (`S6`)"), "{error}");
}

#[test]
fn an_adapter_that_is_gone_is_an_error() {
    let mut commands = 0;
    let (name, adapter, terminal) = adapter(move |_| {
        commands += 1;
        (commands < 4).then_some(&b"\r"[..])
    });
    let bus = open(&name).expect("opened");
    assert_eq!(bus.remark(), None);
    let mut link = Link::new(bus, Duration::from_secs(1));
    drop(terminal);
    let frame = BusFrame::new(FrameKind::Data, 0x123, false, &[1]).expect("a frame");
    link.send(&frame, &AtomicBool::new(false)).expect("taken");
    adapter.join().expect("gone");
    let gone = (0..50).find_map(|_| link.receive(Duration::from_millis(100)).err());
    assert!(matches!(gone, Some(BusError::Gone)), "{gone:?}");
}

#[test]
fn frames_that_the_adapter_refuses_are_dropped() {
    let (name, _adapter, _terminal) = adapter(|line| match line {
        "C" | "S6" | "O" => Some(b"\r"),
        _ => Some(b"\x07"),
    });
    let mut link = Link::new(open(&name).expect("opened"), Duration::from_secs(1));
    let frame = BusFrame::new(FrameKind::Data, 0x123, false, &[1]).expect("a frame");
    for _ in 0..3 {
        assert!(link.send(&frame, &AtomicBool::new(false)).expect("taken"));
    }
    let all_answered = (0..50).any(|_| {
        let _ = link.receive(Duration::from_millis(100));
        link.counts().dropped == 3
    });
    assert!(all_answered, "{:?}", link.counts());
    assert_eq!(link.counts().sent, 0);
}

#[test]
fn an_adapter_that_does_not_answer_is_remarked() {
    let (_adapter, terminal) = TTYPort::pair().expect("a pseudo-terminal");
    let name = format!("slcan:{}@500000", terminal.name().expect("a name"));
    let bus = open(&name).expect("opened");
    assert!(bus.remark().expect("a remark").contains("does not answer"));
}
