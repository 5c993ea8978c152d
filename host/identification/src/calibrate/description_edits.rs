//! Edits a machine description (TOML) and keeps its comments and format: sets, inserts and removes
//! fields. Writes the description, and the file of maps: functions of the carrier angle, one column
//! for each channel.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;
use toml_edit::{Array, DocumentMut, InlineTable, Item, Table, TableLike, Value};

use loadtwin_files::atomic_file::{AtomicFile, Complete, PublishError, publish};
use loadtwin_files::bounded;
use loadtwin_machine::{Channel, DESCRIPTION, complete_columns, six_digits};

/// Why a description cannot be changed.
#[derive(Debug, Error)]
pub enum DescriptionError {
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// It is not TOML.
    #[error("{}: {message}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
}

impl From<PublishError> for DescriptionError {
    fn from(error: PublishError) -> Self {
        Self::File {
            path: error.path,
            source: error.source,
        }
    }
}

/// A machine description as text, with its comments.
pub struct Description {
    document: DocumentMut,
}

impl Description {
    /// Reads the description in `path`.
    ///
    /// # Errors
    /// When it cannot be read or is no TOML.
    pub fn read(path: &Path) -> Result<Self, DescriptionError> {
        let text = bounded::read_text(path, bounded::DESCRIPTION).map_err(|source| {
            DescriptionError::File {
                path: path.to_owned(),
                source,
            }
        })?;
        let document = text
            .parse::<DocumentMut>()
            .map_err(|error| DescriptionError::Syntax {
                path: path.to_owned(),
                message: error.to_string().replace('\n', " "),
            })?;
        Ok(Self { document })
    }

    /// Sets `key` of the entry called `name` in the list `list`, such as
    /// `drivetrain.load`; nothing where there is no such entry.
    pub fn set(&mut self, list: &str, name: &str, key: &str, value: impl Into<Value>) {
        if let Some(entry) = self.entry(list, name) {
            put(entry, key, value.into());
        }
    }

    /// As [`Description::set`], with six digits.
    pub fn set_number(&mut self, list: &str, name: &str, key: &str, value: f64) {
        self.set(list, name, key, six_digits(value));
    }

    /// As [`Description::set`], a table of numbers by name.
    pub fn set_numbers<'a>(
        &mut self,
        list: &str,
        name: &str,
        key: &str,
        values: impl Iterator<Item = (&'a str, f64)>,
    ) {
        let table: InlineTable = values
            .map(|(name, value)| (name, Value::from(six_digits(value))))
            .collect();
        self.set(list, name, key, table);
    }

    /// Sets `key` of entry `index` of the list of tables `list` to a number of six digits;
    /// nothing where there is no such entry.
    pub fn set_number_at(&mut self, list: &str, index: usize, key: &str, value: f64) {
        self.set_at(list, index, key, six_digits(value).into());
    }

    /// As [`Description::set_number`], a matrix.
    pub fn set_matrix(&mut self, list: &str, name: &str, key: &str, rows: &[[f64; 2]]) {
        self.set(list, name, key, matrix(rows));
    }

    /// As [`Description::set_number_at`], a matrix.
    pub fn set_matrix_at(&mut self, list: &str, index: usize, key: &str, rows: &[[f64; 2]]) {
        self.set_at(list, index, key, matrix(rows).into());
    }

    fn set_at(&mut self, list: &str, index: usize, key: &str, value: Value) {
        let entry = match self.item(list) {
            Some(Item::ArrayOfTables(tables)) => tables
                .get_mut(index)
                .map(|table| table as &mut dyn TableLike),
            Some(Item::Value(Value::Array(values))) => (values.get_mut(index))
                .and_then(Value::as_inline_table_mut)
                .map(|table| table as &mut dyn TableLike),
            _ => None,
        };
        if let Some(entry) = entry {
            put(entry, key, value);
        }
    }

    /// Sets `key` of the table at the dotted `path`, of which the last part is made where it
    /// is not there.
    pub fn set_in(&mut self, path: &str, key: &str, value: impl Into<Value>) {
        let (parent, name) = path.rsplit_once('.').unwrap_or(("", path));
        if let Some(table) = self.item(parent).and_then(Item::as_table_like_mut)
            && let Some(table) = (table.entry(name))
                .or_insert_with(|| Item::Table(Table::new()))
                .as_table_like_mut()
        {
            put(table, key, value.into());
        }
    }

    /// Puts an entry called `name` with `numbers` of six digits into the list of tables `list`,
    /// before that called `next`; nothing where there is no such entry.
    pub fn insert_before(&mut self, list: &str, next: &str, name: &str, numbers: &[(&str, f64)]) {
        let numbers = numbers
            .iter()
            .map(|(key, value)| (*key, Value::from(six_digits(*value))));
        let fields: InlineTable = [("name", Value::from(name))]
            .into_iter()
            .chain(numbers)
            .collect();
        match self.item(list) {
            Some(Item::ArrayOfTables(tables)) => {
                let mut all: Vec<Table> = std::mem::take(tables).into_iter().collect();
                if let Some(place) = all.iter().position(|table| is_named(table, next)) {
                    all.insert(place, fields.into_table());
                }
                *tables = all.into_iter().collect();
            }
            Some(Item::Value(Value::Array(values))) => {
                let is_next = |value: &Value| {
                    let table = value.as_inline_table();
                    table.is_some_and(|table| is_named(table, next))
                };
                let place = values.iter().position(is_next);
                if let Some(place) = place {
                    values.insert(place, fields);
                }
            }
            _ => {}
        }
    }

