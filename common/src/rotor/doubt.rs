//! Whether a rotor is as it is described, by the whiteness of the innovations.
//!
//! Where the model holds, an innovation says nothing of the next one, however much sensors are
//! noisy; where it errs, both have what it errs by. The process noise that a description has
//! lets unbalances be found to the last digit, and stands against a rotor that is some
//! per mille softer. So there is a second noise, for the time in which the model is doubted.
//!
//! Source: Mehra, On the identification of variances and adaptive Kalman filtering, IEEE Trans.
//! Autom. Control 15 (1970), section II.

use crate::estimate::SensorEstimate;
use crate::raw::MAX_CHANNELS;

/// Pairs of samples after which is judged. The correlation of white noise deviates by less
/// than 1/16, and less the more sensors there are.
const PAIRS: u16 = 256;

/// Correlation that is let pass, and what comes above it, all in all, before the model is
/// doubted (Page, Continuous inspection schemes, Biometrika 41 (1954)): of one judgement 0.5, half
/// of an innovation, or something that is small and stays. By chance in one of 10^9.
const PASSED: f32 = 0.1;
const DOUBTED: f32 = 0.4;

/// Judgements in which a start dies away, and in which the filter finds to a model that it doubts.
const STARTING: u32 = 1;
const FINDING: u32 = 2;

/// Judgements for which a doubt lasts, or for which there is none after one that explained nothing;
/// and by how many doublings at most it is longer each time.
const SHORTEST: u32 = 8;
const DOUBLINGS: u32 = 8;

/// Sums over pairs of innovations of one sensor, `d = nu - m`.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// `m`, the mean at the last judgement.
    mean: f32,
    /// The first `d` of the pair under way.
    first: f32,
    /// `sum d`, of the first ones and of the second ones.
    values: [f32; 2],
    /// `sum d^2` of the second ones.
    square: f32,
    /// `sum d d'`
    product: f32,
}

/// Whether the model is doubted.
#[derive(Clone, Debug)]
pub struct Doubt {
    sums: [Sums; MAX_CHANNELS],
    /// Whether the pair under way has its first sample.
    half: bool,
    pairs: u16,
    doubted: bool,
    /// Correlation above what is let pass, so far.
    above: f32,
    /// What neighbours had in common when it was last doubted, in variances.
    cause: f32,
    /// Judgements since that changed, and until it may again.
    since: u32,
    until: u32,
    /// How often it was doubted.
    times: u32,
}

impl Default for Doubt {
    /// No doubt.
    fn default() -> Self {
        Self {
            sums: [Sums::default(); MAX_CHANNELS],
            half: false,
            pairs: 0,
            doubted: false,
            above: 0.0,
            cause: 0.0,
            since: 0,
            until: STARTING,
            times: 0,
        }
    }
}

impl Doubt {
    /// Whether the model is doubted.
    pub fn doubted(&self) -> bool {
        self.doubted
    }

    /// Samples are missing: the next one has none before it.
    pub fn skip(&mut self) {
        self.half = false;
    }

    /// Takes in a sample; true where that changes whether the model is doubted.
    ///
    /// `r = sum_i c_i / s_i / sum_i p_i / s_i` over the sensors `i`, with the covariance `c_i` of
    /// neighbours about their mean, and the mean square `p_i`: a sensor that is off by a constant
    /// is not the model, and hides it.
    pub fn push(&mut self, sensors: &[SensorEstimate]) -> bool {
        let all = self.sums.iter_mut().zip(sensors);
        if !self.half {
            all.for_each(|(sums, sensor)| sums.first = sensor.innovation - sums.mean);
            self.half = true;
            return false;
        }
        for (sums, sensor) in all {
            let d = sensor.innovation - sums.mean;
            sums.values[0] += sums.first;
            sums.values[1] += d;
            sums.square += d * d;
            sums.product += d * sums.first;
        }
        self.half = false;
        self.pairs += 1;
        self.pairs == PAIRS && self.judge(sensors)
    }

