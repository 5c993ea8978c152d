//! Fits and runs the regression of Kerst et al. 2019, eq. (20)-(21): four loads from the low-passed
//! (bulk) strains of the gauges, less a thermal offset, and their squares. The fit finds
//! coefficients and offset by least squares; the run sets the offset in the first 0.5 s, where the
//! loads must be given.

use loadtwin_common::bearing::GAUGES;
use loadtwin_common::signal::butterworth::{Butterworth, ButterworthState};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::bearing::baseline::{ESTIMATED, Loads, OUT};
use crate::bearing::rig_calibration::{Rig, RigSample};
use crate::error::BuildError;

/// Cut-off of the low-pass that extracts the bulk strain [Hz].
///
/// Source: Kerst et al. 2019, section V.
const CUTOFF_HZ: f32 = 10.0;
/// Entries of the deformation vector, eq. (21).
const ENTRIES: usize = 2 * GAUGES;
/// One sample on the rig in this many is used.
const THINNED: usize = 20;
/// Steps of Gauss and Newton towards an offset.
const STEPS: usize = 20;
/// Terms of the bulk strain by the loads: 1, each load, its square.
const TERMS: usize = 1 + 2 * OUT;
/// Time over which the offset is set [s].
const ZEROING_S: f64 = 0.5;

type Strain = SVector<f64, GAUGES>;
type Deformation = SVector<f64, ENTRIES>;
type Coefficients = SMatrix<f64, ENTRIES, OUT>;
/// Bulk strain by the loads.
type Forward = SMatrix<f64, TERMS, GAUGES>;
/// How the loads move with the offset.
type Slope = SMatrix<f64, OUT, GAUGES>;

/// `y = x(eps - zeta) beta`, `x(eps) = (eps_1 .. eps_4, eps_1^2 .. eps_4^2)`.
///
/// Source: Kerst et al. 2019, eq. (20)-(21).
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Regression {
    /// `zeta`, the thermal offset when calibrated [um/m].
    pub offset: [f64; GAUGES],
    /// `beta` [ranges / (um/m), ranges / (um/m)^2], a column for each of `Fx, Fz, Mx, Mz`.
    pub coefficients: [[f64; ENTRIES]; OUT],
    /// Bulk strain of each gauge by `1, y, y^2` [um/m], by which an offset is found where loads are known.
    pub strain: [[f64; TERMS]; GAUGES],
}

impl Regression {
    /// Fits `beta` to known loads by least squares.
    ///
    /// Without an intercept the offset has to supply it, so that it is fitted along: `beta` is
    /// linear for each offset, which is found by Gauss-Newton steps on the residual.
    pub(crate) fn fit(rig: &Rig<'_>, samples: &[RigSample]) -> Result<Self, BuildError> {
        Ok(Self::descend(&rows(rig, samples)?))
    }

    fn descend(rows: &[(Strain, Loads)]) -> Self {
        let mut offset = rows.iter().map(|(bulk, _)| bulk).sum::<Strain>() / rows.len() as f64;
        let mut beta = solve(rows, &offset);
        let mut left = left(rows, &offset, &beta);
        'descent: for _ in 0..STEPS {
            let mut step = descent(rows, &offset, &beta);
            loop {
                let next = offset + step;
                let there = solve(rows, &next);
                let less = self::left(rows, &next, &there);
                if less < left {
                    (offset, beta, left) = (next, there, less);
                    break;
                }
                if step.norm() < 0.1 {
                    break 'descent;
                }
                step *= 0.5;
            }
        }
        Self {
            offset: offset.into(),
            coefficients: beta.into(),
            strain: forward(rows).into(),
        }
    }

    fn loads(&self, bulk: &Strain, offset: &Strain) -> Loads {
        Coefficients::from(self.coefficients).tr_mul(&deformation(&(bulk - offset)))
    }

    /// The offset of a bulk strain at known loads.
    fn zeroed(&self, bulk: &Strain, loads: &Loads) -> Strain {
        let expected = Forward::from(self.strain).tr_mul(&terms(loads));
        Strain::from(self.offset) + bulk - expected
    }
}

