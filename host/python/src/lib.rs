//! The compiled module `_loadtwin` of the Python package `loadtwin`: machine descriptions, replays
//! as streams of estimates, archives, and functions that run a command or write Parquet.
//!
//! Estimators run here, on streams of Arrow; the other commands run as a program of their own,
//! by `program`, so that an interrupt ends them.
#![expect(
    clippy::needless_pass_by_value,
    reason = "PyO3 hands over what it converted, `map_err` its error"
)]

mod archive;
mod capsule;
mod replay_threads;
mod replay_worker;

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use arrow_array::{RecordBatch, RecordBatchIterator};
use arrow_schema::SchemaRef;
use loadtwin::archive::message;
use loadtwin::image_build::{Filter, Sensors};
use loadtwin::machine::Machine;
use pyo3::create_exception;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyCapsule};

use replay_threads::Stop;
use replay_worker::{Pause, SharedEnd, Source, Task, Worker};

create_exception!(
    loadtwin,
    Error,
    PyValueError,
    "What cannot be done with this input: where, what was found, what is allowed."
);

/// Time after which an interrupt is looked for.
const PATIENCE: Duration = Duration::from_millis(50);

fn error(error: impl std::error::Error) -> PyErr {
    Error::new_err(message(&error))
}

/// A machine by its description.
#[pyclass(name = "Description", frozen)]
struct Description(Arc<Machine>);

#[pymethods]
impl Description {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let machine = py.detach(|| Machine::load(&path)).map_err(error)?;
        Ok(Self(Arc::new(machine)))
    }

    /// Name of the machine.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Samples a second.
    #[getter]
    fn rate_hz(&self) -> f64 {
        self.0.rate_hz
    }

    /// Name and unit of each load.
    #[getter]
    fn loads(&self) -> Vec<(String, String)> {
        let loads = self.0.loads().into_iter();
        loads
            .map(|load| (load.name.to_owned(), load.unit.to_string()))
            .collect()
    }

    /// Starts a replay.
    fn stream(
        &self,
        py: Python<'_>,
        recording: &Bound<'_, PyAny>,
        state: Option<Vec<u8>>,
        sensors: Option<&str>,
        filter: &str,
        more: bool,
    ) -> PyResult<Stream> {
        let filter = match filter {
            "aekf" => Filter::Aekf,
            "steady" => Filter::Steady,
            found => {
                return Err(Error::new_err(format!(
                    "filter: found {found:?}, allowed: \"aekf\", \"steady\""
                )));
            }
        };
        let sensors = Sensors::choose(&self.0, sensors).map_err(error)?;
        let stop = Stop::default();
        let source = match recording.extract::<PathBuf>() {
            Ok(path) => Source::File(path),
            Err(_) => Source::Batches(capsule::import(recording, &stop)?),
        };
        let task = Task {
            machine: Arc::clone(&self.0),
            sensors: sensors.filtered_by(filter),
            source,
            state,
            more,
        };
        let worker = py.detach(|| Worker::start(task, stop))?;
        Ok(Stream {
            end: worker.end(),
            schema: worker.schema(),
            worker: Mutex::new(Some(worker)),
        })
    }
}

/// Estimates of a replay, read once while it goes on.
#[pyclass(frozen)]
struct Stream {
    worker: Mutex<Option<Worker>>,
    schema: SchemaRef,
    end: SharedEnd,
}

impl Stream {
    fn take(&self) -> PyResult<Worker> {
        let mut worker = self.worker.lock().unwrap_or_else(PoisonError::into_inner);
        let read = || PyRuntimeError::new_err("a stream is read once; start a new one");
        worker.take().ok_or_else(read)
    }
}

#[pymethods]
impl Stream {
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        // A request that cannot be met may be left aside.
        drop(requested_schema);
        capsule::export(py, Box::new(self.take()?))
    }

    /// All estimates, in memory.
    fn collect(&self, py: Python<'_>) -> PyResult<Estimates> {
        let mut worker = self.take()?;
        let mut batches = Vec::new();
        loop {
            match py.detach(|| worker.next_within(PATIENCE)) {
                Ok(batch) => batches.push(batch),
                Err(Pause::Waiting) => {}
                Err(Pause::Ended) => break,
                Err(Pause::Failed(message)) => return Err(Error::new_err(message)),
            }
            py.check_signals()?;
        }
        Ok(Estimates {
            schema: Arc::clone(&self.schema),
            batches,
        })
    }

    /// The state at the end; none before it, where rows are resampled, or where estimates lag and no
    /// other part follows.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyBytes>> {
        let end = self.end.lock().unwrap_or_else(PoisonError::into_inner);
        Some(PyBytes::new(py, end.as_ref()?.state.as_ref()?))
    }

    /// How the recording was read, where it is not as usual.
    #[getter]
    fn notes(&self) -> Vec<String> {
        let end = self.end.lock().unwrap_or_else(PoisonError::into_inner);
        end.as_ref().map_or(Vec::new(), |end| end.notes.clone())
    }
}

/// Estimates of a replay, in memory.
#[pyclass(frozen)]
struct Estimates {
    schema: SchemaRef,
    batches: Vec<RecordBatch>,
}

#[pymethods]
impl Estimates {
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        drop(requested_schema);
        let batches = self.batches.clone().into_iter().map(Ok);
        let reader = RecordBatchIterator::new(batches, Arc::clone(&self.schema));
        capsule::export(py, Box::new(reader))
    }

    fn __len__(&self) -> usize {
        self.batches.iter().map(RecordBatch::num_rows).sum()
    }

    /// Names of the columns.
    #[getter]
    fn columns(&self) -> Vec<String> {
        let fields = self.schema.fields().iter();
        fields.map(|field| field.name().clone()).collect()
    }

    /// Unit of each column by its name.
    #[getter]
    fn units(&self) -> Vec<(String, String)> {
        let fields = self.schema.fields().iter();
        let unit = |field: &arrow_schema::FieldRef| {
            Some((field.name().clone(), field.metadata().get("unit")?.clone()))
        };
        fields.filter_map(unit).collect()
    }
}

/// Runs the command line `arguments`, the program's name first; its exit code.
#[pyfunction]
fn program(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| loadtwin::cli::program(arguments))
}

/// Writes a table or stream to a Parquet file.
#[pyfunction]
fn write_parquet(py: Python<'_>, table: &Bound<'_, PyAny>, path: PathBuf) -> PyResult<()> {
    let batches = capsule::import(table, &Stop::default())?;
    py.detach(|| batches.write_parquet(&path)).map_err(error)
}

/// Ends all replays that still run: a thread that holds objects of Python must not outlive it.
#[pyfunction]
fn end_all(py: Python<'_>) {
    py.detach(replay_threads::end_all);
}

/// Forgets all replays, in a process that was forked: their threads are not in it.
#[pyfunction]
fn forget_all() {
    replay_threads::forget_all();
}

#[pymodule]
mod _loadtwin {
    #[pymodule_export]
    use super::archive::{archive_tasks, replay_archive, replay_task, write_outcome};

    #[pymodule_export]
    use super::{
        Description, Error, Estimates, Stream, end_all, forget_all, program, write_parquet,
    };

    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "its name in Python")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
