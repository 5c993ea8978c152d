//! Readings without a load: two gauges that read nothing may be dead, and agree all the same; and a
//! gauge whose fault is a wrong factor agrees with the others while no load is there.

use crate::drivetrain::fault_isolation::decision::{Hypothesis, at, bit, set};
use crate::drivetrain::fault_isolation::{
    FaultIsolation, Gauge, Isolation, MOST_OF_LIMIT, limited,
};
use crate::io::fault::Fault;
use crate::io::raw::MAX_CHANNELS;

impl FaultIsolation {
    /// Follows how far each gauge of `members` is from its reading without a load; a disagreement
    /// that `begins` begins a window.
    pub(super) fn follow_silence(
        &self,
        isolation: &mut Isolation,
        members: &[u8],
        gauges: &[Gauge; MAX_CHANNELS],
        begins: bool,
    ) {
        for i in members {
            let i = at(*i);
            let gauge = &gauges[i];
            if gauge.value.is_some() {
                let reading = gauge.innovation + gauge.response;
                let now = reading * reading / self.tolerance(i, gauge, 0.0);
                // As the costs: it falls as they do when the load goes.
                let now = limited(now, MOST_OF_LIMIT / self.consistency.forgetting);
                let mean = &mut isolation.silent[i];
                if begins {
                    *mean = now;
                } else {
                    self.smooth(mean, now);
                }
            }
        }
    }
}

/// Whether all gauges of `set` read what they do without a load.
fn are_silent(isolation: &Isolation, members: &[u8], set: u8) -> bool {
    (members.iter().map(|i| at(*i)))
        .filter(|i| set & bit(*i) != 0)
        .all(|i| isolation.silent[i] <= 1.0)
}

/// Of three gauges, two that read nothing are dead, or the third is wrong: as simple, unless the
/// third alone left a sound prediction in a jump, or was left out while the two read a load. The
/// two are left out, as no harm comes of it where there is no load.
pub(super) fn doubt_silent_majority(
    isolation: &mut Isolation,
    members: &[u8],
    chosen: Hypothesis,
) -> Hypothesis {
    let all = set(members);
    let (out, majority) = (chosen.left_out, all & !chosen.left_out);
    if members.len() != 3 || out.count_ones() != 1 {
        return chosen;
    }
    if !are_silent(isolation, members, majority) {
        isolation.confirmed |= out;
    }
    if isolation.confirmed & out != 0 || isolation.jumped & all == out {
        return chosen;
    }
    Hypothesis {
        left_out: majority,
        ambiguous: true,
        ..chosen
    }
}

/// Whether the faults of the gauges that are left out are wrong factors and no gauge reads a load:
/// that they agree is no evidence that they are sound.
pub(super) fn vanishes_without_load(isolation: &Isolation, members: &[u8]) -> bool {
    let factor = |i: &u8| {
        let kind = isolation.fault(at(*i));
        kind.is_none_or(|kind| {
            matches!(
                kind,
                Fault::Dead | Fault::Gain | Fault::Reversed | Fault::Swapped
            )
        })
    };
    are_silent(isolation, members, set(members)) && members.iter().all(factor)
}

/// Whether the gauges of `members` that are left out are exchanged.
pub(super) fn is_swapped(isolation: &Isolation, members: &[u8]) -> bool {
    (members.iter()).any(|i| isolation.fault(at(*i)) == Some(Fault::Swapped))
}
