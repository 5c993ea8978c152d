//! Compares the primary with an alternative hypothesis of a bearing after each block by their
//! likelihood ratio, exchanges the two where the alternative explains the readings better, and
//! starts the next alternative: rows exchanged (mirror image), loads reset or phases shifted.
//!
//! The mirror image of a posterior explains the local strain as well as the posterior itself; only
//! bulk strain and the expected loads distinguish the two, and at a start, with offsets
//! unknown, not before the loads have moved. So the first test against the mirror image lasts until
//! it is decided, and a moment that has passed near zero calls the next one.
//!
//! With exchanged rows the filter estimates offsets that fit the readings. So each alternative, and
//! each search that starts anew, begins with the offsets that were estimated before, while the rows
//! were distinguished from their mirror image. So do both images once they have found their phases:
//! until then they estimate offsets by wrong phases.
//!
//! The limits were tuned on simulated bearings 1 to 4, 101 to 120 and 201 to 216; 121 to 130 took
//! no part (docs/lab/results.md).

use serde::{Deserialize, Serialize};

use crate::bearing::bias_prior::BiasPrior;
use crate::bearing::ekf::{JointEkf, LOAD_INDEX};
use crate::bearing::lock_detector::LockDetector;
use crate::bearing::{BearingEstimator, BearingState, GAUGES, ROWS};

/// Starting points of alternatives: eight moves of the phases, and between them
/// swapped labels and loads anew.
pub(crate) const CANDIDATES: u8 = 16;
/// The one that swapped labels follow.
const BEFORE_MIRROR: u8 = CANDIDATES - 1;

/// Blocks of 10 ms that a test lasts at most.
const TEST_BLOCKS: u16 = 24;

/// Blocks at the start of a test that do not count, while the alternative converges.
const BURN_IN: u16 = 10;
/// As [`TEST_BLOCKS`], before the primary has passed its first test.
const FIRST_TEST_BLOCKS: u16 = 14;

/// As [`BURN_IN`], before the primary has passed its first test.
const FIRST_BURN_IN: u16 = 6;

/// Cost by which the alternative must be lower to replace the primary: sum of NIS and prior cost,
/// minus twice a log-likelihood. 30 is a likelihood ratio of e^15.
const ACCEPT: f32 = 30.0;

/// Cost by which the alternative may be higher before the test ends early: a likelihood ratio of
/// e^200, which no test makes good.
const REJECT: f32 = 400.0;

/// Difference in cost that settles which of two mirror images is true, and by which an alternative
/// replaces the primary before the end of its test: a likelihood ratio of e^50, as errors of the
/// model last for many blocks.
const ACCEPT_MIRROR: f32 = 100.0;

/// Blocks of a mirror test that do not count, 1 s, as an image has yet to find its loads.
const MIRROR_BURN_IN: u16 = 100;

/// Blocks of a mirror test, 5 s, after which [`ACCEPT`] is enough.
const LONGEST_TEST_BLOCKS: u16 = 500;

/// Block of the mirror test, 0.5 s, at which both images learn their offsets anew: those taken up
/// while phases and loads were being found are off by many of their standard deviations. 0.35 and
/// 0.7 s were worse on the development bearings (docs/lab/tried.md).
const FOUND: u16 = 50;

/// Standard deviations by which a moment is off zero when its sign is known.
const SIGN_KNOWN: f32 = 4.0;

/// Standard deviations by which a moment is off zero when it has not missed a reversal: after one, the
/// wrong sign looks like a fault of the bottom gauge.
const FAR: f32 = 8.0;

/// State of the test under way.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct HypothesisTest {
    candidate: u8,
    blocks: u16,
    /// Alternative's cost less the primary's.
    log_likelihood_ratio: f32,
    /// Tests that the primary has passed since it became one.
    pub tests_passed: u8,
    /// Whether the mirror image has been distinguished from the primary hypothesis since the start.
    pub mirror_resolved: bool,
    /// Whether the sign of the over-turning moment is known.
    sign_is_known: bool,
}

impl HypothesisTest {
    fn is_with_mirror(&self) -> bool {
        self.candidate.is_multiple_of(4)
    }

    /// Whether the over-turning moment may just have changed its sign: a posterior that misses the
    /// change bounces off zero instead.
    fn sees_reversal(&mut self, primary: &JointEkf) -> bool {
        let at = LOAD_INDEX + 3;
        let moment = primary.gaussian.state[at];
        let least = SIGN_KNOWN * SIGN_KNOWN * primary.gaussian.upper[at][at];
        let was_known = core::mem::replace(&mut self.sign_is_known, moment * moment >= least);
        self.sign_is_known && !was_known && self.mirror_resolved && self.tests_passed > 0
    }
}

/// Whether the over-turning moment is far from zero, where it may bounce off with the wrong sign.
pub(crate) fn is_far_from_reversal(primary: &JointEkf) -> bool {
    let at = LOAD_INDEX + 3;
    let moment = primary.gaussian.state[at];
    moment * moment > FAR * FAR * primary.gaussian.upper[at][at]
}

