//! Torques in the chain that follow from the loads.

use crate::drivetrain::chain_response::{DrivenChain, ShaftResponse, shaft_rows};
use crate::drivetrain::signals::Response;
use crate::smoothing::smooth;
use loadtwin_design::gearbox::Torsion;
use loadtwin_machine::{CREEP, Drivetrain, Machine};

/// The torques in the chain.
pub(crate) struct ShaftTorques {
    /// Torque of each shaft, referred [N m].
    pub shafts: Vec<Option<Vec<f64>>>,
    /// `sum loads - sum J dw/dt - sum c w - sum friction`, smoothed, where all loads are known.
    pub balance: Option<Vec<f64>>,
    /// Response of the chain, where all loads are known.
    pub response: Option<Response>,
}

/// Speed and acceleration of each inertia, referred.
pub(crate) struct InertiaMotion {
    /// Number of the encoder that measures it.
    pub encoder: Vec<usize>,
    pub speed: Vec<Vec<f64>>,
    pub acceleration: Vec<Vec<f64>>,
}

impl InertiaMotion {
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
pub(crate) fn torques(
    drivetrain: &Drivetrain,
    torsion: &Torsion,
    motion: &InertiaMotion,
    known: &[Option<Vec<f64>>],
    drives: &[Option<Vec<f64>>],
    width: usize,
    dt_s: f64,
) -> ShaftTorques {
    let bodies = drivetrain.inertias.len();
    let n = motion.speed[0].len();
    let ratio = |b: usize| drivetrain.inertias[b].speed_ratio;
    let moment = |b: usize| drivetrain.inertias[b].referred_moment();
    let drag = |b: usize| drivetrain.inertias[b].referred_drag();
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
    let driven = all.then(|| DrivenChain {
        drivetrain: drivetrain.clone(),
        outside: outside.iter().flatten().cloned().collect(),
        speed: motion.speed[0].clone(),
        dt_s,
        play: Vec::new(),
        encoders: Vec::new(),
    });
    let simulated = driven.as_ref().map(|d| d.carried().torque);
    // Dry friction of each body, referred and smoothed: vibration as it sticks is not modelled.
    let creeping = CREEP * drivetrain.nominal_speed_rad_s;
    let dry: Vec<Option<Vec<f64>>> = (0..bodies)
        .map(|b| {
            let referred = drivetrain.inertias[b].referred_friction()?;
            let unloaded = motion.speed[b].iter().map(|w| (*w, 0.0));
            Some(smooth(&referred.course(unloaded, dt_s, creeping), width))
        })
        .collect();
    // Part of the torque carried that each body loses.
    let losses: Vec<Option<Vec<f64>>> = (0..bodies)
        .map(|b| {
            let referred = drivetrain.inertias[b].referred_friction()?;
            let speeds = motion.speed[b].iter().copied();
            let losing = referred.load_part > 0.0;
            losing.then(|| smooth(&referred.losses(speeds, dt_s, creeping), width))
        })
        .collect();
    let lost = |b: usize, i: usize| losses[b].as_ref().map_or(0.0, |losses| losses[i]);
    // Torque of inertia and friction of body b, smoothed.
    let absorbed = |b: usize, i: usize| {
        moment(b) * motion.acceleration[b][i]
            + drag(b) * motion.speed[b][i]
            + dry[b].as_ref().map_or(0.0, |dry| dry[i])
    };
    let slow: Vec<Option<Vec<f64>>> = outside
        .iter()
        .map(|o| o.as_ref().map(|o| smooth(o, width)))
        .collect();
    let mut sides = Vec::new();
    let shafts: Vec<Option<Vec<f64>>> = (0..bodies - 1)
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
                        .map(|b| source[*b].as_ref().map_or(0.0, |o| o[i]) - absorbed(*b, i))
                        .sum();
                    // The loss of the torque carried is a part of the torque itself.
                    let losses: f64 = side.iter().map(|b| lost(*b, i)).sum();
                    let torque = sign * sum;
                    torque / (1.0 + sign * losses * torque.signum())
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
    // Of the shaft before it, or behind the first.
    let carried = |b: usize, i: usize| {
        let shaft = shafts.get(b.saturating_sub(1)).and_then(Option::as_ref);
        shaft.map_or(0.0, |torque| torque[i])
    };
    let balance = all.then(|| {
        let missing = |b: usize, i: usize| {
            slow[b].as_ref().map_or(0.0, |o| o[i])
                - absorbed(b, i)
                - lost(b, i) * carried(b, i).abs()
        };
        (0..n)
            .map(|i| (0..bodies).map(|b| missing(b, i)).sum())
            .collect()
    });
    let response = driven.map(|driven| Response {
        carried: ShaftResponse::default(),
        driven,
        transition: torsion.discretised(dt_s),
        first_drive: torsion.states() + drivetrain.loads.len(),
        shafts: shaft_rows(torsion, drivetrain),
        stiffness: torsion.referred_stiffness().collect(),
        bodies: (0..bodies).map(|b| (moment(b), ratio(b))).collect(),
        side: sides,
    });
    ShaftTorques {
        shafts,
        balance,
        response,
    }
}
