//! Blind benchmark: `diagnose` on recordings of effects that it does not know.
//!
//! `cargo run --release -p loadtwin --example diagnose_benchmark -- [MACHINES] [SEED] [RESULTS.csv]
//! [weak]`
//!
//! For each machine (a description with its parameters drawn anew) ten
//! recordings: four with one effect, two fault-free, two with two effects, two with
//! something outside the library. Effect, strength (0.1 to 1.6), profile and
//! noise are drawn. The true effects are only in the results, which `diagnose`
//! never opens; a row is written as soon as a recording was diagnosed, and
//! rows that are there already are not done again. With `weak` only those with one
//! effect of a strength below 0.3.

mod cases;
mod evaluation;
mod outside;
mod rate;
mod score;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use indicatif::{ProgressBar, ProgressStyle};
use loadtwin::machine::Machine;

use cases::{Case, Kind, STRONG};
use evaluation::evaluate;
use score::{Row, Score};

/// Recordings that are diagnosed at a time.
const AT_A_TIME: usize = 2;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let machines: usize = arguments.next().map_or(Ok(20), |a| a.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(1), |a| a.parse())?;
    let results = arguments
        .next()
        .map_or_else(|| format!("diagnose-{seed}.csv").into(), PathBuf::from);
    let weak_only = match arguments.next().as_deref() {
        None => false,
        Some("weak") => true,
        Some(other) => return Err(format!("found {other}, allowed: weak, or nothing").into()),
    };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/gearbox/machine.toml");
    let (machines, cases) = cases::drawn(&Machine::load(&path)?, machines, seed);

    let before: Vec<Row> = match csv::Reader::from_path(&results) {
        Ok(mut reader) => reader.deserialize().collect::<Result<_, _>>()?,
        Err(_) => Vec::new(),
    };
    let file = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(&results)?;
    let writer = csv::WriterBuilder::new()
        .has_headers(before.is_empty())
        .from_writer(file);
    let left: Vec<(usize, &Case)> = (cases.iter().enumerate())
        .filter(|(number, _)| !before.iter().any(|row| row.number == *number))
        .filter(|(_, case)| !weak_only || is_weak(case))
        .collect();
    let bar = ProgressBar::new((before.len() + left.len()) as u64).with_style(
        ProgressStyle::with_template("{wide_bar} {pos} of {len} recordings, {eta} left")?,
    );
    bar.set_position(before.len() as u64);

    let next = AtomicUsize::new(0);
    let results = Mutex::new((before, writer, Ok(())));
    std::thread::scope(|scope| {
        for _ in 0..AT_A_TIME {
            scope.spawn(|| {
                while let Some((number, case)) = left.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let row = evaluate(*number, case, &machines[case.machine])
                        .map_err(|error| format!("recording {number}: {error}"));
                    let Ok(mut results) = results.lock() else {
                        break;
                    };
                    let (rows, writer, outcome) = &mut *results;
                    let written = row.and_then(|row| {
                        writer.serialize(&row).map_err(|e| e.to_string())?;
                        writer.flush().map_err(|e| e.to_string())?;
                        rows.push(row);
                        Ok(())
                    });
                    if written.is_err() {
                        *outcome = written;
                        break;
                    }
                    bar.inc(1);
                }
            });
        }
    });
    bar.finish_and_clear();
    let (mut rows, _, outcome) = results.into_inner().map_err(|e| e.to_string())?;
    outcome?;
    rows.sort_by_key(|row| row.number);
    print!("{}", Score::of(&rows));
    Ok(())
}

/// Whether it has one effect, and that a weak one.
fn is_weak(case: &Case) -> bool {
    case.kind == Kind::One && case.effects.iter().all(|(_, strength)| *strength < STRONG)
}
