//! The command `loadtwin node`, which replaces the microcontroller: assembles samples from the raw
//! frames of a bus or log, steps the estimator on each, and sends load, sensor and status frames,
//! with a status frame after 0.1 s without a sample.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::frame::{FrameEncoder, RawAssembler, State, Status};
use loadtwin_common::io::raw::RawSample;
use serde::Serialize;

use super::bus::{Bus, BusError, Link, LinkCounts};
use super::live_display::{Page, View};
use super::{CanError, Model, standard, to_bus};

/// Time without a sample after which a status frame is sent (the heartbeat).
const HEARTBEAT: Duration = Duration::from_millis(100);

/// How a node runs.
#[derive(Clone, Debug, clap::Args)]
pub struct NodeArgs {
    /// Bus: an interface (can0), an adapter (`slcan:/dev/ttyACM0@500000`) or a log of raw samples
    #[arg(value_name = "SOURCE")]
    pub interface: String,
    /// Write all that the bus carries, and what the node sends, to a candump log
    #[arg(short = 'o', long = "log", value_name = "FILE")]
    pub log: Option<PathBuf>,
    /// End after so many seconds without a raw sample, once one has come
    #[arg(long, value_parser = super::seconds, value_name = "SECONDS")]
    pub idle: Option<Duration>,
}

/// What a node did.
#[derive(Clone, Debug, Serialize)]
pub struct NodeSummary {
    /// Samples that it stepped.
    pub samples: u64,
    /// Ticks missing between them.
    pub missing_ticks: u64,
    /// Samples of which a frame was lost or out of order.
    pub incomplete_samples: u64,
    /// Raw frames with a wrong check, content or length.
    pub damaged_frames: u64,
    /// Frames of others.
    pub foreign_frames: u64,
    /// What the bus did.
    pub bus: LinkCounts,
}

/// The application: the same line and the same encoder as on a board.
struct Node<'a> {
    line: Estimator<'a>,
    encoder: FrameEncoder,
    status: Status,
}

impl Node<'_> {
    /// One sample: steps the line and sends what is due.
    fn step<B: Bus>(
        &mut self,
        sample: &RawSample,
        link: &mut Link<B>,
        stop: &AtomicBool,
        page: &mut Page,
    ) -> Result<(), BusError> {
        let estimate = self.line.step(sample);
        self.status.missed = self.status.missed.saturating_add(estimate.lost);
        self.status.tick = sample.tick;
        self.status.sensors = estimate.sensors.len() as u8;
        self.status.state = if estimate.homed {
            State::Running
        } else {
            State::Homing
        };
        let mut due = heapless::Vec::<_, 16>::new();
        self.encoder
            .estimate(&estimate, |frame| due.extend([frame]));
        self.status.bus_off = link.counts().bus_off as u32;
        self.status.queue_overflow = link.counts().dropped as u32;
        due.extend(self.encoder.heartbeat(&self.status));
        for frame in due {
            link.send(&to_bus(&frame), stop)?;
        }
        page.estimate(&estimate);
        Ok(())
    }
}

/// Runs until `stop` is set, the user ends the view, the log ends, or no sample comes for
/// `args.idle`.
///
/// # Errors
/// When the model is refused or the bus fails for good.
pub fn run<B: Bus>(
    model: &Model<'_>,
    bus: B,
    args: &NodeArgs,
    view: &mut dyn View,
    stop: &AtomicBool,
) -> Result<NodeSummary, CanError> {
    let (line, encoder) = model.start()?;
    let mut node = Node {
        line,
        encoder,
        status: Status {
            state: State::Waiting,
            ..Status::new()
        },
    };
    let mut assembler = RawAssembler::new(node.encoder.base());
    // A frame older than the next heartbeat is of no use to anyone.
    let mut link = Link::new(bus, HEARTBEAT);
    let mut page = Page::new("node", model);
    let mut foreign = 0;
    let idle = args.idle;
    let mut last_sample = None;

    // Whoever listens knows from it that the line starts anew.
    let hello = node.encoder.status(&node.status);
    link.send(&to_bus(&hello), stop)?;
    let mut last_frame = link.bus().now();
    while !stop.load(Ordering::Relaxed) {
        match link.receive(HEARTBEAT) {
            Ok(Some(received)) => match standard(&received.frame) {
                Some((id, data)) => {
                    if let Some(sample) = assembler.push(id, data) {
                        node.step(&sample, &mut link, stop, &mut page)?;
                        last_frame = link.bus().now();
                        last_sample = Some(last_frame);
                    }
                }
                None => foreign += 1,
            },
            Ok(None) => {}
            Err(BusError::Ended) => break,
            Err(error) => return Err(error.into()),
        }
        let now = link.bus().now();
        if now.saturating_sub(last_frame) >= HEARTBEAT {
            let frame = node.encoder.status(&node.status);
            link.send(&to_bus(&frame), stop)?;
            last_frame = now;
        }
        if idle
            .zip(last_sample)
            .is_some_and(|(idle, last)| now.saturating_sub(last) > idle)
        {
            break;
        }
        if view.due(now) {
            page.count("samples", assembler.counts().samples);
            page.count("frames sent", link.counts().sent);
            page.count("bus-off", link.counts().bus_off);
            if view.show(&page).map_err(CanError::Terminal)?.is_break() {
                break;
            }
        }
    }
    link.bus_mut().finish()?;
    let raw = assembler.counts();
    Ok(NodeSummary {
        samples: raw.samples,
        missing_ticks: raw.lost,
        incomplete_samples: raw.incomplete,
        damaged_frames: raw.damaged,
        foreign_frames: foreign + link.bus().foreign(),
        bus: link.counts(),
    })
}
