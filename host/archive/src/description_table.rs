//! Reads `descriptions.csv` of an archive: for each machine the description files, the days from
//! and to which each is valid, and the counted load with its S-N curve and design spectrum
//! (`Entry`). `at` finds the row that is valid on a day.

use std::collections::BTreeMap;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord};
use loadtwin_life::number_pair;
use serde::{Deserialize, Serialize};

use crate::ArchiveError;
use crate::layout::is_date;

/// Name of the table in the archive.
pub(crate) const TABLE: &str = "descriptions.csv";

const REQUIRED: [&str; 3] = ["machine", "from", "description"];
const OPTIONAL: [&str; 6] = ["to", "sha256", "load", "sn", "range", "design"];

/// Columns of a design spectrum.
const DESIGN: [&str; 2] = ["range", "cycles_per_hour"];

/// Byte order mark that spreadsheets write.
const MARK: &str = "\u{feff}";

/// A row of the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// First day for which it holds, as 2026-11-28.
    pub first: String,
    /// Last day; none where it holds until another one does.
    pub last: Option<String>,
    /// Path of the description.
    pub path: String,
    /// SHA-256 that it has to have (hexadecimal).
    pub sha256: Option<String>,
    /// Load whose cycles are counted.
    pub load: Option<String>,
    /// Points of the S-N curve: cycles, range (in the load's unit); empty for none.
    pub sn: Vec<(f64, f64)>,
    /// Lowest and highest load that the levels of the counts cover (in the load's unit).
    pub range: Option<(f64, f64)>,
    /// Cycles that the machine is designed for: range (in the load's unit), cycles an hour; empty for
    /// none.
    pub design: Vec<(f64, f64)>,
}

/// Reads the table of the archive in `folder`: rows by machine, in the order of their first days.
///
/// # Errors
/// [`ArchiveError::Refused`] with the line that is refused.
pub(crate) fn read(folder: &Path) -> Result<BTreeMap<String, Vec<Entry>>, ArchiveError> {
    let path = folder.join(TABLE);
    let shown = path.display();
    if !path.is_file() {
        let columns = REQUIRED.join(", ");
        let reason = format!("no such table; it has a row for each description: {columns}");
        return Err(ArchiveError::refused(shown, reason));
    }
    let bytes = std::fs::read(&path).map_err(ArchiveError::io(&path))?;
    let unreadable = |error: csv::Error| ArchiveError::refused(shown.to_string(), error);
    let mut reader = ReaderBuilder::new()
        .flexible(true)
        .from_reader(bytes.strip_prefix(MARK.as_bytes()).unwrap_or(&bytes));
    let header = reader.headers().map_err(unreadable)?;
    let columns: Vec<String> = header.iter().map(|name| name.trim().to_owned()).collect();
    check(&columns).map_err(|reason| ArchiveError::refused(shown.to_string(), reason))?;
    let mut found: BTreeMap<String, Vec<Entry>> = BTreeMap::new();
    for row in reader.records() {
        let row = row.map_err(unreadable)?;
        let line = row.position().map_or(0, csv::Position::line);
        let at = |reason: String| ArchiveError::refused(format!("{shown}:{line}"), reason);
        let (machine, entry) = entry(&columns, &row, folder).map_err(at)?;
        let entries = found.entry(machine.clone()).or_default();
        if entries.iter().any(|other| other.first == entry.first) {
            let first = &entry.first;
            return Err(at(format!(
                "machine '{machine}' has two descriptions from {first} on"
            )));
        }
        entries.push(entry);
    }
    for entries in found.values_mut() {
        entries.sort_by(|a, b| a.first.cmp(&b.first));
    }
    Ok(found)
}

/// The description that holds on a day.
///
/// # Errors
/// In words, where none does.
pub(crate) fn at<'a>(entries: &'a [Entry], day: &str) -> Result<&'a Entry, String> {
    let none = |why: String| {
        Err(format!(
            "no description for this machine on {day} in {TABLE}: {why}"
        ))
    };
    let begun = entries.iter().rfind(|entry| entry.first.as_str() <= day);
    match (begun, entries.first()) {
        (None, None) => none("it has none".into()),
        (None, Some(first)) => none(format!("the first one is valid from {} on", first.first)),
        (Some(entry), _) => match &entry.last {
            Some(last) if day > last.as_str() => none(format!("one ends on {last}")),
            _ => Ok(entry),
        },
    }
}

