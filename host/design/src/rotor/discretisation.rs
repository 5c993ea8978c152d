//! Discretises the reduced rotor exactly over one sample, for forces that are held or turn with the
//! shaft. Transforms the result to the coordinates of the filter: modal displacements, their change
//! in a sample, forces.

use faer::linalg::solvers::Solve;
use faer::{Mat, Scale};

use crate::rotor::modal_truncation::ModalModel;
use crate::rotor::undamped_mode_reduction::motion;
use loadtwin_math::exponential::exponential;

/// Smallest part of a mode's speed that must appear in its next displacement.
const LEAST_VISIBLE: f64 = 1e-6;

/// `z+ = z + e`, `e+ = e + D (z, e, s)`, `s+ = R s`, and how to come there from
/// `(z, z', s)`.
#[derive(Clone, Debug)]
pub struct DiscreteModel {
    /// `D`, modes x states.
    pub dense: Mat<f64>,
    /// `T`, `(z, e, s) = T (z, z', s)`.
    pub coordinates: Mat<f64>,
    /// The whole transition in the coordinates of the filter.
    pub transition: Mat<f64>,
}

/// `[A_D B_D]`, 2 r x (2 r + m), the upper rows of `exp([A B; 0 W] dt)`: exact for
/// forces that are held over a sample, and for pairs that turn with the shaft within it.
///
/// Source: Van Loan, IEEE Trans. Autom. Control 23 (1978); Rezende et al. 2023,
/// eq. (5), (6), whose `A^-1` needs no inverse here.
pub(crate) fn held(rotor: &ModalModel, dt_s: f64) -> Mat<f64> {
    let (r, m) = (rotor.input.nrows(), rotor.input.ncols());
    let n = 2 * r;
    let mut a = motion(&rotor.stiffness, &rotor.damping, dt_s, m);
    for j in 0..m {
        for i in 0..r {
            a[(r + i, n + j)] = rotor.input[(i, j)] * dt_s;
        }
        for i in 0..m {
            a[(n + i, n + j)] = rotor.turning[(i, j)] * dt_s;
        }
    }
    let e = exponential(&a);
    Mat::from_fn(n, n + m, |i, j| e[(i, j)])
}

/// The filter's coordinates for `held` = `[A_D B_D]` and forces that move by `R`.
///
/// `e = (A_11 - I) z + A_12 z' + B_1 s`, so that
/// `e+ = (A_11 - I)(z + e) + A_12 (A_21 z + A_22 z' + B_2 s) + B_1 R s` = `e + D (z, e, s)` with
/// `z' = A_12^-1 (e - (A_11 - I) z - B_1 s)`.
///
/// None where a mode is sampled at a multiple of half its period, so that its
/// speed is not observable in its displacements.
pub fn discrete(held: &Mat<f64>, moved: &Mat<f64>) -> Option<DiscreteModel> {
    let m = moved.nrows();
    let n = held.nrows();
    let r = n / 2;
    let part = |i: usize, j: usize, rows: usize, columns: usize| {
        held.submatrix(i, j, rows, columns).to_owned()
    };
    let identity = Mat::<f64>::identity(r, r);
    let (a11, a12, b1) = (
        part(0, 0, r, r) - &identity,
        part(0, r, r, r),
        part(0, n, r, m),
    );
    let (a21, a22, b2) = (part(r, 0, r, r), part(r, r, r, r), part(r, n, r, m));
    let largest = (0..r).map(|i| a12[(i, i)].abs()).fold(0.0, f64::max);
    if !(0..r).all(|i| a12[(i, i)].abs() > LEAST_VISIBLE * largest) {
        return None;
    }
    // A_12 A_22 A_12^-1, solved from the right.
    let carried = a12
        .transpose()
        .partial_piv_lu()
        .solve((&a12 * &a22).transpose())
        .transpose()
        .to_owned();
    let d_z = &a11 + &a12 * &a21 - &carried * &a11;
    let d_e = &a11 + &carried - &identity;
    let d_s = &a12 * &b2 - &carried * &b1 + &b1 * moved;
    let states = n + m;
    let dense = Mat::from_fn(r, states, |i, j| match j {
        _ if j < r => d_z[(i, j)],
        _ if j < n => d_e[(i, j - r)],
        _ => d_s[(i, j - n)],
    });
    let mut coordinates = Mat::<f64>::identity(states, states);
    let mut transition = Mat::<f64>::zeros(states, states);
    for i in 0..r {
        for j in 0..states {
            coordinates[(r + i, j)] = match j {
                _ if j < r => a11[(i, j)],
                _ if j < n => a12[(i, j - r)],
                _ => b1[(i, j - n)],
            };
            transition[(r + i, j)] = dense[(i, j)];
        }
        transition[(r + i, r + i)] += 1.0;
        transition[(i, i)] = 1.0;
        transition[(i, r + i)] = 1.0;
    }
    for i in 0..m {
        for j in 0..m {
            transition[(n + i, n + j)] = moved[(i, j)];
        }
    }
    Some(DiscreteModel {
        dense,
        coordinates,
        transition,
    })
}

/// `R`: pairs that turn by `angle_rad` a sample, the others at rest.
pub fn force_transition(turning: &[bool], angle_rad: f64) -> Mat<f64> {
    let m = 2 * turning.len();
    let mut r = Mat::<f64>::identity(m, m);
    for (k, turns) in turning.iter().enumerate() {
        if *turns {
            let (sine, cosine) = angle_rad.sin_cos();
            let i = 2 * k;
            r[(i, i)] = cosine;
            r[(i, i + 1)] = -sine;
            r[(i + 1, i)] = sine;
            r[(i + 1, i + 1)] = cosine;
        }
    }
    r
}

/// `T A T'`, symmetric.
pub fn force_rotation(t: &Mat<f64>, a: &Mat<f64>) -> Mat<f64> {
    let turned = t * a * t.transpose();
    Scale(0.5) * (&turned + turned.transpose())
}
