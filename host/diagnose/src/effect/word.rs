//! Faults of the converter and of the way from it.

use super::{Effect, Linear};
use crate::stream::{Session, Stream, Term};

/// Logarithm of the odds that one faulty sample gives against chance: what
/// stands out as these do comes once in 10^8 samples.
const PER_SAMPLE: f64 = 8.0;

/// Samples that are wrong by themselves: no residual is fitted, they are counted.
pub struct WordFault {
    name: &'static str,
    about: &'static str,
    experiment: &'static str,
    samples: fn(&Stream) -> u64,
}

/// Samples that stand out alone: bits that are lost.
pub const DROPPED_BITS: WordFault = WordFault {
    name: "dropped-bits",
    about: "single samples have wrong bits",
    experiment: "a test pattern of the converter",
    samples: |stream| stream.spikes,
};

/// A channel that repeats a word.
pub const STUCK: WordFault = WordFault {
    name: "stuck-values",
    about: "a channel repeats its last word for a while",
    experiment: "a counter of new conversions beside each word",
    samples: |stream| stream.stuck,
};

impl Effect for WordFault {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
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
        PER_SAMPLE * (self.samples)(stream) as f64
    }
    fn experiment(&self) -> &'static str {
        self.experiment
    }
}
