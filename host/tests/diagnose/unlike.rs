//! Machines and sensors that are unlike the example's.

use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::{diagnosed, diagnosed_as, machine, recorded, recorded_of, rewritten};

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

/// Torque is told by the lighter side; where that is the eccentric encoder's, strains err by the
/// acceleration that it tells.
#[test]
fn an_eccentric_encoder_is_named_on_the_lighter_side() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let lighter = described(folder, "moment_kg_m2 = 3.0e5", "moment_kg_m2 = 1.0e5");
    let effect = ["encoder-eccentricity=1"];
    let seen = recorded_of(
        &lighter,
        folder,
        "seen.parquet",
        "start-stop",
        "60",
        &effect,
    );
    let said = diagnosed_as(&lighter, &seen, &[]);
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "encoder-eccentricity");
}

/// Where torque and speed swing, an inertia that is 0.2 % off passes for a gain, as all clean
/// machines have it.
#[test]
fn a_gain_that_warmth_changes_is_named_where_the_torque_swings() {
    let folder = tempfile::tempdir().unwrap();
    let effect = ["thermal-gain=1"];
    let seen = recorded(folder.path(), "seen.parquet", "reversals", "90", &effect);
    let said = diagnosed(&seen, &[]);
    assert_eq!(said["effects"][0]["name"], "thermal-gain", "{said}");
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
