//! Tests the drivetrain plant against results by hand: natural frequency, energy and momentum,
//! steady load with friction, backlash, step length, speed control.

use crate::chain_parameters::Shaft;
use crate::drivetrain_plant::*;

fn two(gear: f64, backlash: f64) -> Plant {
    let body = |inertia| Body {
        inertia,
        ..Body::default()
    };
    let chain = Chain {
        bodies: vec![body(4.0e5), body(1.5e5)],
        shafts: vec![Shaft {
            stiffness: 4.0e7,
            damping: 0.0,
            backlash,
            variation: 0.0,
            loss_before: 0.0,
            loss: 0.0,
            gear,
        }],
        ripples: vec![],
        presliding: Vec::new(),
        nominal_speed: 2.7,
        nominal_torque: 3.0e5,
    };
    // Without a controller, unless a test gives it a bandwidth.
    Plant::new(&chain, 1, 0.0)
}

fn loads(speed: f64, first: f64, last: f64) -> Drive {
    let mut drive = Drive::at_speed(speed);
    drive.load(0, first);
    drive.load(1, last);
    drive
}

#[test]
fn free_vibration_has_the_frequency_of_two_inertias_on_a_spring() {
    // w^2 = k (1/J1 + 1/J2); a gear of 0.01 % hardly changes it.
    let mut plant = two(1e-4, 0.0);
    let expected = (4.0e7_f64 * (1.0 / 4.0e5 + 1.0 / 1.5e5)).sqrt() / std::f64::consts::TAU;
    plant.settle(0.0, &loads(0.0, 1e5, -1e5));
    let dt = 1e-3;
    let steps = plant.steps_per_sample(dt).unwrap();
    let mut crossings = vec![];
    let mut before = plant.torque_of(0);
    for sample in 1..20_000 {
        for _ in 0..steps {
            plant.step(dt / f64::from(steps), &loads(0.0, 0.0, 0.0));
        }
        let now = plant.torque_of(0);
        if before < 0.0 && now >= 0.0 {
            crossings.push((f64::from(sample) - now / (now - before)) * dt);
        }
        before = now;
    }
    let turns = crossings.len() - 1;
    let found = turns as f64 / (crossings[turns] - crossings[0]);
    assert!(
        (found / expected - 1.0).abs() < 1e-3,
        "{found} Hz, {expected} Hz"
    );
}

#[test]
fn a_free_plant_keeps_energy_and_momentum() {
    let mut plant = two(0.01, 0.0);
    plant.settle(0.0, &loads(2.0, 1e5, -1e5));
    let energy = |p: &Plant| {
        (0..3)
            .map(|i| 0.5 * p.bodies[i].inertia * p.state.speed[i].powi(2))
            .sum::<f64>()
            + (0..2)
                .map(|i| 0.5 * p.segments[i].stiffness * p.state.twist[i].powi(2))
                .sum::<f64>()
    };
    let momentum = |p: &Plant| {
        (0..3)
            .map(|i| p.bodies[i].inertia * p.state.speed[i])
            .sum::<f64>()
    };
    let (e, m) = (energy(&plant), momentum(&plant));
    assert!(
        (m - 2.0 * 5.5e5).abs() < 1e-6 * m,
        "the split keeps the inertia"
    );
    for _ in 0..100_000 {
        plant.step(1e-4, &loads(0.0, 0.0, 0.0));
    }
    assert!((energy(&plant) / e - 1.0).abs() < 1e-6);
    assert!((momentum(&plant) / m - 1.0).abs() < 1e-9);
}

#[test]
fn a_steady_load_is_carried_whole_less_the_friction_before_it() {
    // By hand: 300 kNm in, 1000 N m s/rad * 2 rad/s and 500 N m on the
    // first body: 297.5 kNm in the mesh.
    let mut plant = two(0.01, 0.002);
    plant.bodies[0].viscous = 1000.0;
    plant.bodies[0].coulomb = 500.0;
    let balanced = loads(2.0, 3e5, -3e5 + plant.drag(2.0));
    plant.settle(0.0, &balanced);
    for _ in 0..10_000 {
        plant.step(1e-4, &balanced);
    }
    assert!(
        (plant.torque_of(0) - 297_500.0).abs() < 1.0,
        "{}",
        plant.torque_of(0)
    );
    assert!((plant.speed_of(1) - 2.0).abs() < 1e-6);
}

#[test]
fn inside_the_backlash_no_torque_is_carried_and_stops_push_only() {
    let mut plant = two(0.01, 0.01);
    plant.settle(0.0, &loads(0.0, 1.0, -1.0));
    plant.segments[1].damping = 1e6;
    let (mut idle, mut before) = (0, 0.0_f64);
    let mut signs = vec![];
    for _ in 0..200_000 {
        plant.step(1e-4, &loads(0.0, -2000.0, 2000.0 * 1.5 / 4.0));
        let (torque, twist) = (plant.torque_of(0), plant.state.twist[1]);
        if twist.abs() < 0.005 {
            assert_eq!(torque, 0.0);
            idle += 1;
        } else {
            assert!(
                torque * twist >= 0.0,
                "a stop that pulls: {torque} at {twist}"
            );
        }
        if torque != 0.0 && torque.signum() != before.signum() {
            signs.push(torque.signum());
        }
        before = if torque == 0.0 { before } else { torque };
    }
    assert!(idle > 100, "crossed the gap in {idle} steps");
    assert!(signs.contains(&-1.0));
}

#[test]
fn a_stiffer_plant_is_stepped_finer_and_one_beyond_reach_is_refused() {
    let mut plant = two(0.01, 0.0);
    let soft = plant.steps_per_sample(0.002).unwrap();
    assert_eq!(soft, 20);
    for s in &mut plant.segments {
        s.stiffness *= 1e4;
    }
    assert!(plant.steps_per_sample(0.002).unwrap() > 100);
    for s in &mut plant.segments {
        s.stiffness *= 1e12;
    }
    assert!(plant.steps_per_sample(0.002).is_err());
}

#[test]
fn the_controlled_machine_holds_the_speed_against_the_load() {
    let mut plant = two(0.01, 0.0);
    plant.bodies[0].viscous = 1000.0;
    for segment in &mut plant.segments[..2] {
        segment.damping = 4e5;
    }
    let chain_inertia = plant.inertia();
    plant.controller.proportional = 3.0 * chain_inertia;
    plant.controller.integral = 2.25 * chain_inertia;
    plant.settle(0.0, &Drive::at_speed(2.0));
    let drive = loads(2.5, 3e5, 0.0);
    for _ in 0..200_000 {
        plant.step(1e-4, &drive);
    }
    assert!((plant.speed_of(1) - 2.5).abs() < 1e-6);
    assert!(
        (plant.drive() - (2500.0 - 3e5)).abs() < 1.0,
        "{}",
        plant.drive()
    );
}
