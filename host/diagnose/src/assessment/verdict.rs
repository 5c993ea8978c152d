//! Decides the verdict of a diagnosis (no effect, named effects, effects that the data do not
//! separate, or unknown) from the excess that remains, the residual tests and the number of faulty
//! samples. Also here: log-odds of faulty samples, look-up of an effect by its name, and the list
//! of effects that the recordings cannot show.
//!
//! The limits were set with benchmark seeds up to 243; 257 and 263 took no part (docs/lab/results.md).

use crate::assessment::residual_excess::ResidualExcess;
use crate::assessment::residual_tests::{ResidualTests, Test, TestResult};
use crate::candidate_effect::Effect;
use crate::candidate_effect::fitted::FittedEffect;
use crate::diagnosable::Diagnosable;
use crate::null_samples::NullSamples;
use crate::regression::cross_validation::RegressionData;
use crate::regression::design_matrix::base_columns;
use crate::residual_model::ResidualModel;
use crate::sample_statistics::{mean_and_std, mean_square};
use crate::selection::model_error::MEAN_SQUARE_TOLERANCE;
use crate::selection::stepwise::Selection;

/// Part of the excess that the effects found must explain, or something else is missing.
const MIN_EXPLAINED: f64 = 0.7;

/// Excess of the mean square that counts as something, over how much it
/// differs over the null samples.
const MIN_EXCESS_SIGMA: f64 = 8.0;

/// Mean square that an order or a covariate explains, over that of a fault-free machine, from which
/// a residual has structure.
const MIN_STRUCTURE: f64 = 0.3;

/// Log-odds of faulty samples that count: those of five outliers.
pub(crate) const MIN_FAULT_LOG_ODDS: f64 = 40.0;

/// The result of a diagnosis.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Nothing is missing.
    None,
    /// These effects, by name, the first found first.
    Effects(Vec<&'static str>),
    /// One of these, which the recordings do not separate.
    Inseparable(Vec<&'static str>),
    /// Something that no candidate explains.
    Unknown,
}

impl Verdict {
    /// Evaluates the effects found, the part of the excess that they leave, and the residuals.
    pub fn of<S: Diagnosable>(
        recordings: &[S],
        selection: &Selection<S>,
        unexplained_part: Option<f64>,
        residual_excesses: &[ResidualExcess],
        residual_tests: &[ResidualTests],
    ) -> Self {
        let faults: Vec<&'static str> = S::library()
            .iter()
            .filter(|e| fault_log_odds(**e, recordings) > MIN_FAULT_LOG_ODDS)
            .map(|e| e.name())
            .collect();
        let nameless = selection.ranking.is_empty();
        if unexplained_part.is_some_and(|part| part > 1.0 - MIN_EXPLAINED)
            || nameless && has_structure(residual_excesses, residual_tests)
        {
            return Self::Unknown;
        }
        let mut names: Vec<&'static str> =
            selection.found.iter().map(|f| f.effect.name()).collect();
        if let ([only], true) = (selection.found.as_slice(), faults.is_empty())
            && only.is_ambiguous()
        {
            names.extend(&only.indistinguishable_from);
            return Self::Inseparable(names);
        }
        names.extend(faults);
        if names.is_empty() {
            Self::None
        } else {
            Self::Effects(names)
        }
    }

    /// The effects of `selection` that it names: none where something else is missing, which they explain
    /// too little of.
    pub fn named<'a, S: ResidualModel>(
        &self,
        selection: &'a Selection<S>,
    ) -> &'a [FittedEffect<S>] {
        match self {
            Self::Unknown => &[],
            _ => &selection.found,
        }
    }

    /// The word in JSON.
    pub fn as_str(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Effects(names) if names.len() == 1 => "effect",
            Self::Effects(_) => "effects",
            Self::Inseparable(_) => "inseparable",
            Self::Unknown => "unknown",
        }
    }
}

/// Part of the excess that the effects found do not explain, where it is beyond chance.
pub(crate) fn unexplained_part<S: Diagnosable>(
    recordings: &[S],
    selection: &Selection<S>,
    residual_excesses: &[ResidualExcess],
    null_samples: &NullSamples,
) -> Option<f64> {
    let data = RegressionData::new(recordings, null_samples);
    let left = data.null_mean_squares(&data.base(base_columns(recordings, &selection.all())));
    let samples: f64 = recordings.iter().map(|s| s.speed().len() as f64).sum();
    let weight = |k: usize| {
        let n = samples / recordings[0].samples_per_independent(k);
        // Relative scatter of the mean square: the larger of its spread over the null samples after the
        // fit and of its standard error from block to block, as null samples share blocks; at least
        // that of white noise.
        let (mut of_samples, mut of_blocks) = (Vec::new(), Vec::new());
        for null_sample in null_samples {
            let blocks: Vec<f64> = (recordings.iter().zip(null_sample))
                .flat_map(|(recording, d)| d[k].chunks(recording.block()))
                .filter_map(mean_square)
                .collect();
            let (mean, spread) = mean_and_std(&blocks);
            of_samples.push(mean);
            of_blocks.push(spread / (blocks.len().max(1) as f64).sqrt());
        }
        let (mean, _) = mean_and_std(&of_samples);
        let (_, spread) = mean_and_std(&left[k]);
        (spread.max(mean_and_std(&of_blocks).0) / mean.max(1e-300))
            .max((2.0 / n).sqrt())
            .max(MEAN_SQUARE_TOLERANCE)
    };
    let (mut before, mut after, mut largest) = (0.0, 0.0, 0.0_f64);
    for (k, excess) in residual_excesses.iter().enumerate() {
        before += (excess.before - 1.0).max(0.0);
        after += (excess.after - 1.0).max(0.0);
        largest = largest.max((excess.after - 1.0) / weight(k));
    }
    (largest > MIN_EXCESS_SIGMA).then(|| after / before.max(1e-300))
}

/// Whether some residual goes with an order or a quantity, by more than how well a fault-free machine
/// is known. Where nothing can be named that is all there is to say.
fn has_structure(residual_excesses: &[ResidualExcess], residual_tests: &[ResidualTests]) -> bool {
    let is_structured =
        |t: &TestResult| t.is_significant() && matches!(t.test, Test::Order | Test::Covariate);
    (residual_excesses.iter().zip(residual_tests))
        .flat_map(|(o, s)| s.tests.iter().map(move |t| (o, t)))
        .any(|(o, t)| is_structured(t) && o.before * t.before > MIN_STRUCTURE)
}

/// Logarithm of the odds that faulty samples give for an effect.
pub(crate) fn fault_log_odds<S: Diagnosable>(effect: &dyn Effect<S>, recordings: &[S]) -> f64 {
    recordings
        .iter()
        .flat_map(ResidualModel::residuals)
        .map(|s| effect.fault_log_odds(s))
        .sum()
}

/// The effect of that name.
pub fn by_name<S: Diagnosable>(name: &str) -> Option<&'static dyn Effect<S>> {
    S::library().iter().copied().find(|e| e.name() == name)
}

/// The effects of which the recordings show nothing, whether they are there or not.
pub fn cannot_show<S: Diagnosable>(selection: &Selection<S>) -> Vec<&'static str> {
    S::library()
        .iter()
        .filter(|e| !e.linear_parameters().is_empty())
        .map(|e| e.name())
        .filter(|name| !selection.ranking.iter().any(|r| r.effect.name() == *name))
        .collect()
}
