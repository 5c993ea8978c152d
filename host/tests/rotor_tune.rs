//! `loadtwin tune` of a rotor: the methods side by side, evaluated on a hold-out recording;
//! and what `replay` says of orbits and of speeds outside of the schedule.

#[path = "web/appearance.rs"]
mod appearance;
#[path = "web/browser.rs"]
mod browser;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::Machine;
use loadtwin::rotor_tune::Trial;
use loadtwin::simulate::{RotorScenario, RotorSimulation};
use loadtwin::tune::Training;
use serde_json::Value;

/// Noise of the sensors in that of the description.
const NOISE: f64 = 4.0;

fn example() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rotor/machine.toml")
}

fn recording(
    machine: &Machine,
    folder: &Path,
    (seed, duration_s): (u64, f64),
    speeds_rad_s: [f64; 2],
) -> PathBuf {
    let path = folder.join(format!("{seed}.parquet"));
    let rotor = machine.rotor.as_ref().unwrap();
    let scenario = RotorScenario {
        noise: NOISE,
        speeds_rad_s,
        ..RotorScenario::by_name("constant", rotor, seed, Some(duration_s)).unwrap()
    };
    let simulation = RotorSimulation::new(machine, rotor, scenario).unwrap();
    simulation.write(&path, |_| ()).unwrap();
    path
}

fn loadtwin(arguments: &[&str], paths: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(arguments)
        .args(paths)
        .output()
        .unwrap()
}

