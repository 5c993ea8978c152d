//! Damaged recordings: whatever the bytes, the reader ends with rows or with one
//! line, without a panic and in bounded memory. `LOADTWIN_FUZZ=20` tries 20 times
//! as many.
use std::path::Path;

use loadtwin::recording::{CsvLayout, OutputColumn, Problem, Reader, Wanted, Writer};
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

/// One way to spoil a file.
#[derive(Clone, Debug)]
enum Damage {
    Overwrite(Index, Vec<u8>),
    Insert(Index, Vec<u8>),
    Remove(Index, u8),
    CutOff(Index),
    Repeat(Index, Index),
}

impl Damage {
    fn apply(&self, bytes: &mut Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        match self {
            Self::Overwrite(at, new) => {
                let at = at.index(bytes.len());
                let end = bytes.len().min(at + new.len());
                bytes[at..end].copy_from_slice(&new[..end - at]);
            }
            Self::Insert(at, new) => {
                let at = at.index(bytes.len());
                bytes.splice(at..at, new.iter().copied());
            }
            Self::Remove(at, count) => {
                let at = at.index(bytes.len());
                let end = bytes.len().min(at + usize::from(*count));
                bytes.drain(at..end);
            }
            Self::CutOff(at) => bytes.truncate(at.index(bytes.len())),
            Self::Repeat(from, to) => {
                let (from, to) = (from.index(bytes.len()), to.index(bytes.len()));
                let copy = bytes[from.min(to)..from.max(to)].to_vec();
                bytes.splice(to..to, copy);
            }
        }
    }
}

/// Bytes that mean something to a decoder: lengths, delimiters, extremes.
fn spice() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        any::<u8>().prop_map(|b| vec![b]),
        any::<u64>().prop_map(|n| n.to_le_bytes().to_vec()),
        (0_u32..64).prop_map(|n| (1_u64 << n).to_le_bytes().to_vec()),
        prop::collection::vec(any::<u8>(), 1..40),
        Just(vec![0xff; 8]),
        Just(vec![0; 8]),
        Just(b"\"".to_vec()),
        Just(b",\n".to_vec()),
        Just(b"nan,-inf,1e999,\n".to_vec()),
    ]
}

fn damage() -> impl Strategy<Value = Vec<Damage>> {
    let index = any::<Index>;
    let one = prop_oneof![
        6 => (index(), spice()).prop_map(|(at, new)| Damage::Overwrite(at, new)),
        2 => (index(), spice()).prop_map(|(at, new)| Damage::Insert(at, new)),
        1 => (index(), any::<u8>()).prop_map(|(at, count)| Damage::Remove(at, count)),
        1 => index().prop_map(Damage::CutOff),
        1 => (index(), index()).prop_map(|(from, to)| Damage::Repeat(from, to)),
    ];
    prop::collection::vec(one, 1..5)
}

/// Reads all of the file, whatever comes.
fn read(path: &Path) -> Result<(), TestCaseError> {
    let wanted: Vec<_> = ["ta1", "enc"]
        .into_iter()
        .zip(["m/m", "counts"])
        .map(|(name, unit)| Wanted {
            name,
            unit: unit.parse().unwrap(),
            required: false,
        })
        .collect();
    let layout: CsvLayout = toml::from_str("largest_gap = 3").unwrap();
    let error = match Reader::open(path, &layout, &wanted) {
        Ok(reader) => {
            let mut before = f64::NEG_INFINITY;
            let mut error = None;
            for block in reader {
                match block {
                    Ok(block) => {
                        for &t in &block.t {
                            prop_assert!(t > before && t.is_finite());
                            before = t;
                        }
                        for values in block.columns.iter().flatten() {
                            prop_assert_eq!(values.len(), block.len());
                            prop_assert!(!values.iter().any(|v| v.is_infinite()));
                        }
                    }
                    Err(e) => error = Some(e),
                }
            }
            error
        }
        Err(e) => Some(e),
    };
    if let Some(error) = error {
        let line = error.to_string();
        prop_assert!(!line.contains('\n') && line.len() < 2000, "{}", line);
        // Panics of the decoders are contained; the text reader has none.
        let panicked = matches!(&error.problem, Problem::Damaged { format: "CSV", .. });
        prop_assert!(!panicked, "{}", line);
    }
    Ok(())
}

/// Resident memory of this process at its peak, bytes.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmHWM")).unwrap();
    let kilobytes = line.split_whitespace().nth(1).unwrap();
    1024 * kilobytes.parse::<u64>().unwrap()
}

/// A new file for each case: file systems make certain of a file that is
/// overwritten, and that takes ten times as long as the case.
fn replace(path: &Path, bytes: &[u8]) {
    let _ = std::fs::remove_file(path);
    std::fs::write(path, bytes).unwrap();
}

