//! Computes the spectral densities of signals and their coherence with others by Welch's method,
//! sample by sample, with the bounds of white noise and of independent signals.

use std::sync::Arc;

use loadtwin_fft::{Complex, Fft};

use super::chi_squared_bounds;

/// Samples of a segment: the resolution is the rate over it, 2 Hz at 2 kHz.
pub const SEGMENT: usize = 1024;

/// Samples from the start of a segment to the next: half of it.
const STEP: usize = SEGMENT / 2;

/// Squared correlation of the spectra of two segments with a Hann window that overlap by half.
///
/// Source: Harris 1978, table I: 0.167 of correlation.
const OVERLAP: f64 = 1.0 / 36.0;

/// Lines of a spectrum, from 0 to half the rate.
const LINES: usize = SEGMENT / 2 + 1;

/// Spectral densities of some outputs, and their coherence with some inputs.
///
/// `S_xy(f) = 2 dt / sum(w^2) * mean over segments of conj(X(f)) Y(f)`, one-sided (at 0 and half
/// the rate without the 2), `X` the Fourier transform of a segment of 1024 samples less its mean,
/// times the periodic Hann window `w`; segments overlap by half. A segment with a value that is not
/// finite is left out. `coherence = |S_xy|^2 / (S_xx S_yy)`
///
/// Source: Welch 1967; Carter 1987 on the coherence.
pub struct Spectra {
    rate_hz: f64,
    fft: Arc<dyn Fft<f64>>,
    window: Vec<f64>,
    /// The last samples of each output, then of each input.
    signals: Vec<Vec<f64>>,
    outputs: Vec<Power>,
    /// Output by output, of each input.
    pairs: Vec<Cross>,
}

/// Sum of `|X|^2` over segments.
#[derive(Clone, Default)]
struct Power {
    segments: u32,
    sum: Vec<f64>,
}

/// Sums over the segments in which both signals are complete.
#[derive(Clone, Default)]
struct Cross {
    segments: u32,
    output: Vec<f64>,
    input: Vec<f64>,
    product: Vec<Complex<f64>>,
}

/// A spectral density.
#[derive(Clone, Debug)]
pub struct Density {
    /// At each of [`Spectra::frequencies_hz`] but 0 [unit^2/Hz].
    pub values: Vec<f64>,
    /// Between these lie 95 % of the values of white noise with the same variance [unit^2/Hz].
    pub white: [f64; 2],
}

/// The coherence of an output with an input.
#[derive(Clone, Debug)]
pub struct Coherence {
    /// At each of [`Spectra::frequencies_hz`] but 0; 0 to 1.
    pub values: Vec<f64>,
    /// Below this lie 95 % of the values of signals that have nothing in common.
    pub bound: f64,
}

impl Spectra {
    /// Nothing gathered yet, at `rate_hz` samples a second.
    pub fn new(outputs: usize, inputs: usize, rate_hz: f64) -> Self {
        let hann = |i: usize| {
            let turn = std::f64::consts::TAU * i as f64 / SEGMENT as f64;
            0.5 - 0.5 * turn.cos()
        };
        Self {
            rate_hz,
            fft: loadtwin_fft::forward(SEGMENT),
            window: (0..SEGMENT).map(hann).collect(),
            signals: vec![Vec::with_capacity(SEGMENT); outputs + inputs],
            outputs: vec![Power::default(); outputs],
            pairs: vec![Cross::default(); outputs * inputs],
        }
    }

    /// Takes the next sample: a value for each output, then for each input; NaN where there is
    /// none.
    pub fn push(&mut self, values: impl IntoIterator<Item = f64>) {
        let mut values = values.into_iter();
        for signal in &mut self.signals {
            signal.push(values.next().unwrap_or(f64::NAN));
        }
        if self.signals.first().map_or(0, Vec::len) == SEGMENT {
            self.add_segment();
            for signal in &mut self.signals {
                signal.drain(..STEP);
            }
        }
    }

    fn add_segment(&mut self) {
        let spectra: Vec<Option<Vec<Complex<f64>>>> = (self.signals.iter())
            .map(|signal| self.transformed(signal))
            .collect();
        let (outputs, inputs) = spectra.split_at(self.outputs.len());
        for (power, spectrum) in self.outputs.iter_mut().zip(outputs) {
            if let Some(spectrum) = spectrum {
                power.segments += 1;
                add(&mut power.sum, spectrum.iter().map(Complex::norm_sqr));
            }
        }
        let pairs = (outputs.iter()).flat_map(|x| inputs.iter().map(move |y| (x, y)));
        for (cross, pair) in self.pairs.iter_mut().zip(pairs) {
            if let (Some(x), Some(y)) = pair {
                cross.segments += 1;
                add(&mut cross.output, x.iter().map(Complex::norm_sqr));
                add(&mut cross.input, y.iter().map(Complex::norm_sqr));
                add(
                    &mut cross.product,
                    x.iter().zip(y).map(|(x, y)| x.conj() * y),
                );
            }
        }
    }

    /// Lines of a complete segment.
    fn transformed(&self, signal: &[f64]) -> Option<Vec<Complex<f64>>> {
        let mean = signal.iter().sum::<f64>() / SEGMENT as f64;
        if !mean.is_finite() {
            return None;
        }
        let mut segment: Vec<Complex<f64>> = (signal.iter().zip(&self.window))
            .map(|(x, w)| Complex::from((x - mean) * w))
            .collect();
        self.fft.process(&mut segment);
        segment.truncate(LINES);
        Some(segment)
    }