/// What the model makes of the estimated forces is what the sensors read, also through a
/// critical speed, where the model is another one at each speed.
#[test]
fn the_objectives_of_the_paper_hold_where_the_speed_varies() {
    let mut machine = Machine::load(&example()).unwrap();
    let encoder = "name = \"shaft\"\ncounts_per_turn = 4096\nbits = 16";
    machine.encoders.push(toml::from_str(encoder).unwrap());
    machine.rotor.as_mut().unwrap().schedule_rad_s = Some([80.0, 200.0]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run-up.parquet");
    let rotor = machine.rotor.as_ref().unwrap();
    let scenario = RotorScenario::by_name("run-up", rotor, 5, Some(5.0)).unwrap();
    let simulation = RotorSimulation::new(&machine, rotor, scenario).unwrap();
    simulation.write(&path, |_| ()).unwrap();
    let sensors = Sensors::choose(&machine, None).unwrap();
    let payload = image_build::image(&machine, &sensors).unwrap();
    let trial = Trial::new(
        &machine,
        rotor,
        &sensors,
        &payload,
        Training::whole(&[path]),
    )
    .unwrap();
    let objectives = trial.run(&[0.0; 8]).objectives;
    println!("objectives in a run-up: {objectives:?}");
    assert!(objectives.iter().all(|f| *f < 0.02), "{objectives:?}");
}

#[test]
fn likelihood_finds_the_noise_and_evolution_follows_it() {
    let machine = Machine::load(&example()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let speeds = [machine.rotor.as_ref().unwrap().speed_rad_s; 2];
    // What is held out is compared after 2 s.
    let [tuned_on, unseen] =
        [(21, 0.5), (22, 3.0)].map(|of_noise| recording(&machine, folder.path(), of_noise, speeds));
    let (out, page) = (
        folder.path().join("tuned.toml"),
        folder.path().join("page.html"),
    );
    let files = [&out, &page, &unseen].map(|path| path.to_str().unwrap());
    let options = [
        "tune",
        "--json",
        "-o",
        files[0],
        "--report",
        files[1],
        "--validate",
        files[2],
    ];
    let output = loadtwin(&options, &[&example(), &tuned_on]);
    assert!(output.status.success(), "{output:?}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let [described, evolution, likelihood] =
        ["described", "evolution", "likelihood"].map(|method| &report["methods"][method]);
    let number = |value: &Value| value.as_f64().unwrap();
    for channel in &machine.channels {
        let found = number(&likelihood["noise_std"][&channel.name]);
        let factor = found / (NOISE * channel.noise_std);
        assert!((0.8..1.25).contains(&factor), "{}: {factor}", channel.name);
    }
    let misfit = |method: &Value| number(&method["misfit"]);
    assert!(misfit(likelihood) < misfit(described) && misfit(likelihood) < misfit(evolution));
    // What follows the noise comes nearer to the readings.
    let objective = |method: &Value, i: usize| number(&method["objectives"][i]);
    assert!(objective(evolution, 0) <= objective(described, 0));
    let evaluated = |method: &Value, key: &str| number(&method["judged"][key]);
    let nis = evaluated(likelihood, "nis_mean");
    assert!((0.8..1.2).contains(&nis), "{nis}");
    let settled = |method: &Value| number(&method["judged"]["displacement_um"]["full"]);
    println!(
        "displacement, unseen, full: described {:.3}, evolution {:.3}, likelihood {:.3} µm; {:.1} s",
        settled(described),
        settled(evolution),
        settled(likelihood),
        number(&report["seconds"])
    );
    let tuned = Machine::load(&out).unwrap();
    let noise = tuned.channels[0].noise_std;
    assert!((noise / number(&likelihood["noise_std"]["x5"]) - 1.0).abs() < 1e-4);
    assert!(
        std::fs::read_to_string(&page)
            .unwrap()
            .contains("Walk disc1_x, disc1_y")
    );
    let mut browser = browser::Browser::open("about:blank");
    appearance::check_report(&mut browser, &page, "tune-rotor");
}

/// Noise that was compared with nothing is not written.
#[test]
fn recordings_too_short_to_compare_write_nothing() {
    let machine = Machine::load(&example()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let speeds = [machine.rotor.as_ref().unwrap().speed_rad_s; 2];
    let short = recording(&machine, folder.path(), (23, 0.5), speeds);
    let out = folder.path().join("tuned.toml");
    let options = ["tune", "-o", out.to_str().unwrap()];
    let output = loadtwin(&options, &[&example(), &short]);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(
        text.contains("nothing to compare after its first 2 s") && !out.exists(),
        "{text}"
    );
}

#[test]
fn what_a_rotor_has_no_use_for_is_refused_in_one_line() {
    let missing = Path::new("none.csv");
    for (options, said) in [
        (
            ["tune", "--method", "frf"].as_slice(),
            "likelihood, evolution",
        ),
        (&["tune", "--cutoff", "10"], "--cutoff"),
        (&["tune", "--compare"], "--compare"),
    ] {
        let output = loadtwin(options, &[&example(), missing]);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(
            text.contains(said) && text.trim_end().lines().count() == 1,
            "{text}"
        );
    }
}

#[test]
fn a_replay_shows_orbits_and_says_where_the_speed_leaves_the_schedule() {
    let folder = tempfile::tempdir().unwrap();
    let described = folder.path().join("machine.toml");
    let encoder = "[[encoder]]\nname = \"shaft\"\ncounts_per_turn = 4096\nbits = 16\n";
    let text = std::fs::read_to_string(example()).unwrap();
    let schedule = "speed_rad_s = 87.96\nschedule_rad_s = [80, 100]";
    let text = text.replacen("speed_rad_s = 87.96", schedule, 1);
    std::fs::write(&described, text + "\n" + encoder).unwrap();
    let machine = Machine::load(&described).unwrap();
    let page = folder.path().join("page.html");
    for (seed, last, outside) in [(1, 98.0, false), (2, 130.0, true)] {
        let path = recording(&machine, folder.path(), (seed, 0.5), [82.0, last]);
        let options = ["replay", "--json", "--report", page.to_str().unwrap()];
        let output = loadtwin(&options, &[&described, &path]);
        assert!(output.status.success(), "{output:?}");
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        let note = report["speed_note"].as_str().unwrap_or_default();
        assert_eq!(!note.is_empty(), outside, "{note}");
        assert!(
            !outside || note.contains("allowed: 80 to 100 rad/s"),
            "{note}"
        );
    }
    let text = std::fs::read_to_string(&page).unwrap();
    for said in ["Orbits, start_up", "Node 37", "1x phasor inversion"] {
        assert!(text.contains(said), "{said}");
    }
}
