//! Predicts and updates an unscented Kalman filter for strongly nonlinear models (`Unscented`):
//! transition and observation are functions, evaluated at sigma points. Used by the baseline filter
//! of a bearing and by benchmarks.
#![expect(
    clippy::range_plus_one,
    reason = "an inclusive range carries a flag that keeps its loop from being unrolled"
)]

use nalgebra::{RowSVector, SVector};

use crate::error::Error;
use crate::kalman::gaussian::{Gaussian, factor};
use crate::kalman::innovation::{Gate, Innovation};
use crate::kalman::transition::ProcessNoise;
use crate::kalman::update;

/// Where the sigma points lie and how they are weighed.
///
/// `gamma^2 = alpha^2 (NX + kappa)`, points at `x` and `x +- gamma s_j` with
/// `P = S S'`. Weights as in Kerst et al. 2019 (`kappa = 0`), written with
/// the odd and even parts of what the points give,
/// `o_j = (y+ - y-) / 2`, `e_j = (y+ + y-) / 2 - y_0`:
/// mean `y_0 + m`, `m = sum e_j / gamma^2`; covariance
/// `sum (o_j o_j' + e_j e_j') / gamma^2 + (beta - alpha^2) m m'`.
/// That is the usual weighted sum term for term, but a sum of squares for
/// every `beta >= alpha^2`, and nothing large is subtracted from it in f32.
///
/// Source: Kerst et al. 2019, section IV; Wan and van der Merwe 2000.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unscented<const NX: usize> {
    gamma: f32,
    inverse_gamma: f32,
    /// `beta - alpha^2`.
    even_weight: f32,
}

impl<const NX: usize> Default for Unscented<NX> {
    /// `alpha = 1`, `beta = 2`, `kappa = 0`: points at `sqrt(NX)` standard deviations.
    fn default() -> Self {
        let n = NX as f32;
        let gamma = libm::sqrtf(n);
        Self {
            gamma,
            inverse_gamma: 1.0 / gamma,
            even_weight: 1.0,
        }
    }
}

impl<const NX: usize> Unscented<NX> {
    /// Spread `alpha` in [0.1, 1] (smaller ones drown the even parts in f32's
    /// rounding), `beta >= alpha^2` (2 for a Gaussian), `kappa > -NX`.
    ///
    /// # Errors
    /// `OutOfRange("alpha")`, `OutOfRange("beta")`, `OutOfRange("kappa")`.
    pub fn try_new(alpha: f32, beta: f32, kappa: f32) -> Result<Self, Error> {
        if !(0.1..=1.0).contains(&alpha) {
            return Err(Error::OutOfRange("alpha"));
        }
        if !(alpha * alpha..f32::INFINITY).contains(&beta) {
            return Err(Error::OutOfRange("beta"));
        }
        let n = NX as f32;
        if !(kappa > -n && kappa.is_finite()) {
            return Err(Error::OutOfRange("kappa"));
        }
        let gamma = alpha * libm::sqrtf(n + kappa);
        Ok(Self {
            gamma,
            inverse_gamma: 1.0 / gamma,
            even_weight: beta - alpha * alpha,
        })
    }

    /// Odd and even parts of `g` over the sigma points, and its value in the middle.
    #[inline]
    fn transform<const NY: usize>(
        &self,
        state: &SVector<f32, NX>,
        root: &[[f32; NX]; NX],
        g: impl Fn(&SVector<f32, NX>) -> SVector<f32, NY>,
    ) -> Transformed<NX, NY> {
        let middle = g(state).data.0[0];
        let half = 0.5 * self.inverse_gamma;
        let mut parts = Transformed {
            middle,
            odd: [[0.0; NX]; NY],
            even: [[0.0; NX]; NY],
        };
        for j in 0..NX {
            let (mut above, mut below) = (*state, *state);
            for i in 0..j + 1 {
                let step = self.gamma * root[j][i];
                above.data.0[0][i] += step;
                below.data.0[0][i] -= step;
            }
            let (above, below) = (g(&above), g(&below));
            for i in 0..NY {
                let (above, below) = (above.data.0[0][i], below.data.0[0][i]);
                parts.odd[i][j] = half * (above - below);
                parts.even[i][j] = half * ((above - middle[i]) + (below - middle[i]));
            }
        }
        parts
    }

