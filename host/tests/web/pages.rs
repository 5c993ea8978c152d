//! Report pages of the commands in a real browser, for drives, gearboxes, rotors and a bearing of several
//! sizes: no fault of appearance, size of the file, time to the first paint.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::{examples, loadtwin};
use crate::appearance::{check_report, faults, violations};
use crate::browser::Browser;

/// A page is never larger.
const LARGEST_PAGE: u64 = 8_000_000;

/// Nobody waits longer for the first text of a page.
const LONGEST_FIRST_PAINT_MS: f64 = 1000.0;

pub struct Bench {
    folder: tempfile::TempDir,
    pub browser: Browser,
}

impl Bench {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        for machine in ["bench", "bearing", "gearbox", "rotor", "feed-drive"] {
            let target = folder.path().join(machine);
            std::fs::create_dir(&target).expect("a folder");
            for file in std::fs::read_dir(examples().join(machine)).expect("a folder") {
                let file = file.expect("a file").path();
                if file.is_file() {
                    std::fs::copy(&file, target.join(file.file_name().expect("a name")))
                        .expect("copied");
                }
            }
        }
        Self {
            browser: Browser::open("about:blank"),
            folder,
        }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn run(&self, line: &str) {
        let arguments: Vec<&str> = line.split_whitespace().collect();
        let output = loadtwin(self.folder.path(), &arguments)
            .output()
            .expect("runs");
        let reason = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{line}: {reason}");
    }

    /// Runs a command that writes a page, and checks this.
    fn check(&mut self, name: &str, line: &str) {
        let page = self.path(&format!("{name}.html"));
        self.run(&format!("{line} --report {}", page.display()));
        assert!(size(&page) <= LARGEST_PAGE, "{name}");
        check_report(&mut self.browser, &page, name);
    }

    /// A tool of 0.03 Nm: the bench with all that moves or bends smaller.
    fn tool(&self) {
        let bench = std::fs::read_to_string(self.path("bench/machine.toml")).expect("text");
        let small = [
            ("\"bench 3\"", "\"hand tool\""),
            ("nominal_nm = 500", "nominal_nm = 0.03"),
            ("= 0.6 ", "= 1e4 "),
            ("= -0.6 ", "= -1e4 "),
            ("moment_kg_m2 = 1.8", "moment_kg_m2 = 1.08e-4"),
            ("moment_kg_m2 = 2.6", "moment_kg_m2 = 1.56e-4"),
            ("= 0.15\n", "= 9e-6\n"),
            ("= 0.2\n", "= 1.2e-5\n"),
            ("= 6.0e4", "= 3.6"),
            ("damping_nm_s_per_rad = 25", "damping_nm_s_per_rad = 1.5e-3"),
        ];
        let text = small.iter().fold(bench, |text, (from, to)| {
            assert!(text.contains(from), "no {from}");
            text.replace(from, to)
        });
        std::fs::write(self.path("tool.toml"), text).expect("written");
    }
}

fn size(path: &Path) -> u64 {
    std::fs::metadata(path).expect("a file").len()
}

#[test]
fn pages_of_a_bench_of_500_newton_metres() {
    let mut bench = Bench::new();
    let effects = "--individual 3 --effect gain-error --effect gauge-offset";
    bench.run(&format!(
        "simulate bench/machine.toml --scenario torque-ramps --duration-s 30 --seed 3 {effects} -o ramps.parquet"
    ));
    bench.run(&format!(
        "simulate bench/machine.toml --duration-s 20 --seed 4 {effects} -o start-stop.parquet"
    ));
    bench.check(
        "replay-bench",
        "replay bench/machine.toml start-stop.parquet",
    );
    bench.check(
        "calibrate-bench",
        "calibrate bench/machine.toml ramps.parquet -o calibrated.toml",
    );
    bench.check(
        "tune-bench",
        "tune calibrated.toml ramps.parquet -o tuned.toml",
    );
    bench.run("replay calibrated.toml start-stop.parquet --estimates estimates.parquet");
    bench.check(
        "life-bench",
        "life estimates.parquet --machine calibrated.toml",
    );
}

#[test]
fn pages_of_a_gearbox_of_312_kilonewton_metres() {
    let mut bench = Bench::new();
    for (scenario, seconds) in [("constant", 30), ("torque-ramps", 30)] {
        bench.run(&format!(
            "simulate gearbox/machine.toml --scenario {scenario} --duration-s {seconds} --seed 2 --individual 1 \
             --effect gauge-creep -o {scenario}.parquet"
        ));
    }
    bench.check(
        "replay-gearbox",
        "replay gearbox/calibrated.toml gearbox/start-stop.parquet --sensors torque-arm-3",
    );
    bench.check(
        "calibrate-gearbox",
        "calibrate gearbox/machine.toml constant.parquet torque-ramps.parquet",
    );
    bench.check(
        "diagnose-gearbox",
        "diagnose gearbox/calibrated.toml torque-ramps.parquet",
    );
    bench.check(
        "tune-gearbox",
        "tune gearbox/calibrated.toml constant.parquet torque-ramps.parquet --sensors torque-arm-3 -o tuned.toml --compare",
    );
}

