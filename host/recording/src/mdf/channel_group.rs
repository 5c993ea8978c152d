//! Reads the channel groups of an MDF4 file that have a time (`Group`): time stamps, median period
//! (s), declared number of samples. `chain` chooses among groups with the same channels those of
//! one rate that follow each other in time: they are one recording.
use falcon_mdf::{Channel, ChannelGroup, Mf4Error, Mf4File};

use super::damaged;
use crate::BLOCK_ROWS;
use crate::error::{Problem, clipped};
use crate::unit::{Conversion, Unit};

/// Periods whose ratio is this close to 1 are the same.
const SAME_PERIOD: f64 = 0.02;

/// A channel group with a time channel.
pub(super) struct Group<'a> {
    pub(super) block: &'a ChannelGroup,
    pub(super) time: &'a Channel,
    /// Number in the file, from 1.
    pub(super) number: usize,
    /// Samples that its block declares.
    pub(super) declared: u64,
}

/// When the samples of a group were taken (s).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stamps {
    /// The first ones.
    pub(super) head: Vec<f64>,
    /// The median step among them; none with one sample.
    pub(super) step: Option<f64>,
    pub(super) last: f64,
}

impl<'a> Group<'a> {
    /// All groups of `file` that have a time.
    pub(super) fn all(file: &'a Mf4File) -> Result<Vec<Self>, Problem> {
        let groups = file.data_groups().iter().flat_map(|d| &d.channel_groups);
        let mut all = Vec::new();
        for (i, group) in groups.enumerate() {
            let time = group.master_channel().filter(|c| c.is_time_channel());
            if let Some(time) = time {
                all.push(Self {
                    block: group,
                    time,
                    number: i + 1,
                    declared: declared_samples(file, group).map_err(damaged)?,
                });
            }
        }
        Ok(all)
    }

    pub(super) fn channel(&self, name: &str) -> Option<&'a Channel> {
        self.block.channels.iter().find(|c| c.name == name)
    }

    /// Whether a layout calls it so: by its acquisition name or its number.
    pub(super) fn is_called(&self, name: &str) -> bool {
        self.block.acquisition_name.trim() == name || self.number.to_string() == name
    }

    /// Its stamps; none where it has no samples. With `whole` all of its time is read, else the
    /// last stamp is that of the first window.
    pub(super) fn stamps(&self, file: &Mf4File, whole: bool) -> Result<Option<Stamps>, Problem> {
        let to_seconds = seconds(self.time)?;
        let mut stamps: Option<Stamps> = None;
        let windows = file.signals_chunks(&[self.time], BLOCK_ROWS);
        for signals in windows.map_err(damaged)? {
            let signals = signals.map_err(damaged)?;
            let Some(signal) = signals.first() else {
                break;
            };
            let mut t = signal.values_f64().map_err(damaged)?;
            to_seconds.apply_to(&mut t);
            let Some(&last) = t.last() else {
                break;
            };
            if let Some(stamps) = &mut stamps {
                stamps.last = last;
            } else {
                let steps = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
                stamps = Some(Stamps {
                    step: median(steps).filter(|step| *step > 0.0),
                    head: t,
                    last,
                });
            }
            if !whole {
                break;
            }
        }
        Ok(stamps)
    }
}

/// How the time of a group becomes seconds; the format's unit of time is the second.
pub(super) fn seconds(time: &Channel) -> Result<Conversion, Problem> {
    let unit = time.unit.trim();
    if unit.is_empty() {
        return Ok(Conversion::Same);
    }
    let parsed = unit.parse::<Unit>().ok();
    parsed
        .and_then(|unit| unit.conversion_to(Unit::SECOND))
        .ok_or_else(|| Problem::WrongUnit {
            column: clipped(time.name.as_bytes(), 40),
            found: clipped(unit.as_bytes(), 40),
            allowed: "a unit of time".into(),
        })
}

impl Stamps {
    pub(super) fn first(&self) -> f64 {
        self.head.first().copied().unwrap_or(f64::NAN)
    }

