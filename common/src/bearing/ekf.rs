//! Estimates loads, preload, gauge biases, ball-pass phases and cage slips of a bearing under one
//! hypothesis of the phases (`JointEkf`), by an extended Kalman filter: prediction by one block of
//! 10 ms, then an update with the harmonics of each gauge's strain. On a rig it is conditioned on
//! known loads.
//!
//! States: phases of ball passing `theta_r` (rad) and slips `s_r` of both rows,
//! loads (kN), preload (um), biases of the bulk strains [um/m].
//!
//! `theta+ = theta + Phi (pace + s)`, `pace` by the loaded contact angle; slips, loads
//! and biases return to what is expected of them, the preload walks. The local strain of gauge g is
//! `sum_n Re(C_n e^(i n Phi))`, `C_n = sum_r e^(i n (theta_r - N psi_g)) S_nr f_r`,
//! with the features `f_r` of the load ([`crate::bearing::contact::Features`]); its bulk
//! strain is linear in loads and features.
//!
//! Sources: Kerst et al. 2019, eq. (1)-(3), in another form: here all gauges share
//! the rows' phases.

mod hypothesis_change;

use nalgebra::{RowSVector, SVector};
use serde::{Deserialize, Serialize};

use crate::bearing::bias_prior::{BiasPrior, Hold, decorrelate_state, propagate_bias};
use crate::bearing::contact::{Contacts, Equilibrium, Features, INPUTS};
use crate::bearing::harmonic_block::HarmonicBlock;
use crate::bearing::{BASIS, FEATURES, GAUGES, GaugeModel, HARMONICS, LOADS, ROWS, Tuning};
use crate::kalman;
use crate::kalman::gaussian::Gaussian;
use crate::kalman::innovation::Gate;
use crate::signal::phase::wrap_rad;
use crate::signal::trigonometry::sin_cos;

/// States.
pub const NX: usize = 2 * ROWS + INPUTS + GAUGES;
/// Place of the first load.
pub const LOAD_INDEX: usize = 2 * ROWS;
/// Place of the preload.
pub const PRELOAD_INDEX: usize = LOAD_INDEX + LOADS;
/// Place of the first bias.
pub const BIAS_INDEX: usize = PRELOAD_INDEX + 1;

/// Variance below which a phase is known [rad^2]: 0.32 rad, a twentieth of a ball spacing.
pub(crate) const KNOWN_PHASE: f32 = 0.1;

/// Part of the square of local strain not explained that counts as error of the bulk strain. None,
/// all and twice it cost accuracy in `Fx` on the development bearings (docs/lab/tried.md).
const UNEXPLAINED_SHARE: f32 = 0.5;

/// Correlation of the gauges' drift: they sit on one ring and warm together. Chosen on the
/// development bearings: with a 2.5 times slower drift of the differences `Fy` errs by 410 N
/// (docs/lab/tried.md).
pub(crate) const DRIFT_CORRELATION: f32 = 0.94;

/// Variance of a load that is known [kN^2]: 0.1 N, far below the error of a reference.
const KNOWN_VARIANCE: f32 = 1e-8;

/// Innovation of one gauge in one block, for one posterior.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct BlockInnovation {
    /// Mean normalised innovation squared of the rows that were used.
    pub nis: f32,
    /// Innovation of the mean strain [um/m] and its variance.
    pub mean: (f32, f32),
    /// Root mean square of the local strain, read and predicted [um/m].
    pub local: (f32, f32),
    /// Mean square of the innovation of the local strain, for one sample ((um/m)^2).
    pub left: f32,
    /// Normalised innovation squared, the sum over the rows.
    ///
    /// Errors of the model last for many blocks and are reported larger for that, so that the
    /// determinant of the innovations' covariance, the other part of the likelihood, would outweigh
    /// them: the hypothesis with the more uncertain rows would win.
    pub cost: f32,
}

/// One posterior about phases, loads and biases.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointEkf {
    /// Mean and covariance of the states.
    pub gaussian: Gaussian<NX>,
    /// Equilibrium at the estimated loads.
    pub equilibrium: Equilibrium,
    /// Features at the estimated loads.
    pub features: Features,
    #[serde(with = "crate::matrix_serde")]
    linearised_at: SVector<f32, NX>,
}

