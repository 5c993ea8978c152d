//! Fault-injection campaign of ten thousand runs with one fault each, on the host and on the
//! emulated board: faults are flagged within 5 samples (but for one count of an encoder) and
//! forgotten, no number is not finite, and both reports are equal.

use std::fs;
use std::process::Command;
use std::time::Instant;

use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::Machine as Description;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;
use loadtwin_firmware::campaign::{self, Kind, Machine, Report};
use loadtwin_tests::firmware::{build, root};
use loadtwin_tests::simulated;

/// As the program on the board has it.
const SETTLE: usize = 1000;
const RUNS: u32 = 10_000;
const SAMPLES: f64 = 7500.0;

/// The image of a part for `MODEL`.
fn part(bytes: &[u8]) -> Vec<u8> {
    let length = u32::try_from(bytes.len()).unwrap();
    [&length.to_le_bytes(), bytes].concat()
}

fn on_board(image: &[u8], machine: &Machine, samples: &[u8]) -> Report {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model");
    let machine = postcard::to_allocvec(machine).unwrap();
    let parts = [part(image), part(&machine), part(samples)].concat();
    fs::write(&model, parts).unwrap();
    let output = Command::new("qemu-system-arm")
        .args(["-M", "mps2-an386", "-cpu", "cortex-m4", "-display", "none"])
        .args(["-monitor", "none", "-serial", "none"])
        .args(["-semihosting-config", "enable=on,target=native"])
        .arg("-device")
        .arg(format!(
            "loader,file={},addr=0x300000,force-raw=on",
            model.display()
        ))
        .arg("-kernel")
        .arg(build_campaign())
        .output()
        .expect("qemu-system-arm starts; tests/run installs it");
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
    let hex = text
        .lines()
        .find_map(|line| line.strip_prefix("report "))
        .unwrap_or_else(|| panic!("no report in {text}"));
    let bytes: Vec<u8> = (0..hex.len() / 2)
        .map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap())
        .collect();
    postcard::from_bytes(&bytes).unwrap()
}

fn build_campaign() -> std::path::PathBuf {
    build("emulated", "campaign")
}

fn print(report: &Report, nominal: f32) {
    println!(
        "| fault | runs | flagged [%] | latency most, mean [samples] | grown [%] | latched | load error most, left [% of nominal] | [std] |"
    );
    for o in &report.outcomes {
        let share = |n: u32| 100.0 * f64::from(n) / f64::from(o.runs.max(1));
        println!(
            "| {:?} | {} | {:.1} | {}, {:.1} | {:.1} | {} | {:.3}, {:.3} | {:.2}, {:.2} |",
            o.kind,
            o.runs,
            share(o.flagged),
            o.latency_most,
            f64::from(o.latency_sum) / f64::from(o.flagged.max(1)),
            100.0 * f64::from(o.grown) / f64::from(o.flagged.max(1)),
            o.latched,
            100.0 * o.error_most / nominal,
            100.0 * o.error_left / nominal,
            o.deviation_most,
            o.deviation_left,
        );
    }
}

#[test]
fn a_fault_is_flagged_forgotten_and_never_becomes_a_number_that_is_none() {
    let path = root().join("tests/machines/campaign.toml");
    let description = Description::load(&path).unwrap();
    let sensors = Sensors::choose(&description, None).unwrap();
    let image = image_build::image(&description, &sensors).unwrap();
    let machine = Machine {
        channels: sensors.channels.len(),
        encoders: sensors.encoders.len(),
        eighth: 512,
        counter_mask: 0xFFFF,
        ends: [-(1 << 23), (1 << 23) - 1],
    };
    let samples = simulated::samples(&description, &sensors, "constant", SAMPLES / 1000.0);
    let line = Estimator::try_build(Image::from_bytes(&image).unwrap()).unwrap();
    let started = Instant::now();
    let host = campaign::run(&line, &machine, &samples, SETTLE);
    println!("host: {:.1} s", started.elapsed().as_secs_f64());
    print(&host, 1000.0);

    let runs: u32 = host.outcomes.iter().map(|outcome| outcome.runs).sum();
    println!("{runs} runs, digest {:016x}", host.digest);
    assert!(runs >= RUNS, "{runs} runs");
    for o in &host.outcomes {
        assert!(o.runs >= 40, "{o:?}");
        assert_eq!((o.not_finite, o.latched), (0, 0), "{o:?}");
        // No fault moves a load further than its own uncertainty allows for.
        assert!(o.deviation_most < 3.0, "{o:?}");
        // One count is the encoder's resolution: no single reading distinguishes it from a true one.
        if !matches!(o.kind, Kind::Glitch(1) | Kind::LostCounts(1)) {
            assert_eq!(o.flagged, o.runs, "{o:?}");
            assert!(o.latency_most <= 5, "{o:?}");
        }
        // Nothing is lost where a sample comes twice, and an index is no reading.
        if !matches!(
            o.kind,
            Kind::Repeated | Kind::IndexMissing | Kind::IndexDouble
        ) {
            assert_eq!(o.grown, o.flagged, "{o:?}");
        }
    }

    let words: Vec<u8> = samples
        .iter()
        .flat_map(|sample| postcard::to_allocvec(sample).unwrap())
        .collect();
    let started = Instant::now();
    let board = on_board(&image, &machine, &words);
    println!("board: {:.1} s", started.elapsed().as_secs_f64());
    assert_eq!(board, host);
}
