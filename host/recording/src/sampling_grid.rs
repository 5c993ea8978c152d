//! Assigns the rows of a recording to ticks of a uniform clock by their times (`Grid`), and returns
//! the gaps between rows. A gap that is too long, a changed rate, a wandering clock and two rows on
//! one tick are errors (`Misplaced`).
//!
//! A row at `t` belongs to the tick `round((t - t0) / T)`. `t0` and `T` are those of a straight
//! line through the rows, times over ticks, with a memory of [`MEMORY`] rows, so that a clock that
//! drifts is followed and jitter is averaged out. The first line is fitted to the most regular
//! stretch of the first block, and continued from there to both sides.
use serde::{Deserialize, Serialize};

use super::error::Problem;
use super::regular_stretch::{Line, RATE, UNIFORM, coarse, median, regular_stretch};

/// Rows that the line rests on. 2048 rows with jitter of half a period leave
/// 0.01 periods of it in the line; a clock that changes by 100 ppm at once is
/// 0.05 periods off until it is followed.
const MEMORY: f64 = 2048.0;

/// How much further than half a period from its tick the row of the next tick may be (periods): the
/// error of the line. Where rows may be missing, a row that far off is more likely that of the tick
/// after.
const GRACE: f64 = 0.03;

/// The same where no row may be missing.
const GRACE_WITHOUT_GAPS: f64 = 0.1;

/// Rows that a line counts for which rests on no regular stretch.
const COARSE: f64 = 16.0;

/// Rows over which the distance from the tick is averaged. Of jitter that is uniform over a period
/// the mean has a standard deviation of 0.036.
const WANDERING: f64 = 32.0;

/// Mean distance from the tick from which the clock wanders (periods): seven such deviations.
const WANDERS: f64 = 0.25;

/// The same where a step that is nearer to one period would make a gap (periods).
const WANDERS_AT_GAP: f64 = 0.12;

/// Rows over which a changed rate is looked for.
const CHANGES: [f64; 2] = [256.0, 8192.0];

/// Rows in a row without a single step of one period that are of another rate.
const NEVER_ONE: u32 = 32;

/// How far back a gap is counted again when the rows after it show that it is a
/// tick longer or shorter (rows).
const RECOUNTED: usize = 16;

/// The stretch that is regular at any period, where the described one holds for `held` rows: none
/// where that is as good.
fn other_period(t: &[f64], held: usize) -> Option<(std::ops::Range<usize>, Line)> {
    /// How much longer the other one is: over few rows, coarse stamps have many periods.
    const LONGER: usize = 8;
    if held * LONGER > t.len() {
        return None;
    }
    let other = regular_stretch(t, None);
    other.filter(|(rows, line)| held == 0 || line.is_sure() && rows.len() >= LONGER * held)
}

/// Samples absent from the file before a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Gap {
    /// Index of the row.
    pub(super) row: usize,
    pub(super) missing: u64,
}

/// A row that the grid does not hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Misplaced {
    /// It falls on the tick of the row before, which is further from it or not.
    SameTick { row: usize, before_is_further: bool },
    /// More rows are missing before it than allowed.
    Gap { row: usize, missing: u64 },
    /// The clock wanders about this row faster than it is followed.
    Wander { row: usize },
    /// Rows come at another period from this one on (s).
    Rate { row: usize, period_s: f64 },
}

/// Times over ticks: a straight line, continued row by row.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Grid {
    /// Period of the clock at present (s).
    period_s: f64,
    /// Period of the recording or its description (s).
    nominal_s: f64,
    /// Time of the present tick on the line (s).
    tick_s: f64,
    /// Rows that the line rests on; none where each row is its own tick.
    memory: Option<f64>,
    /// See [`GRACE`].
    grace: f64,
    started: bool,
    changes: [Change; 2],
    never_one: u32,
    last_t: f64,
    /// Mean distance of the last rows from their ticks (periods).
    beside: f64,
}

/// Sum of the steps of one tick beyond the period (periods), their number, and
/// the runs that they make up.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Change {
    sum: f64,
    steps: f64,
    runs: f64,
}

impl Change {
    /// Adds a step; the relative change of the rate where there is one.
    ///
    /// Within a run without lost rows the sum is that of its last row's jitter
    /// less its first's; of a changed rate it grows with each step.
    fn push(&mut self, over: f64, ticks: i64, rows: f64) -> Option<f64> {
        if ticks == 1 {
            self.sum += over;
            self.steps += 1.0;
        } else {
            self.runs += 1.0;
        }
        if self.steps < rows {
            return None;
        }
        let Self { sum, steps, runs } = std::mem::take(self);
        let by_chance = 6.0 * UNIFORM * (2.0 * (runs + 1.0)).sqrt();
        let changed = runs > 0.0 && sum.abs() > by_chance && sum.abs() > 1e-3 * steps;
        changed.then_some(sum / steps)
    }
}

