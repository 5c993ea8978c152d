//! Reader of recordings in text: units, dialects, gaps, and the message for each wrong file.
mod measured_data;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use loadtwin::recording::{Block, CsvLayout, Problem, Reader, RecordingError, Unit, Wanted};
use loadtwin::recording::{Row, WrittenNan};
use measured_data::measured;

fn unit(text: &str) -> Unit {
    text.parse().unwrap()
}

fn wanted<'a>(name: &'a str, symbol: &str) -> Wanted<'a> {
    Wanted {
        name,
        unit: unit(symbol),
        required: true,
    }
}

struct Bench {
    dir: tempfile::TempDir,
    layout: CsvLayout,
}

impl Bench {
    fn new() -> Self {
        Self {
            dir: tempfile::tempdir().unwrap(),
            layout: CsvLayout::default(),
        }
    }

    fn with(layout: &str) -> Self {
        Self {
            layout: toml::from_str(layout).unwrap(),
            ..Self::new()
        }
    }

    fn path(&self) -> PathBuf {
        self.dir.path().join("bench.csv")
    }

    fn open(&self, text: impl AsRef<[u8]>, want: &[Wanted]) -> Result<Reader, RecordingError> {
        std::fs::write(self.path(), text).unwrap();
        Reader::open(&self.path(), &self.layout, want)
    }

    fn read(&self, text: impl AsRef<[u8]>, want: &[Wanted]) -> Result<Vec<Block>, RecordingError> {
        self.open(text, want)?.collect()
    }

    /// The error's line without the file, which it must begin with.
    fn refused(&self, text: impl AsRef<[u8]>, want: &[Wanted]) -> String {
        let line = self.read(text, want).unwrap_err().to_string();
        assert!(!line.contains('\n'), "{line}");
        assert!(line.len() < 1500, "{line}");
        let file = self.path().display().to_string();
        let rest = line.strip_prefix(&file).expect("begins with the file");
        rest.strip_prefix(": ").unwrap().into()
    }
}

#[test]
fn units_and_order_are_those_wanted() {
    let text = "\u{feff}# a bench\nidx [counts],ta1 [um/m],t [ms],T [°C]\r\n1,100,0,20\r\n\r\n2,,2,21\r\n# noise\n3,-2.5e1,4,22";
    let want = [
        wanted("T", "K"),
        Wanted {
            required: false,
            ..wanted("torque", "Nm")
        },
        wanted("ta1", "m/m"),
        wanted("ta1", "µm/m"),
        wanted("idx", "counts"),
    ];
    let bench = Bench::new();
    let reader = bench.open(text, &want).unwrap();
    assert_eq!(reader.period_s(), 0.002);
    let names: Vec<_> = reader.columns().iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["idx", "ta1", "t", "T"]);
    let blocks: Vec<_> = reader.map(Result::unwrap).collect();
    assert_eq!(blocks.len(), 1);
    let block = &blocks[0];
    assert_eq!(block.t, [0.0, 0.002, 0.004]);
    let kelvin = [293.15, 294.15, 295.15];
    assert_eq!(block.columns[0].as_deref().unwrap(), kelvin);
    assert_eq!(block.columns[1], None);
    let strain = block.columns[2].as_deref().unwrap();
    assert_eq!((strain[0], strain[2]), (100e-6, -25e-6));
    assert!(strain[1].is_nan(), "an empty cell is a missing sample");
    assert_eq!(block.columns[3].as_deref().unwrap()[0], 100.0);
    assert_eq!(block.columns[4].as_deref().unwrap(), [1.0, 2.0, 3.0]);
    assert!(block.bridged.is_empty());
}

#[test]
fn semicolons_decimal_comma_and_named_columns() {
    let bench = Bench::with(
        "delimiter = ';'\ncomment = '%'\nskip_lines = 2\ndecimal_comma = true\n\
         columns = ['t [s]', '', 'm [mNm]']",
    );
    let text = "Recorder;2\nzeit;drehzahl;moment\n0,000;x;1,5\n% note\n0,001;y;\"-2,5\"\n";
    let blocks = bench.read(text, &[wanted("m", "Nm")]).unwrap();
    assert_eq!(blocks[0].t, [0.0, 0.001]);
    assert_eq!(blocks[0].columns[0].as_deref().unwrap(), [1.5e-3, -2.5e-3]);
}

