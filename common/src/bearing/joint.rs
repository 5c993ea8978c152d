//! The joint filter: one belief over all gauges, 100 times a second.
//!
//! States: phases of ball passing `theta_r` [rad] and slips `s_r` of both rows,
//! loads [kN], preload [um], biases of the bulk strains [um/m].
//!
//! `theta+ = theta + Phi (pace + s)`, `pace` by the loaded contact angle; slips, loads
//! and biases return to what is expected of them, the preload walks. The local strain of gauge g is
//! `sum_n Re(C_n e^(i n Phi))`, `C_n = sum_r e^(i n (theta_r - N psi_g)) S_nr f_r`,
//! with the features `f_r` of the load ([`super::contact::Features`]); its bulk
//! strain is linear in loads and features.
//!
//! Sources: Kerst et al. 2019, eq. (1)-(3), in another form: here all gauges share
//! the rows' phases.

use nalgebra::{RowSVector, SVector};

use super::block::Block;
use super::contact::{Contacts, Equilibrium, Features, INPUTS};
use super::offsets::Offsets;
use super::{BASIS, FEATURES, GAUGES, GaugeModel, HARMONICS, LOADS, ROWS, Tuning};
use crate::elementary::sin_cos;
use crate::gaussian::Gaussian;
use crate::innovation::Gate;
use crate::kalman;
use crate::phase::wrap_rad;

/// States.
pub const NX: usize = 2 * ROWS + INPUTS + GAUGES;
/// Place of the first load.
pub const LOAD: usize = 2 * ROWS;
/// Place of the preload.
pub const PRELOAD: usize = LOAD + LOADS;
/// Place of the first bias.
pub const BIAS: usize = PRELOAD + 1;

/// Phases further apart than this are not the same [rad].
const APART: f32 = 0.6;

/// Variance below which a phase is known [rad^2].
pub(super) const KNOWN_PHASE: f32 = 0.1;

/// Part of the square of local strain not explained that is told as error of the bulk strain.
const UNEXPLAINED_SHARE: f32 = 0.5;

/// Correlation of the gauges' drift: they sit on one ring and warm together.
pub(super) const TOGETHER: f32 = 0.94;

/// Variance of a load that is known [kN^2].
const KNOWN_VARIANCE: f32 = 1e-8;

/// What one gauge said to one belief in one block.
#[derive(Clone, Copy, Debug, Default)]
pub struct Told {
    /// Mean normalised innovation squared of the rows that were used.
    pub nis: f32,
    /// Innovation of the mean strain [um/m] and its variance.
    pub mean: (f32, f32),
    /// Root mean square of the local strain, read and predicted [um/m].
    pub local: (f32, f32),
    /// Mean square of the local strain that was not expected.
    pub left: f32,
    /// Normalised innovation squared, the sum over the rows.
    ///
    /// Errors of the model stay for many blocks and are told larger for that, so that the determinant of the
    /// innovations' covariance, the other part of the likelihood, would outweigh them: rows that say less would win.
    pub cost: f32,
}

/// One belief about phases, loads and biases.
#[derive(Clone, Debug)]
pub struct Belief {
    /// Mean and covariance of the states.
    pub gaussian: Gaussian<NX>,
    /// Equilibrium at the believed loads.
    pub equilibrium: Equilibrium,
    /// Features at the believed loads.
    pub features: Features,
    linearised_at: SVector<f32, NX>,
}

impl Belief {
    /// A belief that [`Self::begin`] fills, so that it is made where it stays and not on
    /// the stack.
    pub fn blank() -> Self {
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

    /// Begins with what is expected and known of preload and biases; `rest`: the equilibrium at the expected loads.
    pub fn begin(
        &mut self,
        tuning: &Tuning,
        contacts: &Contacts,
        rest: &Equilibrium,
        offsets: &Offsets,
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
            x[LOAD + i] = *mean;
        }
        self.recall(offsets);
        self.linearised_at = self.gaussian.state;
        self.widen_loads(tuning, 1.0);
        self.equilibrium = *rest;
        for g in 0..GAUGES {
            self.refresh(contacts, g);
        }
    }

    /// The believed loads [kN].
    pub fn loads(&self) -> [f32; LOADS] {
        let mut loads = [0.0; LOADS];
        for (i, load) in loads.iter_mut().enumerate() {
            *load = self.gaussian.state[LOAD + i];
        }
        loads
    }

    /// Adds to the variance of one state; `i < NX`.
    pub fn widen(&mut self, i: usize, variance: f32) {
        if let Some(p) = self
            .gaussian
            .upper
            .get_mut(i)
            .and_then(|column| column.get_mut(i))
        {
            *p += variance;
        }
    }

