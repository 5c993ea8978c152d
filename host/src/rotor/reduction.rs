//! The rotor in few degrees of freedom: the whirls under the forces, and what they lack of
//! the free motion that a start leaves.

use faer::linalg::solvers::Solve;
use faer::{Mat, Scale, Side, c64};

use super::RotorError;
use super::free_motion::free_motion;
use super::model::{BAND, RotorModel};
use super::modes::undamped_modes;
use super::unbalance::forced_response;

/// Part of a vector that the others must leave over for it to count.
const NEW: f64 = 1e-6;

/// Undamped modes beyond twice those kept that free motion is computed in.
const SPARE: usize = 24;

/// A reduced rotor, `q = T z`, `T' M T = I`, `z'' + (C + speed G) z' + K z = T' f`.
///
/// `T`: the whirls under forces that turn at one speed, then the directions that the free
/// motion after a start under these forces has most of beside them, M-orthonormal, turned
/// so that `K` is diagonal at that speed. Steady motion is exact there; undamped modes in place
/// of the free motion's directions leave out how bearings and discs deform what rings on.
#[derive(Clone, Debug)]
pub struct Reduced {
    /// `T`, degrees of freedom x kept.
    pub basis: Mat<f64>,
    gyroscopic: Mat<f64>,
}

/// The largest difference between the whole and the reduced rotor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReductionError {
    /// Largest displacement error at any node [m].
    pub error_m: f64,
    /// Largest displacement at any node [m].
    pub peak_m: f64,
    /// Speed of the largest error [rad/s].
    pub speed_rad_s: f64,
}

impl Reduced {
    /// Keeps the whirls at `speed_rad_s` under each pair of `forces`, rows along x and y over the
    /// degrees of freedom, and `free` directions of free motion at `speeds` [rad/s].
    ///
    /// # Errors
    /// [`RotorError`] where the rotor is not held, or is undamped at its critical speed.
    ///
    /// Source: Lall, Marsden, Glavaski, Int. J. Robust Nonlinear Control 12 (2002): the
    /// directions of an empirical Gramian.
    pub fn new(
        model: &RotorModel,
        speed_rad_s: f64,
        speeds: &[f64],
        free: usize,
        forces: &[Vec<f64>],
    ) -> Result<Self, RotorError> {
        let n = model.len();
        let mut columns = Vec::new();
        for whirl in whirls(model, speed_rad_s, forces)? {
            append(model, &mut columns, whirl);
        }
        let kept = columns.len();
        let undamped = undamped_modes(model, speed_rad_s, 2 * free + SPARE)?;
        for shape in undamped.shapes.col_iter() {
            append(model, &mut columns, shape.as_mat().to_owned());
        }
        let fine = Mat::from_fn(n, columns.len(), |i, j| columns[j][(i, 0)]);
        let rest = fine.ncols() - kept;
        let reduced = Self::on(model, fine.clone());
        let mut gramian = Mat::<f64>::zeros(fine.ncols(), fine.ncols());
        for speed in speeds.iter().filter(|speed| **speed > 0.0) {
            let growth = (speed / speed_rad_s).powi(2);
            let whirls = whirls(model, *speed, forces)?;
            gramian += Scale(growth * growth) * free_motion(model, &reduced, *speed, &whirls);
        }
        let directions = gramian
            .submatrix(kept, kept, rest, rest)
            .self_adjoint_eigen(Side::Lower)
            .map_err(|_| RotorError::NoEigenvalues)?;
        let free = free.min(rest);
        // Rising order: what there is most of comes last.
        let directions = fine.subcols(kept, rest) * directions.U().subcols(rest - free, free);
        let t = Mat::from_fn(n, kept + free, |i, j| match j.checked_sub(kept) {
            Some(j) => directions[(i, j)],
            None => fine[(i, j)],
        });
        let k = model.stiffness(speed_rad_s);
        let turned = project(&t, &(Scale(0.5) * (&k + k.transpose())))
            .self_adjoint_eigen(Side::Lower)
            .map_err(|_| RotorError::NoEigenvalues)?;
        Ok(Self::on(model, &t * turned.U()))
    }

    /// The `modes` lowest undamped modes at `speed_rad_s`, then what `forces`, rows over the
    /// degrees of freedom, bend statically beside them.
    ///
    /// # Errors
    /// [`RotorError`] where the rotor is not held.
    pub fn with_statics(
        model: &RotorModel,
        speed_rad_s: f64,
        modes: usize,
        forces: &[Vec<f64>],
    ) -> Result<Self, RotorError> {
        let n = model.len();
        let mut columns = Vec::new();
        for shape in undamped_modes(model, speed_rad_s, modes)?.shapes.col_iter() {
            append(model, &mut columns, shape.as_mat().to_owned());
        }
        let k = model.stiffness(speed_rad_s);
        let factor = (Scale(0.5) * (&k + k.transpose()))
            .llt(Side::Lower)
            .map_err(|_| RotorError::NotHeld)?;
        for force in forces {
            let force = Mat::from_fn(n, 1, |i, _| force[i]);
            append(model, &mut columns, factor.solve(&force));
        }
        let basis = Mat::from_fn(n, columns.len(), |i, j| columns[j][(i, 0)]);
        Ok(Self::on(model, basis))
    }

    /// A reduced rotor on a given basis, M-orthonormal.
    pub fn on(model: &RotorModel, basis: Mat<f64>) -> Self {
        Self {
            gyroscopic: project(&basis, &model.gyroscopic),
            basis,
        }
    }

    /// Degrees of freedom kept.
    pub fn len(&self) -> usize {
        self.basis.ncols()
    }

