//! `loadtwin diagnose` on simulated drives, each with one effect that the description does not
//! name: it is named and the error of the drive's force is then below 3 %; nothing is named without
//! an effect, a cause outside the library is unknown, and the improved description has the reported
//! error.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// State of motion: time, position, speed, load, and places to remember something.
struct State {
    t: f64,
    x: f64,
    v: f64,
    load: f64,
    memory: f64,
    side: f64,
}

/// A force that the description does not know.
type Hidden = fn(&mut State) -> f64;

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
[[balance.load]]
name = "load"
unit = "N"
"#;

/// 30 s at 200 Hz with reversals at several speeds and noise of 0.03 N.
fn recording(path: &Path, hidden: Hidden, seed: u32) {
    let mut text = String::from("t [s],x [m],f [N],load [N]\n");
    let mut random = seed;
    let mut noise = || {
        // Twelve uniform numbers make a nearly normal one.
        let sum: f64 = (0..12)
            .map(|_| {
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f64::from(random >> 8) / f64::from(1 << 24)
            })
            .sum();
        0.03 * (sum - 6.0)
    };
    let (p, q) = (0.7 * f64::from(seed), 1.9 * f64::from(seed));
    let mut state = State {
        t: 0.0,
        x: 0.0,
        v: 0.0,
        load: 0.0,
        memory: 0.0,
        side: 0.0,
    };
    for i in 0..6000 {
        let t = f64::from(i) * 5e-3;
        let wave = |size: f64, w: f64, phase: f64| {
            let (sin, cos) = (w * t + phase).sin_cos();
            [size * sin, size * w * cos, -size * w * w * sin]
        };
        let (one, two) = (wave(0.4, 0.9, p), wave(0.1, 2.3, q));
        state = State {
            t,
            x: one[0] + two[0],
            v: one[1] + two[1],
            load: 1.0 + 0.8 * (0.37 * t + q).sin(),
            ..state
        };
        let f = 0.5 * (one[2] + two[2]) + 2.0 * state.v + state.load + hidden(&mut state) + noise();
        writeln!(text, "{t:.4},{:.7},{f:.5},{:.5}", state.x, state.load).unwrap();
    }
    std::fs::write(path, text).unwrap();
}

/// Where recordings stand, of which the last is not fitted.
fn recordings(folder: &Path) -> Vec<PathBuf> {
    (1..=3).map(|k| folder.join(format!("{k}.csv"))).collect()
}

fn diagnose(folder: &Path, hidden: Hidden, more: &[&str]) -> Value {
    let machine = folder.join("machine.toml");
    std::fs::write(&machine, DESCRIPTION).unwrap();
    let files = recordings(folder);
    for (k, file) in files.iter().enumerate() {
        recording(file, hidden, k as u32 + 1);
    }
    run(&machine, &files[..2], &files[2..], more)
}

fn run(machine: &Path, fit: &[PathBuf], validate: &[PathBuf], more: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(["diagnose", "--json"])
        .arg(machine)
        .args(fit)
        .args(more)
        .arg("--validate")
        .args(validate)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

fn names(diagnosis: &Value) -> Vec<&str> {
    let effects = diagnosis["effects"].as_array().unwrap();
    effects
        .iter()
        .map(|e| e["name"].as_str().unwrap())
        .collect()
}

fn after(diagnosis: &Value) -> f64 {
    diagnosis["error"]["recalibrated"]["after"]["value_percent"]
        .as_f64()
        .unwrap()
}

fn before(diagnosis: &Value) -> f64 {
    diagnosis["error"]["recalibrated"]["before"]["value_percent"]
        .as_f64()
        .unwrap()
}

/// Each is named, the model is then as good as the noise allows, and nothing
/// else is added.
#[test]
fn the_hidden_effect_is_found() {
    let cases: [(&str, Hidden); 7] = [
        ("coulomb-friction", |s| 0.4 * s.v.signum()),
        ("directional-friction", |s| 0.8 * s.v.abs()),
        ("load-dependent-friction", |s| 0.3 * s.load * s.v.signum()),
        ("position-dependent-torque", |s| 1.5 * s.x),
        ("torque-ripple", |s| {
            let turn = std::f64::consts::TAU * s.x / 0.25;
            0.3 * (3.0 * turn).cos() + 0.2 * turn.sin()
        }),
        ("presliding-hysteresis", |s| {
            // Dahl over 60 mm, stepped as the plant is.
            let dx = s.v * 5e-3;
            s.memory += (dx.signum() - s.memory) * dx.abs() / 0.06;
            0.6 * s.memory
        }),
        ("backlash", |s| {
            // What drags behind a play of 50 mm keeps its sign within it.
            if s.t == 0.0 {
                s.memory = s.x;
            }
            let far = s.memory.clamp(s.x - 0.025, s.x + 0.025);
            if far != s.memory {
                s.side = (far - s.memory).signum();
            }
            s.memory = far;
            0.5 * s.side
        }),
    ];
    for (name, hidden) in cases {
        let folder = tempfile::tempdir().unwrap();
        let diagnosis = diagnose(folder.path(), hidden, &[]);
        println!(
            "{name}: {:?}, {:.2} % to {:.2} %",
            names(&diagnosis),
            before(&diagnosis),
            after(&diagnosis)
        );
        assert_eq!(names(&diagnosis).first(), Some(&name), "{diagnosis}");
        assert!(after(&diagnosis) < 3.0, "{name}: {}", after(&diagnosis));
        assert!(after(&diagnosis) < 0.5 * before(&diagnosis), "{name}");
    }
}

/// Friction that falls with the load and vanishes at its mean, which varies by a fifth:
/// what depends on the load and what does not cancel all but for that, and neither
/// lowers the error by 2 % alone. Both are named; looked for one by one, none is.
#[test]
fn two_effects_that_hide_each_other_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let hidden: Hidden = |s| {
        let load = 1.0 + 0.25 * (s.load - 1.0);
        let other_load = load - s.load;
        s.load = load;
        other_load + 2.0 * (1.0 - load) * s.v.signum()
    };
    let diagnosis = diagnose(folder.path(), hidden, &[]);
    let mut found = names(&diagnosis);
    found.sort_unstable();
    let both = ["coulomb-friction", "load-dependent-friction"];
    assert_eq!(found, both, "{diagnosis}");
    assert!(after(&diagnosis) < 3.0, "{}", after(&diagnosis));
    assert!(before(&diagnosis) > 15.0, "{}", before(&diagnosis));
}

