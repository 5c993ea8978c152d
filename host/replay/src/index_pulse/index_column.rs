//! Reads the index column of a recording with the encoder counts beside it, as many rows as are
//! needed to detect the format of the pulse.

use loadtwin_machine::{Encoder, Index, Machine};
use loadtwin_recording::{Input, Quantity, Reader, Role, Unit, Wanted, columns as columns_of};

use crate::ReplayError;

/// Rows that show what the column holds, once one of them has a pulse.
pub(super) const ROWS: usize = 1 << 20;

/// The column and the encoder beside it.
pub(super) struct IndexColumn {
    pub(super) values: Vec<f64>,
    pub(super) absent: Vec<bool>,
    /// Counts; NaN where unknown.
    pub(super) counts: Vec<f64>,
    pub(super) encoder: Option<IndexEncoder>,
    /// Rows a second.
    pub(super) rate_hz: f64,
}

/// The encoder whose counts the pulse latches.
#[derive(Clone, Copy)]
pub(super) struct IndexEncoder {
    /// Counts from pulse to pulse.
    pub(super) turn: f64,
    /// Counts after which the counter begins anew.
    pub(super) modulus: f64,
}

impl IndexColumn {
    pub(super) fn read(
        machine: &Machine,
        index: &Index,
        input: Input<'_>,
    ) -> Result<Self, ReplayError> {
        let encoder = machine.homed_encoder();
        let mut columns = vec![Wanted {
            name: &index.name,
            unit: Unit::ONE,
            required: true,
        }];
        let names = [(index.name.as_str(), true), (index.encoder.as_str(), false)];
        let found = columns_of(input, &machine.recording, &names)?;
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
        let reader = Reader::open_as(input, &machine.recording, &columns, &roles)?
            .expect_period(1.0 / machine.rate_hz)?;
        let mut rows = Self {
            values: Vec::new(),
            absent: Vec::new(),
            counts: Vec::new(),
            encoder: encoder.map(|e| IndexEncoder {
                turn: counts_between(machine, e),
                modulus: f64::from(e.bits).exp2(),
            }),
            rate_hz: machine.rate_hz,
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

    /// Difference of two counts of the counter.
    pub(super) fn wrapped(&self, difference: f64) -> f64 {
        self.encoder.map_or(difference, |e| {
            difference - (difference / e.modulus).round() * e.modulus
        })
    }

    /// Motion of the encoder up to row `i` from the row before [counts].
    pub(super) fn step(&self, i: usize) -> f64 {
        self.wrapped(self.counts[i] - self.counts[i.saturating_sub(1)])
    }
}

/// Counts of an encoder in the turn of the carrier from pulse to pulse.
fn counts_between(machine: &Machine, encoder: &Encoder) -> f64 {
    let inertias = machine.drivetrain.iter().flat_map(|d| &d.inertias);
    let turns_with = inertias.into_iter().find(|i| i.name == encoder.inertia);
    encoder.counts_per_turn * turns_with.map_or(1.0, |i| i.speed_ratio)
}
