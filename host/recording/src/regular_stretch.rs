//! Fits a straight line, times over ticks, to the rows of a recording's first block (`Line`), and
//! finds the most regular stretch without a lost or an extra row (`regular_stretch`), from which
//! `sampling_grid` continues the line.

/// Relative deviation of a period that is another period.
pub(super) const RATE: f64 = 0.02;

/// Standard deviation of jitter that is uniform over a period (periods).
pub(super) const UNIFORM: f64 = 0.29;

/// A regular stretch has residuals below this (periods): one lost row alone
/// makes two neighbours differ by a whole period, and so one of them by half.
const REGULAR: f64 = 0.25;

/// Standard deviation of the distances from which rows may fill the period (periods): that of a
/// saw tooth of 0.7 periods. One lost row within a stretch makes it 0.25, many make it 0.29.
const FILLED: f64 = 0.2;

/// Lengths of the stretches in which the line is looked for (rows).
const STRETCHES: [usize; 4] = [1024, 256, 64, 16];

/// A straight line through consecutive rows.
#[derive(Clone, Copy)]
pub(super) struct Line {
    pub(super) period_s: f64,
    /// Time of its last row (s).
    pub(super) end_s: f64,
    /// Largest distance of a row from it (periods).
    residual: f64,
    /// Standard deviation of these distances (periods).
    spread: f64,
}

impl Line {
    /// Least squares, one row a tick; a described period counts as much as
    /// jitter of half a period and a clock that is 1 % off make it.
    fn fit(t: &[f64], expected_s: Option<f64>) -> Self {
        let n = t.len() as f64;
        let middle = 0.5 * (n - 1.0);
        // Differences from the first row keep the digits of a time since 1970.
        let mean = t.iter().map(|x| x - t[0]).sum::<f64>() / n;
        let (mut kt, mut kk) = (0.0, 0.0);
        for (k, x) in t.iter().enumerate() {
            let k = k as f64 - middle;
            kt += k * (x - t[0] - mean);
            kk += k * k;
        }
        if let Some(expected_s) = expected_s {
            let weight = (UNIFORM / 0.01_f64).powi(2);
            kt += weight * expected_s;
            kk += weight;
        }
        let period_s = kt / kk;
        let on = |k: usize| mean + (k as f64 - middle) * period_s;
        let (mut largest, mut squares) = (0.0_f64, 0.0);
        for (k, x) in t.iter().enumerate() {
            let distance = x - t[0] - on(k);
            largest = largest.max(distance.abs());
            squares += distance * distance;
        }
        Self {
            period_s,
            end_s: t[0] + on(t.len() - 1),
            residual: largest / period_s,
            spread: (squares / (n - 2.0).max(1.0)).sqrt() / period_s,
        }
    }

    /// Whether no row can be lost or extra, whatever the period.
    pub(super) fn is_sure(&self) -> bool {
        self.residual < 0.5 && self.spread < FILLED
    }

    /// Bound of the relative error of the period of `rows` rows: four standard
    /// deviations at jitter that is uniform up to the largest residual.
    pub(super) fn slope_error(&self, rows: usize) -> f64 {
        4.0 * self.residual * 2.0 / (rows as f64).powf(1.5)
    }
}

/// The most regular stretch without a lost row, of the longest that there are.
pub(super) fn regular_stretch(
    t: &[f64],
    expected_s: Option<f64>,
) -> Option<(std::ops::Range<usize>, Line)> {
    let shortest = t.len().min(16);
    let lengths = STRETCHES.into_iter().filter(|&n| n < t.len());
    for length in std::iter::once(t.len().min(1024))
        .chain(lengths)
        .filter(|&n| n >= shortest && n > 2)
    {
        let last = t.len() - length;
        let mut best: Option<(std::ops::Range<usize>, Line)> = None;
        for start in (0..last).step_by((length / 2).max(1)).chain([last]) {
            let rows = start..start + length;
            let line = Line::fit(&t[rows.clone()], expected_s);
            let is_expected = expected_s.is_none_or(|p| (line.period_s / p - 1.0).abs() <= RATE);
            if is_expected
                && line.residual < 0.5
                && best
                    .as_ref()
                    .is_none_or(|(_, b)| line.residual < b.residual)
                && (line.residual < REGULAR || is_evenly_irregular(&t[rows.clone()], &line))
            {
                best = Some((rows, line));
            }
        }
        if best.is_some() {
            return best;
        }
    }
    // Of few rows with much jitter only the described period makes a line.
    let all = Line::fit(t, expected_s);
    (expected_s.is_some() && t.len() < 64 && all.residual < 0.5).then_some((0..t.len(), all))
}

/// Whether the quarters of a stretch are as irregular as the whole: it is
/// jitter then, and no lost row.
fn is_evenly_irregular(t: &[f64], line: &Line) -> bool {
    if t.len() < 64 {
        return false;
    }
    let least = t
        .chunks_exact(t.len() / 4)
        .map(|quarter| Line::fit(quarter, Some(line.period_s)).residual)
        .fold(f64::INFINITY, f64::min);
    line.residual <= 1.6 * least + 0.02 && !has_steps(t, line)
}

/// Whether the distances of the rows from the line come from lost or extra rows at regular
/// distances, which the line takes for another period.
///
/// Each such row moves those after it by a whole period: few rows between two of them lie on a
/// line of their own, all rows together spread over the period, and two steps in a row show the
/// jump. Jitter spreads few rows as it does all of them; a clock that wanders does not jump.
fn has_steps(t: &[f64], line: &Line) -> bool {
    /// Rows that lie between two such rows: a period within [`RATE`] of another has one in 50.
    const FEW: usize = 16;
    /// Part of the spread of all rows that few have of jitter: at least 0.8, by the 1.8 standard
    /// deviations of 0.11 that 16 uniform values have.
    const OF_JITTER: f64 = 0.7;
    /// Least jump within two steps (periods): jitter in which a whole one passes as regular is
    /// below 0.1.
    const JUMP: f64 = 0.7;
    let jumps = |t: &[f64]| ((t[2] - t[0]) / line.period_s - 2.0).abs() > JUMP;
    if line.spread < FILLED || !t.windows(3).any(jumps) {
        return false;
    }
    let mut few: Vec<f64> = (t.chunks_exact(FEW))
        .map(|rows| Line::fit(rows, None).spread)
        .collect();
    let quarter = few.len() / 4;
    let low = (quarter < few.len()).then(|| *few.select_nth_unstable_by(quarter, f64::total_cmp).1);
    low.is_some_and(|low| low < OF_JITTER * line.spread)
}

/// A line of the given period through the first row, moved by the mean phase of
/// the first rows.
pub(super) fn coarse(t: &[f64], period_s: f64) -> Line {
    let turn = std::f64::consts::TAU / period_s;
    let (mut sine, mut cosine) = (0.0, 0.0);
    for x in t.iter().take(64) {
        let (s, c) = ((x - t[0]) * turn).sin_cos();
        sine += s;
        cosine += c;
    }
    Line {
        period_s,
        end_s: t[0] + sine.atan2(cosine) / turn,
        residual: 0.5,
        spread: UNIFORM,
    }
}

pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
