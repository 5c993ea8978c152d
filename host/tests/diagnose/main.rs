//! `loadtwin diagnose` on recordings whose effect it is not told.

mod refused;
mod several;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use loadtwin::machine::Machine;
use serde_json::{Value, json};

fn machine() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/gearbox/machine.toml")
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

/// Error of the main shaft's torque by the filter [% of nominal].
fn nmae(machine: &str, recording: &str, sensors: &str) -> f64 {
    nmae_of("main_shaft", machine, recording, sensors)
}

fn nmae_of(load: &str, machine: &str, recording: &str, sensors: &str) -> f64 {
    let output = loadtwin(&["replay", "--json", machine, recording, "--sensors", sensors]);
    assert!(output.status.success());
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    said["loads"][load]["nmae_percent"]["full"]
        .as_f64()
        .unwrap()
}

#[test]
fn nothing_is_missing_from_a_clean_recording() {
    let folder = tempfile::tempdir().unwrap();
    let recording = recorded(folder.path(), "clean.parquet", "start-stop", "60", &[]);
    let said = diagnosed(&recording, &[]);
    assert_eq!(said["verdict"], "none", "{said}");
    assert_eq!(said["effects"].as_array().unwrap().len(), 0);
}

/// Vibrations, reversals and steps are done again in the simulations that tell
/// what chance leaves.
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
    only(folder, |block| !block.contains("[[reference]]"))
}

/// The machine of the example with the tables that are `kept`.
fn only(folder: &Path, kept: impl Fn(&str) -> bool) -> PathBuf {
    let described = std::fs::read_to_string(machine()).unwrap();
    let kept: Vec<&str> = described.split("\n\n").filter(|b| kept(b)).collect();
    let maps = machine().with_file_name("sensitivity.csv");
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
    let seen = recorded(folder.path(), "seen.parquet", "start-stop", "60", &effect);
    let said = diagnosed_as(&machine, &seen, &[]);
    assert_eq!(said["torque_told_by"], "gauges", "{said}");
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "gain-error");
    let gain = said["effects"][0]["parameters"]["part of the reading"]["ta2"]
        .as_f64()
        .unwrap();
    assert!((gain.abs() - 0.05).abs() < 3e-3, "{gain}");
    // Friction is not seen without the loads, and there is no error to tell.
    let silent = said["cannot_show"].as_array().unwrap();
    assert!(silent.contains(&"coulomb-friction".into()), "{said}");
    assert!(said["error"]["nominal"]["before"]["value_percent"].is_null());

    let clean = recorded(folder.path(), "clean.parquet", "start-stop", "60", &[]);
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
    tested[when].as_f64().unwrap().abs() > tested["by_chance"].as_f64().unwrap()
}

