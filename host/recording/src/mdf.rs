//! Recordings as ASAM MDF4, what test benches write: the channels of one
//! channel group, the unit of each, its time channel as `t`.
//!
//! Records are read window by window; a compressed block is held whole, which
//! is 4 MB or less from the usual writers. Invalid samples are missing samples.
use std::path::Path;

use falcon_mdf::io::reader::BufferedSource;
use falcon_mdf::{Channel, ChannelGroup, Mf4Error, Mf4File, OpenOptions};

use super::error::{FINITE, FINITE_TIME, NO_NAN, Problem, Row, clipped};
use super::layout::{Column, CsvLayout, Wanted, WrittenNan};
use super::source::{Output, Rows};
use super::{BLOCK_ROWS, TIME, shown};

/// Largest size that a compressed block may claim to have expanded.
const LARGEST_BLOCK: u64 = 256 << 20;

pub(super) struct Mdf {
    file: Mf4File,
    /// Channels of the group, as `columns` lists them.
    channels: Vec<Channel>,
    columns: Vec<Column>,
    /// Samples that the group declares.
    declared: u64,
    nan_is_missing: bool,
}

fn damaged(error: Mf4Error) -> Problem {
    match error {
        Mf4Error::Io(io) if io.kind() != std::io::ErrorKind::UnexpectedEof => Problem::Io(io),
        other => Problem::Damaged {
            format: "MDF4",
            found: clipped(other.to_string().as_bytes(), 160),
        },
    }
}

impl Mdf {
    pub(super) fn open(
        path: &Path,
        layout: &CsvLayout,
        wanted: &[Wanted<'_>],
    ) -> Result<Self, Problem> {
        // Not mapped into memory: a file that another process cuts short would
        // then end this one.
        let source = BufferedSource::open(path).map_err(damaged)?;
        let options = OpenOptions {
            max_decompressed: LARGEST_BLOCK,
            ..OpenOptions::default()
        };
        let file = Mf4File::from_source_with_options(std::sync::Arc::new(source), options)
            .map_err(damaged)?;
        let group = choose_group(&file, wanted)?;
        let declared = declared_samples(&file, group).map_err(damaged)?;
        let channels = group.channels.clone();
        let columns = channels.iter().map(|channel| {
            let is_time = channel.is_master();
            let unit = channel.unit.trim();
            Column {
                name: if is_time { TIME } else { &channel.name }.into(),
                // The format itself fixes the unit of a time channel.
                unit: match unit {
                    "" if is_time => Some("s".into()),
                    "" => None,
                    unit => Some(unit.into()),
                },
            }
        });
        Ok(Self {
            columns: columns.collect(),
            channels,
            declared,
            nan_is_missing: layout.written_nan == WrittenNan::Missing,
            file,
        })
    }

    pub(super) fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Delivers all rows; column `picks[k]` of the file becomes their column `k`.
    pub(super) fn run(self, picks: &[usize], output: &Output) -> Result<(), Problem> {
        let channels: Vec<&Channel> = picks.iter().map(|&i| &self.channels[i]).collect();
        for channel in &channels {
            if !channel.is_numeric() || channel.is_array() {
                return Err(Problem::NotNumeric {
                    column: shown(&channel.name),
                    found: "text, bytes or lists".into(),
                });
            }
        }
        let mut done = 0;
        let windows = self
            .file
            .signals_chunks(&channels, BLOCK_ROWS)
            .map_err(damaged)?;
        for signals in windows {
            let mut rows = Rows::with_columns(0);
            for (k, signal) in signals.map_err(damaged)?.iter().enumerate() {
                let mut values = signal.values_f64().map_err(damaged)?;
                let valid = signal.validity();
                self.check(&mut values, valid.as_deref(), k == Rows::TIME)
                    .map_err(|(i, found, allowed)| Problem::Cell {
                        row: Row {
                            row: done + i as u64 + 1,
                            line: None,
                        },
                        column: shown(&self.columns[picks[k]].name),
                        found,
                        allowed,
                    })?;
                rows.columns.push(values);
            }
            let length = rows.t().len();
            if rows.columns.iter().any(|c| c.len() != length) {
                return Err(cut_off(done, self.declared));
            }
            done += length as u64;
            if !output.deliver(rows, done as f64 / self.declared.max(1) as f64) {
                return Ok(());
            }
        }
        if done < self.declared {
            return Err(cut_off(done, self.declared));
        }
        Ok(())
    }

    /// Makes invalid samples NaN and finds a value that is no usable number:
    /// its index, the value and what it may be.
    fn check(
        &self,
        values: &mut [f64],
        valid: Option<&[bool]>,
        is_time: bool,
    ) -> Result<(), (usize, String, &'static str)> {
        for (i, v) in values.iter_mut().enumerate() {
            let invalid = valid.is_some_and(|valid| valid.get(i) == Some(&false));
            if invalid && !is_time {
                *v = f64::NAN;
            } else if is_time && (invalid || !v.is_finite()) {
                let found = if invalid {
                    "invalid".into()
                } else {
                    v.to_string()
                };
                return Err((i, found, FINITE_TIME));
            } else if v.is_infinite() {
                return Err((i, v.to_string(), FINITE));
            } else if v.is_nan() && !self.nan_is_missing {
                return Err((i, v.to_string(), NO_NAN));
            }
        }
        Ok(())
    }
}

fn cut_off(found: u64, declared: u64) -> Problem {
    Problem::Damaged {
        format: "MDF4",
        found: format!("it ends after {found} of {declared} samples"),
    }
}

/// The group with a time channel and most of the wanted channels.
fn choose_group<'a>(file: &'a Mf4File, wanted: &[Wanted<'_>]) -> Result<&'a ChannelGroup, Problem> {
    let groups = || {
        file.data_groups()
            .iter()
            .flat_map(|data| &data.channel_groups)
            .filter(|group| group.master_channel().is_some_and(Channel::is_time_channel))
    };
    let has = |group: &ChannelGroup, name: &str| group.channels.iter().any(|c| c.name == name);
    let count = |group: &ChannelGroup| wanted.iter().filter(|w| has(group, w.name)).count();
    // Of equally good groups the first.
    let best = groups()
        .rev()
        .max_by_key(|group| count(group))
        .ok_or(Problem::Missing {
            name: TIME.into(),
            found: "no channel group with a time channel".into(),
            nearest: None,
        })?;
    for w in wanted.iter().filter(|w| w.required) {
        if !has(best, w.name) && groups().any(|group| has(group, w.name)) {
            let other = wanted.iter().find(|w| has(best, w.name));
            return Err(Problem::OtherGroup {
                column: shown(w.name),
                other: shown(other.map_or(TIME, |w| w.name)),
            });
        }
    }
    Ok(best)
}

/// Samples that the channel group block itself declares.
///
/// The decoder replaces the figure by what is there, so that a file cut off in
/// its data would pass for a short one. ASAM MDF 4.1, CGBLOCK: header of 24
/// bytes with the number of links at 16, the links, record id, cycle count.
fn declared_samples(file: &Mf4File, group: &ChannelGroup) -> Result<u64, Mf4Error> {
    let number = |at: u64| -> Result<u64, Mf4Error> {
        let bytes = file.read_raw(at, 8)?;
        Ok(bytes.try_into().map_or(0, u64::from_le_bytes))
    };
    let links = number(group.block_offset() + 16)?;
    let counts = links
        .saturating_mul(8)
        .saturating_add(group.block_offset() + 24 + 8);
    number(counts)
}
