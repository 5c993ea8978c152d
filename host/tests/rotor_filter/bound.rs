//! Displacement error of the rotor filter against a lower bound, least squares of a constant
//! unbalance on a rotor that is known exactly: at most 0.03 % of the peak more. Rotors that are not
//! quite as described stay within 1 or 2 % of the peak; a new start resets the mismatch alarm.

use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use faer::Mat;
use faer::linalg::solvers::Solve;
use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::{Machine, Senses};
use loadtwin::replay::Samples;
use loadtwin::simulate::{AppliedUnbalance, RotorScenario};
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::{Image, Model};
use loadtwin_common::io::raw::RawSample;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{evaluated, machine, paper, record, replayed_as, soft};

/// Samples, and displacements of every node [m], `[sample][of each]`.
pub struct Recorded {
    pub raw: Vec<RawSample>,
    pub displacements: Vec<Vec<f64>>,
}

impl Recorded {
    pub fn read(machine: &Machine, path: &Path) -> Self {
        let sensors = Sensors::choose(machine, None).unwrap();
        let mut samples = Samples::open(machine, &sensors, path).unwrap();
        let (mut raw, mut displacements) = (Vec::new(), Vec::new());
        while samples
            .next_block(|sample| {
                raw.push(sample.raw);
                displacements.push(sample.displacements.to_vec());
            })
            .unwrap()
        {}
        Self { raw, displacements }
    }
}

/// A rotor from rest under each unbalance of nominal size alone, in phase and a quarter turn on.
struct Bound {
    /// `[column][sample][displacement]`.
    columns: Vec<Vec<Vec<f64>>>,
}

impl Bound {
    fn new(machine: &Machine, like: &RotorScenario) -> Self {
        let rotor = machine.rotor.as_ref().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("column.parquet");
        let columns = (0..2 * rotor.loads.len())
            .map(|column| {
                let unbalances = (rotor.loads.iter().enumerate())
                    .map(|(k, load)| AppliedUnbalance {
                        moment_kg_m: if k == column / 2 {
                            load.nominal_n / rotor.speed_rad_s.powi(2)
                        } else {
                            0.0
                        },
                        phase_rad: FRAC_PI_2 * (column % 2) as f64,
                    })
                    .collect();
                let scenario = RotorScenario {
                    unbalances,
                    noise: 0.0,
                    ..like.clone()
                };
                record(machine, scenario, &path);
                Recorded::read(machine, &path).displacements
            })
            .collect();
        Self { columns }
    }

    /// Largest error at any node of `recording` from `from_s` on [µm].
    ///
    /// `u = (1 + C' R^-1 C)^-1 C' R^-1 y` of the samples so far, in nominal loads.
    fn settled_um(&self, machine: &Machine, recording: &Path, from_s: f64) -> f64 {
        let recorded = Recorded::read(machine, recording);
        let p = self.columns.len();
        let mut information = Mat::<f64>::identity(p, p);
        let mut weighted = Mat::<f64>::zeros(p, 1);
        let mut worst = 0.0_f64;
        for (i, raw) in recorded.raw.iter().enumerate() {
            for (channel, word) in machine.channels.iter().zip(raw.words) {
                let reading = f64::from(word - channel.zero_word()) * channel.lsb_si();
                let Senses::Displacement(at) = &channel.senses else {
                    continue;
                };
                let (sine, cosine) = at.direction_deg.to_radians().sin_cos();
                let of = |column: &Vec<Vec<f64>>| {
                    column[i][2 * at.node] * cosine + column[i][2 * at.node + 1] * sine
                };
                let row: Vec<f64> = self.columns.iter().map(of).collect();
                let weight = channel.to_si(channel.noise_std).powi(-2);
                for a in 0..p {
                    weighted[(a, 0)] += weight * row[a] * reading;
                    for b in 0..p {
                        information[(a, b)] += weight * row[a] * row[b];
                    }
                }
            }
            if (i as f64) < from_s * machine.rate_hz {
                continue;
            }
            let u = information.partial_piv_lu().solve(&weighted);
            for (k, truth) in recorded.displacements[i].iter().enumerate() {
                let columns = self.columns.iter().enumerate();
                let estimate: f64 = columns.map(|(j, column)| u[(j, 0)] * column[i][k]).sum();
                worst = worst.max((estimate - truth).abs());
            }
        }
        1e6 * worst
    }
}

