//! Faults of the converter and of the way from it.

use super::{Effect, Linear};
use crate::diagnose::stream::{Session, Stream, Term};

/// Logarithm of the odds that one faulty sample gives against chance: what
/// stands out as these do comes once in 10^8 samples.
const PER_SAMPLE: f64 = 8.0;

/// Samples that stand out alone: bits that are lost.
pub struct DroppedBits;

impl Effect for DroppedBits {
    fn name(&self) -> &'static str {
        "dropped-bits"
    }
    fn about(&self) -> &'static str {
        "single samples have wrong bits"
    }
    fn linear(&self) -> &'static [Linear] {
        &[]
    }
    fn grid(&self, _: &Session) -> Vec<Vec<f64>> {
        Vec::new()
    }
    fn terms(&self, _: &Session, _: &[f64]) -> Vec<Term> {
        Vec::new()
    }
    fn evidence_of_faults(&self, stream: &Stream) -> f64 {
        PER_SAMPLE * stream.spikes as f64
    }
    fn experiment(&self) -> &'static str {
        "a test pattern of the converter"
    }
}

/// A channel that repeats a word.
pub struct Stuck;

impl Effect for Stuck {
    fn name(&self) -> &'static str {
        "stuck-values"
    }
    fn about(&self) -> &'static str {
        "a channel repeats its last word for a while"
    }
    fn linear(&self) -> &'static [Linear] {
        &[]
    }
    fn grid(&self, _: &Session) -> Vec<Vec<f64>> {
        Vec::new()
    }
    fn terms(&self, _: &Session, _: &[f64]) -> Vec<Term> {
        Vec::new()
    }
    fn evidence_of_faults(&self, stream: &Stream) -> f64 {
        PER_SAMPLE * stream.stuck as f64
    }
    fn experiment(&self) -> &'static str {
        "a counter of new conversions beside each word"
    }
}
