//! The index pulse in a recording: a column of latched counts or of a level.

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::ReplayError;
use loadtwin_machine::{Encoder, Index, IndexSignal, Machine};
use loadtwin_recording::{Quantity, Reader, Role, Unit, Wanted, columns as columns_of};

/// Rows that show what the column holds, once one of them has a pulse.
const ROWS: usize = 1 << 20;

/// Spread of the low level over the height of the pulse, at most (quartile
/// deviation): of white noise about one level it is 0.25 to 0.3.
const SPREAD: f64 = 0.1;

/// Hysteresis of the edges, parts of the height.
const RISEN: f64 = 2.0 / 3.0;
const FALLEN: f64 = 1.0 / 3.0;

/// Deviation from whole turns between two pulses, beside the motion of two rows [turns].
const TURN: f64 = 0.02;

/// A column that holds no index pulse.
#[derive(Debug, Error)]
#[error(
    "{}: column `{column}` is no index pulse: {found}; allowed: counts of the encoder latched by the \
     pulse, or a level that rises once a turn (`signal` under [index] says which)", file.display()
)]
pub struct IndexError {
    /// The recording.
    pub file: PathBuf,
    /// The column.
    pub column: String,
    /// What it holds.
    pub found: String,
}

/// Finds the pulses in a column, row by row.
#[derive(Clone, Debug)]
pub(super) struct Pulses {
    kind: Kind,
    /// The last value known; of a level whether it is high.
    last: Option<f64>,
    started: bool,
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    /// Each new value is a latched count; one of 0 only where empty cells stand
    /// between counts.
    Latched { zero_is_count: bool },
    /// Edges by these thresholds; whether an empty cell is low.
    Level {
        fallen: f64,
        risen: f64,
        empty_is_low: bool,
    },
    /// Nothing ever rises.
    Never,
}

/// A pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Pulse {
    /// With the count that it latched.
    Count(f64),
    /// In this row.
    Here,
}

impl Pulses {
    fn new(kind: Kind) -> Self {
        Self {
            kind,
            last: None,
            started: false,
        }
    }

    /// The pulse of the next row; `value`: NaN where the cell is empty; `absent`:
    /// the row is not in the file.
    pub(super) fn next(&mut self, value: f64, absent: bool) -> Option<Pulse> {
        let started = std::mem::replace(&mut self.started, true);
        match self.kind {
            Kind::Never => None,
            Kind::Latched { zero_is_count } => {
                if value.is_nan() || (value == 0.0 && !zero_is_count) {
                    // What a register holds on after a lost row is no new count.
                    if !absent {
                        self.last = Some(f64::NAN);
                    }
                    return None;
                }
                let is_new = self.last != Some(value);
                // A register that holds a count from before the recording.
                let is_held = self.last.is_none() && !started;
                self.last = Some(value);
                (is_new && !is_held).then_some(Pulse::Count(value))
            }
            Kind::Level {
                fallen,
                risen,
                empty_is_low,
            } => {
                let high = match value {
                    v if v >= risen => Some(1.0),
                    v if v <= fallen => Some(0.0),
                    v if v.is_nan() && !absent && empty_is_low => Some(0.0),
                    v if v.is_nan() => {
                        // An edge in a gap has no row.
                        self.last = self.last.filter(|_| !absent);
                        return None;
                    }
                    _ => return None,
                };
                let rises = self.last == Some(0.0) && high == Some(1.0);
                self.last = high;
                rises.then_some(Pulse::Here)
            }
        }
    }

    /// What the index column of the recording in `path` holds.
    ///
    /// # Errors
    /// When it cannot be read, or is neither counts nor a level.
    pub(super) fn of(machine: &Machine, index: &Index, path: &Path) -> Result<Self, ReplayError> {
        let rows = Rows::read(machine, index, path)?;
        let fail = |found: String| IndexError {
            file: path.to_owned(),
            column: index.name.clone(),
            found,
        };
        let is_latched = match index.signal {
            Some(signal) => signal == IndexSignal::Latched,
            None => rows.latches().map_err(fail)?,
        };
        let kind = if is_latched {
            rows.latched()
        } else {
            rows.level().map_err(fail)?
        };
        let pulses = Self::new(kind);
        rows.check_turns(pulses.clone()).map_err(fail)?;
        Ok(pulses)
    }
}

