//! A load that all channels read and that is not torque.

use super::{Effect, Linear, one_shape};
use crate::diagnose::signals::moving_mean;
use crate::diagnose::stream::{Kind, Session, Stream, Term};

/// Highest frequency of the common load [Hz].
const HIGHEST_HZ: f64 = 0.6;

/// `scale a L(t)`: a slow load `L` that is the same for all channels, told for
/// each channel by the others. What is left of it in one channel is not used
/// to explain that channel.
pub struct Bending;

impl Effect for Bending {
    fn name(&self) -> &'static str {
        "bending-load"
    }
    fn about(&self) -> &'static str {
        "a slow load that is not torque and that all channels read"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the other channels' mean",
            prior_std: 1.0,
        }]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        let strains = session.streams.iter().filter(|s| s.kind == Kind::Strain);
        if strains.count() >= 3 {
            one_shape()
        } else {
            Vec::new()
        }
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        stream.kind == Kind::Strain
    }
    fn terms(&self, session: &Session, _: &[f64]) -> Vec<Term> {
        let width = (0.5 / HIGHEST_HZ / session.signals.dt_s) as usize | 1;
        let slow: Vec<Option<Vec<f64>>> = session
            .streams
            .iter()
            .map(|s| (s.kind == Kind::Strain).then(|| slow_part(s, width)))
            .collect();
        let n = session.signals.len();
        let mut sum = vec![0.0; n];
        // Weighted by what a channel knows of it.
        let weight = |s: &Stream| (s.scale / s.noise_std).powi(2);
        let mut total = 0.0;
        for (stream, slow) in session.streams.iter().zip(&slow) {
            if let Some(slow) = slow {
                total += weight(stream);
                for (sum, value) in sum.iter_mut().zip(slow) {
                    *sum += weight(stream) * value;
                }
            }
        }
        let columns = session
            .streams
            .iter()
            .zip(&slow)
            .map(|(stream, slow)| {
                slow.as_ref().map_or(Vec::new(), |slow| {
                    let w = weight(stream);
                    sum.iter()
                        .zip(slow)
                        .map(|(sum, own)| stream.scale * (sum - w * own) / (total - w))
                        .collect()
                })
            })
            .collect();
        vec![Term::Each(columns)]
    }
    fn latent(&self, session: &Session) -> f64 {
        2.0 * HIGHEST_HZ * session.signals.dt_s * session.signals.len() as f64
    }
    fn experiment(&self) -> &'static str {
        "a known bending load without torque; gauges in antisymmetric pairs"
    }
}

/// Slow part of a residual in parts of full scale; gaps count as its mean.
fn slow_part(stream: &Stream, width: usize) -> Vec<f64> {
    let (sum, count) = stream
        .residual
        .iter()
        .filter(|r| r.is_finite())
        .fold((0.0, 0.0), |(sum, n), r| (sum + r, n + 1.0));
    let mean = if count > 0.0 { sum / count } else { 0.0 };
    let filled: Vec<f64> = stream
        .residual
        .iter()
        .map(|r| (if r.is_finite() { r - mean } else { 0.0 }) / stream.scale)
        .collect();
    moving_mean(&filled, width)
}
