//! Changes one hypothesis of a bearing into another that is to be tested: turns the phase of a row,
//! exchanges the rows (mirror image) or resets the loads. Also compares the phases of two
//! hypotheses, and computes the prior cost of one: minus twice the logarithm of the prior of its
//! slow states, slips and loads.

use crate::bearing::bias_prior::decorrelate_state;
use crate::bearing::ekf::{BIAS_INDEX, JointEkf, KNOWN_PHASE, LOAD_INDEX, NX, PRELOAD_INDEX};
use crate::bearing::{LOADS, ROWS, Tuning};
use crate::signal::phase::wrap_rad;

/// Phases further apart than this are not the same [rad]: about twice the standard deviation at
/// which a phase is known ([`KNOWN_PHASE`]).
const APART: f32 = 0.6;

impl JointEkf {
    /// Turns the phase of a row by `by` (rad).
    pub fn shift_phase(&mut self, row: usize, by: f32) {
        let theta = &mut self.gaussian.state[row % ROWS];
        *theta = wrap_rad(*theta + by);
    }

    /// The mirror image: rows change places, and with them the signs of axial
    /// force and moments. Local strain of gauges in the middle does not distinguish the two.
    pub fn swap_rows(&mut self) {
        let x = &mut self.gaussian.state;
        x.swap_rows(0, 1);
        x.swap_rows(2, 3);
        for i in [1, 3, 4] {
            x[LOAD_INDEX + i] = -x[LOAD_INDEX + i];
        }
        let p = &mut self.gaussian.upper;
        for i in (0..LOAD_INDEX).chain([1, 3, 4].map(|i| LOAD_INDEX + i)) {
            decorrelate_state(p, i);
        }
    }

    /// Resets the loads to their expected mean and covariance; the phases stay.
    pub fn reset_loads(&mut self, tuning: &Tuning) {
        let p = &mut self.gaussian.upper;
        for i in 0..LOADS {
            let l = LOAD_INDEX + i;
            self.gaussian.state[l] = tuning.load_mean[i];
            decorrelate_state(p, l);
            p[l][l] = 0.0;
        }
        self.inflate_loads(tuning, 1.0);
    }

    /// Whether the phases of two posteriors are not the same, in the rows where the first has a
    /// variance below `KNOWN_PHASE`.
    pub fn phases_differ(&self, other: &Self) -> bool {
        (0..ROWS)
            .filter(|row| self.gaussian.upper[*row][*row] < KNOWN_PHASE)
            .any(|row| wrap_rad(self.gaussian.state[row] - other.gaussian.state[row]).abs() > APART)
    }

    /// Minus twice the logarithm of the prior of what a posterior holds: biases,
    /// slips, preload and loads in units of their standard deviations, squared.
    ///
    /// Two posteriors that explain the readings equally well may differ in what they had to assume
    /// for it.
    pub fn prior_cost(&self, tuning: &Tuning) -> f32 {
        let x = &self.gaussian.state;
        let mut sum = 0.0;
        for b in BIAS_INDEX..NX {
            let part = x[b] / tuning.bias_std;
            sum += part * part;
        }
        for row in 0..ROWS {
            let part = x[ROWS + row] / tuning.slip_std;
            sum += part * part;
        }
        let mut whitened = [0.0; LOADS];
        for i in 0..LOADS {
            let mut part = x[LOAD_INDEX + i] - tuning.load_mean[i];
            for (l, w) in tuning.load_factor[i][..i].iter().zip(&whitened) {
                part -= l * w;
            }
            whitened[i] = part / tuning.load_factor[i][i];
            sum += whitened[i] * whitened[i];
        }
        let part = x[PRELOAD_INDEX] / tuning.preload_std;
        sum + part * part
    }
}