/// A rotor after the example: another shaft, discs, bearings and speed.
pub fn drawn(seed: u64) -> Machine {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut machine = machine();
    machine.name = format!("drawn rotor {seed}");
    let rotor = machine.rotor.as_mut().unwrap();
    let outer = rng.random_range(0.015..0.022);
    rotor.sections[0].outer_m = outer;
    rotor.discs[0].node = rng.random_range(9..15);
    rotor.discs[1].node = rng.random_range(20..28);
    for (disc, load) in rotor.discs.iter_mut().zip(&mut rotor.loads) {
        disc.mass_kg *= rng.random_range(0.7..1.6);
        load.node = disc.node;
    }
    for bearing in &mut rotor.bearings {
        let mut stiffness = || 10.0_f64.powf(rng.random_range(6.0..8.5));
        bearing.stiffness_n_per_m = Some([[stiffness(), 0.0], [0.0, stiffness()]]);
        let mut damping = || rng.random_range(20.0..300.0);
        bearing.damping_n_s_per_m = [[damping(), 0.0], [0.0, damping()]];
    }
    // Critical speeds go with the diameter squared.
    rotor.speed_rad_s = 130.0 * (outer / 0.017).powi(2) * rng.random_range(0.5..1.7);
    for load in &mut rotor.loads {
        load.nominal_n = 0.007 * 0.068 * rotor.speed_rad_s.powi(2);
        load.walk_n_per_sqrt_s = None;
    }
    machine
}

/// Settled error [µm] of the filter, and of least squares with the rotor known exactly.
fn compared(machine: &mut Machine, seeds: std::ops::Range<u64>) {
    // What a reduced model errs by after a start, part of the peak.
    const MODEL: f64 = 3e-4;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rotor.parquet");
    let speeds_rad_s = [machine.rotor.as_ref().unwrap().speed_rad_s; 2];
    let scenario = |seed| RotorScenario {
        speeds_rad_s,
        ..paper(1.0, seed)
    };
    let bound = Bound::new(machine, &scenario(0));
    for noise_m in [1e-7, 1e-6] {
        for channel in &mut machine.channels {
            channel.noise_std = noise_m;
        }
        let (mut filter, mut start, mut least, mut peak) = (0.0, 0.0, 0.0, 0.0);
        let count = (seeds.end - seeds.start) as f64;
        for seed in seeds.clone() {
            record(machine, scenario(seed), &path);
            let outcome = evaluated(machine, &path);
            assert_eq!(outcome.mismatched, 0, "{}", machine.name);
            let bound_um = bound.settled_um(machine, &path, 1.0);
            println!(
                "seed {seed}: settled {:.3} µm, bound {bound_um:.3} µm",
                outcome.settled_um
            );
            filter += outcome.settled_um / count;
            start += outcome.start_um / count;
            least += bound_um / count;
            peak = outcome.peak_um;
        }
        println!(
            "{}, {:.0} rad/s, {peak:.0} µm, noise {noise_m:e} m: settled {filter:.3} µm, bound {least:.3} µm; start-up {start:.2} µm",
            machine.name, speeds_rad_s[0]
        );
        assert!(filter < least + MODEL * peak, "{filter} {least}");
    }
}

/// The paper's rotor, the soft one, and drawn ones; `ROTORS`: the seeds of these.
pub fn rotors() -> Vec<Machine> {
    let seeds = std::env::var("ROTORS").unwrap_or_else(|_| "5,6".into());
    let seeds = seeds.split(',').filter(|seed| !seed.is_empty());
    let drawn = seeds.map(|seed| drawn(seed.parse().unwrap()));
    [machine(), soft()].into_iter().chain(drawn).collect()
}

