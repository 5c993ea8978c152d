//! Computes the statistics of a column by which its kind is recognised (`Statistics`): range, white
//! noise, quantisation step, width of a counter that wraps, steadiness of motion, part of empty
//! rows.

use loadtwin_math::count_unwrapping::unwrapped;

/// Values that are enough for figures of noise.
const FIGURES: usize = 1 << 16;

/// Width of a converter beyond which values have no step that is its count (bit).
const WIDEST_BITS: f64 = 26.0;

/// Bits of a hardware counter.
const COUNTERS: std::ops::RangeInclusive<u32> = 8..=32;

/// Figures of the values of a column, in its unit where none is given.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    /// Least value.
    pub least: f64,
    /// Largest value.
    pub most: f64,
    /// Part of the rows without a value.
    pub empty: f64,
    /// Part of the rows with the most frequent value.
    pub idle: f64,
    /// Different values, 3 at most.
    pub different: usize,
    /// Whether all values are whole numbers.
    pub is_whole: bool,
    /// Standard deviation of the white noise.
    pub noise_std: f64,
    /// Step between values, where they are whole numbers of it.
    pub step: Option<f64>,
    /// Width of the counter that the values wrap around as (bit).
    pub wraps_at_bits: Option<u32>,
    /// Motion from the first to the last value, with the wraps taken out.
    pub motion: f64,
    /// Whether it moves steadily, as a count does.
    pub moves_as_a_counter: bool,
}

impl Statistics {
    /// Of `values`, NaN where there is none; none where all are.
    pub fn of(values: &[f64]) -> Option<Self> {
        let known: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        let mut sorted: Vec<f64> = known.iter().take(FIGURES).copied().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let (least, most) = (
            known.iter().copied().reduce(f64::min)?,
            known.iter().copied().reduce(f64::max)?,
        );
        let is_whole = known.iter().all(|v| v.fract() == 0.0);
        let runs = sorted.chunk_by(|a, b| a == b);
        let idle = runs.clone().map(<[f64]>::len).max().unwrap_or(0);
        let wraps_at_bits = if is_whole {
            wrap(&known, least, most)
        } else {
            None
        };
        let unwrapped = match wraps_at_bits {
            Some(bits) => unwrapped(&known, f64::from(bits).exp2()),
            None => known.clone(),
        };
        let step = step(&sorted);
        Some(Self {
            least,
            most,
            empty: 1.0 - known.len() as f64 / values.len() as f64,
            idle: idle as f64 / sorted.len() as f64,
            different: runs.take(3).count(),
            is_whole,
            noise_std: noise_std(&unwrapped).max(step.unwrap_or(0.0) * 12.0_f64.sqrt().recip()),
            step,
            wraps_at_bits,
            motion: unwrapped.last()? - unwrapped.first()?,
            moves_as_a_counter: is_steady(&unwrapped),
        })
    }

    /// Whether few rows say something, as those of an index pulse.
    pub fn is_sparse(&self) -> bool {
        self.empty > 0.5
            || (self.different < 3 && self.different > 1)
            || (self.idle > 0.9 && self.different > 1)
    }
}

/// Width of the counter where a step by nearly the whole range shows one.
fn wrap(values: &[f64], least: f64, most: f64) -> Option<u32> {
    let largest = values
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .fold(0.0, f64::max);
    let bits = COUNTERS.min_by(|a, b| {
        let off = |bits: u32| (f64::from(bits).exp2() - (most - least + 1.0)).abs();
        off(*a).total_cmp(&off(*b))
    })?;
    let modulus = f64::from(bits).exp2();
    (largest > 0.75 * modulus && most - least < modulus && most - least > 0.75 * modulus)
        .then_some(bits)
}

/// From the median of second differences, `sqrt 6` times the noise of a value.
fn noise_std(values: &[f64]) -> f64 {
    /// Median of the size of a standard normal number.
    const MEDIAN: f64 = 0.674_489_750_196_082;
    let values = &values[..values.len().min(FIGURES)];
    let mut second: Vec<f64> = values
        .windows(3)
        .map(|w| (w[2] - 2.0 * w[1] + w[0]).abs())
        .collect();
    second.sort_unstable_by(f64::total_cmp);
    let median = second.get(second.len() / 2).copied().unwrap_or(0.0);
    median / MEDIAN / 6.0_f64.sqrt()
}

