//! Recorder: receives the frames of a machine, and hands rows and messages to the threads that
//! write and publish. Also here: the command-line options, the lock on the folder, and the start
//! and end of the threads.

use std::fs::{self, File, TryLockError};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;

use loadtwin_can::bus::{Bus, BusError, Link, Received};
use loadtwin_can::{CanError, Model, seconds, standard};
use loadtwin_common::io::frame::{self, Message, RawAssembler, RawCounts, Rejected};
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use serde::Serialize;

use super::RecordError;
use super::broker::Broker;
use super::bus_rows::{EstimateRows, Load, SampleRows, TICK};
use super::counts::Counts;
use super::message_store::MessageStore;
use super::own_files::OwnFiles;
use super::part_writer::{Kind, Part, PartWriter};
use super::publisher::{Publisher, Shared, locked};
use super::summary::Summary;
use super::telemetry::Telemetry;

/// How long the loop sleeps at most without a frame.
const POLL: Duration = Duration::from_millis(100);

/// Parts that wait for the disk at most.
const PARTS: usize = 8;

/// How a bus is recorded.
#[derive(Clone, Debug, clap::Args)]
pub struct RecordArgs {
    /// Bus: an interface (can0), an adapter (`slcan:/dev/ttyACM0@500000`) or a log
    #[arg(value_name = "SOURCE")]
    pub interface: String,
    /// Folder of the archive; made where absent
    #[arg(short, long, value_name = "ARCHIVE")]
    pub output: PathBuf,
    /// Name of the machine in the archive and in topics; that of the description where absent
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Seconds of a file: what is lost at most when power fails
    #[arg(long, value_name = "SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub every: u32,
    /// Most gigabytes on the disk: the oldest files that this recorder has written are deleted
    #[arg(long, value_name = "GB", default_value_t = 10.0, value_parser = gigabytes)]
    pub keep_gb: f64,
    /// Publish loads and health to a broker: `mqtt://[USER[:PASSWORD]@]HOST[:PORT]`
    #[arg(long, value_name = "URL")]
    pub mqtt: Option<Broker>,
    /// Most megabytes of messages on the disk while the broker is away
    #[arg(long, value_name = "MB", default_value_t = 64, requires = "mqtt", value_parser = clap::value_parser!(u32).range(1..))]
    pub store_mb: u32,
    /// End after so many seconds without a frame, once one has come
    #[arg(long, value_parser = seconds, value_name = "SECONDS")]
    pub idle: Option<Duration>,
}

fn gigabytes(text: &str) -> Result<f64, String> {
    let size = text.parse().ok();
    size.filter(|size: &f64| *size > 0.0 && size.is_finite())
        .ok_or_else(|| "allowed: above 0".to_owned())
}

/// What is printed at the end.
#[derive(Debug, Serialize)]
pub struct Recorded {
    /// Name of the machine.
    pub machine: String,
    /// Since the first start.
    #[serde(flatten)]
    pub counts: Counts,
    /// Messages that the broker does not have yet.
    pub messages_waiting: Option<u64>,
    /// Messages deleted to bound the disk, by this run.
    pub messages_dropped: Option<u64>,
}

/// The folder of a machine.
fn folder_name(machine: &str) -> Result<String, RecordError> {
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    let is_good = machine.starts_with(|c: char| c.is_ascii_alphanumeric());
    if is_good && machine.chars().all(is_allowed) && machine.len() <= 100 {
        Ok(format!("machine={machine}"))
    } else {
        Err(RecordError::Name(machine.to_owned()))
    }
}

/// Folder of the recorder, locked until the file is closed.
fn locked_folder(args: &RecordArgs, machine: &str) -> Result<(PathBuf, File), RecordError> {
    let folder = args.output.join("recorder").join(folder_name(machine)?);
    fs::create_dir_all(&folder).map_err(|error| RecordError::file(&folder, error))?;
    let path = folder.join("lock");
    let lock = File::create(&path).map_err(|error| RecordError::file(&path, error))?;
    match lock.try_lock() {
        Ok(()) => Ok((folder, lock)),
        Err(TryLockError::WouldBlock) => Err(RecordError::Locked(folder)),
        Err(TryLockError::Error(error)) => Err(RecordError::file(&path, error)),
    }
}