/// `DRAWS`: how many draws of the noise.
#[test]
fn the_filter_errs_by_little_more_than_what_no_estimator_betters() {
    let draws = std::env::var("DRAWS").map_or(3, |draws| draws.parse().unwrap());
    for mut machine in rotors() {
        compared(&mut machine, 21..21 + draws);
    }
}

/// A rotor with a modulus 0.2 %, bearings 1 % and all damping 10 % above what is described, times `factor`.
fn off(described: &Machine, factor: f64) -> Machine {
    let mut real = described.clone();
    let rotor = real.rotor.as_mut().unwrap();
    for material in &mut rotor.materials {
        material.young_pa *= 1.0 + 0.002 * factor;
    }
    for section in &mut rotor.sections {
        section.alpha_per_s *= 1.0 + 0.1 * factor;
        section.beta_s *= 1.0 + 0.1 * factor;
    }
    for bearing in &mut rotor.bearings {
        for k in bearing.stiffness_n_per_m.iter_mut().flatten().flatten() {
            *k *= 1.0 + 0.01 * factor;
        }
        for c in bearing.damping_n_s_per_m.iter_mut().flatten() {
            *c *= 1.0 + 0.1 * factor;
        }
    }
    real
}

/// After a gap that is a new start, the mismatch alarm and its gains are reset.
#[test]
fn a_new_start_resets_the_mismatch_alarm() {
    const NEW: usize = 2850;
    let mut described = machine();
    // The new start is on a machine that runs.
    described.rotor.as_mut().unwrap().reduction.initial_std = 1.0;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rotor.parquet");
    record(&off(&described, 0.2), paper(1.0, 21), &path);
    let raw = Recorded::read(&described, &path).raw;
    let sensors = Sensors::choose(&described, None).unwrap();
    let payload = image_build::image(&described, &sensors).unwrap();
    let line = || {
        let mut image = Image::from_bytes(&payload).unwrap();
        let Model::Rotor(model) = &mut image.model else {
            panic!("not a rotor");
        };
        // Steady before the next mismatch alarm.
        model.levels[0].full_samples = 600;
        Estimator::try_build(image).unwrap()
    };
    let (mut going, mut fresh) = (line(), line());
    let mut raised = false;
    for sample in &raw[..2700] {
        going.step(sample);
        raised |= going.rotor_level() > 0;
    }
    assert!(raised);
    fresh.step(&raw[0]);
    let mut steady = 0;
    for sample in &raw[NEW..] {
        let (a, b) = (going.step(sample), fresh.step(sample));
        for (a, b) in a.loads.iter().zip(&b.loads) {
            assert_eq!((a.value, a.std), (b.value, b.std), "{}", sample.tick);
        }
        steady += u32::from(a.steady && going.rotor_level() == 0);
    }
    assert!(steady > 200, "{steady}");
}

/// Modulus 0.2 %, bearings 1 % and all damping 10 % above and below what is described, and a fifth
/// and fivefold of it.
#[test]
fn a_rotor_that_is_not_quite_as_described_is_estimated_within_some_per_mille() {
    for described in rotors().into_iter().chain([drawn(3)]) {
        for sign in [-5.0, -1.0, -0.2, 0.2, 1.0, 5.0] {
            let real = off(&described, sign);
            let rotor = described.rotor.as_ref().unwrap();
            let scenario = RotorScenario {
                speeds_rad_s: [rotor.speed_rad_s; 2],
                ..paper(1.0, 21)
            };
            let outcome = replayed_as(&described, &real, scenario);
            println!(
                "{}, {sign:+} times what it is off: start-up {:.2}, settled {:.2} µm of {:.0} µm, force {:.2} %, doubted {} of {}",
                described.name,
                outcome.start_um,
                outcome.settled_um,
                outcome.peak_um,
                outcome.force_percent,
                outcome.mismatched,
                outcome.samples
            );
            assert!(outcome.mismatched > 0 || f64::abs(sign) < 1.0);
            // Settled error, part of the peak.
            let most = if f64::abs(sign) > 1.0 { 0.02 } else { 0.01 };
            assert!(outcome.settled_um < most * outcome.peak_um);
        }
    }
}
