//! Test program of `loadtwin diagnose` for drivetrains, on simulated recordings of the example's
//! gearbox: nothing is named without an effect; here also machines without references, two effects
//! at once, delays, and corrections without a cause.

mod estimator;
mod foreign;
mod improved;
mod refused;
mod several;
mod unlike;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

use serde_json::{Value, json};

fn example() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/gearbox/machine.toml")
}

/// The example with four of its gauges and three of its sensor sets: half of the time that the
/// whole one takes.
fn machine() -> PathBuf {
    static MACHINE: LazyLock<PathBuf> = LazyLock::new(|| {
        let kept = |block: &str| {
            let named = |names: &[&str]| {
                names
                    .iter()
                    .any(|n| block.contains(&format!("name = \"{n}\"")))
            };
            if block.starts_with("[[channel]]") {
                named(&["ta1", "ta2", "ta3", "hsh1"])
            } else if block.starts_with("[[sensor_set]]") {
                named(&["torque-arm-1", "torque-arm-3", "high-speed-housing-1"])
            } else {
                true
            }
        };
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("diagnose");
        std::fs::create_dir_all(&folder).unwrap();
        only(&example(), &folder, kept)
    });
    MACHINE.clone()
}

fn loadtwin(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(arguments)
        .output()
        .unwrap()
}

/// A recording with `effects`, in `folder`.
fn recorded(folder: &Path, name: &str, scenario: &str, seconds: &str, effects: &[&str]) -> String {
    recorded_of(&machine(), folder, name, scenario, seconds, effects)
}

fn recorded_of(
    machine: &Path,
    folder: &Path,
    name: &str,
    scenario: &str,
    seconds: &str,
    effects: &[&str],
) -> String {
    let path = folder.join(name).display().to_string();
    let machine = machine.display().to_string();
    let mut arguments = vec!["simulate", &machine, "--scenario", scenario, "--seed", "5"];
    arguments.extend(["--duration-s", seconds, "-o", &path]);
    for effect in effects {
        arguments.extend(["--effect", effect]);
    }
    let output = loadtwin(&arguments);
    assert!(output.status.success());
    path
}

fn diagnosed(recording: &str, more: &[&str]) -> Value {
    diagnosed_as(&machine(), recording, more)
}

fn diagnosed_as(machine: &Path, recording: &str, more: &[&str]) -> Value {
    let machine = machine.display().to_string();
    let mut arguments = vec!["diagnose", "--json", &machine, recording];
    arguments.extend(more);
    let output = loadtwin(&arguments);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn nothing_is_missing_from_a_clean_recording() {
    let folder = tempfile::tempdir().unwrap();
    let recording = recorded(folder.path(), "clean.parquet", "start-stop", "60", &[]);
    let said = diagnosed(&recording, &[]);
    assert_eq!(said["verdict"], "none", "{said}");
    assert_eq!(said["effects"].as_array().unwrap().len(), 0);
}

/// Vibrations, reversals and steps are repeated in the simulations of the null
/// samples.
#[test]
fn nothing_is_missing_however_the_machine_was_moved() {
    let folder = tempfile::tempdir().unwrap();
    for scenario in ["reversals", "steps", "turbulent"] {
        let recording = recorded(folder.path(), "clean.parquet", scenario, "60", &[]);
        let said = diagnosed(&recording, &[]);
        assert_eq!(said["verdict"], "none", "{scenario}: {said}");
    }
}

/// The machine of the example on a bench without torque flanges.
fn without_references(folder: &Path) -> PathBuf {
    only(&example(), folder, |block| !block.contains("[[reference]]"))
}

/// A machine with the tables that are `kept`.
fn only(machine: &Path, folder: &Path, kept: impl Fn(&str) -> bool) -> PathBuf {
    let described = std::fs::read_to_string(machine).unwrap();
    let kept: Vec<&str> = described.split("\n\n").filter(|b| kept(b)).collect();
    let maps = machine.with_file_name("sensitivity.csv");
    std::fs::copy(maps, folder.join("sensitivity.csv")).unwrap();
    let path = folder.join("machine.toml");
    std::fs::write(&path, kept.join("\n\n")).unwrap();
    path
}

#[test]
fn without_reference_the_gauges_outvote_one_that_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let machine = without_references(folder.path());
    let effect = ["gain-error@ta2=1"];
    let fitted = recorded_of(
        &example(),
        folder.path(),
        "fitted.parquet",
        "start-stop",
        "60",
        &effect,
    );
    let said = diagnosed_as(&machine, &fitted, &[]);
    assert_eq!(said["torque_told_by"], "gauges", "{said}");
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "gain-error");
    let gain = said["effects"][0]["parameters"]["part of the reading"]["ta2"]
        .as_f64()
        .unwrap();
    assert!((gain.abs() - 0.05).abs() < 3e-3, "{gain}");
    // Friction is not observable without the loads, and there is no error to report.
    let silent = said["cannot_show"].as_array().unwrap();
    assert!(silent.contains(&"coulomb-friction".into()), "{said}");
    assert!(said["error"]["nominal"]["before"]["value_percent"].is_null());

    let clean = recorded_of(
        &example(),
        folder.path(),
        "clean.parquet",
        "start-stop",
        "60",
        &[],
    );
    let said = diagnosed_as(&machine, &clean, &[]);
    assert_eq!(said["verdict"], "none", "{said}");
}

