//! Report page of `loadtwin replay` in a real browser: every plot draws, cursors measure,
//! nothing is fetched.

use loadtwin::metrics::{LoadError, Segment};
use loadtwin::report::{KeyFigure, LoadLabel, ReplayPlots, Report, SensorLabel, Table};
use loadtwin_common::io::estimate::{Estimate, LoadEstimate, SensorEstimate};
use loadtwin_common::io::fault::Fault;
use std::path::{Path, PathBuf};
use std::process::Command;

const RATE_HZ: f64 = 500.0;
const SAMPLES: u32 = 45_000;
const GAUGES: usize = 5;
const NOMINAL_NM: f64 = 450_000.0;

/// Torque of a start-stop cycle [N m]: 20 s up, dwell to 60 s, down with a spike below zero at 71 s.
fn torque(t: f64) -> f64 {
    let level = (t / 20.0).min(1.0).min((80.0 - t) / 20.0).max(0.0);
    let spike = -0.35 * (-((t - 71.0) / 0.4).powi(2)).exp();
    NOMINAL_NM * (level + spike + 0.01 * (t * 9.0).sin() * level)
}

/// White noise, nearly normal.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let sum: f64 = (0..12)
            .map(|_| {
                self.0 = self
                    .0
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                (self.0 >> 11) as f64 / (1_u64 << 53) as f64
            })
            .sum();
        sum - 6.0
    }
}

/// A replay of 90 s: one load, five gauges of which one drops out for a while.
fn replay() -> (ReplayPlots, LoadError) {
    let mut noise = Noise(7);
    let load = LoadLabel {
        name: "Main shaft".into(),
        quantity: "Torque".into(),
        unit: "Nm".into(),
    };
    let gauge = |g: usize| SensorLabel {
        name: format!("Torque arm {}", g + 1),
        quantity: "Strain".into(),
        unit: "µm/m".into(),
        factor: 1e6,
        over_angle: true,
    };
    let mut plots = ReplayPlots::new(vec![load], (0..GAUGES).map(gauge).collect(), RATE_HZ);
    let segment = |name: &str, from_s, to_s| Segment {
        name: name.into(),
        from_s,
        to_s,
    };
    let mut error = LoadError::new(vec![
        segment("ramp up", 0.0, 20.0),
        segment("dwell", 20.0, 60.0),
        segment("ramp down", 60.0, f64::INFINITY),
    ]);
    let (mut lag, mut angle, mut wander) = (0.0, 0.0, 0.0);
    for i in 0..SAMPLES {
        let t = f64::from(i) / RATE_HZ;
        let reference = torque(t);
        lag += 0.02 * (reference - lag);
        wander = 0.995 * wander + 600.0 * noise.next();
        let value = lag * 1.02 + wander;
        error.push(t, value, reference);
        angle += 1.9 / RATE_HZ * (reference / NOMINAL_NM).max(0.0);
        let sensor = |g: usize| {
            let phase = 3.0 * angle + 0.7 * g as f64;
            let predicted = (60.0 + 45.0 * phase.cos().powi(3)) * value / NOMINAL_NM;
            // One gauge sits elsewhere than the model says.
            let normalised = noise.next() + if g == 1 { 0.4 * phase.sin() } else { 0.0 };
            let lost = g == 3 && (40.0..43.0).contains(&t);
            SensorEstimate {
                measured: ((predicted + 1.5 * normalised) * 1e-6) as f32,
                innovation: (1.5e-6 * normalised) as f32,
                innovation_variance: 1.5e-6 * 1.5e-6,
                nis: (normalised * normalised) as f32,
                fault: if lost { Fault::Missing } else { Fault::None },
            }
        };
        let estimate = Estimate {
            sensors: (0..GAUGES).map(sensor).collect(),
            loads: std::iter::once(LoadEstimate {
                value: value as f32,
                std: (0.015 * NOMINAL_NM * (1.0 + 4.0 * (-t).exp())) as f32,
                fault: if (50.0..52.0).contains(&t) {
                    Fault::NotValid
                } else {
                    Fault::None
                },
                ..LoadEstimate::default()
            })
            .collect(),
            angle_rad: angle as f32,
            homed: t > 1.0,
            ..Estimate::default()
        };
        plots.push(t, &[reference], &estimate);
    }
    (plots, error)
}

