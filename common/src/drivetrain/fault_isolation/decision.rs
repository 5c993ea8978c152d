//! Decides by the residual cost of each fault hypothesis which redundant gauges of a drivetrain are
//! excluded, and names the kinds of their faults. The prediction of the filter is further evidence
//! after the gauges have agreed for five windows.

use crate::drivetrain::fault_isolation::silence::{
    doubt_silent_majority, is_swapped, vanishes_without_load,
};
use crate::drivetrain::fault_isolation::{
    ANCHORED, FaultIsolation, Gauge, Isolation, Prior, RETURN, pair,
};
use crate::drivetrain::fault_kind::Moments;
use crate::io::fault::Fault;
use crate::io::raw::MAX_CHANNELS;

/// Part of the limit below which gauges agree: half of [`RETURN`].
const CALM: f32 = 0.5 * RETURN;

/// Gauges of a direction that a hypothesis leaves out, one bit each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Hypothesis {
    pub(super) left_out: u8,
    pub(super) swapped: bool,
    /// Whether another hypothesis explains the readings as simply.
    pub(super) ambiguous: bool,
}

impl Hypothesis {
    const SOUND: Self = Self {
        left_out: 0,
        swapped: false,
        ambiguous: false,
    };
}

pub(super) fn bit(i: usize) -> u8 {
    1 << (i % MAX_CHANNELS)
}

/// The gauges of a direction.
pub(super) fn set(members: &[u8]) -> u8 {
    members.iter().fold(0, |all, i| all | bit((*i).into()))
}

impl FaultIsolation {
    /// Takes the first hypothesis of direction `d` that explains the readings: all gauges sound;
    /// those at fault that contradict a sound prediction, where the others agree; one at fault; two
    /// exchanged; two at fault; all but one that the prediction confirms. Where none does, or the
    /// prediction cannot separate one turned gauge from two exchanged, the direction is
    /// contradicted.
    pub(crate) fn decide(
        &self,
        isolation: &mut Isolation,
        d: usize,
        members: &[u8],
        gauges: &[Gauge; MAX_CHANNELS],
    ) {
        let all = set(members);
        let before = isolation.left_out & all;
        let limit = if before == 0 && isolation.contradicted & bit(d) == 0 {
            1.0
        } else {
            RETURN
        };
        let sound = (members.iter()).all(|i| isolation.none[d] - isolation.single[at(*i)] <= limit)
            && isolation.none[d] <= limit * self.limit(members.len());
        if sound && before == 0 {
            isolation.contradicted &= !bit(d);
            isolation.ambiguous &= !bit(d);
            isolation.sound[d] = isolation.sound[d].saturating_add(1);
            return;
        }
        let begins = before == 0 && isolation.contradicted & bit(d) == 0;
        self.follow_silence(isolation, members, gauges, begins);
        let chosen = if before != 0 && vanishes_without_load(isolation, members) {
            Some(Hypothesis {
                left_out: before,
                swapped: is_swapped(isolation, members),
                ambiguous: isolation.ambiguous & bit(d) != 0,
            })
        } else if sound {
            Some(Hypothesis::SOUND)
        } else {
            (self.culprits(isolation, d, members, before))
                .map(|chosen| doubt_silent_majority(isolation, members, chosen))
        };
        isolation.contradicted &= !bit(d);
        let chosen = chosen.unwrap_or_else(|| {
            isolation.contradicted |= bit(d);
            Hypothesis::SOUND
        });
        isolation.left_out = isolation.left_out & !all | chosen.left_out;
        isolation.confirmed &= chosen.left_out | !all;
        for i in members {
            let i = at(*i);
            self.name(isolation, i, chosen, before, &gauges[i]);
        }
        test_alternative(isolation, d, members, chosen, before);
    }

