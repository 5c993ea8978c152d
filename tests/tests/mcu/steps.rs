//! Instructions of a filter step on the emulated Cortex-M4F against their bounds.

use std::path::{Path, PathBuf};
use std::process::Command;

use loadtwin::image_build::{self, Filter, Sensors};
use loadtwin::machine::{Drift, Machine};
use loadtwin::seal::seal;
use loadtwin_common::counting::saved_counts::MAX_BYTES;
use loadtwin_firmware::counting_test;
use loadtwin_tests::emulator::MACHINE;
use loadtwin_tests::firmware::{build_with, root};
use loadtwin_tests::rotor::walk;
use loadtwin_tests::simulated;

/// Kernel, instructions when last looked at, bound that is promised.
///
/// Counts are exact; a change of more than 5 % is to be looked at and stored anew.
const STORED: [(&str, u32, u32); 25] = [
    ("kalman_6_4", 1437, 1450),
    ("kalman_6_1", 792, 820),
    ("kalman_12_4", 8536, 8700),
    ("unscented_5_8", 6105, 7200),
    ("scheduled_gain_6_4", 389, 400),
    ("butterworth", 34, 40),
    ("counting", 150, 150),
    ("counting_white", 184, 200),
    ("counting_most", 786, 1500),
    ("gearbox_line", 5546, 5600),
    ("gearbox_steady_line", 4589, 4700),
    ("rotor_20_4", 29_317, 30_000),
    ("rotor_scheduled_gain_20_4", 844, 1500),
    ("rotor_lag_20_4", 1297, 1500),
    ("rotor_line", 31_086, 32_500),
    ("rotor_steady_line", 3129, 3300),
    ("walking_rotor_steady_line", 3288, 3400),
    ("rotor_24_4", 37_134, 38_500),
    ("rotor_scheduled_gain_24_4", 1082, 1500),
    ("rotor_lag_24_4", 1968, 2300),
    ("biased_rotor_line", 38_931, 40_500),
    ("biased_rotor_steady_line", 3322, 3500),
    // The most: all of 170 million instructions a second at 2 kHz.
    ("bearing_line", 12_501, 14_000),
    ("bearing_line_most", 78_596, 85_000),
    // Coulomb, Stribeck and pre-sliding friction, 8 orders of cogging, one measured load.
    ("drive_line", 2323, 2500),
];

/// Of the bearing's samples at 2 kHz; the last 1000 are counted.
const BEARING_S: f64 = 4.0;

fn sealed(machine: &Machine, sensors: &Sensors, folder: &Path, name: &str) -> PathBuf {
    let payload = image_build::image(machine, sensors).unwrap();
    let path = folder.join(name);
    std::fs::write(&path, seal(&payload, machine.id(), 1, None, None).unwrap()).unwrap();
    path
}

/// The example, with loads that may do anything, and with sensors that drift.
fn rotors(folder: &Path) -> [PathBuf; 3] {
    let example = Machine::load(&root().join("examples/rotor/machine.toml")).unwrap();
    let (mut walking, mut biased) = (example.clone(), example.clone());
    walk(walking.rotor.as_mut().unwrap());
    for channel in &mut biased.channels {
        channel.drift = Some(Drift {
            std: 2e-5,
            time_s: 3600.0,
        });
    }
    let named = [(example, "rotor"), (walking, "walking"), (biased, "biased")];
    named.map(|(machine, name)| {
        let sensors = Sensors::choose(&machine, None).unwrap();
        sealed(&machine, &sensors, folder, name)
    })
}

#[test]
fn steps_stay_within_their_bounds() {
    let folder = tempfile::tempdir().unwrap();
    let mut machine = Machine::load(&root().join("examples/gearbox/calibrated.toml")).unwrap();
    // Four gauges of one encoder: 6 states.
    machine.sensor_sets[0].channels = ["ta1", "ta2", "rg1", "rg2"].map(str::to_owned).to_vec();
    let image = |filter: Filter| {
        let sensors = Sensors::choose(&machine, None).unwrap().filtered_by(filter);
        sealed(&machine, &sensors, folder.path(), filter.name())
    };
    let [rotor, walking, biased] = rotors(folder.path());

    let bearing = Machine::load(&root().join("examples/bearing/calibrated.toml")).unwrap();
    let sensors = Sensors::choose(&bearing, None).unwrap();
    let samples: Vec<u8> = simulated::samples(&bearing, &sensors, "lc1", BEARING_S)
        .iter()
        .flat_map(|sample| postcard::to_allocvec(sample).unwrap())
        .collect();
    let bearing = sealed(&bearing, &sensors, folder.path(), "bearing");
    let bearing_samples = folder.path().join("bearing.samples");
    std::fs::write(&bearing_samples, samples).unwrap();

    let drive = Machine::load(&root().join("tests/machines/cogging-drive.toml")).unwrap();
    let sensors = Sensors::choose(&drive, None).unwrap();
    let drive = sealed(&drive, &sensors, folder.path(), "drive");

    let program = build_with(
        "peers",
        "steps",
        &[
            ("LOADTWIN_IMAGE", &image(Filter::Aekf)),
            ("LOADTWIN_STEADY_IMAGE", &image(Filter::Steady)),
            ("LOADTWIN_ROTOR_IMAGE", &rotor),
            ("LOADTWIN_WALKING_ROTOR_IMAGE", &walking),
            ("LOADTWIN_BIASED_ROTOR_IMAGE", &biased),
            ("LOADTWIN_BEARING_IMAGE", &bearing),
            ("LOADTWIN_DRIVE_IMAGE", &drive),
            ("LOADTWIN_BEARING_SAMPLES", &bearing_samples),
        ],
    );
    let output = Command::new("qemu-system-arm")
        .args(MACHINE)
        .args(["-icount", "shift=10"])
        .arg("-kernel")
        .arg(program)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    println!("{text}");
    assert!(output.status.success(), "{text}");
    let number = |name: &str| -> u32 {
        (text.lines())
            .find_map(|line| {
                line.strip_prefix(name)?
                    .strip_prefix(' ')?
                    .trim()
                    .parse()
                    .ok()
            })
            .unwrap_or_else(|| panic!("no {name} in {text}"))
    };
    // Of 4000 samples, those after the second index pulse, at 1024: at the first one no count has moved yet.
    assert!(
        number("gearbox_steady_line_by_steady_gains") > 2900,
        "{text}"
    );
    for kind in ["", "biased_"] {
        assert_eq!(
            number(&format!("{kind}rotor_line_by_steady_gains")),
            0,
            "{text}"
        );
    }
    for kind in ["", "walking_", "biased_"] {
        let steady = number(&format!("{kind}rotor_steady_line_by_steady_gains"));
        assert!(steady >= 1000, "{text}");
    }
    let mut bytes = vec![0; MAX_BYTES];
    let digest = counting_test::digest(45, 100_000, &mut bytes).unwrap();
    assert_eq!(number("counting_digest"), digest, "{text}");
    // Both hypotheses run, as they do in operation.
    assert!(number("bearing_line_most") > 70_000, "{text}");
    for (kernel, stored, bound) in STORED {
        let count: u32 = number(kernel);
        assert!(
            count <= bound,
            "{kernel}: {count} instructions, promised {bound}"
        );
        let change = f64::from(count) / f64::from(stored) - 1.0;
        assert!(
            change < 0.05,
            "{kernel}: {count} instructions, {stored} are stored"
        );
    }
}
