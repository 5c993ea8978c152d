//! Reads recordings in ASAM MDF4, the format of test benches (`Mdf`): opens the file, plans the
//! channel groups, and delivers rows of the picked channels at the time stamps of one group;
//! channels of other groups are joined at these stamps.
//!
//! A channel is found in whichever group has it. Groups of the same channels
//! that follow each other in time are one recording. Records are read window by
//! window; a compressed block is held whole, which is 4 MB or less from the
//! usual writers. Invalid samples are missing samples.
mod channel_group;
mod channel_track;
mod channel_values;
mod group_join;
mod group_plan;
mod plan_notes;
mod unsorted;

use std::path::Path;
use std::sync::Arc;

use falcon_mdf::io::reader::BufferedSource;
use falcon_mdf::{Mf4Error, Mf4File, OpenOptions};

use super::error::{Problem, clipped};
use super::recording_layout::{Column, CsvLayout, WrittenNan};
use super::row_source::{Output, Rows};
use channel_group::Group;
use channel_track::Stream;
use group_join::Side;
use group_plan::{Plan, Planner};
use unsorted::WholeRecords;

/// Largest size that a compressed block may claim to have expanded, bytes: 24
/// times what the usual writers make, and twice that is held where a block is
/// transposed.
const LARGEST_BLOCK: u64 = 96 << 20;

pub(super) struct Mdf {
    file: Mf4File,
    plan: Plan,
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
        wanted: &[(&str, bool)],
    ) -> Result<Self, Problem> {
        // Not mapped into memory: a file that another process cuts short would
        // then end this one.
        let source = Arc::new(BufferedSource::open(path).map_err(damaged)?);
        let options = OpenOptions {
            max_decompressed: LARGEST_BLOCK,
            ..OpenOptions::default()
        };
        let shared = Arc::clone(&source);
        let mut file =
            Mf4File::from_source_with_options(shared, options.clone()).map_err(damaged)?;
        if let Some(whole) = WholeRecords::of(&file, &source).map_err(damaged)? {
            file = Mf4File::from_source_with_options(Arc::new(whole), options).map_err(damaged)?;
        }
        let plan = Planner::new(&file, &source, layout, wanted)?.plan()?;
        Ok(Self {
            plan,
            nan_is_missing: layout.written_nan == WrittenNan::Missing,
            file,
        })
    }

    /// Names of the channels of all groups that have a time, each once; without those that a group
    /// has twice, which cannot be asked for.
    pub(super) fn names(&self) -> Result<Vec<String>, Problem> {
        let mut names: Vec<String> = Vec::new();
        for group in Group::all(&self.file)? {
            let channels = &group.block.channels;
            for channel in channels {
                let is_once = channels.iter().filter(|c| c.name == channel.name).count() == 1;
                let is_time = channel.name == group.time.name;
                if is_once && !is_time && !names.contains(&channel.name) {
                    names.push(channel.name.clone());
                }
            }
        }
        Ok(names)
    }

    pub(super) fn columns(&self) -> &[Column] {
        &self.plan.columns
    }

    pub(super) fn notes(&self) -> &[String] {
        &self.plan.notes
    }

    /// Delivers all rows; column `picks[k]` of the file becomes their column `k`.
    pub(super) fn run(self, picks: &[usize], output: &Output) -> Result<(), Problem> {
        let plan = &self.plan;
        // Which channels each track is to read, and where they go.
        let mut reads = vec![(Vec::new(), Vec::new()); 1 + plan.sides.len()];
        for (k, &column) in picks.iter().enumerate().filter(|(k, _)| *k != Rows::TIME) {
            if let Some(&(track, place)) = plan.origins.get(column - 1) {
                reads[track].0.push(place);
                reads[track].1.push(k);
            }
        }
        let mut reads = reads.into_iter();
        let (places, base_goals) = reads.next().unwrap_or_default();
        let mut base = Stream::new(&self.file, &plan.base, places, self.nan_is_missing);
        let mut sides = Vec::new();
        for (side, (places, goals)) in plan.sides.iter().zip(reads) {
            let width = places.len();
            let stream = Stream::new(&self.file, &side.track, places, self.nan_is_missing);
            let side = Side::new(stream, width, side.join, side.step_s, plan.period_s);
            sides.push((side, goals));
        }
        while let Some(window) = base.next()? {
            let mut rows = Rows::with_columns(0);
            rows.columns.resize_with(picks.len(), Vec::new);
            for (side, goals) in sides.iter_mut().filter(|(_, goals)| !goals.is_empty()) {
                for (goal, values) in goals.iter().zip(side.at(&window.t)?) {
                    rows.columns[*goal] = values;
                }
            }
            for (goal, values) in base_goals.iter().zip(window.columns) {
                rows.columns[*goal] = values;
            }
            rows.columns[Rows::TIME] = window.t;
            if !output.deliver(rows, base.progress()) {
                return Ok(());
            }
        }
        Ok(())
    }
}
