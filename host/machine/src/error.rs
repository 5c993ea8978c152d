//! Errors of a machine description: `Violation` of a single rule, and `MachineError` with file,
//! line and field. Finds the line of a field in the TOML text.

use std::path::{Path, PathBuf};

use loadtwin_recording::RecordingError;
use thiserror::Error;
use toml::de::{DeTable, DeValue};

/// Why a machine description cannot be used; one line that names the place.
#[derive(Debug, Error)]
pub enum MachineError {
    /// The file could not be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// It is not TOML, has an unknown field, lacks one, or a value has the wrong type.
    #[error("{}:{line}:{column}: {message}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What was found and what is allowed.
        message: String,
    },
    /// A value is out of its range, or names something that is not there.
    #[error("{}:{line}: {field}: found {found}, allowed: {allowed}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The field, as `drivetrain.inertia[1].moment_kg_m2`.
        field: String,
        /// What was found.
        found: String,
        /// What is allowed.
        allowed: String,
    },
    /// The layout of recordings is in a file that cannot be used.
    #[error(transparent)]
    Layout(#[from] Box<RecordingError>),
}

/// A value out of its range, before its place in the file is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// The field, as `drivetrain.inertia[1].moment_kg_m2`; indices from 1.
    pub field: String,
    /// What was found.
    pub found: String,
    /// What is allowed.
    pub allowed: String,
}

impl MachineError {
    /// The error of a text that is no TOML or holds a field that is not known.
    pub fn syntax(path: &Path, text: &str, error: &toml::de::Error) -> Self {
        let start = error.span().map_or(0, |span| span.start);
        let (line, column) = position(text, start);
        let message = if has_decimal_comma(text, start) {
            "found a decimal comma, allowed: a decimal point, as 2.72".to_owned()
        } else {
            in_words(&error.message().replace('\n', "; "))
        };
        Self::Syntax {
            path: path.to_owned(),
            line,
            column,
            message,
        }
    }

    /// The error of a text of another encoding, whose byte `at` is the first that is not UTF-8.
    pub(crate) fn encoding(path: &Path, bytes: &[u8], at: usize) -> Self {
        let before = String::from_utf8_lossy(bytes.get(..at).unwrap_or_default());
        let (line, column) = position(&before, before.len());
        let byte = bytes.get(at).copied().unwrap_or_default();
        Self::Syntax {
            path: path.to_owned(),
            line,
            column,
            message: format!(
                "found the byte {byte:#04x}, allowed: text in UTF-8; save the file with that encoding"
            ),
        }
    }

    /// The error of a field out of its range, with its line in `text`.
    pub fn violation(path: &Path, text: &str, violation: Violation) -> Self {
        let Violation {
            field,
            found,
            allowed,
        } = violation;
        Self::Field {
            path: path.to_owned(),
            line: line_of(text, &field),
            field,
            found,
            allowed,
        }
    }
}

/// Whether byte `at` of `text` is a comma between digits.
fn has_decimal_comma(text: &str, at: usize) -> bool {
    let is_digit = |i: Option<usize>| {
        i.and_then(|i| text.as_bytes().get(i))
            .is_some_and(u8::is_ascii_digit)
    };
    text.as_bytes().get(at) == Some(&b',') && is_digit(at.checked_sub(1)) && is_digit(Some(at + 1))
}

/// `message` of a deserialiser with the names of Rust's types in words.
fn in_words(message: &str) -> String {
    const WORDS: [(&str, &str); 7] = [
        (
            "expected f64",
            "expected a number without quotes and without unit",
        ),
        ("expected u8", "expected a whole number from 0 to 255"),
        ("expected u16", "expected a whole number from 0 to 65535"),
        ("expected u32", "expected a whole number >= 0"),
        ("expected usize", "expected a whole number >= 0"),
        ("expected i32", "expected a whole number"),
        ("expected a boolean", "expected true or false"),
    ];
    let words = WORDS.iter().find(|(name, _)| message.ends_with(name));
    words.map_or_else(
        || message.to_owned(),
        |(name, word)| message.replace(name, word),
    )
}

/// Line and column, from 1, of byte `offset`.
fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    (
        before.matches('\n').count() + 1,
        before[line_start..].chars().count() + 1,
    )
}

/// Line of `field`, or of the deepest of its parents that is in the text.
fn line_of(text: &str, field: &str) -> usize {
    let Ok(document) = DeTable::parse(text) else {
        return 1;
    };
    let mut offset = 0;
    let root = DeValue::Table(document.into_inner());
    let mut value = &root;
    for key in field.split('.') {
        let (name, index) = match key.split_once('[') {
            Some((name, rest)) => (name, rest.trim_end_matches(']').parse::<usize>().ok()),
            None => (key, None),
        };
        let DeValue::Table(table) = value else { break };
        let Some((found_key, found)) = table.get_key_value(name) else {
            break;
        };
        offset = found_key.span().start;
        value = found.get_ref();
        if let (Some(index), DeValue::Array(items)) = (index, value) {
            let Some(item) = items.get(index.saturating_sub(1)) else {
                break;
            };
            offset = item.span().start;
            value = item.get_ref();
        }
    }
    position(text, offset).0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_found_in_the_text() {
        let text = "name = \"a\"\n[drivetrain]\n[[drivetrain.inertia]]\nmoment = 1\n[[drivetrain.inertia]]\nx = 1\nmoment = -1\n";
        assert_eq!(line_of(text, "name"), 1);
        assert_eq!(line_of(text, "drivetrain.inertia[2].moment"), 7);
        assert_eq!(line_of(text, "drivetrain.inertia[2].absent"), 5);
    }
}