#[test]
fn one_gauge_without_reference_is_judged_by_its_innovations() {
    let folder = tempfile::tempdir().unwrap();
    let one = |block: &str| {
        let other = block.contains("[[channel]]") && !block.contains("\"ta1\"");
        !other && !block.contains("[[reference]]") && !block.contains("[[sensor_set]]")
    };
    let machine = only(folder.path(), one);
    let clean = recorded(folder.path(), "clean.parquet", "start-stop", "60", &[]);
    let said = diagnosed_as(&machine, &clean, &[]);
    assert_eq!(said["torque_told_by"], "filter", "{said}");
    assert_eq!(said["verdict"], "none", "{said}");
    // What a load may be is not told.
    let silent = said["cannot_show"].as_array().unwrap();
    assert!(silent.contains(&"gain-error".into()), "{said}");

    let effect = ["carrier-order=1"];
    let seen = recorded(folder.path(), "seen.parquet", "start-stop", "60", &effect);
    let said = diagnosed_as(&machine, &seen, &[]);
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
        let seen = recorded(folder.path(), "seen.parquet", "start-stop", "60", &[effect]);
        diagnosed(&seen, &[])
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

/// The filter's own consistency: of what it expects in a clean machine, not with a gauge that
/// drifts by many times its noise.
#[test]
fn innovations_are_told_beside_the_residuals() {
    let folder = tempfile::tempdir().unwrap();
    let nis = |effects: &[&str]| {
        let seen = recorded(folder.path(), "seen.parquet", "start-stop", "60", effects);
        let said = diagnosed(&seen, &[]);
        let sets = said["innovations"].as_array().unwrap().clone();
        assert_eq!(sets.len(), 8, "{said}");
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
    assert!(wrong > 2.0 * consistent, "{wrong}");
    assert!(bias.abs() > 0.5, "{bias}");
}

#[test]
fn a_gain_error_is_named_and_the_description_is_mended() {
    let folder = tempfile::tempdir().unwrap();
    let effect = ["gain-error@ta2=1"];
    let seen = recorded(folder.path(), "seen.parquet", "start-stop", "60", &effect);
    let unseen = recorded(folder.path(), "unseen.parquet", "steps", "60", &effect);
    let out = folder.path().join("mended.toml").display().to_string();
    let page = folder.path().join("page.html").display().to_string();
    let more = ["--validate", &unseen, "--out", &out, "--report", &page];
    let said = diagnosed(&seen, &more);
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "gain-error");
    assert_eq!(said["effects"][0]["channels"], serde_json::json!(["ta2"]));
    let gain = said["effects"][0]["parameters"]["part of the reading"]["ta2"]
        .as_f64()
        .unwrap();
    assert!((gain.abs() - 0.05).abs() < 1e-3, "{gain}");
    let error = |which: &str| {
        said["error"]["nominal"][which]["value_percent"]
            .as_f64()
            .unwrap()
    };
    assert!(error("after") < 0.5 * error("before"), "{said}");
    assert_eq!(said["machine_out"], out);
    assert!(std::fs::metadata(&page).unwrap().len() > 10_000);
    // The mended description is one that `replay` runs, with a smaller error.
    let described = machine().display().to_string();
    let filter_error = |machine: &str| nmae(machine, &unseen, "torque-arm-3");
    assert!(filter_error(&out) < filter_error(&described));
}

/// What the line runs is no longer missing, on a recording that took no part.
#[test]
fn friction_response_creep_and_warmth_that_are_found_become_part_of_the_description() {
    let folder = tempfile::tempdir().unwrap();
    let described = machine().display().to_string();
    for (effect, load, sensors) in [
        ("coulomb-friction", "main_shaft", "torque-arm-3"),
        ("load-friction", "high_speed_shaft", "torque-arm-3"),
        ("strain-nonlinearity", "main_shaft", "torque-arm-3"),
        ("bending-load", "main_shaft", "torque-arm-3"),
        ("gauge-creep", "main_shaft", "high-speed-housing-1"),
        ("thermal-gain", "main_shaft", "torque-arm-3"),
    ] {
        let seen = recorded(folder.path(), "seen.parquet", "start-stop", "60", &[effect]);
        let unseen = recorded(
            folder.path(),
            "unseen.parquet",
            "reversals",
            "60",
            &[effect],
        );
        let out = folder.path().join("better.toml");
        let out_name = out.display().to_string();
        let said = diagnosed(&seen, &["--out", &out_name]);
        assert_eq!(said["effects"][0]["name"], effect, "{said}");
        let again = diagnosed_as(&out, &unseen, &[]);
        assert_eq!(again["verdict"], "none", "{effect}: {again}");
        let error = |machine: &str| nmae_of(load, machine, &unseen, sensors);
        assert!(error(&out_name) < error(&described), "{effect}");
    }
}

/// The same of a gauge that remembers the way on which the load came, as a description has it.
#[test]
fn hysteresis_of_a_gauge_becomes_part_of_the_description() {
    let folder = tempfile::tempdir().unwrap();
    let described = machine();
    let maps = described.with_file_name("sensitivity.csv");
    let text = (std::fs::read_to_string(&described).unwrap())
        .replace("sensitivity.csv", &maps.display().to_string())
        .replace(
            "name = \"ta2\"",
            "name = \"ta2\"\nhysteresis = { half_width = -8e-6, level = 0.1 }",
        );
    let remembering = folder.path().join("remembering.toml");
    std::fs::write(&remembering, text).unwrap();
    let seen = recorded_of(
        &remembering,
        folder.path(),
        "seen.parquet",
        "reversals",
        "60",
        &[],
    );
    let unseen = recorded_of(
        &remembering,
        folder.path(),
        "unseen.parquet",
        "steps",
        "60",
        &[],
    );
    let out = folder.path().join("better.toml");
    let out_name = out.display().to_string();
    let said = diagnosed(&seen, &["--out", &out_name]);
    assert_eq!(said["effects"][0]["name"], "strain-hysteresis", "{said}");
    let found = Machine::load(&out).unwrap().channels[1].hysteresis.unwrap();
    assert!((found.half_width / -8e-6 - 1.0).abs() < 0.1, "{found:?}");
    assert!((found.level / 0.1 - 1.0).abs() < 0.2, "{found:?}");
    // Of what it adds to the error little is left.
    let clean = recorded(folder.path(), "clean.parquet", "steps", "60", &[]);
    let described = described.display().to_string();
    let error = |machine, recording| nmae(machine, recording, "torque-arm-3");
    let least = error(&described, &clean);
    let (before, after) = (error(&described, &unseen), error(&out_name, &unseen));
    assert!(
        after - least < 0.1 * (before - least),
        "{least} {before} {after}"
    );
}

/// Another recording confirms what is the machine's, though a gauge came loose in it as well, at
/// another moment.
#[test]
fn an_effect_is_confirmed_beside_one_that_does_not_last() {
    let folder = tempfile::tempdir().unwrap();
    let effects = ["gauge-debonding@rg3=1.5", "encoder-eccentricity=0.3"];
    let record = |name, scenario| recorded(folder.path(), name, scenario, "60", &effects);
    let [seen, unseen] = [
        record("seen.parquet", "reversals"),
        record("unseen.parquet", "turbulent"),
    ];
    let said = diagnosed(&seen, &["--validate", &unseen]);
    assert_eq!(said["verdict"], "effects", "{said}");
    let names = [&said["effects"][0]["name"], &said["effects"][1]["name"]];
    assert_eq!(names, ["gauge-debonding", "encoder-eccentricity"], "{said}");
}

/// What the strong one leaves of the gauge that it explains best tells how right its form is.
#[test]
fn a_weak_effect_is_named_beside_a_strong_one() {
    let folder = tempfile::tempdir().unwrap();
    let effects = ["strain-nonlinearity=1.3", "thermal-drift=0.15"];
    let recording = recorded(folder.path(), "two.parquet", "steps", "90", &effects);
    let said = diagnosed(&recording, &[]);
    let found = said["effects"].as_array().unwrap();
    let names: Vec<&Value> = found.iter().map(|f| &f["name"]).collect();
    assert_eq!(names, ["strain-nonlinearity", "thermal-drift"], "{said}");
}

/// Friction that builds up over an angle is a constant torque where nothing stands still.
#[test]
fn beside_another_an_effect_says_what_it_cannot_be_told_from() {
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

/// An effect of strength 1 diagnosed in `reversals`, and the description with it.
struct Mended {
    said: Value,
    machine: Machine,
    /// What the mended description still lacks in the same recording.
    again: Value,
    /// Error of the filter on a recording that took no part, before and after.
    errors: [f64; 2],
}

fn mended(effect: &str, sensors: &str) -> Mended {
    let folder = tempfile::tempdir().unwrap();
    let effect = [effect];
    let recording = recorded(folder.path(), "seen.parquet", "reversals", "60", &effect);
    let out = folder.path().join("mended.toml").display().to_string();
    let said = diagnosed(&recording, &["--out", &out]);
    let unseen = recorded(folder.path(), "unseen.parquet", "start-stop", "60", &effect);
    let described = machine().display().to_string();
    Mended {
        said,
        machine: Machine::load(Path::new(&out)).unwrap(),
        again: diagnosed_as(Path::new(&out), &recording, &[]),
        errors: [&described, &out].map(|machine| nmae(machine, &unseen, sensors)),
    }
}

/// What a recording begins with vibrates at another frequency with the gear; no ripple is needed
/// to explain it. The line runs it, as one inertia more.
#[test]
fn a_gear_with_inertia_is_named_alone_with_its_inertia() {
    let mended = mended("torsional-resonance=1", "torque-arm-3");
    let said = &mended.said;
    assert_eq!(said["verdict"], "effect", "{said}");
    let found = &said["effects"][0];
    assert_eq!(found["name"], "torsional-resonance");
    // 20 %, and the 1 % that every simulated machine has.
    let inertia = &found["parameters"]["inertia [part of the smaller neighbour's]"];
    let inertia = inertia.as_f64().unwrap();
    assert!((inertia - 0.21).abs() < 5e-3, "{inertia}");
    assert_eq!(mended.again["verdict"], "none", "{}", mended.again);
    let [before, after] = mended.errors;
    assert!(after < 0.9 * before, "{before} % before, {after} % after");
}

/// Where its map varies much over the angle, a gauge suffers most from an angle that errs.
#[test]
fn an_eccentric_encoder_is_set_right_in_the_line() {
    let mended = mended("encoder-eccentricity=1", "ring-gear-3");
    let name = &mended.said["effects"][0]["name"];
    assert_eq!(name, "encoder-eccentricity", "{}", mended.said);
    let encoder = mended.machine.homed_encoder().unwrap();
    let amplitude = encoder.eccentricity.unwrap().amplitude_rad;
    assert!((amplitude - 0.002).abs() < 5e-5, "{amplitude}");
    assert_eq!(mended.again["verdict"], "none", "{}", mended.again);
    let [before, after] = mended.errors;
    assert!(after < 0.8 * before, "{before} % before, {after} % after");
}

/// The same of an angle that is old: at nominal speed the carrier turns by 3 degrees in 20 ms.
#[test]
fn a_gauge_that_comes_late_is_compared_with_where_the_carrier_was() {
    let mended = mended("channel-delay@rg2=1", "ring-gear-3");
    let name = &mended.said["effects"][0]["name"];
    assert_eq!(name, "channel-delay", "{}", mended.said);
    for channel in &mended.machine.channels {
        let late_s = if channel.name == "rg2" { 0.02 } else { 0.0 };
        let off = (channel.late_s - late_s).abs();
        assert!(off < 2e-4, "{}: {} s", channel.name, channel.late_s);
    }
    let [before, after] = mended.errors;
    assert!(after < 0.2 * before, "{before} % before, {after} % after");
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

/// A gauge that reads `8 µm/m sin(20 torque / nominal)` too much.
fn wavy(clean: &str, wavy: &Path) {
    let mut to = csv::Writer::from_path(wavy).unwrap();
    let mut from = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_path(clean)
        .unwrap();
    let header = from.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|h| h.starts_with(name)).unwrap();
    let (gauge, torque) = (column("ta2"), column("torque_main"));
    to.write_record(&header).unwrap();
    for record in from.records() {
        let record = record.unwrap();
        let told = |k: usize| record[k].parse::<f64>().unwrap();
        let reads = told(gauge) + 8e-6 * (20.0 * told(torque) / 312e3).sin();
        let cells = record.iter().enumerate();
        to.write_record(cells.map(|(k, cell)| match k {
            _ if k == gauge => reads.to_string(),
            _ => cell.to_owned(),
        }))
        .unwrap();
    }
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
