//! Renames the columns of a file to the names of the machine's channels, and sets their units, as
//! the layout states. Where no column is called `t`, finds the time by its usual names (`time`,
//! `timestamp`, `timestamps`, `zeit`).
use super::TIME;
use super::recording_layout::{Column, CsvLayout};

/// Names of a time column that is not called `t`, in lower case.
pub(super) const TIMES: [&str; 4] = ["timestamps", "timestamp", "time", "zeit"];

/// Renames the columns that `layout` gives to channels, and sets their units. A
/// column that bears the name of a channel read from another one loses it.
pub(super) fn named(columns: &[Column], layout: &CsvLayout) -> Vec<Column> {
    let mut columns = columns.to_vec();
    if layout.column_of(TIME) == TIME {
        name_time(&mut columns);
    }
    let mut named = columns.clone();
    for (channel, described) in &layout.channels {
        let written = layout.column_of(channel);
        if written != channel {
            for column in named.iter_mut().filter(|column| column.name == *channel) {
                column.name.clear();
            }
        }
        for (column, original) in named.iter_mut().zip(&columns) {
            if original.name == written {
                column.name.clone_from(channel);
                if let Some(unit) = described.unit {
                    column.unit = Some(unit.symbol().into());
                }
            }
        }
    }
    named
}

/// Finds the time by its usual names where no column is `t`. asammdf exports it as `timestamps` in
/// seconds, without a unit.
pub(super) fn name_time(columns: &mut [Column]) {
    if columns.iter().any(|column| column.name == TIME) {
        return;
    }
    for name in TIMES {
        let is_time = |column: &&mut Column| column.name.to_lowercase() == name;
        if let Some(column) = columns.iter_mut().find(is_time) {
            column.name = TIME.into();
            if name == "timestamps" {
                column.unit.get_or_insert_with(|| "s".into());
            }
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(headers: &[&str]) -> Vec<Column> {
        headers.iter().map(|h| Column::from_header(h)).collect()
    }

    #[test]
    fn channels_by_their_columns() {
        let layout: CsvLayout = toml::from_str(
            "[channels]\na = { column = 'CH 1', unit = 'm' }\nb = { column = 'a' }\nc = { unit = 's' }",
        )
        .unwrap();
        let found = named(&columns(&["time [s]", "CH 1", "a [V]", "c [m]"]), &layout);
        assert_eq!(found, columns(&["t [s]", "a [m]", "b [V]", "c [s]"]));
        let timed: CsvLayout = toml::from_str("channels.t.unit = 'ms'").unwrap();
        let found = named(&columns(&["Time", "x"]), &timed);
        assert_eq!(found, columns(&["t [ms]", "x"]));
        let exported = named(&columns(&["Timestamps", "x"]), &CsvLayout::default());
        assert_eq!(exported, columns(&["t [s]", "x"]));
        let both = named(&columns(&["Time [s]", "t [ms]"]), &CsvLayout::default());
        assert_eq!(both, columns(&["Time [s]", "t [ms]"]));
    }
}
