//! `loadtwin life`.

use std::path::PathBuf;
use std::str::FromStr;

use anyhow::Context;
use clap::{Args, ValueEnum};
use loadtwin_common::counting::{LEVELS, LevelScale, LoadCounts};
use serde_json::{Map, Value, json};

use super::output::say;
use super::plan::{Plan, Replace};
use super::progress::Progress;
use crate::atomic_file::publish;
use crate::life::{
    Beyond, COUNTS, CountsTable, EXPONENTS, LoadFile, Loads, RatingLife, SnCurve, Spectrum, damage,
    equivalent_load, equivalent_torque, rating_life, turns_at_load,
};
use crate::machine::Machine;
use crate::recording::Unit;

/// Gate where none is given (levels): one bin of the matrix, so that a load between two levels
/// makes no cycles.
const GATE_LEVELS: u8 = 2;

/// Count load cycles and compute damage-equivalent loads.
///
/// The files are estimates, as `replay --estimates` writes them, or recordings with measured
/// loads. Several files are counted as one machine over time, in the order given.
#[derive(Debug, Args)]
pub struct Life {
    /// Estimates or recordings (CSV, Parquet or MDF4), in the order of time.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Machine description (TOML), whose nominal loads give the range that is counted.
    #[arg(long, value_name = "FILE")]
    machine: Option<PathBuf>,
    /// The files are of several machines, whose cycles are added and not joined.
    #[arg(long, conflicts_with = "output")]
    machines: bool,
    /// Column to count; repeatable. Absent: those with a standard deviation and a fault.
    #[arg(long = "load", value_name = "NAME")]
    loads: Vec<String>,
    /// Range that is counted, in 128 levels [SI unit of the load]. Absent: by the machine, or from
    /// the lowest to the highest load of the files.
    #[arg(long, value_name = "FROM:TO")]
    range: Option<Pair>,
    /// Smallest range of a cycle [SI unit of the load]. Absent: 1/64 of the range.
    #[arg(long, value_name = "RANGE")]
    gate: Option<f64>,
    /// Exponents of the damage-equivalent loads.
    #[arg(long, value_name = "M,...", value_delimiter = ',', default_values_t = EXPONENTS)]
    exponents: Vec<f64>,
    /// Cycles of the damage-equivalent load. Absent: one a second of the time seen.
    #[arg(long, value_name = "N")]
    equivalent_cycles: Option<f64>,
    /// S-N curve through points of cycles and range.
    #[arg(long, value_name = "CYCLES:RANGE,...", value_delimiter = ',')]
    sn: Vec<Pair>,
    /// What holds below the last point of the S-N curve.
    #[arg(long, value_enum, default_value_t = Below::Haibach, requires = "sn")]
    below: Below,
    /// Column with the speed of the shaft, for its turns at each load.
    #[arg(long, value_name = "NAME")]
    speed: Option<String>,
    /// Turns of a second shaft, such as the carrier, for one of the first.
    #[arg(long, value_name = "RATIO", default_value_t = 1.0, requires = "speed")]
    ratio: f64,
    /// Exponent of the damage line of a gear, for its equivalent torque.
    #[arg(long, value_name = "P", requires = "speed")]
    gear: Option<f64>,
    /// Load rating [N] and exponent of a bearing that the load acts on: 3 for balls, 3.333 for rollers.
    #[arg(long, value_name = "C:P", requires = "speed")]
    bearing: Option<Pair>,
    /// Write the counts to FILE.parquet.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    replace: Replace,
}

/// Below the last point of an S-N curve.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Below {
    /// The last slope continues.
    Elementary,
    /// The slope m becomes 2 m - 1.
    Haibach,
    /// No damage.
    CutOff,
}

/// Two numbers with a colon between.
#[derive(Clone, Copy, Debug)]
struct Pair(f64, f64);

impl FromStr for Pair {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once(':').and_then(|(a, b)| {
            let number = |text: &str| text.trim().parse().ok().filter(|x: &f64| x.is_finite());
            Some(Self(number(a)?, number(b)?))
        });
        numbers.ok_or_else(|| "allowed: two numbers with a colon between, as 1e6:250".into())
    }
}

