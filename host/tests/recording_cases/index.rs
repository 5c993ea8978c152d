//! Formats of the index pulse in a recording (latched counts, a level of any width, a voltage,
//! absent): the NMAE is that of the plain recording within 0.05 %, or the column is refused.
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::table::{ENCODER, Estimates, INDEX, Table, machine};
use loadtwin::machine::IndexSignal;

fn base() -> Table {
    Table::shipped(0..40_000)
}

fn plain() -> Estimates {
    let plain = base().replay(&machine("")).unwrap();
    assert!(plain.full() < 2.0, "{:?}", plain.nmae);
    plain
}

/// The pulses as a level: `high` for so many rows, else `low`.
fn level(width: usize, low: f64, high: f64, header: &str) -> Table {
    let mut table = base();
    table.index = header.into();
    let pulses: Vec<usize> = pulses(&table);
    table.rows.iter_mut().for_each(|row| row[INDEX] = low);
    for pulse in pulses {
        for row in table.rows.iter_mut().skip(pulse).take(width) {
            row[INDEX] = high;
        }
    }
    table
}

fn pulses(table: &Table) -> Vec<usize> {
    (0..table.rows.len())
        .filter(|&i| !table.rows[i][INDEX].is_nan())
        .collect()
}

fn close(table: &Table, plain: &Estimates, what: &str) {
    let found = table
        .replay(&machine(""))
        .unwrap_or_else(|line| panic!("{what}: {line}"));
    let error = found.full() - plain.full();
    assert!(
        error.abs() < 0.05,
        "{what}: {} % for {} %",
        found.full(),
        plain.full()
    );
}

fn refused(table: &Table, expected: &str) {
    let line = match table.replay(&machine("")) {
        Err(line) => line,
        Ok(found) => panic!("{} %, not {expected}", found.full()),
    };
    assert!(
        line.contains("column `index` is no index pulse: "),
        "{line}"
    );
    assert!(line.contains(expected), "{line}");
}

#[test]
fn a_level_counts_by_its_rising_edge() {
    let plain = plain();
    for width in [1, 5, 20, 35, 60, 300, 700] {
        close(
            &level(width, 0.0, 1.0, "index [1]"),
            &plain,
            &format!("{width} rows"),
        );
    }
    for (low, high, header) in [
        (0.0, 1.0, "index [counts]"),
        (0.0, 1.0, "index"),
        (0.0, 255.0, "index [counts]"),
        (0.1, 4.9, "index [V]"),
        (f64::NAN, 1.0, "index [1]"),
        (-5.0, 5.0, "index [V]"),
    ] {
        close(
            &level(20, low, high, header),
            &plain,
            &format!("{header} {low} to {high}"),
        );
    }
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for noise in [0.02, 0.05, 0.1] {
        let mut table = level(25, 0.0, 5.0, "index [V]");
        for row in &mut table.rows {
            row[INDEX] += 5.0 * noise * rng.sample::<f64, _>(StandardNormal);
        }
        close(&table, &plain, &format!("a voltage with {noise} of noise"));
    }
}

#[test]
fn latched_counts_may_have_zeros_or_the_last_count_between_them() {
    let plain = plain();
    let same = |table: &Table, what: &str| {
        let found = table
            .replay(&machine(""))
            .unwrap_or_else(|line| panic!("{what}: {line}"));
        assert!(found.loads == plain.loads, "{what}: {} %", found.full());
    };
    let filled = |with: fn(f64) -> f64| {
        let mut table = base();
        let mut last = 0.0;
        for row in &mut table.rows {
            if row[INDEX].is_nan() {
                row[INDEX] = with(last);
            } else {
                last = row[INDEX];
            }
        }
        table
    };
    same(&filled(|_| 0.0), "zeros between");
    same(&filled(|last| last), "held");
    let mut bare = base();
    bare.index = "index [1]".into();
    same(&bare, "counts without their unit");
    let mut few = filled(|_| 0.0);
    few.rows.iter_mut().step_by(7).for_each(|row| {
        row[INDEX] = if row[INDEX] == 0.0 {
            f64::NAN
        } else {
            row[INDEX]
        };
    });
    same(&few, "zeros and empty cells");
    same(&filled(|_| -1.0), "-1 between");
    let mut lost = filled(|last| last);
    let is_pulse: Vec<bool> = base().rows.iter().map(|r| !r[INDEX].is_nan()).collect();
    let cells = lost.rows.iter_mut().zip(&is_pulse).enumerate();
    for (i, (row, _)) in cells.filter(|(i, (_, is_pulse))| i % 11 == 0 && !**is_pulse) {
        row[INDEX] = if i > 0 { f64::NAN } else { row[INDEX] };
    }
    same(&lost, "held, with lost cells");
    let mut described = machine("");
    described.index.as_mut().unwrap().signal = Some(IndexSignal::Latched);
    let found = filled(|_| 0.0).replay(&described).unwrap();
    assert!(found.loads == plain.loads);
}