    /// Whether none is kept; never so.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// `K` at a speed [rad/s].
    pub fn stiffness(&self, model: &RotorModel, speed_rad_s: f64) -> Mat<f64> {
        project(&self.basis, &model.stiffness(speed_rad_s))
    }

    /// `C + speed G` at a speed [rad/s].
    pub fn turning_damping(&self, model: &RotorModel, speed_rad_s: f64) -> Mat<f64> {
        project(&self.basis, &model.damping(speed_rad_s)) + Scale(speed_rad_s) * &self.gyroscopic
    }

    /// `A dt` of `(z, z')' = A (z, z')` at a speed, with `more` rows and columns of 0 behind it
    /// for what drives the motion.
    pub(super) fn motion(
        &self,
        model: &RotorModel,
        speed_rad_s: f64,
        dt_s: f64,
        more: usize,
    ) -> Mat<f64> {
        let r = self.len();
        let k = self.stiffness(model, speed_rad_s);
        let c = self.turning_damping(model, speed_rad_s);
        let mut a = Mat::<f64>::zeros(2 * r + more, 2 * r + more);
        for i in 0..r {
            a[(i, r + i)] = dt_s;
            for j in 0..r {
                a[(r + i, j)] = -k[(i, j)] * dt_s;
                a[(r + i, r + j)] = -c[(i, j)] * dt_s;
            }
        }
        a
    }

    /// `row T`: a force, or a measured displacement, over what is kept.
    pub fn row(&self, row: &[f64]) -> Vec<f64> {
        (0..self.len())
            .map(|j| {
                (row.iter().enumerate())
                    .map(|(i, r)| r * self.basis[(i, j)])
                    .sum()
            })
            .collect()
    }

    /// Amplitudes of all degrees of freedom under `force exp(i speed t)`.
    ///
    /// # Errors
    /// [`RotorError::Resonance`] for an undamped rotor at its critical speed.
    pub fn response(
        &self,
        model: &RotorModel,
        speed_rad_s: f64,
        force: &[c64],
    ) -> Result<Vec<c64>, RotorError> {
        let r = self.len();
        let k = self.stiffness(model, speed_rad_s);
        let c = self.turning_damping(model, speed_rad_s);
        let w = speed_rad_s;
        let matrix = Mat::from_fn(r, r, |i, j| {
            let inertia = if i == j { w * w } else { 0.0 };
            c64::new(k[(i, j)] - inertia, w * c[(i, j)])
        });
        let right = Mat::from_fn(r, 1, |j, _| {
            (force.iter().enumerate())
                .map(|(i, f)| *f * self.basis[(i, j)])
                .sum::<c64>()
        });
        let z = matrix.partial_piv_lu().solve(&right);
        if !z.norm_l2().is_finite() {
            return Err(RotorError::Resonance);
        }
        Ok((0..model.len())
            .map(|i| (0..r).map(|j| z[(j, 0)] * self.basis[(i, j)]).sum())
            .collect())
    }
}

impl ReductionError {
    /// Adds the amplitudes of the whole and of the reduced rotor at one speed.
    pub fn push(&mut self, speed_rad_s: f64, whole: &[c64], reduced: &[c64]) {
        let size = |z: c64| z.re.hypot(z.im);
        for (i, (a, b)) in whole.iter().zip(reduced).enumerate() {
            if i % 4 < 2 {
                self.peak_m = self.peak_m.max(size(*a));
                let error = size(*a - *b);
                if error > self.error_m {
                    (self.error_m, self.speed_rad_s) = (error, speed_rad_s);
                }
            }
        }
    }
}

/// What the rotor does under a force that turns with it, for each pair of `forces`:
/// in phase and a quarter turn later.
fn whirls(
    model: &RotorModel,
    speed_rad_s: f64,
    forces: &[Vec<f64>],
) -> Result<Vec<Mat<f64>>, RotorError> {
    let n = model.len();
    let mut all = Vec::new();
    for pair in forces.chunks_exact(2) {
        let force = Mat::from_fn(n, 1, |i, _| c64::new(pair[0][i], -pair[1][i]));
        let whirl = forced_response(model, speed_rad_s, &force)?;
        all.push(Mat::from_fn(n, 1, |i, _| whirl[i].re));
        all.push(Mat::from_fn(n, 1, |i, _| whirl[i].im));
    }
    Ok(all)
}

/// `T' A T` for a matrix of the model, within its band.
pub(super) fn project(basis: &Mat<f64>, matrix: &Mat<f64>) -> Mat<f64> {
    let n = matrix.nrows();
    let product = Mat::from_fn(n, basis.ncols(), |i, j| {
        (i.saturating_sub(BAND)..n.min(i + BAND + 1))
            .map(|k| matrix[(i, k)] * basis[(k, j)])
            .sum::<f64>()
    });
    basis.transpose() * product
}

/// Adds what `columns`, M-orthonormal, lack of `v`, where it is anything.
fn append(model: &RotorModel, columns: &mut Vec<Mat<f64>>, mut v: Mat<f64>) {
    let whole = mass_norm(model, &v);
    // Twice is enough: what the first pass rounds, the second removes.
    for _ in 0..2 {
        let mv = &model.mass * &v;
        for c in columns.iter() {
            let along = (c.transpose() * &mv)[(0, 0)];
            v -= Scale(along) * c;
        }
    }
    let left = mass_norm(model, &v);
    if left > NEW * whole {
        columns.push(Scale(1.0 / left) * v);
    }
}

fn mass_norm(model: &RotorModel, v: &Mat<f64>) -> f64 {
    (v.transpose() * (&model.mass * v))[(0, 0)].sqrt()
}