/// Nothing is missing: nothing is found, on several draws of noise.
#[test]
fn a_complete_model_lacks_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let machine = folder.path().join("machine.toml");
    std::fs::write(&machine, DESCRIPTION).unwrap();
    for seed in 0..8 {
        let files: Vec<PathBuf> = (0..2)
            .map(|k| folder.path().join(format!("{k}.csv")))
            .collect();
        for (k, file) in files.iter().enumerate() {
            recording(file, |_| 0.0, 20 + 2 * seed + k as u32);
        }
        let diagnosis = run(&machine, &files[..1], &files[1..], &[]);
        assert_eq!(diagnosis["verdict"], "none", "{diagnosis}");
        assert!(after(&diagnosis) < 2.0, "{}", after(&diagnosis));
    }
}

/// What no effect of the library is: the force of something that comes and goes
/// with time alone. It is called unknown, or at the least not explained away.
#[test]
fn what_nothing_explains_is_called_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let diagnosis = diagnose(
        folder.path(),
        |s| if (s.t * 0.83).fract() < 0.3 { 0.9 } else { 0.0 },
        &[],
    );
    assert_eq!(diagnosis["verdict"], "unknown", "{diagnosis}");
    assert!(diagnosis["remainder"]["percent"].as_f64().unwrap() > 10.0);
}

/// The description that `first` wrote has the error that `first` reported for it.
fn has_the_reported_error(second: &Value, first: &Value) {
    let nominal = second["error"]["nominal"]["before"]["value_percent"]
        .as_f64()
        .unwrap();
    let reported = after(first);
    assert!((nominal - reported).abs() < 0.05, "{nominal} {reported}");
}

/// The improved description needs no further effect, and has the error reported for it.
#[test]
fn the_improved_description_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let improved = folder.path().join("improved.toml");
    let first = diagnose(
        folder.path(),
        |s| 0.4 * s.v.signum(),
        &["-o", improved.to_str().unwrap()],
    );
    let files = recordings(folder.path());
    let second = run(&improved, &files[..2], &files[2..], &[]);
    assert_eq!(second["verdict"], "none", "{second}");
    has_the_reported_error(&second, &first);
}

/// A load whose gain is wrong by half: the coefficient of what depends on the load
/// belongs to the gain that is written beside it.
#[test]
fn an_effect_of_a_load_follows_its_gain() {
    let folder = tempfile::tempdir().unwrap();
    let improved = folder.path().join("improved.toml");
    let out = ["-o", improved.to_str().unwrap()];
    let hidden: Hidden = |s| 0.3 * s.load * s.v.signum();
    diagnose(folder.path(), hidden, &out);
    let machine = folder.path().join("machine.toml");
    let half = DESCRIPTION.replace("name = \"load\"", "name = \"load\"\ngain = 0.5");
    std::fs::write(&machine, half).unwrap();
    let files = recordings(folder.path());
    let first = run(&machine, &files[..2], &files[2..], &out);
    assert_eq!(names(&first), ["load-dependent-friction"], "{first}");
    let second = run(&improved, &files[..2], &files[2..], &[]);
    has_the_reported_error(&second, &first);
}

/// A bit that was lost on the way is left out, and counted.
#[test]
fn a_spike_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let hidden: Hidden = |s| 0.4 * s.v.signum();
    let clean = diagnose(folder.path(), hidden, &[]);
    let file = folder.path().join("1.csv");
    let text = std::fs::read_to_string(&file).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let cells: Vec<&str> = lines[2000].split(',').collect();
    lines[2000] = format!("{},{},1e6,{}", cells[0], cells[1], cells[3]);
    std::fs::write(&file, lines.join("\n")).unwrap();
    let files = recordings(folder.path());
    let machine = folder.path().join("machine.toml");
    let spiked = run(&machine, &files[..2], &files[2..], &[]);
    assert_eq!(spiked["spikes"], 1);
    assert_eq!(clean["spikes"], 0);
    assert_eq!(names(&spiked), names(&clean));
    assert!((after(&spiked) - after(&clean)).abs() < 0.1);
}

/// A recording that says too little gets a reason.
#[test]
fn a_short_recording_gets_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let machine = folder.path().join("machine.toml");
    std::fs::write(&machine, DESCRIPTION).unwrap();
    let short = folder.path().join("short.csv");
    std::fs::write(
        &short,
        "t [s],x [m],f [N],load [N]\n0,0,0,0\n0.005,0,0,0\n0.01,0,0,0\n",
    )
    .unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .arg("diagnose")
        .args([&machine, &short])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(
        error.contains("short.csv: found 3 rows, allowed: at least 32"),
        "{error}"
    );
}