fn times() -> u32 {
    std::env::var("LOADTWIN_FUZZ").map_or(1, |n| n.parse().unwrap())
}

/// The same cases in every run.
fn runner(cases: u32) -> TestRunner {
    let config = Config {
        cases: cases * times(),
        failure_persistence: None,
        ..Config::default()
    };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
}

/// At most 256 MiB beyond the data, for each of the tests that run at once.
fn assert_memory_is_bounded() {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let limit = (threads.max(2) as u64 + 1) * (256 << 20);
    assert!(peak_memory() < limit, "{} bytes", peak_memory());
}

/// Reads `seed` with `cases` different damages.
fn survive(seed: &[u8], cases: u32) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged");
    std::fs::write(&path, seed).unwrap();
    read(&path).unwrap();
    runner(cases)
        .run(&damage(), |damage| {
            let mut bytes = seed.to_vec();
            for one in &damage {
                one.apply(&mut bytes);
            }
            replace(&path, &bytes);
            read(&path)
        })
        .unwrap();
    assert_memory_is_bounded();
}

fn whole(extension: &str, rows: usize) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("whole").with_extension(extension);
    let column = |name: &str, unit: &str, single| OutputColumn {
        name: name.into(),
        unit: unit.parse().unwrap(),
        single,
    };
    let columns = [column("ta1", "µm/m", true), column("enc", "counts", false)];
    let t: Vec<f64> = (0..rows).map(|i| i as f64 * 0.002).collect();
    let ta1: Vec<f64> = (0..rows)
        .map(|i| {
            if i % 9 == 4 {
                f64::NAN
            } else {
                (i as f64).sin()
            }
        })
        .collect();
    let enc: Vec<f64> = (0..rows).map(|i| (i * 7) as f64).collect();
    let mut writer = Writer::create(&path, &columns, &[("machine", "bench")]).unwrap();
    writer.write(&t, &[&ta1, &enc]).unwrap();
    writer.finish().unwrap();
    std::fs::read(&path).unwrap()
}

#[test]
fn damaged_csv() {
    survive(&whole("csv", 60), 6000);
}

#[test]
fn damaged_parquet() {
    survive(&whole("parquet", 60), 6000);
}

#[test]
fn damaged_parquet_of_every_encoding() {
    use arrow_array::{ArrayRef, Float32Array, Float64Array, Int64Array, RecordBatch};
    use parquet::basic::{Compression, Encoding};
    use parquet::file::properties::{WriterProperties, WriterVersion};
    use std::sync::Arc;
    let t: ArrayRef = Arc::new(Float64Array::from_iter_values((0..200).map(f64::from)));
    let ta1: Float32Array = (0..200_u8)
        .map(|i| (i % 9 != 4).then(|| f32::from(i)))
        .collect();
    let enc: ArrayRef = Arc::new(Int64Array::from_iter_values(0..200));
    let columns = [
        ("t [s]", t),
        ("ta1 [µm/m]", Arc::new(ta1)),
        ("enc [counts]", enc),
    ];
    let batch = RecordBatch::try_from_iter(columns).unwrap();
    for (compression, encoding, dictionary) in [
        (Compression::SNAPPY, Encoding::PLAIN, true),
        (Compression::UNCOMPRESSED, Encoding::PLAIN, false),
        (
            Compression::ZSTD(parquet::basic::ZstdLevel::default()),
            Encoding::PLAIN,
            true,
        ),
        (
            Compression::GZIP(parquet::basic::GzipLevel::default()),
            Encoding::BYTE_STREAM_SPLIT,
            false,
        ),
    ] {
        let properties = WriterProperties::builder()
            .set_compression(compression)
            .set_encoding(encoding)
            .set_dictionary_enabled(dictionary)
            .set_writer_version(WriterVersion::PARQUET_2_0)
            .build();
        let mut bytes = Vec::new();
        let mut writer =
            parquet::arrow::ArrowWriter::try_new(&mut bytes, batch.schema(), Some(properties))
                .unwrap();
        writer.write(&batch).unwrap();
        writer.close().unwrap();
        survive(&bytes, 1500);
    }
}

#[test]
fn damaged_mdf() {
    survive(&whole("mf4", 60), 6000);
}

#[test]
fn damaged_mdf_with_compressed_blocks() {
    let t: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.002).collect();
    let mut writer = falcon_mdf::Mf4Writer::with_start_time_ns(0);
    writer.set_compression(true);
    let group = writer.add_group(&t).unwrap();
    group.add_channel("ta1", "m/m", &t).unwrap();
    group.add_channel("enc", "counts", &t).unwrap();
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    survive(&bytes, 4000);
}

