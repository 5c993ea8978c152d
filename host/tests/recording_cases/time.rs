//! Time stamps of a recording: jitter, coarse steps, drift, gaps, other rates and origins give the
//! estimates of the plain recording, or are refused with their place.
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::table::{Estimates, PERIOD_S, Table, machine, replay};

/// Rows of 29 to 35 s.
fn base() -> Table {
    Table::shipped(14_500..17_500)
}

fn plain() -> Estimates {
    let plain = base().replay(&machine("")).unwrap();
    assert!((plain.full() - 1.69).abs() < 0.02, "{:?}", plain.nmae);
    assert_eq!(plain.loads.len(), 3000);
    plain
}

fn same(table: &Table, layout: &str, plain: &Estimates, what: &str) {
    let found = table
        .replay(&machine(layout))
        .unwrap_or_else(|line| panic!("{what}: {line}"));
    assert_eq!(found.loads.len(), plain.loads.len(), "{what}");
    assert!(found.loads == plain.loads, "{what}: {} %", found.full());
}

fn refused(table: &Table, layout: &str, expected: &str) {
    let line = match table.replay(&machine(layout)) {
        Err(line) => line,
        Ok(found) => panic!(
            "{} samples, {} %, not {expected}",
            found.loads.len(),
            found.full()
        ),
    };
    assert!(
        line.contains(expected),
        "found: {line}\nexpected: {expected}"
    );
    assert!(!line.contains('\n'), "{line}");
}

#[test]
fn stamps_of_regular_rows_give_the_plain_estimates() {
    let plain = plain();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for part in [0.05, 0.2, 0.3, 0.4, 0.45, 0.48] {
        let mut table = base();
        for t in &mut table.t {
            *t += part * PERIOD_S * rng.random_range(-1.0..1.0);
        }
        for layout in ["", "largest_gap = 1"] {
            if layout.is_empty() || part < 0.46 {
                same(
                    &table,
                    layout,
                    &plain,
                    &format!("jitter of {part} periods, {layout}"),
                );
            }
        }
    }
    for ppm in [-15_000.0, -500.0, -20.0, 7.0, 100.0, 15_000.0] {
        let mut table = base();
        table.t.iter_mut().for_each(|t| *t *= 1.0 + ppm * 1e-6);
        same(&table, "", &plain, &format!("a clock {ppm} ppm off"));
    }
    for start in [-7.3, 0.01, 36_000.5, 1e7, 1_714_730_400.0] {
        let mut table = base();
        table.t.iter_mut().for_each(|t| *t += start);
        same(&table, "", &plain, &format!("a start at {start} s"));
    }
    let mut wave = base();
    for t in &mut wave.t {
        *t += 0.05 * (0.3 * *t).sin() * PERIOD_S + 1e-4 * (*t * 0.5).sin();
    }
    same(&wave, "", &plain, "a clock that wanders");
    // Fifty rows a turn, of which few are as regular as between lost rows.
    let mut wave = base();
    for t in &mut wave.t {
        *t += 0.45 * PERIOD_S * (std::f64::consts::TAU * *t / 0.1).sin();
    }
    for layout in ["", "largest_gap = 1"] {
        same(&wave, layout, &plain, "jitter of 10 Hz");
    }
}

/// Decimals that leave less than half a period.
#[test]
fn coarse_stamps() {
    let plain = plain();
    let mut table = base();
    table.decimals = 3;
    same(&table, "", &plain, "1 ms at 2 ms");
    for offset in [0.0004, 0.0006, 0.0011] {
        let mut moved = table.clone();
        moved.t.iter_mut().for_each(|t| *t += offset);
        same(&moved, "", &plain, "1 ms at 2 ms, moved");
    }
    table.decimals = 2;
    refused(
        &table,
        "",
        "row 2 (line 3): time goes from 0 s to 0 s; allowed: only forwards",
    );
}

