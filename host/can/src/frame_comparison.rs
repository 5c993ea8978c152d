//! Recomputes a machine's load and sensor frames from its raw frames with the model image, and
//! compares them bit for bit with those that the machine sent (`Comparison`). Input: received
//! frames, one by one; output: counts, the first difference, and a verdict. Used by `twin`, `prove`
//! and `monitor --web`.

use std::collections::VecDeque;

use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::frame;
use loadtwin_common::io::frame::e2e::{Counter, Sequence};
use loadtwin_common::io::frame::{
    BoardInfo, BoardPage, Frame, FrameEncoder, Message, RawAssembler, Rejected, State, Status,
    StatusPage, signal_layout,
};
use loadtwin_common::io::raw::RawSample;

use super::bus::Received;
pub use super::comparison_figures::{Difference, Figures, Progress, Verdict};
use super::raw_coverage::RawCoverage;
use super::{CanError, Model, firmware_version, standard};

/// Number of identifiers with frames that are a function of the raw samples: loads and sensors.
const COMPARED: usize = signal_layout::sensor_health::OFFSET as usize;

/// Recomputed frames of one identifier that wait for the machine's at most.
const MOST_WAITING: usize = 1 << 20;

/// A frame that is to come.
struct Expected {
    number: u32,
    tick: u32,
    t_us: u64,
    frame: Frame,
}

/// A frame that came before its raw sample.
struct Early {
    number: u32,
    t_us: u64,
    payload: [u8; 8],
}

/// State of one identifier.
#[derive(Default)]
struct Channel {
    expected: VecDeque<Expected>,
    /// Frames that came before the raw sample they were made from.
    early: VecDeque<Early>,
    counter: Counter,
    /// Number of the last frame: its counter, continued.
    last: u32,
}

/// Recomputation of a machine's frames, and its comparison with the frames received.
pub struct Comparison<'a> {
    model: Model<'a>,
    line: Estimator<'a>,
    encoder: FrameEncoder,
    assembler: RawAssembler,
    channels: [Channel; COMPARED],
    status_counter: Counter,
    /// Whether every sample that the machine has had was received. Two states that
    /// once differed converge, but it is not known when they agree to the last bit.
    known: bool,
    /// No sample since the machine started.
    is_fresh: bool,
    coverage: RawCoverage,
    /// Frames for which no raw sample came, since the start.
    unverified: u64,
    answered: bool,
    figures: Figures,
    status: Option<Status>,
    estimate: Estimate,
}

fn number(payload: [u8; 8]) -> u8 {
    payload[2]
}

/// Whether two numbers are those of one frame: of a burst as they are, else by the 8 bits that a
/// frame has of them.
fn is_same(one: u32, other: u32, is_exact: bool) -> bool {
    one == other || (!is_exact && one as u8 == other as u8)
}

fn hex(payload: [u8; 8]) -> String {
    format!("{:016X}", u64::from_be_bytes(payload))
}

impl<'a> Comparison<'a> {
    /// Before the first frame of a machine that runs `model`.
    ///
    /// # Errors
    /// Why the model is refused.
    pub fn new(model: Model<'a>) -> Result<Self, CanError> {
        let (line, encoder) = model.start()?;
        Ok(Self {
            assembler: RawAssembler::new(encoder.base()),
            model,
            line,
            encoder,
            channels: std::array::from_fn(|_| Channel::default()),
            status_counter: Counter::default(),
            known: true,
            is_fresh: true,
            coverage: RawCoverage::default(),
            unverified: 0,
            answered: false,
            figures: Figures::default(),
            status: None,
            estimate: Estimate::default(),
        })
    }

    /// What was found so far.
    pub fn figures(&self) -> Figures {
        let raw = self.assembler.counts();
        let mut figures = self.figures.clone();
        figures.samples = raw.samples;
        figures.missing_ticks = raw.lost;
        figures.incomplete_samples = raw.incomplete;
        figures.damaged_frames += raw.damaged;
        figures.waiting_frames = self.channels.iter().map(|c| c.expected.len() as u64).sum();
        figures.unverifiable_frames += self.unverified + self.early_frames();
        figures.bursts = self.coverage.bursts;
        figures.dropped_bursts = self.coverage.dropped_bursts;
        figures.lag_mean_ms /= figures.lags.max(1) as f64;
        figures
    }