#[test]
fn every_fault_gets_one_line_with_its_place() {
    let ta1 = [wanted("ta1", "m/m")];
    let bench = Bench::new();
    for (text, expected) in [
        ("", "is empty; allowed: a header and at least 2 rows"),
        (
            "# only a comment\n\n",
            "is empty; allowed: a header and at least 2 rows",
        ),
        ("t [s],ta1 [µm/m]\n", "has 0 rows; allowed: at least 2"),
        ("t [s],ta1 [µm/m]\n0,1\n", "has 1 rows; allowed: at least 2"),
        (
            "t [s],ta2 [µm/m],tb [µm/m]\n0,1,2\n1,1,2\n",
            "column `ta1` is missing; found: t, ta2, tb; did you mean `ta2`?",
        ),
        (
            "when [s],ta1 [µm/m]\n0,1\n1,2\n",
            "column `t` is missing; found: when, ta1 (of a text file `row_period_ms` under [recording] states \
             the time from row to row, and `skip_lines` the lines before its header)",
        ),
        (
            "t [s],ta1 [mm]\n0,1\n1,2\n",
            "column `ta1` has the unit `mm`; allowed: a unit of strain (m/m, µm/m)",
        ),
        (
            "t [s],ta1 [furlong]\n0,1\n1,2\n",
            "column `ta1` has the unit `furlong`; allowed: a unit of strain (m/m, µm/m)",
        ),
        (
            "t [s],ta1\n0,1\n1,2\n",
            "column `ta1` has no unit; allowed: a unit of strain (m/m, µm/m), in the file or as \
             `unit` of the channel under [recording.channels]",
        ),
        (
            "t [Nm],ta1 [µm/m]\n0,1\n1,2\n",
            "column `t` has the unit `Nm`; allowed: a unit of time (s, ms, µs, ns, min)",
        ),
        (
            "t [s],ta1 [µm/m],ta1 [m/m]\n0,1,2\n1,2,3\n",
            "column `ta1` is there twice; allowed: one column of each name that is \
             read",
        ),
        (
            "0,1\n1,2\n",
            "line 1 is not a header, found the number `0`; allowed: `name [unit]` for each column, \
             or `columns` under [recording] in the machine description",
        ),
        (
            "t [s],ta1 [µm/m]\n0,1\n# c\n1,abc\n",
            "row 2 (line 4), column `ta1`: found `abc`; allowed: a number, or nothing where the \
             sample is missing (`missing` under [recording] lists texts that stand for that)",
        ),
        (
            "t [s],ta1 [µm/m]\n0,1\n1,NaN\n",
            "row 2 (line 3), column `ta1`: found `NaN`; allowed: a number, or nothing where the \
             sample is missing (`written_nan = \"missing\"` under [recording] takes NaN as that)",
        ),
        (
            "t [s],ta1 [µm/m]\n0,1\n1,1e999\n",
            "row 2 (line 3), column `ta1`: found `1e999`; allowed: a finite number",
        ),
        (
            "t [s],ta1 [µm/m]\n0,1\n,2\n",
            "row 2 (line 3), column `t`: found ``; allowed: a finite number of the time unit",
        ),
        (
            "t [s],ta1 [µm/m]\n0,1\nNaN,2\n",
            "row 2 (line 3), column `t`: found `NaN`; allowed: a finite number of the time unit",
        ),
        (
            "t [s],ta1 [µm/m]\n0,1\n0.5,2\n0.25,2\n",
            "row 3 (line 4): time goes from 0.5 s to 0.25 s; allowed: only forwards",
        ),
        (
            "t [s],ta1 [µm/m]\n0,1\n0,2\n",
            "row 2 (line 3): time goes from 0 s to 0 s; allowed: only forwards",
        ),
        (
            "t [ms],ta1 [µm/m]\n0,1\n2,2\n4,2\n8,2\n10,2\n",
            "row 4 (line 5): gap of 0.004000 s after t = 0.004 s: 1 samples are missing; allowed: 0 \
             at the sample period of 0.002000 s (`largest_gap` under [recording] allows more)",
        ),
        (
            "t [s],ta1 [µm/m]\n0,1,7\n1,2\n",
            "row 1 (line 2) has 3 columns; allowed: 2",
        ),
        (
            "t [s],ta1 [µm/m]\n0,1\n1,2\n2",
            "row 3 (line 4) has 1 columns; allowed: 2 (it is the last row: the file seems to be \
             cut off)",
        ),
    ] {
        assert_eq!(bench.refused(text, &ta1), expected, "{text}");
    }
}

