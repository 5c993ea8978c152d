//! Defines the TOML file that `loadtwin calibrate` writes for a bearing (`Calibration`): strain
//! response of each gauge, physical parameters, mean and covariance of the loads, coefficients of
//! the baselines. Reads it, and gives the initial guess before a fit.

use std::path::Path;

use loadtwin_common::bearing::{FEATURES, HARMONICS, LOADS, ROWS};
use serde::{Deserialize, Serialize};

use crate::bearing::baseline::Baseline;
use crate::bearing::design_matrix::{COEFFICIENTS, DRIFT_TERMS};
use crate::bearing::physical_parameters::PhysicalParameters;
use loadtwin_files::file_kind::FileKind;
use loadtwin_files::{bounded, mark};
use loadtwin_machine::MachineError;

/// Coefficients of a gauge's local strain by row, harmonic and feature: real and imaginary part.
pub type Local = [[[[f64; 2]; FEATURES]; HARMONICS]; ROWS];

/// Coefficients fitted to recordings with known loads.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Mean of the loads on the rig: forces (N), moments [N m].
    pub load_mean: [f64; LOADS],
    /// Their covariance.
    pub load_covariance: [[f64; LOADS]; LOADS],
    /// Part by which each cage goes faster on the rig than predicted from its contacts: by sizes that
    /// differ from the description, and by slip that the bearing always has.
    #[serde(default)]
    pub cage_slip: [f64; ROWS],
    /// The bearing against its description.
    pub physical: PhysicalParameters,
    /// Its standard deviation.
    pub physical_std: PhysicalParameters,
    /// Each gauge, in the order of the description.
    pub gauge: Vec<GaugeResponse>,
    /// What the algorithms need that the filter is compared with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baseline: Option<Baseline>,
}

/// Response of one gauge [um/m / kN], moments over the groove's radius.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaugeResponse {
    /// Name of the gauge.
    pub name: String,
    /// Standard deviation of a sample [um/m].
    pub noise_std: f64,
    /// Error of the local strain's model where there is no strain [um/m].
    pub resting_error: f64,
    /// Error of the local strain's model, as part of the strain.
    pub model_error: f64,
    /// Standard deviation of the bulk strain about the model [um/m].
    pub bulk_error: f64,
    /// Bulk strain at no load when calibrated [um/m].
    pub offset: f64,
    /// Bulk strain by `Fx, Fy, Fz, Mx / R, Mz / R`.
    pub bulk_load: [f64; LOADS],
    /// Its standard deviation.
    pub bulk_load_std: [f64; LOADS],
    /// Bulk strain by the features of each row.
    pub bulk_feature: [[f64; FEATURES]; ROWS],
    /// Its standard deviation.
    pub bulk_feature_std: [[f64; FEATURES]; ROWS],
    /// Local strain.
    pub local: Local,
    /// Its standard deviation.
    pub local_std: Local,
}

impl GaugeResponse {
    /// Its coefficients in the order of [`crate::bearing::design_matrix::rows`], without drift.
    pub(crate) fn coefficients(&self) -> [f64; COEFFICIENTS] {
        let mut all = [0.0; COEFFICIENTS];
        all[0] = self.offset;
        let bulk = (self.bulk_load.iter()).chain(self.bulk_feature.iter().flatten());
        let local = self.local.iter().flatten().flatten().flatten();
        for (slot, value) in all[DRIFT_TERMS..].iter_mut().zip(bulk.chain(local)) {
            *slot = *value;
        }
        all
    }
}

/// What is written as the calibration of a bearing.
pub const CALIBRATION: FileKind = FileKind {
    noun: "calibration",
    suffixes: &["toml"],
    is_same: |file| {
        Ok(mark::is_intact(
            CALIBRATION.noun,
            &file.whole(bounded::DESCRIPTION)?,
        ))
    },
};

impl Calibration {
    /// Initial values before a bearing was calibrated: local strain in phase
    /// with the balls, no bulk strain.
    pub fn guess(gauges: usize) -> Self {
        let mut local = Local::default();
        for row in &mut local {
            row[0][0][0] = GUESS;
        }
        Self {
            load_mean: [0.0; LOADS],
            load_covariance: [[0.0; LOADS]; LOADS],
            cage_slip: [0.0; ROWS],
            physical: PhysicalParameters::default(),
            physical_std: PhysicalParameters::default(),
            gauge: vec![
                GaugeResponse {
                    noise_std: 5.0,
                    local,
                    ..GaugeResponse::default()
                };
                gauges
            ],
            baseline: None,
        }
    }

    /// Reads the file in `path`.
    ///
    /// # Errors
    /// When it cannot be read or is none.
    pub fn read(path: &Path, gauges: usize) -> Result<Self, MachineError> {
        let text = loadtwin_machine::read_description(path)?;
        let read: Self =
            toml::from_str(&text).map_err(|error| MachineError::syntax(path, &text, &error))?;
        if read.gauge.len() != gauges {
            return Err(MachineError::violation(
                path,
                &text,
                loadtwin_machine::Violation {
                    field: "gauge".into(),
                    found: format!("{} tables", read.gauge.len()),
                    allowed: format!("{gauges}, one for each gauge of the machine"),
                },
            ));
        }
        Ok(read)
    }
}

/// Amplitude of the first harmonic by a ball's load that is assumed [um/m / kN].
const GUESS: f64 = 12.0;
