//! The command `loadtwin monitor`: decodes a machine's load, sensor and status frames on a bus or
//! in a log for the display, and counts lost, repeated and damaged frames. With a model and `--web`
//! it also recomputes the frames and compares them.

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use loadtwin_common::io::frame;
use loadtwin_common::io::frame::e2e::{Counter, Sequence};
use loadtwin_common::io::frame::{
    BoardPage, DEFAULT_BASE, Message, RawAssembler, Rejected, Status, StatusPage,
};
use serde::Serialize;

use super::bus::{Bus, BusError, Link, LinkCounts, Received};
use super::frame_comparison::{Comparison, Verdict};
use super::live_display::{Page, View};
use super::{CanError, Model, firmware_version, standard};

/// How a bus is watched.
#[derive(Clone, Debug, clap::Args)]
pub struct MonitorArgs {
    /// Bus: an interface (can0), an adapter (`slcan:/dev/ttyACM0@500000`) or a log
    #[arg(value_name = "SOURCE")]
    pub interface: String,
    /// First identifier of the machine, hexadecimal; 500, or that of its model
    #[arg(long, value_parser = base, value_name = "HEX")]
    pub base: Option<u16>,
    /// End after so many seconds without a frame, once one has come
    #[arg(long, value_parser = super::seconds, value_name = "SECONDS")]
    pub idle: Option<Duration>,
    /// Serve a page for browsers at ADDR (a port, or an address with its port); only this machine
    /// reaches it unless ADDR says otherwise
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = "8080", value_parser = address)]
    pub web: Option<SocketAddr>,
    /// How many times faster than it was recorded a log is shown in browsers
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, requires = "web", value_parser = speed)]
    pub speed: f64,
}

impl MonitorArgs {
    /// Whether the estimates are recomputed where the model is known.
    fn compares(&self) -> bool {
        self.web.is_some()
    }
}

/// An address of the server: a port of this machine alone, or an address with a port.
fn address(text: &str) -> Result<SocketAddr, String> {
    let port = text
        .parse()
        .ok()
        .map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    port.or_else(|| text.parse().ok()).ok_or_else(|| {
        "allowed: a port (8080), or an address with a port (0.0.0.0:8080)".to_owned()
    })
}

/// A factor above 0.
fn speed(text: &str) -> Result<f64, String> {
    let speed = text
        .parse()
        .ok()
        .filter(|speed: &f64| *speed > 0.0 && speed.is_finite());
    speed.ok_or_else(|| "allowed: above 0".to_owned())
}

/// A base identifier from the command line.
fn base(text: &str) -> Result<u16, String> {
    u16::from_str_radix(text.trim_start_matches("0x"), 16)
        .ok()
        .filter(|base| *base <= frame::MAX_BASE && base % frame::IDS_PER_MACHINE == 0)
        .ok_or_else(|| "a multiple of 20 (hexadecimal), at most 7C0".to_owned())
}

/// What came by.
#[derive(Clone, Debug, Default, Serialize)]
pub struct MonitorSummary {
    /// Frames for each identifier of the machine.
    pub frames: BTreeMap<u16, u64>,
    /// Frames missing by their counters.
    pub lost_frames: u64,
    /// Frames sent twice.
    pub repeated_frames: u64,
    /// Frames whose check or content is wrong.
    pub damaged_frames: u64,
    /// Frames of another length or format.
    pub malformed_frames: u64,
    /// Frames of others.
    pub foreign_frames: u64,
    /// Error frames of the controller.
    pub error_frames: u64,
    /// Whole raw samples.
    pub samples: u64,
    /// Name of the model that the machine runs.
    pub machine_model: Option<u32>,
    /// Name of the model that was given, by which loads and sensors are named and scaled.
    pub given_model: Option<u32>,
    /// Version of the board's firmware.
    pub firmware: Option<String>,
    /// State of the machine.
    pub state: Option<&'static str>,
    /// What the bus did.
    pub bus: LinkCounts,
}

impl MonitorSummary {
    /// The model that the machine runs and the one given, where they differ.
    pub fn other_model(&self) -> Option<(u32, u32)> {
        let both = self.machine_model.zip(self.given_model);
        both.filter(|(machine, given)| machine != given)
    }
}

