//! The command `loadtwin zero`: computes the zero of strain bridges (mV/V) from a recording of the
//! unloaded structure, or from raw samples of a bus, and, with a shunt recording, the adjusted gauge
//! factor of one, and writes them to the description.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use serde_json::json;

use loadtwin_common::io::raw::RawSample;

use super::file_plan::{Plan, Replace};
use super::layout_option::LayoutFile;
use super::printing::{say, shown};
use crate::calibrate::Description;
use crate::can::frame_source::Source;
use crate::can::raw_sampling::raw_samples;
use crate::can::stop_on_signal;
use crate::image_build::Sensors;
use crate::machine::{Channel, DESCRIPTION, Encoding, Machine};
use crate::recording::{Reader, Unit, Wanted, columns};
use crate::strain::{Calibration, MV_PER_V, ShuntReading, Simulates, StrainBridge, calibrate};

/// Largest standard deviation of the reading of a machine that stands still, in `noise_std` of the
/// channel. `noise_std` is that about the model in operation; of a machine that stands still the
/// noise is less: three times as much is motion or drift.
const STANDSTILL: f64 = 3.0;

/// Name by which all channels with a bridge are meant.
const ALL: &str = "all";

/// Raw samples that a board is asked for: what a classic bus carries at once.
const BURST: u16 = 400;

/// Ends of the names of logs of a bus.
const LOGS: [&str; 4] = ["log", "asc", "blf", "trc"];

/// Zero strain bridges, and adjust a gauge factor by a shunt resistor.
///
/// Recordings are of the unloaded structure, the bridge's column in mV/V or in
/// counts. A bus or its log serves as well: a board is asked for a burst of raw
/// samples, and its estimator starts anew. The raw gauge factor stays; the
/// adjusted one is written beside it with its date.
#[derive(Debug, Args)]
pub struct Zero {
    /// Machine description (TOML).
    machine: PathBuf,
    /// The channel; it must have a bridge. `all`: each channel that has one.
    channel: String,
    /// Recording of the unloaded structure; a bus (can0, `slcan:/dev/ttyACM0@500000`) or its log
    /// (candump, ASC, BLF, TRC).
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    /// Recording with the shunt resistor across one arm.
    #[arg(long, value_name = "RECORDING", requires = "shunt_ohm")]
    shunt: Option<PathBuf>,
    /// Resistance of the shunt [ohm].
    #[arg(long, value_name = "OHM", requires = "shunt")]
    shunt_ohm: Option<f64>,
    /// What the shunt looks like to the bridge.
    #[arg(long, default_value = "compression")]
    simulates: Arm,
    /// Day of the calibration, as 2026-03-31.
    #[arg(long, value_name = "DATE")]
    date: String,
    /// The description with the calibration.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    layout: LayoutFile,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Arm {
    Tension,
    Compression,
}

