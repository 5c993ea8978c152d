//! Champion and challenger: how phases are found and swapped labels undone.
//!
//! The mirror image of a belief explains the local strain as well as the belief itself; only
//! bulk strain and what is expected of the loads tell the two apart, and at a start, with offsets
//! unknown, not before the loads have moved. So the first duel with the mirror image lasts until
//! it is decided, and a moment that has passed near zero calls the next one.
//!
//! Wrong rows take up offsets that make them right. So each challenger starts with those that were
//! learnt before, by rows that were told from their mirror image, and so does a search that starts anew. So does each
//! of two images once it has found its phases: on the way there it has taken offsets for what phases were.

use super::joint::{Belief, LOAD};
use super::offsets::Offsets;
use super::trust::Trust;
use super::{Bearing, BearingState, GAUGES, ROWS};

/// Starting points of challengers: eight moves of the phases, and between them
/// swapped labels and loads anew.
pub(super) const CANDIDATES: u8 = 16;
/// The one that swapped labels follow.
const BEFORE_MIRROR: u8 = CANDIDATES - 1;

/// Blocks of a duel, and those at its start that do not count.
const DUEL: u16 = 24;
const BURN_IN: u16 = 10;
/// The same before the champion has met its first challenge.
const FIRST_DUEL: u16 = 14;
const FIRST_BURN_IN: u16 = 6;

/// By how much the challenger's cost must be lower, and by how much it may be
/// higher before the duel is over.
const MARGIN: f32 = 30.0;
const HOPELESS: f32 = 400.0;

/// Difference in cost that settles which of two mirror images is true, the blocks that do not
/// count for it, as an image has yet to find its loads, and those after which `MARGIN` is enough.
const DECISIVE: f32 = 100.0;
const MIRROR_BURN_IN: u16 = 100;
const LONGEST_DUEL: u16 = 500;

/// Block of that duel at which both images learn their offsets anew: those taken up while phases and loads were being
/// found are off by many of their standard deviations.
const FOUND: u16 = 50;

/// Standard deviations by which a moment is off zero when its sign is known.
const SIGN_KNOWN: f32 = 4.0;

/// The standing of a challenge.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Duel {
    candidate: u8,
    blocks: u16,
    /// Challenger's cost less the champion's.
    lead: f32,
    /// Challenges that the champion has met since it became one.
    pub won: u8,
    /// Whether the mirror image has been told from the champion since the start.
    pub settled: bool,
    /// Whether the sign of the over-turning moment is known.
    sign_is_known: bool,
}

impl Duel {
    fn is_with_mirror(&self) -> bool {
        self.candidate.is_multiple_of(4)
    }

    /// Whether the over-turning moment may just have changed its sign: a belief that misses the
    /// change bounces off zero instead.
    fn sees_reversal(&mut self, champion: &Belief) -> bool {
        let at = LOAD + 3;
        let moment = champion.gaussian.state[at];
        let least = SIGN_KNOWN * SIGN_KNOWN * champion.gaussian.upper[at][at];
        let was_known = core::mem::replace(&mut self.sign_is_known, moment * moment >= least);
        self.sign_is_known && !was_known && self.settled && self.won > 0
    }
}

/// Whether the mirror image has turned into the belief whose image it was.
fn is_one(champion: &Belief, image: &Belief) -> bool {
    let moment = |belief: &Belief| belief.gaussian.state[LOAD + 3];
    !champion.is_apart(image) && moment(champion) * moment(image) > 0.0
}

