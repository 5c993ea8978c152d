//! Reads a recording sample by sample as a board would have latched it (`Samples`): converter
//! words, encoder counts and index pulses, with reference loads and the true displacements of a
//! rotor. Goes on from the end of the recording before (`SavedSamples`), where rows are not
//! resampled; notes what was rounded, joined or missing.

use std::borrow::Cow;

use loadtwin_common::io::raw::RawSample;

use serde::{Deserialize, Serialize};

use super::ReplayError;
use super::displacement_errors::displacement_columns;
use super::encoder_counts::{Motion, motions};
use super::index_pulse::{Pulse, Pulses};
use super::reading_correction::Correction;
use super::wanted_columns::{optional, reference_note, wanted_sensors};
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{Channel, Encoder, Encoding, Machine, Reference, Regime, Segment};
use loadtwin_recording::{
    Block, Clock, CsvLayout, Input, Reader, Role, Timing, Unit, Wanted, columns,
};

/// A recording, sample by sample.
pub struct Samples {
    reader: Reader,
    channels: Vec<Channel>,
    encodings: Vec<Encoding>,
    encoders: Vec<Encoder>,
    motions: Vec<Motion>,
    period_s: f64,
    index: Option<IndexColumn>,
    references: Vec<Reference>,
    /// Which references have no column, where there is a reason to say it.
    reference_note: Option<String>,
    /// Columns of true displacements.
    displacements: usize,
    machine_segments: Vec<Segment>,
    /// Time from which the segments count [s], once the first row is read.
    segments_from_s: Option<f64>,
    /// Words and counts that were no whole numbers.
    fractional: u64,
    /// Whether counts lie between those of the file.
    is_resampled: bool,
    correction: Correction,
    tick: u32,
}

/// The index column.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct IndexColumn {
    encoder: usize,
    pulses: Pulses,
}

/// How a recording was read up to its end, so that another one goes on from there.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct SavedSamples {
    clock: Clock,
    index: Option<IndexColumn>,
    /// Turns of each encoder whose column is a speed.
    turns: Vec<f64>,
    tick: u32,
    segments_from_s: Option<f64>,
}

/// One row of a recording.
pub struct Sample<'a> {
    /// Time (s).
    pub t: f64,
    /// Time in which the machine's segments are meant (s); see `segment_start_s`.
    pub segment_t: f64,
    /// What the board would have latched.
    pub raw: RawSample,
    /// Each load's reference in the order of the machine's references, in the
    /// load's unit and sign; NaN where the recording has none.
    pub references: &'a [f64],
    /// True displacements of a rotor along x and y, node by node (m); NaN where
    /// the recording has none, empty for other machines.
    pub displacements: &'a [f64],
}

