//! Runs a fault-injection campaign: one estimator, one recording without faults, and many short
//! runs with one fault each (missing words, lost counts, swapped samples and others). Gives
//! detection, latency and deviation from the run without faults for each kind of fault.
//!
//! A run starts from the state that the estimator has at that sample without faults, puts the fault
//! into the samples that follow, and compares the estimates with those of the same samples without
//! it. It ends when all alarms are gone, or after [`LONGEST`] samples. The same code runs on the
//! host and on the emulated board; the digest over all outputs shows whether both computed the same
//! bits.

use heapless::Vec;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::raw::{MAX_ENCODERS, RawSample};
use serde::{Deserialize, Serialize};

/// Samples of a run at most.
pub const LONGEST: usize = 400;
/// Samples for which a fault of a channel lasts.
const LASTS: usize = 12;
/// Samples without an alarm after which a run is over.
const QUIET: usize = 8;
/// Clean samples before a fault.
const BEFORE: usize = 1;
/// Samples from one start to the next.
const STRIDE: usize = 17;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kind {
    /// The word is missing, or was no finite number.
    Missing,
    /// The word is at the upper end of the converter.
    SaturatedHigh,
    /// The word is at the lower end of the converter.
    SaturatedLow,
    /// An open wire of the bridge: the word runs to the end of the converter
    /// within three samples and trembles there.
    OpenBridge,
    /// The word stays what it was.
    Stuck,
    /// The whole sample is lost.
    Dropped,
    /// The sample comes twice.
    Repeated,
    /// Two samples come in the wrong order.
    Swapped,
    /// The encoder's count is missing.
    EncoderMissing,
    /// The encoder's count jumps for one sample.
    Glitch(u8),
    /// The encoder loses counts for good.
    LostCounts(u8),
    /// An index pulse does not come.
    IndexMissing,
    /// An index pulse comes a second time, an eighth of a turn later.
    IndexDouble,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 19] = [
        Self::Missing,
        Self::SaturatedHigh,
        Self::SaturatedLow,
        Self::OpenBridge,
        Self::Stuck,
        Self::Dropped,
        Self::Repeated,
        Self::Swapped,
        Self::EncoderMissing,
        Self::Glitch(1),
        Self::Glitch(4),
        Self::Glitch(16),
        Self::Glitch(64),
        Self::LostCounts(1),
        Self::LostCounts(4),
        Self::LostCounts(16),
        Self::LostCounts(64),
        Self::IndexMissing,
        Self::IndexDouble,
    ];

    /// On how many channels of `channels` and `encoders` it can happen.
    fn places(self, channels: usize, encoders: usize) -> usize {
        match self {
            Self::Missing
            | Self::SaturatedHigh
            | Self::SaturatedLow
            | Self::OpenBridge
            | Self::Stuck => channels,
            Self::EncoderMissing | Self::Glitch(_) | Self::LostCounts(_) => encoders,
            Self::Dropped | Self::Repeated | Self::Swapped => 1,
            Self::IndexMissing | Self::IndexDouble => encoders.min(1),
        }
    }

    fn needs_index(self) -> bool {
        matches!(self, Self::IndexMissing | Self::IndexDouble)
    }
}

/// What became of all runs of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// The fault.
    pub kind: Kind,
    /// Runs.
    pub runs: u32,
    /// Runs in which a flag was raised that was not raised without the fault.
    pub flagged: u32,
    /// Samples from the first that was spoilt to the first flag: most.
    pub latency_most: u32,
    /// The same: sum over the runs flagged.
    pub latency_sum: u32,
    /// Runs in which a standard deviation had grown in the sample of the first flag.
    pub grown: u32,
    /// Runs with a flag that was still up at their end.
    pub latched: u32,
    /// Outputs that were no finite numbers.
    pub not_finite: u32,
    /// Largest deviation of a load from that without the fault, while the fault lasts and after
    /// [standard deviations without the fault].
    pub deviation_most: f32,
    /// Largest deviation at the end of a run [standard deviations without the fault].
    pub deviation_left: f32,
    /// Largest deviation [N m, N].
    pub error_most: f32,
    /// Largest deviation at the end of a run [N m, N].
    pub error_left: f32,
}

/// The whole campaign.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// For each kind.
    pub outcomes: [Outcome; Kind::ALL.len()],
    /// FNV-1a over every output of every run.
    pub digest: u64,
}

/// Sensors of the machine and their ranges.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Machine {
    /// Analogue channels.
    pub channels: usize,
    /// Counting encoders.
    pub encoders: usize,
    /// Counts of an eighth of a turn of the first encoder.
    pub eighth: u32,
    /// Bits that the counters have.
    pub counter_mask: u32,
    /// Words at both ends of the converter.
    pub ends: [i32; 2],
}

