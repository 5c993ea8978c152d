//! Writes the days of a machine to `days.parquet`, a row for each day with lists of its loads,
//! sensors and recordings, and reads them at the next run. A damaged table is read as no days,
//! which are replayed again.

use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Float64Type, Int64Type};
use arrow_array::{Array, ArrayRef, StructArray};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

use crate::ArchiveError;
use crate::day::{Day, DaySums, Days, Flags, LoadOfDay, RecordingOfDay, SensorOfDay};
use crate::table::{self, Table, booleans, counts, flags, lists, numbers, singles, structs, texts};
use crate::verdict::Verdict;

/// Name of the table in the folder of a machine.
const TABLE: &str = "days.parquet";

/// Writes the table of a machine.
///
/// # Errors
/// [`ArchiveError::Io`] when it cannot be written.
pub(crate) fn write(folder: &Path, days: &Days) -> Result<(), ArchiveError> {
    let path = folder.join(TABLE);
    let batch = batch(days).map_err(|error| ArchiveError::refused(path.display(), error))?;
    table::write(&path, &batch)
}

fn batch(days: &Days) -> Table {
    let rows = || days.values();
    let of = |get: fn(&Day) -> Option<&str>| texts(rows().map(get));
    let loads = || rows().map(|day| day.sums.loads.as_slice());
    let sensors = || rows().map(|day| day.sums.sensors.as_slice());
    let recordings = || rows().map(|day| day.recordings.as_slice());
    RecordBatch::try_from_iter_with_nullable(
        [
            ("day", texts(days.keys().map(|day| Some(day.as_str())))),
            ("verdict", of(|day| Some(day.verdict.name()))),
            ("samples", counts(rows().map(|day| day.sums.samples))),
            ("valid", counts(rows().map(|day| day.sums.valid))),
            ("seconds", numbers(rows().map(|day| Some(day.sums.seconds)))),
            ("loads", lists(loads(), load_columns)?),
            ("sensors", lists(sensors(), sensor_columns)?),
            ("recordings", lists(recordings(), recording_columns)?),
            ("fault", of(|day| day.fault.as_deref())),
            ("name", of(|day| day.name.as_deref())),
            ("description", of(|day| day.description.as_deref())),
            (
                "description_sha256",
                of(|day| day.description_sha256.as_deref()),
            ),
            ("loadtwin", of(|day| Some(&day.loadtwin))),
            ("made_from", of(|day| Some(&day.made_from))),
            ("state_sha256", of(|day| Some(&day.state_sha256))),
        ]
        .map(|(name, array)| (name, array, true)),
    )
}

fn load_columns(loads: &[&LoadOfDay]) -> table::Column {
    let all = || loads.iter();
    structs([
        ("name", texts(all().map(|load| Some(load.name.as_str())))),
        ("unit", texts(all().map(|load| Some(load.unit.as_str())))),
        ("valid", counts(all().map(|load| load.valid))),
        ("lowest", singles(all().map(|load| load.lowest))),
        ("highest", singles(all().map(|load| load.highest))),
        ("sum", numbers(all().map(|load| Some(load.sum)))),
        ("flags", flags(all().map(|load| &load.flags))?),
        ("damage", numbers(all().map(|load| load.damage))),
    ])
}

fn sensor_columns(sensors: &[&SensorOfDay]) -> table::Column {
    let all = || sensors.iter();
    structs([
        (
            "name",
            texts(all().map(|sensor| Some(sensor.name.as_str()))),
        ),
        ("compared", counts(all().map(|sensor| sensor.compared))),
        (
            "contradicting",
            counts(all().map(|sensor| sensor.contradicting)),
        ),
        ("used", counts(all().map(|sensor| sensor.used))),
        ("bias", numbers(all().map(|sensor| Some(sensor.bias)))),
        ("nis", numbers(all().map(|sensor| Some(sensor.nis)))),
        ("flags", flags(all().map(|sensor| &sensor.flags))?),
    ])
}

fn recording_columns(recordings: &[&RecordingOfDay]) -> table::Column {
    let all = || recordings.iter();
    let notes = |notes: &[&String]| Ok(texts(notes.iter().map(|note| Some(note.as_str()))));
    structs([
        ("name", texts(all().map(|of| Some(of.name.as_str())))),
        ("samples", counts(all().map(|of| of.samples))),
        ("continued", booleans(all().map(|of| of.continued))),
        ("notes", lists(all().map(|of| of.notes.as_slice()), notes)?),
        ("fault", texts(all().map(|of| of.fault.as_deref()))),
    ])
}

/// Reads the table of a machine; one that is absent or damaged has no days, which are made again.
pub(crate) fn read(folder: &Path) -> Days {
    let read = || {
        let file = File::open(folder.join(TABLE)).ok()?;
        let batches = ParquetRecordBatchReaderBuilder::try_new(file)
            .ok()?
            .build()
            .ok()?;
        let mut days = Days::new();
        for batch in batches {
            read_batch(&StructArray::from(batch.ok()?), &mut days)?;
        }
        Some(days)
    };
    // The decoder panics on some damaged pages, and so does the access to a column of another type.
    catch_unwind(AssertUnwindSafe(read))
        .ok()
        .flatten()
        .unwrap_or_default()
}

