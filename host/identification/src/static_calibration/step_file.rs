//! A file of load steps: the rows of a table, or the plateaus of a recording cut into pieces; runs,
//! and the mean reading of a step with its known variance.

use std::ops::Range;
use std::path::Path;

use super::candidate_term::SAME_LOAD;
use super::plateaus::{FEWEST, fill_gaps, plateaus};
use crate::calibrate::CalibrateError;
use loadtwin_machine::{Channel, Encoding, Machine, extreme_words};
use loadtwin_recording::{RATES_HZ, Reader, RecordingError, Role, Timing, Unit, Wanted, columns};

/// Time over which samples of a recording are averaged first (s): a load is held for longer.
const BLOCK_S: f64 = 0.05;

/// Shortest plateau (s).
pub(super) const SHORTEST_S: f64 = FEWEST as f64 * BLOCK_S;

/// Pieces of a plateau of a recording: a mean, and changes from creep and drift.
const PIECES: usize = 4;

/// Column of the number of the run, and that of the speed of the main shaft, of a table.
const RUN: &str = "run";
const SPEED: &str = "speed";

/// A load that is held.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// File from which it is: the history of the load begins anew.
    pub file: usize,
    /// Series of loads, of all files together.
    pub run: usize,
    /// Stretch of the same load, of all files together.
    pub plateau: usize,
    /// Time (s), or the number of the row.
    pub t_s: f64,
    /// When the load was put on (s), or the row.
    pub since_s: f64,
    /// The applied load [N m].
    pub load: f64,
    /// Speed of the main shaft [rad/s]; 0 where it stands.
    pub speed: f64,
}

/// The column of the applied load.
pub(super) struct Applied<'a> {
    pub column: &'a str,
    /// Number of the load in the drivetrain.
    pub load: usize,
    pub unit: Unit,
    gain: f64,
    zero: f64,
}

impl<'a> Applied<'a> {
    pub(super) fn find(machine: &Machine, column: &'a str) -> Result<Self, CalibrateError> {
        let drivetrain = (machine.drivetrain.as_ref()).ok_or(CalibrateError::NoDrivetrain)?;
        let load_named = |name: &str| drivetrain.loads.iter().position(|load| load.name == name);
        let reference = machine.references.iter().find(|r| r.name == column);
        let found = match reference {
            Some(r) => load_named(&r.load).map(|load| (load, r.unit, r.gain, r.zero)),
            None => load_named(column).map(|load| (load, Unit::NEWTON_METRE, 1.0, 0.0)),
        };
        let Some((load, unit, gain, zero)) = found else {
            let names = (machine.references.iter().map(|r| r.name.as_str()))
                .chain(drivetrain.loads.iter().map(|load| load.name.as_str()));
            return Err(CalibrateError::TooLittle {
                recording: machine.path.clone(),
                reason: format!(
                    "{column:?} is neither a reference nor a load; allowed: {}",
                    names.collect::<Vec<_>>().join(", ")
                ),
            });
        };
        Ok(Self {
            column,
            load,
            unit,
            gain,
            zero,
        })
    }
}

/// A file as it was read, values as they are averaged.
pub(super) struct StepFile {
    t: Vec<f64>,
    /// Applied load, run, speed, then the channels.
    values: Vec<Option<Vec<f64>>>,
    /// Samples of each that are left out.
    saturated: Vec<usize>,
    pub encodings: Vec<Encoding>,
    pub is_recording: bool,
    pub is_timed: bool,
}