#[test]
fn pages_of_a_tool_of_30_millinewton_metres() {
    let mut bench = Bench::new();
    bench.tool();
    bench.run("simulate tool.toml --scenario torque-ramps --duration-s 30 --seed 3 --effect gain-error --individual 3 -o ramps.parquet");
    bench.check("replay-tool", "replay tool.toml ramps.parquet");
    bench.check("calibrate-tool", "calibrate tool.toml ramps.parquet");
    bench.check("diagnose-tool", "diagnose tool.toml ramps.parquet");
    let page = std::fs::read_to_string(bench.path("calibrate-tool.html")).expect("text");
    assert!(page.contains("per mNm"), "the unit of the loads");
}

#[test]
fn pages_of_a_rotor_and_of_a_drive() {
    let mut bench = Bench::new();
    bench.run(
        "simulate rotor/machine.toml --duration-s 4 --seed 2 --effect sensor-bias -o rotor.parquet",
    );
    bench.check("replay-rotor", "replay rotor/machine.toml rotor.parquet");
    bench.check(
        "diagnose-rotor",
        "diagnose rotor/machine.toml rotor.parquet",
    );
    for seed in [1, 2] {
        bench.run(&format!(
            "simulate feed-drive/plant.toml --scenario reversals --duration-s 40 --individual 1 --seed {seed} \
             --effect coulomb-friction=3 -o drive-{seed}.csv"
        ));
    }
    bench.check(
        "diagnose-drive",
        "diagnose feed-drive/drive.toml drive-1.csv --validate drive-2.csv",
    );
}

/// Those of calibration and diagnosis are looked at where the tests of bearings make them.
#[test]
fn page_of_a_wheel_bearing() {
    let mut bench = Bench::new();
    bench.run(
        "simulate bearing/calibrated.toml --scenario lc1 --duration-s 15 --seed 2 --individual 101 -o lc1.parquet",
    );
    bench.check(
        "replay-bearing",
        "replay bearing/calibrated.toml lc1.parquet",
    );
}

#[test]
fn the_page_of_the_papers_tables() {
    Bench::new().check("tables", "tables --individuals 1");
}

#[test]
fn a_page_of_a_million_samples_is_small_and_soon_on_the_screen() {
    let mut bench = Bench::new();
    bench.run("simulate bench/machine.toml --scenario torque-ramps --duration-s 500 --seed 1 -o long.parquet");
    let page = bench.path("long.html");
    bench.run(&format!(
        "replay bench/machine.toml long.parquet --report {}",
        page.display()
    ));
    let text = std::fs::read_to_string(&page).expect("text");
    assert!(text.contains("1000000 samples over time"));
    bench.browser.show_as(1600, 900, "light");
    // Others use the processor meanwhile; the page is not to blame for the slowest of three.
    let first_paints_ms = [0; 3].map(|_| {
        bench.browser.go("about:blank");
        bench.browser.go(&format!("file://{}", page.display()));
        let first = "performance.getEntriesByName('first-contentful-paint')[0]";
        bench.browser.wait(&format!("{first} !== undefined"));
        let time = bench.browser.value(&format!("{first}.startTime"));
        time.as_f64().expect("a time")
    });
    println!(
        "1000000 samples: {} bytes, first paint after {first_paints_ms:.0?} ms",
        size(&page)
    );
    assert!(size(&page) <= LARGEST_PAGE);
    assert!(
        first_paints_ms.iter().copied().fold(f64::NAN, f64::min) <= LONGEST_FIRST_PAINT_MS,
        "{first_paints_ms:?}"
    );
}

/// The checks find what they look for.
#[test]
fn faults_put_into_a_page_are_found() {
    let mut browser = Browser::open("about:blank");
    let page = "<html lang=en><meta name=viewport content='width=device-width'><title>a</title><main><h1>a</h1>\
        <p style='color:#aaa;background:#fff'>pale</p><p style='width:900px'>wide</p>\
        <p style='height:1px'>one</p><p style='margin-top:-14px'>another</p><button></button>\
        <div style='width:30px;overflow-x:hidden;white-space:nowrap'>longer than its place</div>";
    browser.value(&format!("document.write({})", json!(page)));
    browser.show_as(360, 900, "light");
    let found = faults(&mut browser).join("\n");
    for fault in [
        "of 360 pixels wide",
        "one on the other",
        "cut off: longer than its place",
    ] {
        assert!(found.contains(fault), "no {fault}: {found}");
    }
    let found = violations(&mut browser).join("\n");
    for rule in ["color-contrast", "button-name"] {
        assert!(found.contains(rule), "no {rule}: {found}");
    }
}
