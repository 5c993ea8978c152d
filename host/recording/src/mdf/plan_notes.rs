//! Says which channel groups of an MDF4 file were joined, and which were left out and why, as notes
//! of the `Planner`.
use super::channel_group::Candidates;
use super::group_plan::Planner;
use crate::{TIME, shown};

impl Planner<'_> {
    /// Says which groups make the recording where several do, and which are left out.
    pub(super) fn note_lost(
        &mut self,
        chain: &Candidates,
        others: &Candidates,
        want: Option<usize>,
    ) {
        let name = want.map_or(TIME, |want| self.wanted[want].name).to_owned();
        let numbers = |groups: &Candidates| {
            let numbers: Vec<String> = (groups.iter())
                .map(|(group, _)| self.groups[*group].number.to_string())
                .collect();
            numbers.join(", ")
        };
        let mut notes = Vec::new();
        if chain.len() > 1 {
            notes.push(format!(
                "channel groups {} follow each other in time and are read as one recording",
                numbers(chain)
            ));
        }
        if !others.is_empty() {
            notes.push(format!(
                "column `{}` is in the channel groups {} too, with other periods; they are not read",
                shown(&name),
                numbers(others)
            ));
        }
        self.notes.extend(notes);
    }

    /// Says which groups have channels `wants` of the base at other times and are left out, and
    /// which groups of the base lack some.
    pub(super) fn note_unread(&mut self, base: &Candidates, wants: &[usize], read: &[usize]) {
        let names = |wants: &[usize]| {
            let names = wants.iter().map(|want| shown(self.wanted[*want].name));
            names.collect::<Vec<_>>().join("`, `")
        };
        let mut notes = Vec::new();
        for group in 0..self.groups.len() {
            let number = self.groups[group].number;
            let (here, lacking): (Vec<usize>, Vec<usize>) =
                wants.iter().partition(|&&want| self.has(group, want));
            if here.is_empty() || lacking.is_empty() {
                continue;
            }
            if base.iter().any(|(part, _)| *part == group) {
                notes.push(format!(
                    "channel group {number} lacks `{}`: missing in its rows",
                    names(&lacking)
                ));
            }
            if read.contains(&group) {
                continue;
            }
            let Some((from, to)) = self.span(group) else {
                continue;
            };
            let others = base.iter().filter_map(|(other, _)| self.span(*other));
            if others
                .into_iter()
                .all(|other| to < other.0 || from > other.1)
            {
                notes.push(format!(
                    "channel group {number} (t = {from} s to {to} s) is not read: it lacks `{}`",
                    names(&lacking)
                ));
            }
        }
        self.notes.extend(notes);
    }

    /// Says that channels of other groups have no sample within the time of the base.
    pub(super) fn note_apart(&mut self, base: &Candidates, groups: &Candidates, wants: &[usize]) {
        let span = |groups: &Candidates| {
            let first = groups.first().and_then(|(group, _)| self.span(*group))?;
            let last = groups.last().and_then(|(group, _)| self.span(*group))?;
            Some((first.0, last.1))
        };
        let near = |a: &Candidates, b: &Candidates| {
            let (Some(a), Some(b)) = (a.first(), b.last()) else {
                return true;
            };
            // The last stamp of a single group is that of its first window.
            a.1.first() <= b.1.last
        };
        if near(base, groups) && near(groups, base) {
            return;
        }
        let (Some(own), Some(other)) = (span(base), span(groups)) else {
            return;
        };
        if other.0 > own.1 || own.0 > other.1 {
            let names: Vec<String> = wants.iter().map(|w| shown(self.wanted[*w].name)).collect();
            self.notes.push(format!(
                "`{}` (t = {} s to {} s) has no sample in the time of the other channels (t = {} s to {} s): \
                 is it another clock?",
                names.join("`, `"),
                other.0,
                other.1,
                own.0,
                own.1
            ));
        }
    }

    /// First and last time of a group (s); none of one without samples or that cannot be read.
    fn span(&self, group: usize) -> Option<(f64, f64)> {
        let stamps = self.groups[group].stamps(self.file, true).ok().flatten()?;
        Some((stamps.first(), stamps.last))
    }
}