/// The column and the encoder beside it.
struct Rows {
    values: Vec<f64>,
    absent: Vec<bool>,
    /// Counts; NaN where unknown.
    counts: Vec<f64>,
    /// Counts from pulse to pulse, and of the counter.
    encoder: Option<(f64, f64)>,
}

impl Rows {
    fn read(machine: &Machine, index: &Index, path: &Path) -> Result<Self, ReplayError> {
        let encoder = machine.homed_encoder();
        let mut columns = vec![Wanted {
            name: &index.name,
            unit: Unit::ONE,
            required: true,
        }];
        let names = [(index.name.as_str(), true), (index.encoder.as_str(), false)];
        let found = columns_of(path, &machine.recording, &names)?;
        let quantity = |name: &str| {
            let column = found.iter().find(|c| c.name == name)?;
            let unit = column.unit.as_deref()?.parse::<Unit>().ok()?;
            Some(unit.quantity())
        };
        let is_angle = encoder.is_some_and(|e| quantity(&e.name) == Some(Quantity::Angle));
        columns.extend(encoder.map(|e| Wanted {
            name: &e.name,
            unit: if is_angle { Unit::RADIAN } else { Unit::COUNTS },
            required: false,
        }));
        let role = encoder.map_or(Role::Continuous, |e| e.role(is_angle));
        let roles = [Role::Pulse, role];
        let reader = Reader::open_as(path, &machine.recording, &columns, &roles)?
            .expect_period(1.0 / machine.rate_hz)?;
        let mut rows = Self {
            values: Vec::new(),
            absent: Vec::new(),
            counts: Vec::new(),
            encoder: encoder.map(|e| (counts_between(machine, e), f64::from(e.bits).exp2())),
        };
        let scale = match encoder {
            Some(e) if is_angle => e.counts_per_turn / std::f64::consts::TAU,
            _ => 1.0,
        };
        for block in reader {
            let block = block?;
            if rows.values.len() >= ROWS && rows.values.iter().any(|v| v.is_finite() && *v != 0.0) {
                break;
            }
            // A column that never showed anything is not kept.
            if rows.values.len() >= 2 * ROWS {
                rows.values.drain(..ROWS);
                rows.absent.drain(..ROWS);
                rows.counts.drain(..ROWS);
            }
            let length = block.len();
            let from = rows.absent.len();
            rows.absent.resize(from + length, false);
            for &i in &block.bridged {
                rows.absent[from + i] = true;
            }
            let mut columns = block.columns.into_iter();
            let mut next = || columns.next().flatten();
            rows.values.extend(next().unwrap_or(vec![f64::NAN; length]));
            let counts = next().unwrap_or(vec![f64::NAN; length]);
            rows.counts.extend(counts.iter().map(|c| c * scale));
        }
        Ok(rows)
    }

    /// Motion of the encoder up to row `i` from the row before [counts].
    fn step(&self, i: usize) -> f64 {
        let modulus = self.encoder.map_or(f64::INFINITY, |(_, modulus)| modulus);
        wrapped(self.counts[i] - self.counts[i.saturating_sub(1)], modulus)
    }

    fn latched(&self) -> Kind {
        let empty = self
            .values
            .iter()
            .zip(&self.absent)
            .filter(|(v, absent)| v.is_nan() && !**absent);
        Kind::Latched {
            zero_is_count: 2 * empty.count() > self.values.len(),
        }
    }

    /// Whether most new values are counts that the encoder just passed; an error where some are.
    fn latches(&self) -> Result<bool, String> {
        let modulus = self.encoder.map_or(f64::INFINITY, |(_, modulus)| modulus);
        let (mut new, mut passed) = (0_usize, 0_usize);
        let mut pulses = Pulses::new(self.latched());
        let mut levels: Vec<f64> = Vec::new();
        for (i, (&value, &absent)) in self.values.iter().zip(&self.absent).enumerate() {
            let Some(Pulse::Count(count)) = pulses.next(value, absent) else {
                continue;
            };
            if levels.len() < 2 && !levels.contains(&count) {
                levels.push(count);
            }
            let (motion, behind) = (self.step(i), wrapped(self.counts[i] - count, modulus));
            if motion.is_finite() {
                new += 1;
                passed += usize::from(behind.abs() <= 2.0 * motion.abs() + 2.0);
            }
        }
        if self.encoder.is_none() || new == 0 {
            return Ok(self.encoder.is_some() && levels.len() == 2);
        }
        // A level agrees with the encoder at single rows by chance, counts throughout.
        if 2 * passed <= new && passed >= 3 {
            return Err(format!(
                "{passed} of {new} values are counts that the encoder just passed, the others are not"
            ));
        }
        Ok(2 * passed > new)
    }

