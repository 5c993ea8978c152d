//! The command `loadtwin reduce`: reads finite-element strains under unit loads, and writes strain
//! maps of the gauges, and of candidate nodes about them, over the carrier angle: strain per
//! torque.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context;
use clap::Args;
use serde_json::json;

use super::file_plan::{Plan, Replace};
use super::printing::{say, shown};
use crate::atomic_file::publish;
use crate::machine::{MAP_ENTRIES, MAPS, Machine, complete_columns, resampled};
use crate::recording::{Quantity, Unit};
use crate::reduce::{GaugeMaps, Reduction, read_cases, read_nodes};

/// Turn finite-element strains for unit loads into strain maps over the carrier angle.
///
/// The machine's `drivetrain.gears` give the forces, each channel's `place` the
/// position and direction of its gauge. docs/how-to/strain-maps.md says what to export from
/// a finite-element package.
#[derive(Debug, Args)]
pub struct Reduce {
    /// Machine description (TOML).
    machine: PathBuf,
    /// Load cases (CSV): place, angle and axis of the unit force of each step.
    loads: PathBuf,
    /// Strains under these loads: a `CalculiX` result (.frd) or a CSV table.
    strains: PathBuf,
    /// The maps (CSV), to be named as `sensitivity_map`.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Maps of all candidate nodes (CSV), to be named as `patch_map`.
    #[arg(long, value_name = "FILE")]
    patches: Option<PathBuf>,
    /// Angular steps of the maps.
    #[arg(long, value_name = "N", default_value_t = MAP_ENTRIES)]
    entries: usize,
    /// Angular steps of the candidates' maps.
    #[arg(long, value_name = "N", default_value_t = 180)]
    patch_entries: usize,
    /// Unit of the coordinates in an .frd file.
    #[arg(long, value_name = "UNIT", default_value = "m")]
    length: String,
    #[command(flatten)]
    replace: Replace,
}

impl Reduce {
    fn plan(&self) -> Plan {
        // Not the files that the description names: the maps may be among them, and are
        // made anew.
        Plan::new(self.replace)
            .reads([&self.machine, &self.loads, &self.strains])
            .writes("--output", Some(&self.output), MAPS)
            .writes("--patches", self.patches.as_deref(), MAPS)
    }

    fn check_entries(&self) -> anyhow::Result<()> {
        for (name, entries) in [
            ("--entries", self.entries),
            ("--patch-entries", self.patch_entries),
        ] {
            anyhow::ensure!(
                (16..=4096).contains(&entries),
                "{name} {entries}: allowed: 16 to 4096"
            );
        }
        Ok(())
    }

    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let started = Instant::now();
        self.check_entries()?;
        let length = self
            .length
            .parse::<Unit>()
            .ok()
            .filter(|unit| unit.quantity() == Quantity::Length)
            .with_context(|| format!("--length {}: allowed: a unit of length", self.length))?;
        self.plan().check(as_json)?;
        let machine = Machine::load(&self.machine)?;
        let cases = read_cases(&self.loads)?;
        let reduction = Reduction::new(&machine, &cases, &self.loads, self.entries)?;
        let nodes = read_nodes(&machine, &self.strains, cases.len(), length)?;
        let gauges = reduction.gauges(&machine, &nodes, &self.strains)?;
        anyhow::ensure!(
            !gauges.is_empty(),
            "{}: no channel has a place",
            self.machine.display()
        );
        self.write_maps(&machine, &gauges)?;
        let seconds = started.elapsed().as_secs_f64();
        if as_json {
            self.print_json(&machine, cases.len(), &gauges, seconds);
        } else {
            print_gauges(&machine, &gauges);
            say!("{} load cases, {seconds:.1} s", cases.len());
        }
        Ok(())
    }

    /// Writes the maps of the gauges and, where asked for, those of all nodes in their patches.
    fn write_maps(&self, machine: &Machine, gauges: &[GaugeMaps]) -> anyhow::Result<()> {
        let title = |gauge: &GaugeMaps, name: &str| {
            let channel = &machine.channels[gauge.channel];
            format!("{name} [{}/Nm]", channel.unit.symbol())
        };
        let own = |gauge: &GaugeMaps, map: &[f64]| -> Vec<f64> {
            let unit = machine.channels[gauge.channel].unit;
            map.iter().map(|m| unit.from_si(*m)).collect()
        };
        let mut files = Vec::new();
        if let Some(path) = &self.patches {
            let columns: Vec<(String, Vec<f64>)> = gauges
                .iter()
                .flat_map(|gauge| {
                    gauge
                        .candidates
                        .iter()
                        .map(move |candidate| (gauge, candidate))
                })
                .map(|(gauge, (node, map))| {
                    let name = format!("{}/{node}", machine.channels[gauge.channel].name);
                    let map = resampled(&own(gauge, map), self.patch_entries);
                    (title(gauge, &name), map)
                })
                .collect();
            let file = complete_columns(path, &columns);
            files.push(file.with_context(|| path.display().to_string())?);
        }
        let columns: Vec<(String, Vec<f64>)> = gauges
            .iter()
            .map(|gauge| {
                let name = &machine.channels[gauge.channel].name;
                (title(gauge, name), own(gauge, gauge.described()))
            })
            .collect();
        let file = complete_columns(&self.output, &columns);
        files.push(file.with_context(|| self.output.display().to_string())?);
        publish(files)?;
        Ok(())
    }

    fn print_json(&self, machine: &Machine, cases: usize, gauges: &[GaugeMaps], seconds: f64) {
        let channels: Vec<_> = gauges
            .iter()
            .map(|gauge| {
                json!({
                    "name": machine.channels[gauge.channel].name, "node": gauge.node,
                    "distance_m": gauge.distance_m, "candidates": gauge.candidates.len(),
                    "peak": gauge.peak(),
                })
            })
            .collect();
        let out = json!({
            "machine": machine.name, "load_cases": cases, "channels": channels,
            "maps": shown(&self.output), "patches": self.patches.as_ref().map(shown), "seconds": seconds,
        });
        say!("{out}");
    }
}

fn print_gauges(machine: &Machine, gauges: &[GaugeMaps]) {
    say!(
        "{:<16}{:>10}{:>12}{:>12}{:>16}",
        "channel",
        "node",
        "away [mm]",
        "candidates",
        "peak [um/m/kNm]"
    );
    for gauge in gauges {
        say!(
            "{:<16}{:>10}{:>12.1}{:>12}{:>16.4}",
            machine.channels[gauge.channel].name,
            gauge.node,
            1e3 * gauge.distance_m,
            gauge.candidates.len(),
            1e9 * gauge.peak()
        );
    }
}