    /// A-priori step: `x-`, `P-` of `f(x)` over the sigma points, plus `Q`.
    ///
    /// # Errors
    /// `NotPositive("covariance")` when `P` has no factor, `NotFinite("state")`
    /// when `f` gives no numbers; the posterior is untouched.
    pub fn predict(
        &self,
        posterior: &mut Gaussian<NX>,
        propagate: impl Fn(&SVector<f32, NX>) -> SVector<f32, NX>,
        noise: &ProcessNoise<NX>,
    ) -> Result<(), Error> {
        let root = square_root(posterior)?;
        let parts = self.transform(&posterior.state, &root, propagate);
        let mut next = *posterior;
        let mut m = [0.0; NX];
        for i in 0..NX {
            m[i] = parts.even_mean(i, self.inverse_gamma);
            next.state.data.0[0][i] = parts.middle[i] + m[i];
        }
        for j in 0..NX {
            for i in 0..j + 1 {
                let mut sum = 0.0;
                for k in 0..NX {
                    sum += parts.odd[i][k] * parts.odd[j][k] + parts.even[i][k] * parts.even[j][k];
                }
                next.upper[j][i] = sum + self.even_weight * m[i] * m[j] + noise.columns[j][i];
            }
        }
        commit(posterior, next)
    }

    /// Measurement update by `NY` channels with independent noise.
    ///
    /// The sigma points are drawn from the posterior as it is, so that after a
    /// prediction they contain the process noise. In the coordinates `z` of
    /// the square root, `x = x- + S z`, the channels read `y = y_mean + A z + v`,
    /// `A = [o_1 .. o_NX] / gamma`, where `v` has the covariance of the even parts
    /// plus `R`. That covariance is factored channel by channel, which
    /// leaves scalar channels with independent noise for [`update`]. For a
    /// sound sample the posterior is that of the usual
    /// `K = P_xy P_yy^-1`, `P+ = P - K P_yy K'`.
    ///
    /// `measurement`: `y`, [measurement units], NaN where missing; `variance`:
    /// the diagonal of `R`, [measurement units]^2.
    ///
    /// # Errors
    /// `NotPositive("covariance")` when `P` has no factor, `NotFinite("state")` when a number of
    /// the result is not finite; the posterior is untouched.
    ///
    /// Source: Kerst et al. 2019, section IV.
    pub fn update<const NY: usize>(
        &self,
        posterior: &mut Gaussian<NX>,
        observe: impl Fn(&SVector<f32, NX>) -> SVector<f32, NY>,
        measurement: &SVector<f32, NY>,
        variance: &SVector<f32, NY>,
        gates: &mut [Gate; NY],
    ) -> Result<[Innovation; NY], Error> {
        let root = square_root(posterior)?;
        let mut parts = self.transform(&posterior.state, &root, observe);
        let mut z = Gaussian::<NX> {
            state: SVector::zeros(),
            upper: [[0.0; NX]; NX],
        };
        for j in 0..NX {
            z.upper[j][j] = 1.0;
        }
        let mut innovations = [Innovation::INVALID; NY];
        let mut m = [0.0; NY];
        // Of the channels used so far, 0 for the others: row of L, 1/d, innovation; the
        // whitened row takes the place of the odd part.
        let mut lower = [[0.0; NY]; NY];
        let mut inverse = [0.0; NY];
        let mut nus = [0.0; NY];
        for i in 0..NY {
            m[i] = parts.even_mean(i, self.inverse_gamma);
            let mut nu = measurement.data.0[0][i] - (parts.middle[i] + m[i]);
            let mut d = self.even_covariance(&parts, &m, i, i) + variance.data.0[0][i];
            let mut scaled = [0.0; NY]; // L_ik d_k
            let mut row = parts.odd[i];
            for k in 0..i {
                let mut c = self.even_covariance(&parts, &m, i, k);
                for q in 0..k {
                    c -= scaled[q] * lower[k][q];
                }
                let l = c * inverse[k];
                d -= l * c;
                nu -= l * nus[k];
                for j in 0..NX {
                    row[j] -= l * parts.odd[k][j];
                }
                scaled[k] = c;
                lower[i][k] = l;
            }
            let a = RowSVector::from_fn(|_, j| row[j]);
            let predicted = (a * z.state)[0];
            innovations[i] = update(&mut z, &a, nu - predicted, d, &mut gates[i]);
            if innovations[i].used() && d > 0.0 {
                inverse[i] = 1.0 / d;
                parts.odd[i] = row;
                nus[i] = nu;
            } else {
                // Numbers that may be NaN leave no trace in the channels after.
                parts.even[i] = [0.0; NX];
                parts.odd[i] = [0.0; NX];
                lower[i] = [0.0; NY];
                m[i] = 0.0;
            }
        }
        let mut next = *posterior;
        let mut t = [[0.0; NX]; NX]; // rows of S P_z
        for i in 0..NX {
            for k in i..NX {
                next.state.data.0[0][i] += root[k][i] * z.state.data.0[0][k];
                for j in i..NX {
                    t[i][j] += root[k][i] * z.upper[k.max(j)][k.min(j)];
                }
            }
        }
        for j in 0..NX {
            for i in 0..j + 1 {
                let mut sum = 0.0;
                for k in j..NX {
                    sum += t[i][k] * root[k][j];
                }
                next.upper[j][i] = sum;
            }
        }
        commit(posterior, next)?;
        Ok(innovations)
    }