impl Grid {
    /// The grid of a block's rows, at its first; `expected_s`: the described
    /// period. None of fewer than two rows.
    ///
    /// # Errors
    /// [`Problem::Period`] when the rows are regular at another period.
    pub(super) fn of(t: &[f64], expected_s: Option<f64>) -> Result<Option<Self>, Problem> {
        let Some(step) = median(t.windows(2).map(|t| t[1] - t[0]).collect()) else {
            return Ok(None);
        };
        let mut stretch = regular_stretch(t, expected_s);
        if let Some(allowed_s) = expected_s {
            let held = stretch.as_ref().map_or(0, |(rows, _)| rows.len());
            let (found_s, by_jitter) = match other_period(t, held) {
                Some((rows, line)) => (line.period_s, line.slope_error(rows.len())),
                None if held > 0 => (allowed_s, 0.0),
                None => (step, 8.0 * UNIFORM / (t.len() as f64).sqrt()),
            };
            if (found_s / allowed_s - 1.0).abs() > RATE + by_jitter {
                return Err(Problem::Period { found_s, allowed_s });
            }
        }
        let (rows, line) = stretch
            .take()
            .unwrap_or_else(|| (0..1, coarse(t, expected_s.unwrap_or(step))));
        let memory = (rows.len() as f64).clamp(COARSE, MEMORY);
        let mut grid = Self::starting(line, Some(memory), t[0]);
        for &t in &t[rows.end..] {
            grid.follow(t, grid.ticks_to(t));
        }
        // Back to the first row, in time that runs the other way.
        grid.tick_s = -grid.tick_s;
        for &t in t[..t.len() - 1].iter().rev() {
            grid.follow(-t, grid.ticks_to(-t));
        }
        grid.tick_s = -grid.tick_s;
        grid.nominal_s = expected_s.unwrap_or(grid.period_s);
        Ok(Some(grid))
    }

    /// The grid of a recording without a clock: it starts anew at each row. None
    /// of fewer than two rows.
    pub(super) fn free(t: &[f64]) -> Option<Self> {
        let step = median(t.windows(2).map(|t| t[1] - t[0]).collect())?;
        Some(Self::starting(coarse(t, step), None, t[0]))
    }

    fn starting(line: Line, memory: Option<f64>, last_t: f64) -> Self {
        Self {
            period_s: line.period_s,
            nominal_s: line.period_s,
            tick_s: line.end_s,
            memory,
            grace: GRACE,
            started: false,
            changes: [Change::default(); 2],
            never_one: 0,
            last_t,
            beside: 0.0,
        }
    }

    /// Period of the recording, as described or as its first rows have it (s).
    pub(super) fn recording_period_s(&self) -> f64 {
        self.nominal_s
    }

    /// Ticks from the present one to that of `t`.
    fn ticks_to(&self, t: f64) -> i64 {
        let x = (t - self.tick_s) / self.period_s;
        let reach = if self.memory.is_some() {
            0.5 + self.grace
        } else {
            0.0
        };
        if (x - 1.0).abs() <= reach {
            1
        } else {
            x.round() as i64
        }
    }

    /// Goes on by `ticks` to a row at `t`: the line of least squares with a
    /// memory of `n` rows, `gain 2 (2 n - 1) / (n (n + 1))` for the time of the
    /// tick and `6 / (n (n + 1))` for the period.
    ///
    /// Source: Morrison 1969, Introduction to sequential smoothing and
    /// prediction, section 9 (expanding memory of first degree).
    fn follow(&mut self, t: f64, ticks: i64) {
        let Some(memory) = &mut self.memory else {
            self.tick_s = t;
            return;
        };
        *memory = (*memory + 1.0).min(MEMORY);
        let n = *memory;
        self.tick_s += ticks as f64 * self.period_s;
        let error = t - self.tick_s;
        self.tick_s += 2.0 * (2.0 * n - 1.0) / (n * (n + 1.0)) * error;
        self.period_s += 6.0 / (n * (n + 1.0)) * error;
    }

    /// Distance of `t` from the present tick (periods).
    fn error(&self, t: f64) -> f64 {
        (t - self.tick_s) / self.period_s
    }