/// Bulk strains [um/m] and loads [ranges] on the rig.
fn rows(rig: &Rig<'_>, samples: &[RigSample]) -> Result<Vec<(Strain, Loads)>, BuildError> {
    let mut filter = BulkFilter::try_new(rig.machine.rate_hz)?;
    let ranges = rig.bearing.range.all();
    let mut rows = Vec::new();
    for (i, (raw, loads)) in samples.iter().enumerate() {
        let strain = Strain::from_fn(|g, _| {
            let channel = &rig.sensors.channels[g];
            f64::from(raw.words[g] - channel.zero_word()) * channel.lsb_si() * 1e6
        });
        let bulk = filter.step(&strain);
        if i % THINNED == 0 && loads.iter().all(|load| load.is_finite()) {
            let share = |l: usize| loads[l] / (ranges[l][1] - ranges[l][0]);
            rows.push((bulk, Loads::from(ESTIMATED.map(share))));
        }
    }
    Ok(rows)
}

/// `x` of eq. (21).
fn deformation(bulk: &Strain) -> Deformation {
    Deformation::from_fn(|i, _| {
        let strain = bulk[i % GAUGES];
        if i < GAUGES { strain } else { strain * strain }
    })
}

/// `1, y, y^2`.
fn terms(loads: &Loads) -> SVector<f64, TERMS> {
    SVector::from_fn(|i, _| match i {
        0 => 1.0,
        i if i <= OUT => loads[i - 1],
        i => loads[i - 1 - OUT].powi(2),
    })
}

/// Bulk strain by the loads, by least squares.
fn forward(rows: &[(Strain, Loads)]) -> Forward {
    let mut gram = SMatrix::<f64, TERMS, TERMS>::identity() * 1e-9;
    let mut right = Forward::zeros();
    for (bulk, loads) in rows {
        let terms = terms(loads);
        gram += terms * terms.transpose();
        right += terms * bulk.transpose();
    }
    (gram.cholesky()).map_or_else(Forward::zeros, |factor| factor.solve(&right))
}

/// `dy / d zeta`.
fn slope(beta: &Coefficients, bulk: &Strain) -> Slope {
    Slope::from_fn(|l, g| -beta[(g, l)] - 2.0 * beta[(GAUGES + g, l)] * bulk[g])
}

/// `beta` with an offset, by least squares.
fn solve(rows: &[(Strain, Loads)], offset: &Strain) -> Coefficients {
    let mut right = Coefficients::zeros();
    for (bulk, loads) in rows {
        right += deformation(&(bulk - offset)) * loads.transpose();
    }
    gram(rows, offset)
        .cholesky()
        .map_or_else(Coefficients::zeros, |factor| factor.solve(&right))
}

fn gram(rows: &[(Strain, Loads)], offset: &Strain) -> SMatrix<f64, ENTRIES, ENTRIES> {
    let mut gram = SMatrix::zeros();
    for (bulk, _) in rows {
        let x = deformation(&(bulk - offset));
        gram += x * x.transpose();
    }
    gram
}

fn left(rows: &[(Strain, Loads)], offset: &Strain, beta: &Coefficients) -> f64 {
    (rows.iter())
        .map(|(bulk, loads)| (loads - beta.tr_mul(&deformation(&(bulk - offset)))).norm_squared())
        .sum()
}