    /// Frames that came before their raw sample.
    fn early_frames(&self) -> u64 {
        self.channels.iter().map(|c| c.early.len() as u64).sum()
    }

    /// Samples and waiting frames so far, without a copy of all figures.
    pub fn progress(&self) -> Progress {
        Progress {
            samples: self.assembler.counts().samples,
            waiting_frames: self.channels.iter().map(|c| c.expected.len() as u64).sum(),
        }
    }

    /// What the figures so far amount to. While frames are under way, some
    /// are waiting; at the end of a log nothing is.
    pub fn verdict(&self, ended: bool) -> Verdict {
        let f = self.figures();
        let waiting = if ended { f.waiting_frames } else { 0 };
        let is_in_burst = !ended && self.coverage.is_in_burst();
        let unverifiable =
            f.unverifiable_frames - if is_in_burst { self.early_frames() } else { 0 };
        if f.machine_model.is_some_and(|hash| hash != self.model.hash) {
            Verdict::OtherModel
        } else if f.differing_frames > 0 {
            Verdict::Different
        } else if f.compared_frames == 0 {
            Verdict::Nothing
        } else if f.unsettled_frames + f.lost_frames + unverifiable + waiting > 0
            || f.incomplete_samples + f.damaged_frames > 0
        {
            Verdict::Incomplete
        } else {
            Verdict::Identical
        }
    }

    /// The estimate after the last sample.
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// The machine's status, as far as it was reported.
    pub fn status(&self) -> Option<Status> {
        self.status
    }

    /// Takes one frame from the bus.
    pub fn take(&mut self, received: &Received) {
        let Some((id, data)) = standard(&received.frame) else {
            if received.frame.is_error() {
                self.figures.error_frames += 1;
            } else {
                self.figures.foreign_frames += 1;
            }
            return;
        };
        let damaged = self.assembler.counts().damaged + self.assembler.counts().incomplete;
        if let Some(sample) = self.assembler.push(id, data) {
            self.sample(&sample, received.t_us);
        }
        let counts = self.assembler.counts();
        if counts.damaged + counts.incomplete > damaged {
            self.known = false;
        }
        if id == self.encoder.base() + signal_layout::raw_fd::OFFSET {
            return;
        }
        match frame::decode(self.encoder.base(), id, data) {
            Ok((Message::Load(..) | Message::Sensor(..), _)) => {
                if let Ok(payload) = data.try_into() {
                    self.compare(id, received.t_us, payload);
                }
            }
            Ok((Message::Status(status, page), counter)) => {
                self.follow_status(&status, page, counter.unwrap_or(0));
            }
            Ok((Message::Raw, _)) => {}
            Ok((Message::Board(info, page), _)) => self.follow_board(&info, page),
            Err(Rejected::Foreign) => self.figures.foreign_frames += 1,
            Err(Rejected::Length) => {
                self.figures.malformed_frames += 1;
                // The assembler has counted a raw frame among the damaged.
            }
            Err(Rejected::Check | Rejected::Content) => self.figures.damaged_frames += 1,
        }
    }

    /// Steps the recomputation and matches what came before its sample.
    fn sample(&mut self, sample: &RawSample, t_us: u64) {
        let joined_late = self.is_fresh && sample.tick != 0;
        self.is_fresh = false;
        self.coverage.sample(sample.tick);
        self.estimate = self.line.step(sample);
        // The machine may have the same gap, which is no loss then. From here on a difference does
        // not prove a fault.
        if joined_late || self.estimate.lost > 0 {
            self.known = false;
        }
        let mut due = Vec::new();
        self.encoder
            .estimate(&self.estimate, |frame| due.push(frame));
        let is_exact = self.coverage.has_burst();
        for frame in due {
            let every = self.every_log2(frame.id);
            let Some(channel) = self.channel(frame.id) else {
                continue;
            };
            let number = sample.tick >> every;
            channel.expected.push_back(Expected {
                number,
                tick: sample.tick,
                t_us,
                frame,
            });
            let found = channel
                .early
                .iter()
                .position(|early| is_same(early.number, number, is_exact));
            if let Some(found) = found {
                let unverifiable = found as u64;
                let taken = channel.early.drain(..=found).next_back();
                self.figures.unverifiable_frames += unverifiable;
                if let Some(early) = taken {
                    self.matched(frame.id, early);
                }
            } else if channel.expected.len() > MOST_WAITING {
                channel.expected.pop_front();
                self.figures.lost_frames += 1;
            }
        }
    }

