//! The counts that boards keep, for `loadtwin life`: reads them from a bus or its log, names their
//! loads by the machine description, and joins the pages of one board over its images.

use std::path::Path;

use anyhow::{Context, bail};
use loadtwin_common::counting::LoadCounts;

use crate::can::frame_source::Source;
use crate::can::kept_counts::{KeptPage, kept_counts};
use crate::can::stop_on_signal;
use crate::cli::printing::note;
use crate::life::{CountedLoad, Loads};
use crate::machine::Machine;
use crate::recording::Unit;

/// What one board has counted.
pub(super) struct Board {
    pub(super) period_s: f64,
    /// Name and unit of each load, and its counts.
    loads: Vec<(String, Unit, LoadCounts)>,
}

/// Boards among the files, each at the place of its file.
pub(super) struct Boards(Vec<Option<Board>>);

impl Boards {
    /// Reads those among `files`; their loads are named by `machine`.
    pub(super) fn read(
        files: &[std::path::PathBuf],
        machine: Option<&Path>,
        names: &[String],
    ) -> anyhow::Result<Self> {
        let mut stop = None;
        let mut boards = Vec::new();
        for path in files {
            let Some(source) = Source::of_path(path)? else {
                boards.push(None);
                continue;
            };
            let name = path.display();
            let Some(machine) = machine else {
                bail!("{name}: give the machine description of the board by --machine");
            };
            // A handler is set once.
            let stop = match &mut stop {
                Some(stop) => stop,
                empty => empty.insert(stop_on_signal()?),
            };
            // Before the bus is read, which takes its time.
            let machine = Machine::load(machine)?;
            let pages = kept_counts(source, stop).with_context(|| name.to_string())?;
            let board = Board::of(&machine, pages, names).with_context(|| name.to_string())?;
            boards.push(Some(board));
        }
        Ok(Self(boards))
    }

    /// The board at the place of a file.
    pub(super) fn at(&self, place: usize) -> Option<&Board> {
        self.0.get(place)?.as_ref()
    }

    /// The first board.
    pub(super) fn first(&self) -> Option<&Board> {
        self.0.iter().flatten().next()
    }

    /// Place of the first file that is no board.
    pub(super) fn first_file(&self) -> Option<usize> {
        self.0.iter().position(Option::is_none)
    }
}

impl Board {
    /// Joins the pages of the images that count as `machine` describes it, the oldest first.
    fn of(machine: &Machine, mut pages: Vec<KeptPage>, names: &[String]) -> anyhow::Result<Self> {
        let found = pages.len();
        let described = machine.counted_loads()?;
        let rate_hz = machine.rate_hz as f32;
        pages.retain(|page| {
            page.header.counted[..] == described[..] && page.header.rate_hz == rate_hz
        });
        let left_out = found - pages.len();
        let mut pages = pages.into_iter().map(|page| page.counts);
        let mut counts = pages.next().with_context(|| {
            format!(
                "the board counts other loads, other levels or at another rate than [[count]] of {:?}; allowed: the \
                 description of the board's image",
                machine.name
            )
        })?;
        if left_out > 0 {
            note(format_args!(
                "counts of {left_out} images are left out: other loads, levels or rate\n"
            ));
        }
        for page in pages {
            for (earlier, mut later) in counts.iter_mut().zip(page) {
                later.restart();
                earlier.append(&later)?;
            }
        }
        let all = machine.loads();
        let mut loads: Vec<_> = (described.iter().zip(counts))
            .filter_map(|(counted, counts)| {
                let load = all.get(usize::from(counted.load))?;
                Some((load.name.to_owned(), load.unit, counts))
            })
            .collect();
        if !names.is_empty() {
            loads.retain(|(name, ..)| names.contains(name));
            anyhow::ensure!(
                loads.len() == names.len(),
                "--load {}: the board does not count all of them",
                names.join(", ")
            );
        }
        Ok(Self {
            period_s: 1.0 / machine.rate_hz,
            loads,
        })
    }

    /// Names and units of its loads.
    pub(super) fn loads(&self, speed: Option<&str>, ratio: f64) -> Loads {
        let loads = self.loads.iter();
        Loads {
            loads: loads.map(|(name, unit, _)| (name.clone(), *unit)).collect(),
            speed: speed.map(Into::into),
            ratio,
        }
    }

    /// Counts of the same levels with nothing in them.
    pub(super) fn empty(&self) -> anyhow::Result<Vec<CountedLoad>> {
        let empty = self.loads.iter().map(|(.., counts)| {
            let empty = LoadCounts::try_new(*counts.scale(), counts.gate())?;
            Ok(CountedLoad::new(empty, None))
        });
        empty.collect()
    }

    /// Its counts.
    pub(super) fn counts(&self) -> Vec<CountedLoad> {
        let loads = self.loads.iter();
        loads
            .map(|(.., counts)| CountedLoad::new(counts.clone(), None))
            .collect()
    }
}
