//! The command `loadtwin send`: sends raw samples as CAN or CAN FD frames, at the model's sample
//! rate or as fast as the bus accepts them. In lock-step it waits for the load frames of the
//! receiver. Output: counts and the largest delay.

use std::error::Error;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use loadtwin_common::io::frame;
use loadtwin_common::io::frame::{FrameEncoder, Message};
use loadtwin_common::io::raw::RawSample;
use serde::Serialize;

use super::bus::{Bus, BusError, Link, LinkCounts};
use super::live_display::{Page, View};
use super::{CanError, Model, standard, to_bus, to_bus_fd};

/// How long to wait for the machine's answer in lock-step.
const ANSWER: Duration = Duration::from_secs(1);

/// How samples are sent.
#[derive(Clone, Debug, clap::Args)]
pub struct SendArgs {
    /// Bus: an interface (can0) or an adapter (`slcan:/dev/ttyACM0@500000`); none with --log
    #[arg(value_name = "SOURCE", required_unless_present = "log")]
    pub interface: Option<String>,
    /// Write what is sent to a candump log
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
    /// As fast as the bus takes them instead of in real time
    #[arg(long)]
    pub fast: bool,
    /// One FD frame of 64 bytes for each sample instead of classic frames
    #[arg(long)]
    pub fd: bool,
    /// With so many samples at most before the machine has answered with its
    /// load frames
    #[arg(long, value_name = "SAMPLES", requires = "interface")]
    pub lockstep: Option<u32>,
}

/// Summary of the samples sent.
#[derive(Clone, Debug, Serialize)]
pub struct SendSummary {
    /// Samples whose frames all went out.
    pub samples: u64,
    /// Samples of which a frame was given up.
    pub incomplete_samples: u64,
    /// Time taken (s).
    pub seconds: f64,
    /// Largest delay of a sample behind its time (ms); 0 when not in real time.
    pub late_max_ms: f64,
    /// Times that no answer came in lock-step.
    pub unanswered: u64,
    /// What the bus did.
    pub bus: LinkCounts,
}

/// Follows the machine's load frames.
struct Answers {
    base: u16,
    every: u32,
    /// Number of the last answer.
    last: Option<u32>,
}

impl Answers {
    fn take(&mut self, frame: &super::bus_frame::BusFrame) {
        let Some((id, data)) = standard(frame) else {
            return;
        };
        if let Ok((Message::Load(0, _), Some(counter))) = frame::decode(self.base, id, data) {
            let last = self.last.unwrap_or(u32::MAX);
            let step = counter.wrapping_sub(last as u8);
            self.last = Some(last.wrapping_add(u32::from(step)));
        }
    }

    /// Waits until at most `window` samples before sample `number` are open; how often in vain.
    fn wait<B: Bus>(
        &mut self,
        link: &mut Link<B>,
        number: u32,
        window: u32,
        stop: &AtomicBool,
    ) -> Result<u64, CanError> {
        let window = window.max(1 << self.every);
        let deadline = link.bus().now() + ANSWER;
        let mut unanswered = 0;
        while self.open(number) > window && !stop.load(Ordering::Relaxed) {
            match link.receive(Duration::from_millis(20)) {
                Ok(Some(received)) => self.take(&received.frame),
                Ok(None) if link.bus().now() > deadline => {
                    unanswered += 1;
                    // Goes on from here: what was not answered will not be.
                    self.last = Some(number >> self.every);
                }
                Ok(None) => {}
                Err(BusError::Ended) => break,
                Err(error) => return Err(error.into()),
            }
        }
        Ok(unanswered)
    }

    /// Samples after the last one answered, when `sent` is the last one sent.
    fn open(&self, sent: u32) -> u32 {
        let answered = self.last.map_or(0, |last| (last + 1) << self.every);
        (sent + 1).saturating_sub(answered)
    }
}

/// Sends the frames of one sample; whether all were sent.
fn send_sample<B: Bus>(
    link: &mut Link<B>,
    encoder: &FrameEncoder,
    sample: &RawSample,
    fd: bool,
    stop: &AtomicBool,
) -> Result<bool, CanError> {
    if fd {
        return Ok(link.send(&to_bus_fd(&encoder.raw_fd(sample)), stop)?);
    }
    let mut frames = heapless::Vec::<_, 7>::new();
    encoder.raw(sample, |frame| frames.extend([frame]));
    let mut whole = true;
    for frame in frames {
        whole = whole && link.send(&to_bus(&frame), stop)?;
    }
    Ok(whole)
}

/// Sends samples until they end or `stop` is set.
///
/// # Errors
/// When the samples cannot be read or the bus fails for good.
pub fn run<B: Bus>(
    model: &Model<'_>,
    bus: B,
    samples: impl IntoIterator<Item = Result<RawSample, Box<dyn Error + Send + Sync>>>,
    args: &SendArgs,
    view: &mut dyn View,
    stop: &AtomicBool,
) -> Result<SendSummary, CanError> {
    let encoder = FrameEncoder::try_build(&model.image, model.hash)?;
    let period = Duration::from_secs_f32(1.0 / model.image.rate_hz);
    let mut link = Link::new(bus, Duration::from_secs(10));
    let mut page = Page::new("send", model);
    let mut answers = Answers {
        base: encoder.base(),
        every: encoder.load_every_log2(),
        last: None,
    };
    let start = link.bus().now();
    let mut summary = SendSummary {
        samples: 0,
        incomplete_samples: 0,
        seconds: 0.0,
        late_max_ms: 0.0,
        unanswered: 0,
        bus: LinkCounts::default(),
    };
    for (number, sample) in samples.into_iter().enumerate() {
        let sample = sample.map_err(CanError::Samples)?;
        if stop.load(Ordering::Relaxed) {
            break;
        }
        if !args.fast {
            let due = start + period * number as u32;
            let now = link.bus().now();
            link.bus_mut().wait(due.saturating_sub(now));
            let late_ms = now.saturating_sub(due).as_secs_f64() * 1000.0;
            summary.late_max_ms = summary.late_max_ms.max(late_ms);
        }
        if let Some(window) = args.lockstep {
            summary.unanswered += answers.wait(&mut link, number as u32, window, stop)?;
        }
        if send_sample(&mut link, &encoder, &sample, args.fd, stop)? {
            summary.samples += 1;
        } else {
            summary.incomplete_samples += 1;
        }
        let now = link.bus().now();
        if view.due(now) {
            page.count("samples", summary.samples);
            page.count("frames sent", link.counts().sent);
            page.count("queue full", link.counts().full);
            if view.show(&page).map_err(CanError::Terminal)?.is_break() {
                break;
            }
        }
    }
    link.bus_mut().finish()?;
    summary.seconds = link.bus().now().saturating_sub(start).as_secs_f64();
    summary.bus = link.counts();
    Ok(summary)
}
