//! Fixed-lag smoothing of the rotor filter: estimates belong to the sample that they state, and
//! their error falls with the lag.

use faer::{Mat, Side};
use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::{LoadKind, Machine};
use loadtwin::replay::run_line;
use loadtwin::rotor::RotorFilterDesign;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::{Image, Model};
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::raw::RawSample;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::bound::{Recorded, rotors};
use crate::{Case, driven_by, machine, paper, record};

/// With loads that may do anything.
fn lagging(machine: Machine, lag: u8) -> Machine {
    let mut machine = driven_by(machine, LoadKind::Walk);
    machine.rotor.as_mut().unwrap().lag_samples = Some(lag);
    machine
}

/// The paper's case without noise.
fn quiet(machine: &Machine) -> Recorded {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rotor.parquet");
    record(machine, paper(0.0, 1), &path);
    Recorded::read(machine, &path)
}

/// Forces that may do anything are known the better, the more was read since.
#[test]
fn the_later_an_estimate_the_less_it_errs() {
    for rotor in rotors() {
        let case = Case::noisy(LoadKind::Walk, 1e-7);
        for seed in [3, 4] {
            let errors = [0, 1, 2, 4].map(|lag| {
                let outcome = case.run(lagging(rotor.clone(), lag), seed);
                (outcome.settled_um, outcome.force_percent)
            });
            println!("{}, seed {seed}: {errors:.2?}", rotor.name);
            assert!(errors[2].0 < 0.8 * errors[0].0, "{errors:?}");
            assert!(errors[2].0 <= 1.8, "{errors:?}");
            assert!(errors[2].1 < 0.8 * errors[0].1, "{errors:?}");
            assert!(errors.is_sorted_by(|a, b| b.1 < a.1), "{errors:?}");
        }
    }
}

/// Without noise an estimate is off by less than a tenth of what the rotor moves by in a
/// sample: one sample of unreported lag would make it off by all of it. That holds where
/// samples are lost and readings missing, too.
#[test]
fn an_estimate_is_of_the_sample_that_it_says() {
    for lag in 0..=4_u8 {
        let mut machine = lagging(machine(), lag);
        for channel in &mut machine.channels {
            channel.noise_std = 1e-8;
        }
        let Recorded {
            mut raw,
            displacements,
        } = quiet(&machine);
        raw.retain(|sample| !matches!(sample.tick, 2500 | 3100..3103 | 3300..3420));
        raw.insert(2200, raw[2199]);
        for sample in &mut raw {
            if matches!(sample.tick, 2800 | 3103) {
                sample.valid &= !1;
            }
        }
        let sensors = Sensors::choose(&machine, None).unwrap();
        let plan =
            RotorFilterDesign::new(&machine, machine.rotor.as_ref().unwrap(), &sensors.channels);
        let plan = plan.unwrap();
        let payload = image_build::image(&machine, &sensors).unwrap();
        let mut line = Estimator::try_build(Image::from_bytes(&payload).unwrap()).unwrap();
        let mut estimated = vec![0.0; 2 * plan.nodes()];
        let (mut worst, mut moved, mut steady) = (0.0_f64, 0.0_f64, 0);
        let mut last = None;
        for sample in &raw {
            let estimate = line.step(sample);
            let again = last == Some(sample.tick);
            last = Some(sample.tick);
            // Before the first sample, and the first one after more were lost than are bridged.
            let unknown = [0, 3420].map(|first| first..first + u32::from(lag));
            let unknown = unknown.iter().any(|of| of.contains(&sample.tick));
            for load in &estimate.loads {
                // A new start may contradict what it was not made for.
                if sample.tick < 3420 {
                    let unread = load.age - u16::from(lag);
                    assert_eq!(unread, u16::from(again), "{lag}: {load:?}");
                }
                // Nor before a reading was used.
                let invalid = unknown || load.age == u16::MAX;
                assert_eq!(load.fault == Fault::NotValid, invalid, "{lag}: {load:?}");
                assert_eq!(load.std == f32::MAX, unknown, "{lag}: {load:?}");
            }
            // A start needs its time.
            if !(2000..3420).contains(&sample.tick) {
                continue;
            }
            steady += u32::from(estimate.steady);
            plan.displacements(
                line.rotor_state(),
                f64::from(line.rotor_speed()),
                &mut estimated,
            );
            let of = sample.tick as usize - usize::from(lag);
            for (i, estimated) in estimated.iter().enumerate() {
                worst = worst.max((estimated - displacements[of][i]).abs());
                moved = moved.max((displacements[of - 1][i] - displacements[of][i]).abs());
            }
        }
        assert!(steady > 900, "{steady}");
        println!("lag {lag}: {worst:.1e} m, a sample moves {moved:.1e} m");
        assert!(worst < 0.1 * moved, "{lag}: {worst:e} {moved:e}");
    }
}

