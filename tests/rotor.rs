//! Test rotor in a run-up through its first critical speed: machine with random walks of the loads,
//! model image, and raw samples with sensor faults.

use std::path::Path;

use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::{LoadKind, Machine, Rotor};
use loadtwin_common::io::raw::RawSample;

use crate::simulated;

/// `examples/rotor/machine.toml` with an encoder, for speeds around its first critical one.
///
/// # Panics
/// Where the description is not valid.
pub fn machine() -> Machine {
    let path = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/rotor/machine.toml"
    ));
    let mut machine = Machine::load(path).expect("the description is valid");
    let encoder = "name = \"shaft\"\ncounts_per_turn = 4096\nbits = 16";
    let encoder = toml::from_str(encoder).expect("an encoder");
    machine.encoders.push(encoder);
    if let Some(rotor) = &mut machine.rotor {
        rotor.schedule_rad_s = Some([80.0, 200.0]);
    }
    machine
}

/// As [`machine`], with loads that may do anything, of which the estimates lag.
///
/// # Panics
/// As [`machine`].
pub fn walking() -> Machine {
    let mut machine = machine();
    let rotor = machine.rotor.as_mut().expect("a rotor");
    walk(rotor);
    assert!(rotor.lag() > 0);
    machine
}

/// The loads of `rotor` may do anything.
pub fn walk(rotor: &mut Rotor) {
    for load in &mut rotor.loads {
        load.kind = LoadKind::Walk;
        load.walk_n_per_sqrt_s = None;
    }
}

/// The model image of `machine`.
///
/// # Panics
/// Where it cannot be built.
pub fn image(machine: &Machine) -> Vec<u8> {
    let sensors = Sensors::choose(machine, None).expect("few enough sensors");
    image_build::image(machine, &sensors).expect("the machine fits an image")
}

/// A run-up of `seconds`; samples, words and an encoder's count are missing now and
/// then, and a word is at the end of its range.
///
/// # Panics
/// Where the machine cannot be simulated.
pub fn samples(machine: &Machine, seconds: f64) -> Vec<RawSample> {
    let sensors = Sensors::choose(machine, None).expect("few enough sensors");
    let mut all = simulated::samples(machine, &sensors, "run-up", seconds);
    all.retain(|raw| raw.tick % 977 != 976);
    for raw in &mut all {
        if raw.tick % 1511 == 1510 {
            raw.valid &= !1;
        }
        if raw.tick % 2003 == 2002 {
            raw.set_word(1, 0x7F_FFFF);
        }
        if raw.tick % 1201 == 1200 {
            raw.valid &= !(1 << loadtwin_common::io::raw::MAX_CHANNELS);
        }
    }
    all
}
