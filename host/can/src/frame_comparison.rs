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
    Frame, FrameEncoder, Message, RawAssembler, Rejected, State, Status, StatusPage, signal_layout,
};
use loadtwin_common::io::raw::RawSample;
use serde::Serialize;

use super::bus::Received;
use super::{CanError, Model, standard};

/// Number of identifiers with frames that are a function of the raw samples: loads and sensors.
const COMPARED: usize = signal_layout::sensor_health::OFFSET as usize;

/// Recomputed frames of one identifier that wait for the machine's at most.
const MOST_WAITING: usize = 1 << 20;

/// What the comparison says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every frame that came was compared, none lost, every bit equal.
    Identical,
    /// A bit differs although the machine's state is known.
    Different,
    /// Nothing that was compared differs, but not everything could be compared.
    Incomplete,
    /// The machine runs another model.
    OtherModel,
    /// There was nothing to compare.
    Nothing,
}

/// The first frame that differs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Tick of the sample.
    pub tick: u32,
    /// Identifier.
    pub id: u16,
    /// What differs, in words.
    pub what: String,
    /// Payload by this recomputation.
    pub expected: String,
    /// Payload on the bus.
    pub received: String,
}

/// What was found so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Whole raw samples.
    pub samples: u64,
    /// Load and sensor frames compared.
    pub compared_frames: u64,
    /// Payload bits compared.
    pub compared_bits: u64,
    /// Frames that differ.
    pub differing_frames: u64,
    /// Bits that differ.
    pub differing_bits: u64,
    /// Frames that differ where the machine's state is not known: it had samples
    /// that were not received, before the first one here or lost, and has not started anew.
    pub unsettled_frames: u64,
    /// The first frame that differs.
    pub first_difference: Option<Difference>,
    /// Recomputed frames that the machine did not send, or that were lost.
    pub lost_frames: u64,
    /// Frames of the machine without raw sample to recompute them from.
    pub unverifiable_frames: u64,
    /// Recomputed frames still waiting for the machine's.
    pub waiting_frames: u64,
    /// Ticks missing between raw samples.
    pub missing_ticks: u64,
    /// Raw samples of which a frame was lost or out of order.
    pub incomplete_samples: u64,
    /// Frames whose check or content is wrong.
    pub damaged_frames: u64,
    /// Frames with an identifier of the machine but another length or format.
    pub malformed_frames: u64,
    /// Frames sent twice.
    pub repeated_frames: u64,
    /// Frames of others.
    pub foreign_frames: u64,
    /// Error frames of the controller.
    pub error_frames: u64,
    /// Status frames missing by their counter.
    pub lost_status: u64,
    /// Times that the machine started anew.
    pub restarts: u64,
    /// Name of the model that the machine runs, where it was reported.
    pub machine_model: Option<u32>,
    /// Time from a raw sample to a load or sensor frame that the machine made from it, mean (ms).
    /// The delay of the estimates in samples is not part of it.
    pub lag_mean_ms: f64,
    /// The largest such time (ms).
    pub lag_max_ms: f64,
    /// Frames compared, for the mean.
    #[serde(skip)]
    lags: u64,
}

/// How far a comparison is.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Whole raw samples.
    pub samples: u64,
    /// Recomputed frames still waiting for the machine's.
    pub waiting_frames: u64,
}

/// A frame that is to come.
struct Expected {
    tick: u32,
    t_us: u64,
    frame: Frame,
}

/// State of one identifier.
#[derive(Default)]
struct Channel {
    expected: VecDeque<Expected>,
    /// Frames that came before the raw sample they were made from.
    early: VecDeque<(u64, [u8; 8])>,
    counter: Counter,
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
    answered: bool,
    figures: Figures,
    status: Option<Status>,
    estimate: Estimate,
}

fn number(payload: [u8; 8]) -> u8 {
    payload[2]
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
        figures.unverifiable_frames += self
            .channels
            .iter()
            .map(|c| c.early.len() as u64)
            .sum::<u64>();
        figures.lag_mean_ms /= figures.lags.max(1) as f64;
        figures
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
        if f.machine_model.is_some_and(|hash| hash != self.model.hash) {
            Verdict::OtherModel
        } else if f.differing_frames > 0 {
            Verdict::Different
        } else if f.compared_frames == 0 {
            Verdict::Nothing
        } else if f.unsettled_frames + f.lost_frames + f.unverifiable_frames + waiting > 0
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
        let joined_late = self.assembler.counts().samples == 1 && sample.tick != 0;
        self.estimate = self.line.step(sample);
        // The machine may have the same gap, which is no loss then. From here on a difference does
        // not prove a fault.
        if joined_late || self.estimate.lost > 0 {
            self.known = false;
        }
        let mut due = Vec::new();
        self.encoder
            .estimate(&self.estimate, |frame| due.push(frame));
        for frame in due {
            let Some(channel) = self.channel(frame.id) else {
                continue;
            };
            channel.expected.push_back(Expected {
                tick: sample.tick,
                t_us,
                frame,
            });
            let found = channel
                .early
                .iter()
                .position(|(_, p)| number(*p) == number(frame.data));
            if let Some(found) = found {
                let unverifiable = found as u64;
                let taken = channel.early.drain(..=found).next_back();
                self.figures.unverifiable_frames += unverifiable;
                if let Some((t_us, payload)) = taken {
                    self.matched(frame.id, t_us, payload);
                }
            } else if channel.expected.len() > MOST_WAITING {
                channel.expected.pop_front();
                self.figures.lost_frames += 1;
            }
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
        if channel.counter.follow(number(payload)) == Sequence::Repeated {
            self.figures.repeated_frames += 1;
            return;
        }
        self.matched(id, t_us, payload);
    }

    /// Finds the recomputed frame with the machine's number: the first, since
    /// frames of one identifier keep their order.
    fn matched(&mut self, id: u16, t_us: u64, payload: [u8; 8]) {
        let Some(channel) = self.channel(id) else {
            return;
        };
        let found = channel
            .expected
            .iter()
            .position(|e| number(e.frame.data) == number(payload));
        let Some(found) = found else {
            channel.early.push_back((t_us, payload));
            // Its raw sample would have come by now.
            if channel.early.len() > 128 {
                channel.early.pop_front();
                self.figures.unverifiable_frames += 1;
                self.known = false;
            }
            return;
        };
        let unverifiable = channel.early.len();
        channel.early.clear();
        let lost = found as u64;
        let Some(expected) = channel.expected.drain(..=found).next_back() else {
            return;
        };
        self.figures.lost_frames += lost;
        self.figures.unverifiable_frames += unverifiable as u64;
        if unverifiable > 0 {
            self.known = false;
        }
        self.compare_frame(&expected, t_us, payload);
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

    fn follow_status(&mut self, status: &Status, page: StatusPage, counter: u8) {
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
        // The machine has not had a sample since it started. Where it had
        // answered before, it is a new start, and so it is here.
        if status.state == State::Waiting && self.answered {
            self.restart();
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
        for channel in &mut self.channels {
            self.figures.lost_frames += channel.expected.len() as u64;
            self.figures.unverifiable_frames += channel.early.len() as u64;
            *channel = Channel::default();
        }
    }
}
