//! The commands `loadtwin twin` (on a bus, also with a log file as output) and `loadtwin prove` (a
//! log to its end): pass a machine's frames to `frame_comparison.rs`, which compares them bit for
//! bit with recomputed ones, show the progress, and return verdict and counts. A log with malformed
//! lines is never identical.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::isotp::single_frame;
use loadtwin_common::io::uds;
use serde::Serialize;

use super::bus::{Bus, BusError, Link, LinkCounts};
use super::frame_comparison::{Comparison, Figures, Verdict};
use super::frame_source::Source;
use super::live_display::{Page, View};
use super::log::LogWriter;
use super::{CanError, Model, to_bus};

/// How long the loop sleeps at most without a frame.
const POLL: Duration = Duration::from_millis(100);

/// How a twin runs.
#[derive(Clone, Debug, clap::Args)]
pub struct TwinArgs {
    /// Bus: an interface (can0), an adapter (`slcan:/dev/ttyACM0@500000`) or a log
    #[arg(value_name = "SOURCE")]
    pub interface: String,
    /// Write what the bus carries for the machine to a candump log
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
    /// End after so many seconds without a frame, once one has come
    #[arg(long, value_parser = super::seconds, value_name = "SECONDS")]
    pub idle: Option<Duration>,
    /// End after so many raw samples
    #[arg(long, value_name = "N")]
    pub samples: Option<u64>,
    /// Ask the board for a burst of so many raw samples and end with it; its estimator starts anew
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=65534))]
    pub burst: Option<u16>,
    /// Share of the bus that the burst may take (%)
    #[arg(long, value_name = "PERCENT", default_value_t = 50, requires = "burst",
          value_parser = clap::value_parser!(u8).range(1..=100))]
    pub share: u8,
    /// The burst as FD frames, on a bus where every node takes them
    #[arg(long, requires = "burst")]
    pub fd: bool,
}

impl TwinArgs {
    /// The request for a burst.
    fn request(&self) -> Option<Frame> {
        burst_request(self.burst?, self.share, self.fd)
    }
}

/// The request for a burst of `samples` raw samples at a `share` of the bus (%).
pub(crate) fn burst_request(samples: u16, share: u8, fd: bool) -> Option<Frame> {
    let [high, low] = samples.to_be_bytes();
    let [service, kind, routine_high, routine_low] = uds::BURST_ROUTINE;
    let share = share | if fd { 0x80 } else { 0 };
    let message = [service, kind, routine_high, routine_low, high, low, share];
    let data = single_frame(&message)?;
    let id = uds::REQUEST_ID;
    Some(Frame { id, data })
}

/// How a log is proved.
#[derive(Clone, Debug, clap::Args)]
pub struct ProveArgs {
    /// Log (candump, ASC, BLF, TRC), or a bus as of twin
    #[arg(value_name = "SOURCE")]
    pub log: String,
    /// Only the frames of this interface or channel of a log
    #[arg(long)]
    pub interface: Option<String>,
}

/// What a twin found.
#[derive(Clone, Debug, Serialize)]
pub struct TwinSummary {
    /// The verdict.
    pub verdict: Verdict,
    /// Name of the model used here.
    pub model: u32,
    /// The figures behind it.
    #[serde(flatten)]
    pub figures: Figures,
    /// What the bus did.
    pub bus: LinkCounts,
    /// Lines of the log that are no frame; damaged or missing containers of a BLF log.
    pub malformed_lines: u64,
    /// The first of them.
    pub first_malformed_line: Option<u64>,
}