#[test]
fn a_gap_is_as_long_as_the_clock_says() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for (lost, jitter) in [(1, 0.0), (2, 0.2), (7, 0.3), (19, 0.1), (20, 0.35)] {
        // Lost in the file: empty in the plain recording.
        let (mut whole, mut table) = (base(), base());
        for row in (400..400 + lost).chain(2000..2000 + lost) {
            whole.rows[row] = [f64::NAN; 6];
        }
        for t in &mut table.t {
            *t += jitter * PERIOD_S * rng.random_range(-1.0..1.0);
        }
        for row in [2000, 400] {
            table.t.drain(row..row + lost);
            table.rows.drain(row..row + lost);
        }
        let plain = whole.replay(&machine("")).unwrap();
        same(
            &table,
            "largest_gap = 20",
            &plain,
            &format!("{lost} lost, jitter {jitter}"),
        );
        let missing = if lost == 1 {
            "1 samples are missing"
        } else {
            "samples are missing"
        };
        refused(&table, "", missing);
        refused(&table, "", "row 401 (line 402): gap of");
    }
}

#[test]
fn rows_off_the_clock_are_refused_with_their_place() {
    // 60 rows of another device, so many periods after a regular one.
    for after in [0.05, 0.3, 0.65, 0.8, 0.95] {
        for filled in [true, false] {
            let mut table = base();
            for row in (0..3000).step_by(50).rev() {
                let t = table.t[row] + after * PERIOD_S;
                let values = if filled {
                    table.rows[row]
                } else {
                    [f64::NAN; 6]
                };
                table.t.insert(row + 1, t);
                table.rows.insert(row + 1, values);
            }
            for layout in ["", "largest_gap = 3"] {
                refused(&table, layout, "row 2 (line 3) at t = 0.0");
                refused(&table, layout, "falls on the same tick");
            }
        }
    }
    // Each hundredth row again, 1 µs later.
    let mut twice = base();
    for row in (99..3000).step_by(100).rev() {
        twice.t.insert(row + 1, twice.t[row] + 1e-6);
        twice.rows.insert(row + 1, twice.rows[row]);
    }
    refused(
        &twice,
        "",
        "row 101 (line 102) at t = 0.198001 s is not on the clock",
    );
    // A clock that wanders by three periods and back within six seconds.
    let mut wandering = base();
    for t in &mut wandering.t {
        *t += 3.0 * PERIOD_S * (std::f64::consts::TAU * *t / 6.0).sin();
    }
    for layout in ["", "largest_gap = 5"] {
        refused(&wandering, layout, "the clock wanders");
    }
    // A row that is stamped late.
    for late in [0.6, 0.9] {
        let mut table = base();
        table.t[1000] += late * PERIOD_S;
        refused(
            &table,
            "largest_gap = 2",
            "row 1001 (line 1002) at t = 2.00",
        );
    }
}

#[test]
fn another_rate_is_refused_from_where_it_begins() {
    for (factor, found) in [
        (0.5, "0.001000"),
        (0.25, "0.000500"),
        (2.0, "0.004000"),
        (1.5, "0.003000"),
    ] {
        for layout in ["", "largest_gap = 5"] {
            let mut table = base();
            for row in 1501..3000 {
                table.t[row] = 3.0 + (row - 1500) as f64 * factor * PERIOD_S;
            }
            if layout.is_empty() || factor < 1.0 {
                let expected =
                    format!("s on rows come every {found} s, before every 0.002000 s; allowed");
                refused(&table, layout, "row 1502 (line 1503): from t = 3.00");
                refused(&table, layout, &expected);
            } else {
                refused(&table, layout, "on rows come every");
            }
        }
    }
    // A rate close to the one before.
    let mut table = base();
    for row in 1501..3000 {
        table.t[row] = 3.0 + (row - 1500) as f64 * 0.97 * PERIOD_S;
    }
    refused(
        &table,
        "",
        "row 1502 (line 1503): from t = 3.00194 s on rows come every 0.001940 s",
    );
    for (factor, layout) in [
        (1.03, "largest_gap = 2"),
        (1.01, "largest_gap = 2"),
        (0.97, ""),
    ] {
        let mut table = Table::shipped(0..20_000);
        for row in 5001..20_000 {
            table.t[row] = 10.0 + (row - 5000) as f64 * factor * PERIOD_S;
        }
        let line = table.replay(&machine(layout)).unwrap_err();
        let right = [
            "on rows come every",
            "falls on the same tick",
            "the clock wanders",
        ];
        assert!(
            right.iter().any(|part| line.contains(part)),
            "{factor}: {line}"
        );
    }
    let mut all = base();
    all.t.iter_mut().for_each(|t| *t *= 0.5);
    refused(
        &all,
        "",
        "is sampled every 0.001000 s (1000 Hz); allowed: 0.002000 s (500 Hz) within 2 %",
    );
}

