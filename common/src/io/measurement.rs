//! Converts a raw sample to readings in the model's units, each a value or a fault
//! (`SignalConditioner`): words by zero and gain, saturated and stuck words; encoder counts to
//! angles, unwrapped, homed by the index pulse, corrected for an eccentric disc. Counts lost
//! samples and marks repeated ones.

use crate::error::{Error, finite, positive};
use crate::io::fault::Fault;
use crate::io::raw::{MAX_CHANNELS, MAX_ENCODERS, RawSample};
use crate::signal::phase::{Phase, PhaseStep, UPPER_PER_RAD};
use crate::signal::trigonometry;
use serde::{Deserialize, Serialize};

/// How the words of one analogue channel become a reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AdcScaling {
    /// Word at reading 0.
    pub zero: i32,
    /// Reading per count, finite and not 0.
    pub gain: f32,
    /// Words at or below this are saturated.
    pub lowest: i32,
    /// Words at or above this are saturated.
    pub highest: i32,
    /// Equal words in a row after which the channel counts as stuck; 0: never.
    pub stuck_after: u16,
}

/// How the counts of one encoder become an angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EncoderScaling {
    /// Carrier angle of one count.
    pub step: PhaseStep,
    /// Width of the hardware counter (bit), 1 to 32.
    pub bits: u8,
}

/// The once-per-revolution pulse.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IndexPulse {
    /// Which encoder's count the pulse latches.
    pub encoder: u8,
    /// Carrier angle at the pulse.
    pub angle: Phase,
    /// Largest deviation from the expected angle that is not a fault (rad), > 0.
    pub tolerance_rad: f32,
    /// Error of that encoder once per turn, where its disc is not centred.
    pub eccentricity: Option<Eccentricity>,
}

/// Error of an angle once per turn, `c (cos a - 1) + s sin a`, at `a` past the index pulse:
/// homing takes what it is there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Eccentricity {
    /// `c` (rad).
    pub cosine_rad: f32,
    /// `s` (rad).
    pub sine_rad: f32,
}

impl IndexPulse {
    /// Checks the ranges.
    pub(crate) fn check(&self) -> Result<(), Error> {
        positive([self.tolerance_rad], "index tolerance")?;
        self.eccentricity.map_or(Ok(()), |e| {
            finite(&[e.cosine_rad, e.sine_rad], 2, "eccentricity")
        })
    }

    /// Takes the error off the angle of its encoder, once homed.
    // Few machines need it: what it costs is not to be paid by the others.
    #[inline(never)]
    fn remove_eccentricity(&self, e: Eccentricity, angles: &mut [Measured<Phase>]) {
        if let Some(Ok(angle)) = angles.get_mut(usize::from(self.encoder)) {
            let (sine, cosine) = trigonometry::sin_cos(angle.wrapping_sub(self.angle).to_rad());
            let error = e.cosine_rad * (cosine - 1.0) + e.sine_rad * sine;
            *angle = angle.wrapping_sub(Phase::from_small_rad(error));
        }
    }
}

/// A value, or why there is none.
pub type Measured<T> = Result<T, Fault>;

/// One sample in the units of the model.
#[derive(Clone, Copy, Debug)]
pub struct Measurement {
    /// Tick of the sample.
    pub tick: u32,
    /// Samples lost just before this one.
    pub lost: u32,
    /// The sample came twice, or after a later one: nothing of it is used.
    pub stale: bool,
    /// `(word - zero) gain` of each analogue channel.
    pub values: [Measured<f32>; MAX_CHANNELS],
    /// Carrier angle by each encoder.
    pub angles: [Measured<Phase>; MAX_ENCODERS],
    /// Angle by which all encoders were turned by the index pulse of this sample.
    pub rehomed: Option<Phase>,
    /// Whether the angles are homed.
    pub homed: bool,
    /// Whether the last index pulse came where none was expected, or not where
    /// one was.
    pub slipped: bool,
}

/// Converter of raw samples, with the state that it keeps from sample to sample.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct SignalConditioner {
    last_tick: Option<u32>,
    words: [StuckDetector; MAX_CHANNELS],
    counts: [Option<u32>; MAX_ENCODERS],
    angles: [Phase; MAX_ENCODERS],
    homed: bool,
    suspect: Option<Phase>,
    passage: IndexSupervisor,
    /// Whether the count of the index's encoder changed since the last pulse, or the start.
    moved: bool,
    /// Whether a pulse came without: the encoder stands still while the shaft turns.
    frozen: bool,
}

