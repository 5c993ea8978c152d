//! `loadtwin diagnose` on machines and sensor sets that differ from the example's: noise of
//! references, wrong inertias, eccentric encoders, thermometer with lag, creep over decades.

use std::path::{Path, PathBuf};

use loadtwin::machine::Machine;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::improved::nmae;
use super::{diagnosed, diagnosed_as, example, machine, recorded, recorded_of, rewritten};

/// The example with `from` written as `to`.
fn described(folder: &Path, from: &str, to: &str) -> PathBuf {
    let example = std::fs::read_to_string(machine()).unwrap();
    assert!(example.contains(from));
    let maps = machine().with_file_name("sensitivity.csv");
    std::fs::copy(maps, folder.join("sensitivity.csv")).unwrap();
    let path = folder.join("machine.toml");
    std::fs::write(&path, example.replace(from, to)).unwrap();
    path
}

/// Torque is computed from the lighter side; where that is the eccentric encoder's, strains err by
/// the acceleration that it measures.
#[test]
fn an_eccentric_encoder_is_named_on_the_lighter_side() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let lighter = described(folder, "moment_kg_m2 = 3.0e5", "moment_kg_m2 = 1.0e5");
    let effect = ["encoder-eccentricity=1"];
    let fitted = recorded_of(
        &lighter,
        folder,
        "fitted.parquet",
        "start-stop",
        "60",
        &effect,
    );
    let said = diagnosed_as(&lighter, &fitted, &[]);
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "encoder-eccentricity");
}

/// Where torque hardly changes, the noise of a reference is most of what effects of torque are made
/// of, and it is in the residual as well.
#[test]
fn the_noise_of_a_reference_is_no_effect() {
    let folder = tempfile::tempdir().unwrap();
    let bench = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/bench/machine.toml");
    for scenario in ["constant", "torque-ramps"] {
        let name = format!("{scenario}.parquet");
        let clean = recorded_of(&bench, folder.path(), &name, scenario, "60", &[]);
        let said = diagnosed_as(&bench, &clean, &[]);
        assert_eq!(said["verdict"], "none", "{scenario}: {said}");
    }
}

/// Wrong inertias of a description are no effect of the machine, but are reported.
#[test]
fn wrong_moments_of_inertia_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let fitted = recorded(folder.path(), "fitted.parquet", "start-stop", "60", &[]);
    let said = diagnosed(&fitted, &[]);
    assert_eq!(said["note"], serde_json::Value::Null, "{said}");
    let (of, to) = ("moment_kg_m2 = 3.0e5", "moment_kg_m2 = 2.7e5");
    let lighter = described(folder.path(), of, to);
    let said = diagnosed_as(&lighter, &fitted, &[]);
    let note = said["note"].as_str().unwrap();
    assert!(note.contains("moments of inertia"), "{note}");
}

/// Where torque and speed swing, an inertia that is 0.2 % off passes for a gain, as all clean
/// machines have it.
#[test]
fn a_gain_that_warmth_changes_is_named_where_the_torque_swings() {
    let folder = tempfile::tempdir().unwrap();
    let effect = ["thermal-gain=1"];
    let fitted = recorded(folder.path(), "fitted.parquet", "reversals", "90", &effect);
    let said = diagnosed(&fitted, &["--relevant-percent", "0"]);
    assert_eq!(said["effects"][0]["name"], "thermal-gain", "{said}");
}

/// Angles that are read half a sample before torques, which maps over the angle show as a delay: where the
/// speed swings that passes for drag as well, and is none.
#[test]
fn angles_read_half_a_sample_late_are_no_drag() {
    let folder = tempfile::tempdir().unwrap();
    let mut recording = recorded_of(
        &example(),
        folder.path(),
        "clean.csv",
        "reversals",
        "60",
        &[],
    );
    for encoder in ["encoder_main", "encoder_hss"] {
        let late = folder.path().join(format!("{encoder}.csv"));
        let mut before = None;
        rewritten(&recording, &late, encoder, |count, _| {
            let last = before.replace(count).unwrap_or(count);
            let wraps = (count - last).abs() > 2f64.powi(31);
            if wraps {
                count
            } else {
                (0.5 * (last + count)).round()
            }
        });
        recording = late.display().to_string();
    }
    let said = diagnosed_as(&example(), &recording, &[]);
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "channel-delay");
}