    /// Whether its samples are `period_s` apart.
    pub(super) fn has_period(&self, period_s: f64) -> bool {
        self.step
            .is_some_and(|step| (step / period_s - 1.0).abs() <= SAME_PERIOD)
    }
}

/// Candidates that have the same channels: indices and stamps.
pub(super) type Candidates = Vec<(usize, Stamps)>;

/// The groups among `candidates` that make one recording: those of the wanted
/// rate, else of the only rate, else of the most samples, in the order of time.
/// The others are handed back too.
///
/// # Errors
/// The indices of two that were recorded over the same time.
pub(super) fn chain(
    candidates: Candidates,
    period_s: Option<f64>,
    samples: impl Fn(usize) -> u64,
) -> Result<(Candidates, Candidates), Vec<usize>> {
    let has = |period: f64| {
        candidates
            .iter()
            .any(|(_, stamps)| stamps.has_period(period))
    };
    let with_rate = candidates
        .iter()
        .filter(|(_, stamps)| stamps.step.is_some());
    let most = with_rate.max_by_key(|(group, _)| samples(*group));
    let period = period_s
        .filter(|period| has(*period))
        .or_else(|| most.and_then(|(_, stamps)| stamps.step));
    let (mut chain, mut others): (Candidates, Candidates) = candidates
        .into_iter()
        .partition(|(_, stamps)| period.is_none_or(|period| stamps.has_period(period)));
    chain.sort_by(|a, b| a.1.first().total_cmp(&b.1.first()));
    // A group of one sample has no rate; it belongs to those that it lies between.
    for (group, stamps) in std::mem::take(&mut others) {
        let apart = |other: &Stamps| stamps.last < other.first() || stamps.first() > other.last;
        if stamps.step.is_none() && !chain.is_empty() && chain.iter().all(|c| apart(&c.1)) {
            chain.push((group, stamps));
        } else {
            others.push((group, stamps));
        }
    }
    chain.sort_by(|a, b| a.1.first().total_cmp(&b.1.first()));
    for pair in chain.windows(2) {
        if pair[1].1.first() <= pair[0].1.last {
            return Err(vec![pair[0].0, pair[1].0]);
        }
    }
    Ok((chain, others))
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

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamps(first: f64, step: f64, last: f64) -> Stamps {
        Stamps {
            head: vec![first],
            step: (step > 0.0).then_some(step),
            last,
        }
    }

    fn order(candidates: Candidates, period: Option<f64>) -> Result<Vec<usize>, Vec<usize>> {
        chain(candidates, period, |group| 100 - group as u64)
            .map(|(chain, _)| chain.into_iter().map(|(group, _)| group).collect())
    }

    #[test]
    fn groups_that_follow_each_other_are_one() {
        let parts = vec![(0, stamps(3.0, 0.1, 5.9)), (1, stamps(0.0, 0.1, 2.9))];
        assert_eq!(order(parts, None), Ok(vec![1, 0]));
        let page = vec![(0, stamps(0.0, 0.0, 0.0)), (1, stamps(0.0, 0.1, 2.9))];
        assert_eq!(order(page, None), Ok(vec![1]));
        let tail = vec![(0, stamps(0.0, 0.1, 2.9)), (1, stamps(3.5, 0.0, 3.5))];
        assert_eq!(order(tail, None), Ok(vec![0, 1]));
        let over = vec![(0, stamps(0.0, 0.1, 2.9)), (1, stamps(2.0, 0.1, 3.5))];
        assert_eq!(order(over, None), Err(vec![0, 1]));
    }

    #[test]
    fn the_described_rate_is_chosen() {
        let rates = || vec![(0, stamps(0.0, 0.1, 2.9)), (1, stamps(0.0, 0.01, 2.99))];
        assert_eq!(order(rates(), Some(0.01)), Ok(vec![1]));
        assert_eq!(order(rates(), Some(0.1)), Ok(vec![0]));
        assert_eq!(order(rates(), None), Ok(vec![0]));
    }
}
