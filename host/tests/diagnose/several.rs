//! Joint diagnosis of several recordings by `loadtwin diagnose`: zeros that differ between them are
//! no effect, and a gear's inertia is named alone.

use super::{diagnosed, recorded};

#[test]
fn zeros_that_differ_from_recording_to_recording_are_no_effect() {
    let folder = tempfile::tempdir().unwrap();
    let with = |name: &str, scenario: &str, effect: &str| {
        recorded(folder.path(), name, scenario, "60", &[effect])
    };
    let first = with("first.parquet", "start-stop", "gauge-offset=2");
    let second = with("second.parquet", "steps", "gauge-offset=0.5");
    let third = with("third.parquet", "turbulent", "gauge-offset=1");
    let said = diagnosed(&first, &[&second, &third]);
    assert_eq!(said["verdict"], "none", "{said}");
}

/// Each begins with a vibration of its own.
#[test]
fn a_gear_with_inertia_is_named_alone_by_two_recordings() {
    let folder = tempfile::tempdir().unwrap();
    let with = |name: &str, scenario: &str| {
        let effect = ["torsional-resonance=1"];
        recorded(folder.path(), name, scenario, "60", &effect)
    };
    let first = with("first.parquet", "reversals");
    let second = with("second.parquet", "turbulent");
    let said = diagnosed(&first, &[&second]);
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "torsional-resonance");
}
