//! Estimates that lag: of the sample that they say, and better.

use loadtwin::build::{self, Sensors};
use loadtwin::machine::{LoadKind, Machine};
use loadtwin::replay::{Samples, run_line};
use loadtwin::rotor::RotorPlan;
use loadtwin_common::fault::Fault;
use loadtwin_common::image::Image;
use loadtwin_common::line::Line;
use loadtwin_common::raw::RawSample;

use crate::bound::rotors;
use crate::{Case, machine, paper, record};

fn lagging(mut machine: Machine, kind: LoadKind, lag: u8) -> Machine {
    let rotor = machine.rotor.as_mut().unwrap();
    rotor.lag_samples = Some(lag);
    for load in &mut rotor.loads {
        load.kind = kind;
        load.walk_n_per_sqrt_s = None;
    }
    machine
}

/// Samples of the paper's case without noise, and what moved the nodes.
fn quiet(machine: &Machine) -> (Vec<RawSample>, Vec<Vec<f64>>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rotor.parquet");
    record(machine, paper(0.0, 1), &path);
    let sensors = Sensors::choose(machine, None).unwrap();
    let mut samples = Samples::open(machine, &sensors, &path).unwrap();
    let (mut raw, mut displacements) = (Vec::new(), Vec::new());
    while samples
        .next_block(|sample| {
            raw.push(sample.raw);
            displacements.push(sample.displacements.to_vec());
        })
        .unwrap()
    {}
    (raw, displacements)
}

/// Forces that may do anything are known the better, the more was read since.
#[test]
fn the_later_an_estimate_the_less_it_errs() {
    for rotor in rotors() {
        let case = Case::noisy(LoadKind::Walk, 1e-7);
        for seed in [3, 4] {
            let errors = [0, 1, 2, 4].map(|lag| {
                let outcome = case.run(lagging(rotor.clone(), LoadKind::Walk, lag), seed);
                (outcome.settled_um, outcome.force_percent)
            });
            println!("{}, seed {seed}: {errors:.2?}", rotor.name);
            assert!(errors[2].0 < 0.85 * errors[0].0, "{errors:?}");
            assert!(errors[2].0 <= 1.8, "{errors:?}");
            assert!(errors.is_sorted_by(|a, b| b.1 < a.1), "{errors:?}");
        }
    }
}

/// Without noise an estimate is off by less than a tenth of what the rotor moves by in a
/// sample: by one sample's lag that is not told it would be off by all of it. That holds where
/// samples are lost and readings missing, too.
#[test]
fn an_estimate_is_of_the_sample_that_it_says() {
    for lag in 0..=4_u8 {
        let mut machine = lagging(machine(), LoadKind::Walk, lag);
        for channel in &mut machine.channels {
            channel.noise_std = 1e-8;
        }
        let (mut raw, displacements) = quiet(&machine);
        raw.retain(|sample| !matches!(sample.tick, 2500 | 3100..3103));
        for sample in &mut raw {
            if matches!(sample.tick, 2800 | 3103) {
                sample.valid &= !1;
            }
        }
        let sensors = Sensors::choose(&machine, None).unwrap();
        let plan = RotorPlan::new(&machine, machine.rotor.as_ref().unwrap(), &sensors.channels);
        let plan = plan.unwrap();
        let payload = build::image(&machine, &sensors).unwrap();
        let mut line = Line::try_build(Image::from_bytes(&payload).unwrap()).unwrap();
        let mut told = vec![0.0; 2 * plan.nodes()];
        let (mut worst, mut moved, mut steady) = (0.0_f64, 0.0_f64, 0);
        for sample in &raw {
            let estimate = line.step(sample);
            for load in &estimate.loads {
                let unread = load.age - u16::from(lag);
                assert_eq!(unread, 0, "{lag}: {load:?}");
                let before = sample.tick < u32::from(lag);
                assert_eq!(load.fault == Fault::NotValid, before, "{lag}: {load:?}");
            }
            if sample.tick < 2000 {
                continue;
            }
            steady += u32::from(estimate.steady);
            plan.displacements(line.rotor_state(), f64::from(line.rotor_speed()), &mut told);
            let of = sample.tick as usize - usize::from(lag);
            for (i, told) in told.iter().enumerate() {
                worst = worst.max((told - displacements[of][i]).abs());
                moved = moved.max((displacements[of - 1][i] - displacements[of][i]).abs());
            }
        }
        assert!(steady > 1000, "{steady}");
        println!("lag {lag}: {worst:.1e} m, a sample moves {moved:.1e} m");
        assert!(worst < 0.1 * moved, "{lag}: {worst:e} {moved:e}");
    }
}

/// Each sample of a recording is shown once, in order, with what it was itself.
#[test]
fn a_replay_shows_every_sample_beside_the_estimate_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rotor.parquet");
    record(&machine(), paper(1.0, 1), &path);
    let shown = |lag: u8| {
        let machine = lagging(machine(), LoadKind::Walk, lag);
        let sensors = Sensors::choose(&machine, None).unwrap();
        let mut shown = Vec::new();
        run_line(&machine, &sensors, &path, |sample, estimate, _, _| {
            let sensors: Vec<f32> = estimate.sensors.iter().map(|s| s.innovation).collect();
            let displacements = sample.displacements.to_vec();
            shown.push((sample.t, sample.raw, displacements, estimate.tick, sensors));
            assert_eq!(estimate.tick, sample.raw.tick);
            assert!(estimate.loads.iter().all(|l| l.fault == Fault::None));
        })
        .unwrap();
        shown
    };
    let prompt = shown(0);
    assert_eq!(prompt.len(), 4000);
    for lag in [1, 4] {
        assert!(shown(lag) == prompt, "{lag}");
    }
}