/// Whether the index came each time that its place was passed.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct IndexSupervisor {
    /// Side of the place on which the encoder stood last, outside the
    /// tolerance: -1 or 1; 0: not known.
    side: i8,
    /// Whether the pulse came since.
    came: bool,
    /// Whether it did not come when the place was passed last.
    missed: bool,
}

/// Sample numbers that a late sample is behind at most; further back is a new start.
const MAX_REORDER: u32 = 100;

#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct StuckDetector {
    word: i32,
    repeats: u16,
}

impl AdcScaling {
    /// `(word - zero) gain`, or why the word is of no use.
    fn read(&self, word: i32, repeats: u16) -> Measured<f32> {
        if word >= self.highest {
            Err(Fault::SaturatedHigh)
        } else if word <= self.lowest {
            Err(Fault::SaturatedLow)
        } else if self.stuck_after != 0 && repeats >= self.stuck_after {
            Err(Fault::Stuck)
        } else {
            Ok(word.wrapping_sub(self.zero) as f32 * self.gain)
        }
    }
}

impl EncoderScaling {
    /// Counts from `last` to `now`, the short way round the counter.
    pub(crate) fn difference(&self, now: u32, last: u32) -> i32 {
        let unused = 32 - u32::from(self.bits.clamp(1, 32));
        (now.wrapping_sub(last) << unused) as i32 >> unused
    }
}

impl SignalConditioner {
    /// Converts one sample.
    ///
    /// `lead`: how far the carrier is ahead of the index's encoder, by the
    /// twist of the shafts between them. An encoder that was not delivered keeps its last angle
    /// inside; the next count is unwrapped against the last one that was.
    pub fn convert(
        &mut self,
        raw: &RawSample,
        converters: &[AdcScaling],
        counters: &[EncoderScaling],
        index: Option<&IndexPulse>,
        lead: Phase,
    ) -> Measurement {
        let nothing = RawSample {
            tick: raw.tick,
            ..RawSample::default()
        };
        let mut lost = self
            .last_tick
            .map_or(0, |last| raw.tick.wrapping_sub(last).wrapping_sub(1));
        let stale = lost >= MAX_REORDER.wrapping_neg();
        let raw = if stale {
            lost = 0;
            &nothing
        } else {
            self.last_tick = Some(raw.tick);
            raw
        };

        let mut values = [Err(Fault::Missing); MAX_CHANNELS];
        self.read_words(raw, converters, &mut values);

        let mut angles = [Err(Fault::Missing); MAX_ENCODERS];
        for (k, (((counter, last), phase), angle)) in counters
            .iter()
            .zip(&mut self.counts)
            .zip(&mut self.angles)
            .zip(&mut angles)
            .enumerate()
        {
            if raw.has_encoder(k) {
                let count = raw.encoders.get(k).copied().unwrap_or(0);
                let moved = last.map_or(0, |last| counter.difference(count, last));
                if moved != 0 && index.is_some_and(|index| usize::from(index.encoder) == k) {
                    (self.moved, self.frozen) = (true, false);
                }
                *phase = phase.advanced(moved, counter.step);
                *last = Some(count);
                *angle = Ok(*phase);
            }
        }

        let rehomed = index.and_then(|index| {
            let k = usize::from(index.encoder);
            if raw.has_encoder(k) {
                self.supervise_index(raw.index.is_some(), lost > 0, index, lead);
                self.detect_frozen(raw.index.is_some(), k, &mut angles);
            }
            self.home(raw, index, counters, lead)
        });
        if let Some(by) = rehomed {
            for angle in angles.iter_mut().flatten() {
                *angle = angle.wrapping_add(by);
            }
        }
        // The encoder itself stays as it counts: of the next pulse its count is latched.
        if let Some(index) = index.filter(|_| self.homed)
            && let Some(eccentricity) = index.eccentricity
        {
            index.remove_eccentricity(eccentricity, &mut angles);
        }
        Measurement {
            tick: raw.tick,
            lost,
            stale,
            values,
            angles,
            rehomed,
            homed: self.homed,
            slipped: self.suspect.is_some() || self.passage.missed || self.frozen,
        }
    }

