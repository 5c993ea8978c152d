//! Models the local strain of one gauge by a passing ball: contact load times a cubic in the
//! contact angle times two harmonics of the ball-pass phase (Kerst et al. 2019, eq. (1)-(3)). `fit`
//! finds its coefficients from calibration blocks by alternating least squares.

use std::f64::consts::SQRT_2;

use faer::c64;
use loadtwin_common::bearing::contact::Features;
use loadtwin_common::bearing::{BASIS, GAUGES, ROWS};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::bearing::design_matrix::features;
use crate::bearing::phase_tracking::CalibrationBlock;
use crate::bearing::physical_parameters::PhysicalParameters;
use crate::bearing::rig_calibration::Rig;
use crate::error::BuildError;

/// Coefficients of the sensitivity, `N_p + 1`.
///
/// Source: Kerst et al. 2019, section VI-D, `N_p = 3`.
const POWERS: usize = 4;
/// Harmonics, `N_h`.
///
/// Source: Kerst et al. 2019, section VI-D.
const HARMONICS: usize = 2;
/// Times that sensitivity and harmonics are fitted in turn.
const TURNS: usize = 12;
/// `c_bp` of eq. (11): cut-off of the high-pass over the frequency of ball passing, below 1. The
/// paper does not give its value.
pub const CUTOFF: f64 = 0.35;

/// Response of one gauge to a contact of either row.
///
/// `eps = Q eta(alpha) G(phi)`, `eta = sum c_n alpha^n`,
/// `G = cos phi + Re(a_2 e^(2 i phi))`, after the high-pass of eq. (11).
///
/// Source: Kerst et al. 2019, eq. (1)-(3); `N_h = 2`, `N_p = 3`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StrainModel {
    /// `c_n` [um/m / kN / rad^n].
    pub sensitivity: [f64; POWERS],
    /// Real and imaginary part of `a_2`.
    pub second: [f64; 2],
}

impl StrainModel {
    /// `eta(alpha)` [um/m / kN].
    pub fn sensitivity(&self, angle: f64) -> f64 {
        powers(angle).dot(&SVector::from(self.sensitivity))
    }

    /// `G(phi)` and its derivative.
    pub fn transfer(&self, phase: f64) -> (f64, f64) {
        let (sin, cos) = phase.sin_cos();
        let (sin2, cos2) = (2.0 * phase).sin_cos();
        let [re, im] = self.second;
        (
            cos + re * cos2 - im * sin2,
            -sin - 2.0 * (re * sin2 + im * cos2),
        )
    }
}

/// Fits each gauge's strain model to blocks with known phases and loads: least squares in
/// sensitivity and harmonics by turns, each of them linear.
///
/// The bearing is as described, as in the paper; its gauges have 6 parameters each,
/// where the paper lets front and rear share theirs.
pub fn fit(rig: &Rig<'_>, known: &[CalibrationBlock]) -> Result<Vec<StrainModel>, BuildError> {
    let features = features(rig, known.iter(), &PhysicalParameters::default())?;
    Ok((0..GAUGES)
        .map(|g| fit_gauge(rig, known, &features, g))
        .collect())
}

fn fit_gauge(
    rig: &Rig<'_>,
    known: &[CalibrationBlock],
    features: &[Features],
    g: usize,
) -> StrainModel {
    let mut sensitivity = SVector::<f64, POWERS>::zeros();
    let mut harmonics = SVector::<f64, { 2 * HARMONICS }>::from([1.0, 0.0, 0.35, 0.0]);
    for _ in 0..TURNS {
        let mut sums = Sums::new();
        each_reading(rig, known, features, g, |by, y| {
            sums.add(by.transpose() * harmonics, y);
        });
        sensitivity = sums.solve();
        let mut sums = Sums::new();
        each_reading(rig, known, features, g, |by, y| {
            sums.add(by * sensitivity, y);
        });
        harmonics = sums.solve();
    }
    let harmonic = |n: usize| {
        let s = c64::new(0.0, (n + 1) as f64 / CUTOFF);
        let high_pass = s * s / (s * s + s * SQRT_2 + 1.0);
        c64::new(harmonics[2 * n], harmonics[2 * n + 1]) * high_pass
    };
    let (first, second) = (harmonic(0), harmonic(1));
    let size = first.norm();
    // Phases are counted from where the first harmonic is largest.
    let unit = first / size;
    let second = second / (unit * unit * size);
    StrainModel {
        sensitivity: (sensitivity * size).into(),
        second: [second.re, second.im],
    }
}