    /// Covariance of the even parts of two channels.
    #[inline]
    fn even_covariance<const NY: usize>(
        &self,
        parts: &Transformed<NX, NY>,
        m: &[f32; NY],
        i: usize,
        k: usize,
    ) -> f32 {
        let mut sum = 0.0;
        for j in 0..NX {
            sum += parts.even[i][j] * parts.even[k][j];
        }
        sum + self.even_weight * m[i] * m[k]
    }
}

/// Values of a function at the sigma points: `o_ij / gamma` and
/// `e_ij / gamma`, channel by channel.
struct Transformed<const NX: usize, const NY: usize> {
    middle: [f32; NY],
    odd: [[f32; NX]; NY],
    even: [[f32; NX]; NY],
}

impl<const NX: usize, const NY: usize> Transformed<NX, NY> {
    /// `m_i = sum_j e_ij / gamma^2`.
    #[inline]
    fn even_mean(&self, i: usize, inverse_gamma: f32) -> f32 {
        let mut sum = 0.0;
        for j in 0..NX {
            sum += self.even[i][j];
        }
        sum * inverse_gamma
    }
}

/// Columns of the upper triangular `S = U D^(1/2)`, `P = S S'`.
fn square_root<const NX: usize>(posterior: &Gaussian<NX>) -> Result<[[f32; NX]; NX], Error> {
    let mut root = factor(&posterior.upper).ok_or(Error::NotPositive("covariance"))?;
    for j in 0..NX {
        let scale = libm::sqrtf(root[j][j]);
        for i in 0..j {
            root[j][i] *= scale;
        }
        root[j][j] = scale;
    }
    Ok(root)
}

/// Replaces the posterior when every number of the next one is finite.
fn commit<const NX: usize>(posterior: &mut Gaussian<NX>, next: Gaussian<NX>) -> Result<(), Error> {
    let finite = next.state.iter().all(|x| x.is_finite())
        && (0..NX).all(|j| next.upper[j].iter().take(j + 1).all(|p| p.is_finite()));
    if !finite {
        return Err(Error::NotFinite("state"));
    }
    *posterior = next;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector1, Vector2};

    /// `x ~ N(1, 4)`, `y = x^2`, `r = 2`, `alpha = 1`, `beta = 2`: points at -1, 1, 3;
    /// `o = 4`, `e = 4`, `m = 4`, `y_mean = 5`, `A = 4 / 1`,
    /// `s = 16 + 16 + (2 - 1) 16 + 2 = 50`, where a Gaussian has
    /// `4 m^2 P + 2 P^2 + r = 50`, `P_xy = 2 * 4 = 8`. With `y = 10`:
    /// `x+ = 1 + 8 / 50 * 5 = 1.8`, `P+ = 4 - 64 / 50 = 2.72`.
    #[test]
    fn square_by_hand() {
        let mut posterior = Gaussian::independent(Vector1::new(1.0), &Vector1::new(4.0)).unwrap();
        let result = Unscented::default()
            .update(
                &mut posterior,
                |x| Vector1::new(x[0] * x[0]),
                &Vector1::new(10.0),
                &Vector1::new(2.0),
                &mut [Gate::open()],
            )
            .unwrap();
        assert!((result[0].variance - 50.0).abs() < 1e-4);
        assert!((result[0].value - 5.0).abs() < 1e-5);
        assert!((posterior.state[0] - 1.8).abs() < 1e-5);
        assert!((posterior.covariance()[0] - 2.72).abs() < 1e-5);
    }

    /// The numbers of `update_by_hand` of the Kalman filter, a channel missing.
    #[test]
    fn linear_models_give_the_kalman_filter() {
        let p = nalgebra::Matrix2::new(4.0, 1.0, 1.0, 2.0);
        let mut posterior = Gaussian::try_new(Vector2::new(0.0, 1.0), &p).unwrap();
        let result = Unscented::default()
            .update(
                &mut posterior,
                |x| Vector2::new(x[0], 0.0),
                &Vector2::new(3.0, f32::NAN),
                &Vector2::new(1.0, 1.0),
                &mut [Gate::open(), Gate::open()],
            )
            .unwrap();
        assert!(result[0].used() && result[1] == Innovation::INVALID);
        assert!((posterior.state - Vector2::new(2.4, 1.6)).amax() < 1e-6);
        let expected = nalgebra::Matrix2::new(0.8, 0.2, 0.2, 1.8);
        assert!((posterior.covariance() - expected).amax() < 1e-5);
    }

    #[test]
    fn parameters_unfit_for_f32_are_refused() {
        let refused = |a, b, k| Unscented::<3>::try_new(a, b, k).unwrap_err();
        assert_eq!(refused(1e-3, 2.0, 0.0), Error::OutOfRange("alpha"));
        assert_eq!(refused(1.0, 0.5, 0.0), Error::OutOfRange("beta"));
        assert_eq!(refused(1.0, 2.0, -3.0), Error::OutOfRange("kappa"));
    }
}
