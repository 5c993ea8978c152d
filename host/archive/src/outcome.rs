//! Writes the results over all machines at the end of a run: `machines.parquet`, `faults.parquet`,
//! `contradicting.csv` (machines to `diagnose`) and the HTML page of the fleet. Returns the
//! `Figures` that the commands print.

use std::fmt;
use std::path::Path;
use std::time::Duration;

use arrow_array::RecordBatch;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value, json};

use crate::machine_page::{FOLDER, rounded};
use crate::overview::{Fault, Overview};
use crate::table::{self, Table, counts, numbers, texts};
use crate::verdict::Verdict;
use crate::{ArchiveError, complete_file};

/// Tables in the folder of the results.
const MACHINES: &str = "machines.parquet";
const FAULTS: &str = "faults.parquet";
const CONTRADICTING: &str = "contradicting.csv";

/// Significant digits of a number in text.
const DIGITS: usize = 6;

/// Files of the pages beside their data.
const PAGES: [(&str, &str); 4] = [
    ("index.html", include_str!("../page/index.html")),
    ("machine.html", include_str!("../page/machine.html")),
    ("paged_table.js", include_str!("../page/paged_table.js")),
    ("style.css", include_str!("../page/style.css")),
];

/// Figures of a run; as text what the commands print.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    /// Machines.
    pub machines: u64,
    /// Days of all machines.
    pub days: u64,
    /// Days that were replayed in this run.
    pub replayed_days: u64,
    /// Samples of all days.
    pub samples: u64,
    /// Machines in each state.
    #[serde(serialize_with = "by_name")]
    pub verdicts: [(Verdict, u64); Verdict::ALL.len()],
    /// Faults of days and recordings.
    pub faults: u64,
    /// Time of the run (s).
    pub seconds: f64,
    /// Folder of the results.
    pub results: String,
    /// Whether there are pages.
    pub page: bool,
}

fn by_name<S: Serializer>(verdicts: &[(Verdict, u64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(
        verdicts
            .iter()
            .map(|(verdict, count)| (verdict.name(), count)),
    )
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            machines,
            days,
            replayed_days,
            samples,
            results,
            ..
        } = self;
        let verdicts = self.verdicts.iter().filter(|(_, count)| *count > 0);
        let verdicts = verdicts.map(|(verdict, count)| format!("{count} {}", verdict.name()));
        let verdicts: Vec<String> = verdicts.collect();
        writeln!(
            f,
            "{machines} machines, {days} days, {samples} samples; {replayed_days} days replayed"
        )?;
        write!(f, "state: {}", verdicts.join(", "))?;
        if self.faults > 0 {
            write!(f, "\nfaults: {} ({results}/{FAULTS})", self.faults)?;
        }
        let [(_, contradicting), ..] = self.verdicts;
        if contradicting > 0 {
            write!(f, "\nto diagnose: {results}/{CONTRADICTING}")?;
        }
        if self.page {
            write!(f, "\npage: {results}/{FOLDER}/index.html")?;
        }
        Ok(())
    }
}

/// Writes the tables and, with `page`, the page of all machines, given in any order.
///
/// # Errors
/// [`ArchiveError`] when they cannot be written.
pub fn write_outcome(
    results: &Path,
    mut machines: Vec<Overview>,
    page: bool,
    elapsed: Duration,
) -> Result<Figures, ArchiveError> {
    machines.sort_by(|a, b| a.machine.cmp(&b.machine));
    let failed = |error| ArchiveError::refused(results.display(), error);
    let table = machine_table(&machines).map_err(failed)?;
    table::write(&results.join(MACHINES), &table)?;
    let table = fault_table(&machines).map_err(failed)?;
    table::write(&results.join(FAULTS), &table)?;
    let text = contradicting(&machines)
        .map_err(|error| ArchiveError::refused(results.display(), error))?;
    complete_file::write(&results.join(CONTRADICTING), &text)?;
    if page {
        write_page(&results.join(FOLDER), &machines)?;
    }
    let sum = |of: fn(&Overview) -> u64| machines.iter().map(of).sum();
    let of = |verdict| machines.iter().filter(|of| of.verdict == verdict).count() as u64;
    Ok(Figures {
        machines: machines.len() as u64,
        days: sum(|of| of.days),
        replayed_days: sum(|of| of.replayed_days),
        samples: sum(|of| of.samples),
        verdicts: Verdict::ALL.map(|verdict| (verdict, of(verdict))),
        faults: sum(|of| of.faults.len() as u64),
        seconds: rounded(elapsed.as_secs_f64(), 3),
        results: results.display().to_string(),
        page,
    })
}

