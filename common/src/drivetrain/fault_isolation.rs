//! Tests redundant gauges of a drivetrain, which sense the same quantity, against each other in
//! each sample: computes the windowed residual cost of each fault hypothesis (parity space).
//! Inflates the variances of gauges and loads where the gauges disagree.
//!
//! The gauges of a direction read `y_i = p_i + m_i e + f_i + v_i`: `p_i` as predicted, `e` the
//! error of the prediction of what they sense, which they share, `f_i` a fault. With the weights
//! `w_i = 1 / t_i` the cost of a hypothesis that leaves the gauges `H` out is the least square of
//! what the others contradict each other by,
//!
//! `Q_H = sum w nu^2 - (sum w m nu)^2 / sum w m^2`,
//!
//! smoothed over a window: minus twice the log-likelihood, up to a constant. `t_i` is the
//! mean square of a residual that noise and model error exceed with the stated false-alarm rate,
//! so that one limit, 1, holds for every gauge and every hypothesis.
//!
//! Source: Gustafsson, Adaptive Filtering and Change Detection, 2000, chapters 6 and 11 (parity
//! space, generalised likelihood ratio); Birge 1932 (ratio of external to internal uncertainty).

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::drivetrain::fault_kind::Moments;
use crate::error::{Error, positive};
use crate::io::fault::Fault;
use crate::io::raw::MAX_CHANNELS;

/// Pairs of channels.
const PAIRS: usize = MAX_CHANNELS * (MAX_CHANNELS - 1) / 2;

/// Part of the limit below which a gauge that was left out is used again: half of it, so that
/// a residual near the limit does not switch it from sample to sample.
const RETURN: f32 = 0.5;

/// Part of the limit by which one sample counts at most: two samples isolate the largest fault,
/// and after it the window is below [`RETURN`] within four time constants.
const MOST_OF_LIMIT: f32 = 0.5;

/// Angle by which a map is turned against the gauge, one standard deviation [rad]: a gauge, or the
/// index pulse, a centimetre off on a radius of a metre.
pub(super) const MISPLACED: f32 = 0.01;

/// Windows for which gauges agree before the prediction made with them counts against them.
pub(crate) const ANCHORED: f32 = 5.0;

/// Ratio of the disagreement to the noise by which a variance grows at most.
const MOST_RATIO: f32 = 1e4;

/// What the consistency tests of a model allow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Consistency {
    /// Part of a window's mean that one sample replaces, above 0 to 1.
    pub forgetting: f32,
    /// Mean of chi-squared over the window that noise alone exceeds with the false-alarm rate, > 1.
    pub noise_bound: f32,
    /// Square of a Gaussian model error that is exceeded with that rate (variances), > 1.
    pub model_bound: f32,
    /// Turn of the carrier in a sample beyond which no load takes it (rad), > 0.
    pub most_turn: f32,
}

impl Consistency {
    pub(crate) fn check(&self) -> Result<(), Error> {
        positive([self.forgetting, self.most_turn], "consistency")?;
        let over = |bound: f32| bound > 1.0 && bound.is_finite();
        if self.forgetting <= 1.0 && over(self.noise_bound) && over(self.model_bound) {
            Ok(())
        } else {
            Err(Error::OutOfRange("consistency"))
        }
    }
}

/// One gauge in one sample.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Gauge {
    /// The reading, in the channel's unit; nothing else counts without it.
    pub value: Option<f32>,
    /// Reading minus prediction.
    pub innovation: f32,
    /// Predicted part of the reading that is the response to what is sensed.
    pub response: f32,
    /// Slope of the reading over what is sensed.
    pub sensitivity: f32,
    /// Variance of the reading.
    pub variance: f32,
    /// Variance of an error of the map that stays for longer than the window.
    pub persistent: f32,
}

/// What is known of a direction before its gauges are read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    /// What is sensed, in parts of nominal.
    pub sensed: f32,
    /// Its variance.
    pub variance: f32,
}

