//! Reproduces tables 2 and 3 of Bosmans et al. 2023 on simulated gearboxes (`Individual`):
//! simulates one, calibrates its gauges, tunes the noise for each row, and evaluates the NMAE (%)
//! of the first load on another recording (`Cell`).
//!
//! Each individual has its own parameters, gauge positions, offsets and drift.
//! It is calibrated and tuned on a recording with torque ramps and one at
//! constant torque, and evaluated on a start-stop cycle with other noise, which
//! nothing was fitted to.

mod noise_sweep;
mod published;
mod report_page;

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use thiserror::Error;

use crate::calibrate::{
    CalibrateError, MapSource, Observations, calibrate, calibrated, with_noise,
};
use crate::image_build::Sensors;
use crate::machine::{Drift, Machine};
use crate::recording::RecordingError;
use crate::replay::{self, Figures, ReplayError};
use crate::simulate::{Applied, Scenario, SimulateError, Simulation};
use crate::tune::{Training, TuneError, measure_noise, tune_loads};

pub use noise_sweep::{Curve, Point, curve};
pub use published::{OTHERS, Published, TABLE_2, TABLE_3};
pub use report_page::page;

/// How far a gauge may sit from its described angle (rad).
const PATCH_RAD: f64 = 0.1;

/// Drift of a gauge where it has a state (m/m): what section 6.2 reports of the high-speed housing.
const DRIFT_STD: f64 = 5e-6;

/// Its time constant (s).
const DRIFT_TIME_S: f64 = 60.0;

/// The segments of a cell, the whole first.
pub const SEGMENTS: [&str; 4] = ["full", "ramp_up", "dwell", "ramp_down"];

/// NMAE (% of nominal) in each of [`SEGMENTS`].
pub type Nmae = [f64; 4];

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
    /// NMAE of the first load (% of nominal); NaN for a segment that the machine does not name.
    pub nmae: Nmae,
    /// `log10 Qd` of each load.
    pub log10_qd: Vec<f64>,
}

/// One simulated machine, calibrated, with the recordings for its tuning and evaluation.
pub struct Individual {
    machine: Machine,
    fitted_to: [PathBuf; 2],
    evaluated_on: PathBuf,
    /// Holds the recordings and the maps.
    _folder: crate::files::scratch::Scratch,
}

impl Individual {
    /// Simulates individual `number` of `machine` with `effects` and calibrates its description.
    ///
    /// # Errors
    /// When the machine lacks what simulation or calibration needs.
    pub fn new(machine: &Machine, number: u64, effects: &[Applied]) -> Result<Self, TablesError> {
        let folder = crate::files::scratch::Scratch::new()?;
        let record = |scenario: &str, seed: u64| {
            let path = folder.path().join(format!("{scenario}.parquet"));
            let scenario = Scenario::by_name(scenario)?;
            // No two recordings share their noise.
            let seed = 1000 * number + seed;
            Simulation::new(machine, &scenario, seed, Some(number), effects)?
                .write(&path, |_| ())?;
            Ok::<_, TablesError>(path)
        };
        let fitted_to = [record("constant", 1)?, record("torque-ramps", 2)?];
        let evaluated_on = record("start-stop", 3)?;
        let observations = Observations::read(machine, &fitted_to, |_| ())?;
        let source = MapSource::Placed;
        let gauges = calibrate(machine, &observations, &fitted_to[0], PATCH_RAD, source)?;
        let machine = calibrated(machine, &gauges, source, folder.path())?;
        let noise = measure_noise(&machine, &fitted_to[0], 1.0, |_| ())?;
        let noise = noise.iter().map(|(i, noise)| (*i, noise));
        let machine = with_noise(&machine, noise, folder.path())?;
        Ok(Self {
            machine,
            fitted_to,
            evaluated_on,
            _folder: folder,
        })
    }

    /// Tunes and evaluates it: a cell for each of `rows`, in their order. Calls `each` after each
    /// of them.
    ///
    /// # Errors
    /// When the machine lacks a set of sensors.
    pub fn evaluate(
        &self,
        rows: &[Published],
        each: impl Fn() + Sync,
    ) -> Result<Vec<Cell>, TablesError> {
        rows.par_iter()
            .map(|row| {
                let mut sensors = self.sensors(row.sensors)?;
                for channel in sensors.channels.iter_mut().filter(|_| row.drift) {
                    channel.drift = Some(Drift {
                        std: channel.unit.from_si(DRIFT_STD),
                        time_s: DRIFT_TIME_S,
                    });
                }
                let methods = [row.method];
                let (machine, recordings) = (&self.machine, &self.fitted_to);
                let tuned = tune_loads(
                    machine,
                    &sensors,
                    Training::whole(recordings),
                    row.cutoff_hz,
                    &methods,
                    |_| (),
                )?;
                let noise = &tuned.methods[0].1;
                let nmae = self.nmae(sensors, &noise.walk)?;
                each();
                Ok(Cell {
                    nmae,
                    log10_qd: noise.log10_qd.clone(),
                })
            })
            .collect()
    }

    fn sensors(&self, set: &str) -> Result<Sensors, TablesError> {
        Ok(Sensors::choose(&self.machine, Some(set)).map_err(ReplayError::from)?)
    }

    /// NMAE with random walks of the loads of `walk` (N m/sqrt(s)).
    fn nmae(&self, mut sensors: Sensors, walk: &[f64]) -> Result<Nmae, TablesError> {
        let loads = self.machine.drivetrain.iter().flat_map(|d| &d.loads);
        let names = loads.map(|load| load.name.clone());
        sensors.walks = names.zip(walk.iter().copied()).collect();
        nmae(&self.machine, &sensors, &self.evaluated_on)
    }
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

/// Mean `log10 Qd` of each load over individuals.
pub fn mean_qd(cells: &[&Cell]) -> Vec<f64> {
    let loads = cells.first().map_or(0, |cell| cell.log10_qd.len());
    (0..loads)
        .map(|j| statistics(cells.iter().map(|cell| cell.log10_qd[j])).0)
        .collect()
}
