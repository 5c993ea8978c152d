//! Test gearbox: its model image, raw samples, and the frames of the application on the host.

use std::path::Path;

use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::Machine;
use loadtwin_common::io::frame::{Frame, signal_layout};
use loadtwin_common::io::raw::RawSample;
use loadtwin_firmware::app::App;

use crate::bench::Bench;

/// The model image of `tests/machines/gearbox.toml`.
///
/// # Panics
/// Where it cannot be built.
pub fn image() -> Vec<u8> {
    image_of(&machine())
}

/// The description `tests/machines/gearbox.toml`.
///
/// # Panics
/// Where it cannot be read.
pub fn machine() -> Machine {
    let path = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/machines/gearbox.toml"
    ));
    Machine::load(path).expect("the description is valid")
}

/// The model image of a machine with its first set of sensors.
///
/// # Panics
/// Where it cannot be built.
pub fn image_of(machine: &Machine) -> Vec<u8> {
    let sensors = Sensors::choose(machine, None).expect("few enough sensors");
    image_build::image(machine, &sensors).expect("the machine fits an image")
}

/// Whether the frame is the same wherever it is computed: all but the status and what a board says
/// of itself.
pub fn is_estimate(frame: &Frame) -> bool {
    let offset = frame.id % loadtwin_common::io::frame::IDS_PER_MACHINE;
    ![signal_layout::status::OFFSET, signal_layout::board::OFFSET].contains(&offset)
}

/// A torque that ramps and swings, a shaft that turns, and the faults that
/// a converter and an encoder have.
pub fn samples(count: u32) -> Vec<RawSample> {
    let mut angle = 0.0_f64;
    (0..count)
        .filter(|tick| tick % 977 != 976)
        .map(|tick| {
            let t = f64::from(tick) * 1e-3;
            let torque = 400.0 * (t / 2.0).min(1.0) + 100.0 * (7.0 * t).sin();
            angle += 1e-3 * (8.0 + (0.5 * t).sin());
            let counts = (angle / std::f64::consts::TAU * 4096.0).floor() as i64;
            let ripple = i64::from(tick.wrapping_mul(2_654_435_761) >> 20) - 2048;
            let mut raw = RawSample {
                tick,
                ..RawSample::default()
            };
            raw.set_word(0, (torque * 100.0) as i32 + ripple as i32 / 8);
            if tick % 311 != 310 {
                raw.set_word(1, 10_000 - (torque * 200.0) as i32 - ripple as i32 / 6);
            }
            if tick % 1009 == 1008 {
                raw.set_word(0, 0x7F_FFFF);
            }
            raw.set_encoder(0, counts as u32 & 0xFFFF);
            if counts % 4096 < 6 && tick % 3 == 0 {
                raw.index = Some((counts - counts % 4096) as u32 & 0xFFFF);
            }
            raw
        })
        .collect()
}

/// The frames of the same application on the host, with the raw samples too
/// where they are wanted.
///
/// # Panics
/// Where the image is refused.
pub fn on_host(image: &[u8], samples: &[RawSample], with_raw: bool) -> Vec<Frame> {
    let mut app = App::try_new(image, 0).expect("the image is valid");
    app.sends_raw = with_raw;
    run(&mut app, samples)
}

/// The frames of an application on a board that takes all of them.
pub fn run(app: &mut App<'_>, samples: &[RawSample]) -> Vec<Frame> {
    let mut board = Bench::with_room_for(usize::MAX);
    for sample in samples {
        board.sample = Some(*sample);
        app.on_data_ready(&mut board);
    }
    board.outbox.into()
}