/// Records until `stop` is set, the log ends, or what `args` says; `warn` reports what fails meanwhile.
///
/// # Errors
/// When the archive cannot be written, or the bus fails for good.
pub fn run<B: Bus>(
    (machine, sensors, model): (&Machine, &Sensors, &Model<'_>),
    bus: B,
    args: &RecordArgs,
    stop: &AtomicBool,
    warn: &(dyn Fn(&str) + Sync),
) -> Result<Recorded, RecordError> {
    let name = args.name.clone().unwrap_or_else(|| machine.name.clone());
    let (folder, _lock) = locked_folder(args, &name)?;
    let summary = Summary::open(&folder.join("summary.json"), &args.output, &name)?;
    let samples = SampleRows::columns(machine, sensors);
    if samples.iter().filter(|column| column.name == TICK).count() > 1 {
        return Err(RecordError::Column(TICK));
    }
    let machine_folder = folder_name(&name)?;
    let folders = [Kind::Recordings, Kind::Estimates]
        .map(|kind| args.output.join(kind.folder()).join(&machine_folder));
    let own = OwnFiles::find(&folders, &summary.recorder)
        .map_err(|error| RecordError::file(&args.output, error))?;
    let mut writer = PartWriter {
        archive: args.output.clone(),
        machine_folder,
        machine_name: machine.name.clone(),
        samples,
        estimates: EstimateRows::columns(machine),
        most_bytes: (args.keep_gb * 1e9) as u64,
        summary,
        own,
    };
    writer.summary.sequence = writer.summary.sequence.max(writer.own.next_sequence());
    // That the archive can be written shows at once.
    writer.summary.save()?;
    let shared = shared(args, &folder)?;
    let topic = format!("loadtwin/{name}");
    let telemetry = shared.as_ref().map(|shared| {
        let loads = machine.loads();
        let loads = loads
            .iter()
            .map(|load| (load.name.to_owned(), load.unit.to_string()));
        Telemetry::new(shared, topic.clone(), loads.collect(), sensors.names())
    });
    let publisher = (args.mqtt.as_ref().zip(shared.as_ref())).map(|(broker, shared)| Publisher {
        broker: broker.clone(),
        client: format!("loadtwin-{}", writer.summary.recorder),
        health_topic: format!("{topic}/health"),
        shared,
    });
    let (sender, parts) = sync_channel(PARTS);
    let mut recorder = Recorder {
        model,
        base: model.image.can_base,
        load_log2: model.start()?.1.load_every_log2(),
        assembler: RawAssembler::new(model.image.can_base),
        raw: RawCounts::default(),
        samples: SampleRows::new(machine, sensors, writer.summary.progress.clock),
        estimates: EstimateRows::new(machine.loads().len()),
        telemetry,
        parts: sender,
        warn,
    };
    let (result, summary) = thread::scope(|scope| {
        let writing = scope.spawn(move || writer.run(&parts, warn));
        let publishing = publisher.as_ref().map(|p| scope.spawn(|| p.run(warn)));
        let result = recorder.receive(bus, args, stop);
        drop(recorder);
        if let Some(shared) = &shared {
            shared.ending.store(true, Ordering::Relaxed);
        }
        let summary = writing.join();
        let _ = publishing.map(thread::ScopedJoinHandle::join);
        (result, summary)
    });
    result?;
    let summary = summary.map_err(|_| {
        RecordError::file(
            &args.output,
            std::io::Error::other("the writing thread failed"),
        )
    })?;
    let store = shared.as_ref().map(|shared| locked(&shared.store));
    Ok(Recorded {
        machine: name,
        counts: summary.progress.counts,
        messages_waiting: store.as_ref().map(|store| store.waiting()),
        messages_dropped: store.as_ref().map(|store| store.dropped),
    })
}

/// What is shared with the publisher, where there is one.
fn shared(args: &RecordArgs, folder: &std::path::Path) -> Result<Option<Shared>, RecordError> {
    if args.mqtt.is_none() {
        return Ok(None);
    }
    let folder = folder.join("messages");
    let store = MessageStore::open(&folder, u64::from(args.store_mb) << 20)
        .map_err(|error| RecordError::file(&folder, error))?;
    Ok(Some(Shared {
        store: Mutex::new(store),
        health: Mutex::new(None),
        ending: AtomicBool::new(false),
    }))
}

struct Recorder<'a> {
    model: &'a Model<'a>,
    base: u16,
    load_log2: u32,
    assembler: RawAssembler,
    raw: RawCounts,
    samples: SampleRows,
    estimates: EstimateRows,
    telemetry: Option<Telemetry<'a>>,
    parts: SyncSender<Part>,
    warn: &'a (dyn Fn(&str) + Sync),
}

