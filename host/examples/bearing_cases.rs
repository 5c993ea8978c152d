//! Benchmark of the bearing's estimator: load cases on random individuals, each calibrated on
//! its rig and then driven. `bearing_cases [FIRST [COUNT [sizes]]]`, numbers of the
//! individuals; with `sizes` each is of another size, too.

use std::collections::BTreeMap;
use std::path::Path;

use loadtwin::bearing::baseline::{Comparison, METHODS, Rmse};
use loadtwin::bearing::{Calibration, Rig, RigSample, calibrate, model};
use loadtwin::image_build::Sensors;
use loadtwin::machine::{BEARING_LOADS, Bearing, Kind, Machine};
use loadtwin::simulate::{BearingEffect, BearingScenario, BearingSimulation};
use loadtwin_common::bearing::BearingEstimator as Filter;
use loadtwin_common::io::raw::RawSample;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A bearing of another size, drawn by its number: what is described differs, not only the part.
fn another_size(described: &Bearing, number: u64) -> Bearing {
    let mut rng = ChaCha8Rng::seed_from_u64(number);
    let mut bearing = described.clone();
    bearing.balls = rng.random_range(11..=16);
    bearing.ball_mm *= rng.random_range(0.92..1.08);
    bearing.pitch_mm = f64::from(bearing.balls) * bearing.ball_mm * rng.random_range(0.375..0.41);
    bearing.rows_mm *= rng.random_range(0.85..1.15);
    bearing.contact_angle_deg = rng.random_range(34.0..42.0);
    bearing.stiffness_n_per_mm_1_5 *= rng.random_range(0.9..1.1);
    bearing.preload_um *= rng.random_range(0.8..1.25);
    let softness = rng.random_range(0.75..1.3);
    for entry in bearing.compliance_um_per_kn.iter_mut().flatten() {
        *entry *= softness;
    }
    bearing
}

fn record(
    machine: &Machine,
    bearing: &Bearing,
    name: &str,
    seed: u64,
    individual: u64,
    effects: &[BearingEffect],
) -> Vec<RigSample> {
    let (scenario, duration) = BearingScenario::by_name(name).unwrap();
    let simulation = BearingSimulation::new(
        machine,
        bearing,
        scenario,
        duration,
        seed,
        Some(individual),
        effects,
    )
    .unwrap();
    let mut samples = Vec::new();
    for block in simulation {
        for i in 0..block.t.len() {
            let value = |column: usize| block.columns[column].as_ref().unwrap()[i];
            let mut raw = RawSample {
                tick: samples.len() as u32,
                ..RawSample::default()
            };
            for (g, channel) in machine.channels.iter().enumerate() {
                raw.set_word(g, channel.word(channel.to_si(value(g))));
            }
            raw.set_encoder(0, value(4) as i64 as u32);
            samples.push((raw, std::array::from_fn(|j| value(5 + j))));
        }
    }
    samples
}

/// Name, scenario, effects.
const CASES: [(&str, &str, &[BearingEffect]); 6] = [
    ("lc1", "lc1", &[]),
    ("lc2", "lc2", &[]),
    ("lc3", "lc3", &[]),
    ("stop-and-go", "stop-and-go", &[]),
    ("lc1, preload -12 %", "lc1", &[BearingEffect::Preload(0.88)]),
    (
        "lc1, front dead",
        "lc1",
        &[BearingEffect::DeadGauge(0, 10.0)],
    ),
];

type Compared = [[Rmse; 4]; METHODS.len()];

struct Score {
    rmse: [f64; 5],
    valid: f64,
    first_valid_s: f64,
    rate: f64,
    /// By the paper's algorithms and by the joint filter.
    compared: Compared,
}

