//! Reads channels that share one time from consecutive channel groups of an MDF4 file, as one
//! track: `Track` lists the groups and channels, `Stream` returns windows of samples with the time
//! in s. Invalid samples become NaN; a file that ends early is an error.
use falcon_mdf::stream::SignalsChunks;
use falcon_mdf::{Channel, Mf4File};

use super::channel_group::seconds;
use super::channel_values::Decoded;
use super::damaged;
use crate::error::{FINITE, FINITE_TIME, NO_NAN, Problem, Row};
use crate::unit::Conversion;
use crate::{BLOCK_ROWS, TIME, shown};

/// One group of a track.
pub(super) struct Part {
    pub(super) time: Channel,
    /// Each channel of the track; none where this group lacks it.
    pub(super) channels: Vec<Option<Decoded>>,
    pub(super) declared: u64,
}

/// Channels that share one time.
pub(super) struct Track {
    /// Names of the channels.
    pub(super) names: Vec<String>,
    /// Its groups in the order of time.
    pub(super) parts: Vec<Part>,
}

impl Track {
    pub(super) fn declared(&self) -> u64 {
        let each = self.parts.iter().map(|part| part.declared);
        each.fold(0, u64::saturating_add)
    }
}

/// Consecutive samples of a track.
pub(super) struct Window {
    /// Time (s).
    pub(super) t: Vec<f64>,
    pub(super) columns: Vec<Vec<f64>>,
}

/// Reads a track window by window.
pub(super) struct Stream<'a> {
    file: &'a Mf4File,
    track: &'a Track,
    /// Channels that are read, among those of the track.
    picks: Vec<usize>,
    nan_is_missing: bool,
    part: usize,
    windows: Option<Windows<'a>>,
    /// Samples read of this part, and of all.
    done_here: u64,
    done: u64,
}

/// The windows of a part.
struct Windows<'a> {
    signals: SignalsChunks<'a>,
    /// Where the pick `k` is among the signals.
    places: Vec<Option<usize>>,
    to_seconds: Conversion,
}

impl<'a> Stream<'a> {
    pub(super) fn new(
        file: &'a Mf4File,
        track: &'a Track,
        picks: Vec<usize>,
        nan_is_missing: bool,
    ) -> Self {
        Self {
            file,
            track,
            picks,
            nan_is_missing,
            part: 0,
            windows: None,
            done_here: 0,
            done: 0,
        }
    }

    /// Part of the track that was read so far, 0 to 1.
    pub(super) fn progress(&self) -> f64 {
        self.done as f64 / self.track.declared().max(1) as f64
    }

    /// The next samples; none at the end.
    pub(super) fn next(&mut self) -> Result<Option<Window>, Problem> {
        while let Some(part) = self.track.parts.get(self.part) {
            if self.windows.is_none() {
                self.windows = Some(self.open(part)?);
                self.done_here = 0;
            }
            let next = self.windows.as_mut().and_then(|w| w.signals.next());
            let Some(signals) = next else {
                if self.done_here < part.declared {
                    return Err(cut_off(self.done_here, part.declared));
                }
                self.windows = None;
                self.part += 1;
                continue;
            };
            let window = self.window(part, &signals.map_err(damaged)?)?;
            self.done_here += window.t.len() as u64;
            self.done += window.t.len() as u64;
            if !window.t.is_empty() {
                return Ok(Some(window));
            }
        }
        Ok(None)
    }

    fn open(&self, part: &'a Part) -> Result<Windows<'a>, Problem> {
        let mut channels = vec![&part.time];
        let mut places = Vec::new();
        for &pick in &self.picks {
            let Some(decoded) = &part.channels[pick] else {
                places.push(None);
                continue;
            };
            if !decoded.is_number() {
                return Err(Problem::NotNumeric {
                    column: shown(&decoded.channel.name),
                    found: "text, bytes or lists".into(),
                });
            }
            places.push(Some(channels.len()));
            channels.push(&decoded.channel);
        }
        Ok(Windows {
            signals: (self.file.signals_chunks(&channels, BLOCK_ROWS)).map_err(damaged)?,
            places,
            to_seconds: seconds(&part.time)?,
        })
    }

    fn window(&self, part: &Part, signals: &[falcon_mdf::Signal]) -> Result<Window, Problem> {
        let Some(windows) = &self.windows else {
            return Err(cut_off(self.done_here, part.declared));
        };
        let lost = || cut_off(self.done_here, part.declared);
        let time = Decoded::of(&part.time).values(signals.first().ok_or_else(lost)?);
        let mut time = time.map_err(damaged)?;
        for (i, (t, missing)) in time.numbers.iter().zip(&time.missing).enumerate() {
            if *missing || !t.is_finite() {
                let found = if *missing {
                    "invalid".into()
                } else {
                    t.to_string()
                };
                return Err(self.cell(i, TIME, found, FINITE_TIME));
            }
        }
        windows.to_seconds.apply_to(&mut time.numbers);
        let length = time.numbers.len();
        let mut columns = Vec::with_capacity(self.picks.len());
        for (&pick, place) in self.picks.iter().zip(&windows.places) {
            let (Some(place), Some(decoded)) = (place, &part.channels[pick]) else {
                columns.push(vec![f64::NAN; length]);
                continue;
            };
            let signal = signals.get(*place).ok_or_else(lost)?;
            let values = decoded.values(signal).map_err(damaged)?;
            if values.numbers.len() != length {
                return Err(lost());
            }
            let mut numbers = values.numbers;
            for (i, (v, missing)) in numbers.iter_mut().zip(values.missing).enumerate() {
                if missing {
                    *v = f64::NAN;
                } else if v.is_infinite() {
                    return Err(self.cell(i, &self.track.names[pick], v.to_string(), FINITE));
                } else if v.is_nan() && !self.nan_is_missing {
                    return Err(self.cell(i, &self.track.names[pick], v.to_string(), NO_NAN));
                }
            }
            columns.push(numbers);
        }
        Ok(Window {
            t: time.numbers,
            columns,
        })
    }

    fn cell(&self, i: usize, column: &str, found: String, allowed: &'static str) -> Problem {
        Problem::Cell {
            row: Row {
                row: self.done + i as u64 + 1,
                line: None,
            },
            column: shown(column),
            found,
            allowed,
        }
    }
}

fn cut_off(found: u64, declared: u64) -> Problem {
    Problem::Damaged {
        format: "MDF4",
        found: format!("it ends after {found} of {declared} samples"),
    }
}