/// The report on it.
fn sample() -> Report {
    let (plots, error) = replay();
    let percent = |value: Option<f64>| value.map_or("–".into(), |v| format!("{v:.2}"));
    let mut cells = vec![
        "Main shaft".into(),
        percent(error.full().nmae_percent(NOMINAL_NM)),
    ];
    cells.extend(
        error
            .segments()
            .map(|(_, e)| percent(e.nmae_percent(NOMINAL_NM))),
    );
    cells.push(format!("{:.1}", error.full().rmse().unwrap() / 1e3));
    let figure = |label: &str, value, note: &str| KeyFigure {
        label: label.into(),
        value,
        note: note.into(),
    };
    let key_figures = vec![
        figure(
            "NMAE, main shaft",
            format!("{} %", cells[1]),
            "of 450 kNm nominal",
        ),
        figure(
            "Mean NIS",
            percent(plots.nis().mean()),
            &format!("{} expected", percent(plots.nis().expected())),
        ),
        figure("Samples", SAMPLES.to_string(), "90 s at 500 Hz"),
    ];
    let (time, every_sample, sections) = plots.finish();
    Report {
        title: "Gearbox on the test bench <850 kW>".into(),
        facts: [
            ("Machine", "gearbox.toml"),
            ("Recording", "start-stop.csv"),
            ("Filter", "AEKF, 6 states, 5 gauges, 1 encoder"),
            ("Rate", "500 Hz"),
        ]
        .map(|(label, value)| [label.into(), value.into()])
        .to_vec(),
        key_figures,
        tables: vec![Table {
            caption: "Error against the reference, NMAE".into(),
            head: [
                "Load",
                "Full [%]",
                "Ramp up [%]",
                "Dwell [%]",
                "Ramp down [%]",
                "RMSE [kNm]",
            ]
            .map(Into::into)
            .to_vec(),
            rows: vec![cells],
        }],
        time: Some(time),
        samples: Some(every_sample),
        sections,
    }
}

fn chromium() -> &'static str {
    ["chromium", "chromium-browser", "google-chrome"]
        .into_iter()
        .find(|name| Command::new(name).arg("--version").output().is_ok())
        .expect("chromium not found: `apt-get install chromium` (the report is tested in a real browser)")
}

/// The page as the browser leaves it.
fn dom(page: &Path, fragment: &str) -> String {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(chromium())
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--no-first-run",
        ])
        .args([
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
        ])
        .args([
            "--window-size=1500,1000",
            "--virtual-time-budget=20000",
            "--dump-dom",
        ])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("file://{}#{fragment}", page.display()))
        .output()
        .unwrap();
    String::from_utf8(output.stdout).unwrap()
}

fn write_sample(name: &str) -> PathBuf {
    // Stays after the test, to be looked at.
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    sample().write(&path).unwrap();
    path
}

fn selftest(dom: &str) -> serde_json::Value {
    let start = dom
        .find("<pre id=\"selftest\">")
        .expect("the page wrote no result");
    let text = &dom[start + 19..];
    let text = &text[..text.find("</pre>").unwrap()];
    let text = text
        .replace("&lt;", "<")
        .replace("&gt;", ">")
        .replace("&amp;", "&");
    serde_json::from_str(&text).unwrap()
}