#[test]
fn bytes_that_are_no_text_are_named_with_their_place() {
    let ta1 = [wanted("ta1", "m/m")];
    let bench = Bench::new();
    let header = "t [s],ta1 [µm/m]\n".as_bytes();
    assert_eq!(
        bench.refused([header, b"0,1\n1,\xb5\n"].concat(), &ta1),
        "row 2 (line 3), column `ta1`: found `\\xb5`; allowed: a number, or nothing where the \
         sample is missing (`missing` under [recording] lists texts that stand for that)"
    );
    assert_eq!(
        bench.refused(b"t [s],ta1\x01 [m/m]\n0,1\n1,2\n", &ta1),
        "line 1 is not text, found `t [s],ta1\\u{1} [m/m]`; allowed: CSV, Parquet, MDF4 (`encoding` \
         under [recording] names another encoding of text)"
    );
}

#[test]
fn a_layout_that_cannot_be_is_refused() {
    for (layout, field) in [
        ("delimiter = '.'", "delimiter = '.'"),
        ("delimiter = 'µ'", "delimiter = 'µ'"),
        ("decimal_comma = true", "decimal_comma = true"),
        ("encoding = 'klingon'", "encoding = \"klingon\""),
    ] {
        let line = Bench::with(layout).refused("t [s]\n0\n1\n", &[]);
        let expected = format!("cannot be read with [recording] {field}; allowed: ");
        assert!(line.starts_with(&expected), "{line}");
    }
}

#[test]
fn a_file_that_is_not_there_or_is_a_directory() {
    let dir = tempfile::tempdir().unwrap();
    for path in [dir.path().join("absent.csv"), dir.path().into()] {
        let opened = Reader::open(&path, &CsvLayout::default(), &[]);
        let line = opened.err().unwrap().to_string();
        assert!(line.contains("cannot be read: "), "{line}");
    }
}

#[test]
fn written_nan_is_a_missing_sample_where_the_layout_says_so() {
    let mut bench = Bench::new();
    bench.layout.written_nan = WrittenNan::Missing;
    let text = "t [s],a [Nm]\n0,nan\n1,NaN\n2,3\n";
    let blocks = bench.read(text, &[wanted("a", "Nm")]).unwrap();
    let a = blocks[0].columns[0].as_deref().unwrap();
    assert!(a[0].is_nan() && a[1].is_nan());
    assert_eq!(a[2], 3.0);
}

#[test]
fn a_gap_that_is_allowed_becomes_missing_samples() {
    let bench = Bench::with("largest_gap = 2");
    let text = "t [ms],a [Nm]\n0,1\n2,2\n4,3\n10,4\n12,5\n";
    let blocks = bench.read(text, &[wanted("a", "Nm")]).unwrap();
    let block = &blocks[0];
    assert_eq!(block.bridged, [3, 4]);
    let t_ms: Vec<_> = block.t.iter().map(|t| (t * 1e3).round()).collect();
    assert_eq!(t_ms, [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0]);
    let a = block.columns[0].as_deref().unwrap();
    assert!(a[3].is_nan() && a[4].is_nan());
    assert_eq!([a[0], a[1], a[2], a[5], a[6]], [1.0, 2.0, 3.0, 4.0, 5.0]);
    let longer = "t [ms],a [Nm]\n0,1\n2,2\n4,3\n12,4\n14,5\n";
    let line = bench.refused(longer, &[]);
    assert!(
        line.starts_with("row 4 (line 5): gap of 0.008000 s"),
        "{line}"
    );
}

