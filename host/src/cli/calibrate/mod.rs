//! The command `loadtwin calibrate`: fits offset, sensitivity, position and noise of gauges to
//! recordings with reference loads, proposes sets of gauges, and writes the calibrated description,
//! on request with measured error bands, and a page. A bearing goes to `bearing.rs`; known loads at
//! standstill (`--static`) to `static_loads.rs`.

mod bearing;
mod static_loads;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::file_plan::{Plan, Replace};
use super::layout_option::LayoutFile;
use super::printing::{note, say, shown, shown_all};
use super::progress::Progress;
use crate::atomic_file::publish;
use crate::bearing::{CALIBRATION, Rig};
use crate::calibrate::{
    self, Candidate, Description, Gauge, MapSource, Observations, Proposal, calibrated, fronts,
    page, select,
};
use crate::error_band::with_error_bands;
use crate::image_build::Sensors;
use crate::machine::{ErrorBand, Kind, Machine, resampled};
use crate::origin::with_origin;
use crate::report::PAGE;
use crate::tune::{NOISE_BINS, rms};

/// Sizes of the sets that are proposed.
const SET_SIZES: [usize; 3] = [1, 3, 5];

/// Fronts from which gauges are proposed: on or near the Pareto front.
const NEAR: usize = 2;

/// Fit offset, sensitivity, position and noise of gauges to recordings with reference loads.
///
/// The recordings must turn the carrier at least once and vary the torque: a
/// slow ramp, and a stretch at constant torque. With --static the machine stands
/// still, and loads are put on and taken off.
#[derive(Debug, Args)]
pub struct Calibrate {
    /// Machine description (TOML).
    machine: PathBuf,
    /// Recordings (CSV, Parquet or MDF4) of the same machine.
    #[arg(required = true)]
    pub(super) recordings: Vec<PathBuf>,
    /// Write the calibrated description to FILE.toml, with its maps beside it.
    #[arg(short, long, value_name = "FILE")]
    pub(super) output: Option<PathBuf>,
    /// Write a page with surfaces, ranking, simulated against measured, and Pareto fronts.
    #[arg(long, value_name = "FILE.html")]
    pub(super) report: Option<PathBuf>,
    /// Also measure the error of each load with each sensor set, and write it to the output: the
    /// stated standard deviation then holds the error, where it is otherwise that of a load that
    /// moves as fast as its random walk.
    #[arg(long, requires = "output")]
    error_bands: bool,
    /// How far a gauge without `patch_map` may sit from its described angle [degrees of
    /// the carrier].
    #[arg(long, value_name = "DEGREES", default_value_t = 6.0)]
    patch: f64,
    /// Sensitivity over the carrier angle that the output gets.
    #[arg(long, value_enum, default_value_t = Maps::Best)]
    maps: Maps,
    /// Largest mean absolute error of a gauge that is proposed for use [um/m];
    /// for channels other than strain there is no limit.
    #[arg(long, value_name = "UM_PER_M", default_value_t = 5.0)]
    largest_mae: f64,
    /// Calibrate without motion: COLUMN has the applied load, a reference or a load of the machine.
    /// Files are tables with one load a row, or recordings of loads that are held; each is a run, unless
    /// it has a column `run`.
    #[arg(
        long = "static",
        value_name = "COLUMN",
        conflicts_with_all = ["report", "error_bands", "patch", "maps", "largest_mae"]
    )]
    applied: Option<String>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    layout: LayoutFile,
}

/// Sensitivity over the carrier angle that the output gets.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Maps {
    /// The described one, at the position that fits best, with fitted gain.
    Placed,
    /// The measured surface itself.
    Measured,
    /// Of each gauge the one with the smaller error on turns of the carrier that it was not fitted
    /// to.
    Best,
}