#[test]
fn latched_counts_that_come_late_home_later() {
    let plain = plain();
    for late in [3, 40] {
        let mut table = base();
        table.rows.iter_mut().for_each(|row| row[INDEX] = f64::NAN);
        let source = base();
        for i in pulses(&source) {
            if let Some(row) = table.rows.get_mut(i + late) {
                row[INDEX] = source.rows[i][INDEX];
            }
        }
        close(&table, &plain, &format!("{late} rows late"));
    }
}

#[test]
fn a_level_that_is_low_during_the_pulse_counts_by_its_falling_edge() {
    let plain = plain();
    for (low, high, header) in [(1.0, 0.0, "index [1]"), (4.9, 0.1, "index [V]")] {
        for width in [1, 20, 60] {
            let table = level(width, low, high, header);
            close(&table, &plain, &format!("{header}, {width} rows low"));
        }
    }
    let mut described = machine("");
    described.index.as_mut().unwrap().signal = Some(IndexSignal::ActiveLow);
    let stated = level(300, 1.0, 0.0, "index [1]")
        .replay(&described)
        .unwrap();
    assert!(
        (stated.full() - plain.full()).abs() < 0.05,
        "{:?}",
        stated.nmae
    );
}

#[test]
fn counts_beside_those_of_the_encoder_are_refused() {
    for off in [4096.0, -9000.0, 100_000.0] {
        let mut table = base();
        for row in &mut table.rows {
            row[INDEX] += off;
        }
        refused(&table, "another zero, or another counter");
    }
}

#[test]
fn latched_counts_beside_an_encoder_that_stopped_counting_are_read() {
    for from in [0, 15_000] {
        let mut table = base();
        let stuck = table.rows[from][ENCODER];
        for row in table.rows.iter_mut().skip(from) {
            row[ENCODER] = stuck;
        }
        table.replay(&machine("")).unwrap();
    }
}

#[test]
fn what_is_neither_is_refused_by_its_name() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut with = |header: &str, value: fn(&mut ChaCha8Rng, usize) -> f64| {
        let mut table = base();
        table.index = header.into();
        for (i, row) in table.rows.iter_mut().enumerate() {
            row[INDEX] = value(&mut rng, i);
        }
        table
    };
    let scattered = "without a low level";
    refused(
        &with("index [V]", |rng, _| rng.sample(StandardNormal)),
        scattered,
    );
    refused(
        &with("index [V]", |rng, _| rng.random_range(0.0..5.0)),
        scattered,
    );
    refused(
        &with("index [1]", |_, i| (0.005 * i as f64).sin()),
        scattered,
    );
    refused(&with("index [counts]", |_, i| (i % 1000) as f64), scattered);
    let turns = "pulses are not whole turns";
    refused(
        &with("index [1]", |rng, _| {
            f64::from(u8::from(rng.random_bool(0.5)))
        }),
        turns,
    );
    refused(
        &with("index [1]", |rng, _| {
            f64::from(u8::from(rng.random_bool(0.01)))
        }),
        turns,
    );
    refused(
        &with("index [1]", |_, i| f64::from(u8::from(i % 170 < 20))),
        turns,
    );
    let mut noisy = base();
    for row in &mut noisy.rows {
        if row[INDEX].is_nan() {
            row[INDEX] = (3.0 * rng.sample::<f64, _>(StandardNormal)).round();
        }
    }
    refused(
        &noisy,
        "are counts that the encoder just passed, the others are not",
    );
}
