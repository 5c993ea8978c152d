//! Decides from which channel groups of an MDF4 file each wanted channel is read (`Planner`, result
//! `Plan`): the groups with most of the required channels give the time; channels of other groups
//! are joined at its stamps. A required channel of another rate is an error.
use falcon_mdf::Mf4File;
use falcon_mdf::io::reader::BufferedSource;

use super::channel_group::{Candidates, Group, Stamps, chain};
use super::channel_track::{Part, Track};
use super::channel_values::{Decoded, unit};
use super::group_join::Join;
use crate::error::Problem;
use crate::recording_layout::{Column, CsvLayout};
use crate::{TIME, shown};

/// Where the columns of a recording come from.
pub(super) struct Plan {
    /// The time, the channels found, then the other channels of the first group.
    pub(super) columns: Vec<Column>,
    /// For each of `columns` but the time, its track (0: the base) and its place there.
    pub(super) origins: Vec<(usize, usize)>,
    /// Gives the recording its time.
    pub(super) base: Track,
    pub(super) sides: Vec<SidePlan>,
    /// Period of the base (s).
    pub(super) period_s: f64,
    pub(super) notes: Vec<String>,
}

/// Channels of other groups than the base's.
pub(super) struct SidePlan {
    pub(super) track: Track,
    pub(super) join: Join,
    /// Its period (s).
    pub(super) step_s: f64,
}

/// A channel that is wanted.
pub(super) struct Want<'a> {
    /// Name in the machine and in the file.
    pub(super) name: &'a str,
    written: &'a str,
    required: bool,
    group: Option<&'a str>,
}

/// A file and what is wanted of it.
pub(super) struct Planner<'a> {
    pub(super) file: &'a Mf4File,
    source: &'a BufferedSource,
    layout: &'a CsvLayout,
    pub(super) groups: Vec<Group<'a>>,
    pub(super) wanted: Vec<Want<'a>>,
    pub(super) notes: Vec<String>,
}