/// The test of a residual, `with` what it goes, where there is one.
fn tested<'a>(said: &'a Value, channel: &str, test: &str, with: &str) -> &'a Value {
    let structure = said["structure"].as_array().unwrap();
    let of = structure.iter().find(|s| s["channel"] == channel).unwrap();
    let named = |t: &&Value| t["test"] == test && t["with"].as_str().unwrap().contains(with);
    of["tests"].as_array().unwrap().iter().find(named).unwrap()
}

fn stands_out(tested: &Value, when: &str) -> bool {
    let by_chance = tested["by_chance"].as_f64();
    by_chance.is_some_and(|by_chance| tested[when].as_f64().unwrap().abs() > by_chance)
}

#[test]
fn one_gauge_without_reference_is_judged_by_its_innovations() {
    let folder = tempfile::tempdir().unwrap();
    let one = |block: &str| {
        let other = block.contains("[[channel]]") && !block.contains("\"ta1\"");
        !other && !block.contains("[[reference]]") && !block.contains("[[sensor_set]]")
    };
    let machine = only(&machine(), folder.path(), one);
    let clean = recorded(folder.path(), "clean.parquet", "start-stop", "60", &[]);
    let said = diagnosed_as(&machine, &clean, &[]);
    assert_eq!(said["torque_told_by"], "filter", "{said}");
    assert_eq!(said["verdict"], "none", "{said}");
    // An effect that a load can imitate is not reported.
    let silent = said["cannot_show"].as_array().unwrap();
    assert!(silent.contains(&"gain-error".into()), "{said}");

    let effect = ["carrier-order=1"];
    let fitted = recorded(folder.path(), "fitted.parquet", "start-stop", "60", &effect);
    let said = diagnosed_as(&machine, &fitted, &[]);
    assert_eq!(said["verdict"], "unknown", "{said}");
    let order = tested(&said, "ta1", "order", "main_shaft");
    assert!(
        order["with"].as_str().unwrap().starts_with("2 of"),
        "{order}"
    );
    assert!(stands_out(order, "before"), "{order}");
    assert!(said["error"]["nominal"]["before"]["value_percent"].is_null());
}