    /// Turns the phase of a row.
    pub fn turn(&mut self, row: usize, by: f32) {
        let theta = &mut self.gaussian.state[row % ROWS];
        *theta = wrap_rad(*theta + by);
    }

    /// The mirror image: rows change places, and with them the signs of axial
    /// force and moments. Local strain of gauges in the middle cannot tell the two apart.
    pub fn swap_rows(&mut self) {
        let x = &mut self.gaussian.state;
        x.swap_rows(0, 1);
        x.swap_rows(2, 3);
        for i in [1, 3, 4] {
            x[LOAD + i] = -x[LOAD + i];
        }
        let p = &mut self.gaussian.upper;
        for i in (0..LOAD).chain([1, 3, 4].map(|i| LOAD + i)) {
            uncouple(p, i);
        }
    }

    /// Starts with the loads anew, in the phases as they are.
    pub fn forget_loads(&mut self, tuning: &Tuning) {
        let p = &mut self.gaussian.upper;
        for i in 0..LOADS {
            let l = LOAD + i;
            self.gaussian.state[l] = tuning.load_mean[i];
            uncouple(p, l);
            p[l][l] = 0.0;
        }
        self.widen_loads(tuning, 1.0);
    }

    /// Adds a share of the covariance of the expected loads.
    pub fn widen_loads(&mut self, tuning: &Tuning, share: f32) {
        let l = &tuning.load_factor;
        for j in 0..LOADS {
            for i in 0..=j {
                let mut sum = 0.0;
                for k in 0..=i {
                    sum += l[i][k] * l[j][k];
                }
                self.gaussian.upper[LOAD + j][LOAD + i] += share * sum;
            }
        }
    }

    /// Whether the phases of two beliefs, where the first knows its own, are not the same.
    pub fn is_apart(&self, other: &Self) -> bool {
        (0..ROWS)
            .filter(|row| self.gaussian.upper[*row][*row] < KNOWN_PHASE)
            .any(|row| wrap_rad(self.gaussian.state[row] - other.gaussian.state[row]).abs() > APART)
    }

    /// Minus twice the logarithm of the prior of what a belief holds: biases,
    /// slips, preload and loads in units of their standard deviations, squared.
    ///
    /// Two beliefs that explain the readings equally well may differ in what they had to assume for it.
    pub fn prior(&self, tuning: &Tuning) -> f32 {
        let x = &self.gaussian.state;
        let mut sum = 0.0;
        for b in BIAS..NX {
            let part = x[b] / tuning.bias_std;
            sum += part * part;
        }
        for row in 0..ROWS {
            let part = x[ROWS + row] / tuning.slip_std;
            sum += part * part;
        }
        let mut whitened = [0.0; LOADS];
        for i in 0..LOADS {
            let mut part = x[LOAD + i] - tuning.load_mean[i];
            for (l, w) in tuning.load_factor[i][..i].iter().zip(&whitened) {
                part -= l * w;
            }
            whitened[i] = part / tuning.load_factor[i][i];
            sum += whitened[i] * whitened[i];
        }
        let part = x[PRELOAD] / tuning.preload_std;
        sum + part * part
    }

    /// Takes the loads as known [kN].
    pub fn know(&mut self, loads: &[f32; LOADS]) {
        let p = &mut self.gaussian.upper;
        for (i, load) in loads.iter().enumerate() {
            let i = LOAD + i;
            self.gaussian.state[i] = *load;
            uncouple(p, i);
            p[i][i] = KNOWN_VARIANCE;
        }
        // Nor may the preload take up what the gauges' model lacks.
        self.gaussian.state[PRELOAD] = 0.0;
        uncouple(p, PRELOAD);
        p[PRELOAD][PRELOAD] = KNOWN_VARIANCE;
        self.linearised_at = self.gaussian.state;
    }

    /// Whether every number of it is finite.
    pub fn is_finite(&self) -> bool {
        (0..NX).all(|i| self.gaussian.state[i].is_finite() && self.gaussian.upper[i][i].is_finite())
            && self.equilibrium.position.iter().all(|z| z.is_finite())
    }

