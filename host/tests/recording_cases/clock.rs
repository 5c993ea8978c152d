//! Property tests of the sampling grid: no row is lost or invented within the stated limits of
//! jitter and drift.
use std::fmt::Write;

use loadtwin::recording::{CsvLayout, Problem, Reader, Wanted};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const PERIOD_S: f64 = 0.002;

/// A recording whose ticks are known.
#[derive(Clone, Debug)]
struct Clock {
    seed: u64,
    rows: usize,
    /// Largest jitter [periods].
    jitter: f64,
    /// Part of the rows before a gap, and most ticks lost in one.
    lost: (f64, u64),
    /// Deviation of the rate, constant and slowly changing [1].
    rate: f64,
    wander: f64,
    start_s: f64,
}

impl Clock {
    /// Tick of each row, and its time.
    fn record(&self) -> Vec<(u64, f64)> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let (mut tick, mut now) = (0, 0.0);
        let mut rows = Vec::new();
        for row in 0..self.rows {
            let jitter = self.jitter * rng.random_range(-1.0..1.0);
            rows.push((tick, self.start_s + now + jitter * PERIOD_S));
            let lost = if rng.random_bool(self.lost.0) {
                rng.random_range(1..=self.lost.1)
            } else {
                0
            };
            let slow = (row as f64 / self.rows as f64 * std::f64::consts::TAU).sin();
            tick += lost + 1;
            now += (lost + 1) as f64 * PERIOD_S * (1.0 + self.rate + self.wander * slow);
        }
        rows
    }

    /// Tick of each row as a reader finds it, from that of the first on.
    fn read(&self, largest_gap: u32) -> Result<Vec<u64>, Problem> {
        let mut text = String::from("t [s],row [1]");
        for (row, (_, t)) in self.record().iter().enumerate() {
            write!(text, "\n{t:.7},{row}").unwrap();
        }
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text + "\n").unwrap();
        let layout = CsvLayout {
            largest_gap,
            ..CsvLayout::default()
        };
        let wanted = [Wanted {
            name: "row",
            unit: "1".parse().unwrap(),
            required: true,
        }];
        let reader = Reader::open(file.path(), &layout, &wanted).map_err(|e| e.problem)?;
        let mut ticks = Vec::new();
        for block in reader.expect_period(PERIOD_S).map_err(|e| e.problem)? {
            let block = block.map_err(|e| e.problem)?;
            for (i, row) in block.columns[0].as_ref().unwrap().iter().enumerate() {
                let tick = block.first_row + i as u64;
                if !row.is_nan() {
                    assert_eq!(*row, ticks.len() as f64);
                    ticks.push(tick);
                }
            }
        }
        Ok(ticks)
    }

    fn ticks(&self) -> Vec<u64> {
        self.record().into_iter().map(|(tick, _)| tick).collect()
    }
}

/// Clocks with jitter up to `jitter` periods and `lost` ticks.
fn clocks(jitter: f64, lost: (f64, u64)) -> impl Strategy<Value = Clock> {
    (
        any::<u64>(),
        prop::sample::select(vec![1000, 3000, 12_000]),
        0.0..jitter,
        (0.0..=lost.0, 1..=lost.1),
        -5e-3..5e-3,
        0.0..100e-6,
        prop::sample::select(vec![0.0, -3.0, 1e4, 1_714_730_400.0]),
    )
        .prop_map(|(seed, rows, jitter, lost, rate, wander, start_s)| Clock {
            seed,
            rows,
            jitter,
            lost,
            rate,
            wander,
            start_s,
        })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]

    #[test]
    fn rows_with_jitter_stay_on_their_ticks(clock in clocks(0.45, (0.0, 1))) {
        prop_assert_eq!(clock.read(0).unwrap(), clock.ticks());
    }

    #[test]
    fn gaps_have_their_length(clock in clocks(0.3, (0.02, 200))) {
        prop_assert_eq!(clock.read(200).unwrap(), clock.ticks());
    }

    /// Beyond the limits there is a refusal, or the right ticks: no row on
    /// another's tick.
    #[test]
    fn more_jitter_is_refused(clock in clocks(2.0, (0.0, 1))) {
        if let Ok(ticks) = clock.read(0) {
            prop_assert_eq!(ticks, clock.ticks());
        } else {
            prop_assert!(clock.jitter > 0.45);
        }
    }

    #[test]
    fn a_gap_beyond_the_largest_is_refused(clock in clocks(0.3, (0.02, 200)), largest in 0_u32..200) {
        let longest = clock.ticks().windows(2).map(|t| t[1] - t[0] - 1).max().unwrap();
        match clock.read(largest) {
            Ok(ticks) => prop_assert_eq!((ticks, longest <= u64::from(largest)), (clock.ticks(), true)),
            Err(Problem::Gap { missing, .. }) => prop_assert!(missing > u64::from(largest) && longest >= missing),
            Err(other) => prop_assert!(false, "{}", other),
        }
    }
}