    /// Which samples frames of an identifier are sent for.
    fn every_log2(&self, id: u16) -> u32 {
        if id.wrapping_sub(self.encoder.base()) == signal_layout::sensor_health::OFFSET {
            self.encoder.sensor_every_log2()
        } else {
            self.encoder.load_every_log2()
        }
    }

    fn channel(&mut self, id: u16) -> Option<&mut Channel> {
        let offset = id.wrapping_sub(self.encoder.base());
        let index = offset.checked_sub(signal_layout::load::OFFSET)?;
        self.channels.get_mut(usize::from(index))
    }

    /// Takes a load or sensor frame of the machine.
    fn compare(&mut self, id: u16, t_us: u64, payload: [u8; 8]) {
        self.answered = true;
        let Some(channel) = self.channel(id) else {
            return;
        };
        let counter = number(payload);
        let number = match channel.counter.follow(counter) {
            Sequence::Repeated => {
                self.figures.repeated_frames += 1;
                return;
            }
            Sequence::First => u32::from(counter),
            Sequence::Next => channel.last.wrapping_add(1),
            Sequence::Lost(lost) => channel.last.wrapping_add(1 + u32::from(lost)),
        };
        channel.last = number;
        if self.coverage.covers(number << self.every_log2(id)) {
            self.matched(
                id,
                Early {
                    number,
                    t_us,
                    payload,
                },
            );
        } else {
            self.figures.outside_frames += 1;
        }
    }

    /// Finds the recomputed frame with the machine's number: the first, since
    /// frames of one identifier keep their order.
    fn matched(&mut self, id: u16, frame: Early) {
        let is_exact = self.coverage.has_burst();
        // The raw samples of a burst follow as the bus has time.
        let most = if self.coverage.is_in_burst() {
            MOST_WAITING
        } else {
            128
        };
        let Some(channel) = self.channel(id) else {
            return;
        };
        let found = channel
            .expected
            .iter()
            .position(|e| is_same(e.number, frame.number, is_exact));
        let Some(found) = found else {
            channel.early.push_back(frame);
            // Its raw sample would have come by now.
            if channel.early.len() > most {
                channel.early.pop_front();
                self.unverified += 1;
                self.known = false;
            }
            return;
        };
        let is_before = |early: &Early| !is_exact || early.number < frame.number;
        let unverifiable = channel.early.iter().filter(|e| is_before(e)).count();
        channel.early.retain(|early| !is_before(early));
        let lost = found as u64;
        let Some(expected) = channel.expected.drain(..=found).next_back() else {
            return;
        };
        self.figures.lost_frames += lost;
        self.figures.unverifiable_frames += unverifiable as u64;
        if unverifiable > 0 {
            self.known = false;
        }
        self.compare_frame(&expected, frame.t_us, frame.payload);
    }

    fn compare_frame(&mut self, expected: &Expected, t_us: u64, payload: [u8; 8]) {
        let figures = &mut self.figures;
        figures.compared_frames += 1;
        figures.compared_bits += 64;
        let lag_ms = t_us.saturating_sub(expected.t_us) as f64 / 1000.0;
        figures.lag_mean_ms += lag_ms;
        figures.lag_max_ms = figures.lag_max_ms.max(lag_ms);
        figures.lags += 1;
        let differing = u64::from_le_bytes(payload) ^ u64::from_le_bytes(expected.frame.data);
        if differing == 0 {
            return;
        }
        if !self.known {
            figures.unsettled_frames += 1;
            return;
        }
        figures.differing_frames += 1;
        figures.differing_bits += u64::from(differing.count_ones());
        if figures.first_difference.is_none() {
            let what = self.describe(expected.frame, payload);
            self.figures.first_difference = Some(Difference {
                tick: expected.tick,
                id: expected.frame.id,
                what,
                expected: hex(expected.frame.data),
                received: hex(payload),
            });
        }
    }