/// Compares until `stop` is set, the user ends the view, the log ends, or the limits of `args` are
/// reached.
///
/// # Errors
/// When the model is refused, the log cannot be written, or the bus fails for good.
pub fn run<B: Bus>(
    model: &Model<'_>,
    bus: B,
    args: &TwinArgs,
    view: &mut dyn View,
    stop: &AtomicBool,
) -> Result<TwinSummary, CanError> {
    let mut writer = match &args.log {
        Some(path) => Some(LogWriter::create(
            path,
            Source::of(&args.interface)?.device(),
        )?),
        None => None,
    };
    let mut link = Link::new(bus, POLL);
    if let Some(request) = args.request() {
        link.send(&to_bus(&request), stop)?;
    }
    let mut last = None;
    let most = args.samples.or(args.burst.map(u64::from));
    let summary = compare(model, &mut link, view, |link, received, figures| {
        let now = link.bus().now();
        if let Some(received) = received {
            last = Some(now);
            if let Some(writer) = &mut writer {
                writer.write(received)?;
            }
        }
        let idle = args.idle;
        let quiet = idle
            .zip(last)
            .is_some_and(|(idle, last)| now.saturating_sub(last) > idle);
        let enough =
            most.is_some_and(|most| figures.samples >= most && figures.waiting_frames == 0);
        Ok(!quiet && !enough && !stop.load(Ordering::Relaxed))
    })?;
    if let Some(writer) = writer {
        writer.finish()?;
    }
    Ok(summary)
}

/// Compares a log recorded earlier; a bus until `stop` is set.
///
/// # Errors
/// When the model is refused, or the log cannot be read or is none.
pub fn prove(
    model: &Model<'_>,
    args: &ProveArgs,
    view: &mut dyn View,
    stop: &AtomicBool,
) -> Result<TwinSummary, CanError> {
    let source = Source::of(&args.log)?;
    let bus = source.open(Some(model.image.can_base), args.interface.as_deref())?;
    let mut link = Link::new(bus, POLL);
    compare(model, &mut link, view, |_, _, _| {
        Ok(!stop.load(Ordering::Relaxed))
    })
}

fn compare<B: Bus>(
    model: &Model<'_>,
    link: &mut Link<B>,
    view: &mut dyn View,
    mut more: impl FnMut(&Link<B>, Option<&super::bus::Received>, &Progress) -> Result<bool, CanError>,
) -> Result<TwinSummary, CanError> {
    let mut comparison = Comparison::new(model.clone())?;
    let mut page = Page::new("twin", model);
    loop {
        let received = match link.receive(POLL) {
            Ok(received) => received,
            Err(BusError::Ended) => break,
            Err(error) => return Err(error.into()),
        };
        if let Some(received) = &received {
            comparison.take(received);
        }
        if !more(link, received.as_ref(), &comparison.progress())? {
            break;
        }
        if view.due(link.bus().now()) {
            fill(&mut page, &comparison);
            if view.show(&page).map_err(CanError::Terminal)?.is_break() {
                break;
            }
        }
    }
    let mut figures = comparison.figures();
    figures.foreign_frames += link.bus().foreign();
    let (malformed_lines, first_malformed_line) = link.bus().malformed();
    // What could not be read may have been a frame of the machine.
    let verdict = match comparison.verdict(true) {
        Verdict::Identical if malformed_lines > 0 => Verdict::Incomplete,
        verdict => verdict,
    };
    Ok(TwinSummary {
        verdict,
        model: model.hash,
        figures,
        bus: link.counts(),
        malformed_lines,
        first_malformed_line,
    })
}

/// Figures by which the end of a comparison is decided.
pub use super::frame_comparison::Progress;

fn fill(page: &mut Page, comparison: &Comparison<'_>) {
    let figures = comparison.figures();
    page.estimate(comparison.estimate());
    page.status(comparison.status());
    page.verdict(comparison.verdict(false));
    page.count("samples", figures.samples);
    page.count("frames compared", figures.compared_frames);
    page.count("bits differing", figures.differing_bits);
    page.count("frames lost", figures.lost_frames);
    page.count("ticks missing", figures.missing_ticks);
    page.count("damaged", figures.damaged_frames + figures.malformed_frames);
    page.lag(figures.lag_mean_ms, figures.lag_max_ms);
    if let Some(first) = &figures.first_difference {
        page.note(format!(
            "first difference: tick {}, {:03X}: {}",
            first.tick, first.id, first.what
        ));
    }
}