/// Windowed costs of the hypotheses, and the gauges that were excluded.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Isolation {
    none: [f32; MAX_CHANNELS],
    single: [f32; MAX_CHANNELS],
    pair: [f32; PAIRS],
    swap: [f32; PAIRS],
    /// Cost of each gauge against the prediction.
    prior: [f32; MAX_CHANNELS],
    /// Square of the gauges' disagreement over that of their noise, direction by direction.
    ratio: [f32; MAX_CHANNELS],
    /// Variance of what each gauge alone makes of what is sensed.
    spread: [f32; MAX_CHANNELS],
    /// Normalised innovation squared of all gauges of a direction together.
    nis: [f32; MAX_CHANNELS],
    left_out: u8,
    kinds: [Fault; MAX_CHANNELS],
    moments: [Moments; MAX_CHANNELS],
    /// Directions whose gauges contradict each other and none is isolated.
    contradicted: u8,
    /// Gauges that only two others, and not the prediction, contradicted when they were left out.
    outvoted: u8,
    /// Directions where two gauges with the same gain explain the readings as simply as the one
    /// that is left out.
    ambiguous: u8,
    /// Directions whose gauges agreed in the sample before.
    calm: u8,
    /// Gauges that left a sound prediction within one sample, before they could draw it along.
    jumped: u8,
    /// The pair of each direction that is tested next for exchanged readings.
    turns: [u8; MAX_CHANNELS],
    /// Samples for which the gauges of a direction were sound since the start.
    sound: [u16; MAX_CHANNELS],
    /// Square of each gauge's reading over that at the limit without a load.
    silent: [f32; MAX_CHANNELS],
    /// Gauges that were left out while the others read a load.
    confirmed: u8,
}

impl Default for Isolation {
    fn default() -> Self {
        Self {
            none: [0.0; MAX_CHANNELS],
            single: [0.0; MAX_CHANNELS],
            pair: [0.0; PAIRS],
            swap: [0.0; PAIRS],
            prior: [0.0; MAX_CHANNELS],
            ratio: [1.0; MAX_CHANNELS],
            spread: [0.0; MAX_CHANNELS],
            nis: [1.0; MAX_CHANNELS],
            left_out: 0,
            kinds: [Fault::None; MAX_CHANNELS],
            moments: [Moments::default(); MAX_CHANNELS],
            contradicted: 0,
            outvoted: 0,
            ambiguous: 0,
            calm: 0,
            jumped: 0,
            turns: [0; MAX_CHANNELS],
            sound: [0; MAX_CHANNELS],
            silent: [0.0; MAX_CHANNELS],
            confirmed: 0,
        }
    }
}

impl Isolation {
    /// Why gauge `i` is left out; none where it is used.
    pub(crate) fn fault(&self, i: usize) -> Option<Fault> {
        let out = self.left_out & (1 << (i % MAX_CHANNELS)) != 0;
        out.then(|| self.kinds.get(i).copied().unwrap_or(Fault::Erratic))
    }

    /// Whether the gauges of direction `d` contradict each other and none is isolated.
    pub(crate) fn contradicts(&self, d: usize) -> bool {
        self.contradicted & (1 << (d % MAX_CHANNELS)) != 0
    }

    /// Whether any do, or whether another hypothesis is as simple as the one that was chosen.
    pub(crate) fn contradicted(&self) -> bool {
        self.contradicted | self.ambiguous != 0
    }
}

/// The gauges that sense the same.
#[derive(Clone, Debug)]
pub(crate) struct Direction {
    /// Their channels, ascending.
    pub members: Vec<u8, MAX_CHANNELS, u8>,
}

/// The tests, fixed after start.
#[derive(Clone, Debug)]
pub(crate) struct FaultIsolation {
    consistency: Consistency,
    /// Mean square residual that a model error makes at the limit: of the zero, and in parts of
    /// the square of what is sensed.
    tolerances: [[f32; 2]; MAX_CHANNELS],
    /// Unit of each channel [SI].
    units: [f32; MAX_CHANNELS],
}

/// Weighted sums over gauges.
#[derive(Clone, Copy, Default)]
struct Sums {
    information: f32,
    mean: f32,
    square: f32,
}

impl Sums {
    fn of(innovation: f32, sensitivity: f32, variance: f32) -> Self {
        let weight = 1.0 / variance;
        let along = sensitivity * weight;
        Self {
            information: sensitivity * along,
            mean: along * innovation,
            square: innovation * innovation * weight,
        }
    }

    fn plus(self, other: Self) -> Self {
        Self {
            information: self.information + other.information,
            mean: self.mean + other.mean,
            square: self.square + other.square,
        }
    }

    fn minus(self, other: Self) -> Self {
        Self {
            information: self.information - other.information,
            mean: self.mean - other.mean,
            square: self.square - other.square,
        }
    }

    /// `Q`; 0 where nothing is sensed, at most `most`, also where it is no number.
    fn cost(self, most: f32) -> f32 {
        let cost = self.square - self.mean * self.mean / self.information;
        if self.information > 0.0 {
            limited(cost, most)
        } else {
            0.0
        }
    }
}

/// `value` between 0 and `most`; 0 for NaN. Compared, since a Cortex-M4 calls a function for `max`.
fn limited(value: f32, most: f32) -> f32 {
    if value > 0.0 {
        if value < most { value } else { most }
    } else {
        0.0
    }
}