    /// Puts rows on their ticks: the gaps before them.
    ///
    /// # Errors
    /// The first row that the grid does not hold.
    pub(super) fn place(&mut self, t: &[f64], largest_gap: u32) -> Result<Vec<Gap>, Misplaced> {
        self.grace = if largest_gap == 0 {
            GRACE_WITHOUT_GAPS
        } else {
            GRACE
        };
        let mut gaps: Vec<Gap> = Vec::new();
        // Distances from their ticks of the rows since the last gap.
        let mut since: Vec<f64> = Vec::new();
        for (row, &t_row) in t.iter().enumerate() {
            let mut ticks = self.ticks_to(t_row);
            if !self.started {
                self.started = true;
                ticks = 0;
            } else if self.memory.is_none() {
                ticks = ticks.max(1);
            } else {
                ticks = self.recount(t_row, ticks, &mut gaps, &mut since, largest_gap);
                if ticks <= 0 {
                    return Err(self.changed_rate(t, row).unwrap_or(Misplaced::SameTick {
                        row,
                        before_is_further: self.error(self.last_t).abs() > self.error(t_row).abs(),
                    }));
                }
            }
            let step = (t_row - self.last_t) / self.period_s;
            if ticks > 1 && step < 1.5 && self.beside.abs() > WANDERS_AT_GAP {
                return Err(self
                    .changed_rate(t, row)
                    .unwrap_or(Misplaced::Wander { row }));
            }
            if ticks > 1 {
                let missing = ticks as u64 - 1;
                if missing > u64::from(largest_gap) {
                    return Err(self
                        .changed_rate(t, row)
                        .unwrap_or(Misplaced::Gap { row, missing }));
                }
                gaps.push(Gap { row, missing });
                since.clear();
            }
            self.watch_rate(row, t_row, ticks)?;
            let beside = self.error(t_row) - ticks as f64;
            self.beside += (beside - self.beside) / WANDERING;
            if self.memory.is_some() && self.beside.abs() > WANDERS {
                return Err(Misplaced::Wander { row });
            }
            self.follow(t_row, ticks);
            if since.len() < RECOUNTED {
                since.push(self.error(t_row));
            }
            self.last_t = t_row;
        }
        Ok(gaps)
    }

    /// Counts the last gap again where the row at `t` shows that it is one tick
    /// longer or shorter: heavy jitter leaves that open in its first rows.
    fn recount(
        &mut self,
        t: f64,
        ticks: i64,
        gaps: &mut [Gap],
        since: &mut [f64],
        largest_gap: u32,
    ) -> i64 {
        let Some(gap) = gaps.last_mut() else {
            return ticks;
        };
        let by = match ticks {
            0 if gap.missing > 0 => -1,
            2 if gap.missing < u64::from(largest_gap) => 1,
            _ => return ticks,
        };
        let limit = 0.5 + self.grace;
        if since.len() >= RECOUNTED || !since.iter().all(|e| (e - by as f64).abs() <= limit) {
            return ticks;
        }
        gap.missing = gap.missing.saturating_add_signed(by);
        for error in since.iter_mut() {
            *error -= by as f64;
        }
        self.tick_s += by as f64 * self.period_s;
        self.ticks_to(t)
    }

    /// Finds a rate that is not the recording's though each row has its tick.
    fn watch_rate(&mut self, row: usize, t: f64, ticks: i64) -> Result<(), Misplaced> {
        if self.memory.is_none() {
            return Ok(());
        }
        let rate = |relative: f64, period_s: f64| Misplaced::Rate {
            row,
            period_s: period_s * (1.0 + relative),
        };
        let over = (t - self.last_t) / self.period_s - 1.0;
        self.never_one = if ticks > 1 { self.never_one + 1 } else { 0 };
        if self.never_one >= NEVER_ONE {
            return Err(rate(over, self.period_s));
        }
        for (change, rows) in self.changes.iter_mut().zip(CHANGES) {
            if ticks > 0
                && let Some(relative) = change.push(over, ticks, rows)
            {
                return Err(rate(relative, self.period_s));
            }
        }
        let drift = self.period_s / self.nominal_s - 1.0;
        if drift.abs() > RATE {
            return Err(rate(0.0, self.period_s));
        }
        Ok(())
    }

    /// Whether rows come regularly at another period about `row`.
    fn changed_rate(&self, t: &[f64], row: usize) -> Option<Misplaced> {
        /// Rows by which the other period is determined.
        const ROWS: usize = 17;
        let from = row.saturating_sub(1);
        let near = &t[from..t.len().min(from + ROWS)];
        let steps: Vec<f64> = near.windows(2).map(|t| t[1] - t[0]).collect();
        if steps.len() < 4 {
            return None;
        }
        let period_s = median(steps.clone())?;
        let like = |step: f64| (step / period_s - 1.0).abs() < 0.1;
        let is_other = (period_s / self.period_s - 1.0).abs() > RATE;
        if !is_other || !steps.into_iter().all(like) {
            return None;
        }
        // Of two rates that are close to each other, rows are of the nearer one.
        let nearer = |step: f64| (step - period_s).abs() < (step - self.period_s).abs();
        let mut first = row;
        while first > 1 && like(t[first - 1] - t[first - 2]) && nearer(t[first - 1] - t[first - 2])
        {
            first -= 1;
        }
        Some(Misplaced::Rate {
            row: first,
            period_s,
        })
    }
}