/// Whether the mirror image has turned into the posterior whose image it was.
fn is_one(primary: &JointEkf, image: &JointEkf) -> bool {
    let moment = |hypothesis: &JointEkf| hypothesis.gaussian.state[LOAD_INDEX + 3];
    !primary.phases_differ(image) && moment(primary) * moment(image) > 0.0
}

impl BearingEstimator {
    /// Adds the costs of a block to the test; where it is over, keeps the better hypothesis as the
    /// primary and starts the next alternative. A primary that has lost its lock ends the estimate.
    pub(crate) fn decide(&self, state: &mut BearingState) {
        let (primary, alternative) = state.cost;
        state.cost = (0.0, 0.0);
        if state.known.is_none() {
            if state.lock.has_lost_lock() {
                if !state.test.mirror_resolved && !state.holds_slow_states() {
                    // What was remembered has not helped to find the rows.
                    state.offsets = BiasPrior::expected(&self.model.tuning);
                }
                state.running = false;
                return;
            }
            if self.isolate(state, alternative) {
                return;
            }
            let suspect = state.lock.is_suspect() && state.test.tests_passed > 0;
            if state.test.sees_reversal(&state.primary) || suspect {
                state.test.candidate = BEFORE_MIRROR;
                self.propose_alternative(state);
                return;
            }
        }
        let test = &mut state.test;
        test.blocks = test.blocks.saturating_add(1);
        let mirror = test.is_with_mirror();
        // With the loads known, local strain alone distinguishes the image from the truth.
        let undecided = !test.mirror_resolved && state.known.is_none();
        if undecided && mirror && test.blocks == FOUND {
            state.primary.set_offsets(&state.offsets);
            state.primary.inflate_loads(&self.model.tuning, 1.0);
            state.alternative.set_offsets(&state.offsets);
            state.alternative.inflate_loads(&self.model.tuning, 1.0);
        }
        let (length, burn_in) = if undecided && mirror && state.lock.is_confirmed() {
            (LONGEST_TEST_BLOCKS, MIRROR_BURN_IN)
        } else if test.tests_passed > 0 {
            (TEST_BLOCKS, BURN_IN)
        } else {
            (FIRST_TEST_BLOCKS, FIRST_BURN_IN)
        };
        test.log_likelihood_ratio = if test.blocks > burn_in {
            test.log_likelihood_ratio + alternative - primary
        } else {
            0.0
        };
        let prior = state.alternative.prior_cost(&self.model.tuning)
            - state.primary.prior_cost(&self.model.tuning);
        let verdict = test.log_likelihood_ratio + prior;
        let decisive = if test.blocks < LONGEST_TEST_BLOCKS {
            ACCEPT_MIRROR
        } else {
            ACCEPT
        };
        let settles = mirror && test.blocks > MIRROR_BURN_IN && verdict.abs() > decisive;
        let broken = !state.primary.is_finite();
        let image_is_lost = undecided
            && mirror
            && test.blocks > BURN_IN
            && is_one(&state.primary, &state.alternative);
        let over = test.blocks >= length
            || test.log_likelihood_ratio > REJECT
            || test.blocks > burn_in && verdict < -ACCEPT_MIRROR
            || image_is_lost
            || settles && !test.mirror_resolved;
        if !over && !broken {
            return;
        }
        test.mirror_resolved |= settles;
        if broken || verdict < -ACCEPT {
            core::mem::swap(&mut state.primary, &mut state.alternative);
            if broken || state.primary.phases_differ(&state.alternative) {
                test.mirror_resolved &= mirror && !broken;
                test.tests_passed = 0;
                test.candidate = BEFORE_MIRROR;
                state.lock = LockDetector::default();
            }
            if !state.primary.is_finite() {
                self.begin(&mut state.primary, &state.offsets);
            }
        } else {
            test.tests_passed = test.tests_passed.saturating_add(1);
            if mirror && test.mirror_resolved && verdict > ACCEPT && state.known.is_none() {
                state.offsets = state.primary.offsets();
            }
        }
        self.propose_alternative(state);
    }

    /// Makes the next alternative from the primary, and starts its test.
    pub(crate) fn propose_alternative(&self, state: &mut BearingState) {
        let tuning = &self.model.tuning;
        let test = &mut state.test;
        test.candidate = (test.candidate + 1) % CANDIDATES;
        test.blocks = 0;
        test.log_likelihood_ratio = 0.0;
        state.alternative = state.primary.clone();
        let next = &mut state.alternative;
        let moved = test.candidate / 2 + 1;
        match test.candidate % 4 {
            0 => next.swap_rows(),
            2 => next.reset_loads(tuning),
            _ => {
                // Thirds of a turn in both phases, all but (0, 0).
                let third = core::f32::consts::TAU / 3.0;
                next.shift_phase(0, third * f32::from(moved % 3));
                next.shift_phase(1, third * f32::from(moved / 3));
            }
        }
        for row in 0..ROWS {
            next.inflate(row, 0.5);
            next.inflate(ROWS + row, tuning.slip_std * tuning.slip_std);
        }
        next.inflate_loads(tuning, 0.25);
        next.set_offsets(&state.offsets);
        next.newton_step(&self.contacts);
        next.newton_step(&self.contacts);
        for g in 0..GAUGES {
            next.update_features(&self.contacts, g);
        }
    }
}