impl Calibrate {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let started = Instant::now();
        self.check_ranges()?;
        let plan = Plan::new(self.replace)
            .description(&self.machine)
            .reads(self.layout.file())
            .reads_once(&self.recordings)
            .writes("--report", self.report.as_deref(), PAGE);
        let machine = self.layout.machine(&self.machine)?;
        if let Some(column) = &self.applied {
            plan.writes_description("--output", self.output.as_deref())
                .check(as_json)?;
            return static_loads::run(&machine, column, self, as_json);
        }
        if let Some(Kind::Bearing(described)) = machine.kind() {
            plan.writes("--output", self.output.as_deref(), CALIBRATION)
                .check(as_json)?;
            let rig = Rig {
                machine: &machine,
                bearing: described,
                sensors: &Sensors::choose(&machine, None)?,
            };
            return bearing::run(&rig, self, as_json);
        }
        plan.writes_description("--output", self.output.as_deref())
            .check(as_json)?;
        let progress = Progress::new("calibrate");
        let observations =
            Observations::read(&machine, &self.recordings, |part| progress.show(part))?;
        drop(progress);
        let source = match self.maps {
            Maps::Placed => MapSource::Placed,
            Maps::Measured => MapSource::Measured,
            Maps::Best => MapSource::Best,
        };
        let patch_rad = self.patch.to_radians();
        let gauges = calibrate::calibrate(
            &machine,
            &observations,
            &self.recordings[0],
            patch_rad,
            source,
        )?;
        let (mut files, mut bands) = (Vec::new(), BTreeMap::new());
        if let Some(output) = &self.output {
            let folder = crate::files::scratch::Scratch::new()?;
            let calibrated = calibrated(&machine, &gauges, source, folder.path())?;
            let calibrated = if self.error_bands {
                with_error_bands(&calibrated, &self.recordings, 1.0)
            } else {
                calibrated
            };
            files = Description::read(&machine.path)?.with_gauges(&machine, &calibrated, output)?;
            bands = (calibrated.drivetrain.into_iter().flat_map(|d| d.loads))
                .map(|load| (load.name, load.error_bands))
                .collect();
        }
        let proposals = self.proposals(&machine, &gauges, source);
        if let Some(path) = &self.report {
            let page = page(&machine, &observations, &gauges, source, &proposals);
            files.push(with_origin(page, Some(&machine.path)).complete(path)?);
        }
        publish(files)?;
        let selection = selection(&machine, &proposals);
        let direction_note = observations.balance.direction_note(&machine);
        let reference_note = observations.balance.reference_note(&machine);
        let seconds = started.elapsed().as_secs_f64();
        if as_json {
            let channels: Vec<Value> = gauges.iter().map(|g| report(&machine, g, source)).collect();
            let recordings = shown_all(&self.recordings);
            let out = json!({
                "machine": machine.name, "recordings": recordings, "samples": observations.samples,
                "turns": observations.turns, "channels": channels, "selection": selection,
                "error_bands": bands, "direction_note": direction_note,
                "reference_note": reference_note, "machine_out": self.output.as_ref().map(shown), "seconds": seconds,
            });
            say!("{out}");
        } else {
            print(&machine, &gauges, source);
            for (group, sets) in &selection {
                say!("{group}: {}", sets.as_str().unwrap_or(&sets.to_string()));
            }
            print_bands(&machine, &bands);
            for text in [direction_note, reference_note].iter().flatten() {
                note(format_args!("{text}\n"));
            }
            say!("{:.0} turns, {:.1} s", observations.turns, seconds);
        }
        Ok(())
    }

    fn check_ranges(&self) -> anyhow::Result<()> {
        anyhow::ensure!(
            self.patch > 0.0 && self.patch <= 180.0,
            "--patch {}: allowed: above 0, up to 180",
            self.patch
        );
        anyhow::ensure!(
            self.largest_mae > 0.0,
            "--largest-mae {}: allowed: above 0",
            self.largest_mae
        );
        Ok(())
    }

    /// Proposed gauges of each group and of all.
    fn proposals(&self, machine: &Machine, gauges: &[Gauge], source: MapSource) -> Vec<Proposal> {
        let usable: Vec<&Gauge> = gauges
            .iter()
            .filter(|g| {
                let channel = &machine.channels[g.channel];
                let limit = if channel.unit.symbol() == "m/m" || channel.unit.si().symbol() == "m/m"
                {
                    1e-6 * self.largest_mae
                } else {
                    f64::INFINITY
                };
                g.fault.is_none() && g.placement.as_ref().is_some_and(|p| p.mae <= limit)
            })
            .collect();
        let mut groups: Vec<Option<&String>> = Vec::new();
        for gauge in &usable {
            let group = machine.channels[gauge.channel].group.as_ref();
            if !groups.contains(&group) {
                groups.push(group);
            }
        }
        let proposal = |name: &str, members: &[&Gauge]| {
            let candidates: Vec<Candidate> = members
                .iter()
                .filter_map(|g| candidate(g, source))
                .collect();
            let order = select(&candidates, SET_SIZES[SET_SIZES.len() - 1], NEAR);
            Proposal {
                group: name.to_owned(),
                candidates,
                order,
            }
        };
        let mut proposals: Vec<Proposal> = groups
            .iter()
            .map(|group| {
                let of = |g: &&Gauge| machine.channels[g.channel].group.as_ref() == *group;
                let members: Vec<&Gauge> = usable.iter().copied().filter(of).collect();
                proposal(group.map_or("no group", |g| g), &members)
            })
            .collect();
        if groups.len() > 1 {
            proposals.push(proposal("overall", &usable));
        }
        proposals
    }
}

/// Names of the proposed sets and of the Pareto front, for each group.
fn selection(machine: &Machine, proposals: &[Proposal]) -> serde_json::Map<String, Value> {
    let mut out = serde_json::Map::new();
    for Proposal {
        group,
        candidates,
        order,
    } in proposals
    {
        let names = |chosen: &[usize]| {
            chosen
                .iter()
                .map(|&i| machine.channels[candidates[i].channel].name.clone())
                .collect::<Vec<_>>()
        };
        let front: Vec<usize> = fronts(candidates)
            .iter()
            .enumerate()
            .filter(|(_, front)| **front == 0)
            .map(|(i, _)| i)
            .collect();
        let mut sets = serde_json::Map::new();
        for size in SET_SIZES {
            sets.insert(
                size.to_string(),
                json!(names(&order[..size.min(order.len())])),
            );
        }
        sets.insert("front".into(), json!(names(&front)));
        out.insert(group.clone(), Value::Object(sets));
    }
    out
}

