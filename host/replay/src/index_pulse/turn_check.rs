//! Checks that the index pulses of a recording are whole turns of the encoder apart, and refuses a
//! column where most are not.

use super::index_column::IndexColumn;
use super::{Pulse, Pulses};

/// Deviation from whole turns between two pulses, beside the motion of two rows [turns].
const TURN: f64 = 0.02;

impl IndexColumn {
    /// Refuses pulses more than half of which are not whole turns of the encoder apart.
    pub(super) fn check_turns(&self, mut pulses: Pulses) -> Result<(), String> {
        let Some(turn) = self.encoder.map(|encoder| encoder.turn) else {
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
                Pulse::Count(count) => self.wrapped(count - self.counts[i]),
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