fn score(
    machine: &Machine,
    bearing: &Bearing,
    sensors: &Sensors,
    calibration: &Calibration,
    samples: &[RigSample],
) -> Score {
    let filter = Filter::try_build(
        model(machine, bearing, sensors, calibration).unwrap(),
        machine.rate_hz as f32,
    )
    .unwrap();
    let mut state = filter.start();
    let mut comparison = Comparison::try_new(machine, bearing, calibration)
        .unwrap()
        .unwrap();
    let mut estimates = Vec::new();
    let mut sums = [0.0; 5];
    let (mut valid, mut first) = (0.0, f64::NAN);
    let started = std::time::Instant::now();
    for (i, (raw, truth)) in samples.iter().enumerate() {
        let estimate = filter.step(&mut state, raw);
        estimates.push(estimate.clone());
        if estimate.loads.iter().all(|load| load.fault.is_none()) {
            valid += 1.0;
            if first.is_nan() {
                first = i as f64 / machine.rate_hz;
            }
            for ((sum, load), truth) in sums.iter_mut().zip(&estimate.loads).zip(truth) {
                *sum += (f64::from(load.value) - truth).powi(2);
            }
        }
    }
    let seconds = started.elapsed().as_secs_f64();
    for (estimate, (_, truth)) in estimates.iter().zip(samples) {
        comparison.push(estimate, truth);
    }
    let ranges = bearing.range.all();
    Score {
        rmse: std::array::from_fn(|i| {
            100.0 * f64::sqrt(sums[i] / valid) / (ranges[i][1] - ranges[i][0])
        }),
        valid: valid / samples.len() as f64,
        first_valid_s: first,
        rate: samples.len() as f64 / seconds,
        compared: comparison.rmse(),
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |i: usize, default: u64| {
        arguments
            .get(i)
            .map_or(default, |text| text.parse().unwrap())
    };
    let (first, count) = (number(1, 101), number(2, 1));
    let path = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/bearing/machine.toml"
    ));
    let machine = Machine::load(path).unwrap();
    let Some(Kind::Bearing(described)) = machine.kind() else {
        panic!("no bearing")
    };
    let sizes = arguments.get(3).is_some_and(|text| text == "sizes");
    let sensors = Sensors::choose(&machine, None).unwrap();
    let mut means = BTreeMap::<String, Vec<[f64; 5]>>::new();
    let mut compared = BTreeMap::<String, Vec<Compared>>::new();
    for individual in first..first + count {
        let bearing = &if sizes {
            another_size(described, individual)
        } else {
            described.clone()
        };
        let rig = Rig {
            machine: &machine,
            bearing,
            sensors: &sensors,
        };
        let t0 = std::time::Instant::now();
        let samples = record(
            &machine,
            bearing,
            "calibration",
            individual,
            individual,
            &[],
        );
        let t1 = t0.elapsed().as_secs_f64();
        let calibration = match calibrate(&rig, &samples, |_| ()) {
            Ok(calibration) => calibration,
            Err(error) => {
                println!("{individual}: {error}");
                continue;
            }
        };
        println!(
            "{individual}: simulated {t1:.1} s, calibrated {:.1} s; stiffness {:+.2}, preload {:+.2}, contact angle {:+.2} deg",
            t0.elapsed().as_secs_f64() - t1,
            calibration.physical.stiffness,
            calibration.physical.preload,
            calibration.physical.contact_angle_deg,
        );
        for (case, scenario, effects) in CASES {
            let samples = record(
                &machine,
                bearing,
                scenario,
                individual + 1000,
                individual,
                effects,
            );
            let s = score(&machine, bearing, &sensors, &calibration, &samples);
            println!(
                "  {case:<20} {:6.2?} valid {:.3} from {:.1} s, {:.0} samples/s",
                s.rmse, s.valid, s.first_valid_s, s.rate
            );
            if s.valid == 0.0 {
                continue;
            }
            means.entry(case.into()).or_default().push(s.rmse);
            compared.entry(case.into()).or_default().push(s.compared);
        }
    }
    println!("\nmean RMSE [% of range] {BEARING_LOADS:?}");
    for (case, all) in &means {
        let mean: Vec<f64> = (0..5)
            .map(|i| all.iter().map(|r| r[i]).sum::<f64>() / all.len() as f64)
            .collect();
        println!("{case:<22} {mean:6.2?}  of {}", all.len());
    }
    print_compared(&compared);
}

/// Tables III to V: the mean over the bearings for each case and method.
fn print_compared(compared: &BTreeMap<String, Vec<Compared>>) {
    println!(
        "\nmean RMSE [% of range] of Fx, Fz, Mx, Mz, where all three give loads: whole, stable domain"
    );
    for (case, all) in compared {
        for (m, method) in METHODS.iter().enumerate() {
            let mean = |domain: fn(&Rmse) -> Option<f64>| -> Vec<f64> {
                (0..4)
                    .map(|l| {
                        let of: Vec<f64> = all.iter().filter_map(|c| domain(&c[m][l])).collect();
                        of.iter().sum::<f64>() / of.len() as f64
                    })
                    .collect()
            };
            println!(
                "{case:<22} {method:<14} {:6.1?} {:6.1?}",
                mean(|r| r.whole),
                mean(|r| r.stable)
            );
        }
    }
}