fn machine_table(machines: &[Overview]) -> Table {
    let of = |get: fn(&Overview) -> Option<&str>| texts(machines.iter().map(get));
    let count = |get: fn(&Overview) -> u64| counts(machines.iter().map(get));
    let number = |get: fn(&Overview) -> Option<f64>| numbers(machines.iter().map(get));
    RecordBatch::try_from_iter_with_nullable(
        [
            ("machine", of(|row| Some(&row.machine))),
            ("name", of(|row| row.name.as_deref())),
            ("verdict", of(|row| Some(row.verdict.name()))),
            ("since", of(|row| row.since.as_deref())),
            ("days", count(|row| row.days)),
            ("replayed_days", count(|row| row.replayed_days)),
            ("first_day", of(|row| row.first_day.as_deref())),
            ("last_day", of(|row| row.last_day.as_deref())),
            ("samples", count(|row| row.samples)),
            ("seconds", number(|row| Some(row.seconds))),
            ("valid_percent", number(|row| row.valid_percent)),
            ("nis", number(|row| row.nis)),
            ("sensor", of(|row| row.sensor.as_deref())),
            (
                "contradicting_percent",
                number(|row| row.contradicting_percent),
            ),
            ("bias", number(|row| row.bias)),
            ("contradicting_days", count(|row| row.contradicting_days)),
            ("load", of(|row| row.load.as_deref())),
            ("damage", number(|row| row.damage)),
            ("remaining_s", number(|row| row.remaining_s)),
            (
                "remaining_by_design_s",
                number(|row| row.remaining_by_design_s),
            ),
            ("description", of(|row| row.description.as_deref())),
        ]
        .map(|(name, column)| (name, column, true)),
    )
}

fn fault_table(machines: &[Overview]) -> Table {
    let rows = || {
        machines
            .iter()
            .flat_map(|of| of.faults.iter().map(move |fault| (of, fault)))
    };
    let of = |get: fn(&Fault) -> &String| texts(rows().map(|(_, fault)| Some(get(fault).as_str())));
    RecordBatch::try_from_iter_with_nullable(
        [
            (
                "machine",
                texts(rows().map(|(of, _)| Some(of.machine.as_str()))),
            ),
            ("day", of(|fault| &fault.day)),
            ("recording", of(|fault| &fault.recording)),
            ("fault", of(|fault| &fault.fault)),
        ]
        .map(|(name, column)| (name, column, true)),
    )
}

/// Machines whose innovations contradict their description, with what `diagnose` needs.
fn contradicting(machines: &[Overview]) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record([
        "machine",
        "since",
        "sensor",
        "contradicting_percent",
        "bias",
        "nis",
        "description",
        "recordings",
    ])?;
    let number = |value: Option<f64>| value.map(significant).unwrap_or_default();
    let text = |value: &Option<String>| value.clone().unwrap_or_default();
    for row in machines
        .iter()
        .filter(|row| row.verdict == Verdict::Contradicts)
    {
        writer.write_record([
            row.machine.clone(),
            text(&row.since),
            text(&row.sensor),
            number(row.contradicting_percent),
            number(row.bias),
            number(row.nis),
            text(&row.description),
            row.recordings.join(" "),
        ])?;
    }
    writer
        .into_inner()
        .map_err(|error| error.into_error().into())
}

/// A number with six significant digits.
fn significant(value: f64) -> String {
    let digits = DIGITS - 1;
    let short = format!("{value:.digits$e}").parse().unwrap_or(value);
    short.to_string()
}

/// Writes the page of the fleet and the frame of the machines' own pages.
fn write_page(folder: &Path, machines: &[Overview]) -> Result<(), ArchiveError> {
    let mut columns = Map::new();
    let mut column = |name: &str, value: &dyn Fn(&Overview) -> Value| {
        let values = machines.iter().map(value).collect();
        columns.insert(name.to_owned(), Value::Array(values));
    };
    let round = |value: Option<f64>, decimals| json!(value.map(|value| rounded(value, decimals)));
    column("machine", &|row| json!(row.machine));
    column("verdict", &|row| json!(row.verdict.name()));
    column("since", &|row| json!(row.since));
    column("last_day", &|row| json!(row.last_day));
    column("seconds", &|row| round(Some(row.seconds), 1));
    column("valid_percent", &|row| round(row.valid_percent, 2));
    column("nis", &|row| round(row.nis, 3));
    column("sensor", &|row| json!(row.sensor));
    column("contradicting_percent", &|row| {
        round(row.contradicting_percent, 2)
    });
    column("damage", &|row| json!(row.damage));
    column("remaining_s", &|row| round(row.remaining_s, 0));
    column("remaining_by_design_s", &|row| {
        round(row.remaining_by_design_s, 0)
    });
    column("faults", &|row| json!(row.faults.len()));
    let text = format!("const fleet = {};\n", Value::Object(columns));
    complete_file::write(&folder.join("fleet.js"), text.as_bytes())?;
    for (name, page) in PAGES {
        complete_file::write(&folder.join(name), page.as_bytes())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_text_have_six_digits() {
        assert_eq!(significant(5.123_456_789), "5.12346");
        assert_eq!(significant(-0.000_123_456_78), "-0.000123457");
        assert_eq!(significant(100.0), "100");
    }
}
