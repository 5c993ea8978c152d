//! Computes the steady-state Kalman filter of a linear system: covariance of the prediction by the
//! discrete algebraic Riccati equation, gain, innovation covariance, and gains of fixed-lag
//! smoothing.

use faer::linalg::solvers::Solve;
use faer::{Mat, Scale};

/// Doublings after which the recursion has covered 2^64 samples.
const DOUBLINGS: usize = 64;

/// Relative change at which it has converged.
const TOLERANCE: f64 = 1e-12;

/// The covariance to which the filter's prediction converges:
///
/// `P = F P F' - F P H' (H P H' + R)^-1 H P F' + Q`
///
/// `transition` F: n x n; `observation` H: m x n; `process_noise` Q: n x n,
/// symmetric, >= 0; `measurement_noise`: diagonal of R, > 0. None when the
/// doubling does not converge: a state that is neither observed nor damped.
///
/// Structure-preserving doubling, `A_0 = F'`, `G_0 = H' R^-1 H`, `X_0 = Q`, with
/// `W = I + G X`: `A <- A W^-1 A`, `G <- G + A W^-1 G A'`,
/// `X <- X + A' X W^-1 A`. Step k holds what 2^k samples of the recursion give.
///
/// Source: Chu, Fan, Lin, Wang, Structure-preserving algorithms for periodic
/// discrete-time algebraic Riccati equations, Int. J. Control 77 (2004),
/// section 2; Bosmans et al. 2023, eq. (19).
pub fn steady_covariance(
    transition: &Mat<f64>,
    observation: &Mat<f64>,
    process_noise: &Mat<f64>,
    measurement_noise: &[f64],
) -> Option<Mat<f64>> {
    let n = transition.nrows();
    let weighted = Mat::from_fn(n, observation.nrows(), |i, k| {
        observation[(k, i)] / measurement_noise[k]
    });
    let mut a = transition.transpose().to_owned();
    let mut g = &weighted * observation;
    let mut x = process_noise.clone();
    let identity = Mat::<f64>::identity(n, n);
    for _ in 0..DOUBLINGS {
        let w = (&identity + &g * &x).partial_piv_lu();
        let (wa, wg) = (w.solve(&a), w.solve(&g));
        let grown = a.transpose() * &x * &wa;
        g = symmetric(&(&g + &a * wg * a.transpose()));
        a = &a * wa;
        x = symmetric(&(&x + &grown));
        let converged = (0..n).all(|i| grown[(i, i)].abs() <= TOLERANCE * x[(i, i)].abs());
        if !(0..n).all(|i| x[(i, i)].is_finite()) {
            return None;
        }
        if converged {
            return Some(x);
        }
    }
    None
}

/// `K = P H' (H P H' + R)^-1`, n x m, of the prediction's covariance P.
///
/// Source: Bosmans et al. 2023, eq. (20).
pub fn gain(covariance: &Mat<f64>, observation: &Mat<f64>, measurement_noise: &[f64]) -> Mat<f64> {
    let hp = observation * covariance;
    let s = innovation_covariance(&hp, observation, measurement_noise);
    s.partial_piv_lu().solve(hp).transpose().to_owned()
}

/// `S = H P H' + R`, m x m, of `hp` = `H P`.
pub fn innovation_covariance(
    hp: &Mat<f64>,
    observation: &Mat<f64>,
    measurement_noise: &[f64],
) -> Mat<f64> {
    let mut s = hp * observation.transpose();
    for (i, r) in measurement_noise.iter().enumerate() {
        s[(i, i)] += r;
    }
    s
}

/// Gains of the `lag` samples before the last on its innovation, the nearest first, and what
/// each takes from the covariance of such a sample:
///
/// `G_j = M_j H' S^-1`, `G_j S G_j'`, `M_j = P (F (I - K H))^j'`
///
/// `covariance` P and `gain` K: those of the steady filter.
///
/// Source: Anderson and Moore 1979, Optimal Filtering, section 7.3.
pub fn gains_before(
    transition: &Mat<f64>,
    observation: &Mat<f64>,
    covariance: &Mat<f64>,
    gain: &Mat<f64>,
    measurement_noise: &[f64],
    lag: usize,
) -> Vec<(Mat<f64>, Mat<f64>)> {
    let hp = observation * covariance;
    let s = innovation_covariance(&hp, observation, measurement_noise).partial_piv_lu();
    let closed = transition - transition * gain * observation;
    let mut m = covariance.clone();
    let next = || {
        m = &m * closed.transpose();
        let mh = &m * observation.transpose();
        let gain = s.solve(mh.transpose()).transpose().to_owned();
        let reduction = &gain * mh.transpose();
        (gain, reduction)
    };
    std::iter::repeat_with(next).take(lag).collect()
}