#[test]
fn residuals_go_with_what_the_effect_goes_with_until_it_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let diagnosed_with = |effect: &str| {
        let fitted = recorded(
            folder.path(),
            "fitted.parquet",
            "start-stop",
            "60",
            &[effect],
        );
        diagnosed(&fitted, &[])
    };
    let said = diagnosed_with("strain-nonlinearity=1");
    let torque = tested(&said, "ta1", "over", "Torque");
    assert!(torque["before"].as_f64().unwrap() > 0.5, "{torque}");
    assert!(!stands_out(torque, "after"), "{torque}");
    let said = diagnosed_with("thermal-drift=3");
    let warmth = tested(&said, "ta1", "over", "Warmer");
    assert!(warmth["before"].as_f64().unwrap() > 0.5, "{warmth}");
    assert!(!stands_out(warmth, "after"), "{warmth}");
    let said = diagnosed_with("carrier-order=1");
    for (test, with) in [("order", "main_shaft"), ("colour", ""), ("beside", "")] {
        let tested = tested(&said, "ta1", test, with);
        assert!(stands_out(tested, "before"), "{tested}");
        assert!(!stands_out(tested, "after"), "{tested}");
    }
}

/// Both the late part and its delay, not only their product, also where a recording begins in motion.
#[test]
fn the_delay_of_a_gauge_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    for scenario in ["reversals", "start-stop"] {
        let effect = ["channel-delay@ta2=1.5"];
        let recording = recorded(folder.path(), "late.parquet", scenario, "60", &effect);
        let said = diagnosed(&recording, &[]);
        assert_eq!(said["verdict"], "effect", "{said}");
        assert_eq!(said["effects"][0]["name"], "channel-delay");
        let parameters = &said["effects"][0]["parameters"];
        let late_s = parameters["delay [s]"].as_f64().unwrap();
        assert!((late_s - 0.03).abs() < 1e-3, "{parameters}");
        let part = &parameters["part of the reading that is late"]["ta2"];
        assert!((part.as_f64().unwrap() - 1.0).abs() < 0.03, "{parameters}");
    }
}

/// The filter's own consistency, and the innovation of a gauge that it leaves out.
#[test]
fn innovations_are_reported_beside_the_residuals() {
    let folder = tempfile::tempdir().unwrap();
    let nis = |effects: &[&str]| {
        let fitted = recorded(folder.path(), "fitted.parquet", "start-stop", "60", effects);
        let said = diagnosed(&fitted, &[]);
        let sets = said["innovations"].as_array().unwrap().clone();
        assert_eq!(sets.len(), 3, "{said}");
        let set = sets
            .iter()
            .find(|s| s["sensors"] == "torque-arm-3")
            .unwrap();
        let gauge = &set["of"][1];
        assert_eq!(gauge["sensor"], "ta2");
        (
            set["nis"].as_f64().unwrap(),
            gauge["bias"].as_f64().unwrap(),
        )
    };
    let (consistent, bias) = nis(&[]);
    assert!((0.7..1.3).contains(&consistent), "{consistent}");
    assert!(bias.abs() < 0.2, "{bias}");
    let (wrong, bias) = nis(&["gain-error@ta2=1"]);
    // The vote leaves the gauge out: what the filter uses is consistent, its own innovation is not.
    assert!((0.7..1.3).contains(&wrong), "{wrong}");
    assert!(bias.abs() > 0.5, "{bias}");
}

/// Another recording confirms what is the machine's, though a gauge came loose in it as well, at
/// another moment.
#[test]
fn an_effect_is_confirmed_beside_one_that_does_not_last() {
    let folder = tempfile::tempdir().unwrap();
    let effects = ["gauge-debonding@rg3=1.5", "encoder-eccentricity=0.3"];
    let record =
        |name, scenario| recorded_of(&example(), folder.path(), name, scenario, "60", &effects);
    let [fitted, held_out] = [
        record("fitted.parquet", "reversals"),
        record("held_out.parquet", "turbulent"),
    ];
    let said = diagnosed_as(&example(), &fitted, &["--validate", &held_out]);
    assert_eq!(said["verdict"], "effects", "{said}");
    let names = [&said["effects"][0]["name"], &said["effects"][1]["name"]];
    assert_eq!(names, ["gauge-debonding", "encoder-eccentricity"], "{said}");
}

