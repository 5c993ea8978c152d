//! Replays a recording on a thread of its own (`Worker`): a file or Arrow batches in, record
//! batches of estimates out by a queue of four. At the end it gives the estimator's state, with
//! which the next part goes on, and notes on how the recording was read.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use arrow_array::{RecordBatch, RecordBatchReader};
use arrow_schema::{ArrowError, SchemaRef};
use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::Machine;
use loadtwin::recording::{self, Batches, Input};
use loadtwin::replay::{EstimateRows, ReplayError, Run, Sample};
use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::estimate::Estimate;

use crate::replay_threads::{self, Stop};
use loadtwin::archive::message;

/// Blocks of estimates ahead of whoever reads them.
const AHEAD: usize = 4;

/// How often a full queue is tried again.
const RETRY: Duration = Duration::from_millis(1);

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
    /// The state; none where rows are resampled, or where the last estimates that lag were given.
    pub(crate) state: Option<Vec<u8>>,
    /// How the recording was read, where it is not as usual.
    pub(crate) notes: Vec<String>,
}

/// The end of a replay, once it is there.
pub(crate) type SharedEnd = Arc<Mutex<Option<End>>>;

/// A replay at work. Dropped, it stops at the next block.
pub(crate) struct Worker {
    stop: Stop,
    /// The process with its thread.
    process: u32,
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
    /// Starts `task`; its recording ends at `stop`.
    pub(crate) fn start(task: Task, stop: Stop) -> std::io::Result<Self> {
        let rows = EstimateRows::new(&task.machine, &task.sensors, None);
        let schema = Arc::new(recording::schema(rows.described()));
        let (sender, batches) = sync_channel(AHEAD);
        let end = SharedEnd::default();
        let at_end = Arc::clone(&end);
        let queue = Queue {
            sender,
            stop: stop.clone(),
        };
        let thread = thread::Builder::new()
            .name("replay".into())
            .spawn(move || match work(task, rows, &queue) {
                Ok(found) => *at_end.lock().unwrap_or_else(PoisonError::into_inner) = found,
                Err(reason) => {
                    queue.send(Err(reason));
                }
            })?;
        replay_threads::add(stop.clone(), thread);
        Ok(Self {
            stop,
            process: std::process::id(),
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
        if self.process != std::process::id() {
            const FORKED: &str =
                "a stream is read in the process that made it; start one after the fork";
            return Err(Pause::Failed(FORKED.into()));
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

impl Drop for Worker {
    fn drop(&mut self) {
        self.stop.set();
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

/// Where batches wait for their reader.
struct Queue {
    sender: SyncSender<Result<RecordBatch, String>>,
    stop: Stop,
}

impl Queue {
    /// Adds a batch; false where nobody reads any more, or the replay is stopped.
    fn send(&self, batch: Result<RecordBatch, String>) -> bool {
        let mut waiting = batch;
        loop {
            match self.sender.try_send(waiting) {
                Ok(()) => return true,
                Err(TrySendError::Disconnected(_)) => return false,
                Err(TrySendError::Full(batch)) => waiting = batch,
            }
            if self.stop.is_set() {
                return false;
            }
            thread::sleep(RETRY);
        }
    }
}

/// Gathers what a replay gives, row by row.
struct Gathered(EstimateRows);

impl Gathered {
    fn push(&mut self, sample: &Sample<'_>, estimate: &Estimate, line: &Estimator<'_>) {
        self.0.push(sample.t, estimate, line);
    }

    fn deliver(&mut self, queue: &Queue) -> bool {
        let batch = self.0.take(recording::record_batch);
        queue.send(batch.map_err(|error| error.to_string()))
    }
}

/// Replays `task`; none where nobody wants its estimates.
///
/// # Errors
/// In words.
fn work(task: Task, rows: EstimateRows, queue: &Queue) -> Result<Option<End>, String> {
    let said = |error: ReplayError| message(&error);
    let (machine, sensors) = (&task.machine, &task.sensors);
    let image = image_build::image(machine, sensors).map_err(|error| message(&error))?;
    let mut gathered = Gathered(rows);
    let input = match &task.source {
        Source::File(path) => Input::from(path),
        Source::Batches(batches) => Input::Batches(batches),
    };
    let run = match &task.state {
        Some(state) => Run::continued(machine, sensors, &image, input, state),
        None => Run::open(machine, sensors, &image, input),
    };
    let mut run = run.map_err(said)?;
    while run
        .next_block(|sample, estimate, line| gathered.push(sample, estimate, line))
        .map_err(said)?
    {
        if !gathered.deliver(queue) {
            return Ok(None);
        }
    }
    let notes = run.notes();
    // A state that was asked for has to be there.
    let state = if task.more {
        Some(run.save().map_err(said)?)
    } else {
        // Given below, the estimates that lag would be given once more by the part after.
        run.save().ok().filter(|_| !run.lags())
    };
    if !task.more {
        run.finish(|sample, estimate, line| gathered.push(sample, estimate, line));
    }
    if !gathered.0.is_empty() && !gathered.deliver(queue) {
        return Ok(None);
    }
    Ok(Some(End { state, notes }))
}