impl JointEkf {
    /// A posterior that [`Self::initialise`] fills, so that it is made where it stays and not on
    /// the stack.
    pub fn zeroed() -> Self {
        Self {
            gaussian: Gaussian {
                state: SVector::zeros(),
                upper: [[0.0; NX]; NX],
            },
            equilibrium: Equilibrium::default(),
            features: Features::default(),
            linearised_at: SVector::zeros(),
        }
    }

    /// Starts with unknown phases, the expected loads and their covariance, and preload and biases
    /// of `offsets`; `rest`: the equilibrium at the expected loads.
    pub fn initialise(
        &mut self,
        tuning: &Tuning,
        contacts: &Contacts,
        rest: &Equilibrium,
        offsets: &BiasPrior,
    ) {
        let x = &mut self.gaussian.state;
        let p = &mut self.gaussian.upper;
        x.fill(0.0);
        p.as_flattened_mut().fill(0.0);
        let mut spread = |i: usize, std: f32| p[i][i] = std * std;
        for row in 0..ROWS {
            spread(row, 1.0);
            spread(ROWS + row, tuning.slip_std);
        }
        for (i, mean) in tuning.load_mean.iter().enumerate() {
            x[LOAD_INDEX + i] = *mean;
        }
        self.set_offsets(offsets);
        self.linearised_at = self.gaussian.state;
        self.inflate_loads(tuning, 1.0);
        self.equilibrium = *rest;
        for g in 0..GAUGES {
            self.update_features(contacts, g);
        }
    }

    /// The estimated loads (kN).
    pub fn loads(&self) -> [f32; LOADS] {
        let mut loads = [0.0; LOADS];
        for (i, load) in loads.iter_mut().enumerate() {
            *load = self.gaussian.state[LOAD_INDEX + i];
        }
        loads
    }

    /// Adds to the variance of one state; `i < NX`.
    pub fn inflate(&mut self, i: usize, variance: f32) {
        if let Some(p) = self
            .gaussian
            .upper
            .get_mut(i)
            .and_then(|column| column.get_mut(i))
        {
            *p += variance;
        }
    }

    /// Adds a share of the covariance of the expected loads.
    pub fn inflate_loads(&mut self, tuning: &Tuning, share: f32) {
        let l = &tuning.load_factor;
        for j in 0..LOADS {
            for i in 0..=j {
                let mut sum = 0.0;
                for k in 0..=i {
                    sum += l[i][k] * l[j][k];
                }
                self.gaussian.upper[LOAD_INDEX + j][LOAD_INDEX + i] += share * sum;
            }
        }
    }

    /// Conditions the state on known loads (kN; moments over the radius), with the preload at 0.
    pub fn condition_on_loads(&mut self, loads: &[f32; LOADS]) {
        let p = &mut self.gaussian.upper;
        for (i, load) in loads.iter().enumerate() {
            let i = LOAD_INDEX + i;
            self.gaussian.state[i] = *load;
            decorrelate_state(p, i);
            p[i][i] = KNOWN_VARIANCE;
        }
        // Nor may the preload take up what the gauges' model lacks.
        self.gaussian.state[PRELOAD_INDEX] = 0.0;
        decorrelate_state(p, PRELOAD_INDEX);
        p[PRELOAD_INDEX][PRELOAD_INDEX] = KNOWN_VARIANCE;
        self.linearised_at = self.gaussian.state;
    }

    /// Whether every number of it is finite.
    pub fn is_finite(&self) -> bool {
        (0..NX).all(|i| self.gaussian.state[i].is_finite() && self.gaussian.upper[i][i].is_finite())
            && self.equilibrium.position.iter().all(|z| z.is_finite())
    }

