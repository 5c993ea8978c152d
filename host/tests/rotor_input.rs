//! What a rotor's description may not be is said in one line: where, what was found and
//! what is allowed. And rotors of other sizes than the example.

use std::path::Path;

use loadtwin::build::{self, Filter, Sensors};
use loadtwin::machine::{Machine, MachineError};
use loadtwin_common::image::Image;
use loadtwin_common::line::Line;

fn example() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rotor/machine.toml");
    std::fs::read_to_string(path).unwrap()
}

/// The example with `from` replaced by `to` where it first stands.
fn changed(from: &str, to: &str) -> Result<Machine, MachineError> {
    let text = example();
    assert!(text.contains(from), "{from}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("machine.toml");
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    Machine::load(&path)
}

#[test]
fn what_a_rotor_may_not_be_is_said_in_one_line() {
    for (from, to, said) in [
        (
            "[[rotor.disc]]\nnode = 12",
            "[[rotor.disc]]\nnode = 38",
            ["rotor.disc[1].node", "38", "0 to 37"],
        ),
        (
            "displacement = { node = 5",
            "displacement = { node = 50",
            ["channel[1].senses.displacement.node", "50", "0 to 37"],
        ),
        (
            "mass_kg = 2.65",
            "mass_kg = -2.65",
            ["rotor.disc[1].mass_kg", "-2.65", "> 0"],
        ),
        (
            "[[3.925209e8, 0], [0, 2.572044e9]]",
            "[[4e8, 4e8], [4e8, 4e8]]",
            [
                "rotor.bearing[1].stiffness_n_per_m",
                "400000000",
                "singular",
            ],
        ),
        (
            "[[rotor.bearing]]\nnode = 4",
            "[[rotor.bearing]]\nnode = 33",
            ["rotor.bearing", "1 nodes", "not held"],
        ),
        (
            "speed_rad_s = 87.96",
            "speed_rad_s = 87.96\nschedule_rad_s = [100, 200]",
            ["rotor.speed_rad_s", "87.96", "100 to 200"],
        ),
        (
            "noise_std = 1e-7",
            "noise_std = 0.1",
            ["channel[1].noise_std", "0.1 m", "another unit"],
        ),
        (
            "adc = { lsb = 1e-9 }",
            "adc = { lsb = 1e-6 }",
            ["channel[1].adc.lsb", "0.000001 m", "another unit"],
        ),
        (
            "walk_n_per_sqrt_s = 0.0018",
            "walk_n_per_sqrt_s = 0",
            ["rotor.load[1].walk_n_per_sqrt_s", "0", "> 0"],
        ),
    ] {
        let refused = changed(from, to).unwrap_err().to_string();
        println!("{refused}");
        assert!(!refused.contains('\n'), "{refused}");
        for part in said {
            assert!(refused.contains(part), "{part:?} is not in {refused:?}");
        }
    }
}

#[test]
fn a_rotor_has_no_filter_of_gains_alone() {
    let machine = changed("format", "format").unwrap();
    let sensors = Sensors::choose(&machine, None).unwrap();
    let refused = build::image(&machine, &sensors.filtered_by(Filter::Steady))
        .unwrap_err()
        .to_string();
    assert!(refused.starts_with("--filter: found steady"), "{refused}");
}

#[test]
fn rotors_of_other_sizes_are_filled_up_and_larger_ones_refused() {
    for modes in [2, 3, 4] {
        let machine = changed("initial_std", &format!("modes = {modes}\ninitial_std")).unwrap();
        let sensors = Sensors::choose(&machine, None).unwrap();
        let payload = build::image(&machine, &sensors).unwrap();
        assert!(Line::try_build(Image::from_bytes(&payload).unwrap()).is_ok());
    }
    let machine = changed("initial_std", "modes = 5\ninitial_std").unwrap();
    let sensors = Sensors::choose(&machine, None).unwrap();
    let refused = build::image(&machine, &sensors).unwrap_err().to_string();
    assert_eq!(
        refused,
        "rotor.reduction.modes: found 5, allowed: at most 4 beside the 2 loads"
    );
}

/// One disc in place of two, one load, six modes.
#[test]
fn a_rotor_with_one_load_has_room_for_more_modes() {
    let mut machine = changed("format", "format").unwrap();
    let rotor = machine.rotor.as_mut().unwrap();
    rotor.loads.truncate(1);
    rotor.discs.truncate(1);
    rotor.reduction.modes = Some(6);
    machine.references.truncate(2);
    let sensors = Sensors::choose(&machine, None).unwrap();
    let payload = build::image(&machine, &sensors).unwrap();
    assert!(Line::try_build(Image::from_bytes(&payload).unwrap()).is_ok());
}