impl Samples {
    /// Opens the recording `input` for the sensors of `machine`.
    ///
    /// # Errors
    /// When the recording cannot be read, lacks a sensor's column, or has
    /// another rate than the machine.
    pub fn open<'a>(
        machine: &Machine,
        sensors: &Sensors,
        input: impl Into<Input<'a>>,
    ) -> Result<Self, ReplayError> {
        let input = input.into();
        let index = index_column(machine, sensors, input)?;
        Self::with_index(machine, sensors, input, index)
    }

    /// As [`Self::open`], where the recording goes on from `before`.
    ///
    /// # Errors
    /// As [`Self::open`]; when `before` is of a recording with other sensors.
    pub(super) fn continued(
        machine: &Machine,
        sensors: &Sensors,
        input: Input<'_>,
        before: SavedSamples,
    ) -> Result<Self, ReplayError> {
        let index = match before.index {
            // What the column holds shows once there is a pulse.
            Some(last) if last.pulses.is_open() => {
                index_column(machine, sensors, input)?.map(|index| IndexColumn {
                    pulses: index.pulses.after(&last.pulses),
                    ..index
                })
            }
            index => index,
        };
        let mut samples = Self::with_clock(machine, sensors, input, (index, Some(before.clock)))?;
        let turns = before.turns.into_iter();
        for (motion, before) in samples.motions.iter_mut().zip(turns) {
            if let Motion::Speed { turns } = motion {
                *turns = before;
            }
        }
        samples.tick = before.tick;
        samples.segments_from_s = before.segments_from_s;
        Ok(samples)
    }

    /// What goes on in another recording; none where rows are brought onto ticks.
    pub(super) fn saved(&self) -> Option<SavedSamples> {
        Some(SavedSamples {
            clock: self.reader.clock()?,
            index: self.index.clone(),
            turns: (self.motions.iter())
                .map(|motion| match motion {
                    Motion::Speed { turns } => *turns,
                    Motion::Count | Motion::Angle { .. } => 0.0,
                })
                .collect(),
            tick: self.tick,
            segments_from_s: self.segments_from_s,
        })
    }

    /// Number of the next sample.
    pub(super) fn tick(&self) -> u32 {
        self.tick
    }

    /// As [`Self::open`], with the index column of the recording, once it was found.
    pub(super) fn with_index<'a>(
        machine: &Machine,
        sensors: &Sensors,
        input: impl Into<Input<'a>>,
        index: Option<IndexColumn>,
    ) -> Result<Self, ReplayError> {
        Self::with_clock(machine, sensors, input.into(), (index, None))
    }

    fn with_clock(
        machine: &Machine,
        sensors: &Sensors,
        input: Input<'_>,
        (index, clock): (Option<IndexColumn>, Option<Clock>),
    ) -> Result<Self, ReplayError> {
        let layout = &recorded(machine);
        let sensors_named = (sensors.channels.iter().map(|c| &c.name))
            .chain(sensors.encoders.iter().map(|e| &e.name))
            .chain(machine.index.iter().map(|i| &i.name));
        let references_named = machine.references.iter().map(|r| &r.name);
        let names: Vec<(&str, bool)> = sensors_named
            .map(|name| (name.as_str(), true))
            .chain(references_named.map(|name| (name.as_str(), false)))
            .collect();
        let found = columns(input, layout, &names)?;
        let quantity = |name: &str| {
            let column = found.iter().find(|column| column.name == name)?;
            column
                .unit
                .as_deref()?
                .parse::<Unit>()
                .ok()
                .map(Unit::quantity)
        };
        let encodings: Vec<Encoding> = (sensors.channels.iter())
            .map(|channel| Encoding::of(channel, &found))
            .collect();
        let motions = motions(machine, sensors, quantity);
        let (mut wanted, mut roles) = wanted_sensors(sensors, &encodings, &motions);
        if let (Some(index), Some(_)) = (&machine.index, &index) {
            wanted.push(Wanted {
                name: &index.name,
                unit: Unit::ONE,
                required: true,
            });
            roles.push(Role::Pulse);
        }
        for reference in &machine.references {
            wanted.push(optional(&reference.name, reference.unit.si()));
        }
        let displacements = displacement_columns(machine);
        wanted.extend((displacements.iter()).map(|name| optional(name, Unit::METRE)));
        let reader = match clock {
            Some(clock) => Reader::continued(input, layout, &wanted, &roles, clock)?,
            None => Reader::open_as(input, layout, &wanted, &roles)?,
        };
        let reader = reader.expect_period(1.0 / machine.rate_hz)?;
        Ok(Self {
            correction: Correction::none(sensors),
            channels: sensors.channels.clone(),
            encoders: sensors.encoders.clone(),
            references: machine.references.clone(),
            reference_note: reference_note(machine, &found),
            displacements: displacements.len(),
            machine_segments: machine.segments.clone(),
            segments_from_s: None,
            index,
            reader,
            encodings,
            motions,
            period_s: 1.0 / machine.rate_hz,
            fractional: 0,
            is_resampled: machine.recording.timing == Timing::Resample,
            tick: 0,
        })
    }

    /// The same recording, read otherwise.
    pub(super) fn corrected(self, correction: Correction) -> Self {
        Self { correction, ..self }
    }

    /// Part of the recording that was read so far, 0 to 1.
    pub fn progress(&self) -> f64 {
        self.reader.progress()
    }

    /// What was recognised, joined, resampled or rounded to read the recording so far, one line
    /// each.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = self.reader.notes().to_vec();
        let index = self.index.as_ref().and_then(|index| index.pulses.note());
        notes.extend(index.map(str::to_owned));
        notes.extend(self.reference_note.clone());
        if self.fractional > 0 {
            notes.push(format!(
                "{} counts are no whole numbers (means of several conversions?) and are rounded",
                self.fractional
            ));
        }
        notes
    }

    /// Hands the samples of the next block to `each`; false at the end.
    ///
    /// # Errors
    /// When the recording is not what it should be further on.
    pub fn next_block(&mut self, mut each: impl FnMut(&Sample<'_>)) -> Result<bool, ReplayError> {
        let Some(block) = self.reader.next().transpose()? else {
            return Ok(false);
        };
        let mut references = vec![f64::NAN; self.references.len()];
        let mut displacements = vec![f64::NAN; self.displacements];
        let first = || segment_start_s(&self.machine_segments, block.t[0]);
        let segments_from_s = *self.segments_from_s.get_or_insert_with(first);
        let mut bridged = block.bridged.iter().copied().peekable();
        for i in 0..block.len() {
            let absent = bridged.next_if_eq(&i).is_some();
            let raw = self.raw(&block, i, absent);
            let true_ones = block.columns.len() - self.displacements;
            let first = true_ones - self.references.len();
            for (value, column) in displacements.iter_mut().zip(&block.columns[true_ones..]) {
                *value = column.as_ref().map_or(f64::NAN, |column| column[i]);
            }
            for ((value, column), reference) in references
                .iter_mut()
                .zip(&block.columns[first..])
                .zip(&self.references)
            {
                let read = column.as_ref().map_or(f64::NAN, |column| column[i]);
                *value = (read - reference.unit.to_si(reference.zero)) * reference.gain;
            }
            each(&Sample {
                t: block.t[i],
                segment_t: block.t[i] - segments_from_s,
                raw,
                references: &references,
                displacements: &displacements,
            });
        }
        Ok(true)
    }

    fn raw(&mut self, block: &Block, i: usize, absent: bool) -> RawSample {
        let mut raw = RawSample {
            tick: self.tick,
            ..RawSample::default()
        };
        self.tick = self.tick.wrapping_add(1);
        let mut fractional = 0;
        let mut whole = |value: f64| {
            fractional += u64::from(!self.is_resampled && value.fract() != 0.0);
            value.round()
        };
        let at = |column: usize| {
            let column = block.columns.get(column).and_then(Option::as_ref);
            column.map_or(f64::NAN, |c| c[i])
        };
        let encoders = self.channels.len();
        let corrected = self.correction.channels.iter();
        for (k, ((channel, encoding), read)) in
            (self.channels.iter().zip(&self.encodings).zip(corrected)).enumerate()
        {
            let value = at(read.from);
            if !value.is_nan() {
                let zero = f64::from(channel.converter().zero);
                let word = match encoding {
                    Encoding::Word => whole(zero + (value - zero) * read.factor) as i32,
                    Encoding::Ratio => channel.word_of_ratio(value * read.factor),
                    Encoding::Reading => channel.word(value * read.factor),
                };
                let shift = channel.word(read.offset).saturating_sub(channel.word(0.0));
                raw.set_word(k, word.saturating_add(shift));
            }
        }
        // The count of the index's encoder in this row.
        let mut here = self.encoders.is_empty().then_some(0);
        let motions = self.encoders.iter().zip(&mut self.motions);
        let corrected = self.correction.encoders.iter();
        for (k, ((encoder, motion), (from, factor))) in motions.zip(corrected).enumerate() {
            let value = at(encoders + from) * factor;
            if !value.is_nan() {
                if matches!(motion, Motion::Count) {
                    whole(value);
                }
                let count = motion.count(value, self.period_s, encoder);
                raw.set_encoder(k, count);
                if self.index.as_ref().is_some_and(|index| index.encoder == k) {
                    here = Some(count);
                }
            }
        }
        if let Some(index) = &mut self.index {
            let factor = (self.correction.encoders.get(index.encoder)).map_or(1.0, |c| c.1);
            let column = encoders + self.encoders.len();
            let pulse = index.pulses.next(at(column), absent);
            raw.index = match (pulse, self.encoders.get(index.encoder)) {
                (Some(Pulse::Count(count)), Some(encoder)) => {
                    Some(encoder.counter().at_count(count * factor))
                }
                (Some(_), _) => here,
                (None, _) => None,
            };
        }
        self.fractional += fractional;
        raw
    }
}

