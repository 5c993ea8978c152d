//! `loadtwin tables` on an individual that no default was chosen on, against the published figures;
//! mean and deviation by hand.

use std::path::Path;

use loadtwin::machine::Machine;
use loadtwin::paper_tables::{Individual, TABLE_2, statistics};
use loadtwin::simulate::Applied;

#[test]
fn each_set_of_sensors_is_at_least_as_good_as_in_the_paper() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/gearbox/machine.toml"
    );
    let machine = Machine::load(Path::new(path)).unwrap();
    let effects = Applied::list(&["paper"]).unwrap();
    let individual = Individual::new(&machine, 11, &effects).unwrap();
    let cells = individual.evaluate(&TABLE_2, || ()).unwrap();
    assert_eq!(cells.len(), TABLE_2.len());
    for (row, cell) in TABLE_2.iter().zip(&cells) {
        let (ours, paper) = (cell.nmae[0], row.nmae.unwrap()[0]);
        assert!(
            ours > 0.1 && ours <= paper,
            "{}: {ours} % against {paper} %",
            row.sensors
        );
        assert!(cell.nmae.iter().all(|nmae| nmae.is_finite()));
    }
}

#[test]
fn mean_and_deviation() {
    let (mean, std) = statistics([1.0, 2.0, 6.0].into_iter());
    assert!((mean - 3.0).abs() < 1e-12 && (std - 7.0_f64.sqrt()).abs() < 1e-12);
}