#[test]
fn every_plot_draws_and_the_cursors_measure() {
    let path = write_sample("report.html");
    let size = std::fs::metadata(&path).unwrap().len();
    assert!(size < 8_000_000, "{size} bytes");

    let page = std::fs::read_to_string(&path).unwrap();
    for outside in [
        "src=",
        "href=",
        "url(",
        "@import",
        "fetch(",
        "XMLHttpRequest",
    ] {
        assert!(!page.contains(outside), "the page contains {outside}");
    }

    let result = selftest(&dom(&path, "selftest"));
    assert_eq!(result["errors"], serde_json::json!([]));
    assert_eq!(result["requests"], serde_json::json!([]));
    // Load, its error, NIS and the flags; then eight of each gauge.
    assert_eq!(result["plots"], 4 + 8 * GAUGES);
    assert_eq!(result["drawn"], result["plots"]);
    assert_eq!(result["blank"], serde_json::json!([]));

    // Cursors at a quarter and three quarters of 89.998 s, on the load plot.
    let cursors = &result["cursors"];
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let (t1, t2) = (number(&cursors["x1"]), number(&cursors["x2"]));
    assert!(
        (t1 - 22.5).abs() < 0.1 && (t2 - 67.5).abs() < 0.1,
        "{cursors}"
    );
    assert!((number(&cursors["dx"]) - (t2 - t1)).abs() < 1e-9);
    let reference = &cursors["series"][3];
    assert_eq!(reference["label"], "reference");
    for (key, t) in [("y1", t1), ("y2", t2)] {
        // A bucket is 22 ms; the torque moves by less than 1 % of nominal in that time.
        assert!(
            (number(&reference[key]) - torque(t)).abs() < 0.01 * NOMINAL_NM,
            "{reference}"
        );
    }
    let dy = number(&reference["y2"]) - number(&reference["y1"]);
    assert!((number(&reference["dy"]) - dy).abs() < 1e-6 && dy < -100_000.0);
    let readout = result["readout"].as_str().unwrap();
    assert!(
        readout.contains("Δt 44.99") && readout.contains("reference [kNm]"),
        "{readout}"
    );

    let handles: Vec<f64> = serde_json::from_value(result["handles"].clone()).unwrap();
    for (found, expected) in handles.iter().zip([0.25, 0.75]) {
        assert!((found - expected).abs() < 0.005, "{handles:?}");
    }

    // An arrow key steps to the next row: half a bucket.
    let step = number(&result["stepped"]) - t1;
    assert!(step > 0.0 && step < 0.05, "{step}");

    // A drag on one plot zooms all plots over time, one with Shift moves them, and all come back.
    let zoomed: [f64; 2] = serde_json::from_value(result["zoomed"].clone()).unwrap();
    assert!(
        (zoomed[0] - 22.5).abs() < 0.2 && (zoomed[1] - 45.0).abs() < 0.2,
        "{zoomed:?}"
    );
    let ranges = |key: &str| serde_json::from_value::<Vec<[f64; 2]>>(result[key].clone()).unwrap();
    assert_eq!(ranges("linked").len(), 4 + 2 * GAUGES);
    let moved = 0.1 * (zoomed[1] - zoomed[0]);
    for ([low, high], [all_low, all_high]) in ranges("linked").into_iter().zip(ranges("reset")) {
        assert!((low + moved - zoomed[0]).abs() < 0.05 && (high + moved - zoomed[1]).abs() < 0.05);
        assert!(
            all_low == 0.0 && (all_high - 89.998).abs() < 1e-9,
            "{all_low} {all_high}"
        );
    }
}