    /// In doubt, what neighbours have in common has to be gone by half: what a sensor tells
    /// wrongly, no noise of the model explains.
    #[cold]
    fn judge(&mut self, sensors: &[SensorEstimate]) -> bool {
        let (mut varying, mut constant, mut square) = (0.0, 0.0, 0.0);
        let n = f32::from(PAIRS);
        for (sums, sensor) in self.sums.iter_mut().zip(sensors) {
            let [first, second] = sums.values;
            let mean = sums.mean + second / n;
            let mean = if mean.is_finite() { mean } else { 0.0 };
            // 0 where there is no reading, and neither sum.
            let variance = sensor.innovation_variance;
            let unit = if variance > 0.0 { 1.0 / variance } else { 0.0 };
            varying += unit * (sums.product - first * (second / n));
            constant += unit * (n * mean * mean);
            square += unit * (sums.square - second * (second / n));
            *sums = Sums {
                mean,
                ..Sums::default()
            };
        }
        let (common, square) = (varying + constant, square + constant);
        self.pairs = 0;
        self.since = self.since.saturating_add(1);
        let over = self.since > self.until;
        let longer = SHORTEST << self.times.min(DOUBLINGS);
        if self.doubted {
            let vain = self.since > FINDING && common > 0.5 * self.cause;
            if !(vain || over) {
                return false;
            }
            self.until = if vain { longer } else { 0 };
        } else {
            let above = self.above + varying / square - PASSED;
            // 0 where it is no number.
            self.above = if over && above > 0.0 { above } else { 0.0 };
            if self.above <= DOUBTED {
                return false;
            }
            (self.cause, self.until) = (common, longer);
            self.times = self.times.saturating_add(1);
        }
        self.doubted = !self.doubted;
        (self.since, self.above) = (0, 0.0);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise of variance 1/12 from a linear congruential generator.
    struct Noise(u32);

    impl Noise {
        fn next(&mut self) -> f32 {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (self.0 >> 8) as f32 / (1 << 24) as f32 - 0.5
        }
    }

    /// `judgements` of two sensors that read noise and `more` of the sample, as long as `doubted` is
    /// what it was; how many there were.
    fn run(doubt: &mut Doubt, judgements: u32, more: impl Fn(u32) -> f32) -> u32 {
        let mut noise = Noise(7);
        for k in 0..judgements * 2 * u32::from(PAIRS) {
            let sensors = [1.0, -0.5].map(|part| SensorEstimate {
                innovation: noise.next() + part * more(k),
                innovation_variance: 1.0 / 12.0,
                ..SensorEstimate::default()
            });
            if doubt.push(&sensors) {
                return k / (2 * u32::from(PAIRS)) + 1;
            }
        }
        judgements
    }

    fn turning(k: u32) -> f32 {
        libm::sinf(0.05 * k as f32)
    }

    #[test]
    fn noise_and_constants_are_no_reason_for_doubt() {
        for constant in [0.0, 0.2, 50.0] {
            let mut doubt = Doubt::default();
            run(&mut doubt, 2000, |_| constant);
            assert!(!doubt.doubted(), "{constant}");
        }
        // Not even beside something that turns.
        let mut doubt = Doubt::default();
        run(&mut doubt, 100, |k| 50.0 + turning(k));
        assert!(!doubt.doubted());
    }

    #[test]
    fn what_turns_is_doubted_at_once_or_after_a_while() {
        let mut doubt = Doubt::default();
        assert_eq!(run(&mut doubt, 20, turning), STARTING + 1);
        assert!(doubt.doubted());
        let mut doubt = Doubt::default();
        let found = run(&mut doubt, 100, |k| 0.25 * turning(k));
        assert!(doubt.doubted() && found > STARTING + 1, "{found}");
    }

    #[test]
    fn the_model_is_tried_again_less_and_less_often() {
        let mut doubt = Doubt::default();
        let mut lasted = [0; 4];
        for slot in &mut lasted {
            run(&mut doubt, 20, turning);
            assert!(doubt.doubted());
            *slot = run(&mut doubt, 1000, |_| 0.0);
            assert!(!doubt.doubted());
        }
        assert_eq!(lasted, [8, 16, 32, 64].map(|judgements| judgements + 1));
    }

    #[test]
    fn a_doubt_that_explains_nothing_is_given_up() {
        let mut doubt = Doubt::default();
        run(&mut doubt, 20, turning);
        assert_eq!(run(&mut doubt, 20, turning), FINDING + 1);
        assert!(!doubt.doubted());
        assert_eq!(run(&mut doubt, 20, turning), SHORTEST * 2 + 1);
    }

    #[test]
    fn numbers_that_are_none_are_forgotten() {
        let mut doubt = Doubt::default();
        run(&mut doubt, 3, |_| f32::NAN);
        assert!(!doubt.doubted());
        run(&mut doubt, 3, turning);
        assert!(doubt.doubted());
    }
}