/// The step of which all values are whole numbers apart; none where they have none.
fn step(sorted: &[f64]) -> Option<f64> {
    let (least, most) = (*sorted.first()?, *sorted.last()?);
    let apart = sorted.windows(2).map(|pair| pair[1] - pair[0]);
    // Numbers of six digits and more are rounded in their last one.
    let fine = 1e-9 * most.abs().max(least.abs());
    let step = apart.filter(|step| *step > fine).reduce(f64::min)?;
    let is_multiple = |value: &f64| {
        let steps = (value - least) / step;
        (steps - steps.round()).abs() < 0.02
    };
    let is_fine = ((most - least) / step).log2() > WIDEST_BITS;
    (!is_fine && sorted.iter().all(is_multiple)).then_some(step)
}

/// Whether changes of the step are small against the steps, over spans in which it moves.
fn is_steady(values: &[f64]) -> bool {
    let total = values
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .sum::<f64>();
    let mean = total / values.len().max(1) as f64;
    // Spans of eight counts and more, so that rounding does not matter.
    let span = if mean > 0.0 {
        (8.0 / mean).ceil() as usize
    } else {
        return false;
    };
    let span = span.clamp(1, values.len().div_ceil(8).max(1));
    let rough: Vec<f64> = values.iter().step_by(span).copied().collect();
    let first: f64 = rough.windows(2).map(|w| (w[1] - w[0]).abs()).sum();
    let second: f64 = rough
        .windows(3)
        .map(|w| (w[2] - 2.0 * w[1] + w[0]).abs())
        .sum();
    rough.len() > 4 && second < 0.5 * first
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counter_with_its_width_and_direction() {
        let values: Vec<f64> = (0..5000)
            .map(|i| f64::from((70_000 - 37 * i) & 0xFFFF))
            .collect();
        let found = Statistics::of(&values).unwrap();
        assert_eq!(found.wraps_at_bits, Some(16));
        assert_eq!(found.motion, -37.0 * 4999.0);
        assert!(found.moves_as_a_counter && found.is_whole);
        let slow: Vec<f64> = (0..5000).map(|i| f64::from(i / 11)).collect();
        let slow = Statistics::of(&slow).unwrap();
        assert!(slow.moves_as_a_counter && slow.wraps_at_bits.is_none());
    }

    #[test]
    fn noise_and_step_of_a_converter() {
        // A linear congruential generator, so that the noise is the same each time.
        let mut seed = 1_u32;
        let mut uniform = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24)
        };
        let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        let values: Vec<f64> = (0..20_000)
            .map(|i| {
                let value = f64::from(i) * 1e-3 + 0.3 * normal();
                (value / 0.01).round() * 0.01
            })
            .collect();
        let found = Statistics::of(&values).unwrap();
        assert!((found.noise_std / 0.3 - 1.0).abs() < 0.03, "{found:?}");
        assert!((found.step.unwrap() / 0.01 - 1.0).abs() < 1e-6, "{found:?}");
        assert!(!found.moves_as_a_counter && !found.is_sparse());
        assert_eq!(Statistics::of(&[f64::NAN, f64::NAN]), None);
    }

    #[test]
    fn a_pulse_is_sparse() {
        let level: Vec<f64> = (0..1000)
            .map(|i| f64::from(u8::from(i % 100 < 3)))
            .collect();
        assert!(Statistics::of(&level).unwrap().is_sparse());
        let latched: Vec<f64> = (0..1000)
            .map(|i| if i % 100 == 0 { f64::from(i) } else { f64::NAN })
            .collect();
        assert!(Statistics::of(&latched).unwrap().is_sparse());
        let constant = Statistics::of(&[2.0; 50]).unwrap();
        assert!(!constant.is_sparse());
    }
}
