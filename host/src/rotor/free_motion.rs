//! What a rotor does after the forces have set in.

use std::f64::consts::TAU;

use faer::{Mat, Scale};

use super::model::RotorModel;
use super::reduction::Reduced;
use crate::exponential::exponential;

/// From one moment to the next that is summed, in turns.
const STEP: f64 = 0.01;

/// Doublings of the time that is summed: 82 turns, so that undamped motion has an end.
const DOUBLINGS: usize = 13;

/// `sum_k z_k z_k'` over the free motion `z_k = z(k dt)` of a rotor that starts from rest under
/// forces whose steady motion is `whirls`, pairs in phase and a quarter turn later.
///
/// The free motion is that which begins as minus the whirl. With `x = (z, z')` and `F = exp(A dt)`:
/// `X <- X + F X F'`, `F <- F F`, each of which doubles the time.
///
/// Source: Smith, Matrix equation XA + BX = C, SIAM J. Appl. Math. 16 (1968).
pub(super) fn free_motion(
    model: &RotorModel,
    fine: &Reduced,
    speed_rad_s: f64,
    whirls: &[Mat<f64>],
) -> Mat<f64> {
    let r = fine.len();
    let mut f = exponential(&fine.motion(model, speed_rad_s, STEP * TAU / speed_rad_s, 0));
    let coordinates = |v: &Mat<f64>| fine.basis.transpose() * (&model.mass * v);
    let mut x = Mat::<f64>::zeros(2 * r, 2 * r);
    for pair in whirls.chunks_exact(2) {
        let (real, imaginary) = (coordinates(&pair[0]), coordinates(&pair[1]));
        // The force may set in at any angle of the shaft: two of them span the rest.
        for (at, quarter_on) in [
            (&real, Scale(-1.0) * &imaginary),
            (&imaginary, real.clone()),
        ] {
            let begin = Mat::from_fn(2 * r, 1, |i, _| match i.checked_sub(r) {
                None => at[(i, 0)],
                Some(i) => speed_rad_s * quarter_on[(i, 0)],
            });
            x += &begin * begin.transpose();
        }
    }
    for _ in 0..DOUBLINGS {
        x = &x + &f * &x * f.transpose();
        f = &f * &f;
    }
    x.submatrix(0, 0, r, r).to_owned()
}