    /// The value at the dotted `path`.
    fn item(&mut self, path: &str) -> Option<&mut Item> {
        let mut item: &mut Item = self.document.as_item_mut();
        for part in path.split('.').filter(|part| !part.is_empty()) {
            item = item.as_table_like_mut()?.get_mut(part)?;
        }
        Some(item)
    }

    /// Removes `key` of the entry called `name` in the list `list`.
    pub fn remove(&mut self, list: &str, name: &str, key: &str) {
        if let Some(entry) = self.entry(list, name) {
            entry.remove(key);
        }
    }

    /// The entry called `name` in `list`, in either way of writing a list of tables.
    fn entry(&mut self, list: &str, name: &str) -> Option<&mut dyn TableLike> {
        match self.item(list)? {
            Item::ArrayOfTables(tables) => tables
                .iter_mut()
                .map(|table| table as &mut dyn TableLike)
                .find(|table| is_named(*table, name)),
            Item::Value(Value::Array(values)) => values
                .iter_mut()
                .filter_map(Value::as_inline_table_mut)
                .map(|table| table as &mut dyn TableLike)
                .find(|table| is_named(*table, name)),
            _ => None,
        }
    }

    /// Sets `key` in the table `table` of an entry to the fields of `value`;
    /// nothing where there is no such table.
    ///
    /// # Errors
    /// When `value` has fields that TOML does not know.
    pub fn set_fields(
        &mut self,
        (list, name): (&str, &str),
        table: &str,
        key: &str,
        value: &impl serde::Serialize,
    ) -> Result<(), toml::ser::Error> {
        let fields: DocumentMut = toml::to_string(value)?.parse().unwrap_or_default();
        let fields = fields.as_table().clone().into_inline_table();
        let entry = self
            .entry(list, name)
            .and_then(|entry| entry.get_mut(table));
        if let Some(table) = entry.and_then(Item::as_table_like_mut) {
            put(table, key, fields.into());
        }
        Ok(())
    }

    /// Writes the description to `path`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), DescriptionError> {
        Ok(publish([self.complete(path)?])?)
    }

    /// As [`Description::write`], but that the file has no name before it is published.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn complete(&self, path: &Path) -> Result<Complete, DescriptionError> {
        let write =
            || AtomicFile::marked(path, &DESCRIPTION, &self.document.to_string())?.complete();
        write().map_err(|source| DescriptionError::File {
            path: path.to_owned(),
            source,
        })
    }
}

impl std::fmt::Display for Description {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.document.fmt(f)
    }
}

/// Whether `table` is the entry called `name`.
fn is_named(table: &dyn TableLike, name: &str) -> bool {
    table.get("name").and_then(Item::as_str) == Some(name)
}

/// Rows of numbers of six digits.
fn matrix(rows: &[[f64; 2]]) -> Array {
    let row = |row: &[f64; 2]| {
        row.iter()
            .map(|value| six_digits(*value))
            .collect::<Array>()
    };
    rows.iter().map(row).collect()
}

/// Sets a value and keeps the comment after the old one.
fn put(entry: &mut dyn TableLike, key: &str, mut value: Value) {
    match entry.get_mut(key).and_then(Item::as_value_mut) {
        Some(old) => {
            *value.decor_mut() = old.decor().clone();
            *old = value;
        }
        None => {
            entry.insert(key, Item::Value(value));
        }
    }
}

/// Writes functions over the carrier angle in equal steps, a column for each
/// channel, in the channel's unit followed by `per`; no file without columns.
///
/// # Errors
/// When the file cannot be written.
pub fn map_file(
    path: &Path,
    columns: &[(&Channel, Vec<f64>)],
    per: &str,
) -> Result<(), DescriptionError> {
    Ok(publish(complete_map(path, columns, per)?)?)
}

/// As [`map_file`], but that the file has no name before it is published.
///
/// # Errors
/// When the file cannot be written.
pub(super) fn complete_map(
    path: &Path,
    columns: &[(&Channel, Vec<f64>)],
    per: &str,
) -> Result<Option<Complete>, DescriptionError> {
    if columns.is_empty() {
        return Ok(None);
    }
    let columns: Vec<(String, Vec<f64>)> = columns
        .iter()
        .map(|(channel, values)| {
            let title = format!("{} [{}{per}]", channel.name, channel.unit.symbol());
            (title, values.clone())
        })
        .collect();
    let file = complete_columns(path, &columns).map_err(|source| DescriptionError::File {
        path: path.to_owned(),
        source,
    })?;
    Ok(Some(file))
}
