//! The command `loadtwin life`: counts the load cycles of files, or reads those that a board counted;
//! computes damage-equivalent loads, damage and life, prints them, and writes counts and page. Here:
//! options, the sequence of the steps, and the S-N curve from `--sn`.

mod board_counts;
mod count;
mod figures;
mod json;
mod report_page;
mod text_output;

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::Context;
use clap::{Args, ValueEnum};
use serde_json::{Map, Value, json};

use self::board_counts::{Board, Boards};
use self::count::Counted;
use self::figures::Figures;
use super::file_plan::{Plan, Replace};
use super::printing::{say, shown_all};
use crate::atomic_file::publish;
use crate::can::frame_source::Source;
use crate::life::{
    Beyond, COUNTS, CountedLoad, CountsTable, EXPONENTS, Loads, SnCurve, number_pair,
};
use crate::origin::with_origin;
use crate::report::PAGE;

/// Count load cycles and compute damage-equivalent loads.
///
/// The files are estimates, as `replay --estimates` writes them, or recordings with measured
/// loads. Several files are counted as one machine over time, in the order given. From a bus, the
/// counts come that its board keeps (`[[count]]` of its description).
#[derive(Debug, Args)]
pub struct Life {
    /// Estimates or recordings (CSV, Parquet or MDF4), in the order of time; a bus (can0,
    /// `slcan:/dev/ttyACM0@500000`) with a board, or a log of its reading (candump, ASC, BLF, TRC).
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Machine description (TOML): of a board; of files, whose range its nominal loads give.
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
    #[arg(long, value_name = "FROM:TO", allow_hyphen_values = true)]
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
    #[arg(long, value_name = "P")]
    gear: Option<f64>,
    /// Load rating [N] and exponent of a bearing that the load acts on: 3 for balls, 3.333 for
    /// rollers.
    #[arg(long, value_name = "C:P")]
    bearing: Option<Pair>,
    /// Write the counts to FILE.parquet.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write a page with the spectra, the matrix and the equivalent loads to FILE.html.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
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
        let numbers = number_pair(text).map(|(first, second)| Self(first, second));
        numbers.ok_or_else(|| "allowed: two numbers with a colon between, as 1e6:250".into())
    }
}

impl Life {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let mut files = Vec::new();
        for path in &self.files {
            let bus = Source::of_path(path)?.filter(|source| source.log().is_none());
            files.extend(bus.is_none().then_some(path));
        }
        let mut plan = Plan::new(self.replace).reads(files);
        if let Some(machine) = &self.machine {
            plan = plan.description(machine);
        }
        plan.writes("--output", self.output.as_deref(), COUNTS)
            .writes("--report", self.report.as_deref(), PAGE)
            .check(as_json)?;
        anyhow::ensure!(
            self.ratio > 0.0 && self.ratio.is_finite(),
            "--ratio {}: allowed: above 0",
            self.ratio
        );
        let curve = self.curve()?;
        let boards = Boards::read(&self.files, self.machine.as_deref(), &self.loads)?;
        let (loads, empty) = if let Some(board) = boards.first() {
            self.of_board(board, &boards)?
        } else {
            let loads = self.loads_of(&self.files[0], &self.loads)?;
            let empty = self.empty_counts(&loads)?;
            (loads, empty)
        };
        let (period_s, counted) = self.count(&loads, &empty, &boards)?;
        let figures = (counted.iter())
            .map(|counted| self.figures(counted, period_s, curve.as_ref()))
            .collect::<anyhow::Result<Vec<_>>>()?;
        self.write(&counted, &figures, period_s)?;
        if as_json {
            let loads: Map<String, Value> = (counted.iter().zip(&figures))
                .map(|(counted, figures)| {
                    (
                        counted.name.clone(),
                        json::report(counted, figures, period_s),
                    )
                })
                .collect();
            say!(
                "{}",
                json!({ "files": shown_all(&self.files), "period_s": period_s, "loads": loads })
            );
        } else {
            for (counted, figures) in counted.iter().zip(&figures) {
                text_output::print(counted, figures, period_s);
            }
        }
        Ok(())
    }

    /// The loads of a file.
    fn loads_of(&self, path: &Path, names: &[String]) -> anyhow::Result<Loads> {
        let turns = self.speed.is_some() || (self.gear.is_none() && self.bearing.is_none());
        anyhow::ensure!(
            turns,
            "--gear, --bearing: allowed with --speed, or of a board, which counts turns"
        );
        Ok(Loads::find(path, names, self.speed.as_deref(), self.ratio)?)
    }

    /// Loads and levels of a board, by which the files beside it are counted too.
    fn of_board(
        &self,
        board: &Board,
        boards: &Boards,
    ) -> anyhow::Result<(Loads, Vec<CountedLoad>)> {
        anyhow::ensure!(
            self.range.is_none() && self.gate.is_none(),
            "--range, --gate: a board counts by [[count]] of its description"
        );
        let loads = board.loads(self.speed.as_deref(), self.ratio);
        if let Some(place) = boards.first_file() {
            let names: Vec<String> = loads.loads.iter().map(|(name, _)| name.clone()).collect();
            self.loads_of(&self.files[place], &names)?;
        }
        Ok((loads, board.empty()?))
    }

    /// Writes the page and the counts, both or none.
    fn write(&self, counted: &[Counted], figures: &[Figures], period_s: f64) -> anyhow::Result<()> {
        let mut complete = Vec::new();
        if let Some(path) = &self.report {
            let page = report_page::report(&self.files, counted, figures, period_s);
            complete.push(with_origin(page, None).complete(path)?);
        }
        if let Some(path) = &self.output {
            let mut table = CountsTable::default();
            for counted in counted {
                for machine in &counted.machines {
                    table.add(&counted.name, &machine.counts);
                }
            }
            let table = table.complete(path);
            complete.push(table.with_context(|| path.display().to_string())?);
        }
        publish(complete)?;
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
}