#[test]
fn plots_are_shaded_saved_and_printed() {
    let path = write_sample("saved.html");
    let result = selftest(&dom(&path, "selftest&theme=dark"));
    assert_eq!(result["errors"], serde_json::json!([]));
    let spans: Vec<[f64; 2]> = serde_json::from_value(result["spans"].clone()).unwrap();
    assert_eq!(spans.len(), 1, "{spans:?}");
    // To within a bucket of 22 ms.
    assert!((spans[0][0] - 50.0).abs() < 0.03 && (spans[0][1] - 52.0).abs() < 0.03);

    assert_eq!(result["unsaved"], serde_json::json!([]));
    let texts: Vec<String> = serde_json::from_value(result["svg"].clone()).unwrap();
    for text in [
        "Main shaft",
        "Time [s]",
        "Torque [kNm]",
        "reference",
        "± 2 σ",
        "400",
    ] {
        assert!(
            texts.iter().any(|found| found == text),
            "no {text} in {texts:?}"
        );
    }
    // Of each bucket from when to when, and the least and the greatest value.
    let names = ["estimate", "estimate + 2 σ", "estimate - 2 σ", "reference"];
    let ends = names.map(|name| format!("{name} [Nm] least,{name} [Nm] greatest"));
    assert_eq!(
        result["csv"][0],
        format!("Time [s] from,Time [s] to,{},not valid", ends.join(","))
    );
    let cells: Vec<f64> = (result["csv"][1].as_str().unwrap().split(','))
        .map(|cell| cell.parse().unwrap())
        .collect();
    assert_eq!((cells.len(), cells[0], cells[10]), (11, 0.0, 0.0));
    assert!(
        cells[1] > 0.01 && cells[2] <= cells[3] && cells[4] > cells[2],
        "{cells:?}"
    );
    let [width, height]: [f64; 2] = serde_json::from_value(result["png"].clone()).unwrap();
    assert!(width > 1000.0 && height > 300.0, "{width} {height}");

    // Of A4 without its margins, at 96 pixels an inch.
    let printed = &result["printed"];
    assert_eq!(
        (&printed["theme"], &printed["open"]),
        (&"light".into(), &true.into())
    );
    assert!(
        printed["widest"].as_f64().unwrap() < 186.0 / 25.4 * 96.0,
        "{printed}"
    );
}

/// A recording of no or one sample, a sensor that never answered, a constant: no script error.
#[test]
fn odd_signals_do_no_harm() {
    let directory = tempfile::tempdir().unwrap();
    for samples in [0, 1, 50] {
        let sensor = SensorLabel {
            name: "<b>&\"".into(),
            quantity: "</script>".into(),
            unit: "µm/m".into(),
            factor: 1e6,
            over_angle: true,
        };
        let load = LoadLabel {
            name: "constant".into(),
            quantity: "Torque".into(),
            unit: "Nm".into(),
        };
        let mut plots = ReplayPlots::new(vec![load], vec![sensor], 1.0);
        for i in 0..samples {
            let estimate = Estimate {
                loads: std::iter::once(LoadEstimate::default()).collect(),
                ..Estimate::default()
            };
            plots.push(f64::from(i), &[0.0], &estimate);
        }
        let (time, every_sample, sections) = plots.finish();
        let report = Report {
            time: Some(time),
            samples: Some(every_sample),
            sections,
            ..Report::default()
        };
        let path = directory.path().join("odd.html");
        report.write(&path).unwrap();
        let result = selftest(&dom(&path, "selftest"));
        assert_eq!(result["errors"], serde_json::json!([]), "{samples} samples");
        // The others say that they have no data; the normal distribution is there without a sample.
        let [plots, drawn, empty] =
            ["plots", "drawn", "empty"].map(|key| result[key].as_u64().unwrap());
        assert_eq!(plots - empty, drawn, "{samples} samples: {result}");
        assert!(drawn > 0 && empty > 0, "{samples} samples: {result}");
    }
}

/// These tests can fail: a page whose data is broken says so.
#[test]
fn a_broken_page_is_noticed() {
    let path = write_sample("broken.html");
    let page = std::fs::read_to_string(&path).unwrap();
    std::fs::write(
        &path,
        page.replacen("\"columns\":[\"", "\"columns\":[\"!", 1),
    )
    .unwrap();
    let result = selftest(&dom(&path, "selftest"));
    assert_ne!(result["errors"], serde_json::json!([]));
    assert_ne!(result["drawn"], result["plots"]);
}