/// The model error of the strong one follows from the residual of the gauge that it explains best.
#[test]
fn a_weak_effect_is_named_beside_a_strong_one() {
    let folder = tempfile::tempdir().unwrap();
    let effects = ["strain-nonlinearity=1.3", "thermal-drift=0.3"];
    let recording = recorded(folder.path(), "two.parquet", "steps", "90", &effects);
    let said = diagnosed(&recording, &["--relevant-percent", "0"]);
    let found = said["effects"].as_array().unwrap();
    let names: Vec<&Value> = found.iter().map(|f| &f["name"]).collect();
    assert_eq!(names, ["strain-nonlinearity", "thermal-drift"], "{said}");
    let said = diagnosed(&recording, &["--relevant-percent", "2"]);
    assert_eq!(said["effects"].as_array().unwrap().len(), 1, "{said}");
    assert_eq!(said["negligible"], json!(["thermal-drift"]), "{said}");
}

/// Friction that builds up over an angle is a constant torque where nothing stands still.
#[test]
fn an_effect_beside_another_names_its_indistinguishable_ones() {
    let folder = tempfile::tempdir().unwrap();
    let effects = ["mains-pick-up=1", "presliding-hysteresis=1"];
    let recording = recorded(folder.path(), "two.parquet", "turbulent", "60", &effects);
    let said = diagnosed(&recording, &[]);
    let found = said["effects"].as_array().unwrap();
    let friction = found.iter().find(|f| f["name"] == "coulomb-friction");
    assert_eq!(friction.unwrap()["or_is"], json!(["presliding-hysteresis"]));
    assert_eq!(found.len(), 2, "{said}");
    assert!(said["next_experiment"].is_string(), "{said}");
}

#[test]
fn what_no_candidate_explains_is_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let effect = ["bursts=1"];
    let recording = recorded(folder.path(), "bursts.parquet", "start-stop", "60", &effect);
    let said = diagnosed(&recording, &[]);
    assert_eq!(said["verdict"], "unknown", "{said}");
    assert!(said["unexplained"][0]["after"].as_f64().unwrap() > 1.5);
    // Bursts go with nothing that was measured.
    assert_eq!(said["empirical_corrections"], json!([]), "{said}");
}

/// `from` in `to`, with `change` of each value of `column`, given also those of other columns.
fn rewritten(
    from: &str,
    to: &Path,
    column: &str,
    mut change: impl FnMut(f64, &dyn Fn(&str) -> f64) -> f64,
) {
    let mut to = csv::Writer::from_path(to).unwrap();
    let mut from = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_path(from)
        .unwrap();
    let header = from.headers().unwrap().clone();
    let place = |name: &str| header.iter().position(|h| h.starts_with(name)).unwrap();
    let changed = place(column);
    to.write_record(&header).unwrap();
    for record in from.records() {
        let record = record.unwrap();
        let number = |name: &str| record[place(name)].parse::<f64>().unwrap();
        let value = change(number(column), &number).to_string();
        let cells = record.iter().enumerate();
        to.write_record(cells.map(|(k, cell)| if k == changed { &value } else { cell }))
            .unwrap();
    }
}

/// A gauge that reads `8 µm/m sin(20 torque / nominal)` too much.
fn wavy(clean: &str, wavy: &Path) {
    rewritten(clean, wavy, "ta2", |reads, column| {
        reads + 8e-6 * (20.0 * column("torque_main") / 312e3).sin()
    });
}

#[test]
fn what_goes_with_torque_is_offered_as_a_correction_without_a_cause() {
    let folder = tempfile::tempdir().unwrap();
    let clean = recorded(folder.path(), "clean.csv", "start-stop", "60", &[]);
    let path = folder.path().join("wavy.csv");
    wavy(&clean, &path);
    let said = diagnosed(&path.display().to_string(), &[]);
    assert_eq!(said["verdict"], "unknown", "{said}");
    let offered = &said["empirical_corrections"][0];
    assert_eq!(offered["channel"], "ta2", "{said}");
    assert_eq!(offered["over"], "Torque over nominal", "{said}");
    assert!(offered["takes"].as_f64().unwrap() > 0.5, "{offered}");
}
