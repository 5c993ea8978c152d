//! Goes through the days of one machine in order and replays those that are not up to date: new
//! ones, those with a fault, and those where the hash of recordings, description, options and state
//! before has changed. Other days keep their row, also where their recordings were removed.

use std::collections::{BTreeSet, HashMap};
use std::fs;
use std::io;
use std::path::Path;
use std::rc::Rc;
use std::time::{Duration, Instant};

use loadtwin_files::hex::hex;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::carried_state::CarriedState;
use crate::complete_file::{Lock, remove_parts};
use crate::day::{Day, DaySums, Days, RecordingOfDay};
use crate::day_replay::DayReplay;
use crate::described_machine::Described;
use crate::description_table::{self, Entry};
use crate::layout::{Archive, Recording, Results, is_date};
use crate::options::Options;
use crate::overview::Overview;
use crate::verdict::Verdict;
use crate::{ArchiveError, Watch, days_table, machine_page};

/// Time between two writings of the table of the days; a kill loses no more.
const SAVE: Duration = Duration::from_secs(2);

/// Everything that is needed to replay a machine, in any process.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MachineTask {
    /// Folder of the archive.
    pub archive: String,
    /// Folder of the results.
    pub results: String,
    /// Name of the machine in the archive.
    pub machine: String,
    /// Its rows of the table of descriptions.
    pub entries: Vec<Entry>,
    /// How it is replayed.
    pub options: Options,
}

/// A description by file, stated hash and counted load, or why it is refused.
type DescribedBy = HashMap<(String, Option<String>, Option<String>), Result<Rc<Described>, String>>;

/// The days of a machine while they are replayed.
pub(crate) struct MachineHistory<'a> {
    task: &'a MachineTask,
    watch: &'a Watch,
    results: Results,
    rows: Days,
    described: DescribedBy,
    saved: Instant,
}

/// A day that was looked at.
struct Done {
    row: Day,
    /// State after it.
    after: CarriedState,
    /// Whether it was replayed.
    is_new: bool,
}

impl MachineTask {
    /// Replays what is not up to date. Of several processes that are given the same machine, one
    /// works and the others wait.
    ///
    /// # Errors
    /// [`ArchiveError`] when recordings cannot be listed or results cannot be written, or the run
    /// was stopped.
    pub(crate) fn replay(&self, watch: &Watch) -> Result<Overview, ArchiveError> {
        let archive = Archive {
            folder: (&self.archive).into(),
        };
        let results = Results {
            folder: (&self.results).into(),
        };
        let folder = results.days(&self.machine);
        let lock = Lock::wait(&folder.join(".lock"))?;
        remove_parts(&folder)?;
        remove_parts(&results.all_estimates(&self.machine))?;
        let history = MachineHistory {
            task: self,
            watch,
            rows: days_table::read(&folder),
            results,
            described: HashMap::new(),
            saved: Instant::now(),
        };
        let overview = history.run(&archive);
        drop(lock);
        overview
    }
}

