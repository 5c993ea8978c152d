//! Replays all machines of an archive on a thread pool, each machine on one thread, and writes the
//! outcome; a machine that fails does not stop the others, a full disk does. `prepared` makes the
//! task of each machine; `Watch` reports the progress, and stops a run from another thread.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use rayon::ThreadPoolBuilder;

use crate::layout::{Archive, Results};
use crate::outcome::{Figures, write_outcome};
use crate::overview::Overview;
use crate::{ArchiveError, MachineTask, Options, description_table};

/// Progress of a run, and its stop, from another thread.
#[derive(Debug, Default)]
pub struct Watch {
    stopped: AtomicBool,
    total: AtomicUsize,
    done: AtomicUsize,
}

impl Watch {
    /// Ends the run before its next block of samples; days that are done stay.
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// Machines that are done, and all of them.
    pub fn progress(&self) -> (usize, usize) {
        let count = |of: &AtomicUsize| of.load(Ordering::Relaxed);
        (count(&self.done), count(&self.total))
    }

    /// # Errors
    /// [`ArchiveError::Stopped`] once it is stopped.
    pub(crate) fn check(&self) -> Result<(), ArchiveError> {
        if self.stopped.load(Ordering::Relaxed) {
            return Err(ArchiveError::Stopped);
        }
        Ok(())
    }
}

/// Checks archive and results, and gives the task of each machine.
///
/// # Errors
/// [`ArchiveError`] when the archive is none, is empty, or has no table of descriptions; when the
/// folder of the results holds something else.
pub fn prepared(
    archive: &Path,
    results: &Path,
    options: &Options,
) -> Result<Vec<MachineTask>, ArchiveError> {
    let found = Archive::open(archive)?;
    let machines = found.machines()?;
    let mut entries = description_table::read(&found.folder)?;
    let results = Results::begin(results, &found)?;
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let task = |machine: String| MachineTask {
        archive: text(&found.folder),
        results: text(&results.folder),
        entries: entries.remove(&machine).unwrap_or_default(),
        machine,
        options: options.clone(),
    };
    Ok(machines.into_iter().map(task).collect())
}

/// Replays the days of a machine that are not up to date; where it cannot be replayed, its row has
/// the fault.
///
/// # Errors
/// [`ArchiveError`] when the disk of the results is full or cannot be written: every machine would
/// have it. Also when the run was stopped.
pub fn replay_machine(task: &MachineTask, watch: &Watch) -> Result<Overview, ArchiveError> {
    // The other machines go on, whatever one of them meets.
    let replayed = catch_unwind(AssertUnwindSafe(|| task.replay(watch)));
    match replayed {
        Ok(Ok(overview)) => Ok(overview),
        Ok(Err(error)) if error.ends_the_run() => Err(error),
        Ok(Err(error)) => Ok(Overview::failed(&task.machine, error.to_string())),
        Err(_) => {
            let fault = "its replay gave up; this is a defect of loadtwin".to_owned();
            Ok(Overview::failed(&task.machine, fault))
        }
    }
}

/// Replays all machines of an archive, those days that are not up to date, on so many `threads`;
/// absent: one for each core.
///
/// # Errors
/// As [`prepared`] and [`replay_machine`]; when there can be no threads.
pub fn run(
    archive: &Path,
    results: &Path,
    options: &Options,
    threads: Option<usize>,
    watch: &Watch,
) -> Result<Figures, ArchiveError> {
    let began = Instant::now();
    let tasks = prepared(archive, results, options)?;
    let refused = |reason: String| ArchiveError::refused("processes", reason);
    if threads == Some(0) {
        return Err(refused("found 0, allowed: 1 and more".into()));
    }
    let pool = ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0));
    let pool = pool.build().map_err(|error| refused(error.to_string()))?;
    watch.total.store(tasks.len(), Ordering::Relaxed);
    let next = AtomicUsize::new(0);
    let rows = Mutex::new(Vec::with_capacity(tasks.len()));
    // A thread takes the next machine when it is done with one. As tasks of the pool, machines would
    // also be begun where a machine waits for a parallel design of its model: on its stack, and with
    // its lock held.
    let outcomes = pool.broadcast(|_| {
        while let Some(task) = tasks.get(next.fetch_add(1, Ordering::Relaxed)) {
            watch.check()?;
            let row = replay_machine(task, watch).inspect_err(|_| watch.stop())?;
            rows.lock()
                .unwrap_or_else(PoisonError::into_inner)
                .push(row);
            watch.done.fetch_add(1, Ordering::Relaxed);
        }
        Ok(())
    });
    // Where one thread met a full disk, it stopped the others.
    let failures = outcomes.into_iter().filter_map(Result::err);
    let first = failures.reduce(|first, error| match first {
        ArchiveError::Stopped => error,
        first => first,
    });
    if let Some(error) = first {
        return Err(error);
    }
    let rows = rows.into_inner().unwrap_or_else(PoisonError::into_inner);
    let results = crate::layout::text(results)?;
    write_outcome(Path::new(&results), rows, options.page, began.elapsed())
}
