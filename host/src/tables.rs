//! `loadtwin tables`: the paper's tables 2 and 3 on simulated machines.
//!
//! Each individual has its own parameters, gauge positions, offsets and drift.
//! It is calibrated and tuned on a recording with torque ramps and one at
//! constant torque, and judged on a start-stop cycle with other noise, which
//! nothing was fitted to.

use std::path::Path;

use rayon::prelude::*;
use thiserror::Error;

use crate::build::Sensors;
use crate::calibrate::{
    CalibrateError, MapSource, Observations, calibrate, calibrated, with_noise,
};
use crate::machine::Machine;
use crate::recording::RecordingError;
use crate::replay::{self, Figures, ReplayError};
use crate::simulate::{Applied, Scenario, SimulateError, Simulation};
use crate::tune::{Method, TuneError, measure_noise, tune_loads};

/// How far a gauge may sit from its described angle [rad].
const PATCH_RAD: f64 = 0.1;

/// The segments of a cell, the whole first.
pub const SEGMENTS: [&str; 4] = ["full", "ramp_up", "dwell", "ramp_down"];

/// NMAE [%] in each of [`SEGMENTS`].
pub type Nmae = [f64; 4];

/// A row of a table in the paper.
#[derive(Clone, Copy, Debug)]
pub struct Published {
    /// Set of sensors of the shipped example.
    pub sensors: &'static str,
    /// What the loads' noise was tuned by.
    pub method: Method,
    /// Cut-off frequency [Hz].
    pub cutoff_hz: f64,
    /// `log10 Qd` of both loads, in table 3.
    pub log10_qd: Option<[f64; 2]>,
    /// What the paper found [%]; none for a way of tuning that it does not have.
    pub nmae: Option<Nmae>,
}

const fn table2(sensors: &'static str, nmae: Nmae) -> Published {
    Published {
        sensors,
        method: Method::Frf,
        cutoff_hz: 10.0,
        log10_qd: None,
        nmae: Some(nmae),
    }
}

const fn table3(
    sensors: &'static str,
    method: Method,
    cutoff_hz: f64,
    log10_qd: [f64; 2],
    nmae: Nmae,
) -> Published {
    Published {
        sensors,
        method,
        cutoff_hz,
        log10_qd: Some(log10_qd),
        nmae: Some(nmae),
    }
}

/// Bosmans et al. 2023, table 2.
pub const TABLE_2: [Published; 8] = [
    table2("torque-arm-1", [3.57, 3.80, 3.46, 3.57]),
    table2("torque-arm-3", [3.43, 3.43, 3.41, 3.49]),
    table2("torque-arm-5", [3.41, 3.99, 3.10, 3.45]),
    table2("ring-gear-1", [7.27, 5.77, 6.46, 11.46]),
    table2("ring-gear-3", [4.59, 4.65, 3.11, 8.47]),
    table2("ring-gear-5", [3.90, 3.92, 2.67, 7.15]),
    table2("high-speed-housing-1", [6.81, 8.70, 2.44, 15.96]),
    table2("high-speed-housing-3", [7.47, 6.92, 3.96, 17.56]),
];

/// Bosmans et al. 2023, table 3.
pub const TABLE_3: [Published; 12] = {
    const TA: &str = "torque-arm-3";
    const RG: &str = "ring-gear-3";
    const HSH: &str = "high-speed-housing-3";
    const F: Method = Method::Frf;
    const I: Method = Method::Innovation;
    [
        table3(TA, I, 10.0, [8.0, 4.0], [3.91, 3.71, 3.98, 4.01]),
        table3(TA, F, 1.0, [4.3, 0.8], [3.80, 5.36, 2.71, 4.62]),
        table3(TA, F, 10.0, [5.6, 2.3], [3.43, 3.43, 3.41, 3.49]),
        table3(TA, F, 100.0, [5.4, 5.1], [3.42, 3.44, 3.39, 3.46]),
        table3(RG, I, 10.0, [8.0, 6.0], [11.49, 8.94, 11.37, 15.19]),
        table3(RG, F, 1.0, [4.8, 1.1], [6.11, 8.19, 2.36, 13.35]),
        table3(RG, F, 10.0, [6.4, 2.5], [4.59, 4.65, 3.11, 8.47]),
        table3(RG, F, 100.0, [6.4, 5.3], [5.28, 4.87, 4.07, 9.05]),
        table3(HSH, I, 10.0, [8.0, 6.0], [9.93, 6.03, 7.51, 18.54]),
        table3(HSH, F, 1.0, [3.6, -0.6], [7.57, 7.07, 3.88, 18.08]),
        table3(HSH, F, 10.0, [5.1, 1.2], [7.47, 6.92, 3.96, 17.56]),
        table3(HSH, F, 100.0, [5.6, 2.5], [7.50, 6.92, 4.03, 17.55]),
    ]
};

