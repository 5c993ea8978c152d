//! A correction without a cause: what a residual is, on average, over something that was measured.

use serde::Serialize;

use super::bins::{Binned, Bins, binned, known, means, takes};
use super::observed::{Abscissa, Observed, common};
use super::oddity::Oddity;

/// Part of a residual's mean square that a correction must take from blocks left out.
const WORTH: f64 = 0.2;

/// What may be subtracted from a reading, though nobody knows why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Correction {
    /// The residual.
    pub channel: String,
    /// Unit of what is subtracted.
    pub unit: &'static str,
    /// What it is over.
    pub over: &'static str,
    /// Unit of that.
    pub over_unit: &'static str,
    /// Part of the mean square about its mean that it takes from blocks left out.
    pub takes: f64,
    /// Middles of the bins, rising.
    pub at: Vec<f64>,
    /// What is subtracted there, about the mean.
    pub subtract: Vec<f64>,
}

/// For each residual that is larger than a clean machine's the correction that takes most of it,
/// where one takes enough. Time is no cause: what it explains is not there in the next recording.
pub fn corrections<S: Observed>(sessions: &[S], oddities: &[Oddity]) -> Vec<Correction> {
    let along: Vec<_> = (common(sessions).into_iter())
        .filter(|along| along[0].quantity != "Time")
        .collect();
    let strange = (0..oddities.len()).filter(|k| oddities[*k].before > 1.1);
    let best = |k: usize| {
        (along.iter())
            .filter_map(|along| over(sessions, k, along))
            .max_by(|a, b| a.takes.total_cmp(&b.takes))
    };
    let mut all: Vec<Correction> = strange.filter_map(best).collect();
    all.sort_by(|a, b| b.takes.total_cmp(&a.takes));
    all
}

/// Of stream `k` over one quantity.
fn over<S: Observed>(sessions: &[S], k: usize, along: &[Abscissa]) -> Option<Correction> {
    let sessions_along = || sessions.iter().zip(along);
    let bins =
        Bins::of(sessions_along().flat_map(|(s, along)| known(&along.values, s.residual(k))))?;
    let samples: Vec<Binned> = sessions_along()
        .flat_map(|(s, along)| {
            let places = bins.places(&along.values, s.block());
            binned(&places, s.residual(k)).collect::<Vec<_>>()
        })
        .collect();
    let takes = takes(&samples);
    let subtract = means(samples.iter().map(|(bin, y, _)| (*bin, *y)));
    (takes > WORTH).then(|| Correction {
        channel: sessions[0].name(k).to_owned(),
        unit: sessions[0].unit(k),
        over: along[0].quantity,
        over_unit: along[0].unit,
        takes,
        at: bins.middles,
        subtract,
    })
}
