//! The command `loadtwin tables`: has simulated gearboxes calibrated, tuned and evaluated as in
//! tables 2 and 3 of Bosmans et al. 2023, prints their errors beside the published ones, and writes
//! a page.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

use clap::Args;
use serde_json::{Value, json};

use super::demo;
use super::file_plan::{Plan, Replace};
use super::printing::say;
use super::progress::Progress;
use crate::machine::Machine;
use crate::origin::with_origin;
use crate::paper_tables::{
    Cell, Curve, Individual, OTHERS, Published, SEGMENTS, TABLE_2, TABLE_3, curve, mean_qd, page,
    statistics,
};
use crate::report::PAGE;
use crate::simulate::Applied;

/// Reproduce tables 2 and 3 of Bosmans et al. 2023 on simulated individuals.
///
/// Each individual of the shipped gearbox is calibrated and tuned on
/// recordings of its own and evaluated on another one. The paper's figure stands
/// beside ours, mean +- standard deviation over the individuals.
#[derive(Debug, Args)]
pub struct Tables {
    /// Machine description (TOML) with the sets of sensors of the shipped gearbox.
    machine: Option<PathBuf>,
    /// How many individuals, numbered from 1.
    #[arg(long, value_name = "COUNT", default_value_t = 10)]
    individuals: u64,
    /// Effect that the estimator's model lacks, as in `simulate`; repeatable.
    #[arg(long = "effect", value_name = "EFFECT", default_value = "paper")]
    effects: Vec<String>,
    /// Write a page with the tables, and with error and innovations over Qd, to FILE.html.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    #[command(flatten)]
    replace: Replace,
}

/// Sets of sensors of table 3.
const SETS: [&str; 3] = ["torque-arm-3", "ring-gear-3", "high-speed-housing-3"];

impl Tables {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        anyhow::ensure!(self.individuals > 0, "--individuals 0: allowed: at least 1");
        let started = Instant::now();
        let path = match &self.machine {
            Some(path) => path.clone(),
            None => demo::example()?.join("machine.toml"),
        };
        Plan::new(self.replace)
            .description(&path)
            .writes("--report", self.report.as_deref(), PAGE)
            .check(as_json)?;
        let machine = Machine::load(&path)?;
        let effects = Applied::list(&self.effects)?;
        let rows: Vec<Published> = TABLE_2.into_iter().chain(TABLE_3).chain(OTHERS).collect();
        let progress = Progress::new("tables");
        let mut cells = Vec::new();
        let mut curves: Vec<Vec<Curve>> = Vec::new();
        // Rows, and curves of the page, that are done.
        let done = AtomicU64::new(0);
        let curve_count = if self.report.is_some() { SETS.len() } else { 0 };
        let all = self.individuals * (rows.len() + curve_count) as u64;
        let step = || progress.show((done.fetch_add(1, Relaxed) + 1) as f64 / all as f64);
        for number in 1..=self.individuals {
            let individual = Individual::new(&machine, number, &effects)?;
            cells.push(individual.evaluate(&rows, step)?);
            if self.report.is_some() {
                let of_sets = SETS.iter().map(|set| {
                    let curve = curve(&individual, set);
                    step();
                    curve
                });
                curves.push(of_sets.collect::<Result<_, _>>()?);
            }
        }
        drop(progress);
        if let Some(path) = &self.report {
            let page = page(&machine, &self.effects, &rows, &cells, &curves);
            with_origin(page, Some(&machine.path)).write(path)?;
        }
        let of_row = |i: usize| cells.iter().map(|row| &row[i]).collect::<Vec<_>>();
        let seconds = started.elapsed().as_secs_f64();
        if as_json {
            let reports: Vec<Value> = rows
                .iter()
                .enumerate()
                .map(|(i, row)| report(row, &of_row(i)))
                .collect();
            let (table2, rest) = reports.split_at(TABLE_2.len());
            let (table3, others) = rest.split_at(TABLE_3.len());
            let out = json!({
                "machine": machine.name, "individuals": self.individuals, "effects": self.effects,
                "table_2": table2, "table_3": table3, "others": others, "seconds": seconds,
            });
            say!("{out}");
        } else {
            say!(
                "NMAE [%] of the main shaft: paper | mean +- deviation of {} individuals",
                self.individuals
            );
            let segments: String = SEGMENTS.map(|segment| format!("{segment:>22}")).concat();
            say!("{:<40}{:>15}{segments}", "", "log10 Qd");
            for (i, row) in rows.iter().enumerate() {
                match i {
                    0 => say!("table 2"),
                    _ if i == TABLE_2.len() => say!("table 3"),
                    _ if i == TABLE_2.len() + TABLE_3.len() => say!("not in the paper"),
                    _ => {}
                }
                say!("{}", line(row, &of_row(i)));
            }
            say!("{seconds:.0} s");
        }
        Ok(())
    }
}

fn report(row: &Published, cells: &[&Cell]) -> Value {
    let nmae: serde_json::Map<String, Value> = SEGMENTS
        .iter()
        .enumerate()
        .map(|(k, segment)| {
            let (mean, std) = statistics(cells.iter().map(|cell| cell.nmae[k]));
            let each: Vec<f64> = cells.iter().map(|cell| cell.nmae[k]).collect();
            let entry =
                json!({ "paper": row.nmae.map(|n| n[k]), "mean": mean, "std": std, "each": each });
            ((*segment).to_owned(), entry)
        })
        .collect();
    json!({
        "sensors": row.sensors, "method": row.method.name(), "cutoff_hz": row.cutoff_hz,
        "drift": row.drift,
        "log10_qd": { "paper": row.log10_qd, "mean": mean_qd(cells) }, "nmae_percent": nmae,
    })
}

fn line(row: &Published, cells: &[&Cell]) -> String {
    let qd: Vec<String> = mean_qd(cells).iter().map(|qd| format!("{qd:.1}")).collect();
    let mut line = format!(
        "{:<22}{:<18}{:>15}",
        row.sensors,
        row.tuning(),
        qd.join(" ")
    );
    for k in 0..SEGMENTS.len() {
        let (mean, std) = statistics(cells.iter().map(|cell| cell.nmae[k]));
        let paper = row.nmae.map(|nmae| nmae[k]);
        // Results worse than the paper are highlighted.
        let mark = if paper.is_some_and(|paper| mean > paper) {
            '!'
        } else {
            ' '
        };
        let paper = paper.map_or("-".to_owned(), |paper| format!("{paper:.2}"));
        line += &format!("{paper:>7} |{mean:>6.2} +-{std:>4.1}{mark}");
    }
    line
}