fn candidate(gauge: &Gauge, source: MapSource) -> Option<Candidate> {
    let (noise, (_, map)) = (gauge.noise.as_ref()?, gauge.model(source)?);
    let map = if map.len() == 1 {
        vec![map[0]; NOISE_BINS]
    } else {
        resampled(map, NOISE_BINS)
    };
    Some(Candidate {
        channel: gauge.channel,
        response: gauge.surface.as_ref()?.sensitivity().abs(),
        mae: gauge.placement.as_ref()?.mae,
        information: map
            .iter()
            .zip(&noise.scaled)
            .map(|(m, sigma)| (m / sigma).powi(2))
            .collect(),
    })
}

/// One object for each channel, in its unit.
fn report(machine: &Machine, gauge: &Gauge, source: MapSource) -> Value {
    let channel = &machine.channels[gauge.channel];
    let own = |si: f64| channel.unit.from_si(si);
    let noise = gauge.noise.as_ref().map(|n| own(rms(&n.scaled)));
    json!({
        "name": channel.name,
        "group": channel.group,
        "unit": channel.unit.symbol(),
        "sensitivity": gauge.surface.as_ref().map(|s| own(s.sensitivity())),
        "nodes": gauge.surface.as_ref().map(|s| s.map.len()),
        "rmse": gauge.surface.as_ref().map(|s| own(s.rmse)),
        "adjusted_r2": gauge.surface.as_ref().map(|s| s.adjusted_r2),
        "offset": gauge.model(source).map(|(offset, _)| own(offset)),
        "gain": gauge.placement.as_ref().map(|p| p.gain),
        "shift_deg": gauge.placement.as_ref().map(|p| p.shift_rad.to_degrees()),
        "spread_deg": gauge.placement.as_ref().map(|p| p.spread_rad.to_degrees()),
        "map": gauge.source(source).name(),
        "node": gauge.placement.as_ref().and_then(|p| p.node.as_ref()),
        "mae_before": gauge.placement.as_ref().map(|p| own(p.mae_before)),
        "mae": gauge.placement.as_ref().map(|p| own(p.mae)),
        "noise_std": noise,
        "fault": gauge.fault.as_ref().map(ToString::to_string),
    })
}

/// A line for each set of sensors with the error of each load.
fn print_bands(machine: &Machine, bands: &BTreeMap<String, BTreeMap<String, ErrorBand>>) {
    for set in &machine.sensor_sets {
        let of_load = |(load, sets): (&String, &BTreeMap<String, ErrorBand>)| {
            let band = sets.get(&set.name)?;
            Some(format!("{load} {:.2}", band.error_over_std))
        };
        let loads: Vec<String> = bands.iter().filter_map(of_load).collect();
        if !loads.is_empty() {
            say!(
                "{:<16}error over the standard deviation of the filter: {}",
                set.name,
                loads.join(", ")
            );
        }
    }
}

/// A line for each channel, the most sensitive first.
fn print(machine: &Machine, gauges: &[Gauge], source: MapSource) {
    let response = |g: &Gauge| g.surface.as_ref().map_or(0.0, |s| s.sensitivity().abs());
    let mut ranked: Vec<&Gauge> = gauges.iter().collect();
    ranked.sort_by(|a, b| response(b).total_cmp(&response(a)));
    say!(
        "{:<16}{:<20}{:>12}{:>10}{:>9}{:>10}{:>8}{:>8}{:>9}{:>10}{:>10}",
        "channel",
        "group",
        "f_T",
        "RMSE",
        "adj.R2",
        "offset",
        "gain",
        "deg",
        "spread",
        "MAE was",
        "MAE"
    );
    for gauge in ranked {
        let channel = &machine.channels[gauge.channel];
        let own = |si: f64| channel.unit.from_si(si);
        let mut line = format!(
            "{:<16}{:<20}",
            channel.name,
            channel.group.as_deref().unwrap_or("-")
        );
        if let Some(s) = &gauge.surface {
            line += &format!(
                "{:>12.3e}{:>10.2e}{:>9.4}",
                own(s.sensitivity()),
                own(s.rmse),
                s.adjusted_r2
            );
        }
        if let (Some(p), Some((offset, _))) = (&gauge.placement, gauge.model(source)) {
            line += &format!(
                "{:>10.2e}{:>8.3}{:>8.2}{:>9.2}{:>10.2e}{:>10.2e}",
                own(offset),
                p.gain,
                p.shift_rad.to_degrees(),
                p.spread_rad.to_degrees(),
                own(p.mae_before),
                own(p.mae)
            );
        }
        if let Some(fault) = &gauge.fault {
            line += &format!("  {fault}");
        }
        say!("{line}");
    }
}