/// Other ways of tuning, on the sets of table 3.
pub const OTHERS: [Published; 9] = {
    const fn row(sensors: &'static str, method: Method, cutoff_hz: f64) -> Published {
        Published {
            sensors,
            method,
            cutoff_hz,
            log10_qd: None,
            nmae: None,
        }
    }
    [
        row("torque-arm-3", Method::FrfPerBand, 1.0),
        row("torque-arm-3", Method::FrfPerBand, 10.0),
        row("torque-arm-3", Method::Likelihood, 10.0),
        row("ring-gear-3", Method::FrfPerBand, 1.0),
        row("ring-gear-3", Method::FrfPerBand, 10.0),
        row("ring-gear-3", Method::Likelihood, 10.0),
        row("high-speed-housing-3", Method::FrfPerBand, 1.0),
        row("high-speed-housing-3", Method::FrfPerBand, 10.0),
        row("high-speed-housing-3", Method::Likelihood, 10.0),
    ]
};

/// Why the tables cannot be made.
#[derive(Debug, Error)]
pub enum TablesError {
    /// The machine cannot be simulated.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// It cannot be calibrated.
    #[error(transparent)]
    Calibrate(#[from] CalibrateError),
    /// It cannot be tuned.
    #[error(transparent)]
    Tune(#[from] TuneError),
    /// It cannot be replayed.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// A recording cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// There is no room for the recordings.
    #[error("temporary folder: {0}")]
    Folder(#[from] std::io::Error),
}

/// What one individual gave in one row.
#[derive(Clone, Debug)]
pub struct Cell {
    /// NMAE of the first load [%]; NaN for a segment that the machine does not name.
    pub nmae: Nmae,
    /// `log10 Qd` of the loads.
    pub log10_qd: Vec<f64>,
}

/// Calibrates, tunes and judges individual number `individual` of `machine`,
/// with `effects`: a cell for each of `rows`, in their order.
///
/// # Errors
/// When the machine lacks a set of sensors or what calibration needs.
pub fn judge(
    machine: &Machine,
    individual: u64,
    effects: &[Applied],
    rows: &[Published],
) -> Result<Vec<Cell>, TablesError> {
    let folder = tempfile::tempdir()?;
    let record = |scenario: &str, seed: u64| {
        let path = folder.path().join(format!("{scenario}.parquet"));
        let scenario = Scenario::by_name(scenario)?;
        // No two recordings share their noise.
        let seed = 1000 * individual + seed;
        Simulation::new(machine, &scenario, seed, Some(individual), effects)?
            .write(&path, |_| ())?;
        Ok::<_, TablesError>(path)
    };
    let fitted_to = [record("constant", 1)?, record("torque-ramps", 2)?];
    let judged_on = record("start-stop", 3)?;
    let observations = Observations::read(machine, &fitted_to, |_| ())?;
    let source = MapSource::Placed;
    let gauges = calibrate(machine, &observations, &fitted_to[0], PATCH_RAD, source)?;
    let machine = calibrated(machine, &gauges, source, folder.path())?;
    let noise = measure_noise(&machine, &fitted_to[0], |_| ())?;
    let noise = noise.iter().map(|(i, noise)| (*i, noise));
    let machine = with_noise(&machine, noise, folder.path())?;
    rows.par_iter()
        .map(|row| {
            let mut sensors =
                Sensors::choose(&machine, Some(row.sensors)).map_err(ReplayError::from)?;
            let tuned = tune_loads(
                &machine,
                &sensors,
                &fitted_to,
                row.cutoff_hz,
                &[row.method],
                |_| (),
            )?;
            let noise = &tuned.methods[0].1;
            let loads = machine
                .drivetrain
                .iter()
                .flat_map(|d| &d.loads)
                .map(|l| l.name.clone());
            sensors.walks = loads.zip(noise.walk.iter().copied()).collect();
            Ok(Cell {
                nmae: nmae(&machine, &sensors, &judged_on)?,
                log10_qd: noise.log10_qd.clone(),
            })
        })
        .collect()
}

fn nmae(machine: &Machine, sensors: &Sensors, recording: &Path) -> Result<Nmae, TablesError> {
    let mut figures = Figures::new(machine);
    replay::run(machine, sensors, recording, |sample, estimate, _| {
        figures.push(sample, estimate);
    })?;
    let errors = figures
        .loads()
        .next()
        .map(|(_, load)| load.nmae_percent)
        .unwrap_or_default();
    Ok(SEGMENTS.map(|segment| errors.get(segment).copied().flatten().unwrap_or(f64::NAN)))
}

/// Mean and standard deviation over individuals.
pub fn statistics(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    let variance = values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean, variance.sqrt())
}
