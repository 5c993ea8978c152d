//! Unit tests of the fault isolation among redundant gauges: fault kinds, two faults at once,
//! exchanged gauges, ambiguous cases.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::drivetrain::fault_isolation::*;

/// Response of each gauge at nominal load; noise is 0.3, as of strain in micrometre a metre.
const MAPS: [f32; 4] = [100.0, 80.0, 120.0, -60.0];
const NOISE: f32 = 0.3;
const CONSISTENCY: Consistency = Consistency {
    forgetting: 0.02,
    noise_bound: 1.86,
    model_bound: 24.0,
    most_turn: 1.0,
};

/// The gauges of one direction and their maps' errors.
struct Rig {
    fault_isolation: FaultIsolation,
    isolation: Isolation,
    direction: Direction,
    rng: ChaCha8Rng,
    errors: [f32; 4],
    sample: u32,
    /// Part of the way to the first gauges' mean that the prediction goes in a sample, and how far
    /// it is off.
    follows: f32,
    off: f32,
    /// Part of the load that is there.
    load: f32,
}

impl Rig {
    fn new(gauges: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let errors = core::array::from_fn(|_| {
            let z: f32 = rng.sample(StandardNormal);
            1.0 + 0.02 * z.clamp(-2.0, 2.0)
        });
        let error = |map: &f32| ([0.5, 0.03 * map.abs()], 1.0);
        Self {
            fault_isolation: FaultIsolation::new(CONSISTENCY, MAPS.iter().map(error)),
            isolation: Isolation::default(),
            direction: Direction {
                members: (0..gauges as u8).collect(),
            },
            rng,
            errors,
            sample: 0,
            follows: 0.0,
            off: 0.0,
            load: 1.0,
        }
    }

    /// `samples` under a load that swings, each reading changed by `change`.
    fn run(&mut self, samples: u32, change: impl Fn(&mut [f32; 4], u32)) {
        for k in 0..samples {
            self.sample += 1;
            let swing = libm::sinf(self.sample as f32 * 0.01);
            let sensed = self.load * (0.8 + 0.3 * swing);
            let mut readings = core::array::from_fn(|i| {
                let noise: f32 = self.rng.sample(StandardNormal);
                MAPS[i] * self.errors[i] * sensed + NOISE * noise
            });
            change(&mut readings, k);
            let predicted = sensed + self.off;
            let mean = (0..3).map(|i| readings[i] / MAPS[i] / 3.0).sum::<f32>();
            self.off += self.follows * (mean - predicted);
            let mut gauges = [Gauge::default(); MAX_CHANNELS];
            for (i, gauge) in gauges.iter_mut().enumerate().take(4) {
                *gauge = Gauge {
                    value: Some(readings[i]),
                    innovation: readings[i] - MAPS[i] * predicted,
                    response: MAPS[i] * predicted,
                    sensitivity: MAPS[i],
                    variance: NOISE * NOISE,
                    persistent: 0.0,
                };
            }
            let prior = Prior {
                sensed: predicted,
                variance: 1e-4,
            };
            let direction = self.direction.clone();
            (self.fault_isolation).weigh(&mut self.isolation, 0, &direction, &gauges, prior);
        }
    }

    fn faults(&self) -> [Option<Fault>; 4] {
        core::array::from_fn(|i| self.isolation.fault(i))
    }
}

#[test]
fn gauges_whose_maps_are_roughly_right_are_not_flagged() {
    for seed in 0..40 {
        let mut rig = Rig::new(2 + seed as usize % 3, seed);
        for _ in 0..25 {
            rig.run(100, |_, _| ());
            assert_eq!(rig.faults(), [None; 4], "{seed}");
            assert!(!rig.isolation.contradicted(), "{seed}");
        }
    }
}

