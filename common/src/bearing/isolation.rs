//! Isolates the gauge of a bearing that contradicts the slow states (`Isolation`): leaves out one
//! gauge after the other in the alternative hypothesis, with preload and biases held where they were
//! before the contradiction, and names the gauge without which the other three agree.
//!
//! In a further trial all four gauges are used and the preload is free: what a changed preload
//! explains is no gauge's fault. A gauge is excluded when two rounds of trials in a row name it; one
//! round named a wrong gauge in 3 of 17 slow losses of gain.
//!
//! Source: Willsky 1976: a bank of filters, each without one sensor.

use serde::{Deserialize, Serialize};

use crate::bearing::bias_prior::{BiasPrior, Hold};
use crate::bearing::ekf::{JointEkf, PRELOAD_INDEX};
use crate::bearing::{BearingEstimator, BearingState, GAUGES, ROWS};

/// Each gauge left out, and the preload.
const TRIALS: usize = GAUGES + 1;

/// Blocks of 10 ms of a trial.
const TRIAL_BLOCKS: u16 = 30;

/// Blocks of a trial that do not count, while the loads are found.
const BURN_IN: u16 = 10;

/// Blocks between two isolations.
const PAUSE_BLOCKS: u16 = 50;

/// Mean cost of a block of three gauges up to which they agree: on recordings without a fault it is
/// 2.
const AGREE: f32 = 6.0;

/// Cost of a block by which every other trial is higher.
const DISTINGUISHED: f32 = 1.5;

/// Added to the variance of a phase at the start of a trial [rad^2]: 0.14 rad.
const PHASE_VARIANCE: f32 = 0.02;

/// Part of the covariance of the expected loads that is added at the start of a trial.
const LOAD_SHARE: f32 = 0.25;

/// Trial under way, and costs of those before.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Isolation {
    /// The trial, from 1; 0: none.
    trial: u8,
    /// Blocks since it started, or since the last round.
    blocks: u16,
    /// Sum of the costs of the blocks that count, of each trial.
    cost: [f32; TRIALS],
    /// What the round before named.
    named: Option<u8>,
}

impl Isolation {
    /// Whether the alternative hypothesis leaves out this gauge.
    pub fn leaves_out(&self, g: usize) -> bool {
        usize::from(self.trial) == g + 1
    }

    /// Which slow states the alternative hypothesis does not update.
    pub fn holds(&self) -> Hold {
        match usize::from(self.trial) {
            0 => Hold::Nothing,
            TRIALS => Hold::Biases,
            _ => Hold::All,
        }
    }

    /// The gauge without which alone the others agree.
    fn culprit(&self) -> Option<usize> {
        let counted = f32::from(TRIAL_BLOCKS - BURN_IN);
        let cost = self.cost.map(|cost| cost / counted);
        let best = (0..GAUGES).fold(0, |best, i| if cost[i] < cost[best] { i } else { best });
        let unique = (0..TRIALS).all(|i| i == best || cost[i] > cost[best] + DISTINGUISHED);
        (unique && cost[best] < AGREE).then_some(best)
    }
}

impl BearingEstimator {
    /// Goes on isolating the cause of a contradiction; false: there is none to isolate, and the
    /// alternative hypothesis is free. `cost`: of the alternative in the block.
    pub(crate) fn isolate(&self, state: &mut BearingState, cost: f32) -> bool {
        let Some(reference) = state.consistency.proven() else {
            let was_used = state.isolation.trial > 0;
            state.isolation = Isolation::default();
            if was_used {
                self.propose_alternative(state);
            }
            return was_used;
        };
        let isolation = &mut state.isolation;
        isolation.blocks = isolation.blocks.saturating_add(1);
        let trial = usize::from(isolation.trial);
        if trial == 0 {
            // After a round that named none; the first begins at once.
            let wait = isolation.named.is_none() && isolation.cost[0] > 0.0;
            if wait && isolation.blocks < PAUSE_BLOCKS {
                return false;
            }
            isolation.cost = [0.0; TRIALS];
            self.start_trial(state, 1, &reference);
            return true;
        }
        if isolation.blocks > BURN_IN {
            isolation.cost[(trial - 1) % TRIALS] += cost;
        }
        if isolation.blocks < TRIAL_BLOCKS {
            return true;
        }
        if trial < TRIALS {
            self.start_trial(state, trial as u8 + 1, &reference);
            return true;
        }
        isolation.trial = 0;
        isolation.blocks = 0;
        let named = isolation.culprit().map(|g| g as u8);
        let before = core::mem::replace(&mut isolation.named, named);
        if let Some(g) = named.filter(|_| named == before).map(usize::from) {
            isolation.named = None;
            state.consistency.resolve();
            state.test.tests_passed = 0;
            state.exclusion.exclude(g);
            self.move_to(&mut state.primary, &reference);
        }
        if state.isolation.named.is_none() {
            self.propose_alternative(state);
        }
        true
    }

    /// Starts a trial from the primary hypothesis.
    fn start_trial(&self, state: &mut BearingState, trial: u8, reference: &BiasPrior) {
        state.isolation.trial = trial;
        state.isolation.blocks = 0;
        state.alternative = state.primary.clone();
        self.move_to(&mut state.alternative, reference);
        if usize::from(trial) == TRIALS {
            let std = self.model.tuning.preload_std;
            state.alternative.inflate(PRELOAD_INDEX, std * std);
        }
    }

    /// Moves a hypothesis to other slow states, so that it finds its loads anew.
    fn move_to(&self, hypothesis: &mut JointEkf, slow: &BiasPrior) {
        hypothesis.set_offsets(slow);
        for row in 0..ROWS {
            hypothesis.inflate(row, PHASE_VARIANCE);
        }
        hypothesis.inflate_loads(&self.model.tuning, LOAD_SHARE);
        hypothesis.newton_step(&self.contacts);
        hypothesis.newton_step(&self.contacts);
        for g in 0..GAUGES {
            hypothesis.update_features(&self.contacts, g);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The culprit by these mean costs of a block.
    fn culprit(cost: [f32; TRIALS]) -> Option<usize> {
        let counted = f32::from(TRIAL_BLOCKS - BURN_IN);
        let isolation = Isolation {
            cost: cost.map(|cost| cost * counted),
            ..Isolation::default()
        };
        isolation.culprit()
    }

    #[test]
    fn a_gauge_is_named_where_it_alone_explains() {
        assert_eq!(culprit([20.0, 2.0, 30.0, 8.0, 15.0]), Some(1));
        // Two gauges explain it, the preload does, or nothing does.
        assert_eq!(culprit([2.5, 2.0, 30.0, 8.0, 15.0]), None);
        assert_eq!(culprit([20.0, 2.0, 30.0, 8.0, 1.5]), None);
        assert_eq!(culprit([70.0, 9.0, 450.0, 16.0, 15.0]), None);
    }
}