fn symmetric(m: &Mat<f64>) -> Mat<f64> {
    Scale(0.5) * (m + m.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::mat;

    #[test]
    fn a_random_walk_has_its_closed_form() {
        let (q, r) = (1e-9, 2.0);
        let p = steady_covariance(&mat![[1.0]], &mat![[1.0]], &mat![[q]], &[r]).unwrap();
        let expected = 0.5 * (q + f64::sqrt(q * q + 4.0 * q * r));
        assert!(
            (p[(0, 0)] / expected - 1.0).abs() < 1e-9,
            "{} {expected}",
            p[(0, 0)]
        );
        let k = gain(&p, &mat![[1.0]], &[r]);
        assert!((k[(0, 0)] - p[(0, 0)] / (p[(0, 0)] + r)).abs() < 1e-15);
    }

    /// With the samples before as states of their own, the filter corrects them by itself.
    #[test]
    fn samples_before_are_corrected_as_by_a_filter_that_has_them_as_states() {
        const LAG: usize = 2;
        let f = mat![[1.0, 0.1, 0.0], [-0.4, 0.95, 0.2], [0.0, 0.0, 1.0]];
        let h = mat![[1.0, 0.0, 0.0], [0.5, -0.1, 0.0]];
        let (q, r) = ([1e-6, 1e-6, 1e-2], [1e-4, 3e-4]);
        let n = f.nrows();
        let grown = (1 + LAG) * n;
        let transition = Mat::from_fn(grown, grown, |i, j| match i.checked_sub(n) {
            Some(before) => f64::from(u8::from(before == j)),
            None if j < n => f[(i, j)],
            None => 0.0,
        });
        let observation = Mat::from_fn(2, grown, |i, j| if j < n { h[(i, j)] } else { 0.0 });
        let mut p = Mat::from_fn(grown, grown, |i, j| f64::from(u8::from(i == j)));
        let mut posterior = p.clone();
        for _ in 0..2000 {
            p = &transition * &posterior * transition.transpose();
            for (i, q) in q.iter().enumerate() {
                p[(i, i)] += q;
            }
            let k = gain(&p, &observation, &r);
            posterior = symmetric(&(&p - &k * &observation * &p));
        }
        let expected = gain(&p, &observation, &r);

        let q = Mat::from_fn(n, n, |i, j| if i == j { q[i] } else { 0.0 });
        let steady = steady_covariance(&f, &h, &q, &r).unwrap();
        let k = gain(&steady, &h, &r);
        let before = gains_before(&f, &h, &steady, &k, &r, LAG);
        assert_eq!(before.len(), LAG);
        let mut left = &steady - &k * &h * &steady;
        for (j, (gain, reduction)) in before.iter().enumerate() {
            left -= reduction;
            for i in 0..n {
                for c in 0..2 {
                    let found = gain[(i, c)] - expected[((j + 1) * n + i, c)];
                    assert!(found.abs() < 1e-9, "{j} {i} {c}: {found:e}");
                }
            }
        }
        for i in 0..n {
            let expected = posterior[(LAG * n + i, LAG * n + i)];
            assert!((left[(i, i)] / expected - 1.0).abs() < 1e-8, "{i}");
            // The force is known better for it, by far.
            assert!(i < 2 || left[(i, i)] < 0.7 * posterior[(i, i)]);
        }
    }

    #[test]
    fn the_solution_satisfies_the_equation() {
        // Position, speed and an unknown force of a lightly damped oscillator.
        let f = mat![[1.0, 0.01, 0.0], [-0.4, 0.999, 0.02], [0.0, 0.0, 1.0]];
        let h = mat![[1.0, 0.0, 0.0], [-40.0, -0.1, 2.0]];
        let q = mat![[1e-8, 0.0, 0.0], [0.0, 1e-6, 0.0], [0.0, 0.0, 1e-3]];
        let r = [1e-4, 0.3];
        let p = steady_covariance(&f, &h, &q, &r).unwrap();
        let k = gain(&p, &h, &r);
        let posterior = &p - &k * &h * &p;
        let again = &f * posterior * f.transpose() + &q;
        for i in 0..3 {
            for j in 0..3 {
                let scale = (p[(i, i)] * p[(j, j)]).sqrt();
                assert!((again[(i, j)] - p[(i, j)]).abs() < 1e-10 * scale);
            }
        }
    }

    #[test]
    fn what_is_never_observed_is_refused() {
        let f = mat![[1.0, 0.0], [0.0, 1.0]];
        let q = mat![[1.0, 0.0], [0.0, 1.0]];
        assert!(steady_covariance(&f, &mat![[1.0, 0.0]], &q, &[1.0]).is_none());
    }
}