fn check(columns: &[String]) -> Result<(), String> {
    if let Some(name) = REQUIRED
        .iter()
        .find(|name| !columns.iter().any(|c| c == *name))
    {
        let found = columns.join(", ");
        return Err(format!("no column '{name}'; found: {found}"));
    }
    let known = [&REQUIRED[..], &OPTIONAL].concat();
    for (k, name) in columns.iter().enumerate() {
        if !known.contains(&name.as_str()) {
            let allowed = known.join(", ");
            return Err(format!("unknown column '{name}'; allowed: {allowed}"));
        }
        if columns[..k].contains(name) {
            return Err(format!("column '{name}' is there twice; allowed: once"));
        }
    }
    Ok(())
}

fn entry(
    columns: &[String],
    row: &StringRecord,
    archive: &Path,
) -> Result<(String, Entry), String> {
    if row.len() != columns.len() {
        return Err("another number of cells than the header has".into());
    }
    let cell = |name: &str| {
        let column = columns.iter().position(|column| column == name)?;
        row.get(column)
            .map(str::trim)
            .filter(|cell| !cell.is_empty())
    };
    let (Some(machine), Some(description)) = (cell("machine"), cell("description")) else {
        return Err("machine or description is empty".into());
    };
    let (sn, load, range) = (cell("sn"), cell("load"), cell("range"));
    if load.is_none() && (sn.is_some() || range.is_some()) {
        return Err("sn or range without the load that they are for".into());
    }
    let design = cell("design");
    if sn.is_none() && design.is_some() {
        return Err("design without the S-N curve (sn) that it is for".into());
    }
    let path = archive.join(description);
    let entry = Entry {
        first: date("from", cell("from").unwrap_or_default())?,
        last: cell("to").map(|text| date("to", text)).transpose()?,
        path: path.to_string_lossy().into_owned(),
        sha256: cell("sha256").map(str::to_lowercase),
        load: load.map(str::to_owned),
        sn: (sn.iter())
            .flat_map(|sn| sn.split(','))
            .map(|text| pair("sn", text))
            .collect::<Result<_, _>>()?,
        range: range.map(|text| pair("range", text)).transpose()?,
        design: design.map_or(Ok(Vec::new()), |name| design_spectrum(&archive.join(name)))?,
    };
    Ok((machine.to_owned(), entry))
}

/// Reads a design spectrum: a row for each range of cycles.
fn design_spectrum(path: &Path) -> Result<Vec<(f64, f64)>, String> {
    let shown = path.display();
    let refused = |error: csv::Error| format!("{shown}: {error}");
    let mut reader = csv::Reader::from_path(path).map_err(refused)?;
    if reader.headers().map_err(refused)? != DESIGN.as_slice() {
        return Err(format!(
            "{shown}: allowed: the columns {}",
            DESIGN.join(",")
        ));
    }
    let rows = reader.deserialize().map(|row| {
        let (range, per_hour): (f64, f64) = row.map_err(refused)?;
        if range > 0.0 && per_hour >= 0.0 && range.is_finite() && per_hour.is_finite() {
            return Ok((range, per_hour));
        }
        Err(format!(
            "{shown}: found {range},{per_hour}, allowed: a range above 0 and cycles from 0 on"
        ))
    });
    rows.collect()
}

fn date(name: &str, text: &str) -> Result<String, String> {
    if is_date(text) {
        return Ok(text.to_owned());
    }
    Err(format!(
        "{name}: found '{text}', allowed: a date, as 2026-11-28"
    ))
}

fn pair(name: &str, text: &str) -> Result<(f64, f64), String> {
    number_pair(text)
        .ok_or_else(|| format!("{name}: found '{text}', allowed: two numbers with a colon between"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_row_that_has_begun_holds_until_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let table = "\u{feff}machine, from ,to,description,load,sn\n\
                     g,2026-02-01,2026-02-09,b.toml,,\n\
                     g,2026-01-01,,a.toml,shaft,\"1e4:5e5, 2e6:1e5\"\n";
        std::fs::write(folder.path().join(TABLE), table).unwrap();
        let entries = &read(folder.path()).unwrap()["g"];
        let name = |day| at(entries, day).map(|entry| entry.path.rsplit('/').next().unwrap());
        assert_eq!(name("2026-01-31"), Ok("a.toml"));
        assert_eq!(name("2026-02-09"), Ok("b.toml"));
        assert!(
            name("2026-02-10")
                .unwrap_err()
                .ends_with("one ends on 2026-02-09")
        );
        assert!(
            name("2025-12-31")
                .unwrap_err()
                .contains("from 2026-01-01 on")
        );
        assert!(at(&[], "2026-01-01").unwrap_err().ends_with("it has none"));
        assert_eq!(entries[0].sn, [(1e4, 5e5), (2e6, 1e5)]);
    }
}
