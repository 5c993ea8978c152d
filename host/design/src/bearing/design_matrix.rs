//! Builds and solves the linear least-squares problem for the coefficients of one gauge: contact
//! features in equilibrium with the loads of each block (Newton's method), rows for the bulk strain
//! and the ball-pass harmonics with their weights, normal equations.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use loadtwin_common::bearing::contact::{Contacts, DOF, Equilibrium, Features};
use loadtwin_common::bearing::{BASIS, FEATURES, GAUGES, HARMONICS, LOADS, ROWS};

use crate::bearing::phase_tracking::CalibrationBlock;
use crate::bearing::physical_parameters::{PhysicalParameters, geometry};
use crate::bearing::rig_calibration::Rig;
use crate::error::BuildError;

/// Powers of the time that follow the warming of the bulk strain, constant to cubic.
pub const DRIFT_TERMS: usize = 4;
/// Coefficients of the bulk strain: drift, loads, features of both rows.
pub const BULK_TERMS: usize = DRIFT_TERMS + LOADS + ROWS * FEATURES;
/// All coefficients of a gauge: those of the bulk strain, then real and imaginary part of the local
/// strain's harmonics for each row and feature.
pub const COEFFICIENTS: usize = BULK_TERMS + ROWS * HARMONICS * FEATURES * 2;
/// Force out of balance at which an equilibrium is reached [kN].
const BALANCED: f32 = 1e-4;

/// Most steps of Newton's method to it; two were too few (docs/lab/tried.md).
const MOST_STEPS: usize = 20;
/// Error of the mean strain from block to block [um/m], by which it is weighted beside the
/// harmonics.
const BULK_ERROR: f64 = 5.0;

/// Features of each block with the bearing's `physical` parameters.
pub fn features<'a>(
    rig: &Rig<'_>,
    known: impl Iterator<Item = &'a CalibrationBlock>,
    physical: &PhysicalParameters,
) -> Result<Vec<Features>, BuildError> {
    let settled = settled(rig, known, physical)?;
    Ok(settled.into_iter().map(|(features, _)| features).collect())
}

/// Features of each block, and the rate of ball passing of each row over that at the unloaded
/// contact angle.
pub fn settled<'a>(
    rig: &Rig<'_>,
    known: impl Iterator<Item = &'a CalibrationBlock>,
    physical: &PhysicalParameters,
) -> Result<Vec<(Features, [f32; ROWS])>, BuildError> {
    let contacts =
        Contacts::try_new(geometry(rig.bearing, physical)?).map_err(BuildError::Model)?;
    let mut state = None;
    Ok(known
        .map(|block| {
            let at = match state {
                None => contacts.solve_equilibrium(&block.loads, 0.0),
                Some(position) => balanced(&contacts, &position, &block.loads),
            };
            state = Some(at.position);
            let mut features = Features::default();
            for g in 0..GAUGES {
                contacts.features(&at, 0.0, g, &mut features.value[g], &mut features.slope[g]);
            }
            (features, at.pace)
        })
        .collect())
}

/// Equilibrium with `loads`, from that of the block before.
fn balanced(contacts: &Contacts, position: &[f32; DOF], loads: &[f32; LOADS]) -> Equilibrium {
    let mut from = *position;
    let mut at = contacts.newton(&from, loads, 0.0);
    for _ in 0..MOST_STEPS {
        let next = contacts.newton(&at.position, loads, 0.0);
        if next.residual > at.residual {
            // A contact opened or closed on the way: half the step back.
            at.position = std::array::from_fn(|i| 0.5 * (from[i] + at.position[i]));
        } else {
            from = at.position;
            at = next;
        }
        if at.residual < BALANCED {
            break;
        }
    }
    at
}

/// Sums of a linear least-squares problem.
#[derive(Clone)]
pub struct Normal {
    /// `X' W X`, [`COEFFICIENTS`] square.
    pub gram: Mat<f64>,
    /// `X' W y`.
    pub right: Mat<f64>,
    /// `y' W y`.
    square: f64,
    /// Number of rows of `X`.
    pub rows: f64,
}