impl StepFile {
    pub(super) fn read(
        machine: &Machine,
        applied: &Applied<'_>,
        path: &Path,
    ) -> Result<Self, CalibrateError> {
        let mut layout = machine.recording.clone();
        layout.timing = Timing::Free;
        let names: Vec<(&str, bool)> = [(applied.column, true), (RUN, false), (SPEED, false)]
            .into_iter()
            .chain(machine.channels.iter().map(|c| (c.name.as_str(), false)))
            .collect();
        let found = columns(path, &layout, &names)?;
        let is_timed = found.iter().any(|column| column.name == "t");
        if !is_timed {
            layout.row_period_ms = Some(ROW_MS);
        }
        let unit = applied.unit.si();
        let encodings: Vec<Encoding> = (machine.channels.iter())
            .map(|channel| Encoding::of(channel, &found))
            .collect();
        let wanted: Vec<Wanted<'_>> = names
            .iter()
            .enumerate()
            .map(|(i, (name, required))| Wanted {
                name,
                unit: match i {
                    0 => unit,
                    1 => Unit::ONE,
                    2 => Unit::RADIAN_PER_SECOND,
                    _ => encodings[i - 3].unit(&machine.channels[i - 3]),
                },
                required: *required,
            })
            .collect();
        // The number of a run has no unit: it is handed out as written.
        let roles = [Role::Continuous, Role::Pulse];
        let reader = Reader::open_as(path, &layout, &wanted, &roles)?;
        let is_recording = is_timed && RATES_HZ.contains(&(1.0 / reader.period_s()));
        let per_block = if is_recording {
            (BLOCK_S / reader.period_s()).round().max(1.0) as usize
        } else {
            1
        };
        let is_saturated = |column: usize, value: f64| {
            column >= 3 && is_saturated(&machine.channels[column - 3], encodings[column - 3], value)
        };
        let Means {
            t,
            mut values,
            saturated,
            ..
        } = Means::of(reader, per_block, wanted.len(), is_saturated)?;
        let zero = applied.unit.to_si(applied.zero);
        if let Some(load) = &mut values[0] {
            for x in &mut *load {
                *x = (*x - zero) * applied.gain;
            }
            if is_recording {
                fill_gaps(load).map_err(|row| CalibrateError::TooLittle {
                    recording: path.to_owned(),
                    reason: format!(
                        "{:?} is missing for long from {:.2} s on; allowed: gaps shorter than {SHORTEST_S} s and \
                         {FEWEST} rows",
                        applied.column, t[row]
                    ),
                })?;
            }
        }
        Ok(Self {
            t,
            values,
            saturated,
            encodings,
            is_recording,
            is_timed,
        })
    }

    /// Values of the channel with that number.
    pub(super) fn channel(&self, number: usize) -> Option<&[f64]> {
        self.values[3 + number].as_deref()
    }

    /// Samples of the channel with that number that are left out.
    pub(super) fn saturated(&self, number: usize) -> usize {
        self.saturated[3 + number]
    }

    /// Whether rows are means at speeds; a recording has its history in any case.
    pub(super) fn are_means(&self) -> bool {
        !self.is_recording && self.values[2].is_some()
    }

    /// # Errors
    /// Where a load has no run or no speed though the file has that column.
    pub(super) fn steps(&self, file: usize) -> Result<Vec<Found>, String> {
        if self.is_recording {
            self.plateau_steps(file)
        } else {
            self.table_steps(file)
        }
    }

    fn load(&self) -> &[f64] {
        self.values[0].as_deref().unwrap_or_default()
    }

    /// A step for each row that has a load.
    fn table_steps(&self, file: usize) -> Result<Vec<Found>, String> {
        let at = |column: usize, i: usize| match &self.values[column] {
            Some(values) if !values[i].is_finite() => Err(format!(
                "row {} below the header has a load and no number in {:?}; allowed: one in each row, or no such column",
                i + 1,
                [RUN, SPEED][column - 1]
            )),
            values => Ok(values.as_ref().map_or(0.0, |values| values[i])),
        };
        let mut found: Vec<Found> = Vec::new();
        let mut runs: Vec<f64> = Vec::new();
        for (i, load) in self.load().iter().enumerate() {
            if !load.is_finite() {
                continue;
            }
            let number = at(1, i)?;
            let run = runs
                .iter()
                .position(|known| *known == number)
                .unwrap_or(runs.len());
            if run == runs.len() {
                runs.push(number);
            }
            let before = found.last().map(|found| found.step);
            let same = before.filter(|before| before.load == *load && before.run == run);
            found.push(Found {
                step: Step {
                    file,
                    run,
                    plateau: match (same, before) {
                        (Some(same), _) => same.plateau,
                        (None, before) => before.map_or(0, |before| before.plateau + 1),
                    },
                    t_s: self.t[i],
                    // A load is put on right after the reading before it.
                    since_s: match (same, before) {
                        (Some(same), _) => same.since_s,
                        (None, before) => before.map_or(self.t[i], |before| before.t_s),
                    },
                    load: *load,
                    speed: at(2, i)?,
                },
                rows: i..i + 1,
                plateau_rows: i..i + 1,
            });
        }
        if self.values[1].is_none() && self.values[2].is_none() {
            number_cycles(&mut found);
        }
        Ok(found)
    }