/// Rows of several blocks: the same whatever block they fall into.
#[test]
fn blocks_join_without_a_seam() {
    const ROWS: usize = 20_000;
    let mut text = String::from("t [ms],a [counts]\n");
    for i in 0..ROWS {
        // One sample lost at the seam between the first two blocks.
        if i != 8192 {
            writeln!(text, "{i},{}", 3 * i).unwrap();
        }
    }
    let bench = Bench::with("largest_gap = 1");
    let mut expected = 0;
    let mut last = 0.0;
    for block in bench.open(&text, &[wanted("a", "counts")]).unwrap() {
        let block = block.unwrap();
        assert_eq!(block.first_row, expected);
        assert!(block.len() <= 8192 + 1);
        let a = block.columns[0].as_deref().unwrap();
        for i in 0..block.len() {
            let row = expected + i as u64;
            assert!((block.t[i] - row as f64 * 1e-3).abs() < 1e-9);
            if row == 8192 {
                assert!(a[i].is_nan() && block.bridged == [i]);
            } else {
                assert_eq!(a[i], 3.0 * row as f64);
            }
        }
        expected += block.len() as u64;
        last = *block.t.last().unwrap();
    }
    assert_eq!((expected, last), (ROWS as u64, 19.999));

    // Errors past the first block name the row of the file.
    let wrong = text.replace("\n15000,45000\n", "\n15000,x\n");
    let mut reader = bench.open(wrong, &[wanted("a", "counts")]).unwrap();
    let error = reader.find_map(Result::err).unwrap();
    let Problem::Cell { row, found, .. } = &error.problem else {
        panic!("{error}")
    };
    let place = Row {
        row: 15_000,
        line: Some(15_001),
    };
    assert_eq!((*row, found.as_str()), (place, "x"));
    assert!(reader.next().is_none(), "nothing comes after an error");
}

#[test]
fn sample_period_that_the_machine_does_not_have() {
    let bench = Bench::new();
    let text = "t [ms],a [Nm]\n0,1\n2,2\n4,3\n";
    let open = || bench.open(text, &[]).unwrap();
    assert_eq!(open().expect_period(0.00201).unwrap().period_s(), 0.00201);
    let line = open().expect_period(0.001).err().unwrap().to_string();
    let expected =
        ": is sampled every 0.002000 s (500 Hz); allowed: 0.001000 s (1000 Hz) within 2 %";
    assert!(line.contains(expected), "{line}");
}

/// Resident memory of this process at its peak, bytes.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmHWM")).unwrap();
    1024 * line
        .split_whitespace()
        .nth(1)
        .unwrap()
        .parse::<u64>()
        .unwrap()
}

#[test]
fn a_hundred_megabytes_of_anything_fail_at_once_and_need_no_memory() {
    use rand::{Rng, SeedableRng};
    let mut bytes = vec![0; 100_000_000];
    rand_chacha::ChaCha8Rng::seed_from_u64(1).fill_bytes(&mut bytes);
    let bench = Bench::new();
    let write = |bytes: &[u8]| std::fs::write(bench.path(), bytes).unwrap();
    let named = Bench::with("columns = ['t [s]', 'a [Nm]']").layout;

    write(&bytes);
    let before = peak_memory();
    let start = std::time::Instant::now();
    for layout in [&CsvLayout::default(), &named] {
        assert!(Reader::open(&bench.path(), layout, &[]).is_err());
    }
    for byte in [0, b'"', b'7', b','] {
        bytes.fill(byte);
        write(&bytes);
        let error = Reader::open(&bench.path(), &named, &[]).err().unwrap();
        assert!(
            matches!(error.problem, Problem::LineTooLong { line: 1, .. }),
            "{error}"
        );
    }
    bytes.fill(b'\n');
    write(&bytes);
    assert!(Reader::open(&bench.path(), &named, &[]).is_err());
    assert!(start.elapsed().as_secs() < 20);
    assert!(peak_memory() - before < 32_000_000);
}

