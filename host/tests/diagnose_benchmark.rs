//! A fixed part of the benchmark of `diagnose`, five cases of one simulated gearbox: strong effects
//! are found, nothing is named without an effect, one outside the library is unknown. Also the
//! interval of a rate against a published one.

#[path = "../examples/diagnose_benchmark/cases.rs"]
mod cases;
#[path = "../examples/diagnose_benchmark/evaluation.rs"]
mod evaluation;
#[path = "../examples/diagnose_benchmark/outside.rs"]
mod outside;
#[path = "../examples/diagnose_benchmark/rate.rs"]
mod rate;
#[path = "../examples/diagnose_benchmark/score.rs"]
mod score;

use std::path::Path;

use loadtwin::machine::Machine;
use rayon::prelude::*;

use rate::Rate;
use score::Score;

/// Seed of the machines and cases.
const SEED: u64 = 2026;

/// Of the first machine: two with one effect, two clean ones, one outside the library.
const NUMBERS: [usize; 5] = [0, 1, 4, 5, 8];

#[test]
fn undeclared_effects_are_found() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/gearbox/machine.toml");
    let (machines, cases) = cases::drawn(&Machine::load(&path).unwrap(), 1, SEED);
    let rows: Vec<_> = NUMBERS
        .par_iter()
        .map(|number| {
            let case = &cases[*number];
            evaluation::evaluate(*number, case, &machines[case.machine]).unwrap()
        })
        .collect();
    let score = Score::of(&rows);
    let (strong, weak) = (score.first_strong.all, score.first_weak.all);
    assert_eq!(strong.of + weak.of, 2);
    assert_eq!(strong.right, strong.of, "{score}");
    assert_eq!(score.false_alarms.right, 0, "{score}");
    assert_eq!(score.false_alarms.of, 2);
    assert_eq!(score.unknown_inside.right, 0, "{score}");
    assert_eq!(score.unknown_outside.right, 1, "{score}");
}

/// Newcombe 1998, "Two-sided confidence intervals for the single proportion",
/// table I, method 3: 15 of 148.
#[test]
fn the_interval_is_that_of_the_literature() {
    let [low, high] = Rate { right: 15, of: 148 }.interval();
    assert!((low - 0.0624).abs() < 5e-5 && (high - 0.1605).abs() < 5e-5);
}
