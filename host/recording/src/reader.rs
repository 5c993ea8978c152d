//! Reads a recording in blocks of samples (`Reader`, `Block`) with the wanted columns in the wanted
//! units. Rows are placed on the ticks of one clock unless the layout states that there is none.
//! Gaps up to the allowed length become samples of NaN; longer ones and time running backwards are
//! errors.
use std::path::PathBuf;

use super::TIME;
use super::clock_state::Clock;
use super::column_selection::Selection;
use super::error::{Problem, RecordingError, Row, WHOLE_COUNTS};
use super::recording_layout::{Column, CsvLayout, Role, Timing, Wanted};
use super::resample::Resampler;
use super::row_source::{Input, Opened, Rows, Source};
use super::sampling_grid::{Gap, Grid, Misplaced};

/// Time that no clock shows, 30 000 years (s): nanoseconds since 1970 read as
/// seconds are later.
const LATEST_S: f64 = 1e12;

/// Counts from which f64 does not hold each whole number.
const LARGEST_COUNT: f64 = (1_u64 << f64::MANTISSA_DIGITS) as f64;

/// Consecutive samples of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Row of the first sample, from 0; rows put into gaps are counted.
    pub first_row: u64,
    /// Time of each sample, s, strictly increasing.
    pub t: Vec<f64>,
    /// The wanted columns in the order wanted, each as long as `t`, in the unit
    /// wanted; none for an optional column that the recording lacks. NaN is a
    /// missing sample; every other value is finite.
    pub columns: Vec<Option<Vec<f64>>>,
    /// Samples that are not in the file but were put into a gap (indices into
    /// `t`): all their columns are NaN.
    pub bridged: Vec<usize>,
}

impl Block {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there is no sample; a [`Reader`] never hands out such a block.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }
}

/// Reads a recording block by block.
///
/// ```
/// use loadtwin_recording::{CsvLayout, Reader, Wanted};
/// # let dir = tempfile::tempdir()?;
/// # let path = dir.path().join("bench.csv");
/// std::fs::write(&path, "t [ms],ta1 [µm/m]\n0,100\n2,101\n4,102.5\n")?;
/// let wanted = [Wanted { name: "ta1", unit: "m/m".parse()?, required: true }];
/// let reader = Reader::open(&path, &CsvLayout::default(), &wanted)?;
/// assert_eq!(reader.period_s(), 0.002);
/// for block in reader {
///     let block = block?;
///     assert_eq!(block.t, [0.0, 0.002, 0.004]);
///     assert_eq!(block.columns[0].as_deref(), Some(&[100e-6, 101e-6, 102.5e-6][..]));
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Reader {
    file: PathBuf,
    columns: Vec<Column>,
    notes: Vec<String>,
    source: Source,
    selection: Selection,
    timing: Timing,
    /// Period by the description (s), where the caller has one.
    expected_s: Option<f64>,
    /// Whether the grid is that of the part before.
    is_continued: bool,
    /// Ticks of the rows.
    grid: Grid,
    largest_gap: u32,
    /// Rows read before `ahead`.
    rows_before: u64,
    /// Rows put into gaps so far; of resampled rows all ticks.
    bridged: u64,
    /// The row handed out last and its time.
    last: Option<(Row, f64)>,
    /// Time of the row read last.
    last_t: Option<f64>,
    /// The first rows, read to find the sample period.
    ahead: Option<Rows>,
    /// Where rows are brought onto ticks, once they are.
    resampler: Option<Resampler>,
    /// Whether it has all rows.
    all_read: bool,
    ended: bool,
}

impl Reader {
    /// Opens a recording and reads its first rows.
    ///
    /// # Errors
    /// [`RecordingError`] when the file cannot be read, lacks a required column
    /// or has it in a unit of another quantity, names a column twice, has fewer
    /// than 2 rows, or where its first rows are wrong.
    pub fn open<'a>(
        input: impl Into<Input<'a>>,
        layout: &CsvLayout,
        wanted: &[Wanted<'_>],
    ) -> Result<Self, RecordingError> {
        Self::open_as(input, layout, wanted, &[])
    }

