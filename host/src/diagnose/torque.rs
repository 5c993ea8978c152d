//! What the loads tell of the torques in the chain.

use super::signals::{Response, smooth};
use crate::gearbox::Torsion;
use crate::machine::{Drivetrain, Machine, Senses};

/// The torques in the chain.
pub(super) struct Torques {
    /// Torque of each shaft, referred [N m].
    pub shafts: Vec<Option<Vec<f64>>>,
    /// `sum loads - sum J dw/dt - sum c w`, smoothed, where all loads are known.
    pub balance: Option<Vec<f64>>,
    /// Response of the chain, where all loads are known.
    pub response: Option<Response>,
}

/// Speed and acceleration of each inertia, referred.
pub(super) struct Bodies {
    /// Number of the encoder that tells it.
    pub encoder: Vec<usize>,
    pub speed: Vec<Vec<f64>>,
    pub acceleration: Vec<Vec<f64>>,
}

impl Bodies {
    /// Each inertia by its own encoder, or by the nearest one.
    pub fn new(
        machine: &Machine,
        drivetrain: &Drivetrain,
        speeds: &[Vec<f64>],
        accelerations: &[Vec<f64>],
    ) -> Self {
        let place = |name: &str| {
            drivetrain
                .inertias
                .iter()
                .position(|i| i.name == name)
                .unwrap_or(0)
        };
        let nearest = |body: usize| {
            (0..machine.encoders.len())
                .min_by_key(|k| place(&machine.encoders[*k].inertia).abs_diff(body))
                .unwrap_or(0)
        };
        let encoder: Vec<usize> = (0..drivetrain.inertias.len()).map(nearest).collect();
        Self {
            speed: encoder.iter().map(|e| speeds[*e].clone()).collect(),
            acceleration: encoder.iter().map(|e| accelerations[*e].clone()).collect(),
            encoder,
        }
    }
}

/// The torques that `known` and `drives` come to.
#[allow(
    clippy::too_many_lines,
    reason = "the equations of the chain, in their order"
)]
pub(super) fn torques(
    drivetrain: &Drivetrain,
    torsion: &Torsion,
    motion: &Bodies,
    known: &[Option<Vec<f64>>],
    drives: &[Option<Vec<f64>>],
    width: usize,
    dt_s: f64,
) -> Torques {
    let bodies = drivetrain.inertias.len();
    let n = motion.speed[0].len();
    let ratio = |b: usize| drivetrain.inertias[b].speed_ratio;
    let moment = |b: usize| drivetrain.inertias[b].moment_kg_m2 * ratio(b) * ratio(b);
    let drag = |b: usize| drivetrain.inertias[b].drag_nm_s_per_rad * ratio(b) * ratio(b);
    // Torque from outside on each inertia, referred; none where it is not known.
    let outside: Vec<Option<Vec<f64>>> = (0..bodies)
        .map(|b| {
            let mut sum = vec![0.0; n];
            for (load, values) in drivetrain.loads.iter().zip(known) {
                if torsion.inertia(&load.inertia) == b {
                    let factor = load.direction.sign() * ratio(b);
                    for (sum, v) in sum.iter_mut().zip(values.as_ref()?) {
                        *sum += factor * v;
                    }
                }
            }
            if let Some(drive) = &drives[b] {
                for (sum, v) in sum.iter_mut().zip(drive) {
                    *sum += ratio(b) * v;
                }
            }
            Some(sum)
        })
        .collect();
    let has_load = |b: usize| {
        drives[b].is_some()
            || drivetrain
                .loads
                .iter()
                .any(|l| torsion.inertia(&l.inertia) == b)
    };
    let all = outside.iter().all(Option::is_some);
    let simulated = all.then(|| simulate(torsion, drivetrain, motion, &outside, dt_s));
    // What inertia and drag of body b take, smoothed.
    let taken =
        |b: usize, i: usize| moment(b) * motion.acceleration[b][i] + drag(b) * motion.speed[b][i];
    let slow: Vec<Option<Vec<f64>>> = outside
        .iter()
        .map(|o| o.as_ref().map(|o| smooth(o, width)))
        .collect();
    let mut sides = Vec::new();
    let shafts = (0..bodies - 1)
        .map(|s| {
            let before: Vec<usize> = (0..=s).collect();
            let after: Vec<usize> = (s + 1..bodies).collect();
            let usable = |side: &[usize]| {
                side.iter().all(|b| outside[*b].is_some()) && side.iter().any(|b| has_load(*b))
            };
            let weight = |side: &[usize]| side.iter().map(|b| moment(*b)).sum::<f64>();
            let take_after = match (usable(&before), usable(&after)) {
                (false, false) => {
                    sides.push(vec![0.0; bodies]);
                    return None;
                }
                (true, false) => false,
                (false, true) => true,
                _ => weight(&after) < weight(&before),
            };
            let (side, sign) = if take_after {
                (&after, -1.0)
            } else {
                (&before, 1.0)
            };
            sides.push(
                (0..bodies)
                    .map(|b| if side.contains(&b) { -sign } else { 0.0 })
                    .collect(),
            );
            // The slow part by the loads of one side, the fast part by the chain.
            let source = if simulated.is_some() { &slow } else { &outside };
            let mut torque: Vec<f64> = (0..n)
                .map(|i| {
                    let sum: f64 = side
                        .iter()
                        .map(|b| source[*b].as_ref().map_or(0.0, |o| o[i]) - taken(*b, i))
                        .sum();
                    sign * sum
                })
                .collect();
            if let Some(simulated) = &simulated {
                let slow_part = smooth(&simulated[s], width);
                for i in 0..n {
                    torque[i] += simulated[s][i] - slow_part[i];
                }
            }
            Some(torque)
        })
        .collect();
    let balance = all.then(|| {
        (0..n)
            .map(|i| {
                (0..bodies)
                    .map(|b| slow[b].as_ref().map_or(0.0, |o| o[i]) - taken(b, i))
                    .sum()
            })
            .collect()
    });
    let response = all.then(|| Response {
        transition: torsion.discretised(dt_s),
        first_drive: torsion.states() + drivetrain.loads.len(),
        shafts: shaft_rows(torsion, drivetrain),
        stiffness: torsion.referred_stiffness().collect(),
        bodies: (0..bodies).map(|b| (moment(b), ratio(b))).collect(),
        side: sides,
    });
    Torques {
        shafts,
        balance,
        response,
    }
}