    /// A step for each piece of each plateau.
    fn plateau_steps(&self, file: usize) -> Result<Vec<Found>, String> {
        let all = plateaus(self.load());
        let mean = |range: Range<usize>, of: &[f64]| {
            let values: Vec<f64> = of[range]
                .iter()
                .copied()
                .filter(|x| x.is_finite())
                .collect();
            values.iter().sum::<f64>() / values.len() as f64
        };
        let mut found: Vec<Found> = Vec::new();
        for (plateau, rows) in all.iter().enumerate() {
            let load = mean(rows.clone(), self.load());
            let since_s = match plateau {
                0 => self.t[rows.start],
                _ => 0.5 * (self.t[all[plateau - 1].end - 1] + self.t[rows.start]),
            };
            let piece = rows.len() / PIECES;
            for k in 0..PIECES {
                let of_piece = rows.start + k * piece..rows.start + (k + 1) * piece;
                let speeds = self.values[2].as_ref();
                let speed = speeds.map_or(0.0, |speed| mean(of_piece.clone(), speed));
                if speed.is_nan() {
                    return Err(format!(
                        "{SPEED:?} is missing at {:.1} s, where the load is held",
                        self.t[of_piece.start]
                    ));
                }
                found.push(Found {
                    step: Step {
                        file,
                        run: 0,
                        plateau,
                        t_s: mean(of_piece.clone(), &self.t),
                        since_s,
                        load,
                        speed,
                    },
                    rows: of_piece,
                    plateau_rows: rows.clone(),
                });
            }
        }
        number_cycles(&mut found);
        Ok(found)
    }
}

/// Whether a value of a column is at an end of the range of the channel's converter.
fn is_saturated(channel: &Channel, encoding: Encoding, value: f64) -> bool {
    let Some(adc) = &channel.adc else {
        return false;
    };
    let word = match encoding {
        Encoding::Word => value,
        Encoding::Ratio => f64::from(channel.word_of_ratio(value)),
        Encoding::Reading => f64::from(channel.word(value)),
    };
    let [lowest, highest] = extreme_words(adc.bits).map(f64::from);
    word <= lowest || word >= highest
}

/// Period that stands for the number of a row [ms].
const ROW_MS: f64 = 1000.0;

/// A step and the rows of its readings.
pub(super) struct Found {
    pub step: Step,
    rows: Range<usize>,
    plateau_rows: Range<usize>,
}

impl Found {
    /// Mean reading (SI) and its known variance.
    ///
    /// Of a recording, `s^2 / n` with `s^2` half the mean square of differences of `n` means over
    /// sixteenths of the plateau, which creep and drift do not enlarge, and NaN where fewer than two
    /// differences are known; of a table, that of one word of the converter.
    pub(super) fn reading(
        &self,
        channel: &Channel,
        encoding: Encoding,
        values: &[f64],
    ) -> (f64, f64) {
        let mean = |rows: Range<usize>| {
            let known = values[rows].iter().filter(|x| x.is_finite());
            let (sum, n) = known.fold((0.0, 0.0), |(sum, n), x| (sum + x, n + 1.0));
            // The mean of words is a word between them.
            encoding.reading(channel, sum / n)
        };
        let value = mean(self.rows.clone());
        let word = channel.lsb_si().powi(2) / 12.0;
        let rounded = if encoding == Encoding::Ratio {
            word
        } else {
            0.0
        };
        if self.plateau_rows.len() < FEWEST {
            return (value, word);
        }
        let part = self.plateau_rows.len() / FEWEST;
        let means: Vec<f64> = (0..FEWEST)
            .map(|k| {
                let from = self.plateau_rows.start + k * part;
                mean(from..from + part)
            })
            .collect();
        let differences = means.windows(2).map(|pair| (pair[1] - pair[0]).powi(2));
        let known: Vec<f64> = differences.filter(|square| square.is_finite()).collect();
        let variance = if known.len() < 2 {
            f64::NAN
        } else {
            0.5 * known.iter().sum::<f64>() / known.len() as f64
        };
        let parts = self.rows.len() as f64 / part as f64;
        (value, variance / parts + rounded)
    }
}

