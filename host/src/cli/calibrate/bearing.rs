//! The part of `loadtwin calibrate` for bearings: fits contact stiffness, preload, contact angle,
//! row coupling and gauges to one recording on a rig, prints them, and writes the calibration file
//! and a page.

use std::time::Instant;

use serde_json::{Value, json};

use super::Calibrate;
use crate::atomic_file::{AtomicFile, publish};
use crate::bearing::{CALIBRATION, Calibration, Rig, RigSample};
use crate::cli::printing::{say, shown, shown_all};
use crate::cli::progress::Progress;
use crate::machine::BEARING_LOADS;
use crate::origin::with_origin;
use crate::replay::recorded;
use crate::report::{Axis, Data, MinMaxDecimator, Plot, Report, Role, Section, Series, Table};

/// Rows of the plots over time.
const ROWS: usize = 2048;

/// Fits a bearing to a recording on a rig; `--output` gets the calibration.
pub(super) fn run(rig: &Rig<'_>, options: &Calibrate, as_json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let [recording] = options.recordings.as_slice() else {
        anyhow::bail!(
            "a bearing is calibrated from one recording; found {}",
            options.recordings.len()
        );
    };
    let samples = recorded(rig.machine, rig.sensors, recording)?;
    let progress = Progress::new("calibrate");
    let calibration = crate::bearing::calibrate(rig, &samples, |part| progress.show(part))?;
    drop(progress);
    let mut files = Vec::new();
    if let Some(output) = &options.output {
        let text = toml::to_string(&calibration)?;
        files.push(AtomicFile::marked(output, &CALIBRATION, &text)?.complete()?);
    }
    if let Some(path) = &options.report {
        let page = page(rig, &calibration, &samples, &shown(recording));
        files.push(with_origin(page, Some(&rig.machine.path)).complete(path)?);
    }
    publish(files)?;
    let seconds = started.elapsed().as_secs_f64();
    if as_json {
        let gauges: Vec<Value> = (calibration.gauge.iter())
            .map(|g| json!({ "name": g.name, "resting_error": g.resting_error, "model_error": g.model_error, "bulk_error": g.bulk_error }))
            .collect();
        say!(
            "{}",
            json!({
                "machine": rig.machine.name, "recordings": shown_all(&options.recordings), "samples": samples.len(),
                "physical": calibration.physical, "physical_std": calibration.physical_std,
                "gauges": gauges,
                "calibration_out": options.output.as_ref().map(shown), "seconds": seconds,
            })
        );
    } else {
        for (name, [value, std]) in physical(&calibration) {
            say!("{name:<20} {value:+.3} +- {std:.3} against the description");
        }
        for gauge in &calibration.gauge {
            say!(
                "{:<20} error: local {:.2} um/m and {:.0} %, bulk {:.2} um/m",
                gauge.name,
                gauge.resting_error,
                100.0 * gauge.model_error,
                gauge.bulk_error
            );
        }
        say!("{} samples, {seconds:.1} s", samples.len());
    }
    Ok(())
}

/// Difference of the bearing from its description, with the standard deviation: the contact angle
/// in degrees, the others relative.
fn physical(calibration: &Calibration) -> [(&'static str, [f64; 2]); 4] {
    let (found, std) = (calibration.physical, calibration.physical_std);
    [
        ("contact stiffness", [found.stiffness, std.stiffness]),
        ("preload", [found.preload, std.preload]),
        (
            "contact angle [deg]",
            [found.contact_angle_deg, std.contact_angle_deg],
        ),
        ("row coupling", [found.row_coupling, std.row_coupling]),
    ]
}

/// Bearing and gauges as fitted, and the recording that they were fitted to.
fn page(
    rig: &Rig<'_>,
    calibration: &Calibration,
    samples: &[RigSample],
    recording: &str,
) -> Report {
    let machine = rig.machine;
    let mut time = MinMaxDecimator::new(BEARING_LOADS.len(), ROWS);
    for (i, (_, loads)) in samples.iter().enumerate() {
        time.push(i as f64 / machine.rate_hz, loads);
    }
    let load = |k: usize, name: &str| Plot {
        title: name.to_owned(),
        y: if name.starts_with('M') {
            Axis::new("Moment", "Nm")
        } else {
            Axis::new("Force", "N")
        },
        data: Data::Time(vec![(Series::line("reference", Role::Reference), k)]),
        ..Plot::default()
    };
    Report {
        title: format!("Calibration of {}", machine.name),
        facts: vec![
            ["Recording".into(), recording.into()],
            [
                "Samples".into(),
                format!("{} at {} Hz", samples.len(), machine.rate_hz),
            ],
        ],
        tables: vec![
            physical_table(calibration),
            gauge_table(calibration),
            load_table(calibration),
        ],
        sections: vec![Section {
            title: "Loads of the rig".into(),
            note: "What was applied; loads that do not vary are not calibrated.".into(),
            open: true,
            tables: Vec::new(),
            plots: (BEARING_LOADS.iter().enumerate())
                .map(|(k, name)| load(k, name))
                .collect(),
        }],
        time: Some(time),
        ..Report::default()
    }
}

fn physical_table(calibration: &Calibration) -> Table {
    let rows = physical(calibration).map(|(name, [value, std])| {
        vec![name.to_owned(), format!("{value:+.3}"), format!("{std:.3}")]
    });
    Table {
        caption: "Bearing against its description, relative where no unit is given".into(),
        head: ["", "difference", "standard deviation"]
            .map(String::from)
            .to_vec(),
        rows: rows.to_vec(),
    }
}

fn gauge_table(calibration: &Calibration) -> Table {
    let rows = calibration.gauge.iter().map(|gauge| {
        vec![
            gauge.name.clone(),
            format!("{:.2}", gauge.noise_std),
            format!("{:.2}", gauge.resting_error),
            format!("{:.0}", 100.0 * gauge.model_error),
            format!("{:.2}", gauge.bulk_error),
            format!("{:.2}", gauge.offset),
        ]
    });
    Table {
        caption: "Gauges: noise, and error of the model of local and bulk strain".into(),
        head: [
            "Gauge",
            "noise of a sample [µm/m]",
            "local, at rest [µm/m]",
            "local [% of the strain]",
            "bulk [µm/m]",
            "offset of bulk [µm/m]",
        ]
        .map(String::from)
        .to_vec(),
        rows: rows.collect(),
    }
}

fn load_table(calibration: &Calibration) -> Table {
    let rows = calibration.gauge.iter().map(|gauge| {
        let cells = gauge.bulk_load.iter().zip(gauge.bulk_load_std);
        std::iter::once(gauge.name.clone())
            .chain(cells.map(|(value, std)| format!("{value:.2} ± {std:.2}")))
            .collect()
    });
    Table {
        caption: "Bulk strain of the gauges by load [µm/m per kN], ± standard deviation; R is the groove's radius"
            .into(),
        head: ["Gauge", "Fx", "Fy", "Fz", "Mx / R", "Mz / R"]
            .map(String::from)
            .to_vec(),
        rows: rows.collect(),
    }
}
