//! Benchmark of writing and reading recordings: rows a second and peak memory.
//!
//! ```text
//! cargo run --release --example recording_speed -- write long.csv 10000000
//! cargo run --release --example recording_speed -- read long.csv
//! ```
use std::path::Path;
use std::time::Instant;

use loadtwin::recording::{BLOCK_ROWS, CsvLayout, OutputColumn, Reader, Unit, Wanted, Writer};

const CHANNELS: usize = 8;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let names: Vec<String> = (0..CHANNELS).map(|k| format!("c{k}")).collect();
    let strain: Unit = "µm/m".parse()?;
    let start = Instant::now();
    let rows = match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["write", path, rows] => write(Path::new(path), rows.parse()?, &names, strain)?,
        ["read", path] => read(Path::new(path), &names, strain)?,
        _ => return Err("write FILE ROWS, or read FILE".into()),
    };
    let seconds = start.elapsed().as_secs_f64();
    let status = std::fs::read_to_string("/proc/self/status")?;
    let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    println!(
        "{rows} rows of {CHANNELS} channels in {seconds:.2} s: {:.2} million rows/s, peak memory {}",
        rows as f64 / seconds / 1e6,
        peak.unwrap_or("unknown").trim()
    );
    Ok(())
}

/// Strains with three decimals, as a bridge amplifier delivers them.
fn write(
    path: &Path,
    rows: usize,
    names: &[String],
    unit: Unit,
) -> Result<usize, Box<dyn std::error::Error>> {
    let columns: Vec<_> = names
        .iter()
        .map(|name| OutputColumn {
            name: name.clone(),
            unit,
            single: false,
        })
        .collect();
    let mut writer = Writer::create(path, &columns, &[])?;
    for first in (0..rows).step_by(BLOCK_ROWS) {
        let block = first..rows.min(first + BLOCK_ROWS);
        let t: Vec<f64> = block.clone().map(|i| i as f64 / 500.0).collect();
        let values: Vec<Vec<f64>> = (0..CHANNELS)
            .map(|k| {
                let sample = |i| ((i * (k + 1)) as f64 * 0.01).sin() * 1e5;
                block.clone().map(|i| sample(i).round() / 1e3).collect()
            })
            .collect();
        writer.write(&t, &values.iter().map(Vec::as_slice).collect::<Vec<_>>())?;
    }
    writer.finish()?;
    Ok(rows)
}

fn read(path: &Path, names: &[String], unit: Unit) -> Result<usize, Box<dyn std::error::Error>> {
    let wanted: Vec<_> = names
        .iter()
        .map(|name| Wanted {
            name,
            unit: unit.si(),
            required: true,
        })
        .collect();
    let mut rows = 0;
    for block in Reader::open(path, &CsvLayout::default(), &wanted)? {
        rows += block?.len();
    }
    Ok(rows)
}
