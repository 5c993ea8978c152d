//! Compares three methods on one recording with known loads, sample by sample: loadtwin's own
//! filter ("joint filter"), and regression and cascade of Kerst et al. 2019. Gives the RMSE of Fx,
//! Fz, Mx and Mz in % of range after a low-pass of 4 Hz, over all samples and away from reversals
//! of Mx. `PUBLISHED` holds the paper's figures for the two (tables III to V).

use loadtwin_common::bearing::{GAUGES, LOADS};
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::signal::butterworth::{Butterworth, ButterworthState};
use serde::Serialize;

use crate::bearing::Calibration;
use crate::bearing::baseline::cascade::Cascade;
use crate::bearing::baseline::regression::RegressionRun;
use crate::bearing::baseline::{ESTIMATED, Loads, OUT};
use crate::error::BuildError;
use loadtwin_machine::{Bearing, Machine};

/// What is compared.
pub const METHODS: [&str; 3] = ["regression", "cascade", "joint filter"];

/// The paper's figures for the regression and the cascade [% of the range], `Fx, Fz, Mx, Mz`:
/// load case 1; load case 2, stable domain only; load case 3.
///
/// Source: Kerst et al. 2019, tables III to V.
pub const PUBLISHED: [(&str, [[f64; OUT]; 2]); 3] = [
    ("lc1", [[8.8, 8.5, 10.4, 4.9], [6.3, 5.2, 2.3, 10.7]]),
    ("lc2 stable", [[3.3, 3.2, 5.5, 7.0], [7.9, 3.2, 2.4, 3.6]]),
    ("lc3", [[11.9, 10.6, 12.7, 6.8], [6.9, 7.3, 2.8, 5.7]]),
];

/// Cut-off of the low-pass over results [Hz], that of the paper for the rig.
///
/// Source: Kerst et al. 2019, section VI-C.
const RESULT_HZ: f32 = 4.0;
/// Over-turning moment from which on the domain is stable, in ranges: below, the rows hand over.
const STABLE: f64 = 0.1;
/// Place of the over-turning moment among the estimated loads.
const MX: usize = 2;

/// Root mean square errors of one load [% of its range].
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Rmse {
    /// Over the whole domain.
    pub whole: Option<f64>,
    /// Away from reversals of the over-turning moment.
    pub stable: Option<f64>,
}

/// All three on one recording.
pub struct Comparison {
    regression: RegressionRun,
    cascade: Cascade,
    ranges: [f64; LOADS],
    low_pass: Butterworth,
    states: [[ButterworthState; OUT]; METHODS.len()],
    /// Squares of the errors, whole and stable.
    squares: [[[f64; OUT]; 2]; METHODS.len()],
    counts: [f64; 2],
    compared: bool,
}

impl Comparison {
    /// Nothing compared yet; none where the calibration holds nothing to compare with.
    ///
    /// # Errors
    /// When the description does not make a model.
    pub fn try_new(
        machine: &Machine,
        bearing: &Bearing,
        calibration: &Calibration,
    ) -> Result<Option<Self>, BuildError> {
        let Some(baseline) = &calibration.baseline else {
            return Ok(None);
        };
        let dt_s = (1.0 / machine.rate_hz) as f32;
        Ok(Some(Self {
            regression: RegressionRun::try_new(&baseline.regression, machine.rate_hz)?,
            cascade: Cascade::try_new(machine, bearing, &baseline.strain)?,
            ranges: bearing.range.all().map(|[from, to]| to - from),
            low_pass: Butterworth::try_new(RESULT_HZ, dt_s).map_err(BuildError::Model)?,
            states: Default::default(),
            squares: Default::default(),
            counts: [0.0; 2],
            compared: false,
        }))
    }

    /// Adds one sample: the joint filter's estimate, its readings, and the loads as they are
    /// [N, N m].
    ///
    /// Errors are compared where all three give loads.
    pub fn push(&mut self, estimate: &Estimate, loads: &[f64; LOADS]) {
        let truth = Loads::from(ESTIMATED.map(|l| loads[l] / self.ranges[l]));
        let strain: [f64; GAUGES] = std::array::from_fn(|g| {
            1e6 * estimate
                .sensors
                .get(g)
                .map_or(0.0, |s| f64::from(s.measured))
        });
        let regression = self.regression.step(&strain, &truth);
        let cascade = self
            .cascade
            .step(&strain, f64::from(estimate.angle_rad), loads);
        let valid = estimate.loads.iter().all(|load| load.fault.is_none());
        let joint = valid.then(|| {
            let share = |l: usize| {
                estimate
                    .loads
                    .get(l)
                    .map_or(f64::NAN, |e| f64::from(e.value) / self.ranges[l])
            };
            Loads::from(ESTIMATED.map(share))
        });
        let (Some(regression), Some(cascade), Some(joint), true) = (
            regression,
            cascade,
            joint,
            truth.iter().all(|load| load.is_finite()),
        ) else {
            self.compared = false;
            return;
        };
        let stable = truth[MX].abs() > STABLE;
        self.counts[0] += 1.0;
        self.counts[1] += f64::from(stable);
        for (m, loads) in [regression, cascade, joint].iter().enumerate() {
            for l in 0..OUT {
                let error = (loads[l] - truth[l]) as f32;
                if !self.compared {
                    self.states[m][l] = ButterworthState::settled(error);
                }
                let square =
                    f64::from(self.low_pass.step(&mut self.states[m][l], error).low).powi(2);
                self.squares[m][0][l] += square;
                self.squares[m][1][l] += if stable { square } else { 0.0 };
            }
        }
        self.compared = true;
    }

    /// Errors of each of [`METHODS`], `Fx, Fz, Mx, Mz`.
    pub fn rmse(&self) -> [[Rmse; OUT]; METHODS.len()] {
        self.squares.map(|[whole, stable]| {
            let percent =
                |square: f64, count: f64| (count > 0.0).then(|| 100.0 * (square / count).sqrt());
            std::array::from_fn(|l| Rmse {
                whole: percent(whole[l], self.counts[0]),
                stable: percent(stable[l], self.counts[1]),
            })
        })
    }
}
