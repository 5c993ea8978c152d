//! Round trip of recordings in CSV, Parquet and MDF4, and one line of error for each damaged file.
use std::path::Path;

use loadtwin::recording::{
    BLOCK_ROWS, Block, CsvLayout, OutputColumn, Problem, Reader, RecordingError, Wanted, Writer,
};

const FORMATS: [&str; 3] = ["csv", "parquet", "mf4"];

fn columns() -> Vec<OutputColumn> {
    let column = |name: &str, unit: &str, single| OutputColumn {
        name: name.into(),
        unit: unit.parse().unwrap(),
        single,
    };
    vec![
        column("ta1", "µm/m", true),
        column("enc", "counts", false),
        column("T", "°C", false),
    ]
}

/// Samples of the machine at 500 Hz; every 100th strain is missing.
fn sample(i: usize) -> (f64, [f64; 3]) {
    let strain = if i % 100 == 7 {
        f64::NAN
    } else {
        f64::from((i as f32 * 0.37).sin() * 120.0)
    };
    let t = i as f64 / 500.0;
    (t, [strain, (i * 17 % 8192) as f64, 20.0 + 1e-5 * i as f64])
}

fn write(path: &Path, rows: usize) -> Result<(), RecordingError> {
    let mut writer = Writer::create(path, &columns(), &[("machine", "bench\n2")])?;
    for start in (0..rows).step_by(1000) {
        let samples: Vec<_> = (start..rows.min(start + 1000)).map(sample).collect();
        let t: Vec<f64> = samples.iter().map(|s| s.0).collect();
        let values: Vec<Vec<f64>> = (0..3)
            .map(|k| samples.iter().map(|s| s.1[k]).collect())
            .collect();
        let slices: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
        writer.write(&t, &slices)?;
    }
    writer.finish()
}

fn open(path: &Path, names: &[(&str, &str)]) -> Result<Reader, RecordingError> {
    let wanted: Vec<_> = names
        .iter()
        .map(|&(name, unit)| Wanted {
            name,
            unit: unit.parse().unwrap(),
            required: true,
        })
        .collect();
    Reader::open(path, &CsvLayout::default(), &wanted)
}

fn read(path: &Path, names: &[(&str, &str)]) -> Result<Vec<Block>, RecordingError> {
    open(path, names)?.collect()
}

fn names(folder: &Path) -> Vec<String> {
    std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect()
}

#[test]
fn what_is_written_comes_back_in_every_format() {
    const ROWS: usize = 70_001;
    let dir = tempfile::tempdir().unwrap();
    for format in FORMATS {
        let path = dir.path().join("out").with_extension(format);
        write(&path, ROWS).unwrap();
        assert_eq!(names(dir.path()).len(), 1);
        let all = [("T", "K"), ("ta1", "µm/m"), ("enc", "counts")];
        let mut reader = open(&path, &all).unwrap();
        assert!((reader.period_s() - 0.002).abs() < 1e-12);
        assert_eq!(reader.columns().len(), 4);
        for (name, unit) in [("t", "s"), ("ta1", "µm/m"), ("enc", "counts"), ("T", "°C")] {
            let column = reader.columns().iter().find(|c| c.name == name).unwrap();
            assert_eq!(column.unit.as_deref(), Some(unit), "{format}");
        }
        let mut i = 0;
        while let Some(block) = reader.next() {
            let block = block.unwrap();
            assert!(block.len() <= 2 * BLOCK_ROWS);
            assert_eq!(block.first_row, i as u64);
            for k in 0..block.len() {
                let (t, [strain, enc, temperature]) = sample(i);
                assert_eq!(block.t[k], t, "{format} row {i}");
                let value = |c: usize| block.columns[c].as_ref().unwrap()[k];
                assert_eq!(value(0), temperature + 273.15, "{format} row {i}");
                // CSV holds the shortest decimal of the f32.
                let same = value(1) as f32 == strain as f32;
                assert!(same || (strain.is_nan() && value(1).is_nan()), "row {i}");
                assert_eq!(value(2), enc, "{format} row {i}");
                i += 1;
            }
            assert!((0.0..=1.0).contains(&reader.progress()));
        }
        assert_eq!(i, ROWS, "{format}");
        assert!(reader.progress() > 0.99, "{format}: {}", reader.progress());
        std::fs::remove_file(&path).unwrap();
    }
}

#[test]
fn the_same_faults_are_found_in_every_format() {
    let dir = tempfile::tempdir().unwrap();
    for format in FORMATS {
        let path = dir.path().join("out").with_extension(format);
        let refused = |names: &[(&str, &str)]| read(&path, names).unwrap_err().problem;

        write(&path, 100).unwrap();
        let problem = refused(&[("ta2", "m/m")]);
        assert!(
            matches!(&problem, Problem::Missing { nearest: Some(n), .. } if n == "ta1"),
            "{format}: {problem}"
        );
        let problem = refused(&[("ta1", "mm")]);
        assert!(
            matches!(&problem, Problem::WrongUnit { column, found, .. } if column == "ta1" && found == "µm/m"),
            "{format}: {problem}"
        );

        for rows in [0, 1] {
            write(&path, rows).unwrap();
            let problem = refused(&[("ta1", "m/m")]);
            let expected = rows as u64;
            assert!(
                matches!(problem, Problem::TooShort { found } if found == expected),
                "{format}: {problem}"
            );
        }

        // Time that stands still and a gap; infinity is no measured value.
        let cases = [
            ([0.0, 0.1, 0.1, 0.2], [0.0; 4], "row 3"),
            ([0.0, 0.1, 0.2, 0.5], [0.0; 4], "row 4"),
            (
                [0.0, 0.1, 0.2, 0.3],
                [0.0, f64::INFINITY, 0.0, 0.0],
                "row 2",
            ),
        ];
        for (t, a, row) in cases {
            let column = OutputColumn {
                single: false,
                ..columns()[1].clone()
            };
            let mut writer = Writer::create(&path, &[column], &[]).unwrap();
            writer.write(&t, &[&a]).unwrap();
            writer.finish().unwrap();
            let line = read(&path, &[("enc", "counts")]).unwrap_err().to_string();
            assert!(line.contains(row), "{format}: {line}");
            assert!(!line.contains('\n'), "{format}: {line}");
        }
    }
}

