//! Joins channels of another MDF4 channel group at the time stamps of the recording (`Side::at`):
//! nearest sample at the same rate, linear interpolation of a slower group, mean over one period of
//! a faster group; NaN where there is no sample.
use std::collections::VecDeque;

use super::channel_track::Stream;
use crate::error::{Problem, Row};

/// How the samples of another group become samples of the recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Join {
    /// Same rate: the sample nearest in time, within half a period.
    Nearest,
    /// Slower: on the line between the two samples around, held at the ends for
    /// one of its own periods.
    Interpolated,
    /// Faster: the mean over one period of the recording.
    Averaged,
}

impl Join {
    /// By the periods of the other group and of the recording (s).
    pub(super) fn of(step_s: f64, period_s: f64, same: bool) -> Self {
        if same {
            Self::Nearest
        } else if step_s > period_s {
            Self::Interpolated
        } else {
            Self::Averaged
        }
    }
}

/// Another group, read along with the recording.
pub(super) struct Side<'a> {
    stream: Stream<'a>,
    join: Join,
    /// Period of the group and of the recording (s).
    step_s: f64,
    period_s: f64,
    /// Samples around the current stamps: time and values.
    samples: VecDeque<(f64, Vec<f64>)>,
    /// Whether the front of `samples` was handed out.
    used: bool,
    last_t: f64,
    ended: bool,
    width: usize,
}

impl<'a> Side<'a> {
    pub(super) fn new(
        stream: Stream<'a>,
        width: usize,
        join: Join,
        step_s: f64,
        period_s: f64,
    ) -> Self {
        Self {
            stream,
            join,
            step_s,
            period_s,
            samples: VecDeque::new(),
            used: false,
            last_t: f64::NEG_INFINITY,
            ended: false,
            width,
        }
    }

    /// Its columns at the stamps `t` (s); NaN where it has no sample.
    pub(super) fn at(&mut self, t: &[f64]) -> Result<Vec<Vec<f64>>, Problem> {
        let mut columns = vec![Vec::with_capacity(t.len()); self.width];
        for &t in t {
            self.read_beyond(t + self.period_s)?;
            match self.join {
                Join::Nearest => self.nearest(t, &mut columns),
                Join::Interpolated => self.interpolated(t, &mut columns),
                Join::Averaged => self.averaged(t, &mut columns),
            }
        }
        Ok(columns)
    }

    /// Reads until a sample lies beyond `t`, or to the end.
    fn read_beyond(&mut self, t: f64) -> Result<(), Problem> {
        while !self.ended && self.last_t <= t {
            let Some(window) = self.stream.next()? else {
                self.ended = true;
                return Ok(());
            };
            for (i, &found) in window.t.iter().enumerate() {
                if found <= self.last_t {
                    return Err(Problem::Backwards {
                        row: Row {
                            row: i as u64 + 1,
                            line: None,
                        },
                        before: self.last_t,
                        found,
                        continues: false,
                    });
                }
                self.last_t = found;
                let values = window.columns.iter().map(|column| column[i]).collect();
                self.samples.push_back((found, values));
            }
        }
        Ok(())
    }

    fn nearest(&mut self, t: f64, columns: &mut [Vec<f64>]) {
        while let [Some(first), Some(second)] = [self.samples.front(), self.samples.get(1)] {
            if (second.0 - t).abs() > (first.0 - t).abs() {
                break;
            }
            self.samples.pop_front();
            self.used = false;
        }
        let near = self.samples.front().filter(|(at, _)| {
            let distance = (at - t).abs();
            distance < 0.5 * self.period_s && !self.used
        });
        push(columns, near.map(|(_, values)| values.as_slice()));
        self.used |= near.is_some();
    }

    fn interpolated(&mut self, t: f64, columns: &mut [Vec<f64>]) {
        while self.samples.get(1).is_some_and(|(at, _)| *at <= t) {
            self.samples.pop_front();
        }
        let [before, after] = [self.samples.front(), self.samples.get(1)];
        match (before, after) {
            (Some((from, a)), Some((to, b))) if *from <= t => {
                let part = (t - from) / (to - from);
                for (k, column) in columns.iter_mut().enumerate() {
                    column.push(a[k] + part * (b[k] - a[k]));
                }
            }
            (Some((at, values)), _) if (at - t).abs() <= self.step_s => {
                push(columns, Some(values));
            }
            _ => push(columns, None),
        }
    }

    fn averaged(&mut self, t: f64, columns: &mut [Vec<f64>]) {
        let (from, to) = (t - 0.5 * self.period_s, t + 0.5 * self.period_s);
        while self.samples.front().is_some_and(|(at, _)| *at < from) {
            self.samples.pop_front();
        }
        let within = || self.samples.iter().take_while(|(at, _)| *at < to);
        for (k, column) in columns.iter_mut().enumerate() {
            let (mut sum, mut count) = (0.0, 0.0);
            for (_, values) in within().filter(|(_, values)| !values[k].is_nan()) {
                sum += values[k];
                count += 1.0;
            }
            column.push(if count > 0.0 { sum / count } else { f64::NAN });
        }
    }
}

fn push(columns: &mut [Vec<f64>], values: Option<&[f64]>) {
    for (k, column) in columns.iter_mut().enumerate() {
        column.push(values.map_or(f64::NAN, |values| values[k]));
    }
}
