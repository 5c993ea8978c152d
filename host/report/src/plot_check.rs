//! Checks that a plot can be drawn before the page is written: columns that exist, series as long
//! as `x`, `x` that does not fall, bands of two edges, a name for each point. Otherwise an error
//! names the plot.

use crate::{Data, Mark, MinMaxDecimator, Plot, ReportError};

/// Refuses what the page could not draw.
pub(crate) fn check(plot: &Plot, time: Option<&MinMaxDecimator>) -> Result<(), ReportError> {
    let columns = time.map_or(0, MinMaxDecimator::columns);
    let (marks, problem): (Vec<Mark>, Option<String>) = match &plot.data {
        Data::Time(series) => (
            series.iter().map(|(series, _)| series.mark).collect(),
            series
                .iter()
                .find(|(_, column)| *column >= columns)
                .map(|(_, column)| format!("found column {column}, allowed is below {columns}")),
        ),
        Data::Own { x, series } => (
            series.iter().map(|(series, _)| series.mark).collect(),
            series
                .iter()
                .find(|(_, values)| values.len() != x.len())
                .map(|(s, v)| format!("{:?} has {} values for {} x", s.label, v.len(), x.len()))
                .or_else(|| (!x.is_sorted()).then(|| "x falls or is not a number".to_owned())),
        ),
    };
    // Each mark but the first with the one before it, the last with nothing after it.
    let before = std::iter::once(Mark::Line).chain(marks.iter().copied());
    let after = marks.iter().copied().chain([Mark::Line]);
    let unpaired = before
        .zip(after)
        .any(|(before, mark)| (before == Mark::Upper) != (mark == Mark::Lower));
    let shaded = (plot.shaded.iter().map(|shaded| shaded.column))
        .chain(plot.band.into_iter().flatten())
        .find(|column| *column >= columns);
    let points = match &plot.data {
        Data::Time(_) => 0,
        Data::Own { x, .. } => x.len(),
    };
    let names = plot.names.len();
    let problem = problem
        .or_else(|| {
            (names != 0 && names != points).then(|| format!("{names} names for {points} points"))
        })
        .or_else(|| {
            shaded.map(|column| format!("found column {column}, allowed is below {columns}"))
        })
        .or_else(|| unpaired.then(|| "an upper edge needs its lower edge next".to_owned()));
    problem.map_or(Ok(()), |problem| {
        Err(ReportError::Plot {
            plot: plot.title.clone(),
            problem,
        })
    })
}