/// The larger one; the first where either is NaN.
fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// Where the pair of channels `i < j` stands.
fn pair(i: usize, j: usize) -> usize {
    (j * j.wrapping_sub(1) / 2 + i) % PAIRS
}

impl FaultIsolation {
    pub(crate) fn new(
        consistency: Consistency,
        errors: impl Iterator<Item = ([f32; 2], f32)>,
    ) -> Self {
        let mut fault_isolation = Self {
            consistency,
            tolerances: [[0.0; 2]; MAX_CHANNELS],
            units: [1.0; MAX_CHANNELS],
        };
        let slots = fault_isolation
            .tolerances
            .iter_mut()
            .zip(&mut fault_isolation.units);
        for ((tolerance, unit), (error, of)) in slots.zip(errors) {
            *tolerance = error.map(|std| consistency.model_bound * std * std);
            *unit = of;
        }
        fault_isolation
    }

    fn smooth(&self, mean: &mut f32, value: f32) {
        *mean += self.consistency.forgetting * (value - *mean);
    }

    /// Takes the readings of direction `d` in, and decides which gauges are left out.
    #[inline(never)]
    pub(crate) fn weigh(
        &self,
        isolation: &mut Isolation,
        d: usize,
        direction: &Direction,
        gauges: &[Gauge; MAX_CHANNELS],
        prior: Prior,
    ) {
        let most = MOST_OF_LIMIT / self.consistency.forgetting;
        let d = d % MAX_CHANNELS;
        let members = &direction.members;
        let mut sums = [Sums::default(); MAX_CHANNELS];
        if members.len() > 1 {
            let mut all = Sums::default();
            for (slot, i) in sums.iter_mut().zip(members) {
                let i = usize::from(*i) % MAX_CHANNELS;
                let gauge = &gauges[i];
                if gauge.value.is_some() {
                    let tolerance = self.tolerance(i, gauge, prior.sensed);
                    *slot = Sums::of(gauge.innovation, gauge.sensitivity, tolerance);
                    all = all.plus(*slot);
                    let against = self.against_prediction(gauge, prior, tolerance);
                    self.smooth(&mut isolation.prior[i], limited(against, most));
                }
            }
            let cost = all.cost(most);
            self.follow_jump(isolation, d, members, cost, (gauges, prior));
            self.smooth(&mut isolation.none[d], cost);
            for (q, j) in members.iter().enumerate() {
                let j = usize::from(*j) % MAX_CHANNELS;
                let without = all.minus(sums[q % MAX_CHANNELS]);
                self.smooth(&mut isolation.single[j], without.cost(most));
                for (p, i) in members.iter().take(q).enumerate() {
                    let cost = without.minus(sums[p % MAX_CHANNELS]).cost(most);
                    self.smooth(&mut isolation.pair[pair(usize::from(*i), j)], cost);
                }
            }
            if members.len() > 2 {
                self.swapped(isolation, (d, members), gauges, &sums, all);
            }
            self.decide(isolation, d, members, gauges);
        }
        self.grow(isolation, d, members, (gauges, &sums), prior);
    }

    /// Squared innovation over its limit.
    #[inline]
    fn against_prediction(&self, gauge: &Gauge, prior: Prior, tolerance: f32) -> f32 {
        let m = gauge.sensitivity;
        let own = self.consistency.noise_bound * m * m * prior.variance + tolerance;
        gauge.innovation * gauge.innovation / own
    }

    /// The gauges of `members` that are off the prediction, one bit each.
    #[inline(never)]
    fn departed(&self, members: &[u8], gauges: &[Gauge; MAX_CHANNELS], prior: Prior) -> u8 {
        let mut departed = 0;
        for i in members {
            let i = usize::from(*i) % MAX_CHANNELS;
            let gauge = &gauges[i];
            let tolerance = self.tolerance(i, gauge, prior.sensed);
            if gauge.value.is_some() && self.against_prediction(gauge, prior, tolerance) > RETURN {
                departed |= 1 << i;
            }
        }
        departed
    }

    /// Mean square residual at the limit.
    fn tolerance(&self, i: usize, gauge: &Gauge, sensed: f32) -> f32 {
        let [zero, share] = self.tolerances[i % MAX_CHANNELS];
        let sensed = sensed * sensed;
        self.consistency.noise_bound * gauge.variance
            + zero
            + share * sensed
            + self.consistency.model_bound * gauge.persistent
    }