/// Counts of one load in one machine or several.
struct Counted {
    name: String,
    unit: Unit,
    /// One for each machine.
    machines: Vec<LoadCounts>,
    spectrum: Spectrum,
}

/// What follows for a load.
struct Figures {
    seen_s: f64,
    equivalent_cycles: f64,
    equivalent: Vec<(f64, f64)>,
    damage: Option<f64>,
    /// For each shaft.
    torque: Vec<Option<f64>>,
    bearing: Option<RatingLife>,
}

impl Life {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let mut plan = Plan::new(self.replace).reads(&self.files);
        if let Some(machine) = &self.machine {
            plan = plan.description(machine);
        }
        plan.writes("--output", self.output.as_deref(), COUNTS)
            .check(as_json)?;
        anyhow::ensure!(
            self.ratio > 0.0 && self.ratio.is_finite(),
            "--ratio {}: allowed: above 0",
            self.ratio
        );
        let curve = self.curve()?;
        let loads = Loads::find(
            &self.files[0],
            &self.loads,
            self.speed.as_deref(),
            self.ratio,
        )?;
        let empty = self.empty_counts(&loads)?;
        let (period_s, counted) = self.count(&loads, &empty)?;
        let figures = (counted.iter())
            .map(|counted| self.figures(counted, period_s, curve.as_ref()))
            .collect::<anyhow::Result<Vec<_>>>()?;
        if let Some(path) = &self.output {
            let mut table = CountsTable::default();
            for (counted, counts) in counted
                .iter()
                .flat_map(|c| c.machines.iter().map(move |m| (c, m)))
            {
                table.add(&counted.name, counts);
            }
            let complete = table
                .complete(path)
                .with_context(|| path.display().to_string())?;
            publish([complete])?;
        }
        if as_json {
            let loads: Map<String, Value> = (counted.iter().zip(&figures))
                .map(|(counted, figures)| {
                    (counted.name.clone(), report(counted, figures, period_s))
                })
                .collect();
            say!(
                "{}",
                json!({ "files": self.files, "period_s": period_s, "loads": loads })
            );
        } else {
            for (counted, figures) in counted.iter().zip(&figures) {
                print(counted, figures, period_s);
            }
        }
        Ok(())
    }

    fn curve(&self) -> anyhow::Result<Option<SnCurve>> {
        let beyond = match self.below {
            Below::Elementary => Beyond::Elementary,
            Below::Haibach => Beyond::Haibach,
            Below::CutOff => Beyond::CutOff,
        };
        let points: Vec<_> = self.sn.iter().map(|point| (point.0, point.1)).collect();
        let curve = (!points.is_empty()).then(|| SnCurve::through(&points, beyond));
        curve.transpose().context("--sn")
    }

    /// Counts with nothing in them yet, one for each load.
    fn empty_counts(&self, loads: &Loads) -> anyhow::Result<Vec<LoadCounts>> {
        let ranges = match &self.range {
            Some(range) => vec![[range.0 as f32, range.1 as f32]; loads.loads.len()],
            None => self.found_ranges(loads)?,
        };
        let mut empty = Vec::new();
        for ((name, unit), [from, to]) in loads.loads.iter().zip(ranges) {
            let scale = LevelScale::covering(from, to)
                .with_context(|| format!("range of {name} {from}:{to}: allowed: FROM below TO"))?;
            let gate = match self.gate {
                None => GATE_LEVELS,
                Some(gate) => {
                    let levels = (gate / f64::from(scale.width())).ceil().max(1.0);
                    anyhow::ensure!(
                        gate > 0.0 && levels < LEVELS as f64,
                        "--gate {gate}: allowed for {name}: above 0, below {:.4} {unit}",
                        to - from
                    );
                    levels as u8
                }
            };
            empty.push(LoadCounts::try_new(scale, gate)?);
        }
        Ok(empty)
    }

    /// By the machine's nominal loads, widened to what the files reach.
    fn found_ranges(&self, loads: &Loads) -> anyhow::Result<Vec<[f32; 2]>> {
        let machine = self.machine.as_deref().map(Machine::load).transpose()?;
        let nominal = |name: &str| {
            let machine = machine.as_ref()?;
            let load = machine.loads().into_iter().find(|load| load.name == name)?;
            Some([-load.nominal as f32, load.nominal as f32])
        };
        let mut ranges: Vec<Option<[f32; 2]>> =
            loads.loads.iter().map(|(name, _)| nominal(name)).collect();
        for path in &self.files {
            for (range, found) in ranges.iter_mut().zip(loads.extremes(path)?) {
                let both = range.iter().chain(found.iter()).copied();
                *range = both.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
            }
        }
        let widened = |(range, (name, _)): (Option<[f32; 2]>, &(String, Unit))| {
            let [from, to] =
                range.with_context(|| format!("{name}: no valid sample in the files"))?;
            // The highest load lies inside the last level; a constant load has a range as well.
            let margin = ((to - from) / LEVELS as f32)
                .max(1e-3 * from.abs().max(to.abs()))
                .max(1e-6);
            Ok([from - margin, to + margin])
        };
        ranges.into_iter().zip(&loads.loads).map(widened).collect()
    }

    fn count(&self, loads: &Loads, empty: &[LoadCounts]) -> anyhow::Result<(f64, Vec<Counted>)> {
        let progress = Progress::new("life");
        let mut machines: Vec<Vec<LoadCounts>> = vec![empty.to_vec()];
        let mut period_s = None;
        for (done, path) in self.files.iter().enumerate() {
            let file = LoadFile::open(path, loads)?;
            let period = *period_s.get_or_insert(file.period_s());
            anyhow::ensure!(
                (file.period_s() / period - 1.0).abs() < 1e-3,
                "{}: a sample every {} s, and every {period} s in the files before; allowed: one rate",
                path.display(),
                file.period_s()
            );
            let mut counts = empty.to_vec();
            file.count(&mut counts)?;
            match machines.last_mut() {
                Some(machine) if done > 0 && !self.machines => {
                    for (earlier, later) in machine.iter_mut().zip(&mut counts) {
                        later.restart();
                        earlier.append(later)?;
                    }
                }
                Some(first) if done == 0 => *first = counts,
                _ => machines.push(counts),
            }
            progress.show((done + 1) as f64 / self.files.len() as f64);
        }
        let counted = loads.loads.iter().enumerate().map(|(k, (name, unit))| {
            let machines: Vec<LoadCounts> =
                machines.iter().map(|counts| counts[k].clone()).collect();
            let mut spectrum = Spectrum::of(name, &machines[0])?;
            for machine in &machines[1..] {
                spectrum.merge(name, &Spectrum::of(name, machine)?)?;
            }
            Ok(Counted {
                name: name.clone(),
                unit: *unit,
                machines,
                spectrum,
            })
        });
        let counted = counted.collect::<anyhow::Result<_>>()?;
        Ok((period_s.unwrap_or_default(), counted))
    }

    fn figures(
        &self,
        counted: &Counted,
        period_s: f64,
        curve: Option<&SnCurve>,
    ) -> anyhow::Result<Figures> {
        let seen: u64 = counted
            .machines
            .iter()
            .map(|counts| counts.observation().seen)
            .sum();
        let seen_s = seen as f64 * period_s;
        let equivalent_cycles = self.equivalent_cycles.unwrap_or(seen_s);
        let equivalent = (self.exponents.iter())
            .map(|&m| Ok((m, equivalent_load(&counted.spectrum, m, equivalent_cycles)?)))
            .collect::<anyhow::Result<_>>()?;
        let turns = |shaft: usize| -> Vec<(f64, f64)> {
            let machines = counted.machines.iter();
            machines
                .flat_map(|counts| turns_at_load(counts, shaft))
                .collect()
        };
        let torque = (self.gear.iter())
            .flat_map(|&exponent| [0, 1].map(|shaft| equivalent_torque(&turns(shaft), exponent)))
            .collect::<Result<_, _>>()?;
        let bearing = (self.bearing.as_ref())
            .map(|bearing| rating_life(&turns(0), bearing.0, bearing.1))
            .transpose()?;
        Ok(Figures {
            seen_s,
            equivalent_cycles,
            equivalent,
            damage: curve.map(|curve| damage(&counted.spectrum, curve)),
            torque,
            bearing: bearing.flatten(),
        })
    }
}

