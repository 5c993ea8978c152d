//! Fits the two algorithms of Kerst et al. 2019 to a rig recording (`Baseline`), to compare
//! loadtwin's own filter ("joint filter") with them: the strain models of the cascade, and the
//! regression of the loads on the bulk strain. The submodules run them and compare the results.

mod baseline_comparison;
mod cascade;
mod load_model;
mod regression;
mod strain_model;

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

pub use crate::bearing::baseline::baseline_comparison::{Comparison, METHODS, PUBLISHED, Rmse};
pub use crate::bearing::baseline::regression::Regression;
pub use crate::bearing::baseline::strain_model::StrainModel;

use crate::bearing::phase_tracking::CalibrationBlock;
use crate::bearing::rig_calibration::{Rig, RigSample};
use crate::error::BuildError;

/// Loads that the paper's algorithms estimate, as places among all five: the axial force is
/// not among them.
pub const ESTIMATED: [usize; OUT] = [0, 2, 3, 4];
/// Their number.
pub const OUT: usize = 4;
/// Those loads, in ranges of the description.
type Loads = SVector<f64, OUT>;

/// What the paper's algorithms need of a calibration.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baseline {
    /// The reference algorithm.
    pub regression: Regression,
    /// Response of each gauge to its contacts in the cascade.
    pub strain: Vec<StrainModel>,
}

impl Baseline {
    /// Fits both to a recording on the rig; `known`: its blocks with their phases.
    ///
    /// # Errors
    /// When the description makes no geometry.
    pub(crate) fn fit(
        rig: &Rig<'_>,
        samples: &[RigSample],
        known: &[CalibrationBlock],
    ) -> Result<Self, BuildError> {
        Ok(Self {
            regression: Regression::fit(rig, samples)?,
            strain: strain_model::fit(rig, known)?,
        })
    }
}
