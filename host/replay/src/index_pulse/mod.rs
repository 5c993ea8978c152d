//! Finds the index pulses in a recording: detects whether the column holds latched counts or a
//! level, then gives the pulses row by row, each with its count where one is latched.

mod index_column;
mod latched_counts;
mod level;
mod turn_check;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use self::index_column::IndexColumn;
use self::latched_counts::Latched;
use self::level::Level;
use super::ReplayError;
use loadtwin_machine::{Index, IndexSignal, Machine};
use loadtwin_recording::Input;

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
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Pulses {
    kind: Kind,
    /// The last value known; of a level whether the pulse is on.
    last: Option<f64>,
    started: bool,
    /// The last value that was written, whatever it is.
    written: Option<f64>,
    /// Whether there was a pulse.
    seen: bool,
    /// How the column is read, where that is not plain.
    note: Option<String>,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
enum Kind {
    /// Each new value is a latched count.
    Latched(Latched),
    /// The pulse begins at an edge.
    Level(Level),
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
            written: None,
            seen: false,
            note: None,
        }
    }

    /// How the column is read, where that is not plain.
    pub(super) fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    /// The pulse of the next row; `value`: NaN where the cell is empty; `absent`:
    /// the row is not in the file.
    pub(super) fn next(&mut self, value: f64, absent: bool) -> Option<Pulse> {
        let pulse = self.pulse(value, absent);
        self.seen |= pulse.is_some();
        if !value.is_nan() {
            self.written = Some(value);
        }
        pulse
    }

    fn pulse(&mut self, value: f64, absent: bool) -> Option<Pulse> {
        let started = std::mem::replace(&mut self.started, true);
        match self.kind {
            Kind::Never => None,
            Kind::Latched(latched) => {
                if latched.is_none(value) {
                    // What a register holds on after a lost row is no new count.
                    if latched.ends_count(value) && !absent {
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
            Kind::Level(level) => {
                let Some(on) = level.is_on(value, absent) else {
                    // An edge in a gap has no row.
                    if absent {
                        self.last = None;
                    }
                    return None;
                };
                let on = f64::from(u8::from(on));
                let begins = self.last == Some(0.0) && on > 0.0;
                self.last = Some(on);
                begins.then_some(Pulse::Here)
            }
        }
    }

    /// Whether there was no pulse yet, so that what the column holds may not have shown.
    pub(super) fn is_open(&self) -> bool {
        !self.seen
    }

    /// Goes on where `before` was, which never saw a pulse.
    pub(super) fn after(mut self, before: &Self) -> Self {
        self.started = before.started;
        self.written = before.written;
        self.last = before.written.and_then(|value| match self.kind {
            Kind::Never => None,
            Kind::Latched(latched) => (!latched.is_none(value)).then_some(value),
            Kind::Level(level) => (level.is_on(value, false)).map(|on| f64::from(u8::from(on))),
        });
        self
    }

    /// What the index column of a recording holds.
    ///
    /// # Errors
    /// When it cannot be read, or is neither counts nor a level.
    pub(super) fn of(
        machine: &Machine,
        index: &Index,
        input: Input<'_>,
    ) -> Result<Self, ReplayError> {
        let head = input.head(index_column::ROWS)?;
        let column =
            IndexColumn::read(machine, index, head.as_ref().map_or(input, Input::Batches))?;
        let fail = |found: String| IndexError {
            file: input.name().to_owned(),
            column: index.name.clone(),
            found,
        };
        let latched = column.latched();
        let is_latched = match index.signal {
            Some(signal) => signal == IndexSignal::Latched,
            None => column.latches(latched).map_err(fail)?,
        };
        let mut pulses = if is_latched {
            Self::new(Kind::Latched(latched))
        } else {
            let active_low = index.signal.map(|s| s == IndexSignal::ActiveLow);
            let level = column.level(active_low).map_err(fail)?;
            Self::new(level.map_or(Kind::Never, Kind::Level))
        };
        column.check_turns(pulses.clone()).map_err(fail)?;
        if let (Kind::Level(level), None) = (pulses.kind, index.signal) {
            pulses.note = level.active_low().then(|| {
                format!(
                    "the level in column `{}` is high in most rows: its falling edge is the pulse \
                     (`signal = \"active_low\"` or `\"level\"` under [index] states which edge)",
                    index.name
                )
            });
        }
        Ok(pulses)
    }
}