    /// One block later: `phase` (rad) passed in `dt_s`.
    pub fn predict(&mut self, tuning: &Tuning, phase: f32, dt_s: f32) {
        let x = &mut self.gaussian.state;
        let p = &mut self.gaussian.upper;
        let keep = 1.0 - (dt_s / tuning.slip_time_s).min(1.0);
        for row in 0..ROWS {
            let (theta, slip) = (row, ROWS + row);
            x[theta] = wrap_rad(x[theta] + phase * (self.equilibrium.pace[row] + x[slip]));
            // theta += phase s, then s *= keep: rows and columns of P.
            let cross = p[slip][theta];
            let mut column = [0.0; NX];
            for (j, entry) in column.iter_mut().enumerate() {
                *entry = p[slip.max(j)][slip.min(j)];
            }
            for j in 0..NX {
                if j != theta {
                    p[theta.max(j)][theta.min(j)] += phase * column[j];
                }
            }
            p[theta][theta] += phase * (2.0 * cross + phase * column[slip]);
            for j in 0..NX {
                if j != slip {
                    p[slip.max(j)][slip.min(j)] *= keep;
                }
            }
            p[slip][slip] *= keep * keep;
            p[slip][slip] += (1.0 - keep * keep) * tuning.slip_std * tuning.slip_std;
            p[theta][theta] += tuning.phase_walk * tuning.phase_walk * phase.abs();
            x[slip] *= keep;
        }
        let keep = 1.0 - (dt_s / tuning.load_time_s).min(1.0);
        for i in 0..LOADS {
            let l = LOAD_INDEX + i;
            x[l] = tuning.load_mean[i] + keep * (x[l] - tuning.load_mean[i]);
            for j in 0..NX {
                if j != l {
                    p[l.max(j)][l.min(j)] *= keep;
                }
            }
            p[l][l] *= keep * keep;
        }
        let share = 1.0 - keep * keep;
        propagate_bias(x, p, dt_s / tuning.bias_time_s, tuning.bias_std);
        p[PRELOAD_INDEX][PRELOAD_INDEX] += tuning.preload_walk * tuning.preload_walk * dt_s;
        self.linearised_at = *x;
        self.inflate_loads(tuning, share);
    }

    /// Brings the equilibrium to the estimated loads, one step of Newton's method.
    pub fn newton_step(&mut self, contacts: &Contacts) {
        let preload = self.gaussian.state[PRELOAD_INDEX];
        self.equilibrium = contacts.newton(&self.equilibrium.position, &self.loads(), preload);
    }

    /// Brings the features of one gauge to the equilibrium.
    pub fn update_features(&mut self, contacts: &Contacts, gauge: usize) {
        let g = gauge % GAUGES;
        contacts.features(
            &self.equilibrium,
            self.gaussian.state[PRELOAD_INDEX],
            g,
            &mut self.features.value[g],
            &mut self.features.slope[g],
        );
    }

    /// Coefficients of one gauge's strain and their derivatives by the states.
    fn predict_with_jacobian(
        &self,
        model: &GaugeModel,
        passing: f32,
        phase: f32,
        g: usize,
    ) -> ([f32; BASIS], [[f32; NX]; BASIS]) {
        let g = g % GAUGES;
        let x = &self.linearised_at;
        let mut c = [0.0; BASIS];
        let mut by = [[0.0; NX]; BASIS];
        c[0] = model.offset + x[BIAS_INDEX + g];
        by[0][BIAS_INDEX + g] = 1.0;
        for i in 0..LOADS {
            c[0] += model.bulk_load[i] * x[LOAD_INDEX + i];
            by[0][LOAD_INDEX + i] = model.bulk_load[i];
        }
        for row in 0..ROWS {
            let slip = ROWS + row;
            // At the start of the block, turned by what slips in half of it.
            let theta =
                x[row] - phase * (0.5 + 0.5 * (self.equilibrium.pace[row] + x[slip])) - passing;
            let (sin1, cos1) = sin_cos(theta);
            let (mut sin, mut cos) = (0.0, 1.0);
            let f = &self.features.value[g][row];
            let slope = &self.features.slope[g][row];
            for k in 0..FEATURES {
                c[0] += model.bulk_feature[row][k] * f[k];
                for i in 0..INPUTS {
                    by[0][LOAD_INDEX + i] += model.bulk_feature[row][k] * slope[k][i];
                }
            }
            for n in 0..HARMONICS {
                (sin, cos) = (sin * cos1 + cos * sin1, cos * cos1 - sin * sin1);
                let (re, im) = (2 * n + 1, 2 * n + 2);
                let (mut real, mut imaginary) = (0.0, 0.0);
                for k in 0..FEATURES {
                    let s = model.local[row][n][k];
                    // y carries Re(C e^(i n Phi)): the sine's coefficient is -Im C.
                    let a = cos * s[0] - sin * s[1];
                    let b = -(sin * s[0] + cos * s[1]);
                    real += a * f[k];
                    imaginary += b * f[k];
                    for i in 0..INPUTS {
                        by[re][LOAD_INDEX + i] += a * slope[k][i];
                        by[im][LOAD_INDEX + i] += b * slope[k][i];
                    }
                }
                c[re] += real;
                c[im] += imaginary;
                let order = (n + 1) as f32;
                by[re][row] += order * imaginary;
                by[im][row] -= order * real;
                by[re][slip] -= 0.5 * phase * order * imaginary;
                by[im][slip] += 0.5 * phase * order * real;
            }
        }
        (c, by)
    }

