//! Reduces the finite-element rotor to its lowest undamped modes and the static deflections under
//! given forces (attachment modes): basis, reduced stiffness and damping, state matrix of the
//! motion. `ReductionError` holds the largest displacement error of a reduction.

use faer::linalg::solvers::Solve;
use faer::{Mat, Scale, Side};

use crate::rotor::RotorError;
use crate::rotor::fe_model::{BAND, RotorModel};
use crate::rotor::modes::undamped_modes;

/// Part of a vector that the others must leave over for it to count.
const NEW: f64 = 1e-6;

/// A reduced rotor, `q = T z`, `T' M T = I`,
/// `z'' + (C + speed G) z' + (K + speed' K_st) z = T' f`.
#[derive(Clone, Debug)]
pub struct Reduced {
    /// `T`, degrees of freedom x kept.
    pub basis: Mat<f64>,
    gyroscopic: Mat<f64>,
    accelerating: Mat<f64>,
}

/// The largest difference between the whole and the reduced rotor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReductionError {
    /// Largest displacement error at any node (m).
    pub error_m: f64,
    /// Largest displacement at any node (m).
    pub peak_m: f64,
    /// Speed of the largest error [rad/s].
    pub speed_rad_s: f64,
}

impl Reduced {
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
            accelerating: project(&basis, &model.accelerating_stiffness()),
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

    /// `K_st`, as [`RotorModel::accelerating_stiffness`].
    pub fn accelerating_stiffness(&self) -> &Mat<f64> {
        &self.accelerating
    }

    /// `C + speed G` at a speed [rad/s].
    pub fn turning_damping(&self, model: &RotorModel, speed_rad_s: f64) -> Mat<f64> {
        project(&self.basis, &model.damping(speed_rad_s)) + Scale(speed_rad_s) * &self.gyroscopic
    }

    /// `A dt` of `(z, z')' = A (z, z')` at a speed, with `more` rows and columns of 0 behind it
    /// for what drives the motion.
    pub(crate) fn motion(
        &self,
        model: &RotorModel,
        speed_rad_s: f64,
        dt_s: f64,
        more: usize,
    ) -> Mat<f64> {
        motion(
            &self.stiffness(model, speed_rad_s),
            &self.turning_damping(model, speed_rad_s),
            dt_s,
            more,
        )
    }

    /// `row T`: a force, or a measured displacement, over what is kept.
    pub fn row(&self, row: &[f64]) -> Vec<f64> {
        over(&self.basis, row)
    }
}

impl ReductionError {
    /// Adds a displacement of the whole rotor and what of it is lost [m].
    pub(crate) fn push(&mut self, speed_rad_s: f64, whole_m: f64, lost_m: f64) {
        self.peak_m = self.peak_m.max(whole_m);
        if lost_m > self.error_m {
            (self.error_m, self.speed_rad_s) = (lost_m, speed_rad_s);
        }
    }
}

/// `A dt` of `(z, z')' = A (z, z')`, with `more` rows and columns of 0 behind it for what
/// drives the motion.
pub(crate) fn motion(stiffness: &Mat<f64>, damping: &Mat<f64>, dt_s: f64, more: usize) -> Mat<f64> {
    let r = stiffness.nrows();
    let mut a = Mat::<f64>::zeros(2 * r + more, 2 * r + more);
    for i in 0..r {
        a[(i, r + i)] = dt_s;
        for j in 0..r {
            a[(r + i, j)] = -stiffness[(i, j)] * dt_s;
            a[(r + i, r + j)] = -damping[(i, j)] * dt_s;
        }
    }
    a
}

/// `row T`.
pub(crate) fn over(basis: &Mat<f64>, row: &[f64]) -> Vec<f64> {
    (0..basis.ncols())
        .map(|j| {
            (row.iter().enumerate())
                .map(|(i, r)| r * basis[(i, j)])
                .sum()
        })
        .collect()
}

/// `T' A T` for a matrix of the model, within its band.
pub(crate) fn project(basis: &Mat<f64>, matrix: &Mat<f64>) -> Mat<f64> {
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
