//! A replay on a thread of its own: recording in, estimates out, a few blocks at a time.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use arrow_array::{RecordBatch, RecordBatchReader};
use arrow_schema::{ArrowError, SchemaRef};
use loadtwin::build::{self, Sensors};
use loadtwin::machine::Machine;
use loadtwin::recording::{self, Batches, Input};
use loadtwin::replay::{EstimateRows, ReplayError, Run};

use crate::message;

/// Blocks of estimates ahead of whoever reads them.
const AHEAD: usize = 4;

/// A recording of a caller.
pub(crate) enum Source {
    File(PathBuf),
    Batches(Batches),
}

/// What is replayed.
pub(crate) struct Task {
    pub(crate) machine: Arc<Machine>,
    pub(crate) sensors: Sensors,
    pub(crate) source: Source,
    /// State after the part before.
    pub(crate) state: Option<Vec<u8>>,
    /// Whether another part follows.
    pub(crate) more: bool,
}

/// What is there at the end.
#[derive(Clone, Debug)]
pub(crate) struct End {
    /// The state; none where rows are resampled.
    pub(crate) state: Option<Vec<u8>>,
    /// How the recording was read, where it is not as usual.
    pub(crate) notes: Vec<String>,
}

/// The end of a replay, once it is there.
pub(crate) type SharedEnd = Arc<Mutex<Option<End>>>;

/// A replay at work. Dropped, it stops at the next block.
pub(crate) struct Worker {
    schema: SchemaRef,
    batches: Receiver<Result<RecordBatch, String>>,
    end: SharedEnd,
    ended: bool,
}

/// Why there is no batch.
pub(crate) enum Pause {
    /// None within the time.
    Waiting,
    /// The replay has ended.
    Ended,
    /// It failed.
    Failed(String),
}

impl Worker {
    pub(crate) fn start(task: Task) -> std::io::Result<Self> {
        let rows = EstimateRows::new(&task.machine, &task.sensors, None);
        let schema = Arc::new(recording::schema(rows.described()));
        let (sender, batches) = sync_channel(AHEAD);
        let end = SharedEnd::default();
        let at_end = Arc::clone(&end);
        std::thread::Builder::new()
            .name("replay".into())
            .spawn(move || match work(&task, rows, &sender) {
                Ok(found) => *at_end.lock().unwrap_or_else(PoisonError::into_inner) = found,
                Err(error) => {
                    let _ = sender.send(Err(message(&error)));
                }
            })?;
        Ok(Self {
            schema,
            batches,
            end,
            ended: false,
        })
    }

    pub(crate) fn schema(&self) -> SchemaRef {
        Arc::clone(&self.schema)
    }

    pub(crate) fn end(&self) -> SharedEnd {
        Arc::clone(&self.end)
    }

    /// The next batch, if there is one within `time`.
    pub(crate) fn next_within(&mut self, time: Duration) -> Result<RecordBatch, Pause> {
        if self.ended {
            return Err(Pause::Ended);
        }
        match self.batches.recv_timeout(time) {
            Ok(Ok(batch)) => Ok(batch),
            Err(RecvTimeoutError::Timeout) => Err(Pause::Waiting),
            Ok(Err(error)) => {
                self.ended = true;
                Err(Pause::Failed(error))
            }
            Err(RecvTimeoutError::Disconnected) => {
                self.ended = true;
                let end = self.end.lock().unwrap_or_else(PoisonError::into_inner);
                Err(if end.is_some() {
                    Pause::Ended
                } else {
                    Pause::Failed("the replay stopped; this is a defect of loadtwin".into())
                })
            }
        }
    }
}

impl Iterator for Worker {
    type Item = Result<RecordBatch, ArrowError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            return match self.next_within(Duration::from_secs(1)) {
                Ok(batch) => Some(Ok(batch)),
                Err(Pause::Waiting) => continue,
                Err(Pause::Ended) => None,
                Err(Pause::Failed(error)) => Some(Err(ArrowError::ExternalError(error.into()))),
            };
        }
    }
}

impl RecordBatchReader for Worker {
    fn schema(&self) -> SchemaRef {
        Self::schema(self)
    }
}

/// Replays `task`; none where nobody wants its estimates.
fn work(
    task: &Task,
    mut rows: EstimateRows,
    sender: &SyncSender<Result<RecordBatch, String>>,
) -> Result<Option<End>, ReplayError> {
    let Task {
        machine, sensors, ..
    } = task;
    let image = build::image(machine, sensors)?;
    let input = match &task.source {
        Source::File(path) => Input::from(path),
        Source::Batches(batches) => Input::Batches(batches),
    };
    let mut run = match &task.state {
        Some(state) => Run::continued(machine, sensors, &image, input, state)?,
        None => Run::open(machine, sensors, &image, input)?,
    };
    let deliver = |rows: &mut EstimateRows| {
        let batch = rows.take(recording::record_batch);
        sender
            .send(batch.map_err(|error| error.to_string()))
            .is_ok()
    };
    while run.next_block(|sample, estimate, line| rows.push(sample.t, estimate, line))? {
        if !deliver(&mut rows) {
            return Ok(None);
        }
    }
    let notes = run.notes();
    let state = run.save();
    // A state that was asked for has to be there.
    let state = if task.more { Some(state?) } else { state.ok() };
    if !task.more {
        run.finish(|sample, estimate, line| rows.push(sample.t, estimate, line));
    }
    if !rows.is_empty() && !deliver(&mut rows) {
        return Ok(None);
    }
    Ok(Some(End { state, notes }))
}
