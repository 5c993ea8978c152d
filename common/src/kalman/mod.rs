//! Predicts and updates an augmented Kalman filter in `f32`, linear or extended: `predict` by the
//! transition, then `update` by one scalar channel after the other, with a gate. Nonlinear
//! transitions and observations are given as traits.
//!
//! A step is `predict`, then one scalar [`update`] for each channel, or
//! [`update_all`].
//!
//! ```
//! use loadtwin_common::kalman::gaussian::Gaussian;
//! use loadtwin_common::kalman::innovation::Gate;
//! use loadtwin_common::kalman::{predict, update};
//! use loadtwin_common::kalman::transition::{ProcessNoise, RandomWalk, Transition};
//! use nalgebra::{Matrix2, RowVector2, Vector2};
//!
//! // A rotor of 0.5 kg m^2 sampled at 1 kHz: speed [rad/s], unknown torque [Nm].
//! let transition = Transition::<2, 1>::try_new(&Matrix2::new(1.0, 0.002, 0.0, 1.0), RandomWalk)?;
//! let noise = ProcessNoise::independent(&Vector2::new(1e-8, 0.1))?;
//! let mut posterior = Gaussian::independent(Vector2::new(0.0, 0.0), &Vector2::new(1.0, 100.0))?;
//! let mut gate = Gate::open();
//! for k in 1..=1000 {
//!     let speed = 0.02 * k as f32; // 20 rad/s^2: a torque of 10 Nm
//!     predict(&mut posterior, &transition, &noise);
//!     let nu = speed - posterior.state[0];
//!     update(&mut posterior, &RowVector2::new(1.0, 0.0), nu, 1e-6, &mut gate);
//! }
//! assert!((posterior.load::<1>()[0] - 10.0).abs() < 0.01);
//! # Ok::<(), loadtwin_common::Error>(())
//! ```
#![expect(
    clippy::range_plus_one,
    reason = "an inclusive range carries a flag that keeps its loop from being unrolled"
)]

pub mod gaussian;
pub mod innovation;
pub mod scheduled_gain;
pub mod transition;
pub(crate) mod unroll;
pub mod unscented;

use nalgebra::{RowSVector, SVector};

use crate::error::Error;
use crate::kalman::gaussian::{Gaussian, symmetric_product};
use crate::kalman::innovation::{Gate, Innovation, Outcome};
use crate::kalman::transition::{INFLATION, LoadModel, ProcessNoise, Transition};
use crate::kalman::unroll::{UNROLLED, unroll};

/// A-priori step of the linear filter.
///
/// `x- = F x`, `P- = F P F' + Q`
///
/// A known input's increment is added to `posterior.state` before or after.
///
/// Source: Bosmans et al. 2023, eq. (9), (11).
#[inline]
pub fn predict<const NX: usize, const ND: usize, L: LoadModel<ND>>(
    posterior: &mut Gaussian<NX>,
    transition: &Transition<NX, ND, L>,
    noise: &ProcessNoise<NX>,
) {
    posterior.state = transition.propagate(&posterior.state);
    transition.propagate_covariance(posterior, noise);
}

/// A-priori step of states that stay what they are.
///
/// `x- = x`, `P- = P + Q`
///
/// Source: Kerst et al. 2019, eq. (16).
#[inline]
pub fn predict_constant<const NX: usize>(posterior: &mut Gaussian<NX>, noise: &ProcessNoise<NX>) {
    for j in 0..NX {
        for i in 0..j + 1 {
            posterior.upper[j][i] += noise.columns[j][i];
        }
        posterior.upper[j][j] += posterior.upper[j][j] * INFLATION;
    }
}

/// A nonlinear state evolution with loads in the last `ND` states.
pub trait NonlinearTransition<const NX: usize, const ND: usize> {
    /// How the loads evolve.
    type Load: LoadModel<ND>;

    /// `f(x)`, the state one sample later.
    fn propagate(&self, state: &SVector<f32, NX>) -> SVector<f32, NX>;

