//! Check of the improved description by the estimator in `loadtwin diagnose`: effects that make
//! the estimates worse are not written.

use std::path::{Path, PathBuf};

use loadtwin::diagnose::{
    Diagnosis, DrivetrainResiduals, Evaluated, FilterCheck, check_filter, diagnose,
};
use loadtwin::machine::Machine;

use super::{machine, recorded};

/// A recording with a gauge whose gain is off, another cycle of the same machine, and what is found.
fn found(folder: &Path) -> (Machine, PathBuf, Diagnosis<DrivetrainResiduals>) {
    let effect = ["gain-error@ta2=1"];
    let fitted = recorded(folder, "fitted.parquet", "torque-ramps", "40", &effect);
    let other = recorded(folder, "other.parquet", "start-stop", "60", &effect);
    let machine = Machine::load(&machine()).unwrap();
    let diagnosis = diagnose(&machine, &[fitted.into()], &[], |_| ()).unwrap();
    assert_eq!(diagnosis.selection.found.len(), 1, "the gain error");
    (machine, other.into(), diagnosis)
}

fn checked(
    machine: &Machine,
    other: &Path,
    diagnosis: &mut Diagnosis<DrivetrainResiduals>,
) -> FilterCheck {
    let evaluated = Evaluated::choose(&[], &[other.to_owned()]);
    check_filter(machine, diagnosis, evaluated).unwrap()
}

/// The gain as found makes the estimator better on another cycle; with zeros off by 5 µm/m, which a fit that is
/// wrong may give, it is worse and refused.
#[test]
fn an_effect_that_makes_the_estimator_worse_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (machine, other, mut diagnosis) = found(folder.path());
    let right = checked(&machine, &other, &mut diagnosis);
    assert!(right.is_accepted && right.left_out.is_empty());
    let falls = |check: &FilterCheck, sign: f64| {
        (check.sets.iter().flat_map(|set| set.nmae_percent.values()))
            .filter(|c| sign * (c.before - c.after) > 0.1)
            .count()
    };
    assert!(falls(&right, 1.0) > 0 && falls(&right, -1.0) == 0);
    for zero in (diagnosis.selection.nuisance.iter_mut()).filter_map(|own| own.first_mut()) {
        *zero += 5e-6;
    }
    let wrong = checked(&machine, &other, &mut diagnosis);
    assert!(!wrong.is_accepted && falls(&wrong, -1.0) > 0);
    assert!(wrong.worse().count() > 0);
}