/// What of an estimate a run is evaluated by.
#[derive(Clone, Copy, Debug, Default)]
struct Summary {
    flags: u32,
    loads: [(f32, f32); 2],
}

fn summary(estimate: &Estimate) -> Summary {
    let mut summary = Summary::default();
    for (i, sensor) in estimate.sensors.iter().enumerate() {
        summary.flags |= u32::from(sensor.fault != Fault::None) << i;
    }
    for (j, load) in estimate.loads.iter().enumerate() {
        summary.flags |= u32::from(load.fault != Fault::None) << (16 + j);
    }
    summary.flags |= u32::from(estimate.lost > 0) << 31;
    for (slot, load) in summary.loads.iter_mut().zip(&estimate.loads) {
        *slot = (load.value, load.std);
    }
    summary
}

fn absorb(digest: &mut u64, word: u32) {
    for byte in word.to_le_bytes() {
        *digest = (*digest ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3);
    }
}

/// Runs as many starts as `samples` has room for, after `settle` samples.
pub fn run(
    line: &Estimator<'_>,
    machine: &Machine,
    samples: &[RawSample],
    settle: usize,
) -> Report {
    let mut report = Report {
        outcomes: Kind::ALL.map(|kind| Outcome {
            kind,
            runs: 0,
            flagged: 0,
            latency_most: 0,
            latency_sum: 0,
            grown: 0,
            latched: 0,
            not_finite: 0,
            deviation_most: 0.0,
            deviation_left: 0.0,
            error_most: 0.0,
            error_left: 0.0,
        }),
        digest: 0xCBF2_9CE4_8422_2325,
    };
    let mut clean = line.clone();
    // Estimates of the window's samples without faults.
    let mut ahead = line.clone();
    let mut said: Vec<Summary, { LONGEST + STRIDE }> = Vec::new();
    let (start, rest) = samples.split_at(settle.min(samples.len()));
    for sample in start {
        clean.step(sample);
        ahead.step(sample);
    }
    let mut window = rest;
    let mut position = 0_u32;
    while window.len() >= LONGEST {
        for sample in window.iter().take(LONGEST).skip(said.len()) {
            let _ = said.push(summary(&ahead.step(sample)));
        }
        let index = window
            .iter()
            .take(STRIDE)
            .position(|sample| sample.index.is_some());
        for outcome in &mut report.outcomes {
            // These runs are ten times as long as the others.
            if matches!(outcome.kind, Kind::LostCounts(_)) && !position.is_multiple_of(4) {
                continue;
            }
            let begin = match (outcome.kind.needs_index(), index) {
                (false, _) => BEFORE,
                (true, Some(at)) if at >= BEFORE => at,
                _ => continue,
            };
            for place in 0..outcome.kind.places(machine.channels, machine.encoders) {
                let fault = Spoiler {
                    kind: outcome.kind,
                    place,
                    begin,
                    machine,
                };
                one(
                    clean.clone(),
                    &fault,
                    window,
                    &said,
                    outcome,
                    &mut report.digest,
                );
            }
        }
        let (passed, next) = window.split_at(STRIDE);
        for sample in passed {
            clean.step(sample);
        }
        said.rotate_left(STRIDE);
        said.truncate(LONGEST - STRIDE);
        window = next;
        position += 1;
    }
    report
}

/// One fault in the samples of a window.
struct Spoiler<'a> {
    kind: Kind,
    place: usize,
    /// First sample that is spoilt.
    begin: usize,
    machine: &'a Machine,
}

