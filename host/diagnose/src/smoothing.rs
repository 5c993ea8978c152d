//! Smooths signals without delay: by moving means, and by low-pass and Wiener filters on the
//! discrete cosine transform.

use loadtwin_fft::Complex;

/// Moving mean over `width` samples, centred, three times over.
pub fn smooth(x: &[f64], width: usize) -> Vec<f64> {
    let once = moving_mean(x, width);
    moving_mean(&moving_mean(&once, width), width)
}

/// The part of `x`, sampled every `dt_s`, up to `highest_hz`, sharply: of the cosines that it is the sum
/// of with its own mirror image behind it, where nothing jumps.
pub fn low_pass_dct(x: &[f64], dt_s: f64, highest_hz: f64) -> Vec<f64> {
    let highest = (highest_hz * dt_s * 2.0 * x.len() as f64) as usize;
    dct_filter(x, |_| {
        (0..=x.len())
            .map(|bin| f64::from(u8::from(bin <= highest)))
            .collect()
    })
}

/// `x`, sampled every `dt_s`, without its white noise of `noise_std`, as far as the signal is above that:
///
/// `1 - n s^2 / S` of each cosine, `S` the mean of its neighbours' squares (Wiener).
///
/// Where noise is all there is, nothing stays: a chain that resonates there would answer to it.
pub fn wiener_denoise(x: &[f64], dt_s: f64, noise_std: f64) -> Vec<f64> {
    // So much more than noise is no chance, of the mean over this band.
    /// Factor on the variance of the noise: a mean square over the band that exceeds it is no
    /// chance.
    const SURELY: f64 = 1.5;
    /// Width of the band over which squares are averaged [Hz].
    const BAND_HZ: f64 = 0.5;
    let n = 2.0 * x.len() as f64;
    let width = (BAND_HZ * dt_s * n) as usize | 1;
    dct_filter(x, |sizes| {
        let squares: Vec<f64> = sizes.iter().map(Complex::norm_sqr).collect();
        let noise = SURELY * n * noise_std * noise_std;
        let kept = |square: &f64| (1.0 - noise / square.max(f64::MIN_POSITIVE)).max(0.0);
        moving_mean(&squares, width).iter().map(kept).collect()
    })
}

/// `x` with of each cosine, of which it is the sum with its own mirror image behind it, the part that
/// `kept` says of their sizes, the slowest first.
fn dct_filter(x: &[f64], kept: impl Fn(&[Complex<f64>]) -> Vec<f64>) -> Vec<f64> {
    let n = 2 * x.len();
    let mut mirrored: Vec<Complex<f64>> = (x.iter().chain(x.iter().rev()))
        .map(|x| Complex::from(*x))
        .collect();
    loadtwin_fft::forward(n).process(&mut mirrored);
    let kept = kept(&mirrored[..=x.len()]);
    for (bin, size) in mirrored.iter_mut().enumerate() {
        *size *= kept[bin.min(n - bin)];
    }
    loadtwin_fft::inverse(n).process(&mut mirrored);
    let parts = mirrored.iter().take(x.len());
    parts.map(|value| value.re / n as f64).collect()
}

/// Moving mean over `width` samples, centred; shorter at the ends.
pub fn moving_mean(x: &[f64], width: usize) -> Vec<f64> {
    let half = width / 2;
    let mut sums = Vec::with_capacity(x.len() + 1);
    let mut sum = 0.0;
    sums.push(0.0);
    for value in x {
        sum += value;
        sums.push(sum);
    }
    (0..x.len())
        .map(|i| {
            let (from, to) = (i.saturating_sub(half), (i + half + 1).min(x.len()));
            (sums[to] - sums[from]) / (to - from) as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn a_line_stays_a_line_under_smoothing() {
        let line: Vec<f64> = (0..100).map(f64::from).collect();
        let smoothed = smooth(&line, 5);
        for i in 10..90 {
            assert!((smoothed[i] - line[i]).abs() < 1e-9);
        }
    }

    /// A wave of 1 Hz and 10 stays beside noise of 1, of which 0.1 at most stays.
    #[test]
    fn noise_goes_and_what_is_above_it_stays() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let dt_s = 0.002;
        let wave: Vec<f64> = (0..30_000)
            .map(|i| 10.0 * (TAU * dt_s * f64::from(i)).cos())
            .collect();
        let noisy: Vec<f64> = (wave.iter())
            .map(|x| x + rng.sample::<f64, _>(rand_distr::StandardNormal))
            .collect();
        let left = wiener_denoise(&noisy, dt_s, 1.0);
        let squares: f64 = (left.iter().zip(&wave)).map(|(a, b)| (a - b).powi(2)).sum();
        let error = (squares / wave.len() as f64).sqrt();
        assert!(error < 0.1, "{error}");
    }

    #[test]
    fn what_is_slow_stays_and_what_is_faster_goes() {
        let dt_s = 0.008;
        let wave = |hz: f64| -> Vec<f64> {
            let of = |i: usize| (TAU * hz * dt_s * i as f64 + 0.7).sin();
            (0..10_000).map(of).collect()
        };
        let (below, above) = (wave(0.5), wave(0.7));
        let (kept, gone) = (
            low_pass_dct(&below, dt_s, 0.6),
            low_pass_dct(&above, dt_s, 0.6),
        );
        let power = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>() / 5000.0;
        let lost = power(&mut kept.iter().zip(&below).map(|(a, b)| a - b));
        assert!(lost < 0.006, "{lost}");
        assert!(power(&mut gone.iter().copied()) < 0.012);
        // What a bend at the ends spreads over the whole.
        for i in 1000..9000 {
            assert!((kept[i] - below[i]).abs() < 0.05, "{i}: {}", kept[i]);
            assert!(gone[i].abs() < 0.05, "{i}: {}", gone[i]);
        }
    }
}
