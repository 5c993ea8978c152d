//! Test machine of the CAN tests: its model, raw samples and the frames that it sends.

use std::path::Path;

use loadtwin::can::bus::Received;
use loadtwin::can::{Model, to_bus, to_bus_fd};
use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::Machine;
use loadtwin_common::io::frame::{State, Status};
use loadtwin_common::io::raw::RawSample;

pub fn image() -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/two_inertias.toml");
    let machine = Machine::load(&path).expect("a good machine");
    let sensors = Sensors::choose(&machine, None).expect("its sensors");
    image_build::image(&machine, &sensors).expect("an image")
}

/// A second a turn, a noisy torque, with a lost word, a repeated word and an
/// index pulse now and then; `lost` ticks are left out.
pub fn samples(count: u32, lost: impl Fn(u32) -> bool) -> Vec<RawSample> {
    let mut noise = 1_u32;
    let mut samples = Vec::new();
    for tick in (0..count).filter(|tick| !lost(*tick)) {
        let mut sample = RawSample {
            tick,
            ..RawSample::default()
        };
        for channel in 0..2 {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            if noise >> 24 != 7 {
                sample.set_word(channel, 20_000 + (noise >> 20) as i32 + tick as i32 % 3000);
            }
        }
        let count = tick * 492;
        sample.set_encoder(0, count);
        if tick % 500 == 100 {
            sample.index = Some(count - 17);
        }
        samples.push(sample);
    }
    samples
}

/// What a machine of `model` with `samples` puts on a bus, with its raw samples.
pub fn traffic(model: &Model<'_>, samples: &[RawSample], fd: bool) -> Vec<Received> {
    let (mut line, mut encoder) = model.start().expect("a good model");
    let mut frames = Vec::new();
    let mut status = Status {
        state: State::Waiting,
        ..Status::new()
    };
    let hello = encoder.status(&status);
    let mut send = |frame, tick: u32| {
        frames.push(Received {
            t_us: u64::from(tick) * 2000,
            frame,
        });
    };
    send(to_bus(&hello), 0);
    for sample in samples {
        let tick = sample.tick;
        if fd {
            send(to_bus_fd(&encoder.raw_fd(sample)), tick);
        } else {
            encoder.raw(sample, |frame| send(to_bus(&frame), tick));
        }
        let estimate = line.step(sample);
        encoder.estimate(&estimate, |frame| send(to_bus(&frame), tick));
        status.tick = tick;
        status.missed += estimate.lost;
        status.state = if estimate.homed {
            State::Running
        } else {
            State::Homing
        };
        if let Some(frame) = encoder.heartbeat(&status) {
            send(to_bus(&frame), tick);
        }
    }
    frames
}
