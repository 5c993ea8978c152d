//! Writes the improved description of a drive: linear part, effects and noise levels, in the table
//! `[balance]` of the original text.

use std::path::Path;

use toml_edit::{Array, ArrayOfTables, DocumentMut, Item, Table, TableLike, value};

use crate::noise_levels::Levels;
use crate::{BalanceError, Linear};
use loadtwin_files::atomic_file::AtomicFile;
use loadtwin_machine::{BalanceEffect, DESCRIPTION, Machine, read_description};

/// Digits of a coefficient.
const DIGITS: usize = 8;

/// Writes the description of `machine` with a new linear part and effects to `path`.
///
/// # Errors
/// When the description cannot be read again or `path` not be written.
pub fn write(
    machine: &Machine,
    linear: &Linear,
    effects: &[BalanceEffect],
    levels: &Levels,
    path: &Path,
) -> Result<(), BalanceError> {
    let failed = |path: &Path, reason: String| BalanceError::Write {
        path: path.to_owned(),
        reason,
    };
    let text = read_description(&machine.path).map_err(|e| failed(&machine.path, e.to_string()))?;
    let mut document: DocumentMut = text.parse().map_err(|e: toml_edit::TomlError| {
        failed(&machine.path, e.to_string().replace('\n', " "))
    })?;
    let Some(balance) = document
        .get_mut("balance")
        .and_then(Item::as_table_like_mut)
    else {
        return Err(failed(&machine.path, "no table [balance]".into()));
    };
    for (key, number) in [
        ("offset", linear.offset),
        ("inertia", linear.inertia),
        ("drag", linear.drag),
    ] {
        balance.insert(key, value(rounded(number)));
    }
    write_levels(balance, levels);
    // The recalibrated factor of a load goes into its gain.
    for (i, (load, factor)) in machine
        .balance
        .iter()
        .flat_map(|b| &b.loads)
        .zip(&linear.load_gains)
        .enumerate()
    {
        let entry = balance
            .get_mut("load")
            .and_then(Item::as_array_of_tables_mut)
            .and_then(|loads| loads.get_mut(i));
        match entry {
            Some(entry) => {
                entry.insert("gain", value(rounded(load.gain * factor)));
            }
            None => {
                return Err(failed(
                    &machine.path,
                    "write each load as [[balance.load]]".into(),
                ));
            }
        }
    }
    let mut tables = ArrayOfTables::new();
    for effect in effects {
        let numbers = |list: &[f64]| -> Array { list.iter().map(|x| rounded(*x)).collect() };
        let mut table = Table::new();
        table.insert("name", value(&effect.name));
        table.insert("shape", value(numbers(&effect.shape)));
        table.insert("coefficients", value(numbers(&effect.coefficients)));
        tables.push(table);
    }
    balance.remove("effect");
    if !effects.is_empty() {
        balance.insert("effect", Item::ArrayOfTables(tables));
    }
    let written = AtomicFile::marked(path, &DESCRIPTION, &document.to_string());
    (written.and_then(AtomicFile::finish)).map_err(|e| failed(path, e.to_string()))
}

/// Rated drive where there is none, residual, and the noise of each column.
fn write_levels(balance: &mut dyn TableLike, levels: &Levels) {
    if !balance.contains_key("nominal") {
        balance.insert("nominal", value(to_digits(levels.nominal, 3)));
    }
    balance.insert("model_std", value(to_digits(levels.model_std, 3)));
    for key in ["drive", "position", "speed"] {
        let signal = balance.get_mut(key).and_then(Item::as_table_like_mut);
        let noise = signal.and_then(|signal| {
            let name = signal.get("name")?.as_str()?;
            let (_, std) = levels.noise.iter().find(|(column, _)| column == name)?;
            Some((signal, *std))
        });
        if let Some((signal, std)) = noise {
            signal.insert("noise_std", value(to_digits(std, 3)));
        }
    }
}

fn rounded(x: f64) -> f64 {
    to_digits(x, DIGITS)
}

fn to_digits(x: f64, digits: usize) -> f64 {
    format!("{x:.*e}", digits - 1).parse().unwrap_or(x)
}
