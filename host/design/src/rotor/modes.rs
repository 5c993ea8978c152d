//! Computes the modes of a rotor: undamped ones without gyroscopic terms, damped ones (eigenvalue,
//! direction of whirl) at a speed, and those over several speeds for a Campbell diagram.

use faer::linalg::solvers::Solve;
use faer::{Mat, Scale, Side, c64};
use rayon::prelude::*;

use crate::rotor::RotorError;
use crate::rotor::fe_model::{BAND, RotorModel};
use crate::rotor::undamped_mode_reduction::project;

/// Modes beyond those asked for that the first guess is made of.
const SPARE: usize = 14;

/// Steps of inverse iteration; convergence is quadratic.
const POLISHES: usize = 4;

/// Relative step after which an eigenvalue has converged: its error is the step squared.
const CONVERGED: f64 = 1e-6;

/// The lowest modes of the undamped rotor without gyroscopic terms, `K phi = w^2 M phi`.
#[derive(Clone, Debug)]
pub struct UndampedModes {
    /// `w^2` [rad^2/s^2], rising.
    pub squares: Vec<f64>,
    /// `Phi`, one column for each mode, `Phi' M Phi = I`.
    pub shapes: Mat<f64>,
}

/// A damped mode at one speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Eigenvalue [1/s, rad/s], imaginary part >= 0.
    pub eigenvalue: c64,
    /// Area that the nodes' orbits enclose, over that of circles of the same
    /// size: 1 whirls forward, -1 backward.
    pub whirl: f64,
}

impl Mode {
    /// Natural frequency `|s|` [rad/s].
    pub fn natural_rad_s(&self) -> f64 {
        self.eigenvalue.re.hypot(self.eigenvalue.im)
    }

    /// Damping ratio `-Re s / |s|`.
    pub fn damping_ratio(&self) -> f64 {
        -self.eigenvalue.re / self.natural_rad_s()
    }
}

/// The `count` lowest undamped modes with the stiffness of `speed_rad_s`, the
/// symmetric part where bearings couple.
///
/// `K = L L'`, then the largest eigenvalues of `L^-1 M L^-T`: the lowest modes
/// keep all their digits beside bearings a million times stiffer than the shaft.
///
/// # Errors
/// [`RotorError::NotHeld`] where `K` is not positive definite.
pub fn undamped_modes(
    model: &RotorModel,
    speed_rad_s: f64,
    count: usize,
) -> Result<UndampedModes, RotorError> {
    let k = model.stiffness(speed_rad_s);
    let k = Scale(0.5) * (&k + k.transpose());
    let n = model.len();
    let factor = k.llt(Side::Lower).map_err(|_| RotorError::NotHeld)?;
    let l = factor.L();
    let mut a = model.mass.clone();
    l.solve_lower_triangular_in_place(a.as_mut());
    let mut a = a.transpose().to_owned();
    l.solve_lower_triangular_in_place(a.as_mut());
    let eigen = a
        .self_adjoint_eigen(Side::Lower)
        .map_err(|_| RotorError::NoEigenvalues)?;
    let count = count.min(n);
    // Rising order: the slowest modes come last.
    let inverse = |k: usize| eigen.S()[n - 1 - k];
    if !(0..count).all(|k| inverse(k) > 0.0) {
        return Err(RotorError::NoEigenvalues);
    }
    let mut shapes = Mat::from_fn(n, count, |i, k| eigen.U()[(i, n - 1 - k)]);
    l.transpose()
        .solve_upper_triangular_in_place(shapes.as_mut());
    for k in 0..count {
        let scale = 1.0 / inverse(k).sqrt();
        for i in 0..n {
            shapes[(i, k)] *= scale;
        }
    }
    Ok(UndampedModes {
        squares: (0..count).map(|k| 1.0 / inverse(k)).collect(),
        shapes,
    })
}

/// The `count` lowest damped modes at `speed_rad_s`, by natural frequency.
///
/// A first guess from the undamped modes, then inverse iteration on the whole model:
/// `Q(s) u = Q'(s) v`, `s <- s - 1 / (v* u)`, with `Q(s) = s^2 M + s (C + speed G) + K`.
///
/// # Errors
/// [`RotorError`] where the rotor is not held or numbers are out of proportion.
///
/// Source: Guettel, Tisseur, The nonlinear eigenvalue problem, Acta Numerica 26
/// (2017), section 4.3.
pub fn modes(model: &RotorModel, speed_rad_s: f64, count: usize) -> Result<Vec<Mode>, RotorError> {
    let basis = undamped_modes(model, speed_rad_s, 2 * count + SPARE)?;
    modes_from(model, &basis, speed_rad_s, count)
}

