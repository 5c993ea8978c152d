//! `loadtwin diagnose` of wheel bearings on simulated recordings: nothing is named without an
//! effect; a loose gauge is named with its place and the part of its answer that is lost, within
//! 0.05.

#[path = "web/appearance.rs"]
mod appearance;
#[path = "web/browser.rs"]
mod browser;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use loadtwin::diagnose::{self, BearingResiduals, Verdict};
use loadtwin::machine::{Kind, Machine};
use loadtwin::simulate::{BearingEffect, BearingScenario, BearingSimulation};
use serde_json::Value;

/// The individual that the example is calibrated for.
const CALIBRATED: u64 = 101;

fn example() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/bearing/calibrated.toml")
}

fn record(scenario: &str, seed: u64, effects: &[BearingEffect], folder: &Path) -> PathBuf {
    const DURATION_S: f64 = 20.0;
    let machine = Machine::load(&example()).unwrap();
    let Some(Kind::Bearing(bearing)) = machine.kind() else {
        unreachable!("the example is a bearing");
    };
    let (scenario, _) = BearingScenario::by_name(scenario).unwrap();
    let path = folder.join(format!("{seed}.parquet"));
    BearingSimulation::new(
        &machine,
        bearing,
        scenario,
        DURATION_S,
        seed,
        Some(CALIBRATED),
        effects,
    )
    .unwrap()
    .write(&path, |_| ())
    .unwrap();
    path
}

#[test]
fn of_a_clean_bearing_nothing_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = record("lc1", 31, &[], folder.path());
    let machine = Machine::load(&example()).unwrap();
    let said = diagnose::diagnose::<BearingResiduals>(&machine, &[path], &[], |_| ()).unwrap();
    assert_eq!(said.verdict, Verdict::None);
    // At one speed an offset does the same.
    assert_eq!(diagnose::cannot_show(&said.selection), ["speed-offset"]);
}

fn loadtwin(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(arguments)
        .output()
        .unwrap()
}

/// Named with its place and size; a line has no place for it, and says so.
#[test]
fn a_loose_gauge_is_named() {
    const LEFT: f64 = 0.7;
    let folder = tempfile::tempdir().unwrap();
    let path = record(
        "lc2",
        32,
        &[BearingEffect::LooseGauge(1, LEFT)],
        folder.path(),
    );
    let [out, page] = ["improved.toml", "page.html"].map(|name| folder.path().join(name));
    let output = loadtwin(&[
        "diagnose",
        "--json",
        &example().display().to_string(),
        &path.display().to_string(),
        "--out",
        &out.display().to_string(),
        "--report",
        &page.display().to_string(),
    ]);
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{complaint}");
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "loose-gauge", "{said}");
    assert_eq!(said["effects"][0]["place"], "top", "{said}");
    let lost = said["effects"][0]["parameters"]["part of the answer that is lost"]
        .as_f64()
        .unwrap();
    println!(
        "{:.1} % lost, {:.1} % in truth",
        100.0 * lost,
        100.0 * (1.0 - LEFT)
    );
    assert!((lost - (1.0 - LEFT)).abs() < 0.05, "{lost}");
    assert!(
        complaint.contains("loose-gauge: the line has no place"),
        "{complaint}"
    );
    // With its calibration found from another folder.
    assert!(Machine::load(&out).unwrap().bearing.is_some());
    let replayed = [&out, &path].map(|file| file.display().to_string());
    let replayed = loadtwin(&["replay", "--json", &replayed[0], &replayed[1]]);
    assert!(replayed.status.success());
    let mut browser = browser::Browser::open("about:blank");
    appearance::check_report(&mut browser, &page, "diagnose-bearing");
}
