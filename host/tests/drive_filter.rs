//! Estimator of a simulated drive: what `diagnose` finds is built and replayed, and lowers the
//! error of an unknown load of 3 N on another recording from above 1 N to below 0.35 N. Effects
//! that the estimator lacks are refused with their key.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde_json::Value;

/// An axis of 0.5 kg with drag, of which friction and cogging are to be found.
const DESCRIPTION: &str = r#"
format = 1
name = "made up"
rate_hz = 200.0
[balance]
unit = "N"
drive = { name = "f", unit = "N" }
position = { name = "x", unit = "m" }
inertia = 0.5
drag = 2.0
turn = 0.25
[tuning]
cutoff_hz = 5.0
[[reference]]
name = "pull"
load = "load"
unit = "N"
"#;

/// 30 s at 200 Hz; `pull` acts on the axis from the tenth second on, and no column says so but the
/// reference.
fn recording(path: &Path, pull: f64, seed: u64) {
    let mut text = String::from("t [s],x [m],f [N],pull [N]\n");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = || 0.03 * random.sample::<f64, _>(StandardNormal);
    let phase = 0.7 * seed as f64;
    for i in 0..6000 {
        let t = f64::from(i) * 5e-3;
        let wave = |size: f64, w: f64, phase: f64| {
            let (sin, cos) = (w * t + phase).sin_cos();
            [size * sin, size * w * cos, -size * w * w * sin]
        };
        let (one, two) = (wave(0.4, 0.9, phase), wave(0.1, 2.3, 2.0 * phase));
        let [x, v, a] = std::array::from_fn(|i| one[i] + two[i]);
        let load = if t > 10.0 { pull } else { 0.0 };
        let cogging = 0.4 * (TAU * 3.0 * x / 0.25).cos();
        let f = 0.5 * a + 2.0 * v + 1.5 * v.signum() + cogging + load + noise();
        writeln!(text, "{t:.4},{x:.7},{f:.5},{load:.5}").unwrap();
    }
    std::fs::write(path, text).unwrap();
}

fn loadtwin(arguments: &[&str], files: &[&Path]) -> Output {
    (Command::new(env!("CARGO_BIN_EXE_loadtwin")).args(arguments))
        .args(files)
        .output()
        .unwrap()
}

fn json(arguments: &[&str], files: &[&Path]) -> Value {
    let output = loadtwin(arguments, files);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(arguments: &[&str], files: &[&Path]) -> String {
    let output = loadtwin(arguments, files);
    assert!(!output.status.success());
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn written(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

/// An unknown pull of 3 N on another recording, before and after the loop; then the image.
#[test]
fn what_the_loop_finds_makes_the_estimator_better() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    recording(&at("1.csv"), 0.0, 1);
    recording(&at("2.csv"), 0.0, 2);
    recording(&at("3.csv"), 3.0, 3);
    let described = DESCRIPTION.replace("turn = 0.25", "turn = 0.25\nnominal = 3.0");
    let plain = written(folder.path(), "plain.toml", &described);
    let found = at("found.toml");
    json(
        &["diagnose", "--json", "-o"],
        &[&found, &plain, &at("1.csv"), &at("2.csv")],
    );
    let error = |machine: &Path| {
        let replayed = json(&["replay", "--json"], &[machine, &at("3.csv")]);
        replayed["loads"]["load"]["rmse"].as_f64().unwrap()
    };
    let (before, after) = (error(&plain), error(&found));
    assert!(before > 1.0 && after < 0.35, "{before} {after}");

    let built = json(
        &["build", "--json"],
        &[&found, Path::new("-o"), &at("axis.image")],
    );
    assert!(built["bytes"].as_u64().unwrap() > 500);
}

#[test]
fn what_the_estimator_lacks_is_named_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("axis.image");
    let build = |text: &str| {
        let machine = written(folder.path(), "machine.toml", text);
        refused(&["build"], &[&machine, Path::new("-o"), &image])
    };
    let said = build(DESCRIPTION);
    assert!(
        said.contains("balance.nominal") && said.contains("diagnose -o"),
        "{said}"
    );
    let nominal = DESCRIPTION.replace("turn = 0.25", "turn = 0.25\nnominal = 3.0");
    let warm =
        "[[balance.effect]]\nname = \"warm-up\"\nshape = [60.0, 0.0]\ncoefficients = [1.0, 1.0]\n";
    let said = build(&nominal.replace("[tuning]", &format!("{warm}[tuning]")));
    assert!(
        said.contains("balance.effect[1].name") && said.contains("warm-up"),
        "{said}"
    );
    let short =
        "[[balance.effect]]\nname = \"coulomb-friction\"\nshape = [0.0]\ncoefficients = [1.0]\n";
    let said = build(&nominal.replace("[tuning]", &format!("{short}[tuning]")));
    assert!(said.contains("balance.effect[1].shape"), "{said}");
    let late = "[[balance.effect]]\nname = \"delay\"\nshape = []\ncoefficients = [-1.0]\n";
    let said = build(&nominal.replace("[tuning]", &format!("{late}[tuning]")));
    assert!(said.contains("samples"), "{said}");
    assert!(!image.exists());
}