/// References twenty times as noisy as a good flange: what the chain makes of that is no effect.
#[test]
fn noisy_references_are_no_effect() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut recording = recorded(folder.path(), "clean.csv", "steps", "60", &[]);
    for (reference, std) in [("torque_main", 600.0), ("torque_hss", 10.0)] {
        let noisy = folder.path().join(format!("{reference}.csv"));
        rewritten(&recording, &noisy, reference, |reads, _| {
            reads + std * rng.sample::<f64, _>(StandardNormal)
        });
        recording = noisy.display().to_string();
    }
    let said = diagnosed(&recording, &[]);
    assert_eq!(said["verdict"], "none", "{said}");
}

/// What follows `u`, one value each 2 ms, in `time_s`.
fn following(time_s: f64) -> impl FnMut(f64) -> f64 {
    let mut z = None;
    move |u| {
        let before = *z.get_or_insert(u);
        *z.insert(before + 0.002 / time_s * (u - before))
    }
}

/// A machine that warms by 4 K while a gauge follows the thermometer in 15 s: the effect is named with that
/// time, and the estimator follows as late.
#[test]
fn a_gauge_that_follows_the_thermometer_late_is_named_with_its_lag() {
    let folder = tempfile::tempdir().unwrap();
    let clean = recorded(folder.path(), "clean.csv", "turbulent", "90", &[]);
    let (warm, late) = (
        folder.path().join("warm.csv"),
        folder.path().join("late.csv"),
    );
    rewritten(&clean, &warm, "housing_temperature", |_, column| {
        20.0 + 4.0 * (1.0 - (-column("t [") / 25.0).exp())
    });
    let mut follow = following(15.0);
    rewritten(
        &warm.display().to_string(),
        &late,
        "ta2",
        |reads, column| reads + 5e-6 * (follow(column("housing_temperature")) - 20.0),
    );
    let late = late.display().to_string();
    let out = folder.path().join("better.toml");
    let said = diagnosed(&late, &["--out", &out.display().to_string()]);
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "thermal-drift", "{said}");
    let better = Machine::load(&out).unwrap();
    let lag_s = better.thermometer().unwrap().lag_s;
    assert!((lag_s / 15.0 - 1.0).abs() < 0.1, "{lag_s}");
    let error = |machine: &Path| nmae(&machine.display().to_string(), &late, "torque-arm-3");
    let at_once = folder.path().join("at-once.toml");
    let text = std::fs::read_to_string(&out).unwrap();
    let without: Vec<&str> = text.lines().filter(|l| !l.starts_with("lag_s")).collect();
    assert_eq!(without.len() + 1, text.lines().count());
    std::fs::write(&at_once, without.join("\n")).unwrap();
    assert!(error(&out) < error(&at_once));
    assert!(error(&out) < error(&machine()));
}

/// Creep over decades of time, which one exponential is only a part of: a signal that is free
/// explains more, and is not what it is.
#[test]
fn creep_over_decades_is_no_free_load() {
    let folder = tempfile::tempdir().unwrap();
    let mut recording = recorded(folder.path(), "clean.csv", "turbulent", "90", &[]);
    for gauge in ["ta1", "ta2", "ta3"] {
        let creeping = folder.path().join(format!("{gauge}.csv"));
        let mut parts = [2.0, 6.0, 18.0, 54.0].map(following);
        for part in &mut parts {
            part(0.0);
        }
        rewritten(&recording, &creeping, gauge, |reads, column| {
            let level = column("torque_main") / 312e3;
            let crept: f64 = parts.iter_mut().map(|part| part(level)).sum();
            reads + 3e-6 * crept
        });
        recording = creeping.display().to_string();
    }
    let said = diagnosed(&recording, &[]);
    assert_eq!(said["effects"][0]["name"], "gauge-creep", "{said}");
}
