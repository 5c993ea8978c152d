//! Computes the motion of a reduced rotor at constant speed, sample by sample, under given forces
//! that are linear between samples (first-order hold). Used by tests against another program.

use faer::Mat;

use crate::rotor::fe_model::RotorModel;
use crate::rotor::undamped_mode_reduction::Reduced;
use loadtwin_math::exponential::exponential;

/// A reduced rotor under given forces, exact for forces that run straight from
/// one sample to the next.
///
/// With `x = (z, z')`: `x+ = F x + G0 f + G1 (f+ - f)`, the upper rows of
/// `exp([A B 0; 0 0 I; 0 0 0] dt)`.
///
/// Source: Franklin, Powell, Workman, Digital Control of Dynamic Systems (1998),
/// section 6.3.2; Van Loan, IEEE Trans. Autom. Control 23 (1978).
#[derive(Clone, Debug)]
pub struct TimeResponse {
    transition: Mat<f64>,
    held: Mat<f64>,
    ramp: Mat<f64>,
    basis: Mat<f64>,
    state: Mat<f64>,
    force: Mat<f64>,
}

impl TimeResponse {
    /// At rest, with steps of `dt_s` (s) under `forces`, rows over the degrees of freedom.
    pub fn new(
        model: &RotorModel,
        reduced: &Reduced,
        speed_rad_s: f64,
        forces: &[Vec<f64>],
        dt_s: f64,
    ) -> Self {
        let (r, m) = (reduced.len(), forces.len());
        let n = 2 * r;
        let mut a = reduced.motion(model, speed_rad_s, dt_s, 2 * m);
        for (j, force) in forces.iter().enumerate() {
            for (i, value) in reduced.row(force).iter().enumerate() {
                a[(r + i, n + j)] = value * dt_s;
            }
            // In steps: the ramp rises by one over a sample.
            a[(n + j, n + m + j)] = 1.0;
        }
        let e = exponential(&a);
        Self {
            transition: Mat::from_fn(n, n, |i, j| e[(i, j)]),
            held: Mat::from_fn(n, m, |i, j| e[(i, n + j)]),
            ramp: Mat::from_fn(n, m, |i, j| e[(i, n + m + j)]),
            basis: reduced.basis.clone(),
            state: Mat::zeros(n, 1),
            force: Mat::zeros(m, 1),
        }
    }

    /// Sets the force of the present sample (N); 0 at the start.
    pub fn set_force(&mut self, force: &[f64]) {
        for (i, f) in force.iter().enumerate() {
            self.force[(i, 0)] = *f;
        }
    }

    /// One sample on, to the force `next` (N).
    pub fn step(&mut self, next: &[f64]) {
        let next = Mat::from_fn(next.len(), 1, |i, _| next[i]);
        let change = &next - &self.force;
        self.state =
            &self.transition * &self.state + &self.held * &self.force + &self.ramp * change;
        self.force = next;
    }

    /// Displacements and rotations of all nodes [m, rad].
    pub fn displacements(&self) -> Vec<f64> {
        let z = self.state.subrows(0, self.basis.ncols());
        let q = &self.basis * z;
        (0..q.nrows()).map(|i| q[(i, 0)]).collect()
    }
}