/// Watches until `stop` is set or the log ends.
///
/// # Errors
/// When the bus fails for good.
pub fn run<B: Bus>(
    model: Option<&Model<'_>>,
    bus: B,
    args: &MonitorArgs,
    view: &mut dyn View,
    stop: &AtomicBool,
) -> Result<MonitorSummary, CanError> {
    let base = args
        .base
        .or(model.map(|m| m.image.can_base))
        .unwrap_or(DEFAULT_BASE);
    let mut link = Link::new(bus, Duration::ZERO);
    // Recomputed beside it where the model is known.
    let comparison = match model.filter(|_| args.compares()) {
        Some(model) => Some(Comparison::new(model.clone())?),
        None => None,
    };
    let mut watch = Watch {
        base,
        page: model.map_or_else(
            || Page::empty("monitor"),
            |model| Page::new("monitor", model),
        ),
        counters: BTreeMap::new(),
        assembler: RawAssembler::new(base),
        status: None,
        summary: MonitorSummary {
            given_model: model.map(|model| model.hash),
            ..MonitorSummary::default()
        },
        comparison,
    };
    let mut last = None;
    while !stop.load(Ordering::Relaxed) {
        let received = match link.receive(Duration::from_millis(100)) {
            Ok(received) => received,
            Err(BusError::Ended) => break,
            Err(error) => return Err(error.into()),
        };
        let now = link.bus().now();
        if let Some(received) = received {
            last = Some(now);
            watch.take(&received, view);
        }
        let idle = args.idle;
        if idle
            .zip(last)
            .is_some_and(|(idle, last)| now.saturating_sub(last) > idle)
        {
            break;
        }
        if view.due(now) {
            watch.update_page(link.bus().foreign());
            if view
                .show(&watch.page)
                .map_err(CanError::Terminal)?
                .is_break()
            {
                break;
            }
        }
    }
    let mut summary = watch.summary;
    summary.samples = watch.assembler.counts().samples;
    summary.foreign_frames += link.bus().foreign();
    summary.state = watch.status.map(|status| status.state.name());
    summary.bus = link.counts();
    Ok(summary)
}

/// What was received so far.
struct Watch<'a> {
    base: u16,
    page: Page,
    counters: BTreeMap<u16, Counter>,
    assembler: RawAssembler,
    status: Option<Status>,
    summary: MonitorSummary,
    comparison: Option<Comparison<'a>>,
}

impl Watch<'_> {
    /// Decodes and counts one frame.
    fn take(&mut self, received: &Received, view: &mut dyn View) {
        if let Some(comparison) = &mut self.comparison {
            comparison.take(received);
        }
        match standard(&received.frame) {
            Some((id, data)) => self.decode(id, data, view),
            None if received.frame.is_error() => self.summary.error_frames += 1,
            None => self.summary.foreign_frames += 1,
        }
    }

    fn decode(&mut self, id: u16, data: &[u8], view: &mut dyn View) {
        self.assembler.push(id, data);
        // A raw sample's FD frame is the assembler's alone.
        let fd = id == self.base + frame::signal_layout::raw_fd::OFFSET;
        match frame::decode(self.base, id, data) {
            _ if fd => *self.summary.frames.entry(id).or_default() += 1,
            Ok((message, counter)) => {
                *self.summary.frames.entry(id).or_default() += 1;
                if let Some(counter) = counter {
                    match self.counters.entry(id).or_default().follow(counter) {
                        Sequence::Lost(lost) => self.summary.lost_frames += u64::from(lost),
                        Sequence::Repeated => self.summary.repeated_frames += 1,
                        Sequence::First | Sequence::Next => {}
                    }
                }
                self.show(message);
                if matches!(message, Message::Load(..) | Message::Sensor(..)) {
                    view.take(&self.page);
                }
            }
            Err(Rejected::Foreign) => self.summary.foreign_frames += 1,
            Err(Rejected::Length) => self.summary.malformed_frames += 1,
            Err(Rejected::Check | Rejected::Content) => self.summary.damaged_frames += 1,
        }
    }

    fn show(&mut self, message: Message) {
        match message {
            Message::Load(index, load) => self.page.load(index, &load),
            Message::Sensor(index, sensor) => self.page.sensor(index, &sensor),
            Message::Status(newer, page) => {
                self.status.get_or_insert_default().merge(&newer, page);
                if let StatusPage::Image(hash) = page {
                    self.summary.machine_model = Some(hash);
                }
            }
            Message::Board(info, BoardPage::Firmware) => {
                self.summary.firmware = Some(firmware_version(&info));
            }
            Message::Raw | Message::Board(..) => {}
        }
    }

    /// Brings state, verdict and counts on the page.
    fn update_page(&mut self, foreign: u64) {
        let (page, summary) = (&mut self.page, &self.summary);
        page.status(self.status);
        if let Some(comparison) = &self.comparison {
            page.verdict(comparison.verdict(false));
        } else if summary.other_model().is_some() {
            page.verdict(Verdict::OtherModel);
        }
        page.count("frames", summary.frames.values().sum());
        page.count("lost", summary.lost_frames);
        page.count("damaged", summary.damaged_frames + summary.malformed_frames);
        page.count("foreign", summary.foreign_frames + foreign);
        page.count("raw samples", self.assembler.counts().samples);
    }
}