/// Counts a new run where a load of one sign turns at its lowest value.
///
/// A load is low if it is nearer to the lowest one than to the next. Where loads have both signs,
/// one file is one run.
fn number_cycles(found: &mut [Found]) {
    let sizes = || found.iter().map(|found| found.step.load.abs());
    let largest = sizes().fold(0.0, f64::max);
    let lowest = sizes().fold(f64::INFINITY, f64::min);
    let next = sizes()
        .filter(|size| *size > lowest + SAME_LOAD * largest)
        .fold(f64::INFINITY, f64::min);
    let is_low: Vec<bool> = sizes().map(|size| size < 0.5 * (lowest + next)).collect();
    let has_sign = |sign: f64| (found.iter()).any(|f| f.step.load * sign > 0.5 * (lowest + next));
    if has_sign(1.0) && has_sign(-1.0) {
        return;
    }
    let (mut run, mut left) = (0, false);
    let mut runs = vec![0; found.len()];
    for i in 0..found.len() {
        if left && is_low[i] && is_low.get(i + 1) == Some(&false) {
            // The last reading at the lowest load begins the next run; of a recording all pieces.
            (run, left) = (run + 1, false);
            for k in (0..i)
                .rev()
                .take_while(|&k| found[k].plateau_rows == found[i].plateau_rows)
            {
                runs[k] = run;
            }
        }
        left |= !is_low[i];
        runs[i] = run;
    }
    for (found, run) in found.iter_mut().zip(runs) {
        found.step.run = run;
    }
}

/// Means over blocks of rows.
struct Means {
    per_block: usize,
    rows: usize,
    sum_t: f64,
    sums: Vec<(f64, f64)>,
    saturated: Vec<usize>,
    t: Vec<f64>,
    values: Vec<Option<Vec<f64>>>,
}

impl Means {
    fn of(
        reader: Reader,
        per_block: usize,
        columns: usize,
        is_saturated: impl Fn(usize, f64) -> bool,
    ) -> Result<Self, RecordingError> {
        let mut means = Self {
            per_block,
            rows: 0,
            sum_t: 0.0,
            sums: vec![(0.0, 0.0); columns],
            saturated: vec![0; columns],
            t: Vec::new(),
            values: vec![None; columns],
        };
        for block in reader {
            let block = block?;
            for i in 0..block.t.len() {
                let mut row: Vec<Option<f64>> = (block.columns.iter())
                    .map(|c| c.as_ref().map(|c| c[i]))
                    .collect();
                for (column, value) in row.iter_mut().enumerate() {
                    if let Some(value) = value.as_mut().filter(|v| is_saturated(column, **v)) {
                        *value = f64::NAN;
                        means.saturated[column] += 1;
                    }
                }
                means.push(block.t[i], row.into_iter());
            }
        }
        Ok(means)
    }

    fn push(&mut self, t: f64, row: impl Iterator<Item = Option<f64>>) {
        self.sum_t += t;
        self.rows += 1;
        let ends = self.rows == self.per_block;
        for ((value, sum), values) in row.zip(&mut self.sums).zip(&mut self.values) {
            let Some(value) = value else { continue };
            if value.is_finite() {
                sum.0 += value;
                sum.1 += 1.0;
            }
            if ends {
                // NaN where no sample came.
                values.get_or_insert_default().push(sum.0 / sum.1);
                *sum = (0.0, 0.0);
            }
        }
        if ends {
            self.t.push(self.sum_t / self.per_block as f64);
            (self.sum_t, self.rows) = (0.0, 0);
        }
    }
}