impl Bearing {
    /// Ends the block: who explains the readings better?
    pub(super) fn judge(&self, state: &mut BearingState) {
        let (champion, challenger) = state.cost;
        state.cost = (0.0, 0.0);
        if state.known.is_none() {
            if state.trust.is_lost() {
                if !state.duel.settled {
                    // What was remembered has not helped to find the rows.
                    state.offsets = Offsets::expected(&self.model.tuning);
                }
                state.running = false;
                return;
            }
            let doubt = state.trust.begins_to_doubt() && state.duel.won > 0;
            if state.duel.sees_reversal(&state.champion) || doubt {
                state.duel.candidate = BEFORE_MIRROR;
                self.challenge(state);
                return;
            }
        }
        let duel = &mut state.duel;
        duel.blocks = duel.blocks.saturating_add(1);
        let mirror = duel.is_with_mirror();
        // With the loads told, local strain alone tells the image from the truth.
        let undecided = !duel.settled && state.known.is_none();
        if undecided && mirror && duel.blocks == FOUND {
            state.champion.recall(&state.offsets);
            state.champion.widen_loads(&self.model.tuning, 1.0);
            state.challenger.recall(&state.offsets);
            state.challenger.widen_loads(&self.model.tuning, 1.0);
        }
        let (length, burn_in) = if undecided && mirror && state.trust.is_earned() {
            (LONGEST_DUEL, MIRROR_BURN_IN)
        } else if duel.won > 0 {
            (DUEL, BURN_IN)
        } else {
            (FIRST_DUEL, FIRST_BURN_IN)
        };
        duel.lead = if duel.blocks > burn_in {
            duel.lead + challenger - champion
        } else {
            0.0
        };
        let prior =
            state.challenger.prior(&self.model.tuning) - state.champion.prior(&self.model.tuning);
        let verdict = duel.lead + prior;
        let decisive = if duel.blocks < LONGEST_DUEL {
            DECISIVE
        } else {
            MARGIN
        };
        let settles = mirror && duel.blocks > MIRROR_BURN_IN && verdict.abs() > decisive;
        let broken = !state.champion.is_finite();
        let image_is_lost = undecided
            && mirror
            && duel.blocks > BURN_IN
            && is_one(&state.champion, &state.challenger);
        let over = duel.blocks >= length
            || duel.lead > HOPELESS
            || duel.blocks > burn_in && verdict < -DECISIVE
            || image_is_lost
            || settles && !duel.settled;
        if !over && !broken {
            return;
        }
        duel.settled |= settles;
        if broken || verdict < -MARGIN {
            core::mem::swap(&mut state.champion, &mut state.challenger);
            if broken || state.champion.is_apart(&state.challenger) {
                duel.settled &= mirror && !broken;
                duel.won = 0;
                duel.candidate = BEFORE_MIRROR;
                state.trust = Trust::default();
            }
            if !state.champion.is_finite() {
                self.begin(&mut state.champion, &state.offsets);
            }
        } else {
            duel.won = duel.won.saturating_add(1);
            if mirror && duel.settled && verdict > MARGIN && state.known.is_none() {
                state.offsets = state.champion.offsets();
            }
        }
        self.challenge(state);
    }

    /// Sends the next challenger out.
    pub(super) fn challenge(&self, state: &mut BearingState) {
        let tuning = &self.model.tuning;
        let duel = &mut state.duel;
        duel.candidate = (duel.candidate + 1) % CANDIDATES;
        duel.blocks = 0;
        duel.lead = 0.0;
        state.challenger = state.champion.clone();
        let next = &mut state.challenger;
        let moved = duel.candidate / 2 + 1;
        match duel.candidate % 4 {
            0 => next.swap_rows(),
            2 => next.forget_loads(tuning),
            _ => {
                // Thirds of a turn in both phases, all but (0, 0).
                let third = core::f32::consts::TAU / 3.0;
                next.turn(0, third * f32::from(moved % 3));
                next.turn(1, third * f32::from(moved / 3));
            }
        }
        for row in 0..ROWS {
            next.widen(row, 0.5);
            next.widen(ROWS + row, tuning.slip_std * tuning.slip_std);
        }
        next.widen_loads(tuning, 0.25);
        next.recall(&state.offsets);
        next.balance(&self.contacts);
        next.balance(&self.contacts);
        for g in 0..GAUGES {
            next.refresh(&self.contacts, g);
        }
    }
}