/// Rows of any time, brought onto the estimator's clock.
#[test]
fn resampled_rows_give_the_plain_error() {
    let plain = plain();
    let layout = "timing = 'resample'";
    let plain_rows = base();
    for start in [0.0, 0.1, 1e5, 1_714_730_400.0] {
        let mut table = base();
        table.t.iter_mut().for_each(|t| *t += start);
        same(
            &table,
            layout,
            &plain,
            &format!("rows on the clock, from {start} s on"),
        );
    }
    let close = |table: &Table, what: &str| {
        let found = table
            .replay(&machine(layout))
            .unwrap_or_else(|line| panic!("{what}: {line}"));
        assert_eq!(found.loads.len(), 3000, "{what}");
        let error = found.full() - plain.full();
        assert!(
            error.abs() < 0.2,
            "{what}: {} % for {} %",
            found.full(),
            plain.full()
        );
    };
    let between = |table: &Table, at: f64| {
        let (i, part) = (at.floor() as usize, at.fract());
        let mut row = table.rows[i];
        for (k, value) in row.iter_mut().enumerate() {
            let next = table.rows[(i + 1).min(2999)][k];
            *value = if k == super::table::INDEX {
                f64::NAN
            } else {
                *value + part * (next - *value)
            };
        }
        row[super::table::ENCODER] = row[super::table::ENCODER].round();
        row
    };
    for after in [0.1, 0.3, 0.65] {
        for filled in [true, false] {
            let mut table = base();
            for row in (0..2999).step_by(50).rev() {
                let values = if filled {
                    between(&plain_rows, row as f64 + after)
                } else {
                    [f64::NAN; 6]
                };
                table.t.insert(row + 1, table.t[row] + after * PERIOD_S);
                table.rows.insert(row + 1, values);
            }
            close(
                &table,
                &format!("a union of two devices, {after}, {filled}"),
            );
        }
    }
    for times in [2, 5] {
        let mut table = base();
        for row in (1500..2999).rev() {
            for k in (1..times).rev() {
                let at = row as f64 + k as f64 / times as f64;
                table.t.insert(row + 1, at * PERIOD_S);
                table.rows.insert(row + 1, between(&plain_rows, at));
            }
        }
        close(&table, &format!("{times} times the rate from 3 s on"));
    }
}

/// One row of `every` absent, or one more: the mean rate stays within 2 %.
#[test]
fn rows_absent_or_added_at_regular_distances_are_no_other_rate() {
    for (every, rate, jitter) in [
        (52, 1.0, 0.0),
        (60, 1.0, 0.0),
        (60, 1.004, 0.05),
        (75, 0.995, 0.0),
        (120, 1.0, 0.2),
        (400, 1.0, 0.0),
    ] {
        let what = format!("1 of {every}, rate {rate}, jitter {jitter}");
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut on_clock = base();
        for t in &mut on_clock.t {
            *t = *t * rate + jitter * PERIOD_S * rng.random_range(-1.0..1.0);
        }
        let rows = (25..3000).step_by(every).rev();
        let (mut whole, mut lost) = (base(), on_clock.clone());
        for row in rows.clone() {
            whole.rows[row] = [f64::NAN; 6];
            lost.t.remove(row);
            lost.rows.remove(row);
        }
        refused(&lost, "", "row 26 (line 27): gap of");
        let plain = whole.replay(&machine("")).unwrap();
        same(&lost, "largest_gap = 1", &plain, &what);
        for after in [0.2, 0.5] {
            let mut more = on_clock.clone();
            for row in rows.clone() {
                more.t.insert(row + 1, more.t[row] + after * PERIOD_S);
                more.rows.insert(row + 1, more.rows[row]);
            }
            refused(&more, "", "falls on the same tick");
        }
    }
}

