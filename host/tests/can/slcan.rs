//! A serial adapter: what a machine sends in a minute, over a pseudo-terminal.
#![cfg(unix)]

use std::fmt::Write as _;
use std::io::{Read, Write};
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::Duration;

use loadtwin::can::bus_frame::{BusFrame, FrameKind};
use loadtwin::can::comparison::Verdict;
use loadtwin::can::page::Quiet;
use loadtwin::can::source::Source;
use loadtwin::can::twin::{self, TwinArgs};
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
            twin::run(&model, bus, &args, &mut Quiet, &AtomicBool::new(false)).expect("ran")
        });
        assert_eq!(summary.verdict, Verdict::Identical);
        let figures = summary.figures;
        assert_eq!(figures.samples, taken.len() as u64);
        assert_eq!((figures.lost_frames, figures.differing_bits), (0, 0));
    }
}