fn report(counted: &Counted, figures: &Figures, period_s: f64) -> Value {
    let machines: Vec<Value> = (counted.machines.iter())
        .map(|counts| machine_report(counts, period_s))
        .collect();
    let equivalent: Map<String, Value> = (figures.equivalent.iter())
        .map(|(m, load)| (m.to_string(), json!(load)))
        .collect();
    let cycles: Vec<[f64; 2]> = counted
        .spectrum
        .cycles()
        .map(|cycle| [cycle.range, cycle.count])
        .collect();
    json!({
        "unit": counted.unit.symbol(),
        "machines": machines,
        "seen_s": figures.seen_s,
        "cycles": cycles,
        "equivalent_cycles": figures.equivalent_cycles,
        "damage_equivalent_load": equivalent,
        "damage": figures.damage,
        "equivalent_torque": figures.torque,
        "bearing": figures.bearing.map(|life| json!({
            "equivalent_load": life.equivalent,
            "l10_turns": life.l10_turns,
            "used": life.used,
        })),
    })
}

fn machine_report(counts: &LoadCounts, period_s: f64) -> Value {
    let seen = counts.observation();
    let extremes = counts.extremes().map(|extremes| {
        extremes
            .map(|extreme| json!({ "load": extreme.load, "t": extreme.sample as f64 * period_s }))
    });
    let (closed, residue) = counts.ended();
    let middle = |level: &u8| counts.scale().middle(*level);
    json!({
        "range": counts.scale().ends(),
        "gate": f32::from(counts.gate()) * counts.scale().width(),
        "samples": {
            "seen": seen.seen, "not_valid": seen.not_valid, "missing": seen.missing,
            "gaps": seen.gaps, "restarts": seen.restarts, "seen_share": seen.share(),
        },
        "extremes": extremes,
        "closed_cycles": closed.cycles(),
        "residue": residue.points().iter().map(middle).collect::<Vec<_>>(),
    })
}

