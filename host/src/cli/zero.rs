//! The command `loadtwin zero`: computes the zero of strain bridges (mV/V) from a recording of the
//! unloaded structure, or from raw samples of a bus, and, with a shunt recording, the adjusted gauge
//! factor of one, and writes them to the description.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use serde_json::json;

use super::file_plan::{Plan, Replace};
use super::layout_option::LayoutFile;
use super::printing::{say, shown};
use super::unloaded_readings::Unloaded;
use crate::calibrate::Description;
use crate::can::frame_source::Source;
use crate::machine::{Channel, DESCRIPTION, Encoder, Machine, extreme_words};
use crate::strain::{Calibration, ShuntReading, Simulates, StrainBridge, calibrate, is_iso_date};

/// Largest standard deviation of the reading of a machine that stands still, in `noise_std` of the
/// channel. `noise_std` is that about the model in operation; of a machine that stands still the
/// noise is less: three times as much is motion or drift.
const STANDSTILL: f64 = 3.0;

/// Counts by which an encoder of a machine at standstill may differ: it is at the edge of a line.
const RESTS: f64 = 2.0;

/// Name by which all channels with a bridge are meant.
const ALL: &str = "all";

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
        let bus = Source::of_path(&self.recording)?;
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
        anyhow::ensure!(
            is_iso_date(&self.date),
            "--date: found {:?}, allowed: a day as 2026-03-31",
            self.date
        );
        let machine = self.layout.machine(&self.machine)?;
        let channels = self.channels(&machine)?;
        let named: Vec<&Channel> = channels.iter().map(|(channel, _)| *channel).collect();
        let (encoders, source) = (&machine.encoders, self.recording.as_path());
        let unloaded = match bus {
            Some(bus) => Unloaded::of_bus(&machine, &named, encoders, (bus, source))?,
            None => Unloaded::of_recording(&machine, &named, encoders, source)?,
        };
        self.check_encoders(encoders, &unloaded)?;
        let mut found = Vec::new();
        for ((channel, bridge), ratios) in channels.into_iter().zip(&unloaded.ratios) {
            self.check_standstill(channel, bridge, ratios)?;
            let shunt = self.shunt_reading(&machine, channel)?;
            let calibration = calibrate(bridge, ratios, shunt, &self.date).with_context(|| {
                format!(
                    "{}: {}",
                    self.place(&channel.name),
                    self.recording.display()
                )
            })?;
            self.check_readings(channel, ratios, unloaded.are_words)?;
            found.push(Zeroed {
                channel,
                bridge,
                calibration,
                samples: ratios.len(),
            });
        }
        self.write(&found)?;
        self.print(&found, as_json);
        Ok(())
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
            None if bridges().next().is_none() => {
                bail!(
                    "{}: found no channel with a `bridge`, allowed: one or more",
                    self.machine.display()
                )
            }
            None if self.channel == ALL => Ok(bridges().collect()),
            None => {
                let names: Vec<_> = bridges()
                    .map(|(channel, _)| channel.name.as_str())
                    .collect();
                bail!("{place}: not there; allowed: all, {}", names.join(", "))
            }
        }
    }

    /// Refuses an encoder that moves.
    fn check_encoders(&self, encoders: &[Encoder], unloaded: &Unloaded) -> anyhow::Result<()> {
        for (encoder, counts) in encoders.iter().zip(&unloaded.counts) {
            let turn = f64::from(encoder.bits).exp2();
            let moved = (counts.iter())
                .map(|count| count - counts[0])
                .map(|moved| (moved - turn * (moved / turn).round()).abs())
                .fold(0.0, f64::max);
            anyhow::ensure!(
                moved <= RESTS,
                "{}: encoder {:?}: found {moved} counts of motion, allowed: up to {RESTS}; record while the \
                 machine is unloaded and stands still",
                self.recording.display(),
                encoder.name
            );
        }
        Ok(())
    }

    /// Refuses readings at the end of the converter's range, and words of a converter that is stuck; a
    /// logger may round, so that its readings repeat.
    fn check_readings(
        &self,
        channel: &Channel,
        ratios: &[f64],
        are_words: bool,
    ) -> anyhow::Result<()> {
        if channel.adc.is_none() {
            return Ok(());
        }
        let ends = extreme_words(channel.converter().bits);
        let words: Vec<i32> = ratios
            .iter()
            .map(|ratio| channel.word_of_ratio(*ratio))
            .collect();
        let at_end = words.iter().filter(|word| ends.contains(word)).count();
        let longest = words
            .chunk_by(|a, b| a == b)
            .map(<[i32]>::len)
            .max()
            .unwrap_or(0);
        let limit = usize::from(channel.stuck_after());
        let source = self.recording.display();
        anyhow::ensure!(
            at_end == 0,
            "{}: {source}: found {at_end} of {} readings at the end of the converter's range, allowed: none; check \
             gain, excitation and wiring",
            self.place(&channel.name),
            words.len()
        );
        anyhow::ensure!(
            !are_words || limit == 0 || longest < limit,
            "{}: {source}: found {longest} equal words in a row, allowed: up to {} (stuck_after); check the converter",
            self.place(&channel.name),
            limit.saturating_sub(1)
        );
        Ok(())
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
        let unloaded = Unloaded::of_recording(machine, &[channel], &[], path)?;
        let readings = unloaded.ratios.concat();
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
        for zeroed in found {
            let name = &zeroed.channel.name;
            description.set_fields(
                ("channel", name),
                "bridge",
                "calibration",
                &zeroed.calibration,
            )?;
            if zeroed.replaces_offset() {
                description.set_number("channel", name, "offset", 0.0);
            }
        }
        description.write(&self.output)?;
        Ok(())
    }

    fn print(&self, found: &[Zeroed<'_>], as_json: bool) {
        if as_json {
            let channels: Vec<_> = found.iter().map(Zeroed::json).collect();
            let mut printed = match channels.as_slice() {
                [one] if self.channel != ALL => one.clone(),
                _ => json!({ "channels": channels }),
            };
            printed["machine_out"] = json!(shown(&self.output));
            say!("{printed}");
            return;
        }
        for zeroed in found {
            let name = &zeroed.channel.name;
            let calibration = &zeroed.calibration;
            say!(
                "{name}: zero {:.6} mV/V, {} samples",
                calibration.zero_mv_per_v,
                zeroed.samples
            );
            if let Some(adjusted) = calibration.gauge_factor {
                let kept = if self.shunt.is_some() {
                    ""
                } else {
                    ", as before"
                };
                say!(
                    "gauge factor {} raw, {adjusted:.5} adjusted{kept}",
                    zeroed.bridge.gauge_factor
                );
            }
            if zeroed.replaces_offset() {
                say!(
                    "offset {} {} set to 0: it was that of the bridge without a zero",
                    zeroed.channel.offset,
                    zeroed.channel.unit
                );
            }
        }
    }
}

/// A channel and its new zero.
struct Zeroed<'a> {
    channel: &'a Channel,
    bridge: &'a StrainBridge,
    calibration: Calibration,
    samples: usize,
}

impl Zeroed<'_> {
    /// Whether the channel's offset holds the output of the unloaded bridge, which is now subtracted: that
    /// of a bridge that had no zero. Beside a zero, an offset is what a calibration adds to it.
    fn replaces_offset(&self) -> bool {
        let had_zero = self.bridge.calibration.is_some() || self.bridge.initial_mv_per_v != 0.0;
        !had_zero && self.channel.offset != 0.0
    }

    fn json(&self) -> serde_json::Value {
        json!({
            "channel": self.channel.name,
            "calibration": self.calibration,
            "samples": self.samples,
            "offset_replaced": self.replaces_offset(),
        })
    }
}

/// Standard deviation of `of` each value; 0 of none.
fn standard_deviation(values: &[f64], of: impl Fn(f64) -> f64) -> f64 {
    let count = values.len().max(1) as f64;
    let mean = values.iter().map(|v| of(*v)).sum::<f64>() / count;
    let squares = values.iter().map(|v| (of(*v) - mean).powi(2));
    (squares.sum::<f64>() / count).sqrt()
}