    /// Frequencies of the values (Hz): all lines but 0, where the mean was taken away.
    pub fn frequencies_hz(&self) -> Vec<f64> {
        let line_hz = self.rate_hz / SEGMENT as f64;
        (1..LINES).map(|line| line as f64 * line_hz).collect()
    }

    /// Spectral density of an output; `None` before its first complete segment.
    pub fn density(&self, output: usize) -> Option<Density> {
        let power = self.outputs.get(output).filter(|p| p.segments > 0)?;
        let squares: f64 = self.window.iter().map(|w| w * w).sum();
        let scale = 2.0 / (self.rate_hz * squares * f64::from(power.segments));
        let mut values: Vec<f64> = power.sum[1..].iter().map(|sum| sum * scale).collect();
        if let Some(last) = values.last_mut() {
            *last /= 2.0;
        }
        // The mean over the lines is the variance over the bandwidth.
        let level = values.iter().sum::<f64>() / (values.len() as f64 - 0.5);
        let degrees = 2.0 * independent(power.segments);
        let white = chi_squared_bounds(0.95, degrees).map(|bound| level * bound / degrees);
        Some(Density { values, white })
    }

    /// Coherence of an output with an input; `None` before the second segment in which both are
    /// complete, and of a signal that does not vary.
    pub fn coherence(&self, output: usize, input: usize) -> Option<Coherence> {
        let inputs = self.signals.len() - self.outputs.len();
        let cross = (self.pairs.get(output * inputs + input)).filter(|c| c.segments > 1)?;
        let lines = cross.output.iter().zip(&cross.input).zip(&cross.product);
        let values: Vec<f64> = (lines.skip(1))
            .map(|((x, y), product)| product.norm_sqr() / (x * y))
            .collect();
        // P(coherence > c) = (1 - c)^(n - 1) of n independent segments (Carter 1987).
        let bound = 1.0 - 0.05_f64.powf(1.0 / (independent(cross.segments) - 1.0).max(1e-9));
        (values.iter().all(|value| value.is_finite())).then_some(Coherence { values, bound })
    }
}

/// Independent segments that average as well as so many that overlap by half: Welch 1967.
fn independent(segments: u32) -> f64 {
    let n = f64::from(segments);
    n / (1.0 + 2.0 * OVERLAP * (n - 1.0) / n)
}

/// Adds to sums, which are empty at first.
fn add<T: Copy + std::ops::AddAssign>(sums: &mut Vec<T>, values: impl Iterator<Item = T>) {
    if sums.is_empty() {
        sums.extend(values);
    } else {
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference(key: &str) -> Vec<f64> {
        let text = include_str!("../../../tests/reference/spectra.json");
        let json: serde_json::Value = serde_json::from_str(text).unwrap();
        serde_json::from_value(json[key].clone()).unwrap()
    }

    /// Uniform numbers of the generator in `tests/reference/spectra.py`.
    fn noise(mut state: u32) -> impl FnMut() -> f64 {
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / 4_294_967_296.0
        }
    }

    #[test]
    fn equals_scipy() {
        let (mut a, mut b, mut level) = (noise(1), noise(2), 0.0);
        let mut spectra = Spectra::new(1, 1, 500.0);
        for _ in 0..5000 {
            let x = a();
            level = 0.6 * level + x;
            spectra.push([level + 100.0, x + b()]);
        }
        assert_eq!(spectra.frequencies_hz(), reference("f")[1..]);
        let density = spectra.density(0).unwrap().values;
        let coherence = spectra.coherence(0, 0).unwrap().values;
        for (found, key) in [(density, "density"), (coherence, "coherence")] {
            for (found, expected) in found.iter().zip(&reference(key)[1..]) {
                assert!(
                    (found - expected).abs() < 1e-9 * expected,
                    "{key}: {found} {expected}"
                );
            }
        }
    }

    /// Of two independent white sequences, 95 % of the lines are within the bounds of each.
    #[test]
    fn bounds_hold_for_white_noise() {
        let (mut a, mut b) = (noise(3), noise(4));
        let mut spectra = Spectra::new(1, 1, 1000.0);
        for _ in 0..50_000 {
            spectra.push([a(), b()]);
        }
        let density = spectra.density(0).unwrap();
        let is_inside = |v: &&f64| (density.white[0]..density.white[1]).contains(v);
        let inside = density.values.iter().filter(is_inside).count();
        // Variance 1/12 over 500 Hz.
        let level = density.values.iter().sum::<f64>() / 512.0;
        assert!((level - 1.0 / 6000.0).abs() < 3e-6, "{level}");
        let coherence = spectra.coherence(0, 0).unwrap();
        let below = coherence
            .values
            .iter()
            .filter(|v| **v < coherence.bound)
            .count();
        // Of 512 lines 486 +- 5, which the window ties to their neighbours.
        for count in [inside, below] {
            assert!((470..=502).contains(&count), "{inside} {below}");
        }
    }

    #[test]
    fn a_segment_with_a_gap_is_left_out_and_a_constant_has_no_coherence() {
        let mut a = noise(5);
        let mut spectra = Spectra::new(2, 1, 1.0);
        for i in 0..SEGMENT + STEP {
            let gap = if i == 5 { f64::NAN } else { a() };
            spectra.push([gap, a(), 2.0]);
        }
        assert_eq!(
            (spectra.outputs[0].segments, spectra.outputs[1].segments),
            (1, 2)
        );
        assert!(spectra.coherence(0, 0).is_none() && spectra.coherence(1, 0).is_none());
        assert!(Spectra::new(1, 0, 1.0).density(0).is_none());
    }
}