    /// Latches which gauges departed from a sound prediction in the sample in which a direction
    /// began to disagree: later, two that err alike have drawn the prediction along, and it
    /// contradicts the third. A disagreement that grows slowly latches none.
    #[inline]
    pub(super) fn follow_jump(
        &self,
        isolation: &mut Isolation,
        d: usize,
        members: &[u8],
        cost: f32,
        (gauges, prior): (&[Gauge; MAX_CHANNELS], Prior),
    ) {
        let agreed = isolation.calm & bit(d) != 0;
        if cost <= CALM {
            isolation.calm |= bit(d);
            if isolation.jumped != 0
                && isolation.none[d] <= CALM
                && is_trusted(isolation, d, members)
            {
                isolation.jumped &= !set(members);
            }
        } else {
            isolation.calm &= !bit(d);
            let begins = agreed && cost > 1.0;
            if begins && is_trusted(isolation, d, members) && self.is_anchored(isolation, d) {
                let departed = self.departed(members, gauges, prior);
                isolation.jumped = isolation.jumped & !set(members) | departed;
            }
        }
    }

    /// Gauges that contradict a prediction that was sound.
    fn against(&self, isolation: &Isolation, d: usize, members: &[u8]) -> u8 {
        (members.iter())
            .filter(|i| self.is_anchored(isolation, d) && isolation.prior[at(**i)] > RETURN)
            .fold(0, |set, i| set | bit((*i).into()))
    }

    fn is_anchored(&self, isolation: &Isolation, d: usize) -> bool {
        f32::from(isolation.sound[d]) * self.consistency.forgetting >= ANCHORED
    }

    /// The cost that `voters` gauges do not exceed: the first of their residuals is at the limit,
    /// the others are noise.
    fn limit(&self, voters: usize) -> f32 {
        1.0 + voters.saturating_sub(2) as f32 / self.consistency.noise_bound
    }

    fn culprits(
        &self,
        isolation: &Isolation,
        d: usize,
        members: &[u8],
        before: u8,
    ) -> Option<Hypothesis> {
        let n = members.len();
        let leave = |left_out: u8| {
            Some(Hypothesis {
                left_out,
                ..Hypothesis::SOUND
            })
        };
        // A jump away from a prediction that was sound.
        let anchored = self.is_anchored(isolation, d);
        let against = self.against(isolation, d, members);
        let rest = n - against.count_ones() as usize;
        if against != 0 && rest > 1 && self.remain(isolation, members, against) {
            return leave(against);
        }
        // The prediction is no evidence where all, or none, are off it.
        let accused = |i: usize| against == 0 || rest == 0 || against & bit(i) != 0;
        if n > 2 {
            let lowest =
                |a: &usize, b: &usize| isolation.single[*a].total_cmp(&isolation.single[*b]);
            // What explains the readings so far is kept as long as it does.
            let kept = (members.iter().map(|i| at(*i)))
                .find(|i| bit(*i) == before && isolation.single[*i] <= self.limit(n - 1));
            let single = match kept {
                Some(single) => single,
                None => members.iter().map(|i| at(*i)).min_by(lowest)?,
            };
            let explains = isolation.single[single] <= self.limit(n - 1)
                && accused(single)
                && agrees(isolation, members, single);
            let pairs = || {
                (members.iter().enumerate())
                    .flat_map(|(q, j)| members.iter().take(q).map(|i| (at(*i), at(*j))))
            };
            let cheapest = |costs: &[f32]| {
                pairs().min_by(|a, b| {
                    let cost = |(i, j): (usize, usize)| costs[pair(i, j)];
                    cost(*a).total_cmp(&cost(*b))
                })
            };
            let (i, j) = cheapest(&isolation.swap)?;
            let exchanged = isolation.swap[pair(i, j)] <= self.limit(n);
            // One gauge turned round, or two exchanged whose maps are opposite: the readings
            // are the same, the load is not.
            if explains && exchanged && against == 0 {
                return None;
            }
            if explains {
                return leave(bit(single));
            }
            if exchanged {
                return Some(Hypothesis {
                    left_out: bit(i) | bit(j),
                    swapped: true,
                    ambiguous: false,
                });
            }
            if n > 3 {
                let kept = pairs().find(|(i, j)| {
                    bit(*i) | bit(*j) == before && isolation.pair[pair(*i, *j)] <= self.limit(n - 2)
                });
                let (i, j) = kept.or_else(|| cheapest(&isolation.pair))?;
                let cost = isolation.pair[pair(i, j)];
                let rival = |(k, l): &(usize, usize)| {
                    (*k, *l) != (i, j) && isolation.pair[pair(*k, *l)] - cost <= RETURN
                };
                let alone = kept.is_some() || !pairs().any(|other| rival(&other));
                if cost <= self.limit(n - 2) && alone {
                    return leave(bit(i) | bit(j));
                }
            }
        }
        // One alone: only the prediction confirms it.
        if rest == 1 {
            return leave(against);
        }
        let alone = before != 0 && before.count_ones() as usize + 1 == n;
        if alone && against & !before == 0 && anchored {
            return leave(before);
        }
        None
    }