#[test]
fn a_fault_is_isolated_named_and_forgotten() {
    type Change = fn(&mut [f32; 4], u32);
    let cases: [(Change, Fault); 5] = [
        (|y, _| y[1] = 0.1, Fault::Dead),
        (|y, _| y[1] = -y[1], Fault::Reversed),
        (|y, _| y[1] *= 0.6, Fault::Gain),
        (|y, _| y[1] += 50.0, Fault::Offset),
        (|y, k| y[1] += 0.02 * k as f32, Fault::Drift),
    ];
    for (change, kind) in cases {
        for seed in 0..10 {
            for gauges in [3, 4] {
                let mut rig = Rig::new(gauges, seed);
                rig.run(1000, |_, _| ());
                rig.run(2000, change);
                let mut expected = [None; 4];
                expected[1] = Some(kind);
                assert_eq!(rig.faults(), expected, "{kind:?} {seed} {gauges}");
                // Two seconds at 500 Hz.
                rig.run(1000, |_, _| ());
                assert_eq!(rig.faults(), [None; 4], "{kind:?} {seed} {gauges}");
            }
        }
    }
}

#[test]
fn two_at_once_are_isolated_among_four() {
    for seed in 0..10 {
        let mut rig = Rig::new(4, seed);
        rig.run(1000, |_, _| ());
        rig.run(1000, |y, _| {
            y[0] = 0.0;
            y[2] += 80.0;
        });
        let expected = [Some(Fault::Dead), None, Some(Fault::Offset), None];
        assert_eq!(rig.faults(), expected, "{seed}");
    }
}

#[test]
fn exchanged_gauges_are_named() {
    for seed in 0..10 {
        let mut rig = Rig::new(4, seed);
        rig.run(1000, |_, _| ());
        rig.run(1000, |y, _| y.swap(1, 2));
        let out = rig.faults().map(|fault| fault.is_some());
        assert_eq!(out, [false, true, true, false], "{seed}");
    }
}

/// Two gauges that drift apart slowly: the prediction follows both, and none is isolated.
#[test]
fn where_nothing_isolates_the_culprit_the_direction_is_contradicted() {
    let mut rig = Rig::new(2, 1);
    // From the start: no prediction speaks for either.
    rig.run(200, |y, _| y[1] *= 0.5);
    assert!(rig.isolation.contradicted());
    rig.run(500, |_, _| ());
    assert!(!rig.isolation.contradicted());
}

#[test]
fn of_three_gauges_one_gain_is_as_simple_as_two_unless_the_prediction_accuses_one() {
    for sound in [0, 1000] {
        let mut rig = Rig::new(3, 1);
        rig.run(sound, |_, _| ());
        rig.run(500, |y, _| y[1] *= 0.6);
        assert_eq!(rig.faults()[..3], [None, Some(Fault::Gain), None]);
        assert_eq!(rig.isolation.contradicted(), sound == 0);
        rig.run(1000, |_, _| ());
        assert!(!rig.isolation.contradicted());
    }
}

#[test]
fn two_of_three_gauges_with_one_gain_do_not_pass_for_the_third() {
    for ramp in [1, 400] {
        let mut rig = Rig::new(3, 1);
        rig.follows = 0.3;
        rig.run(1000, |_, _| ());
        let gain = |k: u32| 1.0 - 0.4 * (k as f32 / ramp as f32).min(1.0);
        rig.run(1000, |y, k| {
            y[0] *= gain(k + 1);
            y[1] *= gain(k + 1);
        });
        assert!(rig.isolation.contradicted(), "{ramp} {:?}", rig.faults());
        rig.run(1000, |_, _| ());
        assert!(!rig.isolation.contradicted());
    }
}

