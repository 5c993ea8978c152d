//! Candidate effects of faulty samples, not fitted: log-odds in proportion to the number of dropped
//! bits (single outliers) or stuck values (repeated words) that a signal already counts.

use crate::candidate_effect::{Effect, EffectInfo, Scope};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor, ResidualSignal};

/// Logarithm of the odds that one faulty sample gives against chance: an
/// outlier of this size occurs once in 10^8 samples.
const PER_SAMPLE: f64 = 8.0;

/// Samples that are wrong by themselves: no residual is fitted, they are counted.
pub struct DataFault {
    info: EffectInfo,
    samples: fn(&ResidualSignal) -> u64,
}

/// Samples that stand out alone: bits that are lost.
pub const DROPPED_BITS: DataFault = DataFault {
    info: EffectInfo {
        name: "dropped-bits",
        description: "single samples have wrong bits",
        scope: Scope::PerSignal,
        linear: &[],
        nonlinear: &[],
        recommended_experiment: "a test pattern of the converter",
    },
    samples: |signal| signal.spikes,
};

/// A channel that repeats a word.
pub const STUCK: DataFault = DataFault {
    info: EffectInfo {
        name: "stuck-values",
        description: "a channel repeats its last word for a while",
        scope: Scope::PerSignal,
        linear: &[],
        nonlinear: &[],
        recommended_experiment: "a counter of new conversions beside each word",
    },
    samples: |signal| signal.stuck,
};

impl Effect<DrivetrainResiduals> for DataFault {
    fn info(&self) -> &EffectInfo {
        &self.info
    }
    fn initial_values(&self, _: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        Vec::new()
    }
    fn regressors(&self, _: &DrivetrainResiduals, _: &[f64]) -> Vec<Regressor> {
        Vec::new()
    }
    fn fault_log_odds(&self, signal: &ResidualSignal) -> f64 {
        PER_SAMPLE * (self.samples)(signal) as f64
    }
}