/// Shows each reading of local strain, and by what products of harmonics and powers it is made.
fn each_reading(
    rig: &Rig<'_>,
    known: &[CalibrationBlock],
    features: &[Features],
    g: usize,
    mut each: impl FnMut(&SMatrix<f64, { 2 * HARMONICS }, POWERS>, f64),
) {
    let angle0 = rig.bearing.contact_angle_deg.to_radians();
    for (known, features) in known.iter().zip(features) {
        let mut basis = [SMatrix::<f64, { 2 * HARMONICS }, POWERS>::zeros(); BASIS];
        for row in 0..ROWS {
            let [load, turned, ..] = features.value[g][row].map(f64::from);
            let angle = angle0 + (turned / load.max(1e-6)).clamp(-1.0, 1.0).asin();
            let by_angle = powers(angle).transpose() * load;
            for n in 0..HARMONICS {
                let (sin, cos) = ((n + 1) as f64 * (known.phase[row] - rig.passing(g))).sin_cos();
                for (k, re, im) in [(2 * n + 1, cos, -sin), (2 * n + 2, -sin, -cos)] {
                    let mut rows = basis[k].fixed_rows_mut::<2>(2 * n);
                    rows += SVector::from([re, im]) * by_angle;
                }
            }
        }
        for k in 1..BASIS {
            if known.block.root[k][k] == 0.0 {
                continue;
            }
            let by = (k..BASIS)
                .map(|j| basis[j] * f64::from(known.block.root[k][j]))
                .sum();
            each(&by, f64::from(known.block.reading[g][k]));
        }
    }
}

fn powers(angle: f64) -> SVector<f64, POWERS> {
    SVector::from([1.0, angle, angle * angle, angle * angle * angle])
}

/// Normal equations of a small least-squares problem.
struct Sums<const N: usize> {
    gram: SMatrix<f64, N, N>,
    right: SVector<f64, N>,
}

impl<const N: usize> Sums<N> {
    fn new() -> Self {
        Self {
            gram: SMatrix::zeros(),
            right: SVector::zeros(),
        }
    }

    fn add(&mut self, row: SVector<f64, N>, y: f64) {
        self.gram += row * row.transpose();
        self.right += row * y;
    }

    /// The solution, with a ridge that settles what the data leave open.
    fn solve(mut self) -> SVector<f64, N> {
        for i in 0..N {
            self.gram[(i, i)] = self.gram[(i, i)] * (1.0 + 1e-6) + 1e-12;
        }
        (self.gram.cholesky()).map_or_else(SVector::zeros, |factor| factor.solve(&self.right))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `G(0) = 1 + Re a_2`; the slope against a difference.
    #[test]
    fn transfer_by_hand() {
        let model = StrainModel {
            sensitivity: [2.0, 3.0, 0.0, 1.0],
            second: [0.3, -0.2],
        };
        assert!((model.sensitivity(0.5) - 3.625).abs() < 1e-12);
        assert!((model.transfer(0.0).0 - 1.3).abs() < 1e-12);
        let (step, at) = (1e-6, 0.7);
        let slope = (model.transfer(at + step).0 - model.transfer(at - step).0) / (2.0 * step);
        assert!((model.transfer(at).1 - slope).abs() < 1e-6);
    }
}