#[test]
fn two_dead_gauges_do_not_outvote_the_third() {
    for seed in 0..10 {
        let mut rig = Rig::new(3, seed);
        rig.follows = 0.3;
        // Dead while no load is there, with which all agree; from the start, and later.
        rig.load = 0.0;
        rig.run(1000 * (seed as u32 % 2), |_, _| ());
        let dead: fn(&mut [f32; 4], u32) = |y, _| (y[0], y[1]) = (0.1, -0.1);
        rig.run(500, dead);
        assert!(!rig.isolation.contradicted());
        rig.load = 1.0;
        rig.run(500, dead);
        assert_eq!(rig.faults()[2], None, "{seed}");
        assert!(rig.faults()[..2].iter().all(Option::is_some), "{seed}");
        assert!(rig.isolation.contradicted(), "{seed}");
        rig.run(1000, |_, _| ());
        assert_eq!(rig.faults(), [None; 4], "{seed}");
        assert!(!rig.isolation.contradicted(), "{seed}");
    }
}

/// The two that read no load are right once they read one while the third is left out.
#[test]
fn an_offset_without_a_load_is_ambiguous_until_the_load_is_there() {
    let mut rig = Rig::new(3, 1);
    rig.load = 0.0;
    let offset: fn(&mut [f32; 4], u32) = |y, _| y[1] += 50.0;
    rig.run(500, offset);
    assert!(rig.isolation.contradicted());
    for load in [1.0, 0.0] {
        rig.load = load;
        rig.run(500, offset);
        assert_eq!(rig.faults()[..3], [None, Some(Fault::Offset), None]);
        assert!(!rig.isolation.contradicted());
    }
}

#[test]
fn a_dead_gauge_stays_left_out_while_no_load_is_there() {
    let mut rig = Rig::new(3, 1);
    rig.run(1000, |_, _| ());
    for load in [1.0, 0.0, 1.0] {
        rig.load = load;
        rig.run(500, |y, _| y[1] = 0.1);
        assert_eq!(rig.faults()[..3], [None, Some(Fault::Dead), None], "{load}");
    }
}

#[test]
fn disagreement_grows_the_deviation() {
    let mut rig = Rig::new(3, 1);
    rig.errors = [1.0; 4];
    rig.run(500, |_, _| ());
    assert_eq!(rig.fault_isolation.inflation(&rig.isolation, 0), 1.0);
    assert_eq!(rig.fault_isolation.deviation(&rig.isolation, 1).1, 0.0);
    rig.run(500, |y, _| y[1] *= 1.08);
    let (_, added) = rig.fault_isolation.deviation(&rig.isolation, 1);
    // By hand: a spread of 8 % in one of three gauges of about equal weight, sqrt(2)/3 of it.
    let deviation = libm::sqrtf(added);
    assert!((0.02..0.05).contains(&deviation), "{deviation}");
    assert!(rig.fault_isolation.inflation(&rig.isolation, 0) > 10.0);
}

/// Two directions of four gauges: a counter that they share would give each every other pair.
#[test]
fn every_pair_of_every_direction_is_tested_for_exchanged_readings() {
    let errors = [([0.5, 3.0], 1.0); MAX_CHANNELS];
    let fault_isolation = FaultIsolation::new(CONSISTENCY, errors.into_iter());
    let gauge = Gauge {
        value: Some(100.0),
        innovation: 5.0,
        response: 95.0,
        sensitivity: 100.0,
        variance: NOISE * NOISE,
        persistent: 0.0,
    };
    let mut gauges = [gauge; MAX_CHANNELS];
    for (i, gauge) in gauges.iter_mut().enumerate() {
        gauge.value = Some(100.0 + i as f32);
    }
    let prior = Prior {
        sensed: 0.95,
        variance: 1e-4,
    };
    let mut isolation = Isolation::default();
    let directions = [0..4_u8, 4..8].map(|members| Direction {
        members: members.collect(),
    });
    for _ in 0..6 {
        for (d, direction) in directions.iter().enumerate() {
            fault_isolation.weigh(&mut isolation, d, direction, &gauges, prior);
        }
    }
    for direction in &directions {
        for (q, j) in direction.members.iter().enumerate() {
            for i in direction.members.iter().take(q) {
                let cost = isolation.swap[pair(usize::from(*i), usize::from(*j))];
                assert!(cost != 0.0, "{i} {j}");
            }
        }
    }
}