fn read_batch(rows: &StructArray, days: &mut Days) -> Option<()> {
    for row in 0..rows.len() {
        let sums = DaySums {
            samples: count(rows, "samples", row)?,
            valid: count(rows, "valid", row)?,
            seconds: number(rows, "seconds", row)?,
            loads: list(rows, "loads", row, load)?,
            sensors: list(rows, "sensors", row, sensor)?,
        };
        let day = Day {
            verdict: Verdict::named(&text(rows, "verdict", row)?)?,
            sums,
            recordings: list(rows, "recordings", row, recording)?,
            fault: text(rows, "fault", row),
            name: text(rows, "name", row),
            description: text(rows, "description", row),
            description_sha256: text(rows, "description_sha256", row),
            loadtwin: text(rows, "loadtwin", row)?,
            made_from: text(rows, "made_from", row)?,
            state_sha256: text(rows, "state_sha256", row)?,
        };
        days.insert(text(rows, "day", row)?, day);
    }
    Some(())
}

fn load(rows: &StructArray, row: usize) -> Option<LoadOfDay> {
    let single = |name| {
        let column = present(rows, name, row)?;
        Some(column.as_primitive_opt::<Float32Type>()?.value(row))
    };
    Some(LoadOfDay {
        name: text(rows, "name", row)?,
        unit: text(rows, "unit", row)?,
        valid: count(rows, "valid", row)?,
        lowest: single("lowest"),
        highest: single("highest"),
        sum: number(rows, "sum", row)?,
        flags: read_flags(rows, row)?,
        damage: number(rows, "damage", row),
    })
}

fn sensor(rows: &StructArray, row: usize) -> Option<SensorOfDay> {
    Some(SensorOfDay {
        name: text(rows, "name", row)?,
        compared: count(rows, "compared", row)?,
        contradicting: count(rows, "contradicting", row)?,
        used: count(rows, "used", row)?,
        bias: number(rows, "bias", row)?,
        nis: number(rows, "nis", row)?,
        flags: read_flags(rows, row)?,
    })
}

fn recording(rows: &StructArray, row: usize) -> Option<RecordingOfDay> {
    let notes = present(rows, "notes", row)?
        .as_list_opt::<i32>()?
        .value(row);
    let notes = notes.as_string_opt::<i32>()?.iter().flatten();
    Some(RecordingOfDay {
        name: text(rows, "name", row)?,
        samples: count(rows, "samples", row)?,
        continued: present(rows, "continued", row)?
            .as_boolean_opt()?
            .value(row),
        notes: notes.map(str::to_owned).collect(),
        fault: text(rows, "fault", row),
    })
}

/// The column of this name, where it has a value in the row.
fn present<'a>(rows: &'a StructArray, name: &str, row: usize) -> Option<&'a ArrayRef> {
    let column = rows.column_by_name(name)?;
    (row < column.len() && column.is_valid(row)).then_some(column)
}

fn text(rows: &StructArray, name: &str, row: usize) -> Option<String> {
    let column = present(rows, name, row)?.as_string_opt::<i32>()?;
    Some(column.value(row).to_owned())
}

fn count(rows: &StructArray, name: &str, row: usize) -> Option<u64> {
    let column = present(rows, name, row)?.as_primitive_opt::<Int64Type>()?;
    column.value(row).try_into().ok()
}

fn number(rows: &StructArray, name: &str, row: usize) -> Option<f64> {
    let column = present(rows, name, row)?.as_primitive_opt::<Float64Type>()?;
    Some(column.value(row))
}

fn list<T>(
    rows: &StructArray,
    name: &str,
    row: usize,
    of: fn(&StructArray, usize) -> Option<T>,
) -> Option<Vec<T>> {
    let values = present(rows, name, row)?.as_list_opt::<i32>()?.value(row);
    let values = values.as_struct_opt()?;
    (0..values.len()).map(|k| of(values, k)).collect()
}

fn read_flags(rows: &StructArray, row: usize) -> Option<Flags> {
    let entries = present(rows, "flags", row)?.as_map_opt()?.value(row);
    let names = entries.column(0).as_string_opt::<i32>()?;
    let found = entries.column(1).as_primitive_opt::<Int64Type>()?;
    let flag = |(name, count): (Option<&str>, Option<i64>)| {
        Some((name?.to_owned(), count?.try_into().ok()?))
    };
    names.iter().zip(found).map(flag).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_read_as_they_were_written_or_not_at_all() {
        let load = LoadOfDay {
            name: "shaft".into(),
            unit: "N m".into(),
            valid: 3,
            lowest: Some(-1.5),
            highest: None,
            sum: 0.1 + 0.2,
            flags: [("stuck".to_owned(), 2)].into(),
            damage: Some(1e-9),
        };
        let recording = |name: &str, notes: &[&str], fault| RecordingOfDay {
            name: name.into(),
            samples: 4,
            continued: true,
            notes: notes.iter().map(|&note| note.to_owned()).collect(),
            fault,
        };
        let day = Day {
            verdict: Verdict::NotValid,
            sums: DaySums {
                samples: 8,
                valid: 3,
                seconds: 0.3,
                loads: vec![
                    load.clone(),
                    LoadOfDay {
                        damage: None,
                        ..load
                    },
                ],
                sensors: vec![SensorOfDay::default()],
            },
            recordings: vec![
                recording("a", &["one", "two"], None),
                recording("b", &[], Some("broken".into())),
            ],
            fault: Some("damage".into()),
            name: None,
            description: Some("machine.toml".into()),
            description_sha256: None,
            loadtwin: "0".into(),
            made_from: "1".into(),
            state_sha256: "2".into(),
        };
        let empty = Day {
            sums: DaySums::default(),
            recordings: Vec::new(),
            ..day.clone()
        };
        let days: Days = [("2026-11-01".into(), day), ("2026-11-02".into(), empty)].into();
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &days).unwrap();
        assert_eq!(read(folder.path()), days);
        let path = folder.path().join(TABLE);
        let bytes = std::fs::read(&path).unwrap();
        for length in [0, 4, bytes.len() / 2, bytes.len() - 20] {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert_eq!(read(folder.path()), Days::new());
        }
    }
}