fn print(counted: &Counted, figures: &Figures, period_s: f64) {
    let unit = counted.unit;
    for (number, counts) in (1..).zip(&counted.machines) {
        let of_machine = match counted.machines.len() {
            1 => String::new(),
            _ => format!(", machine {number}"),
        };
        let [from, to] = counts.scale().ends();
        let seen = counts.observation();
        say!(
            "{} [{unit}]{of_machine}: counted from {from:.4} to {to:.4}, gate {:.4}",
            counted.name,
            f32::from(counts.gate()) * counts.scale().width()
        );
        say!(
            "  seen {:.2} % of {:.1} s: {} samples not valid, {} missing in {} gaps, {} restarts",
            100.0 * seen.share().unwrap_or(0.0),
            seen.elapsed() as f64 * period_s,
            seen.not_valid,
            seen.missing,
            seen.gaps,
            seen.restarts
        );
        if let Some([low, high]) = counts.extremes() {
            let at = |sample: u64| sample as f64 * period_s;
            say!(
                "  lowest {:.4} at {:.2} s, highest {:.4} at {:.2} s",
                low.load,
                at(low.sample),
                high.load,
                at(high.sample)
            );
        }
        let (closed, residue) = counts.ended();
        say!(
            "  {} closed cycles, {} half cycles",
            closed.cycles(),
            residue.ranges().count()
        );
    }
    say!(
        "  equal cycles of the same damage, {:.0} of them:",
        figures.equivalent_cycles
    );
    say!("    exponent      range [{unit}]");
    for (exponent, load) in &figures.equivalent {
        say!("    {exponent:>8}{load:>15.4}");
    }
    if let Some(damage) = figures.damage {
        say!("  damage by the S-N curve: {damage:.4e}");
    }
    for (shaft, torque) in (1..).zip(&figures.torque) {
        if let Some(torque) = torque {
            say!("  equivalent torque of a gear on shaft {shaft}: {torque:.4} {unit}");
        }
    }
    if let Some(life) = &figures.bearing {
        let l10 = life
            .l10_turns
            .map_or("without end".into(), |turns| format!("{turns:.4e} turns"));
        say!(
            "  bearing: equivalent load {:.4}, L10 {l10}, used {:.4e}",
            life.equivalent,
            life.used
        );
    }
}