    /// The Jacobian `df/dx` at `state`.
    fn linearize_at(&self, state: &SVector<f32, NX>) -> Transition<NX, ND, Self::Load>;
}

/// A-priori step of the extended filter.
///
/// `x- = f(x)`, `P- = F P F' + Q` with `F = df/dx` at `x`
///
/// # Errors
/// `NotFinite("state")` when `f(x)` is not finite, `NotFinite("transition")` when `F` is not; the
/// posterior is untouched.
///
/// Source: Bosmans et al. 2023, eq. (8), (9), (11).
#[inline]
pub fn predict_extended<const NX: usize, const ND: usize, M: NonlinearTransition<NX, ND>>(
    posterior: &mut Gaussian<NX>,
    model: &M,
    noise: &ProcessNoise<NX>,
) -> Result<(), Error> {
    let next = model.propagate(&posterior.state);
    if !next.iter().all(|x| x.is_finite()) {
        return Err(Error::NotFinite("state"));
    }
    let transition = model.linearize_at(&posterior.state);
    if !transition.is_finite() {
        return Err(Error::NotFinite("transition"));
    }
    posterior.state = next;
    transition.propagate_covariance(posterior, noise);
    Ok(())
}

/// Share of the prior variance below which f32 cannot resolve what a channel
/// adds: some hundred roundings.
const RESOLUTION: f32 = 1.0 / (1u32 << 16) as f32;

/// Measurement update by one scalar channel.
///
/// `s = h P h' + r`, `k = P h' / s`, `x+ = x + k nu`, `P+ = P - k s k'`
///
/// `row`: `h`, 1 x NX; `innovation`: `nu = y - h(x)`, [measurement
/// unit]; `variance`: `r`, [measurement unit]^2. NaN or infinity in any of them, or
/// `r < 0`, leaves the posterior untouched and is reported.
///
/// `r` is raised to `RESOLUTION` of `sum h_i^2 P_ii`: a better channel
/// would cancel more digits of `P` than f32 has. It then takes its full
/// effect over a few samples instead of one.
///
/// Source: Bosmans et al. 2023, eq. (11)-(14).
// Inlined into a loop over channels, P is kept in registers across them and
// spilled: 40 instructions more for each channel of 6 states.
#[inline(never)]
pub fn update<const NX: usize>(
    posterior: &mut Gaussian<NX>,
    row: &RowSVector<f32, NX>,
    innovation: f32,
    variance: f32,
    gate: &mut Gate,
) -> Innovation {
    let mut h = [0.0; NX];
    for i in 0..NX {
        h[i] = row.data.0[i][0];
    }
    let p = &mut posterior.upper;
    let (w, scale) = symmetric_product(p, &h);
    let floor = scale * RESOLUTION;
    let mut r = variance;
    if r < floor {
        if r < 0.0 {
            return Innovation::INVALID;
        }
        r = floor;
    }
    let mut s = r;
    for i in 0..NX {
        s += h[i] * w[i];
    }
    let inverse = 1.0 / s;
    let nis = innovation * innovation * inverse;
    // 1/s is positive for every finite s > 0; both fail on NaN.
    if !(inverse > 0.0 && nis <= f32::MAX) {
        return Innovation::INVALID;
    }
    let innovation_with = |outcome| Innovation {
        value: innovation,
        variance: s,
        nis,
        outcome,
    };
    if !gate.accepts(nis) {
        return innovation_with(Outcome::Gated);
    }
    if NX <= UNROLLED {
        unroll!(j in 0..NX {
            let k_j = w[j] * inverse;
            posterior.state.data.0[0][j] += k_j * innovation;
            for i in 0..j + 1 {
                p[j][i] -= w[i] * k_j;
            }
        });
        return innovation_with(Outcome::Used);
    }
    for (x, w) in posterior.state.iter_mut().zip(&w) {
        *x += w * inverse * innovation;
    }
    // Two columns at a time; what the first gets below the diagonal is not used.
    let (pairs, last) = p.as_chunks_mut::<2>();
    for (n, [first, second]) in pairs.iter_mut().enumerate() {
        let (k0, k1) = (w[2 * n % NX] * inverse, w[(2 * n + 1) % NX] * inverse);
        let columns = first.iter_mut().zip(second);
        for ((p0, p1), w) in columns.zip(&w).take(2 * n + 2) {
            *p0 -= w * k0;
            *p1 -= w * k1;
        }
    }
    if let [last] = last {
        let k = w[NX - 1] * inverse;
        for (p, w) in last.iter_mut().zip(&w) {
            *p -= w * k;
        }
    }
    innovation_with(Outcome::Used)
}