/// One row for each reading of a block: coefficients, reading, weight.
pub fn rows(
    known: &CalibrationBlock,
    features: &Features,
    passing: f64,
    g: usize,
    mut each: impl FnMut(&[f64; COEFFICIENTS], f64, usize),
) {
    let mut basis = [[0.0; COEFFICIENTS]; BASIS];
    let mut time = 1.0;
    for power in &mut basis[0][..DRIFT_TERMS] {
        *power = time;
        time *= known.time;
    }
    for (slot, load) in basis[0][DRIFT_TERMS..].iter_mut().zip(&known.loads) {
        *slot = f64::from(*load);
    }
    for row in 0..ROWS {
        for k in 0..FEATURES {
            let f = f64::from(features.value[g][row][k]);
            basis[0][DRIFT_TERMS + LOADS + row * FEATURES + k] = f;
            for n in 0..HARMONICS {
                let (sin, cos) = ((n + 1) as f64 * (known.phase[row] - passing)).sin_cos();
                let place = BULK_TERMS + ((row * HARMONICS + n) * FEATURES + k) * 2;
                basis[2 * n + 1][place] = cos * f;
                basis[2 * n + 1][place + 1] = -sin * f;
                basis[2 * n + 2][place] = -sin * f;
                basis[2 * n + 2][place + 1] = -cos * f;
            }
        }
    }
    for k in 0..BASIS {
        if known.block.root[k][k] == 0.0 {
            continue;
        }
        let mut row = [0.0; COEFFICIENTS];
        for j in k..BASIS {
            let u = f64::from(known.block.root[k][j]);
            let from = if j == 0 { 0 } else { BULK_TERMS };
            for (sum, value) in row[from..].iter_mut().zip(&basis[j][from..]) {
                *sum += u * value;
            }
        }
        each(&row, f64::from(known.block.reading[g][k]), k);
    }
}

/// Weight of row `k`: the mean strain is modelled less well than the others.
pub fn weight(known: &CalibrationBlock, noise: f64, k: usize) -> f64 {
    if k == 0 {
        let n = f64::from(known.block.count);
        noise * noise / (noise * noise + n * BULK_ERROR * BULK_ERROR)
    } else {
        1.0
    }
}

/// Normal equations of gauge `g` over the blocks `known`, whose contacts have `features`.
pub fn normal<'a>(
    rig: &Rig<'_>,
    known: impl Iterator<Item = &'a CalibrationBlock>,
    features: &[Features],
    g: usize,
) -> Normal {
    let passing = rig.passing(g);
    let mut gram = vec![0.0; COEFFICIENTS * COEFFICIENTS];
    let mut right = vec![0.0; COEFFICIENTS];
    let (mut square, mut count) = (0.0, 0.0);
    for (block, features) in known.zip(features) {
        rows(block, features, passing, g, |row, y, k| {
            let w = weight(block, 1.0, k);
            let first = if k == 0 { 0 } else { BULK_TERMS };
            for i in first..COEFFICIENTS {
                let scaled = w * row[i];
                right[i] += scaled * y;
                let line = &mut gram[i * COEFFICIENTS..(i + 1) * COEFFICIENTS];
                for j in first..=i {
                    line[j] += scaled * row[j];
                }
            }
            square += w * y * y;
            count += 1.0;
        });
    }
    Normal {
        gram: Mat::from_fn(COEFFICIENTS, COEFFICIENTS, |i, j| {
            gram[i.max(j) * COEFFICIENTS + i.min(j)]
        }),
        right: Mat::from_fn(COEFFICIENTS, 1, |i, _| right[i]),
        square,
        rows: count,
    }
}

impl Normal {
    /// Factor of the sums, with a ridge of a millionth that settles what the data leave open.
    pub fn factor(&self) -> Option<faer::linalg::solvers::Llt<f64>> {
        let mut gram = self.gram.clone();
        for i in 0..COEFFICIENTS {
            gram[(i, i)] = gram[(i, i)] * (1.0 + 1e-6) + 1e-9;
        }
        gram.llt(Side::Lower).ok()
    }

    /// Coefficients and the sum of squares that they leave.
    pub fn solve(&self) -> (Mat<f64>, f64) {
        let zero = || Mat::zeros(COEFFICIENTS, 1);
        let x = self
            .factor()
            .map_or_else(zero, |factor| factor.solve(&self.right));
        let explained =
            (x.transpose() * &self.right)[(0, 0)] * 2.0 - (x.transpose() * &self.gram * &x)[(0, 0)];
        (x, (self.square - explained).max(0.0))
    }
}
