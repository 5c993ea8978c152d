//! Reading a recording block by block.
use std::path::{Path, PathBuf};

use super::error::{Problem, RecordingError};
use super::layout::{Column, CsvLayout, Wanted};
use super::selection::Selection;
use super::source::{Format, Rows, Source};

/// A step longer than this many sample periods is a gap.
const GAP: f64 = 1.5;

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
/// use loadtwin::recording::{CsvLayout, Reader, Wanted};
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
    source: Source,
    selection: Selection,
    period_s: f64,
    largest_gap: u32,
    /// Rows read before `ahead`.
    rows_before: u64,
    /// Rows put into gaps so far.
    bridged: u64,
    last_t: Option<f64>,
    /// The first rows, read to find the sample period.
    ahead: Option<Rows>,
    ended: bool,
}

impl Reader {
    /// Opens a recording and reads its first rows.
    ///
    /// # Errors
    /// [`RecordingError`] when the file cannot be read, lacks a required column
    /// or has it in a unit of another quantity, names a column twice, has fewer
    /// than 2 rows, or where its first rows are wrong.
    pub fn open(
        path: &Path,
        layout: &CsvLayout,
        wanted: &[Wanted<'_>],
    ) -> Result<Self, RecordingError> {
        Self::try_open(path, layout, wanted).map_err(|problem| RecordingError {
            file: path.to_path_buf(),
            problem,
        })
    }

    fn try_open(path: &Path, layout: &CsvLayout, wanted: &[Wanted<'_>]) -> Result<Self, Problem> {
        let format = Format::open(path, layout, wanted)?;
        let selection = Selection::try_new(format.columns(), wanted)?;
        let columns = format.columns().to_vec();
        let source = Source::start(format, selection.picks.clone())?;
        let mut reader = Self {
            file: path.to_path_buf(),
            columns,
            source,
            selection,
            period_s: f64::NAN,
            largest_gap: layout.largest_gap,
            rows_before: 0,
            bridged: 0,
            last_t: None,
            ahead: None,
            ended: false,
        };
        let first = reader.read_rows()?;
        let steps: Vec<f64> = first.t().windows(2).map(|t| t[1] - t[0]).collect();
        reader.period_s = median(steps).ok_or(Problem::TooShort {
            found: first.t().len() as u64,
        })?;
        reader.ahead = Some(first);
        Ok(reader)
    }

    /// Sets the nominal sample period, which is otherwise the median step of
    /// the first block, s.
    ///
    /// # Errors
    /// [`Problem::Period`] when the median differs from it by more than 2 %.
    pub fn expect_period(mut self, period_s: f64) -> Result<Self, RecordingError> {
        if ((self.period_s / period_s) - 1.0).abs() <= 0.02 {
            self.period_s = period_s;
            Ok(self)
        } else {
            Err(RecordingError {
                problem: Problem::Period {
                    found_s: self.period_s,
                    allowed_s: period_s,
                },
                file: self.file,
            })
        }
    }

    /// Nominal time from one sample to the next, s.
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// All columns of the recording, wanted or not, the time among them.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Part of the recording that was read so far, 0 to 1.
    pub fn progress(&self) -> f64 {
        self.source.progress()
    }

    /// Reads rows, converts them, and refuses time that runs backwards.
    fn read_rows(&mut self) -> Result<Rows, Problem> {
        let mut rows = self.source.next()?;
        self.selection.time.apply_to(&mut rows.columns[Rows::TIME]);
        let mut before = self.last_t.unwrap_or(f64::NEG_INFINITY);
        for (i, &found) in rows.t().iter().enumerate() {
            if found <= before {
                return Err(Problem::Backwards {
                    row: rows.place(self.rows_before, i),
                    before,
                    found,
                });
            }
            before = found;
        }
        Ok(rows)
    }

    fn next_block(&mut self) -> Result<Option<Block>, Problem> {
        let rows = match self.ahead.take() {
            Some(rows) => rows,
            None => self.read_rows()?,
        };
        if rows.t().is_empty() {
            return Ok(None);
        }
        let count = rows.t().len() as u64;
        let gaps = self.gaps(&rows)?;
        let first_row = self.rows_before + self.bridged;
        self.rows_before += count;
        self.last_t = rows.t().last().copied();
        let (t, bridged) = bridge_time(rows.t(), &gaps);
        self.bridged += bridged.len() as u64;
        let mut columns: Vec<_> = rows.columns.into_iter().map(Some).collect();
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
                    bridge_values(values, &gaps)
                })
            }));
        }
        Ok(Some(Block {
            first_row,
            t,
            columns: ordered,
            bridged,
        }))
    }

    /// Gaps that may be bridged.
    fn gaps(&self, rows: &Rows) -> Result<Vec<Gap>, Problem> {
        let allowed_s = (f64::from(self.largest_gap) + GAP) * self.period_s;
        let mut gaps = Vec::new();
        let mut before = self.last_t;
        for (row, &t) in rows.t().iter().enumerate() {
            if let Some(before) = before {
                let gap_s = t - before;
                if gap_s > allowed_s {
                    return Err(Problem::Gap {
                        row: rows.place(self.rows_before, row),
                        before,
                        gap_s,
                        allowed_s,
                        period_s: self.period_s,
                    });
                }
                if gap_s > GAP * self.period_s {
                    let missing = (gap_s / self.period_s).round() as usize - 1;
                    gaps.push(Gap {
                        row,
                        missing,
                        before,
                    });
                }
            }
            before = Some(t);
        }
        Ok(gaps)
    }
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

/// Samples absent from the file before a row.
struct Gap {
    row: usize,
    missing: usize,
    /// Time of the row before the gap, s.
    before: f64,
}

/// Times with those of the missing samples, evenly spaced in their gap, and
/// where they are.
fn bridge_time(t: &[f64], gaps: &[Gap]) -> (Vec<f64>, Vec<usize>) {
    let mut bridged = Vec::new();
    let mut all = Vec::with_capacity(t.len());
    let mut done = 0;
    for gap in gaps {
        all.extend_from_slice(&t[done..gap.row]);
        done = gap.row;
        let step = (t[gap.row] - gap.before) / (gap.missing + 1) as f64;
        for i in 1..=gap.missing {
            bridged.push(all.len());
            all.push(gap.before + i as f64 * step);
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
        all.extend(std::iter::repeat_n(f64::NAN, gap.missing));
        done = gap.row;
    }
    all.extend_from_slice(&values[done..]);
    all
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