    /// The field that differs and both its values.
    fn describe(&self, expected: Frame, received: [u8; 8]) -> String {
        let base = self.encoder.base();
        let decode = |data: [u8; 8]| frame::decode(base, expected.id, &data).map(|(m, _)| m);
        match (decode(expected.data), decode(received)) {
            (Ok(Message::Load(i, here)), Ok(Message::Load(_, there))) => {
                let name = self
                    .model
                    .image
                    .loads()
                    .get(i)
                    .map_or("", |load| load.name.as_str());
                let (field, here, there) = if here.value != there.value {
                    ("value", here.value.to_string(), there.value.to_string())
                } else if here.std != there.std {
                    ("std", here.std.to_string(), there.std.to_string())
                } else if here.fault != there.fault {
                    ("fault", here.fault.name().into(), there.fault.name().into())
                } else {
                    ("age", here.age.to_string(), there.age.to_string())
                };
                format!("load {name}: {field} {here} here, {there} on the bus")
            }
            (Ok(Message::Sensor(i, here)), Ok(Message::Sensor(k, there))) => {
                format!("sensor {i}: {here:?} here, sensor {k}: {there:?} on the bus")
            }
            _ => "payload".to_owned(),
        }
    }

    /// Takes what the board says of itself: frames of samples that do not come wait no longer.
    fn follow_board(&mut self, info: &BoardInfo, page: BoardPage) {
        if page == BoardPage::Firmware {
            self.figures.firmware = Some(firmware_version(info));
        }
        if !self.coverage.follow(info, page) {
            return;
        }
        self.figures.outside_frames += std::mem::take(&mut self.unverified);
        let coverage = self.coverage;
        let first = self.encoder.base() + signal_layout::load::OFFSET;
        let every: [u32; COMPARED] =
            std::array::from_fn(|index| self.every_log2(first + index as u16));
        for (channel, every) in self.channels.iter_mut().zip(every) {
            let before = channel.early.len();
            channel
                .early
                .retain(|early| coverage.covers(early.number << every));
            self.figures.outside_frames += (before - channel.early.len()) as u64;
        }
    }

    fn follow_status(&mut self, status: &Status, page: StatusPage, counter: u8) {
        // The machine has not had a sample since it started. Where it had answered before, it is a new
        // start, and so it is here.
        if status.state == State::Waiting && self.answered {
            self.restart();
            self.status_counter = Counter::default();
        }
        match self.status_counter.follow(counter) {
            Sequence::Lost(lost) => self.figures.lost_status += u64::from(lost),
            Sequence::Repeated => {
                self.figures.repeated_frames += 1;
                return;
            }
            Sequence::First | Sequence::Next => {}
        }
        self.status.get_or_insert_default().merge(status, page);
        if let StatusPage::Image(hash) = page
            && status.state != State::NoImage
        {
            self.figures.machine_model = Some(hash);
        }
    }

    fn restart(&mut self) {
        // It was accepted when this comparison was made.
        let Ok((line, _)) = self.model.start() else {
            return;
        };
        self.line = line;
        self.figures.restarts += 1;
        self.answered = false;
        self.known = true;
        // Before the first raw sample, nobody may have asked for one; what the board says next
        // decides it.
        let unverified = self.unverified + self.early_frames();
        if self.is_fresh {
            self.unverified = unverified;
        } else {
            self.unverified = 0;
            self.figures.unverifiable_frames += unverified;
        }
        self.is_fresh = true;
        self.coverage.restart();
        for channel in &mut self.channels {
            self.figures.lost_frames += channel.expected.len() as u64;
            *channel = Channel::default();
        }
    }
}
