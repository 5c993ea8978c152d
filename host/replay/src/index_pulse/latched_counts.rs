//! Tests whether the index column of a recording holds latched encoder counts: which of its values
//! are counts, and whether the encoder passed most of them within the last second.

use serde::{Deserialize, Serialize};

use super::index_column::IndexColumn;
use super::{Kind, Pulse, Pulses};

/// Time by which a latched count may reach the recording late [s].
const LATE_S: f64 = 1.0;

/// Part by which distances of values may differ from the motion of the encoder.
const ALIKE: f64 = 0.02;

/// Which values of a column are latched counts.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Latched {
    /// Counts stand in single rows and the cells between them are empty. Else a register is
    /// written in each row.
    sparse: bool,
    /// What a register holds where there is no pulse, beside 0.
    idle: Option<f64>,
}

impl Latched {
    /// Whether the value is no count.
    pub(super) fn is_none(&self, value: f64) -> bool {
        value.is_nan() || self.idle == Some(value) || (value == 0.0 && !self.sparse)
    }

    /// Whether the same count behind this value is a new pulse: not behind a lost cell of a register.
    pub(super) fn ends_count(&self, value: f64) -> bool {
        self.sparse || !value.is_nan()
    }
}

/// A new value of the column.
struct Change {
    row: usize,
    value: f64,
}

impl IndexColumn {
    pub(super) fn latched(&self) -> Latched {
        let rows = self.values.iter().zip(&self.absent);
        let empty = rows.filter(|(v, absent)| v.is_nan() && !**absent).count();
        let sparse = 2 * empty > self.values.len();
        Latched {
            sparse,
            idle: if sparse { None } else { self.idle() },
        }
    }

    /// The value that stands in most rows and comes back again and again.
    fn idle(&self) -> Option<f64> {
        let known = || self.values.iter().copied().filter(|v| !v.is_nan());
        // Boyer and Moore 1991: the only value that can stand in more than half of the rows.
        let (most, _) = known().fold((f64::NAN, 0_usize), |(most, lead), value| match lead {
            0 => (value, 1),
            _ if value == most => (most, lead + 1),
            _ => (most, lead - 1),
        });
        let count = known().filter(|v| *v == most).count();
        let ends = known().zip(known().skip(1));
        let returns = ends.filter(|(a, b)| *a != most && *b == most).count();
        (2 * count > known().count() && returns > 1).then_some(most)
    }

    /// Whether most new values are counts that the encoder passed lately; an error where some
    /// are, or where they are counts beside those of the encoder. A new value while the encoder
    /// stands shows nothing of the format: no pulse can come then, the encoder has failed.
    pub(super) fn latches(&self, latched: Latched) -> Result<bool, String> {
        let changes = self.changes(latched);
        let Some(encoder) = self.encoder else {
            return Ok(false);
        };
        let positions = self.positions();
        let moves = |c: &&Change| {
            let (least, most) = self.range_before(c.row, &positions);
            self.step(c.row).is_finite() && least < most
        };
        let new = changes.iter().filter(moves).count();
        if new == 0 {
            let turns =
                |pair: &[Change]| self.wrapped(pair[1].value - pair[0].value) / encoder.turn;
            let is_whole =
                |turns: f64| turns.round() != 0.0 && (turns - turns.round()).abs() < ALIKE;
            let stands = changes.iter().any(|c| self.step(c.row).is_finite());
            let other = |c: &Change| c.value != changes[0].value;
            return Ok(changes.iter().any(other)
                && (!stands || changes.windows(2).all(|pair| is_whole(turns(pair)))));
        }
        let passed = changes.iter().filter(moves);
        let passed = passed.filter(|c| self.has_passed(c, &positions)).count();
        // A level agrees with the encoder at single rows by chance, counts throughout.
        if 2 * passed <= new && passed >= 3 {
            return Err(format!(
                "{passed} of {new} values are counts that the encoder just passed, the others are not"
            ));
        }
        if 2 * passed > new {
            return Ok(true);
        }
        match self.offset(&changes, &positions) {
            Some(offset) => Err(format!(
                "its values advance as the counts of the encoder do, but are {:.0} counts {} them: \
                 another zero, or another counter",
                offset.abs(),
                if offset > 0.0 { "ahead of" } else { "behind" }
            )),
            None => Ok(false),
        }
    }

    fn changes(&self, latched: Latched) -> Vec<Change> {
        let mut pulses = Pulses::new(Kind::Latched(latched));
        let rows = self.values.iter().zip(&self.absent).enumerate();
        let mut changes = Vec::new();
        for (row, (&value, &absent)) in rows {
            if let Some(Pulse::Count(value)) = pulses.next(value, absent) {
                changes.push(Change { row, value });
            }
        }
        changes
    }

    /// Motion of the encoder since the first row [counts]; unknown steps are none.
    fn positions(&self) -> Vec<f64> {
        let mut position = 0.0;
        let step = |i| {
            let step = self.step(i);
            position += if step.is_finite() { step } else { 0.0 };
            position
        };
        (0..self.counts.len()).map(step).collect()
    }

    /// Lowest and highest position of the encoder within [`LATE_S`] before row `row` [counts].
    fn range_before(&self, row: usize, positions: &[f64]) -> (f64, f64) {
        let from = row.saturating_sub((LATE_S * self.rate_hz) as usize);
        let lately = positions[from..=row].iter().copied();
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        lately.fold(start, |(least, most), p| (least.min(p), most.max(p)))
    }

    /// Whether the encoder passed the value in this row or within [`LATE_S`] before it.
    fn has_passed(&self, change: &Change, positions: &[f64]) -> bool {
        let Change { row, value } = *change;
        let behind = self.wrapped(self.counts[row] - value);
        let allowed = 2.0 * self.step(row).abs() + 2.0;
        let at = positions[row] - behind;
        let (least, most) = self.range_before(row, positions);
        (least - allowed..=most + allowed).contains(&at)
    }

    /// By how much the values are off the counts, where they move as these do.
    fn offset(&self, changes: &[Change], positions: &[f64]) -> Option<f64> {
        let follows = |pair: &&[Change]| {
            let moved = positions[pair[1].row] - positions[pair[0].row];
            let apart = self.wrapped(pair[1].value - pair[0].value - moved).abs();
            moved.abs() > 8.0 && apart <= ALIKE * moved.abs() + 2.0
        };
        let pairs = changes.len().saturating_sub(1);
        let following = changes.windows(2).filter(follows).count();
        let last = changes.last()?;
        let offset = self.wrapped(last.value - self.counts[last.row]);
        (2 * following > pairs).then_some(offset)
    }
}
