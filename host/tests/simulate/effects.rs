//! Injected effects of `loadtwin simulate`: what each changes, and by how much.

use loadtwin::machine::{Friction, Machine};
use loadtwin::simulate::EFFECTS;

use super::{Columns, bits, gearbox, mean, run, std};

#[test]
fn an_effect_of_strength_0_changes_not_one_bit() {
    let machine = gearbox();
    let clean = run(&machine, "turbulent", 1.0, (1, 1), &[]);
    for effect in EFFECTS {
        let none = format!("{}=0", effect.name);
        assert_eq!(
            bits(&run(&machine, "turbulent", 1.0, (1, 1), &[&none])),
            bits(&clean),
            "{none}"
        );
    }
}

/// The signals that each effect may change, and the number of gauges that must show it.
#[test]
fn an_effect_changes_what_it_claims_and_nothing_else() {
    let machine = gearbox();
    let clean = run(&machine, "start-stop", 30.0, (1, 1), &[]);
    for effect in EFFECTS {
        let with = run(&machine, "start-stop", 30.0, (1, 1), &[effect.name]);
        let changed: Vec<&str> = bits(&clean)
            .into_iter()
            .filter(|(name, values)| bits(&with)[name] != *values)
            .map(|(name, _)| name)
            .collect();
        let gauges = changed
            .iter()
            .filter(|n| machine.channels.iter().any(|c| c.name == **n))
            .count();
        let others = changed.len() - gauges;
        let (expected, on_bench) = match effect.name {
            "gain-error" | "channel-delay" | "gauge-step" | "gauge-debonding" | "bursts"
            | "dropped-bits" | "stuck-values" | "missing-samples" => (1, false),
            "gauge-creep" => (3, false),
            "peak-overestimated" | "planet-sharing" => (5, false),
            "gauge-position"
            | "thermal-drift"
            | "gauge-offset"
            | "thermal-gain"
            | "carrier-order"
            | "bending-load"
            | "strain-nonlinearity"
            | "mains-pick-up" => (13, false),
            "encoder-eccentricity" => {
                assert!(
                    changed
                        .iter()
                        .all(|n| ["encoder_main", "index"].contains(n)),
                    "{changed:?}"
                );
                continue;
            }
            _ => (13, true),
        };
        assert_eq!(
            (gauges, others > 0),
            (expected, on_bench),
            "{}: {changed:?}",
            effect.name
        );
    }
}

#[test]
fn effects_have_the_size_that_they_state() {
    let machine = gearbox();
    let run = |scenario, effects: &[&str]| run(&machine, scenario, 23.1, (4, 4), effects);
    let clean = run("constant", &[]);
    let change = |name: &str, effects: &[&str]| {
        let with = run("constant", effects);
        with[name]
            .iter()
            .zip(&clean[name])
            .map(|(a, b)| a - b)
            .collect::<Vec<f64>>()
    };
    let span = mean(&clean["ta1"]);
    let gain = change("ta1", &["gain-error@ta1=2"]);
    assert!((mean(&gain).abs() / span - 0.1).abs() < 1e-3);
    let mains = change("ta1", &["mains-pick-up"]);
    assert!((std(&mains) * 2f64.sqrt() / span - 0.02).abs() < 1e-3);
    let order = change("ta1", &["carrier-order"]);
    assert!(
        (std(&order) * 2f64.sqrt() / span - 0.03).abs() < 2e-3,
        "{}",
        std(&order) / span
    );
    let creep = change("hsh1", &["gauge-creep"]);
    let end = mean(&creep[11_000..11_500]);
    let expected = 0.12 * (1.0 - (-22.5_f64 / 30.0).exp()) * 41.7e-6;
    assert!((end / expected - 1.0).abs() < 0.3, "{end} {expected}");
    let step = change("rg2", &["gauge-step@rg2"]);
    assert!(step[100].abs() < 1e-12 && step[11_000].abs() > 3e-6);
    let bent = change("ta1", &["bending-load"]);
    let bent_left = change("ta2", &["bending-load"]);
    let product = mean(
        &bent
            .iter()
            .zip(&bent_left)
            .map(|(a, b)| a * b)
            .collect::<Vec<_>>(),
    );
    assert!(
        product > 0.0,
        "bending has no opposite signs left and right"
    );
    let peak = |c: &Columns| c["rg1"].iter().fold(0.0, |m: f64, v| m.max(*v));
    let lower = run("constant", &["peak-overestimated"]);
    assert!((peak(&lower) / peak(&clean) - 0.9).abs() < 0.01);
    assert!((mean(&lower["rg1"]) - mean(&clean["rg1"])).abs() < 0.2e-6);
    let missing = run("constant", &["missing-samples@ta1"]);
    let share =
        missing["ta1"].iter().filter(|v| v.is_nan()).count() as f64 / missing["ta1"].len() as f64;
    assert!((share - 0.01).abs() < 0.004, "{share}");
    let late = change("ta1", &["channel-delay@ta1"]);
    assert!(late.iter().all(|v| v.abs() < 2e-6) && std(&late) > 0.0);
    // Friction is torque that the generator misses.
    let hss = change("torque_hss", &["coulomb-friction=1"]);
    assert!(
        (mean(&hss[5000..]) * 61.8 / 312e3 + 0.02).abs() < 1e-3,
        "{}",
        mean(&hss[5000..])
    );
    let loss = change("torque_hss", &["load-friction=1"]);
    assert!(
        (mean(&loss[5000..]) * 61.8 / 309e3 + 0.02).abs() < 1e-3,
        "{}",
        mean(&loss[5000..])
    );
    let ripple = change("torque_hss", &["torque-ripple=1"]);
    assert!(std(&ripple) > 1.0);
}

#[test]
fn torque_through_zero_rests_in_the_backlash() {
    let machine = gearbox();
    let idle = |effects: &[&str]| {
        let c = run(&machine, "reversals", 40.0, (2, 2), effects);
        c["hsh1"]
            .windows(10)
            .filter(|w| w.iter().all(|v| v.abs() < 1.2e-6))
            .count()
    };
    let (with, without) = (idle(&["backlash"]), idle(&[]));
    assert!(with > without + 50, "{with} {without}");
}

/// What a description says of a mesh is what the effect does; a loss before the first shaft
/// leaves less for both sides.
#[test]
fn a_described_loss_is_that_of_the_effect() {
    let mut machine = gearbox();
    let run = |machine: &_, effects: &[&str]| run(machine, "reversals", 10.0, (4, 4), effects);
    let with_effect = run(&machine, &["load-friction=1"]);
    let losing = Some(Friction {
        load_part: 0.02,
        ..Friction::default()
    });
    let inertias = |machine: &mut Machine, at: usize| {
        let drivetrain = machine.drivetrain.as_mut().unwrap();
        drivetrain
            .inertias
            .iter_mut()
            .for_each(|i| i.friction = None);
        drivetrain.inertias[at].friction = losing;
    };
    inertias(&mut machine, 1);
    assert_eq!(bits(&run(&machine, &[])), bits(&with_effect));
    inertias(&mut machine, 0);
    let columns = super::run(&machine, "constant", 23.1, (4, 4), &[]);
    let carried = mean(&columns["ta1"][5000..]);
    let clean = super::run(&gearbox(), "constant", 23.1, (4, 4), &[]);
    let part = carried / mean(&clean["ta1"][5000..]);
    // By hand: what is carried and 2 % of it are the load.
    assert!((part - 1.0 / 1.02).abs() < 1e-3, "{part}");
}
