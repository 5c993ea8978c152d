//! Computes what may be subtracted from a reading without a known cause: for each residual with an
//! excess, its binned mean over the covariate (not time) that explains most of its variance, at
//! least 20 %. A diagnosis does this where its verdict is unknown.

use serde::Serialize;

use crate::assessment::binned_mean::{Binned, Bins, binned, explained_by_bins, known, means};
use crate::assessment::residual_excess::ResidualExcess;
use crate::residual_model::{Covariate, ResidualModel, common_covariates};

/// Part of a residual's mean square that a correction must take from blocks left out.
const WORTH: f64 = 0.2;

/// Values that may be subtracted from a reading over a covariate, without a known cause.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Correction {
    /// The residual.
    pub channel: String,
    /// Unit of what is subtracted.
    pub unit: &'static str,
    /// The quantity that it depends on.
    pub over: &'static str,
    /// Unit of that.
    pub over_unit: &'static str,
    /// Part of the mean square about its mean that it explains in hold-out blocks.
    #[serde(rename = "takes")]
    pub explained: f64,
    /// Middles of the bins, rising.
    pub at: Vec<f64>,
    /// What is subtracted there, about the mean.
    pub subtract: Vec<f64>,
}

/// For each residual that is larger than a fault-free machine's the correction that explains most
/// of it, where one explains enough. Time is no cause: what it explains is not there in the next
/// recording.
pub fn corrections<S: ResidualModel>(
    recordings: &[S],
    residual_excesses: &[ResidualExcess],
) -> Vec<Correction> {
    let along: Vec<_> = (common_covariates(recordings).into_iter())
        .filter(|along| along[0].quantity != "Time")
        .collect();
    let strange = (0..residual_excesses.len()).filter(|k| residual_excesses[*k].before > 1.1);
    let best = |k: usize| {
        (along.iter())
            .filter_map(|along| over(recordings, k, along))
            .max_by(|a, b| a.explained.total_cmp(&b.explained))
    };
    let mut all: Vec<Correction> = strange.filter_map(best).collect();
    all.sort_by(|a, b| b.explained.total_cmp(&a.explained));
    all
}

/// Of signal `k` over one quantity.
fn over<S: ResidualModel>(recordings: &[S], k: usize, along: &[Covariate]) -> Option<Correction> {
    let sessions_along = || recordings.iter().zip(along);
    let bins =
        Bins::of(sessions_along().flat_map(|(s, along)| known(&along.values, s.residual(k))))?;
    let samples: Vec<Binned> = sessions_along()
        .flat_map(|(s, along)| {
            let bins_of = bins.bins_of(&along.values, s.block());
            binned(&bins_of, s.residual(k)).collect::<Vec<_>>()
        })
        .collect();
    let explained = explained_by_bins(&samples);
    let subtract = means(samples.iter().map(|(bin, y, _)| (*bin, *y)));
    (explained > WORTH).then(|| Correction {
        channel: recordings[0].name(k).to_owned(),
        unit: recordings[0].unit(k),
        over: along[0].quantity,
        over_unit: along[0].unit,
        explained,
        at: bins.middles,
        subtract,
    })
}