impl<'a> Planner<'a> {
    pub(super) fn new(
        file: &'a Mf4File,
        source: &'a BufferedSource,
        layout: &'a CsvLayout,
        wanted: &[(&'a str, bool)],
    ) -> Result<Self, Problem> {
        let mut unique: Vec<Want<'a>> = Vec::new();
        for &(name, required) in wanted {
            match unique.iter_mut().find(|want| want.name == name) {
                Some(known) => known.required |= required,
                None if name == TIME => {}
                None => unique.push(Want {
                    name,
                    written: layout.column_of(name),
                    required,
                    group: layout.channel(name).and_then(|c| c.group.as_deref()),
                }),
            }
        }
        Ok(Self {
            file,
            source,
            layout,
            groups: Group::all(file)?,
            wanted: unique,
            notes: Vec::new(),
        })
    }

    pub(super) fn plan(mut self) -> Result<Plan, Problem> {
        let base = self.base()?;
        let described = self.layout.rate_hz.map(|rate| 1.0 / rate);
        let period_s = (base.first())
            .and_then(|(_, stamps)| stamps.step)
            .or(described)
            .unwrap_or(1.0);
        let mut plan = Plan {
            columns: vec![Column {
                name: TIME.into(),
                unit: Some("s".into()),
            }],
            origins: Vec::new(),
            base: Track {
                names: Vec::new(),
                parts: Vec::new(),
            },
            sides: Vec::new(),
            period_s,
            notes: Vec::new(),
        };
        let mut of_base = Vec::new();
        let mut of_sides: Vec<(Candidates, Vec<usize>)> = Vec::new();
        for want in 0..self.wanted.len() {
            if base.iter().any(|(group, _)| self.has(*group, want)) {
                of_base.push(want);
            } else if let Some(groups) = self.side(want, period_s)? {
                let same =
                    |other: &Candidates| other.iter().map(|g| g.0).eq(groups.iter().map(|g| g.0));
                match of_sides.iter_mut().find(|(other, _)| same(other)) {
                    Some((_, wants)) => wants.push(want),
                    None => of_sides.push((groups, vec![want])),
                }
            }
        }
        let sides = of_sides.iter().flat_map(|(groups, _)| groups);
        let read: Vec<usize> = base.iter().chain(sides).map(|(group, _)| *group).collect();
        self.note_unread(&base, &of_base, &read);
        plan.base = self.track(&base, &of_base, 0, &mut plan)?;
        for (groups, wants) in of_sides {
            let number = plan.sides.len() + 1;
            let side = self.side_plan(&base, &groups, &wants, period_s)?;
            let track = self.track(&groups, &wants, number, &mut plan)?;
            plan.sides.push(SidePlan { track, ..side });
        }
        self.list_others(&base, &mut plan);
        plan.notes = self.notes;
        Ok(plan)
    }

    pub(super) fn has(&self, group: usize, want: usize) -> bool {
        let (group, want) = (&self.groups[group], &self.wanted[want]);
        want.group.is_none_or(|name| group.is_called(name)) && group.channel(want.written).is_some()
    }

    /// The groups that have most of the required channels, or of all where none is required.
    fn base(&mut self) -> Result<Candidates, Problem> {
        let count = |group: usize| {
            let here = |required: bool| {
                (0..self.wanted.len())
                    .filter(|&want| self.wanted[want].required == required && self.has(group, want))
                    .count()
            };
            (here(true), here(false))
        };
        let key = |group: usize| -> Vec<bool> {
            let any_required = self.wanted.iter().any(|want| want.required);
            (0..self.wanted.len())
                .map(|want| self.has(group, want) && (self.wanted[want].required || !any_required))
                .collect()
        };
        let filled = |group: &usize| self.groups[*group].block.sample_count > 1;
        let all = 0..self.groups.len();
        // Of equally good groups the one with samples, then the first.
        let best = all.clone().rev().max_by_key(|&group| {
            let (required, optional) = count(group);
            (required, optional, filled(&group))
        });
        let Some(best) = best else {
            return Err(Problem::Missing {
                column: format!("`{TIME}`"),
                found: "no channel group with a time channel".into(),
                nearest: None,
                is_time: false,
            });
        };
        let wanted = key(best);
        let same: Vec<usize> = if wanted.iter().any(|has| *has) {
            all.filter(|&group| key(group) == wanted).collect()
        } else {
            vec![best]
        };
        let candidates = self.stamped(&same)?;
        if candidates.is_empty() {
            return Ok(vec![(best, Stamps::none())]);
        }
        let first = wanted.iter().position(|has| *has);
        let (chain, others) = self.chain(candidates, first)?;
        self.note_lost(&chain, &others, first);
        Ok(chain)
    }

    /// Those of `groups` that have samples, with their stamps.
    fn stamped(&self, groups: &[usize]) -> Result<Candidates, Problem> {
        let mut stamped = Vec::new();
        for &group in groups {
            // The order of several groups needs their ends.
            if let Some(stamps) = self.groups[group].stamps(self.file, groups.len() > 1)? {
                stamped.push((group, stamps));
            }
        }
        Ok(stamped)
    }

    fn chain(
        &self,
        candidates: Candidates,
        want: Option<usize>,
    ) -> Result<(Candidates, Candidates), Problem> {
        let period_s = self.layout.rate_hz.map(|rate| 1.0 / rate);
        let samples = |group: usize| self.groups[group].block.sample_count;
        chain(candidates, period_s, samples).map_err(|over| {
            let numbers: Vec<String> = over
                .iter()
                .map(|group| self.groups[*group].number.to_string())
                .collect();
            Problem::Ambiguous {
                column: shown(want.map_or(TIME, |want| self.wanted[want].name)),
                groups: numbers.join(" and "),
            }
        })
    }

    /// The groups that channel `want` is read from where the base has it not; none where no group
    /// has it.
    fn side(&mut self, want: usize, period_s: f64) -> Result<Option<Candidates>, Problem> {
        let having: Vec<usize> = (0..self.groups.len())
            .filter(|&group| self.has(group, want))
            .collect();
        let candidates = self.stamped(&having)?;
        if candidates.is_empty() {
            if !having.is_empty() {
                let name = shown(self.wanted[want].name);
                self.notes.push(format!("column `{name}` has no samples"));
            }
            return Ok(None);
        }
        let at_rate = |(_, stamps): &(usize, Stamps)| stamps.has_period(period_s);
        let candidates = if candidates.iter().any(at_rate) {
            candidates.into_iter().filter(at_rate).collect()
        } else {
            candidates
        };
        let (chain, _) = self.chain(candidates, Some(want))?;
        Ok(Some(chain))
    }

    /// How channels of other groups are brought to the stamps of the base.
    fn side_plan(
        &mut self,
        base: &Candidates,
        groups: &Candidates,
        wants: &[usize],
        period_s: f64,
    ) -> Result<SidePlan, Problem> {
        let stamps = groups.first().map(|(_, stamps)| stamps);
        let step_s = stamps.and_then(|s| s.step).unwrap_or(f64::INFINITY);
        let same = stamps.is_some_and(|stamps| stamps.has_period(period_s));
        let number = groups
            .first()
            .map_or(0, |(group, _)| self.groups[*group].number);
        let required = wants.iter().find(|want| self.wanted[**want].required);
        if let (Some(&want), false) = (required, same) {
            let other = self
                .wanted
                .iter()
                .enumerate()
                .find(|(other, _)| base.iter().any(|(group, _)| self.has(*group, *other)));
            return Err(Problem::OtherRate {
                column: shown(self.wanted[want].name),
                other: shown(other.map_or(TIME, |(_, want)| want.name)),
                found_s: step_s,
                allowed_s: period_s,
            });
        }
        let join = Join::of(step_s, period_s, same);
        self.note_apart(base, groups, wants);
        let names: Vec<String> = wants.iter().map(|w| shown(self.wanted[*w].name)).collect();
        let names = names.join(", ");
        match join {
            Join::Nearest => {
                let apart = stamps.map_or(0.0, |side| offset(base, side));
                if apart > 0.01 * period_s {
                    self.notes.push(format!(
                        "{names} (channel group {number}) is sampled up to {:.3} ms beside the other \
                         channels; the nearest samples are taken",
                        1e3 * apart
                    ));
                }
            }
            Join::Interpolated => self.notes.push(format!(
                "{names} (channel group {number}) has a sample every {step_s:.6} s and is \
                 interpolated to {period_s:.6} s"
            )),
            Join::Averaged => self.notes.push(format!(
                "{names} (channel group {number}) has a sample every {step_s:.6} s and is averaged \
                 over {period_s:.6} s"
            )),
        }
        Ok(SidePlan {
            track: Track {
                names: Vec::new(),
                parts: Vec::new(),
            },
            join,
            step_s,
        })
    }

    /// The channels `wants` of consecutive groups; `number` is the track's.
    fn track(
        &self,
        groups: &Candidates,
        wants: &[usize],
        number: usize,
        plan: &mut Plan,
    ) -> Result<Track, Problem> {
        let mut track = Track {
            names: Vec::new(),
            parts: Vec::new(),
        };
        for (place, &want) in wants.iter().enumerate() {
            let want = &self.wanted[want];
            plan.origins.push((number, place));
            plan.columns.push(Column {
                name: want.name.into(),
                unit: self.unit(groups, want)?,
            });
            track.names.push(want.name.into());
        }
        for &(group, _) in groups {
            let group = &self.groups[group];
            let channel = |want: &usize| -> Result<Option<Decoded>, Problem> {
                let written = self.wanted[*want].written;
                let mut same = group.block.channels.iter().filter(|c| c.name == written);
                match (same.next(), same.next()) {
                    (Some(_), Some(_)) => Err(Problem::Duplicate {
                        name: shown(written),
                    }),
                    (channel, _) => Ok(channel.map(Decoded::of)),
                }
            };
            track.parts.push(Part {
                time: group.time.clone(),
                channels: wants.iter().map(channel).collect::<Result<_, _>>()?,
                declared: group.declared,
            });
        }
        Ok(track)
    }

    /// The unit of a channel: as the layout says it, else as its groups do, which must agree.
    fn unit(&self, groups: &Candidates, want: &Want<'_>) -> Result<Option<String>, Problem> {
        let stated = self.layout.channel(want.name).and_then(|c| c.unit);
        if let Some(stated) = stated {
            return Ok(Some(stated.symbol().into()));
        }
        let mut units = groups
            .iter()
            .filter_map(|(group, _)| self.groups[*group].channel(want.written))
            .map(|channel| unit(channel, self.source));
        let first = units.next().flatten();
        match units.find(|unit| *unit != first) {
            None => Ok(first),
            Some(other) => Err(Problem::WrongUnit {
                column: shown(want.name),
                found: shown(other.unwrap_or_default()),
                allowed: format!(
                    "the unit of its other channel groups ({})",
                    shown(first.unwrap_or_default())
                ),
            }),
        }
    }

    /// Adds the channels that nobody asked for, so that messages can name them.
    fn list_others(&self, base: &Candidates, plan: &mut Plan) {
        let first = base.first().map(|(group, _)| *group);
        let later = (0..self.groups.len()).filter(|group| Some(*group) != first);
        for group in first.into_iter().chain(later) {
            for channel in &self.groups[group].block.channels {
                let known = |column: &Column| column.name == channel.name;
                let is_wanted = self.wanted.iter().any(|want| want.written == channel.name);
                if !channel.is_master() && !is_wanted && !plan.columns.iter().any(known) {
                    plan.columns.push(Column {
                        name: channel.name.clone(),
                        unit: unit(channel, self.source),
                    });
                }
            }
        }
    }
}

impl Stamps {
    /// Of a group without samples.
    fn none() -> Self {
        Self {
            head: Vec::new(),
            step: None,
            last: f64::NAN,
        }
    }
}

/// How far the first samples of `side` are from those of the base at most (s).
fn offset(base: &Candidates, side: &Stamps) -> f64 {
    let head = base.first().map_or(&[][..], |(_, stamps)| &stamps.head);
    let mut largest = 0.0_f64;
    for t in &side.head {
        let after = head.partition_point(|other| other < t);
        let near = [after.checked_sub(1), Some(after)];
        let distance = near
            .into_iter()
            .flatten()
            .filter_map(|i| head.get(i))
            .map(|other| (other - t).abs())
            .fold(f64::INFINITY, f64::min);
        if after > 0 && after < head.len() {
            largest = largest.max(distance);
        }
    }
    largest
}