    // Inlined, it is written out for eight channels, and every reading is moved twice.
    #[inline(never)]
    fn read_words(
        &mut self,
        raw: &RawSample,
        converters: &[AdcScaling],
        values: &mut [Measured<f32>; MAX_CHANNELS],
    ) {
        for (i, ((converter, last), value)) in converters
            .iter()
            .zip(&mut self.words)
            .zip(values)
            .enumerate()
        {
            if raw.has_word(i) {
                let word = raw.words.get(i).copied().unwrap_or(0);
                last.repeats = if word == last.word {
                    last.repeats.saturating_add(1)
                } else {
                    0
                };
                last.word = word;
                *value = converter.read(word, last.repeats);
            }
        }
    }

    /// Takes encoder `k` for frozen from an index pulse since whose last its count has not changed,
    /// until it does: a pulse at standstill, or before the first count, homes nothing either.
    fn detect_frozen(&mut self, pulse: bool, k: usize, angles: &mut [Measured<Phase>]) {
        if pulse {
            self.frozen = !self.moved;
            self.moved = false;
        }
        if let Some(angle) = angles.get_mut(k).filter(|_| self.frozen) {
            *angle = Err(Fault::Stuck);
        }
    }

    /// Takes a shift of the counts of encoder `k` back: its angle goes on where it was.
    pub(crate) fn shift(&mut self, k: usize, by: Phase) {
        if let Some(angle) = self.angles.get_mut(k) {
            *angle = angle.wrapping_add(by);
        }
        (self.suspect, self.passage) = (None, IndexSupervisor::default());
    }

    /// Notes whether the pulse came while the encoder went from one side of its
    /// place to the other, by less than half a turn.
    ///
    /// Inside the tolerance nothing is decided: an encoder that trembles there
    /// may or may not meet the pulse. With a lost sample a pulse may be lost.
    fn supervise_index(&mut self, came: bool, lost: bool, index: &IndexPulse, lead: Phase) {
        let Some(angle) = self.angles.get(usize::from(index.encoder)) else {
            return;
        };
        let passage = &mut self.passage;
        // The upper half of the phase: signed, a turn is 2^32.
        let ahead = (angle.wrapping_add(lead).wrapping_sub(index.angle).0 >> 32) as i32;
        let distance = ahead.unsigned_abs();
        if lost || distance > 1 << 30 {
            passage.side = 0;
        }
        passage.came |= came;
        if distance <= 1 << 30 && distance > (index.tolerance_rad * UPPER_PER_RAD) as u32 {
            let side = if ahead < 0 { -1 } else { 1 };
            if side == -passage.side {
                passage.missed = !passage.came && self.homed;
            }
            passage.side = side;
            passage.came = false;
        }
    }

    /// Turns all angles so that the index pulse, if one came, stands at its angle.
    ///
    /// A pulse within the tolerance changes nothing: it would only add the
    /// jitter of its latch. One outside it is either false or says that counts
    /// were lost. A false pulse is not repeated: only a second one with the
    /// same deviation turns the angles.
    fn home(
        &mut self,
        raw: &RawSample,
        index: &IndexPulse,
        counters: &[EncoderScaling],
        lead: Phase,
    ) -> Option<Phase> {
        let latched = raw.index.filter(|_| !self.frozen)?;
        let k = usize::from(index.encoder);
        let (counter, count) = (counters.get(k)?, (*self.counts.get(k)?)?);
        let since = counter.difference(count, latched);
        let at_pulse = self
            .angles
            .get(k)?
            .advanced(since.wrapping_neg(), counter.step);
        let by = index.angle.wrapping_sub(at_pulse.wrapping_add(lead));
        let near = |phase: Phase| libm::fabsf(phase.to_rad()) <= index.tolerance_rad;
        if self.homed {
            if near(by) {
                self.suspect = None;
                self.passage.missed = false;
                return None;
            }
            if !self
                .suspect
                .is_some_and(|suspect| near(by.wrapping_sub(suspect)))
            {
                self.suspect = Some(by);
                return None;
            }
        }
        for angle in &mut self.angles {
            *angle = angle.wrapping_add(by);
        }
        self.homed = true;
        self.suspect = None;
        self.passage = IndexSupervisor::default();
        Some(by)
    }
}

#[cfg(test)]
#[path = "measurement_tests.rs"]
mod tests;
