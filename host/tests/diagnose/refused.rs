//! Recordings that `loadtwin diagnose` refuses, each with its reason.

use std::path::Path;

use loadtwin::machine::Machine;
use loadtwin::simulate::{Course, Demand, Scenario, Simulation};

use super::{loadtwin, machine, only, recorded, recorded_of};

/// The one line that `diagnose` gives instead of a verdict.
fn refused(machine: &Path, recordings: &[&str]) -> String {
    let machine = machine.display().to_string();
    let output = loadtwin(&[&["diagnose", machine.as_str()], recordings].concat());
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(message.lines().count(), 1, "{message}");
    message
}

#[test]
fn a_recording_that_is_too_short_gets_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let recording = recorded(folder.path(), "short.parquet", "start-stop", "5", &[]);
    assert!(refused(&machine(), &[&recording]).contains("too short"));
}

#[test]
fn a_machine_at_rest_gets_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let described = Machine::load(&machine()).unwrap();
    let course = Course {
        dt_s: 1.0 / described.rate_hz,
        angle: 0.0,
        demands: vec![Demand::default(); 10_000],
    };
    let path = folder.path().join("rest.parquet");
    Simulation::new(&described, &Scenario::recorded(course), 1, None, &[])
        .unwrap()
        .write(&path, |_| ())
        .unwrap();
    let message = refused(&machine(), &[&path.display().to_string()]);
    assert!(message.contains("of nominal"), "{message}");
}

#[test]
fn loads_that_contradict_the_description_get_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let recording = recorded(folder.path(), "fitted.parquet", "start-stop", "30", &[]);
    let described = std::fs::read_to_string(machine()).unwrap();
    let wrong = described.replace("direction = \"brakes\"", "direction = \"drives\"");
    assert_ne!(described, wrong);
    let path = folder.path().join("machine.toml");
    std::fs::write(&path, wrong).unwrap();
    let maps = machine().with_file_name("sensitivity.csv");
    std::fs::copy(maps, folder.path().join("sensitivity.csv")).unwrap();
    let message = refused(&path, &[&recording]);
    assert!(message.contains("contradict"), "{message}");
}

#[test]
fn recordings_with_different_channels_are_not_diagnosed_together() {
    let folder = tempfile::tempdir().unwrap();
    let both = recorded(folder.path(), "both.parquet", "start-stop", "30", &[]);
    let one = only(&machine(), folder.path(), |block| {
        !block.contains("name = \"torque_hss\"")
    });
    let one = recorded_of(&one, folder.path(), "one.parquet", "start-stop", "30", &[]);
    for order in [[both.as_str(), &one], [&one, &both]] {
        let message = refused(&machine(), &order);
        assert!(message.contains("one.parquet: has no "), "{message}");
    }
}