    /// Cost of the next pair whose readings may be each other's, one pair a sample.
    fn swapped(
        &self,
        isolation: &mut Isolation,
        (d, members): (usize, &[u8]),
        gauges: &[Gauge; MAX_CHANNELS],
        sums: &[Sums; MAX_CHANNELS],
        all: Sums,
    ) {
        let n = members.len();
        let pairs = n * (n - 1) / 2;
        let next = &mut isolation.turns[d % MAX_CHANNELS];
        let turn = usize::from(*next).checked_rem(pairs).unwrap_or(0);
        *next = (turn + 1) as u8;
        let (mut q, mut first) = (1, 0);
        while first + q <= turn {
            first += q;
            q += 1;
        }
        let p = turn - first;
        let at = |place: usize| members.get(place).map_or(0, |i| usize::from(*i)) % MAX_CHANNELS;
        let (i, j) = (at(p), at(q));
        let (a, b) = (&gauges[i], &gauges[j]);
        let (Some(ya), Some(yb)) = (a.value, b.value) else {
            return;
        };
        // The reading of one through the converter of the other.
        let (from_a, from_b) = (self.units[i] / self.units[j], self.units[j] / self.units[i]);
        let exchanged = |gauge: &Gauge, sums: &Sums, by: f32| {
            let nu = gauge.innovation + by;
            let weight = sums.information / (gauge.sensitivity * gauge.sensitivity);
            Sums {
                information: sums.information,
                mean: gauge.sensitivity * weight * nu,
                square: weight * nu * nu,
            }
        };
        let (sa, sb) = (&sums[p % MAX_CHANNELS], &sums[q % MAX_CHANNELS]);
        let swapped = (all.minus(*sa).minus(*sb))
            .plus(exchanged(a, sa, yb * from_b - ya))
            .plus(exchanged(b, sb, ya * from_a - yb));
        let forgetting = limited(self.consistency.forgetting * pairs as f32, 1.0);
        let cost = swapped.cost(MOST_OF_LIMIT / self.consistency.forgetting);
        let mean = &mut isolation.swap[pair(i, j)];
        *mean += forgetting * (cost - *mean);
    }

    /// Follows the factors by which the disagreement of the gauges in use inflates the variances.
    fn grow(
        &self,
        isolation: &mut Isolation,
        d: usize,
        members: &[u8],
        (gauges, sums): (&[Gauge; MAX_CHANNELS], &[Sums; MAX_CHANNELS]),
        prior: Prior,
    ) {
        let (mut by_noise, mut by_tolerance) = (Sums::default(), Sums::default());
        let mut used = 0_u8;
        for (i, sums) in members.iter().zip(sums) {
            let i = usize::from(*i) % MAX_CHANNELS;
            let gauge = &gauges[i];
            if gauge.value.is_none() || isolation.left_out & (1 << i) != 0 {
                continue;
            }
            used += 1;
            let (nu, m) = (gauge.innovation, gauge.sensitivity);
            by_noise = by_noise.plus(Sums::of(nu, m, gauge.variance));
            by_tolerance = by_tolerance.plus(*sums);
        }
        if used > 1 {
            let ratio = by_noise.cost(MOST_RATIO) / f32::from(used - 1);
            self.smooth(&mut isolation.ratio[d], ratio);
            if by_tolerance.information > 0.0 {
                let spread = by_tolerance.cost(MOST_RATIO) / by_tolerance.information;
                self.smooth(&mut isolation.spread[d], limited(spread, MOST_RATIO));
            }
        } else {
            isolation.ratio[d] = 1.0;
            isolation.spread[d] = 0.0;
        }
        if by_noise.information > 0.0 {
            let nu = by_noise.mean / by_noise.information;
            let s = prior.variance + self.inflation(isolation, d) / by_noise.information;
            let most = MOST_OF_LIMIT / self.consistency.forgetting;
            self.smooth(&mut isolation.nis[d], limited(nu * nu / s, most));
        }
    }

    /// Factor of the variances of the readings of direction `d`: 1 where noise explains their
    /// disagreement.
    pub(crate) fn inflation(&self, isolation: &Isolation, d: usize) -> f32 {
        let ratio = isolation.ratio[d % MAX_CHANNELS];
        if ratio > self.consistency.noise_bound {
            ratio
        } else {
            1.0
        }
    }

    /// Factor of a load's variance, and what is added to it [parts of nominal squared].
    pub(crate) fn deviation(&self, isolation: &Isolation, directions: usize) -> (f32, f32) {
        let (mut factor, mut added) = (1.0_f32, 0.0_f32);
        for d in 0..directions.min(MAX_CHANNELS) {
            if isolation.nis[d] > self.consistency.noise_bound {
                factor = larger(factor, isolation.nis[d]);
            }
            if isolation.ratio[d] > self.consistency.noise_bound {
                added = larger(added, isolation.spread[d]);
            }
        }
        (factor, added)
    }
}

mod decision;
mod silence;

#[cfg(test)]
mod tests;
