//! The command `loadtwin zero`: computes the zero of a strain bridge (mV/V) from a recording of the
//! unloaded structure and, with a shunt recording, its adjusted gauge factor, and writes both to
//! the description.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use serde_json::json;

use super::file_plan::{Plan, Replace};
use super::layout_option::LayoutFile;
use super::printing::{say, shown};
use crate::calibrate::Description;
use crate::machine::{Channel, DESCRIPTION, Encoding, Machine};
use crate::recording::{Reader, Unit, Wanted, columns};
use crate::strain::{Calibration, MV_PER_V, ShuntReading, Simulates, calibrate};

/// Largest standard deviation of the reading of a machine that stands still, in `noise_std` of the
/// channel. `noise_std` is that about the model in operation; of a machine that stands still the
/// noise is less: three times as much is motion or drift.
const STANDSTILL: f64 = 3.0;

/// Zero a strain bridge, and adjust its gauge factor by a shunt resistor.
///
/// Recordings are of the unloaded structure, the bridge's column in mV/V or in
/// counts. The raw gauge factor stays; the adjusted one is written beside it
/// with its date.
#[derive(Debug, Args)]
pub struct Zero {
    /// Machine description (TOML).
    machine: PathBuf,
    /// The channel; it must have a bridge.
    channel: String,
    /// Recording of the unloaded structure.
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
        Plan::new(self.replace)
            .description(&self.machine)
            .reads(self.layout.file())
            .reads(
                [Some(&self.recording), self.shunt.as_ref()]
                    .into_iter()
                    .flatten(),
            )
            .writes("--output", Some(&self.output), DESCRIPTION)
            .check(as_json)?;
        let machine = self.layout.machine(&self.machine)?;
        let place = || format!("{}: channel {:?}", self.machine.display(), self.channel);
        let names = || {
            machine
                .channels
                .iter()
                .map(|c| c.name.as_str())
                .collect::<Vec<_>>()
                .join(", ")
        };
        let Some(channel) = machine.channels.iter().find(|c| c.name == self.channel) else {
            bail!("{}: not there; allowed: {}", place(), names());
        };
        let Some(bridge) = &channel.bridge else {
            bail!("{}: has no bridge", place());
        };
        let zero = ratios(&machine, channel, &self.recording)?;
        let deviation = standard_deviation(&zero, |ratio| bridge.strain(ratio));
        let allowed = STANDSTILL * channel.to_si(channel.noise_std);
        anyhow::ensure!(
            deviation <= allowed,
            "{}: {}: found a standard deviation of {:.2} µm/m over {} samples, allowed: up to {:.2} µm/m ({STANDSTILL} \
             times noise_std); record while the machine is unloaded and stands still",
            place(),
            self.recording.display(),
            1e6 * deviation,
            zero.len(),
            1e6 * allowed
        );
        let shunt = self.shunt_reading(&machine, channel)?;
        let calibration = calibrate(bridge, &zero, shunt, &self.date).with_context(place)?;
        self.write(&calibration)?;
        if as_json {
            say!(
                "{}",
                json!({ "channel": channel.name, "calibration": calibration, "machine_out": shown(&self.output) })
            );
        } else {
            say!(
                "{}: zero {:.6} mV/V",
                channel.name,
                calibration.zero_mv_per_v
            );
            if let Some(adjusted) = calibration.gauge_factor {
                say!(
                    "gauge factor {} raw, {adjusted:.5} adjusted",
                    bridge.gauge_factor
                );
            }
        }
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

    fn write(&self, calibration: &Calibration) -> anyhow::Result<()> {
        let mut description = Description::read(&self.machine)?;
        description.set_fields(
            ("channel", &self.channel),
            "bridge",
            "calibration",
            calibration,
        )?;
        description.write(&self.output)?;
        Ok(())
    }
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
                (value - f64::from(channel.converter().zero)) * channel.converter().lsb * MV_PER_V
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