/// Whether a replay of the recordings of `machine` has a state with which another one goes on: rows that are
/// brought onto ticks have none.
pub fn has_state(machine: &Machine) -> bool {
    recorded(machine).timing != Timing::Resample
}

/// How the recordings of `machine` are laid out. Rows without a common clock, and recordings whose
/// means alone count, are brought onto the ticks of the estimator.
fn recorded(machine: &Machine) -> Cow<'_, CsvLayout> {
    let layout = &machine.recording;
    let steady = machine
        .balance
        .as_ref()
        .is_some_and(|b| b.regime == Regime::Steady);
    if machine.balance.is_some() && (steady || layout.timing == Timing::Free) {
        Cow::Owned(CsvLayout {
            timing: Timing::Resample,
            // At constant speed nothing happens between rows that are further apart.
            largest_gap: if steady {
                layout.largest_gap.max(machine.rate_hz as u32)
            } else {
                layout.largest_gap
            },
            ..layout.clone()
        })
    } else {
        Cow::Borrowed(layout)
    }
}

/// Time from which segments count in a recording that begins at `t0` [s]: 0, the time of the
/// recording; its beginning where that lies beyond the last bound of a segment by more than they
/// all span, as with times since 1970 or since midnight.
pub(super) fn segment_start_s(segments: &[Segment], t0: f64) -> f64 {
    let bounds = || {
        segments
            .iter()
            .flat_map(|s| [Some(s.from_s), s.to_s])
            .flatten()
    };
    let last = bounds().fold(f64::NEG_INFINITY, f64::max);
    let first = bounds().fold(0.0, f64::min);
    if last.is_finite() && t0 > last + (last - first) {
        t0
    } else {
        0.0
    }
}

/// The index column of the recording `input`, where it homes one of the sensors.
pub(super) fn index_column(
    machine: &Machine,
    sensors: &Sensors,
    input: Input<'_>,
) -> Result<Option<IndexColumn>, ReplayError> {
    let Some(index) = &machine.index else {
        return Ok(None);
    };
    let encoder = (sensors.encoders.iter()).position(|e| e.name == index.encoder);
    if encoder.is_none() && !sensors.encoders.is_empty() {
        return Ok(None);
    }
    Ok(Some(IndexColumn {
        encoder: encoder.unwrap_or(0),
        pulses: Pulses::of(machine, index, input)?,
    }))
}