    /// Updates the posterior with the readings of one gauge in a block.
    ///
    /// The row of the mean strain comes first in the block, so that the other
    /// rows do not contain it; its variance includes `bulk_std` and half of the local strain that
    /// is not explained, so that a posterior that has not converged takes up no offsets. `used`
    /// false: the innovations are computed, and the posterior stays.
    pub fn update(
        &mut self,
        model: &GaugeModel,
        tuning: &Tuning,
        block: &HarmonicBlock,
        gauge: usize,
        used: bool,
        hold: Hold,
    ) -> BlockInnovation {
        let held = (used && hold != Hold::Nothing).then(|| self.offsets());
        let g = gauge % GAUGES;
        let (c, by) = self.predict_with_jacobian(model, model.passing, block.phase, g);
        let mut innovations = BlockInnovation::default();
        let mut square = 0.0;
        for value in &c[1..] {
            square += value * value;
        }
        let local = model.resting_variance() + model.model_error * model.model_error * square;
        let bulk = local
            + tuning.bulk_std * tuning.bulk_std * f32::from(block.count)
            + UNEXPLAINED_SHARE * residual_power(block, g, &c);
        let mut rows = 0.0;
        for k in 0..BASIS {
            if block.root[k][k] == 0.0 {
                continue;
            }
            let mut row = RowSVector::<f32, NX>::zeros();
            let mut predicted = 0.0;
            for j in k..BASIS {
                let u = block.root[k][j];
                predicted += u * c[j];
                for i in 0..NX {
                    row[i] += u * by[j][i];
                }
            }
            if k > 0 {
                innovations.local.0 += block.reading[g][k] * block.reading[g][k];
                innovations.local.1 += predicted * predicted;
            }
            for i in 0..NX {
                predicted += row[i] * (self.gaussian.state[i] - self.linearised_at[i]);
            }
            let r = if k == 0 { bulk } else { local };
            let nu = block.reading[g][k] - predicted;
            if k > 0 {
                innovations.left += nu * nu;
            }
            let mut gate = if used { Gate::open() } else { Gate::closed() };
            let row_innovation = kalman::update(&mut self.gaussian, &row, nu, r, &mut gate);
            if let Some(slow) = &held {
                self.hold_offsets(slow, hold);
            }
            innovations.cost += row_innovation.nis;
            rows += 1.0;
            if k == 0 {
                let scale = 1.0 / f32::from(block.count.max(1));
                innovations.mean = (nu * libm::sqrtf(scale), row_innovation.variance * scale);
            }
        }
        let count = f32::from(block.count.max(1));
        innovations.nis = innovations.cost / f32::max(rows, 1.0);
        innovations.left /= count;
        innovations.local = (
            libm::sqrtf(innovations.local.0 / count),
            libm::sqrtf(innovations.local.1 / count),
        );
        innovations
    }
}

/// Sum of squares of a gauge's local strain that coefficients `c` do not explain [(um/m)^2].
fn residual_power(block: &HarmonicBlock, g: usize, c: &[f32; BASIS]) -> f32 {
    let mut sum = 0.0;
    for k in 1..BASIS {
        let mut nu = block.reading[g % GAUGES][k];
        for j in k..BASIS {
            nu -= block.root[k][j] * c[j];
        }
        sum += nu * nu;
    }
    sum
}
