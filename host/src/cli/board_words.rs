//! Reads the words of a board's converter from a bus or its log, for `loadtwin zero`: outputs of each
//! bridge, counts of each encoder. Notes samples that are missing or damaged.

use std::path::Path;

use anyhow::bail;
use loadtwin_common::io::raw::RawSample;

use super::printing::note;
use crate::can::frame_source::Source;
use crate::can::raw_sampling::raw_samples;
use crate::can::stop_on_signal;
use crate::image_build::Sensors;
use crate::machine::{Channel, Machine};
use crate::strain::MV_PER_V;

/// Raw samples that a board is asked for: what a classic bus carries at once.
const BURST: u16 = 400;

/// Words of a board's converter.
pub(super) struct Words {
    /// Names of the channels in the order of the words.
    names: Vec<String>,
    samples: Vec<RawSample>,
}

impl Words {
    /// Counts of the encoder at `place`; missing ones left out.
    pub(super) fn counts(&self, place: usize) -> Vec<f64> {
        let samples = self
            .samples
            .iter()
            .filter(|sample| sample.has_encoder(place));
        samples
            .map(|sample| f64::from(sample.encoders[place]))
            .collect()
    }

    /// Bridge output of `channel` (V/V); missing words left out.
    pub(super) fn ratios(&self, channel: &Channel) -> anyhow::Result<Vec<f64>> {
        let place = self.names.iter().position(|name| *name == channel.name);
        let Some(place) = place else {
            bail!(
                "channel {:?}: is in no word of the board; its sensor set has {}",
                channel.name,
                self.names.join(", ")
            );
        };
        let words = self.samples.iter().filter(|sample| sample.has_word(place));
        Ok(words
            .map(|sample| ratio_of_word(channel, f64::from(sample.words[place])))
            .collect())
    }
}

/// Raw samples of the machine's board on `bus`, or in a log.
pub(super) fn words_of_bus(
    machine: &Machine,
    bus: Source<'_>,
    name: &Path,
) -> anyhow::Result<Words> {
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
    Ok(Words {
        names: sensors.channels.into_iter().map(|c| c.name).collect(),
        samples,
    })
}

/// Output of the bridge at a word of the converter (V/V).
pub(super) fn ratio_of_word(channel: &Channel, word: f64) -> f64 {
    let converter = channel.converter();
    (word - f64::from(converter.zero)) * converter.lsb * MV_PER_V
}