impl MachineHistory<'_> {
    fn run(mut self, archive: &Archive) -> Result<Overview, ArchiveError> {
        let machine = &self.task.machine;
        let mut recorded = archive.days(machine)?;
        let days: BTreeSet<String> = recorded.keys().chain(self.rows.keys()).cloned().collect();
        let (mut replayed, mut carried) = (0, CarriedState::default());
        for day in days {
            self.watch.check()?;
            let recordings = recorded.remove(&day).unwrap_or_default();
            let done = self.day(&day, &recordings, carried)?;
            self.rows.insert(day, done.row);
            carried = done.after;
            replayed += u64::from(done.is_new);
            if done.is_new && self.saved.elapsed() > SAVE {
                self.save()?;
            }
        }
        if replayed > 0 {
            self.save()?;
        }
        if self.task.options.page {
            machine_page::write(&self.results, machine, &self.rows, replayed > 0)?;
        }
        let overview = Overview::of(machine, &self.rows, replayed);
        Ok(overview.against_design(&self.task.entries))
    }

    fn save(&mut self) -> Result<(), ArchiveError> {
        days_table::write(&self.results.days(&self.task.machine), &self.rows)?;
        self.saved = Instant::now();
        Ok(())
    }

    fn day(
        &mut self,
        day: &str,
        recordings: &[Recording],
        carried: CarriedState,
    ) -> Result<Done, ArchiveError> {
        let folder = self.results.estimates(&self.task.machine, day);
        let before = self.rows.get(day).map(|row| {
            let after = CarriedState::read(&folder, &row.state_sha256);
            (row.clone(), after)
        });
        let before = match before {
            // Recordings that were removed leave their results.
            Some((row, after)) if recordings.is_empty() => {
                return Ok(Done {
                    row,
                    after: after.unwrap_or(carried),
                    is_new: false,
                });
            }
            before => before,
        };
        let described = self.description(day);
        let made_from = self.made_from(recordings, &carried, described.as_ref().ok())?;
        let is_there = before.is_some();
        if let Some((row, Some(after))) = before
            && row.made_from == made_from
            // What failed may have been a disk or a network.
            && !row.has_fault()
            && !self.task.options.again
        {
            return Ok(Done {
                row,
                after,
                is_new: false,
            });
        }
        if is_there {
            // From here on until the row is written anew, the day is not up to date.
            self.rows.remove(day);
            self.save()?;
        }
        let (row, after) = match described {
            Err(fault) => (failed(fault, recordings), carried),
            Ok((entry, described)) => {
                let mut replay = DayReplay {
                    entry: &entry,
                    described: &described,
                    options: &self.task.options,
                    folder: &folder,
                    carried,
                    watch: self.watch,
                };
                let row = replay.run(recordings)?;
                (row, replay.carried)
            }
        };
        remove_stale(&folder, &row).map_err(ArchiveError::io(&folder))?;
        let state_sha256 = after.write(&folder)?;
        let row = Day {
            made_from,
            state_sha256,
            ..row
        };
        Ok(Done {
            row,
            after,
            is_new: true,
        })
    }

    /// The description of a day.
    ///
    /// # Errors
    /// In words, where there is none.
    fn description(&mut self, day: &str) -> Result<(Entry, Rc<Described>), String> {
        if !is_date(day) {
            return Err(format!(
                "day={day}: found '{day}', allowed: a date, as day=2026-11-28"
            ));
        }
        let entry = description_table::at(&self.task.entries, day)?;
        let key = (entry.path.clone(), entry.sha256.clone(), entry.load.clone());
        let options = &self.task.options;
        let described = self.described.entry(key);
        let described = described.or_insert_with(|| Described::read(entry, options).map(Rc::new));
        Ok((entry.clone(), described.clone()?))
    }

    /// Hash of all that a day is made from.
    fn made_from(
        &self,
        recordings: &[Recording],
        carried: &CarriedState,
        described: Option<&(Entry, Rc<Described>)>,
    ) -> Result<String, ArchiveError> {
        let recordings = recordings.iter().map(|recording| {
            let Recording {
                name,
                size,
                modified_ns,
                ..
            } = recording;
            (name, size, modified_ns.to_string())
        });
        let options = &self.task.options;
        let parts = (
            recordings.collect::<Vec<_>>(),
            carried.sha256()?,
            described.map(|(_, described)| &described.sha256),
            described.map(|(entry, _)| (&entry.load, &entry.sn, entry.range)),
            (
                &options.sensors,
                options.filter().name(),
                options.columns.name(),
            ),
        );
        let text = serde_json::to_vec(&parts)
            .map_err(|error| ArchiveError::refused(&self.task.machine, error))?;
        Ok(hex(Sha256::digest(text)))
    }
}

/// Removes estimates of recordings that are not there any more or have none.
fn remove_stale(folder: &Path, row: &Day) -> io::Result<()> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    for entry in entries {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let is_kept = (row.recordings.iter()).any(|of| of.samples > 0 && of.name == name);
        if name.ends_with(".parquet") && !is_kept {
            fs::remove_file(&path)?;
        }
    }
    Ok(())
}

/// The row of a day without a description.
fn failed(fault: String, recordings: &[Recording]) -> Day {
    let recordings = recordings.iter().map(|recording| RecordingOfDay {
        name: recording.name.clone(),
        ..RecordingOfDay::default()
    });
    Day {
        verdict: Verdict::NoData,
        sums: DaySums::default(),
        recordings: recordings.collect(),
        fault: Some(fault),
        name: None,
        description: None,
        description_sha256: None,
        loadtwin: env!("CARGO_PKG_VERSION").to_owned(),
        made_from: String::new(),
        state_sha256: String::new(),
    }
}
