//! Parameters identified on simulated benches that differ from their description: the true values lie within the
//! stated deviations, what the recordings do not show is reported and keeps its value, and a description that is
//! right stays as it is.

use std::path::{Path, PathBuf};

use loadtwin_diagnose::{Identification, Identified, Quantity, Shown, identify};
use loadtwin_machine::Machine;
use loadtwin_simulate::{Scenario, Simulation};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// The example's bench at 500 Hz, with a second encoder behind the shaft where `is_twist_measured`.
fn bench(folder: &Path, is_twist_measured: bool) -> Machine {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/bench/machine.toml");
    let text = std::fs::read_to_string(path).unwrap();
    let mut text = text.replace("rate_hz = 2000", "rate_hz = 500");
    if is_twist_measured {
        let second =
            "[[encoder]]\nname = \"behind\"\ninertia = \"brake\"\ncounts_per_turn = 8192\n\n";
        let at = text.find("# Torque flanges").unwrap();
        text.insert_str(at, second);
    }
    let path = folder.join("machine.toml");
    std::fs::write(&path, text).unwrap();
    Machine::load(&path).unwrap()
}

/// A bench that differs from `described` as benches do: inertias by 5 %, stiffness by 10 %, damping and drag by
/// 50 %, standard deviations.
fn drawn(described: &Machine, seed: u64) -> Machine {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut factor = |std: f64| {
        let off: f64 = rng.sample(StandardNormal);
        (1.0 + std * off).max(0.2)
    };
    let mut machine = described.clone();
    let drivetrain = machine.drivetrain.as_mut().unwrap();
    for inertia in &mut drivetrain.inertias {
        inertia.moment_kg_m2 *= factor(0.05);
        inertia.drag_nm_s_per_rad *= factor(0.5);
    }
    for shaft in &mut drivetrain.shafts {
        shaft.stiffness_nm_per_rad *= factor(0.1);
        shaft.damping_nm_s_per_rad *= factor(0.5);
    }
    machine
}

/// A recording of `machine`.
fn recorded(machine: &Machine, scenario: &str, seconds: f64, seed: u64, path: PathBuf) -> PathBuf {
    let mut scenario = Scenario::by_name(scenario).unwrap();
    scenario.duration_s = seconds;
    Simulation::new(machine, &scenario, seed, None, &[])
        .unwrap()
        .write(&path, |_| ())
        .unwrap();
    path
}

/// Two recordings of `machine`.
fn recordings(machine: &Machine, seed: u64, folder: &Path) -> Vec<PathBuf> {
    [("steps", 30.0), ("turbulent", 24.0)]
        .into_iter()
        .map(|(scenario, seconds)| {
            let path = folder.join(format!("{scenario}-{seed}.parquet"));
            recorded(machine, scenario, seconds, seed, path)
        })
        .collect()
}

fn true_value(machine: &Machine, identified: &Identified) -> f64 {
    let drivetrain = machine.drivetrain.as_ref().unwrap();
    let part = &identified.parameter.part;
    let inertia = || {
        (drivetrain.inertias.iter())
            .find(|i| i.name == *part)
            .unwrap()
    };
    let shaft = || drivetrain.shafts.iter().find(|s| s.name == *part).unwrap();
    match identified.parameter.quantity {
        Quantity::Inertia => inertia().moment_kg_m2,
        Quantity::Drag => inertia().drag_nm_s_per_rad,
        Quantity::Stiffness => shaft().stiffness_nm_per_rad,
        Quantity::Damping => shaft().damping_nm_s_per_rad,
    }
}

fn of<'a>(found: &'a Identification, quantity: Quantity, part: &str) -> &'a Identified {
    let mut parameters = found.parameters.iter();
    let is = |p: &&Identified| p.parameter.quantity == quantity && p.parameter.part == part;
    parameters.find(is).unwrap()
}

#[test]
fn true_values_lie_within_two_deviations() {
    let folder = tempfile::tempdir().unwrap();
    let described = bench(folder.path(), true);
    let (mut shown, mut inside, mut closer, mut accepted) = (0, 0, 0, 0);
    for seed in 1..=5 {
        let machine = drawn(&described, seed);
        let paths = recordings(&machine, seed, folder.path());
        let found = identify(&described, &paths, |_| ()).unwrap();
        for identified in &found.parameters {
            let truth = true_value(&machine, identified);
            if identified.shown == Shown::Alone {
                shown += 1;
                inside += usize::from((identified.fitted - truth).abs() <= 2.0 * identified.std);
            }
            let is_damping = identified.parameter.quantity == Quantity::Damping;
            assert!(!(identified.accepted && is_damping), "{identified:?}");
            if identified.accepted && identified.shown == Shown::Alone {
                let off = |value: f64| (value - truth).abs();
                accepted += 1;
                closer += usize::from(off(identified.value) < off(identified.parameter.described));
            }
        }
        let gain = found.gain.unwrap();
        assert!(gain.interval[0] > 0.0, "{gain:?}");
    }
    println!("{inside} of {shown} inside, {closer} of {accepted} accepted ones closer");
    assert!(shown >= 15, "{shown} of 30 shown");
    assert!(10 * inside >= 9 * shown, "{inside} of {shown} inside");
    assert!(accepted >= 8, "{accepted} accepted");
    assert!(
        20 * closer >= 19 * accepted,
        "{closer} of {accepted} closer to the truth"
    );
}

#[test]
fn a_description_that_is_right_stays() {
    let folder = tempfile::tempdir().unwrap();
    let described = bench(folder.path(), true);
    for seed in 11..=12 {
        let paths = recordings(&described, seed, folder.path());
        let found = identify(&described, &paths, |_| ()).unwrap();
        for identified in &found.parameters {
            assert!(!identified.accepted, "{seed} {identified:?}");
            assert_eq!(identified.value, identified.parameter.described);
        }
    }
}

/// One encoder and no gauge: both inertias turn as one, nothing shows how the shaft twists.
#[test]
fn what_does_not_show_is_reported_and_stays() {
    let folder = tempfile::tempdir().unwrap();
    let mut described = bench(folder.path(), false);
    described.channels.clear();
    let mut machine = described.clone();
    for inertia in &mut machine.drivetrain.as_mut().unwrap().inertias {
        inertia.moment_kg_m2 *= 1.08;
    }
    let paths = recordings(&machine, 21, folder.path());
    let found = identify(&described, &paths, |_| ()).unwrap();
    for quantity in [Quantity::Stiffness, Quantity::Damping] {
        let hidden = of(&found, quantity, "gear");
        assert!(hidden.shown == Shown::No && !hidden.accepted, "{hidden:?}");
        assert_eq!(hidden.value, hidden.parameter.described);
    }
    let inertias = ["motor", "brake"].map(|part| of(&found, Quantity::Inertia, part));
    for inertia in inertias {
        assert!(inertia.ratio() > 0.5, "{inertia:?}");
        assert_eq!(inertia.shown, Shown::Together);
    }
    let sum: f64 = inertias.iter().map(|inertia| inertia.value).sum();
    assert!((sum / (1.08 * 4.4) - 1.0).abs() < 0.01, "{sum}");
    let is_of_both = |c: &&loadtwin_diagnose::Combination| {
        let quantity = |(i, _): &(usize, f64)| found.parameters[*i].parameter.quantity;
        c.weights.len() == 2 && c.weights.iter().all(|w| quantity(w) == Quantity::Inertia)
    };
    let combination = found.combinations.iter().find(is_of_both).unwrap();
    assert!(combination.ratio < 0.2, "{combination:?}");
}