/// A nonlinear set of `NY` channels over `NX` states.
pub trait Observation<const NX: usize, const NY: usize> {
    /// Prediction `h_i(x)` of a channel and its gradient `dh_i/dx` at `state`;
    /// `channel < NY`.
    fn linearize_at(&self, channel: usize, state: &SVector<f32, NX>) -> (f32, RowSVector<f32, NX>);
}

/// Measurement update by all channels in order, each linearised at the state
/// that the channels before it left.
///
/// `measurement`: `y`, [measurement units], NaN where missing; `variance`:
/// the diagonal of `R`, [measurement units]^2.
///
/// Source: Bosmans et al. 2023, eq. (10)-(14), one row at a time.
#[inline]
pub fn update_all<const NX: usize, const NY: usize, O: Observation<NX, NY>>(
    posterior: &mut Gaussian<NX>,
    observation: &O,
    measurement: &SVector<f32, NY>,
    variance: &SVector<f32, NY>,
    gates: &mut [Gate; NY],
) -> [Innovation; NY] {
    let mut innovations = [Innovation::INVALID; NY];
    for i in 0..NY {
        let (prediction, row) = observation.linearize_at(i, &posterior.state);
        let nu = measurement.data.0[0][i] - prediction;
        innovations[i] = update(posterior, &row, nu, variance.data.0[0][i], &mut gates[i]);
    }
    innovations
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kalman::transition::{GaussMarkov, Harmonic, RandomWalk};
    use nalgebra::{Matrix2, Matrix3, RowVector2, SMatrix, Vector2, Vector3};

    /// Position and speed, `P = [[4, 1], [1, 2]]`, position measured as 3 with `r = 1`.
    ///
    /// `s = 5`, `k = (0.8, 0.2)`, `x+ = (2.4, 1.6)`, `P+ = P - k s k' = [[0.8, 0.2], [0.2, 1.8]]`.
    #[test]
    fn update_by_hand() {
        let p = Matrix2::new(4.0, 1.0, 1.0, 2.0);
        let mut posterior = Gaussian::try_new(Vector2::new(0.0, 1.0), &p).unwrap();
        let row = RowVector2::new(1.0, 0.0);
        let result = update(&mut posterior, &row, 3.0, 1.0, &mut Gate::open());
        assert_eq!(
            (result.value, result.variance, result.outcome),
            (3.0, 5.0, Outcome::Used)
        );
        assert!((result.nis - 1.8).abs() < 1e-6);
        assert!((posterior.state - Vector2::new(2.4, 1.6)).amax() < 1e-6);
        assert!((posterior.covariance() - Matrix2::new(0.8, 0.2, 0.2, 1.8)).amax() < 1e-6);
    }

    /// `F = [[1, 0.5], [0, 1]]`, `P = [[4, 1], [1, 2]]`, `Q = diag(0.1, 0.2)`:
    /// `F P F' = [[4 + 1 + 0.5, 1 + 1], [2, 2]]`.
    #[test]
    fn predict_by_hand() {
        let p = Matrix2::new(4.0, 1.0, 1.0, 2.0);
        let mut posterior = Gaussian::try_new(Vector2::new(1.0, 2.0), &p).unwrap();
        let f = Matrix2::new(1.0, 0.5, 0.0, 1.0);
        let noise = ProcessNoise::independent(&Vector2::new(0.1, 0.2)).unwrap();
        let transition = Transition::<2, 1>::try_new(&f, RandomWalk).unwrap();
        predict(&mut posterior, &transition, &noise);
        assert!((posterior.state - Vector2::new(2.0, 2.0)).amax() < 1e-6);
        // Inflated by 1e-6 of 5.6.
        assert!((posterior.covariance() - Matrix2::new(5.6, 2.0, 2.0, 2.2)).amax() < 7e-6);
    }

    /// Each load model acts as its matrix `F_d` would in a dense `F P F' + Q`.
    #[test]
    fn load_models_equal_their_matrix() {
        fn check<L: LoadModel<2> + Copy>(load_model: L, f_d: Matrix2<f32>) {
            let mut f = SMatrix::<f32, 3, 3>::zeros();
            f.row_mut(0).copy_from_slice(&[0.9, 0.3, -0.2]);
            let transition = Transition::<3, 2, L>::try_new(&f, load_model).unwrap();
            f.fixed_view_mut::<2, 2>(1, 1).copy_from(&f_d);
            let p = Matrix3::new(3.0, 0.5, -0.4, 0.5, 2.0, 0.3, -0.4, 0.3, 1.0);
            let q = Matrix3::new(0.2, 0.1, 0.0, 0.1, 0.3, 0.0, 0.0, 0.0, 0.1);
            let x = Vector3::new(1.0, -2.0, 3.0);
            let mut posterior = Gaussian::try_new(x, &p).unwrap();
            predict(
                &mut posterior,
                &transition,
                &ProcessNoise::try_new(&q).unwrap(),
            );
            assert!((posterior.state - f * x).amax() < 1e-5);
            assert!((posterior.covariance() - (f * p * f.transpose() + q)).amax() < 1e-5);
        }
        check(RandomWalk, Matrix2::identity());
        let e = libm::expf(-0.1);
        check(
            GaussMarkov::try_new([0.01, f32::INFINITY], 0.001).unwrap(),
            Matrix2::new(e, 0.0, 0.0, 1.0),
        );
        let (c, s) = (libm::cosf(0.4), libm::sinf(0.4));
        check(Harmonic::try_new(0.4).unwrap(), Matrix2::new(c, -s, s, c));
    }

    #[test]
    fn what_is_not_a_number_leaves_the_belief_untouched() {
        let p = Matrix2::new(4.0, 1.0, 1.0, 2.0);
        let posterior = Gaussian::try_new(Vector2::new(0.0, 1.0), &p).unwrap();
        let row = RowVector2::new(1.0, 0.5);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for (row, nu, r) in [
                (RowVector2::new(bad, 0.0), 1.0, 1.0),
                (row, bad, 1.0),
                (row, 1.0, bad),
                (row, 1.0, -1.0),
            ] {
                let mut same = posterior;
                let result = update(&mut same, &row, nu, r, &mut Gate::open());
                assert_eq!(result, Innovation::INVALID);
                assert_eq!(same, posterior);
            }
        }
    }

    #[test]
    fn configurations_that_make_no_sense_are_refused() {
        let x = Vector2::zeros();
        let refused = |p| Gaussian::try_new(x, &p).unwrap_err();
        assert_eq!(
            refused(Matrix2::new(1.0, 2.0, 2.0, 1.0)),
            Error::NotPositive("covariance")
        );
        assert_eq!(
            refused(Matrix2::new(1.0, 0.2, 0.1, 1.0)),
            Error::NotSymmetric("covariance")
        );
        assert_eq!(
            refused(Matrix2::repeat(f32::NAN)),
            Error::NotFinite("covariance")
        );
        assert_eq!(
            Transition::<2, 1>::try_new(&Matrix2::new(1.0, 0.0, 0.1, 1.0), RandomWalk),
            Err(Error::OutOfRange("transition"))
        );
        assert_eq!(
            ProcessNoise::independent(&Vector2::new(-1.0, 1.0)),
            Err(Error::NotPositive("process_noise"))
        );
    }
}