fn shaft_rows(torsion: &Torsion, drivetrain: &Drivetrain) -> Vec<Vec<f64>> {
    drivetrain
        .shafts
        .iter()
        .map(|shaft| {
            let row = torsion.sensed_row(&Senses::Shaft(shaft.name.clone()));
            row[..torsion.states()]
                .iter()
                .map(|c| c * shaft.speed_ratio)
                .collect()
        })
        .collect()
}

/// Torque of each shaft when the known torques act on the chain and its rigid
/// motion is the measured one.
fn simulate(
    torsion: &Torsion,
    drivetrain: &Drivetrain,
    motion: &Bodies,
    outside: &[Option<Vec<f64>>],
    dt_s: f64,
) -> Vec<Vec<f64>> {
    let f = torsion.discretised(dt_s);
    let (states, bodies) = (torsion.states(), outside.len());
    let first = states + drivetrain.loads.len();
    let rows = shaft_rows(torsion, drivetrain);
    let n = motion.speed[0].len();
    let moments: Vec<f64> = drivetrain
        .inertias
        .iter()
        .map(|i| i.moment_kg_m2 * i.speed_ratio * i.speed_ratio)
        .collect();
    let total: f64 = moments.iter().sum();
    let torque = |b: usize, i: usize| outside[b].as_ref().map_or(0.0, |o| o[i]);
    let mut x = vec![0.0; states];
    x[states - bodies..].fill(motion.speed[0][0]);
    let net: f64 = (0..bodies).map(|b| torque(b, 0)).sum();
    let mut carried = 0.0;
    for (s, k) in torsion.referred_stiffness().enumerate() {
        carried += torque(s, 0) - moments[s] / total * net;
        x[1 + s] = carried / k;
    }
    let mut next = x.clone();
    let mut out = vec![Vec::with_capacity(n); rows.len()];
    for i in 0..n {
        for (row, out) in rows.iter().zip(&mut out) {
            out.push(row.iter().zip(&x).map(|(c, x)| c * x).sum());
        }
        let to = (i + 1).min(n - 1);
        for (r, slot) in next.iter_mut().enumerate() {
            let mut sum = 0.0;
            for (c, x) in x.iter().enumerate() {
                sum += f[(r, c)] * x;
            }
            for b in 0..bodies {
                // Between the samples by straight lines: their mean over the step.
                let u = 0.5 * (torque(b, i) + torque(b, to)) / drivetrain.inertias[b].speed_ratio;
                sum += f[(r, first + b)] * u;
            }
            *slot = sum;
        }
        let speeds = states - bodies;
        let mean: f64 = (0..bodies)
            .map(|b| moments[b] / total * next[speeds + b])
            .sum();
        let shift = motion.speed[0][to] - mean;
        next[speeds..].iter_mut().for_each(|w| *w += shift);
        next[0] = 0.0;
        std::mem::swap(&mut x, &mut next);
    }
    out
}