fn read_measured(path: &Path, layout: &str, want: &[Wanted]) -> (f64, Vec<f64>, Vec<Vec<f64>>) {
    let layout = toml::from_str(layout).unwrap();
    let reader = Reader::open(path, &layout, want).unwrap();
    let period = reader.period_s();
    let (mut t, mut columns) = (Vec::new(), vec![Vec::new(); want.len()]);
    for block in reader {
        let block = block.unwrap();
        t.extend(block.t);
        for (all, values) in columns.iter_mut().zip(block.columns) {
            all.extend(values.unwrap());
        }
    }
    (period, t, columns)
}

#[test]
fn measured_tool_drive() {
    let Some(folder) = measured("tool-drive") else {
        return;
    };
    let layout = r#"
        comment = "%"
        largest_gap = 20
        columns = ["t [s]", "enc_in [counts]", "torque_in [counts]", "current [A]",
                   "enc_out [counts]", "torque_out [counts]", "command_out", "command_in",
                   "enc_motor [counts]", "target [counts]"]
    "#;
    let want = [wanted("torque_in", "counts"), wanted("enc_out", "counts")];
    for file in ["00", "02", "03", "11", "21", "32"] {
        let path = folder.join(file).with_extension("TXT");
        let (period, t, columns) = read_measured(&path, layout, &want);
        assert!((period - 0.001).abs() < 1e-9, "{file}: {period}");
        assert!(t.len() > 19_000, "{file}: {} samples", t.len());
        assert!(columns[0].iter().all(|v| v.is_nan() || v.fract() == 0.0));
        if file == "00" {
            assert_eq!((columns[0][0], columns[1][0]), (1224.0, 859.0));
        }
    }
}

#[test]
fn measured_lead_screw() {
    let Some(folder) = measured("lead-screw-drive") else {
        return;
    };
    let layout = r#"
        delimiter = ";"
        skip_lines = 14
        columns = ["t [ms]", "speed [rpm]", "torque [%]"]
    "#;
    let want = [wanted("speed", "rpm"), wanted("torque", "1")];
    let path = folder.join("steady_state/0.096kg/100.csv");
    let (period, t, columns) = read_measured(&path, layout, &want);
    assert_eq!(t.len(), 500);
    assert!(period > 0.0);
    // The file is named for the speed; the drive turns the other way round.
    let mean = columns[0].iter().sum::<f64>() / 500.0;
    assert!((mean + 100.0).abs() < 2.0, "mean speed {mean} rpm");
}

#[test]
fn measured_axis_and_slow_turn() {
    if let Some(folder) = measured("positioning-axis") {
        let layout = "skip_lines = 1\n\
                      columns = ['t [s]', 'target [m]', 'position [m]', 'drive [V]']";
        let want = [wanted("position", "m"), wanted("drive", "V")];
        let (period, t, columns) = read_measured(&folder.join("axis-tracking.csv"), layout, &want);
        assert!((period - 0.001).abs() < 1e-6);
        assert_eq!(t.len(), 24_841);
        assert_eq!((columns[0][0], columns[1][0]), (7.45e-6, 2.538_628_1));
    }
    if let Some(folder) = measured("direct-drive-motor") {
        let layout = "skip_lines = 1\nlargest_gap = 5\ntiming = 'free'\n\
                      columns = ['t [s]', 'position [counts]', 'i [A]']";
        let want = [wanted("position", "counts"), wanted("i", "A")];
        let (period, t, _) = read_measured(&folder.join("slow-turn-0.csv"), layout, &want);
        assert!((0.002..0.003).contains(&period), "{period}");
        assert!((9.9..10.1).contains(&(t[t.len() - 1] - t[0])));
    }
}