/// Loads that walk as described, on the model itself: the squared error over the reported
/// variance is 1 on average, and not more in the samples after some were lost.
#[test]
fn the_reported_deviation_is_that_of_the_error() {
    const NZ: usize = 8;
    for lag in [0, 2, 4] {
        let machine = lagging(machine(), lag);
        let rotor = machine.rotor.as_ref().unwrap();
        let sensors = Sensors::choose(&machine, None).unwrap();
        let plan = RotorFilterDesign::new(&machine, rotor, &sensors.channels).unwrap();
        let f = &plan.transitions().unwrap()[0].1;
        let payload = image_build::image(&machine, &sensors).unwrap();
        let image = Image::from_bytes(&payload).unwrap();
        let Model::Rotor(model) = &image.model else {
            panic!("not a rotor");
        };
        let model = model.clone();
        let n = f.nrows();
        let q = Mat::from_fn(n, n, |i, j| {
            let (low, high) = (i.min(j), i.max(j));
            f64::from(model.levels[0].process.get(high * (high + 1) / 2 + low))
        });
        let eigen = q.self_adjoint_eigen(Side::Lower).unwrap();
        let root = Mat::from_fn(n, n, |i, j| {
            eigen.U()[(i, j)] * eigen.S()[j].max(0.0).sqrt()
        });
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut line = Estimator::try_build(image).unwrap();
        let mut x = Mat::<f64>::zeros(n, 1);
        let mut forces = Vec::new();
        // All, and those after a gap: sum and count of the squared error over the variance.
        let mut found = [(0.0, 0.0); 2];
        for tick in 0..30_000_u32 {
            x = f * &x + &root * Mat::from_fn(n, 1, |_, _| normal());
            forces.push([0, 1, 2, 3].map(|j| x[(2 * NZ + j, 0)]));
            let mut raw = RawSample {
                tick,
                ..RawSample::default()
            };
            for (k, channel) in model.channels.iter().enumerate() {
                let moved: f64 = (channel.row.iter().enumerate())
                    .map(|(i, h)| f64::from(*h) * x[(i, 0)])
                    .sum();
                let reading = moved + f64::from(channel.variance).sqrt() * normal();
                raw.set_word(
                    k,
                    (reading / f64::from(channel.converter.gain)).round() as i32,
                );
            }
            let since = tick % 500;
            if since < 40 && tick > 1000 {
                continue;
            }
            let estimate = line.step(&raw);
            if tick < 1000 {
                continue;
            }
            for (j, load) in estimate.loads.iter().enumerate() {
                let of = tick as usize - usize::from(lag);
                let scale = f64::from(model.scale[2 * NZ + j]);
                let off = f64::from(load.value) - scale * forces[of][j];
                let part = (off / f64::from(load.std)).powi(2);
                found[0] = (found[0].0 + part, found[0].1 + 1.0);
                if since < 60 && tick > 1500 {
                    found[1] = (found[1].0 + part, found[1].1 + 1.0);
                }
            }
        }
        let [all, after] = found.map(|(sum, count)| sum / count);
        println!("lag {lag}: squared error over variance {all:.2}, after gaps {after:.2}");
        assert!(
            (0.9..1.1).contains(&all) && (0.7..1.2).contains(&after),
            "{lag}: {all} {after}"
        );
    }
}

/// Each sample of a recording is shown once, in order, with what it was itself.
#[test]
fn a_replay_shows_every_sample_beside_the_estimate_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rotor.parquet");
    record(&machine(), paper(1.0, 1), &path);
    let shown = |lag: u8| {
        let machine = lagging(machine(), lag);
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