impl Zero {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let bus = self.bus()?;
        let files = [
            (bus.is_none_or(|bus| bus.log().is_some())).then_some(&self.recording),
            self.shunt.as_ref(),
        ];
        Plan::new(self.replace)
            .description(&self.machine)
            .reads(self.layout.file())
            .reads(files.into_iter().flatten())
            .writes("--output", Some(&self.output), DESCRIPTION)
            .check(as_json)?;
        let machine = self.layout.machine(&self.machine)?;
        let channels = self.channels(&machine)?;
        let words = match bus {
            Some(bus) => Some(words_of_bus(&machine, bus)?),
            None => None,
        };
        let mut found = Vec::new();
        for (channel, bridge) in channels {
            let ratios = match &words {
                Some(words) => words.ratios(channel)?,
                None => ratios(&machine, channel, &self.recording)?,
            };
            self.check_standstill(channel, bridge, &ratios)?;
            let shunt = self.shunt_reading(&machine, channel)?;
            let calibration = calibrate(bridge, &ratios, shunt, &self.date)
                .with_context(|| self.place(&channel.name))?;
            found.push((channel.name.as_str(), bridge, calibration));
        }
        self.write(&found)?;
        self.print(&found, as_json)
    }

    /// The bus or its log, where the recording is one.
    fn bus(&self) -> anyhow::Result<Option<Source<'_>>> {
        let Some(name) = self.recording.to_str() else {
            return Ok(None);
        };
        let source = Source::of(name)?;
        let end = self.recording.extension().and_then(|end| end.to_str());
        let is_bus = source.log().is_none() || end.is_some_and(|end| LOGS.contains(&end));
        Ok(is_bus.then_some(source))
    }

    fn place(&self, channel: &str) -> String {
        format!("{}: channel {channel:?}", self.machine.display())
    }

    /// The channels that are zeroed, each with its bridge.
    fn channels<'a>(
        &self,
        machine: &'a Machine,
    ) -> anyhow::Result<Vec<(&'a Channel, &'a StrainBridge)>> {
        let place = self.place(&self.channel);
        let bridges = || {
            let channels = machine.channels.iter();
            channels.filter_map(|channel| Some((channel, channel.bridge.as_ref()?)))
        };
        let named = machine.channels.iter().find(|c| c.name == self.channel);
        match named {
            Some(channel) => {
                let Some(bridge) = &channel.bridge else {
                    bail!("{place}: has no bridge");
                };
                Ok(vec![(channel, bridge)])
            }
            None if self.channel == ALL && self.shunt.is_some() => {
                bail!("--shunt: found with `all`, allowed: with the channel that is shunted")
            }
            None if self.channel == ALL && bridges().next().is_some() => Ok(bridges().collect()),
            None => {
                let names: Vec<_> = bridges()
                    .map(|(channel, _)| channel.name.as_str())
                    .collect();
                bail!("{place}: not there; allowed: all, {}", names.join(", "))
            }
        }
    }

    /// Refuses readings that scatter more than those of a machine that stands still.
    fn check_standstill(
        &self,
        channel: &Channel,
        bridge: &StrainBridge,
        ratios: &[f64],
    ) -> anyhow::Result<()> {
        let deviation = standard_deviation(ratios, |ratio| bridge.strain(ratio));
        let allowed = STANDSTILL * channel.to_si(channel.noise_std);
        anyhow::ensure!(
            deviation <= allowed,
            "{}: {}: found a standard deviation of {:.2} µm/m over {} samples, allowed: up to {:.2} µm/m ({STANDSTILL} \
             times noise_std); record while the machine is unloaded and stands still",
            self.place(&channel.name),
            self.recording.display(),
            1e6 * deviation,
            ratios.len(),
            1e6 * allowed
        );
        Ok(())
    }

    /// Mean output of the bridge with the shunt resistor, where one was connected.
    fn shunt_reading(
        &self,
        machine: &Machine,
        channel: &Channel,
    ) -> anyhow::Result<Option<ShuntReading>> {
        let (Some(path), Some(shunt_ohm)) = (&self.shunt, self.shunt_ohm) else {
            return Ok(None);
        };
        let readings = ratios(machine, channel, path)?;
        Ok(Some(ShuntReading {
            ratio: readings.iter().sum::<f64>() / readings.len() as f64,
            shunt_ohm,
            simulates: match self.simulates {
                Arm::Tension => Simulates::Tension,
                Arm::Compression => Simulates::Compression,
            },
        }))
    }

    fn write(&self, found: &[Zeroed<'_>]) -> anyhow::Result<()> {
        let mut description = Description::read(&self.machine)?;
        for (channel, _, calibration) in found {
            description.set_fields(("channel", channel), "bridge", "calibration", calibration)?;
        }
        description.write(&self.output)?;
        Ok(())
    }

    fn print(&self, found: &[Zeroed<'_>], as_json: bool) -> anyhow::Result<()> {
        if as_json {
            let channels: Vec<_> = (found.iter())
                .map(|(channel, _, calibration)| json!({ "channel": channel, "calibration": calibration }))
                .collect();
            let mut printed = match channels.as_slice() {
                [one] if self.channel != ALL => one.clone(),
                _ => json!({ "channels": channels }),
            };
            printed["machine_out"] = json!(shown(&self.output));
            say!("{printed}");
            return Ok(());
        }
        for (channel, bridge, calibration) in found {
            say!("{channel}: zero {:.6} mV/V", calibration.zero_mv_per_v);
            if let Some(adjusted) = calibration.gauge_factor {
                say!(
                    "gauge factor {} raw, {adjusted:.5} adjusted",
                    bridge.gauge_factor
                );
            }
        }
        Ok(())
    }
}

/// A channel's name, its bridge, and what was found.
type Zeroed<'a> = (&'a str, &'a StrainBridge, Calibration);

/// Words of a board's converter.
struct Words {
    /// Names of the channels in the order of the words.
    names: Vec<String>,
    samples: Vec<RawSample>,
}

impl Words {
    /// Bridge output of `channel` (V/V); missing words left out.
    fn ratios(&self, channel: &Channel) -> anyhow::Result<Vec<f64>> {
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
fn words_of_bus(machine: &Machine, bus: Source<'_>) -> anyhow::Result<Words> {
    let stop = stop_on_signal()?;
    let samples = raw_samples(bus, machine.can_base, BURST, &stop)?;
    anyhow::ensure!(
        !samples.is_empty(),
        "found no raw sample of this machine, allowed: a board that answers, or a log with the raw samples of a burst"
    );
    let sensors = Sensors::choose(machine, None)?;
    Ok(Words {
        names: sensors.channels.into_iter().map(|c| c.name).collect(),
        samples,
    })
}

/// Output of the bridge at a word of the converter (V/V).
fn ratio_of_word(channel: &Channel, word: f64) -> f64 {
    let converter = channel.converter();
    (word - f64::from(converter.zero)) * converter.lsb * MV_PER_V
}

/// Bridge output of `channel` over a recording (V/V); missing samples left out.
fn ratios(machine: &Machine, channel: &Channel, path: &Path) -> anyhow::Result<Vec<f64>> {
    let layout = &machine.recording;
    let found = columns(path, layout, &[(&channel.name, true)])?;
    let counts = Encoding::of(channel, &found) == Encoding::Word;
    let unit = if counts {
        Unit::COUNTS
    } else {
        Unit::VOLT_PER_VOLT
    };
    let wanted = [Wanted {
        name: &channel.name,
        unit,
        required: true,
    }];
    let mut ratios = Vec::new();
    for block in Reader::open(path, layout, &wanted)? {
        let read = block?
            .columns
            .into_iter()
            .flatten()
            .flatten()
            .filter(|value| value.is_finite());
        ratios.extend(read.map(|value| {
            if counts {
                ratio_of_word(channel, value)
            } else {
                value
            }
        }));
    }
    Ok(ratios)
}

/// Standard deviation of `of` each value; 0 of none.
fn standard_deviation(values: &[f64], of: impl Fn(f64) -> f64) -> f64 {
    let count = values.len().max(1) as f64;
    let mean = values.iter().map(|v| of(*v)).sum::<f64>() / count;
    let squares = values.iter().map(|v| (of(*v) - mean).powi(2));
    (squares.sum::<f64>() / count).sqrt()
}