/// [`modes`] at each of `speeds_rad_s`, for a Campbell diagram.
///
/// # Errors
/// As [`modes`].
pub fn campbell(
    model: &RotorModel,
    speeds_rad_s: &[f64],
    count: usize,
) -> Result<Vec<Vec<Mode>>, RotorError> {
    let middle = speeds_rad_s.iter().sum::<f64>() / speeds_rad_s.len().max(1) as f64;
    let basis = undamped_modes(model, middle, 2 * count + SPARE)?;
    speeds_rad_s
        .par_iter()
        .map(|speed| modes_from(model, &basis, *speed, count))
        .collect()
}

fn modes_from(
    model: &RotorModel,
    basis: &UndampedModes,
    speed_rad_s: f64,
    count: usize,
) -> Result<Vec<Mode>, RotorError> {
    let damping = model.turning_damping(speed_rad_s);
    let stiffness = model.stiffness(speed_rad_s);
    let r = basis.shapes.ncols();
    let (c, k) = (
        project(&basis.shapes, &damping),
        project(&basis.shapes, &stiffness),
    );
    let mut a = Mat::<f64>::zeros(2 * r, 2 * r);
    for i in 0..r {
        a[(i, r + i)] = 1.0;
        for j in 0..r {
            a[(r + i, j)] = -k[(i, j)];
            a[(r + i, r + j)] = -c[(i, j)];
        }
    }
    // Displacements and speeds in like units, so that the eigenvalues are well conditioned.
    for i in 0..r {
        let w = basis.squares[i].sqrt();
        for j in 0..2 * r {
            a[(i, j)] *= w;
            a[(j, i)] /= w;
        }
    }
    let eigen = a.eigen().map_err(|_| RotorError::NoEigenvalues)?;
    let values: Vec<c64> = (0..2 * r).map(|i| eigen.S()[i]).collect();
    let mut order: Vec<usize> = (0..2 * r).filter(|i| values[*i].im > 0.0).collect();
    let size = |s: c64| s.re.hypot(s.im);
    order.sort_by(|i, j| size(values[*i]).total_cmp(&size(values[*j])));
    let mut found = Vec::new();
    for i in order.into_iter().take(count) {
        let shape = Mat::from_fn(model.len(), 1, |row, _| {
            (0..r)
                .map(|j| eigen.U()[(j, i)] * (basis.shapes[(row, j)] / basis.squares[j].sqrt()))
                .sum::<c64>()
        });
        found.push(polished(model, &damping, &stiffness, values[i], shape)?);
    }
    found.sort_by(|a, b| a.natural_rad_s().total_cmp(&b.natural_rad_s()));
    Ok(found)
}

/// Inverse iteration on the whole model from a good guess.
fn polished(
    model: &RotorModel,
    damping: &Mat<f64>,
    stiffness: &Mat<f64>,
    mut s: c64,
    mut v: Mat<c64>,
) -> Result<Mode, RotorError> {
    let n = model.len();
    for _ in 0..POLISHES {
        let norm = v.norm_l2();
        v = Scale(c64::new(1.0 / norm, 0.0)) * v;
        // Q'(s) v = (2 s M + C + speed G) v, within the band.
        let right = Mat::from_fn(n, 1, |i, _| {
            (i.saturating_sub(BAND)..n.min(i + BAND + 1))
                .map(|j| (s * (2.0 * model.mass[(i, j)]) + damping[(i, j)]) * v[(j, 0)])
                .sum::<c64>()
        });
        let Ok(factor) = model.dynamic_stiffness(s, damping, stiffness)?.sp_lu() else {
            break;
        };
        let u = factor.solve(&right);
        let along: c64 = (0..n).map(|i| v[(i, 0)].conj() * u[(i, 0)]).sum();
        let step = c64::new(1.0, 0.0) / along;
        if !(step.re.is_finite() && step.im.is_finite() && u.norm_l2().is_finite()) {
            break;
        }
        s -= step;
        v = u;
        if step.re.hypot(step.im) <= CONVERGED * s.re.hypot(s.im) {
            break;
        }
    }
    let (mut area, mut size) = (0.0, 0.0);
    for node in 0..model.nodes {
        let (x, y) = (v[(4 * node, 0)], v[(4 * node + 1, 0)]);
        area += 2.0 * (x * y.conj()).im;
        size += x.re * x.re + x.im * x.im + y.re * y.re + y.im * y.im;
    }
    Ok(Mode {
        eigenvalue: s,
        whirl: if size > 0.0 { area / size } else { 0.0 },
    })
}
