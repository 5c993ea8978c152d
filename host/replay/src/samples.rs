//! Rows of a recording as the raw samples that a board would have taken.

use std::path::Path;

use loadtwin_common::raw::RawSample;

use super::ReplayError;
use super::displacements::displacement_columns;
use super::index::{Pulse, Pulses};
use loadtwin_design::build::Sensors;
use loadtwin_machine::{Channel, Encoder, Machine, Reference, Segment};
use loadtwin_recording::{Block, Quantity, Reader, Role, Unit, Wanted};

/// A recording, sample by sample.
pub struct Samples {
    reader: Reader,
    channels: Vec<Channel>,
    forms: Vec<Form>,
    encoders: Vec<Encoder>,
    angles: Vec<bool>,
    index: Option<IndexColumn>,
    references: Vec<Reference>,
    /// Columns of true displacements.
    displacements: usize,
    machine_segments: Vec<Segment>,
    /// Time from which the segments count [s], once the first row is read.
    segments_from_s: Option<f64>,
    tick: u32,
}

/// What the column of an analogue channel holds.
#[derive(Clone, Copy)]
enum Form {
    /// The converter's words themselves.
    Word,
    /// The output of the channel's bridge.
    Ratio,
    /// The reading.
    Reading,
}

/// The index column.
struct IndexColumn {
    encoder: usize,
    pulses: Pulses,
}

/// One row of a recording.
pub struct Sample<'a> {
    /// Time [s].
    pub t: f64,
    /// Time in which the machine's segments are meant [s]; see [`segment_start_s`].
    pub segment_t: f64,
    /// What the board would have latched.
    pub raw: RawSample,
    /// Each load's reference in the order of the machine's references, in the
    /// load's unit and sign; NaN where the recording has none.
    pub references: &'a [f64],
    /// True displacements of a rotor along x and y, node by node [m]; NaN where
    /// the recording has none, empty for other machines.
    pub displacements: &'a [f64],
}

impl Samples {
    /// Opens the recording in `path` for the sensors of `machine`.
    ///
    /// # Errors
    /// When the recording cannot be read, lacks a sensor's column, or has
    /// another rate than the machine.
    pub fn open(machine: &Machine, sensors: &Sensors, path: &Path) -> Result<Self, ReplayError> {
        let layout = &machine.recording;
        let found = Reader::open(path, layout, &[])?;
        let quantity = |name: &str| {
            let column = found.columns().iter().find(|column| column.name == name)?;
            column
                .unit
                .as_deref()?
                .parse::<Unit>()
                .ok()
                .map(Unit::quantity)
        };
        let forms: Vec<Form> = sensors
            .channels
            .iter()
            .map(|channel| match quantity(&channel.name) {
                Some(Quantity::Counts) => Form::Word,
                Some(Quantity::BridgeRatio) if channel.bridge.is_some() => Form::Ratio,
                _ => Form::Reading,
            })
            .collect();
        let angles: Vec<bool> = sensors
            .encoders
            .iter()
            .map(|e| quantity(&e.name) == Some(Quantity::Angle))
            .collect();
        let index = index_column(machine, sensors, path)?;

        let mut wanted = Vec::new();
        for (channel, form) in sensors.channels.iter().zip(&forms) {
            let unit = match form {
                Form::Word => Unit::COUNTS,
                Form::Ratio => Unit::VOLT_PER_VOLT,
                Form::Reading => channel.unit.si(),
            };
            wanted.push(Wanted {
                name: &channel.name,
                unit,
                required: true,
            });
        }
        let mut roles = vec![Role::Continuous; wanted.len()];
        for (encoder, &is_angle) in sensors.encoders.iter().zip(&angles) {
            wanted.push(Wanted {
                name: &encoder.name,
                unit: if is_angle { Unit::RADIAN } else { Unit::COUNTS },
                required: true,
            });
            roles.push(encoder.role(is_angle));
        }
        if let Some((name, _)) = &index {
            wanted.push(Wanted {
                name,
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
        let reader =
            Reader::open_as(path, layout, &wanted, &roles)?.expect_period(1.0 / machine.rate_hz)?;
        Ok(Self {
            channels: sensors.channels.clone(),
            encoders: sensors.encoders.clone(),
            references: machine.references.clone(),
            displacements: displacements.len(),
            machine_segments: machine.segments.clone(),
            segments_from_s: None,
            index: index.map(|(_, column)| column),
            reader,
            forms,
            angles,
            tick: 0,
        })
    }

    /// Part of the recording that was read so far, 0 to 1.
    pub fn progress(&self) -> f64 {
        self.reader.progress()
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
        let mut columns = block
            .columns
            .iter()
            .map(|column| column.as_ref().map_or(f64::NAN, |c| c[i]));
        for (k, (channel, form)) in self.channels.iter().zip(&self.forms).enumerate() {
            let value = columns.next().unwrap_or(f64::NAN);
            if !value.is_nan() {
                let word = match form {
                    Form::Word => value as i32,
                    Form::Ratio => channel.word_of_ratio(value),
                    Form::Reading => channel.word(value),
                };
                raw.set_word(k, word);
            }
        }
        // The count of the index's encoder in this row.
        let mut here = self.encoders.is_empty().then_some(0);
        for (k, (encoder, is_angle)) in self.encoders.iter().zip(&self.angles).enumerate() {
            let value = columns.next().unwrap_or(f64::NAN);
            if !value.is_nan() {
                let turns = value / std::f64::consts::TAU;
                let counts = if *is_angle {
                    turns * encoder.counts_per_turn
                } else {
                    value
                };
                let count = counter(encoder, counts);
                raw.set_encoder(k, count);
                if self.index.as_ref().is_some_and(|index| index.encoder == k) {
                    here = Some(count);
                }
            }
        }
        if let Some(index) = &mut self.index {
            let pulse = index
                .pulses
                .next(columns.next().unwrap_or(f64::NAN), absent);
            raw.index = match (pulse, self.encoders.get(index.encoder)) {
                (Some(Pulse::Count(count)), Some(encoder)) => Some(counter(encoder, count)),
                (Some(_), _) => here,
                (None, _) => None,
            };
        }
        raw
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

/// The index column of the recording in `path`, by name, where it homes one of the sensors.
fn index_column<'a>(
    machine: &'a Machine,
    sensors: &Sensors,
    path: &Path,
) -> Result<Option<(&'a str, IndexColumn)>, ReplayError> {
    let Some(index) = &machine.index else {
        return Ok(None);
    };
    let encoder = (sensors.encoders.iter()).position(|e| e.name == index.encoder);
    if encoder.is_none() && !sensors.encoders.is_empty() {
        return Ok(None);
    }
    let column = IndexColumn {
        encoder: encoder.unwrap_or(0),
        pulses: Pulses::of(machine, index, path)?,
    };
    Ok(Some((&index.name, column)))
}

/// The hardware counter's value for a count.
fn counter(encoder: &Encoder, count: f64) -> u32 {
    (count.round() as i64).rem_euclid(1_i64 << encoder.bits) as u32
}

/// A column that a recording need not have.
fn optional(name: &str, unit: Unit) -> Wanted<'_> {
    Wanted {
        name,
        unit,
        required: false,
    }
}
