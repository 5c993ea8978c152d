//! Origin of a report page, added to its facts: description with its hash, command, date.

use std::path::Path;
use std::time::SystemTime;

use chrono::{DateTime, Utc};
use sha2::{Digest, Sha256};

use crate::report::Report;

/// Digits of a hash that are shown: enough for the versions of one file.
const SHOWN: usize = 12;

/// `report` with the facts that it can be traced by: file name and the start of the SHA-256 of
/// `description`, the command, the day (UTC).
pub(crate) fn with_origin(mut report: Report, description: Option<&Path>) -> Report {
    report
        .facts
        .extend(description.map(|path| ["Description".into(), with_hash(path)]));
    let command = std::env::args_os()
        .skip(1)
        .map(|argument| argument.to_string_lossy().into_owned());
    let command = std::iter::once("loadtwin".to_owned()).chain(command);
    let day = DateTime::<Utc>::from(SystemTime::now()).format("%Y-%m-%d");
    report.facts.extend([
        ["Command".into(), command.collect::<Vec<_>>().join(" ")],
        ["Date".into(), day.to_string()],
    ]);
    report
}

/// File name, with the start of the hash where the file can be read.
fn with_hash(path: &Path) -> String {
    let mut name = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    if let Ok(content) = std::fs::read(path) {
        let bytes = Sha256::digest(&content);
        let first = bytes.iter().take(SHOWN / 2);
        let hash = first.fold(String::new(), |hash, byte| hash + &format!("{byte:02x}"));
        name += &format!(" (SHA-256 {hash})");
    }
    name
}
