//! Reads what an unloaded machine shows, for `loadtwin zero` (`Unloaded`): outputs of bridges and counts
//! of encoders, from a recording, or from the raw samples of a bus or its log. Notes samples of a bus
//! that are missing or damaged.

use std::path::Path;

use anyhow::bail;

use super::printing::note;
use crate::can::frame_source::Source;
use crate::can::raw_sampling::raw_samples;
use crate::can::stop_on_signal;
use crate::image_build::Sensors;
use crate::machine::{Channel, Encoder, Encoding, Machine};
use crate::recording::{Reader, Unit, Wanted, columns};
use crate::strain::MV_PER_V;

/// Raw samples that a board is asked for: what a classic bus carries at once.
const BURST: u16 = 400;

/// Readings of an unloaded machine; missing ones are left out.
pub(super) struct Unloaded {
    /// Output of the bridge of each channel that was asked for (V/V).
    pub ratios: Vec<Vec<f64>>,
    /// Counts of each encoder that was asked for; none of one that has no column of counts.
    pub counts: Vec<Vec<f64>>,
    /// Whether they are words of a board's converter: a logger may round.
    pub are_words: bool,
}

impl Unloaded {
    /// From a recording.
    pub(super) fn of_recording(
        machine: &Machine,
        channels: &[&Channel],
        encoders: &[Encoder],
        path: &Path,
    ) -> anyhow::Result<Self> {
        let layout = &machine.recording;
        let names = channels.iter().map(|channel| (channel.name.as_str(), true));
        let optional = encoders
            .iter()
            .map(|encoder| (encoder.name.as_str(), false));
        let names: Vec<_> = names.chain(optional).collect();
        let found = columns(path, layout, &names)?;
        let are_words = |channel: &Channel| Encoding::of(channel, &found) == Encoding::Word;
        let has_counts = |encoder: &Encoder| {
            let column = found.iter().find(|column| column.name == encoder.name);
            let unit = column.and_then(|column| column.unit.as_deref()?.parse::<Unit>().ok());
            unit == Some(Unit::COUNTS)
        };
        let bridges = channels.iter().map(|channel| Wanted {
            name: &channel.name,
            unit: if are_words(channel) {
                Unit::COUNTS
            } else {
                Unit::VOLT_PER_VOLT
            },
            required: true,
        });
        let counters = encoders
            .iter()
            .filter(|encoder| has_counts(encoder))
            .map(|encoder| Wanted {
                name: &encoder.name,
                unit: Unit::COUNTS,
                required: false,
            });
        let wanted: Vec<_> = bridges.chain(counters).collect();
        let mut values = vec![Vec::new(); wanted.len()];
        for block in Reader::open(path, layout, &wanted)? {
            for (values, column) in values.iter_mut().zip(block?.columns) {
                let read = column.into_iter().flatten();
                values.extend(read.filter(|value| value.is_finite()));
            }
        }
        let of = |name: &str| {
            let place = wanted.iter().position(|wanted| wanted.name == name);
            place.map_or(&[][..], |place| values[place].as_slice())
        };
        let ratios = channels.iter().map(|channel| {
            let read = of(&channel.name).iter();
            if are_words(channel) {
                read.map(|word| ratio_of_word(channel, *word)).collect()
            } else {
                read.copied().collect()
            }
        });
        Ok(Self {
            ratios: ratios.collect(),
            counts: encoders.iter().map(|e| of(&e.name).to_vec()).collect(),
            are_words: false,
        })
    }

    /// From the raw samples of the machine's board on `bus`, or in a log; `name` is that of the source.
    pub(super) fn of_bus(
        machine: &Machine,
        channels: &[&Channel],
        encoders: &[Encoder],
        (bus, name): (Source<'_>, &Path),
    ) -> anyhow::Result<Self> {
        let stop = stop_on_signal()?;
        let (samples, counts) = raw_samples(bus, machine.can_base, BURST, &stop)?;
        let name = name.display();
        anyhow::ensure!(
            samples.len() > 1,
            "{name}: found {} raw samples with identifiers from {:#x} on, allowed: two or more, of a board that answers \
             or of a log with its burst",
            samples.len(),
            machine.can_base
        );
        let missing = counts.lost + counts.incomplete + counts.damaged;
        if missing > 0 {
            note(format_args!(
                "{name}: {missing} raw samples are missing or damaged\n"
            ));
        }
        if bus.log().is_none() && samples.len() < usize::from(BURST) {
            note(format_args!(
                "{name}: {} of {BURST} raw samples came\n",
                samples.len()
            ));
        }
        let sensors = Sensors::choose(machine, None)?;
        let ratios = channels.iter().map(|channel| {
            let place = sensors.channels.iter().position(|c| c.name == channel.name);
            let Some(place) = place else {
                let names: Vec<_> = sensors.channels.iter().map(|c| c.name.as_str()).collect();
                bail!(
                    "channel {:?}: is in no word of the board; its sensor set has {}",
                    channel.name,
                    names.join(", ")
                );
            };
            let words = samples.iter().filter(|sample| sample.has_word(place));
            Ok(words
                .map(|sample| ratio_of_word(channel, f64::from(sample.words[place])))
                .collect())
        });
        let counts = (0..encoders.len()).map(|place| {
            let samples = samples.iter().filter(|sample| sample.has_encoder(place));
            samples
                .map(|sample| f64::from(sample.encoders[place]))
                .collect()
        });
        Ok(Self {
            ratios: ratios.collect::<anyhow::Result<_>>()?,
            counts: counts.collect(),
            are_words: true,
        })
    }
}

/// Output of the bridge at a word of the converter (V/V).
fn ratio_of_word(channel: &Channel, word: f64) -> f64 {
    let converter = channel.converter();
    (word - f64::from(converter.zero)) * converter.lsb * MV_PER_V
}
