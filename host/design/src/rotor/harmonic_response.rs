//! Computes the steady harmonic response of the assembled rotor at one speed: complex amplitudes of
//! all degrees of freedom under unbalances, or under forces of one frequency.

use faer::linalg::solvers::Solve;
use faer::{Mat, c64};

use crate::rotor::RotorError;
use crate::rotor::beam_element::NODE;
use crate::rotor::fe_model::RotorModel;

/// A mass off the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unbalance {
    /// Node that it is at.
    pub node: usize,
    /// Mass times distance from the axis [kg m].
    pub moment_kg_m: f64,
    /// Angle from x at time 0 (rad).
    pub phase_rad: f64,
}

/// Amplitudes `X`, `q(t) = Re(X exp(i speed t))`, of all degrees of freedom.
///
/// `(K + i speed (C + speed G) - speed^2 M) X = F`, with
/// `F_x = m d speed^2 exp(i phase)` and `F_y = -i F_x`.
///
/// # Errors
/// [`RotorError::Resonance`] for an undamped rotor at its critical speed.
///
/// Source: Rezende et al. 2023, eq. (16).
pub fn unbalance_response(
    model: &RotorModel,
    speed_rad_s: f64,
    unbalances: &[Unbalance],
) -> Result<Vec<c64>, RotorError> {
    let mut force = Mat::<c64>::zeros(model.len(), 1);
    for unbalance in unbalances {
        let size = unbalance.moment_kg_m * speed_rad_s * speed_rad_s;
        let (sine, cosine) = unbalance.phase_rad.sin_cos();
        let x = c64::new(size * cosine, size * sine);
        force[(NODE * unbalance.node, 0)] += x;
        force[(NODE * unbalance.node + 1, 0)] += c64::new(x.im, -x.re);
    }
    forced_response(model, speed_rad_s, speed_rad_s, &force)
}

/// Amplitudes of all degrees of freedom at a speed under `force exp(i frequency t)`.
///
/// # Errors
/// [`RotorError::Resonance`] for an undamped rotor at its critical speed.
pub(crate) fn forced_response(
    model: &RotorModel,
    speed_rad_s: f64,
    frequency_rad_s: f64,
    force: &Mat<c64>,
) -> Result<Vec<c64>, RotorError> {
    let matrix = model.dynamic_stiffness(
        c64::new(0.0, frequency_rad_s),
        &model.turning_damping(speed_rad_s),
        &model.stiffness(speed_rad_s),
    )?;
    let factor = matrix.sp_lu().map_err(|_| RotorError::Resonance)?;
    let x = factor.solve(force);
    if x.norm_l2().is_finite() {
        Ok((0..model.len()).map(|i| x[(i, 0)]).collect())
    } else {
        Err(RotorError::Resonance)
    }
}
