//! Peak memory of writing and reading a recording: ten times the rows need less than 6 MB more.
//! Alone in its process, as the peak is that of the process.
use std::path::Path;

use loadtwin::recording::{BLOCK_ROWS, CsvLayout, OutputColumn, Reader, Wanted, Writer};

fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmHWM")).unwrap();
    let kilobytes = line.split_whitespace().nth(1).unwrap();
    1024 * kilobytes.parse::<u64>().unwrap()
}

fn write_and_read(path: &Path, rows: usize) {
    let columns: Vec<_> = (0..4)
        .map(|k| OutputColumn {
            name: format!("c{k}"),
            unit: "Nm".parse().unwrap(),
            single: false,
        })
        .collect();
    let mut writer = Writer::create(path, &columns, &[]).unwrap();
    for first in (0..rows).step_by(BLOCK_ROWS) {
        let block = first..rows.min(first + BLOCK_ROWS);
        let t: Vec<f64> = block.clone().map(|i| i as f64).collect();
        let values: Vec<f64> = block.map(|i| (i as f64 * 0.01).sin()).collect();
        writer.write(&t, &[&values[..]; 4]).unwrap();
    }
    writer.finish().unwrap();
    let wanted: Vec<_> = columns
        .iter()
        .map(|c| Wanted {
            name: &c.name,
            unit: c.unit,
            required: true,
        })
        .collect();
    let reader = Reader::open(path, &CsvLayout::default(), &wanted).unwrap();
    assert_eq!(reader.map(|b| b.unwrap().len()).sum::<usize>(), rows);
}

#[test]
fn ten_times_the_rows_need_no_more_memory() {
    let dir = tempfile::tempdir().unwrap();
    for format in ["csv", "parquet"] {
        let path = dir.path().join("long").with_extension(format);
        write_and_read(&path, 150_000);
        let before = peak_memory();
        write_and_read(&path, 1_500_000);
        let grown = peak_memory() - before;
        // The longer file holds 60 MB of numbers.
        assert!(grown < 6_000_000, "{format}: {grown} bytes more");
    }
}