impl Recorder<'_> {
    fn receive<B: Bus>(
        &mut self,
        bus: B,
        args: &RecordArgs,
        stop: &AtomicBool,
    ) -> Result<(), CanError> {
        let mut link = Link::new(bus, Duration::ZERO);
        let every = Duration::from_secs(args.every.into());
        let mut since = link.bus().now();
        let mut last = None;
        let ended = loop {
            if stop.load(Ordering::Relaxed) {
                break Ok(());
            }
            let received = match link.receive(POLL) {
                Ok(received) => received,
                Err(BusError::Ended) => break Ok(()),
                // What came before is written.
                Err(error) => break Err(error.into()),
            };
            let now = link.bus().now();
            if let Some(received) = received {
                last = Some(now);
                self.take(&received);
            }
            if now.saturating_sub(since) >= every {
                since = now;
                self.end_parts();
            }
            let is_idle = args.idle.zip(last);
            if is_idle.is_some_and(|(idle, last)| now.saturating_sub(last) > idle) {
                break Ok(());
            }
        };
        self.end_parts();
        ended
    }

    fn end_parts(&mut self) {
        let (samples, estimates) = (self.samples.take(), self.estimates.take());
        self.hand(samples);
        if !estimates.t.is_empty() {
            self.hand(estimates);
        }
    }

    /// Hands a part to the writer. Where the disk is too slow its rows are not written.
    fn hand(&mut self, part: Part) {
        if let Err(TrySendError::Full(part)) = self.parts.try_send(part) {
            (self.warn)(&format!(
                "the disk is too slow: {} rows not written",
                part.t.len()
            ));
            let empty = Part {
                t: Vec::new(),
                columns: Vec::new(),
                written: part.not_written,
                ..part
            };
            // Waits for the disk.
            let _ = self.parts.send(empty);
        }
    }

    fn take(&mut self, received: &Received) {
        let Some((id, data)) = standard(&received.frame) else {
            return;
        };
        let now_s = received.t_us as f64 * 1e-6;
        if let Some(sample) = self.assembler.push(id, data) {
            let mut ended = None;
            self.samples.push(&sample, now_s, |part| ended = Some(part));
            if let Some(part) = ended {
                self.hand(part);
            }
        }
        let raw = self.assembler.counts();
        let damaged = |counts: RawCounts| counts.damaged + counts.incomplete;
        self.samples.counts.damaged += damaged(raw) - damaged(self.raw);
        self.raw = raw;
        let is_fd = id == self.base + frame::signal_layout::raw_fd::OFFSET;
        self.samples.counts.frames += u64::from(is_fd);
        match frame::decode(self.base, id, data) {
            _ if is_fd => {}
            Ok((message, counter)) => {
                self.samples.counts.frames += 1;
                self.message(message, counter, now_s);
            }
            Err(Rejected::Foreign) => {}
            Err(_) => self.samples.counts.damaged += 1,
        }
        if let Some(telemetry) = &mut self.telemetry
            && let Err(error) = telemetry.tick(now_s as u64)
        {
            (self.warn)(&format!("--mqtt: messages of a second not stored: {error}"));
        }
    }

    fn message(&mut self, message: Message, counter: Option<u8>, now_s: f64) {
        let telemetry = self.telemetry.as_mut();
        match message {
            Message::Load(index, frame) => {
                let loads = self.model.image.loads();
                let Some(full_scale) = loads.get(index).map(|load| load.full_scale) else {
                    return;
                };
                let load = Load::of(&frame, f64::from(full_scale));
                if let Some(telemetry) = telemetry {
                    telemetry.load(index, &load);
                }
                let counter = counter.unwrap_or(0);
                let t = self
                    .samples
                    .time_of(counter, self.load_log2)
                    .filter(|t| (t - now_s).abs() < 60.0);
                let mut ended = None;
                let (key, t) = ((index, counter), t.unwrap_or(now_s));
                self.estimates.push(key, load, t, |part| ended = Some(part));
                if let Some(part) = ended {
                    self.hand(part);
                }
            }
            Message::Sensor(index, frame) => {
                if let Some(telemetry) = telemetry {
                    telemetry.sensor(index, &frame);
                }
            }
            Message::Status(status, page) => {
                if let Some(telemetry) = telemetry {
                    telemetry.status(&status, page);
                }
            }
            Message::Raw | Message::Board(..) => {}
        }
    }
}