    /// As [`Reader::open`]; `roles`: what the wanted columns are, in their order.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn open_as<'a>(
        input: impl Into<Input<'a>>,
        layout: &CsvLayout,
        wanted: &[Wanted<'_>],
        roles: &[Role],
    ) -> Result<Self, RecordingError> {
        let input = input.into();
        Self::try_open(input, layout, wanted, (roles, None)).map_err(|problem| input.error(problem))
    }

    /// As [`Reader::open_as`], where the recording goes on from that of which `clock` is: rows are
    /// placed on its ticks. A part may have a single row, or none.
    ///
    /// # Errors
    /// As [`Reader::open_as`].
    pub fn continued<'a>(
        input: impl Into<Input<'a>>,
        layout: &CsvLayout,
        wanted: &[Wanted<'_>],
        roles: &[Role],
        clock: Clock,
    ) -> Result<Self, RecordingError> {
        let input = input.into();
        Self::try_open(input, layout, wanted, (roles, Some(clock)))
            .map_err(|problem| input.error(problem))
    }

    fn try_open(
        input: Input<'_>,
        layout: &CsvLayout,
        wanted: &[Wanted<'_>],
        (roles, clock): (&[Role], Option<Clock>),
    ) -> Result<Self, Problem> {
        layout.check()?;
        let names: Vec<_> = wanted.iter().map(|w| (w.name, w.required)).collect();
        let opened = Opened::open(input, layout, &names)?;
        let columns = opened.columns;
        let selection = Selection::try_new(&columns, wanted, roles, layout)
            .map_err(|problem| opened.format.explained(problem, &columns))?;
        let source = Source::start(opened.format, selection.picks.clone())?;
        let mut last_t = clock.as_ref().map(Clock::last_t);
        let last = last_t.map(|t| (Row { row: 0, line: None }, t));
        let first = read_rows(&source, &selection, 0, &mut last_t)?;
        let is_continued = clock.is_some();
        let grid = match layout.timing {
            _ if is_continued => clock.map(Clock::into_grid),
            Timing::Free => Grid::free(first.t()),
            Timing::Clocked | Timing::Resample => Grid::of(first.t(), None)?,
        };
        let grid = grid.ok_or(Problem::TooShort {
            found: first.t().len() as u64,
        })?;
        Ok(Self {
            file: input.name().to_path_buf(),
            columns,
            notes: opened.notes,
            source,
            selection,
            timing: layout.timing,
            expected_s: None,
            is_continued,
            grid,
            largest_gap: layout.largest_gap,
            rows_before: 0,
            bridged: 0,
            last,
            last_t,
            ahead: Some(first),
            resampler: None,
            all_read: false,
            ended: false,
        })
    }

    /// Sets the sample period that the description has, s; the first rows alone
    /// say it otherwise. To be called before the first block.
    ///
    /// # Errors
    /// [`Problem::Period`] when the rows come at another period, by more than
    /// 2 %; [`Problem::Layout`] for rows without a clock.
    pub fn expect_period(mut self, period_s: f64) -> Result<Self, RecordingError> {
        self.set_period(period_s)
            .map_err(|problem| RecordingError {
                problem,
                file: self.file.clone(),
            })?;
        Ok(self)
    }

    fn set_period(&mut self, period_s: f64) -> Result<(), Problem> {
        self.expected_s = Some(period_s);
        match (self.timing, &self.ahead) {
            (Timing::Free, _) => Err(Problem::Layout {
                field: "timing",
                found: "\"free\"".into(),
                allowed: "`clocked` or `resample` where samples follow at `rate_hz`; rows without \
                    a clock only in a [balance]",
            }),
            (Timing::Clocked, Some(first)) if !self.is_continued => {
                if let Some(grid) = Grid::of(first.t(), Some(period_s))? {
                    self.grid = grid;
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// The clock after the last block, by which a recording goes on; none where rows are brought
    /// onto ticks, of which those at the end wait for rows after them.
    pub fn clock(&self) -> Option<Clock> {
        let last_t = self.last.map(|(_, t)| t)?;
        (self.timing != Timing::Resample).then(|| Clock::new(self.grid.clone(), last_t))
    }

    /// Nominal time from one sample to the next, s.
    pub fn period_s(&self) -> f64 {
        self.expected_s
            .unwrap_or_else(|| self.grid.recording_period_s())
    }

    /// All columns of the recording, wanted or not, the time among them.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// What was recognised, joined or resampled to read the recording, one line
    /// each; empty where it is written as the layout says.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Part of the recording that was read so far, 0 to 1.
    pub fn progress(&self) -> f64 {
        self.source.progress()
    }

    fn next_rows(&mut self) -> Result<Rows, Problem> {
        match self.ahead.take() {
            Some(rows) => Ok(rows),
            None => read_rows(
                &self.source,
                &self.selection,
                self.rows_before,
                &mut self.last_t,
            ),
        }
    }

    /// The next ticks of rows that are brought onto them.
    fn next_resampled(&mut self) -> Result<Option<Block>, Problem> {
        loop {
            if let Some(resampler) = &mut self.resampler {
                let ticks = resampler.take(self.all_read)?;
                if !ticks.t.is_empty() {
                    let first_row = self.bridged;
                    self.bridged += ticks.t.len() as u64;
                    return Ok(Some(Block {
                        first_row,
                        columns: self.ordered(ticks.columns),
                        t: ticks.t,
                        bridged: ticks.bridged,
                    }));
                }
            }
            if self.all_read {
                return Ok(None);
            }
            let rows = self.next_rows()?;
            self.all_read = rows.t().is_empty();
            self.rows_before += rows.t().len() as u64;
            if let Some(resampler) = &mut self.resampler {
                resampler.push(rows);
            } else {
                let roles = self.selection.roles.clone();
                let first = Resampler::new(rows, roles, self.period_s(), self.largest_gap);
                self.resampler = Some(first);
            }
        }
    }

    fn next_block(&mut self) -> Result<Option<Block>, Problem> {
        if self.timing == Timing::Resample {
            return self.next_resampled();
        }
        let rows = self.next_rows()?;
        let Some(&end) = rows.t().last() else {
            return Ok(None);
        };
        let count = rows.t().len();
        let gaps = self
            .grid
            .place(rows.t(), self.largest_gap)
            .map_err(|misplaced| self.misplaced(misplaced, &rows))?;
        let first_row = self.rows_before + self.bridged;
        let (t, bridged) = bridge_time(rows.t(), &gaps, self.last.map_or(end, |(_, t)| t));
        self.last = Some((rows.place(self.rows_before, count - 1), end));
        self.rows_before += count as u64;
        self.bridged += bridged.len() as u64;
        let columns = self
            .ordered(rows.columns)
            .into_iter()
            .map(|column| column.map(|values| bridge_values(values, &gaps)))
            .collect();
        Ok(Some(Block {
            first_row,
            t,
            columns,
            bridged,
        }))
    }

    /// The columns wanted, in the order and the units wanted.
    fn ordered(&self, columns: Vec<Vec<f64>>) -> Vec<Option<Vec<f64>>> {
        let mut columns: Vec<_> = columns.into_iter().map(Some).collect();
        let order = &self.selection.order;
        let mut ordered = Vec::with_capacity(order.len());
        for (position, &wanted) in order.iter().enumerate() {
            ordered.push(wanted.and_then(|(k, conversion)| {
                // The last to want a column gets it without a copy.
                let again = order[position + 1..].iter().flatten().any(|w| w.0 == k);
                let values = if again {
                    columns[k].clone()
                } else {
                    columns[k].take()
                };
                values.map(|mut values| {
                    conversion.apply_to(&mut values);
                    values
                })
            }));
        }
        ordered
    }

    /// What is wrong with a row that the grid does not hold, by its place.
    fn misplaced(&self, misplaced: Misplaced, rows: &Rows) -> Problem {
        let at = |row: usize| (rows.place(self.rows_before, row), rows.t()[row]);
        let before = |row: usize| match row.checked_sub(1) {
            Some(row) => at(row),
            None => self.last.unwrap_or_else(|| at(0)),
        };
        let clock_s = self.grid.recording_period_s();
        match misplaced {
            Misplaced::SameTick {
                row,
                before_is_further,
            } => {
                let (mut far, mut near) = (at(row), before(row));
                if before_is_further {
                    std::mem::swap(&mut far, &mut near);
                }
                Problem::SameTick {
                    row: far.0,
                    t: far.1,
                    other: near.0,
                    other_t: near.1,
                    period_s: clock_s,
                }
            }
            Misplaced::Gap { row, missing } => Problem::Gap {
                row: at(row).0,
                before: before(row).1,
                gap_s: at(row).1 - before(row).1,
                missing,
                allowed: self.largest_gap,
                period_s: clock_s,
            },
            Misplaced::Wander { row } => Problem::Wander {
                row: at(row).0,
                t: at(row).1,
                period_s: clock_s,
            },
            Misplaced::Rate { row, period_s } => Problem::Rate {
                row: at(row).0,
                t: at(row).1,
                found_s: period_s,
                period_s: clock_s,
            },
        }
    }
}

/// Reads rows, converts their time, and refuses one that runs backwards, and counts that are not
/// exact.
pub(super) fn read_rows(
    source: &Source,
    selection: &Selection,
    rows_before: u64,
    last_t: &mut Option<f64>,
) -> Result<Rows, Problem> {
    let mut rows = source.next()?;
    selection.time.apply_to(&mut rows.columns[Rows::TIME]);
    let mut before = last_t.unwrap_or(f64::NEG_INFINITY);
    for (i, &found) in rows.t().iter().enumerate() {
        if found.abs() > LATEST_S {
            return Err(Problem::Cell {
                row: rows.place(rows_before, i),
                column: TIME.into(),
                found: format!("{found} s"),
                allowed: "at most 1e12 s; is its unit another (ns, µs, ms)?",
            });
        }
        if found <= before {
            return Err(Problem::Backwards {
                row: rows.place(rows_before, i),
                before,
                found,
                continues: rows_before == 0 && i == 0,
            });
        }
        before = found;
    }
    *last_t = rows.t().last().copied().or(*last_t);
    for (pick, name) in &selection.counts {
        let mut values = rows.columns[*pick].iter();
        if let Some(i) = values.position(|value| value.abs() >= LARGEST_COUNT) {
            return Err(Problem::Cell {
                row: rows.place(rows_before, i),
                column: name.clone(),
                found: rows.columns[*pick][i].to_string(),
                allowed: WHOLE_COUNTS,
            });
        }
    }
    Ok(rows)
}

impl Iterator for Reader {
    type Item = Result<Block, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let next = self.next_block().transpose();
        self.ended = !matches!(next, Some(Ok(_)));
        next.map(|block| {
            block.map_err(|problem| RecordingError {
                file: self.file.clone(),
                problem,
            })
        })
    }
}

/// Times with those of the missing samples, evenly spaced in their gap, and
/// where they are; `before`: the time of the row before the first.
fn bridge_time(t: &[f64], gaps: &[Gap], before: f64) -> (Vec<f64>, Vec<usize>) {
    let mut bridged = Vec::new();
    let mut all = Vec::with_capacity(t.len());
    let mut done = 0;
    for gap in gaps {
        all.extend_from_slice(&t[done..gap.row]);
        done = gap.row;
        let before = if gap.row > 0 { t[gap.row - 1] } else { before };
        let step = (t[gap.row] - before) / (gap.missing + 1) as f64;
        for i in 1..=gap.missing {
            bridged.push(all.len());
            all.push(before + i as f64 * step);
        }
    }
    all.extend_from_slice(&t[done..]);
    (all, bridged)
}

fn bridge_values(values: Vec<f64>, gaps: &[Gap]) -> Vec<f64> {
    if gaps.is_empty() {
        return values;
    }
    let mut all = Vec::with_capacity(values.len());
    let mut done = 0;
    for gap in gaps {
        all.extend_from_slice(&values[done..gap.row]);
        all.extend(std::iter::repeat_n(f64::NAN, gap.missing as usize));
        done = gap.row;
    }
    all.extend_from_slice(&values[done..]);
    all
}