/// Step of the offset, `beta` eliminated.
fn descent(rows: &[(Strain, Loads)], offset: &Strain, beta: &Coefficients) -> Strain {
    let mut curvature = SMatrix::<f64, GAUGES, GAUGES>::zeros();
    let mut cross = [SMatrix::<f64, ENTRIES, GAUGES>::zeros(); OUT];
    let mut right = Strain::zeros();
    for (bulk, loads) in rows {
        let x = deformation(&(bulk - offset));
        let slope = slope(beta, &(bulk - offset));
        curvature += slope.tr_mul(&slope);
        right += slope.tr_mul(&(loads - beta.tr_mul(&x)));
        for (l, cross) in cross.iter_mut().enumerate() {
            *cross += x * slope.row(l);
        }
    }
    let Some(factor) = gram(rows, offset).cholesky() else {
        return Strain::zeros();
    };
    for cross in &cross {
        curvature -= cross.tr_mul(&factor.solve(cross));
    }
    curvature += SMatrix::<f64, GAUGES, GAUGES>::identity() * (1e-6 * curvature.trace());
    (curvature.cholesky()).map_or_else(Strain::zeros, |factor| factor.solve(&right))
}

/// Low-pass of all gauges.
struct BulkFilter {
    filter: Butterworth,
    states: [Option<ButterworthState>; GAUGES],
}

impl BulkFilter {
    fn try_new(rate_hz: f64) -> Result<Self, BuildError> {
        Ok(Self {
            filter: Butterworth::try_new(CUTOFF_HZ, (1.0 / rate_hz) as f32)
                .map_err(BuildError::Model)?,
            states: [None; GAUGES],
        })
    }

    fn step(&mut self, strain: &Strain) -> Strain {
        Strain::from_fn(|g, _| {
            let strain = strain[g] as f32;
            let state = self.states[g].get_or_insert(ButterworthState::settled(strain));
            f64::from(self.filter.step(state, strain).low)
        })
    }
}

/// The regression, sample by sample.
pub(crate) struct RegressionRun {
    model: Regression,
    filter: BulkFilter,
    offset: Option<Strain>,
    /// Sums while the offset is set.
    strain: Strain,
    loads: Loads,
    count: f64,
    zeroing: f64,
}

impl RegressionRun {
    pub(crate) fn try_new(model: &Regression, rate_hz: f64) -> Result<Self, BuildError> {
        Ok(Self {
            model: model.clone(),
            filter: BulkFilter::try_new(rate_hz)?,
            offset: None,
            strain: Strain::zeros(),
            loads: Loads::zeros(),
            count: 0.0,
            zeroing: ZEROING_S * rate_hz,
        })
    }

    /// Loads [ranges] by the strains [um/m], once the thermal offset is set: by the first half
    /// second's loads, as the paper sets it where loads are known to be none.
    pub(crate) fn step(&mut self, strain: &[f64; GAUGES], reference: &Loads) -> Option<Loads> {
        let bulk = self.filter.step(&Strain::from(*strain));
        if self.offset.is_none() {
            self.strain += bulk;
            self.loads += reference;
            self.count += 1.0;
            if self.count >= self.zeroing {
                let (bulk, loads) = (self.strain / self.count, self.loads / self.count);
                self.offset = Some(self.model.zeroed(&bulk, &loads));
            }
        }
        Some(self.model.loads(&bulk, self.offset.as_ref()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Loads made by eq. (20)-(21) with an offset are found again, the offset along with them.
    #[test]
    fn what_is_made_by_the_regression_is_found_by_it() {
        let offset = Strain::from([12.0, -7.0, 3.0, 20.0]);
        let beta = Coefficients::from_fn(|i, l| {
            let size = if i < GAUGES { 0.01 } else { 3e-5 };
            size * f64::from((7 * i + 5 * l) as u32).sin()
        });
        let rows: Vec<_> = (0..400_u32)
            .map(|k| {
                let bulk = Strain::from_fn(|g, _| 40.0 * f64::from(k * (3 + 2 * g as u32)).sin());
                (bulk, beta.tr_mul(&deformation(&(bulk - offset))))
            })
            .collect();
        let found = Regression::descend(&rows);
        let left = left(
            &rows,
            &Strain::from(found.offset),
            &found.coefficients.into(),
        );
        let all: f64 = rows.iter().map(|(_, loads)| loads.norm_squared()).sum();
        assert!(left < 1e-6 * all, "{left} of {all}");
    }
}
