//! Functions of the Python module for archives: replay of all machines on threads; or, for an engine
//! that hands out tasks, their list, the replay of one, and tables and page of all outcomes.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use loadtwin::archive::{self, ArchiveError, Figures, MachineTask, Options, Overview, Watch};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{Error, PATIENCE};

/// Sensors, filter, columns, again, page.
type Given = (Option<String>, String, String, bool, bool);

/// Figures of a run as JSON, and as text.
type Shown = (String, String);

fn error(error: ArchiveError) -> PyErr {
    match error {
        ArchiveError::Io { path, source } => match source.raw_os_error() {
            // An `OSError` of the kind that its number has.
            Some(number) => {
                let reason = source.to_string();
                let reason = reason
                    .split(" (os error")
                    .next()
                    .unwrap_or_default()
                    .to_owned();
                PyOSError::new_err((number, reason, path.display().to_string()))
            }
            None => PyOSError::new_err(format!("{}: {source}", path.display())),
        },
        error => Error::new_err(error.to_string()),
    }
}

fn options((sensors, filter, columns, again, page): Given) -> PyResult<Options> {
    let options = Options {
        sensors,
        again,
        page,
        ..Options::default()
    };
    options.named(&filter, &columns).map_err(error)
}

fn shown(figures: &Figures) -> PyResult<Shown> {
    let json = serde_json::to_string(figures).map_err(crate::error)?;
    Ok((json, figures.to_string()))
}

fn to_bytes(value: &impl Serialize) -> PyResult<Vec<u8>> {
    postcard::to_stdvec(value).map_err(crate::error)
}

fn from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> PyResult<T> {
    let refused = |error| Error::new_err(format!("task or row of another version: {error}"));
    postcard::from_bytes(bytes).map_err(refused)
}

/// Does `work` on another thread, while interrupts are looked for; `progress` is called with the
/// machines that are done, and all of them.
fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Watch) -> Result<T, ArchiveError> + Send,
) -> PyResult<T> {
    let watch = Watch::default();
    thread::scope(|scope| {
        let (sender, mut done) = channel();
        let watch = &watch;
        scope.spawn(move || {
            // Nobody waits where an interrupt came.
            let _ = sender.send(work(watch));
        });
        let mut last = 0;
        loop {
            let found = py.detach(|| next(&mut done));
            let (count, total) = watch.progress();
            let interrupted = py.check_signals().and_then(|()| match progress {
                Some(progress) if count > last => progress.call1((count, total)).map(drop),
                _ => Ok(()),
            });
            last = count;
            if let Err(interrupt) = interrupted {
                watch.stop();
                // The scope waits for the thread, which other threads of Python need not.
                py.detach(|| while let Err(RecvTimeoutError::Timeout) = next(&mut done) {});
                return Err(interrupt);
            }
            match found {
                Ok(outcome) => return outcome.map_err(error),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(Error::new_err(
                        "the replay gave up; this is a defect of loadtwin",
                    ));
                }
            }
        }
    })
}

/// The outcome, if it is there within [`PATIENCE`].
fn next<T>(done: &mut Receiver<T>) -> Result<T, RecvTimeoutError> {
    done.recv_timeout(PATIENCE)
}

/// Replays all machines of an archive on so many threads; the figures.
#[pyfunction]
pub(crate) fn replay_archive(
    py: Python<'_>,
    archive: PathBuf,
    results: PathBuf,
    given: Given,
    threads: Option<usize>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Shown> {
    let options = options(given)?;
    let figures = watched(py, progress, |watch| {
        archive::run(&archive, &results, &options, threads, watch)
    })?;
    shown(&figures)
}

/// Checks archive and results; name and task of each machine.
#[pyfunction]
pub(crate) fn archive_tasks(
    py: Python<'_>,
    archive: PathBuf,
    results: PathBuf,
    given: Given,
) -> PyResult<Vec<(String, Py<PyBytes>)>> {
    let options = options(given)?;
    let tasks = py.detach(|| archive::prepared(&archive, &results, &options));
    let bytes = |task: MachineTask| {
        let bytes = PyBytes::new(py, &to_bytes(&task)?).unbind();
        Ok((task.machine, bytes))
    };
    tasks.map_err(error)?.into_iter().map(bytes).collect()
}

/// Replays the machine of a task; its row.
#[pyfunction]
pub(crate) fn replay_task<'py>(py: Python<'py>, task: &[u8]) -> PyResult<Bound<'py, PyBytes>> {
    let task: MachineTask = from_bytes(task)?;
    let row = watched(py, None, |watch| archive::replay_machine(&task, watch))?;
    Ok(PyBytes::new(py, &to_bytes(&row)?))
}

/// Writes the tables and the page of all machines by their rows, after so many seconds; the figures.
#[pyfunction]
pub(crate) fn write_outcome(
    py: Python<'_>,
    results: PathBuf,
    rows: Vec<Vec<u8>>,
    page: bool,
    seconds: f64,
) -> PyResult<Shown> {
    let rows: PyResult<Vec<Overview>> = rows.iter().map(|row| from_bytes(row)).collect();
    let (rows, elapsed) = (
        rows?,
        Duration::try_from_secs_f64(seconds).unwrap_or_default(),
    );
    let figures = py.detach(|| archive::write_outcome(&results, rows, page, elapsed));
    shown(&figures.map_err(error)?)
}