/// Stamps whose decimals are a good part of the period, at a rate that differs: no row is lost.
#[test]
fn coarse_stamps_at_another_rate() {
    for period_ms in [1.97, 1.99, 2.01, 2.03] {
        let mut table = base();
        table.decimals = 3;
        for (k, t) in table.t.iter_mut().enumerate() {
            *t = k as f64 * period_ms * 1e-3;
        }
        let what = format!("{period_ms} ms in whole ms");
        same(&table, "", &plain(), &what);
        same(&table, "largest_gap = 1", &plain(), &what);
    }
    // Beyond what the description allows, short stretches would suit it.
    for (period_ms, found) in [
        (2.1, "0.002100 s (476.2 Hz)"),
        (1.9, "0.001900 s (526.3 Hz)"),
    ] {
        let mut table = base();
        table.decimals = 3;
        for (k, t) in table.t.iter_mut().enumerate() {
            *t = k as f64 * period_ms * 1e-3;
        }
        for layout in ["", "largest_gap = 1"] {
            refused(
                &table,
                layout,
                &format!("is sampled every {found}; allowed: 0.002000 s (500 Hz)"),
            );
        }
    }
}

#[test]
fn row_periods_of_any_length() {
    for (period, rate_hz) in [
        ("2", 500.0),
        ("2.0", 500.0),
        ("0.5", 2000.0),
        ("0.8333", 1200.0),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rec.csv");
        let table = base();
        table.write(&path);
        let text = std::fs::read_to_string(&path).unwrap();
        let bare: Vec<&str> = text
            .lines()
            .map(|line| line.split_once(',').unwrap().1)
            .collect();
        std::fs::write(&path, bare.join("\n")).unwrap();
        let mut machine = machine(&format!("row_period_ms = {period}"));
        machine.rate_hz = rate_hz;
        let found = replay(&path, &machine).unwrap();
        assert_eq!(found.loads.len(), 3000, "{period}");
        if rate_hz == 500.0 {
            assert!(found.loads == plain().loads, "{period}");
        }
        machine.rate_hz *= 1.1;
        let line = replay(&path, &machine).unwrap_err();
        assert!(line.contains("is sampled every"), "{line}");
    }
    for period in ["0", "-1.0", "nan", "inf", "1e9"] {
        refused(
            &base(),
            &format!("row_period_ms = {period}"),
            "[recording] row_period_ms = ",
        );
    }
}

#[test]
fn segments_count_from_the_first_row_of_times_since_1970() {
    let excerpt = base().replay(&machine("")).unwrap();
    assert!(excerpt.note.is_none());
    for start in [36_000.0, 1e6, 1_714_730_400.0, 3.8e9, 45_000.0] {
        let mut table = base();
        table.t.iter_mut().for_each(|t| *t += start);
        let found = table.replay(&machine("")).unwrap();
        assert_eq!(found.nmae, excerpt.nmae, "{start}");
        assert!(
            found
                .note
                .unwrap()
                .contains(&format!("begins at t = {start} s"))
        );
    }
    // An excerpt of the last segment stays there.
    for start in [61.0, 75.0] {
        let mut table = base();
        table.t.iter_mut().for_each(|t| *t += start);
        let found = table.replay(&machine("")).unwrap();
        assert!(found.note.is_none());
        assert_eq!(found.nmae["ramp_down"], found.nmae["full"]);
        assert_eq!(found.nmae["ramp_up"], None);
    }
}