    /// Whether those that `against` leaves agree, as far as two at most are left out.
    fn remain(&self, isolation: &Isolation, members: &[u8], against: u8) -> bool {
        let mut out = members
            .iter()
            .map(|i| at(*i))
            .filter(|i| against & bit(*i) != 0);
        let n = members.len();
        match (out.next(), out.next(), out.next()) {
            (Some(i), None, None) => isolation.single[i] <= self.limit(n - 1),
            (Some(i), Some(j), None) => isolation.pair[pair(i, j)] <= self.limit(n - 2),
            _ => false,
        }
    }

    /// Names the kind of fault of gauge `i`.
    fn name(
        &self,
        isolation: &mut Isolation,
        i: usize,
        chosen: Hypothesis,
        before: u8,
        gauge: &Gauge,
    ) {
        if chosen.left_out & bit(i) == 0 {
            isolation.kinds[i] = Fault::None;
            return;
        }
        if before & bit(i) == 0 {
            isolation.moments[i] = Moments::default();
        }
        if gauge.value.is_some() {
            let reading = gauge.innovation + gauge.response;
            let tolerance = self.tolerance(i, gauge, 1.0);
            let moments = &mut isolation.moments[i];
            moments.push(reading, gauge.response, self.consistency.forgetting);
            isolation.kinds[i] = if chosen.swapped {
                Fault::Swapped
            } else {
                moments.kind(tolerance, self.consistency.forgetting)
            };
        }
    }
}

/// Whether no gauge of direction `d` is left out, and they do not contradict each other.
#[inline(never)]
fn is_trusted(isolation: &Isolation, d: usize, members: &[u8]) -> bool {
    isolation.left_out & set(members) == 0 && isolation.contradicted & bit(d) == 0
}

/// Of three gauges, the same wrong gain in two fits as well as the inverse gain in the third: the
/// fault is ambiguous unless the excluded gauge alone left the prediction in a jump.
fn test_alternative(
    isolation: &mut Isolation,
    d: usize,
    members: &[u8],
    chosen: Hypothesis,
    before: u8,
) {
    isolation.ambiguous &= !bit(d);
    if chosen.ambiguous {
        isolation.ambiguous |= bit(d);
    }
    if members.len() != 3 || chosen.left_out.count_ones() != 1 {
        return;
    }
    let out = chosen.left_out;
    if before != out {
        let alone = isolation.jumped & set(members) == out;
        isolation.outvoted = isolation.outvoted & !out | if alone { 0 } else { out };
    }
    let gain = members
        .iter()
        .any(|i| out & bit((*i).into()) != 0 && isolation.kinds[at(*i)] == Fault::Gain);
    if gain && isolation.outvoted & out != 0 {
        isolation.ambiguous |= bit(d);
    }
}

pub(super) fn at(i: u8) -> usize {
    usize::from(i) % MAX_CHANNELS
}

/// Whether no further gauge is at fault among those without `single`.
fn agrees(isolation: &Isolation, members: &[u8], single: usize) -> bool {
    members.len() <= 3
        || (members.iter().map(|i| at(*i)))
            .filter(|i| *i != single)
            .all(|i| {
                let (low, high) = (i.min(single), i.max(single));
                isolation.single[single] - isolation.pair[pair(low, high)] <= 1.0
            })
}