#[test]
fn a_file_cut_off_anywhere_is_refused_but_for_the_ends_of_lines() {
    let dir = tempfile::tempdir().unwrap();
    for format in FORMATS {
        let whole = dir.path().join("whole").with_extension(format);
        let cut = dir.path().join("cut").with_extension(format);
        write(&whole, 3000).unwrap();
        let bytes = std::fs::read(&whole).unwrap();
        for part in 0..40 {
            let length = bytes.len() * part / 40;
            // The text format has no mark of its end; a cut inside a row shows.
            let begin_of_line = bytes[..length].iter().rposition(|&b| b == b'\n');
            let line = &bytes[begin_of_line.map_or(0, |n| n + 1)..length];
            if format == "csv" && line.split(|&b| b == b',').count() == 4 {
                continue;
            }
            if format == "csv" && line.is_empty() && part > 0 {
                continue;
            }
            std::fs::write(&cut, &bytes[..length]).unwrap();
            let all = [("ta1", "m/m"), ("enc", "counts")];
            let error = read(&cut, &all).expect_err(&format!("{format} cut at {length}"));
            let line = error.to_string();
            assert!(!line.contains('\n') && line.len() < 600, "{line}");
        }
    }
}

#[test]
fn the_format_is_known_by_content_not_by_name() {
    let dir = tempfile::tempdir().unwrap();
    for format in FORMATS {
        let path = dir.path().join("out").with_extension(format);
        write(&path, 100).unwrap();
        let renamed = dir.path().join("renamed.dat");
        std::fs::rename(&path, &renamed).unwrap();
        assert_eq!(read(&renamed, &[("ta1", "m/m")]).unwrap()[0].len(), 100);
    }
}

#[test]
fn nothing_is_left_of_an_output_that_was_not_finished() {
    let dir = tempfile::tempdir().unwrap();
    for format in FORMATS {
        let path = dir.path().join("out").with_extension(format);
        let mut writer = Writer::create(&path, &columns(), &[]).unwrap();
        writer.write(&[0.0], &[&[1.0], &[1.0], &[1.0]]).unwrap();
        drop(writer);
        assert!(names(dir.path()).is_empty(), "{format}");
    }
    let absent = dir.path().join("absent/out.csv");
    for path in [absent.as_path(), dir.path(), Path::new("estimates.xlsx")] {
        let line = write(path, 1).unwrap_err().to_string();
        assert!(line.contains("cannot be written"), "{line}");
    }
    assert!(names(dir.path()).is_empty());
}

#[test]
fn an_mdf_file_that_would_not_fit_into_memory_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("long.mf4");
    let mut writer = Writer::create(&path, &columns()[..1], &[]).unwrap();
    let block = vec![0.0; 1 << 20];
    let error = (0..100).find_map(|_| writer.write(&block, &[&block]).err());
    assert!(matches!(error.unwrap().problem, Problem::TooLong { .. }));
}

#[test]
fn a_parquet_column_of_text_and_a_written_nan_are_refused() {
    use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray};
    use std::sync::Arc;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bench.parquet");
    // Units in the names, as tables without field metadata have them.
    let t: ArrayRef = Arc::new(Float64Array::from(vec![0.0, 0.1, 0.2]));
    let a: ArrayRef = Arc::new(Float64Array::from(vec![Some(1.0), None, Some(f64::NAN)]));
    let note: ArrayRef = Arc::new(StringArray::from(vec!["a", "b", "c"]));
    let batch =
        RecordBatch::try_from_iter([("t [s]", t), ("a [Nm]", a), ("note [1]", note)]).unwrap();
    let file = std::fs::File::create(&path).unwrap();
    let mut writer = parquet::arrow::ArrowWriter::try_new(file, batch.schema(), None).unwrap();
    writer.write(&batch).unwrap();
    writer.close().unwrap();

    let line = |names| {
        let line = read(&path, names).unwrap_err().to_string();
        line.strip_prefix(&format!("{}: ", path.display()))
            .unwrap()
            .to_string()
    };
    assert_eq!(
        line(&[("a", "Nm")]),
        "row 3, column `a`: found `NaN`; allowed: a number, or nothing where the sample is missing \
         (`written_nan = \"missing\"` under [recording] takes NaN as that)"
    );
    assert_eq!(
        line(&[("note", "1")]),
        "column `note` holds Utf8; allowed: numbers, Booleans, timestamps, times of day, durations \
         (`type` of the channel under [recording.channels] reads text as one of them)"
    );
    let layout: CsvLayout = toml::from_str("written_nan = 'missing'").unwrap();
    let wanted = Wanted {
        name: "a",
        unit: "mNm".parse().unwrap(),
        required: true,
    };
    let mut reader = Reader::open(&path, &layout, &[wanted]).unwrap();
    let block = reader.next().unwrap().unwrap();
    let a = block.columns[0].as_deref().unwrap();
    assert!(a[0] == 1000.0 && a[1].is_nan() && a[2].is_nan());
}