#[test]
fn damaged_text_of_other_programs() {
    let csv = String::from_utf8(whole("csv", 60)).unwrap();
    let semicolons = csv.replace(',', ";").replace('.', ",");
    let utf16: Vec<u8> = (semicolons.encode_utf16())
        .flat_map(u16::to_le_bytes)
        .collect();
    let windows: Vec<u8> = semicolons.chars().map(|c| c as u32 as u8).collect();
    let excel = format!("sep=;\n{semicolons}");
    let mut stamped = String::from("t,ta1 [µm/m],enc [counts]\n");
    for i in 0..60 {
        stamped += &format!("2026-03-31T12:00:00.{:03},{i},{}\n", 2 * i, 7 * i);
    }
    let rows = "t,ta1,enc\ns,µm/m,counts\n0,1,true\n0.002,2,false\n0.004,3,true\n";
    for seed in [
        semicolons.as_bytes(),
        &utf16,
        &windows,
        excel.as_bytes(),
        stamped.as_bytes(),
        rows.as_bytes(),
    ] {
        survive(seed, 1000);
    }
}

#[test]
fn damaged_parquet_of_every_type() {
    use arrow_array::types::Int32Type;
    use arrow_array::{
        ArrayRef, BooleanArray, Decimal128Array, DictionaryArray, DurationNanosecondArray,
        Float64Array, RecordBatch, TimestampNanosecondArray,
    };
    use std::sync::Arc;
    let stamps = (0..200_i64).map(|i| 1_780_000_000_000_000_000 + 2_000_000 * i);
    let stamps: ArrayRef = Arc::new(TimestampNanosecondArray::from_iter_values(stamps));
    let since = (0..200_i64).map(|i| 2_000_000 * i);
    let since: ArrayRef = Arc::new(DurationNanosecondArray::from_iter_values(since));
    let decimal: ArrayRef = Arc::new(
        Decimal128Array::from_iter_values((0..200).map(|i| 1001 * i))
            .with_precision_and_scale(12, 3)
            .unwrap(),
    );
    let flags: ArrayRef = Arc::new((0..200).map(|i| Some(i % 7 == 0)).collect::<BooleanArray>());
    let keys: arrow_array::Int32Array = (0..200).map(|i| Some(i % 3)).collect();
    let words: ArrayRef = Arc::new(Float64Array::from(vec![1.0, 2.0, 3.0]));
    let dictionary: ArrayRef = Arc::new(DictionaryArray::<Int32Type>::new(keys, words));
    for (t, ta1, enc) in [(&stamps, &decimal, &flags), (&since, &dictionary, &decimal)] {
        let columns = [
            ("t", Arc::clone(t)),
            ("ta1 [µm/m]", Arc::clone(ta1)),
            ("enc [counts]", Arc::clone(enc)),
        ];
        let batch = RecordBatch::try_from_iter(columns).unwrap();
        let mut bytes = Vec::new();
        let mut writer =
            parquet::arrow::ArrowWriter::try_new(&mut bytes, batch.schema(), None).unwrap();
        writer.write(&batch).unwrap();
        writer.close().unwrap();
        survive(&bytes, 1500);
    }
}

/// 1 kB in which the header of a page claims 774 MiB.
#[test]
fn a_page_that_cannot_expand_so_far_is_refused_before_there_is_room_for_it() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/parquet-774M.parquet");
    let before = peak_memory();
    read(&path).unwrap();
    assert!(peak_memory() - before < 256 << 20);
    let reader = Reader::open(&path, &CsvLayout::default(), &[]);
    let line = reader.err().unwrap().to_string();
    assert!(line.contains("is not a whole Parquet file"), "{line}");
}

#[test]
fn damaged_mdf_of_several_groups() {
    let t = |from: i32| -> Vec<f64> { (from..from + 60).map(|i| f64::from(i) * 0.002).collect() };
    let mut writer = falcon_mdf::Mf4Writer::with_start_time_ns(0);
    for from in [0, 60] {
        let both = t(from);
        let group = writer.add_group(&both).unwrap();
        group.add_channel("ta1", "m/m", &both).unwrap();
    }
    let all: Vec<f64> = t(0).into_iter().chain(t(60)).collect();
    let group = writer.add_group(&all).unwrap();
    group.add_channel("enc", "counts", &all).unwrap();
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    survive(&bytes, 4000);
}

#[test]
fn random_bytes_behind_every_magic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("random");
    let start = prop_oneof![
        Just(&b""[..]),
        Just(&b"PAR1"[..]),
        Just(&b"MDF     4.10    "[..]),
        Just(&b"UnFinMF 4.10    "[..]),
        Just(&b"t [s],ta1 [m/m]\n"[..]),
    ];
    let end = prop_oneof![Just(&b""[..]), Just(&b"\x10\0\0\0PAR1"[..])];
    let bytes = prop::collection::vec(any::<u8>(), 0..4000);
    runner(3000)
        .run(&(start, bytes, end), |(start, bytes, end)| {
            replace(&path, &[start, &bytes, end].concat());
            read(&path)
        })
        .unwrap();
}