    /// The thresholds of a level.
    fn level(&self) -> Result<Kind, String> {
        let mut values: Vec<f64> = self
            .values
            .iter()
            .copied()
            .filter(|v| !v.is_nan())
            .collect();
        values.sort_unstable_by(f64::total_cmp);
        let (Some(&least), Some(&most)) = (values.first(), values.last()) else {
            return Ok(Kind::Never);
        };
        if least == most {
            // Written only where the pulse is; or nothing but one level.
            let is_pulse = values.len() < self.values.len() && most > 0.0;
            let level = Kind::Level {
                fallen: FALLEN * most,
                risen: RISEN * most,
                empty_is_low: true,
            };
            return Ok(if is_pulse { level } else { Kind::Never });
        }
        let upper = values.partition_point(|v| *v < 0.5 * (least + most));
        let low = values[upper / 2];
        let high = values[upper + (values.len() - upper) / 2];
        let spread = 0.5 * (values[3 * upper / 4] - values[upper / 4]) / (high - low);
        if spread > SPREAD {
            return Err(format!(
                "found values spread from {least} to {most} without a low level ({:.0} % of the \
                 height scattered)",
                100.0 * spread
            ));
        }
        Ok(Kind::Level {
            fallen: low + FALLEN * (high - low),
            risen: low + RISEN * (high - low),
            empty_is_low: false,
        })
    }

    /// Refuses pulses that are not whole turns of the encoder apart, by half or more.
    fn check_turns(&self, mut pulses: Pulses) -> Result<(), String> {
        let Some((turn, modulus)) = self.encoder else {
            return Ok(());
        };
        let mut last: Option<f64> = None;
        // Motion since the last pulse, its length, and the longest of a row [counts].
        let (mut moved, mut path, mut fastest) = (0.0, 0.0, 0.0_f64);
        let mut wrong = Vec::new();
        let mut pairs = 0;
        for (i, (&value, &absent)) in self.values.iter().zip(&self.absent).enumerate() {
            let step = self.step(i);
            if step.is_nan() {
                last = None;
            }
            (moved, path, fastest) = (moved + step, path + step.abs(), fastest.max(step.abs()));
            let Some(pulse) = pulses.next(value, absent) else {
                continue;
            };
            // Where the pulse was, by the present count.
            let behind = match pulse {
                Pulse::Count(count) => wrapped(count - self.counts[i], modulus),
                Pulse::Here => 0.0,
            };
            if let Some(last) = last {
                let turns = (moved + behind - last) / turn;
                let off = (turns - turns.round()).abs();
                let allowed = TURN + 2.0 * fastest / turn.abs();
                let reversed = path > 1.5 * moved.abs() + 4.0;
                pairs += 1;
                if off > allowed || (turns.round() == 0.0 && !reversed && path > 4.0) {
                    wrong.push(turns.abs());
                }
            }
            last = (!self.counts[i].is_nan()).then_some(behind);
            (moved, path, fastest) = (0.0, 0.0, 0.0);
        }
        if 2 * wrong.len() <= pairs || pairs < 3 {
            return Ok(());
        }
        wrong.sort_unstable_by(f64::total_cmp);
        Err(format!(
            "{} of {pairs} pulses are not whole turns ({} counts of the encoder) after the one \
             before, but {:.3} turns in the median; counts_per_turn or speed_ratio is wrong, or the pulses \
             are noise",
            wrong.len(),
            turn.abs(),
            wrong[wrong.len() / 2]
        ))
    }
}

/// Counts of an encoder in the turn of the carrier from pulse to pulse.
fn counts_between(machine: &Machine, encoder: &Encoder) -> f64 {
    let inertias = machine.drivetrain.iter().flat_map(|d| &d.inertias);
    let turns_with = inertias.into_iter().find(|i| i.name == encoder.inertia);
    encoder.counts_per_turn * turns_with.map_or(1.0, |i| i.speed_ratio)
}

/// A difference of counts that begin anew after `modulus`.
fn wrapped(difference: f64, modulus: f64) -> f64 {
    if modulus.is_finite() {
        difference - (difference / modulus).round() * modulus
    } else {
        difference
    }
}