impl Spoiler<'_> {
    /// The last spoilt sample; none for what stays as it is.
    fn end(&self) -> usize {
        match self.kind {
            Kind::Missing
            | Kind::SaturatedHigh
            | Kind::SaturatedLow
            | Kind::OpenBridge
            | Kind::Stuck
            | Kind::EncoderMissing => self.begin + LASTS - 1,
            Kind::Swapped | Kind::Repeated => self.begin + 1,
            // By then the gate has had its patience, and the index came twice.
            Kind::LostCounts(_) => self.begin + 240,
            // By then it has come again.
            Kind::IndexMissing | Kind::IndexDouble => self.begin + 110,
            Kind::Dropped | Kind::Glitch(_) => self.begin,
        }
    }

    /// What the estimator gets in place of sample `i`: nothing, one or two samples.
    fn spoil(&self, i: usize, window: &[RawSample]) -> Vec<RawSample, 2> {
        let mut out = Vec::new();
        let Some(sample) = window.get(i) else {
            return out;
        };
        let mut raw = *sample;
        let lasts = i >= self.begin && i <= self.end();
        let first = i == self.begin;
        let [low, high] = self.machine.ends;
        let word = raw.words.get(self.place).copied().unwrap_or(0);
        let mask = self.machine.counter_mask;
        let jump = |raw: &mut RawSample, by: u8| {
            if let Some(count) = raw.encoders.get_mut(self.place % MAX_ENCODERS) {
                *count = count.wrapping_add(by.into()) & mask;
            }
        };
        match self.kind {
            Kind::Missing if lasts => raw.valid &= !(1 << self.place),
            Kind::SaturatedHigh if lasts => raw.set_word(self.place, high),
            Kind::SaturatedLow if lasts => raw.set_word(self.place, low),
            Kind::OpenBridge if lasts => {
                let gone = (i - self.begin + 1).min(3) as i32;
                let noise = (i & 1) as i32;
                raw.set_word(
                    self.place,
                    word / 3 * (3 - gone) + high / 3 * gone + noise + 2,
                );
            }
            Kind::Stuck if lasts => {
                let before = window
                    .get(self.begin - 1)
                    .and_then(|before| before.words.get(self.place));
                raw.set_word(self.place, before.copied().unwrap_or(0));
            }
            Kind::Dropped | Kind::Swapped if first => return out,
            Kind::Repeated if first => {
                let _ = out.push(raw);
            }
            Kind::Swapped if i == self.begin + 1 => {
                let _ = out.push(raw);
                raw = window.get(self.begin).copied().unwrap_or(raw);
            }
            Kind::EncoderMissing if lasts => {
                raw.valid &= !(1 << (loadtwin_common::io::raw::MAX_CHANNELS + self.place));
            }
            Kind::Glitch(by) if first => jump(&mut raw, by),
            Kind::LostCounts(by) if i >= self.begin => {
                jump(&mut raw, by);
                if self.place == 0 {
                    raw.index = raw.index.map(|count| count.wrapping_add(by.into()) & mask);
                }
            }
            Kind::IndexMissing if first => raw.index = None,
            Kind::IndexDouble if i > self.begin && raw.index.is_none() => {
                let latched = window.get(self.begin).and_then(|sample| sample.index);
                let at = latched.unwrap_or(0).wrapping_add(self.machine.eighth) & mask;
                let [count, ..] = raw.encoders;
                let before = window.get(i - 1).map_or(count, |before| before.encoders[0]);
                let passed = count.wrapping_sub(at) & mask;
                if passed < count.wrapping_sub(before) & mask {
                    raw.index = Some(at);
                }
            }
            _ => {}
        }
        let _ = out.push(raw);
        out
    }
}

fn one(
    mut line: Estimator<'_>,
    fault: &Spoiler<'_>,
    window: &[RawSample],
    said: &[Summary],
    outcome: &mut Outcome,
    digest: &mut u64,
) {
    outcome.runs += 1;
    let mut flagged = false;
    let mut spoilt_since = None;
    let mut quiet = 0;
    let (mut most, mut most_std) = (0.0_f32, 0.0_f32);
    let (mut last, mut last_std) = (0.0, 0.0);
    for (i, (clean, sent)) in said.iter().zip(window).enumerate() {
        let received = fault.spoil(i, window);
        if spoilt_since.is_none() && received != [*sent] {
            spoilt_since = Some(i);
        }
        for sample in received {
            let estimate = line.step(&sample);
            let now = summary(&estimate);
            absorb(digest, now.flags);
            (last, last_std) = (0.0, 0.0);
            let mut grown = false;
            for ((value, std), (clean_value, clean_std)) in now.loads.iter().zip(&clean.loads) {
                absorb(digest, value.to_bits());
                absorb(digest, std.to_bits());
                outcome.not_finite += u32::from(!(value.is_finite() && std.is_finite()));
                let off = libm::fabsf(value - clean_value);
                last = libm::fmaxf(last, off);
                if *clean_std > 0.0 {
                    last_std = libm::fmaxf(last_std, off / clean_std);
                }
                grown |= std > clean_std;
            }
            most = libm::fmaxf(most, last);
            most_std = libm::fmaxf(most_std, last_std);
            let news = now.flags & !clean.flags;
            if let Some(since) = spoilt_since
                && news != 0
                && !flagged
            {
                flagged = true;
                outcome.flagged += 1;
                let latency = (i - since) as u32;
                outcome.latency_sum += latency;
                outcome.latency_most = outcome.latency_most.max(latency);
                outcome.grown += u32::from(grown);
            }
            quiet = if news == 0 { quiet + 1 } else { 0 };
        }
        if i > fault.end() + 1 && quiet >= QUIET {
            break;
        }
    }
    outcome.latched += u32::from(quiet < QUIET);
    outcome.error_most = libm::fmaxf(outcome.error_most, most);
    outcome.error_left = libm::fmaxf(outcome.error_left, last);
    outcome.deviation_most = libm::fmaxf(outcome.deviation_most, most_std);
    outcome.deviation_left = libm::fmaxf(outcome.deviation_left, last_std);
}
