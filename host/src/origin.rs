//! Adds to a report page the facts by which it can be traced (`with_origin`): the description and
//! the files that it names with their hashes, command, version, date; `image_fact` gives the hash
//! of the model image.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use chrono::{DateTime, Utc};
use sha2::{Digest, Sha256};

use crate::files::hex::hex;
use crate::report::Report;

/// Digits of a hash that are shown: enough for the versions of one file.
const SHOWN: usize = 12;

/// `report` with the facts that it can be traced by: file name and the start of the SHA-256 of
/// `description` and of the files that it names (calibration, maps), the command, the version, the
/// day (UTC).
pub(crate) fn with_origin(mut report: Report, description: Option<&Path>) -> Report {
    if let Some(path) = description {
        report.facts.push(["Description".into(), with_hash(path)]);
        let files: Vec<String> = (named_files(path).iter())
            .map(|file| with_hash(file))
            .collect();
        if !files.is_empty() {
            report.facts.push(["With".into(), files.join(", ")]);
        }
    }
    let command = std::env::args_os()
        .skip(1)
        .map(|argument| argument.to_string_lossy().into_owned());
    let command = std::iter::once("loadtwin".to_owned()).chain(command);
    let day = DateTime::<Utc>::from(SystemTime::now()).format("%Y-%m-%d");
    report.facts.extend([
        ["Command".into(), command.collect::<Vec<_>>().join(" ")],
        [
            "Version".into(),
            format!("loadtwin {}", env!("CARGO_PKG_VERSION")),
        ],
        ["Date".into(), day.to_string()],
    ]);
    report
}

/// The model image by the start of its SHA-256, and the number that a board with it has in its
/// status.
pub(crate) fn image_fact(image: &[u8]) -> [String; 2] {
    let digest = Sha256::digest(image);
    let mut first = [0; 4];
    first.copy_from_slice(&digest[..4]);
    let hash = hex(&digest[..SHOWN / 2]);
    let on_bus = u32::from_le_bytes(first);
    [
        "Image".into(),
        format!("SHA-256 {hash} (on the bus {on_bus:#010x})"),
    ]
}

/// File name, with the start of the hash where the file can be read.
fn with_hash(path: &Path) -> String {
    let mut name = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    if let Ok(content) = std::fs::read(path) {
        let hash = hex(&Sha256::digest(&content)[..SHOWN / 2]);
        name += &format!(" (SHA-256 {hash})");
    }
    name
}

/// Files beside the description that a text in it names.
fn named_files(description: &Path) -> Vec<PathBuf> {
    let table = std::fs::read_to_string(description)
        .ok()
        .and_then(|text| text.parse::<toml::Table>().ok());
    let folder = description.parent().unwrap_or(Path::new(""));
    let mut files = Vec::new();
    add_files(
        &toml::Value::Table(table.unwrap_or_default()),
        folder,
        &mut files,
    );
    files
}

fn add_files(value: &toml::Value, folder: &Path, files: &mut Vec<PathBuf>) {
    match value {
        toml::Value::String(name) => {
            let path = folder.join(name);
            let is_name = path.extension().is_some() && path.is_file();
            if is_name && !files.contains(&path) {
                files.push(path);
            }
        }
        toml::Value::Array(values) => values.iter().for_each(|v| add_files(v, folder, files)),
        toml::Value::Table(table) => table.values().for_each(|v| add_files(v, folder, files)),
        _ => {}
    }
}