    /// One block later: `phase` [rad] passed in `dt_s`.
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
            let l = LOAD + i;
            x[l] = tuning.load_mean[i] + keep * (x[l] - tuning.load_mean[i]);
            for j in 0..NX {
                if j != l {
                    p[l.max(j)][l.min(j)] *= keep;
                }
            }
            p[l][l] *= keep * keep;
        }
        let share = 1.0 - keep * keep;
        forget(x, p, dt_s / tuning.bias_time_s, tuning.bias_std);
        p[PRELOAD][PRELOAD] += tuning.preload_walk * tuning.preload_walk * dt_s;
        self.linearised_at = *x;
        self.widen_loads(tuning, share);
    }

    /// Brings the equilibrium to the believed loads, one step of Newton's method.
    pub fn balance(&mut self, contacts: &Contacts) {
        let preload = self.gaussian.state[PRELOAD];
        self.equilibrium = contacts.newton(&self.equilibrium.position, &self.loads(), preload);
    }

    /// Brings the features of one gauge to the equilibrium.
    pub fn refresh(&mut self, contacts: &Contacts, gauge: usize) {
        let g = gauge % GAUGES;
        contacts.features(
            &self.equilibrium,
            self.gaussian.state[PRELOAD],
            g,
            &mut self.features.value[g],
            &mut self.features.slope[g],
        );
    }

    /// Coefficients of one gauge's strain and their derivatives by the states.
    fn coefficients(
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
        c[0] = model.offset + x[BIAS + g];
        by[0][BIAS + g] = 1.0;
        for i in 0..LOADS {
            c[0] += model.bulk_load[i] * x[LOAD + i];
            by[0][LOAD + i] = model.bulk_load[i];
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
                    by[0][LOAD + i] += model.bulk_feature[row][k] * slope[k][i];
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
                        by[re][LOAD + i] += a * slope[k][i];
                        by[im][LOAD + i] += b * slope[k][i];
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

    /// Updates the belief with what one gauge said in a block.
    ///
    /// The row of the mean strain comes first in the block, so that the other
    /// rows do not see it; it is trusted only as far as `bulk_std` and as far as the local strain is explained:
    /// a belief that is still on its way takes up no offsets. `used` false: the gauge is only
    /// compared.
    pub fn update(
        &mut self,
        model: &GaugeModel,
        tuning: &Tuning,
        block: &Block,
        gauge: usize,
        used: bool,
    ) -> Told {
        let g = gauge % GAUGES;
        let (c, by) = self.coefficients(model, model.passing, block.phase, g);
        let mut told = Told::default();
        let mut square = 0.0;
        for value in &c[1..] {
            square += value * value;
        }
        let local = model.resting_variance() + model.model_error * model.model_error * square;
        let bulk = local
            + tuning.bulk_std * tuning.bulk_std * f32::from(block.count)
            + UNEXPLAINED_SHARE * unexplained(block, g, &c);
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
                told.local.0 += block.reading[g][k] * block.reading[g][k];
                told.local.1 += predicted * predicted;
            }
            for i in 0..NX {
                predicted += row[i] * (self.gaussian.state[i] - self.linearised_at[i]);
            }
            let r = if k == 0 { bulk } else { local };
            let nu = block.reading[g][k] - predicted;
            if k > 0 {
                told.left += nu * nu;
            }
            let mut gate = if used { Gate::open() } else { Gate::shut() };
            let told_row = kalman::update(&mut self.gaussian, &row, nu, r, &mut gate);
            told.cost += told_row.nis;
            rows += 1.0;
            if k == 0 {
                let scale = 1.0 / f32::from(block.count.max(1));
                told.mean = (nu * libm::sqrtf(scale), told_row.variance * scale);
            }
        }
        let count = f32::from(block.count.max(1));
        told.nis = told.cost / f32::max(rows, 1.0);
        told.left /= count;
        told.local = (
            libm::sqrtf(told.local.0 / count),
            libm::sqrtf(told.local.1 / count),
        );
        told
    }
}

/// Sum of squares of a gauge's local strain that coefficients `c` do not explain [(um/m)^2].
fn unexplained(block: &Block, g: usize, c: &[f32; BASIS]) -> f32 {
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

/// Takes from state `i` what it has in common with the others; its variance stays.
#[inline(never)]
pub(super) fn uncouple(p: &mut [[f32; NX]; NX], i: usize) {
    for (j, column) in p.iter_mut().enumerate() {
        // Column j ends at the diagonal.
        if j == i {
            column.iter_mut().take(i).for_each(|entry| *entry = 0.0);
        } else if let Some(entry) = column.get_mut(i).filter(|_| j > i) {
            *entry = 0.0;
        }
    }
}

/// Biases forget: `x+ = k x`, `P+ = k P k + (1 - k^2) std^2 C`, `k = 1 - share`; `C` is 1 on its diagonal
/// and [`TOGETHER`] elsewhere.
fn forget(x: &mut SVector<f32, NX>, p: &mut [[f32; NX]; NX], share: f32, std: f32) {
    let keep = 1.0 - share.min(1.0);
    let new = (1.0 - keep * keep) * std * std;
    for i in BIAS..NX {
        x[i] *= keep;
        for j in 0..NX {
            if j != i {
                p[i.max(j)][i.min(j)] *= keep;
            }
        }
        p[i][i] = keep * keep * p[i][i] + new;
    }
    for (j, column) in p.iter_mut().enumerate().skip(BIAS) {
        for entry in column.iter_mut().take(j).skip(BIAS) {
            *entry += TOGETHER * new;
        }
    }
}
