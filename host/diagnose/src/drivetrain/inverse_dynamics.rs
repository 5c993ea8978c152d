//! Computes the torque of each shaft of a torsional chain from the loads, inertias and friction on
//! one side of it (inverse dynamics), its fast part from simulation; and the torque balance of the
//! whole chain.

use std::ops::Range;

use crate::drivetrain::chain_response::{DrivenChain, ShaftResponse, shaft_rows};
use crate::drivetrain::decimated_signals::Response;
use crate::drivetrain::motion_sensor::moved_inertias;
use crate::smoothing::smooth;
use loadtwin_design::gearbox::Torsion;
use loadtwin_machine::{CREEP, Drivetrain, Inertia, Machine};

/// The torques in the chain.
#[derive(Default)]
pub(crate) struct ShaftTorques {
    /// Torque of each shaft, referred [N m].
    pub shafts: Vec<Option<Vec<f64>>>,
    /// `sum loads - sum J dw/dt - sum c w - sum friction`, smoothed, where all loads are known.
    pub balance: Option<Vec<f64>>,
    /// Response of the chain, where all loads are known.
    pub response: Option<Response>,
}

/// Speed [rad/s] and acceleration [rad/s^2] of each inertia, referred.
pub(crate) struct InertiaMotion {
    /// Number of the encoder or the speed that measures it.
    pub encoder: Vec<usize>,
    pub speed: Vec<Vec<f64>>,
    pub acceleration: Vec<Vec<f64>>,
}

impl InertiaMotion {
    /// Each inertia by its own encoder or speed, or by the nearest one.
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
        let moved: Vec<usize> = moved_inertias(machine).into_iter().map(place).collect();
        let nearest = |body: usize| {
            (0..moved.len())
                .min_by_key(|k| moved[*k].abs_diff(body))
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

/// Torques from outside on the inertias.
pub(crate) struct AppliedTorques<'a> {
    /// Each load of the drivetrain; none where it is not known.
    pub loads: &'a [Option<Vec<f64>>],
    /// Drive of each inertia, where it has one.
    pub drives: &'a [Option<Vec<f64>>],
}

impl AppliedTorques<'_> {
    /// Sum on each inertia, referred; none where a load on it is not known. `n` samples.
    fn on_inertias(
        &self,
        drivetrain: &Drivetrain,
        torsion: &Torsion,
        n: usize,
    ) -> Vec<Option<Vec<f64>>> {
        let on = |b: usize| {
            let ratio = drivetrain.inertias[b].speed_ratio;
            let mut sum = vec![0.0; n];
            for (load, values) in drivetrain.loads.iter().zip(self.loads) {
                if torsion.inertia(&load.inertia) == b {
                    let factor = load.direction.sign() * ratio;
                    for (sum, v) in sum.iter_mut().zip(values.as_ref()?) {
                        *sum += factor * v;
                    }
                }
            }
            if let Some(drive) = &self.drives[b] {
                for (sum, v) in sum.iter_mut().zip(drive) {
                    *sum += ratio * v;
                }
            }
            Some(sum)
        };
        (0..drivetrain.inertias.len()).map(on).collect()
    }

    fn act_on(&self, body: usize, drivetrain: &Drivetrain, torsion: &Torsion) -> bool {
        let mut loads = drivetrain.loads.iter();
        self.drives[body].is_some() || loads.any(|l| torsion.inertia(&l.inertia) == body)
    }
}

/// What the inertias take of the torque: `J dw/dt + c w + friction`, referred and smoothed over
/// `width` samples: vibration as friction sticks is not modelled.
struct Absorption<'a> {
    drivetrain: &'a Drivetrain,
    motion: &'a InertiaMotion,
    /// Dry friction of each body.
    dry: Vec<Option<Vec<f64>>>,
    /// Part of the torque carried that each body loses.
    losses: Vec<Option<Vec<f64>>>,
}

impl<'a> Absorption<'a> {
    fn new(drivetrain: &'a Drivetrain, motion: &'a InertiaMotion, width: usize, dt_s: f64) -> Self {
        let creeping = CREEP * drivetrain.nominal_speed_rad_s;
        let bodies = drivetrain.inertias.iter().zip(&motion.speed);
        let (dry, losses) = bodies
            .map(|(inertia, speed)| {
                let Some(referred) = inertia.referred_friction() else {
                    return (None, None);
                };
                let unloaded = speed.iter().map(|w| (*w, 0.0));
                let dry = smooth(&referred.course(unloaded, dt_s, creeping), width);
                let losing = referred.load_part > 0.0;
                let speeds = speed.iter().copied();
                let losses =
                    losing.then(|| smooth(&referred.losses(speeds, dt_s, creeping), width));
                (Some(dry), losses)
            })
            .unzip();
        Self {
            drivetrain,
            motion,
            dry,
            losses,
        }
    }

    /// Torque of inertia and friction of body `b` at sample `i`.
    fn torque(&self, b: usize, i: usize) -> f64 {
        let inertia = &self.drivetrain.inertias[b];
        inertia.referred_moment() * self.motion.acceleration[b][i]
            + inertia.referred_drag() * self.motion.speed[b][i]
            + self.dry[b].as_ref().map_or(0.0, |dry| dry[i])
    }

    /// Part of the torque carried that body `b` loses at sample `i`.
    fn loss(&self, b: usize, i: usize) -> f64 {
        self.losses[b].as_ref().map_or(0.0, |losses| losses[i])
    }
}

/// The bodies on one side of a shaft from which its torque follows.
#[derive(Clone)]
struct ShaftSide {
    bodies: Range<usize>,
    /// Of the torque of that side in the torque of the shaft.
    sign: f64,
}

impl ShaftSide {
    /// The side of shaft `shaft` whose torques are `known` and on which something `acts`; of two
    /// the one with less inertia.
    fn lighter(
        shaft: usize,
        drivetrain: &Drivetrain,
        known: impl Fn(usize) -> bool,
        acts: impl Fn(usize) -> bool,
    ) -> Option<Self> {
        let before = Self {
            bodies: 0..shaft + 1,
            sign: 1.0,
        };
        let after = Self {
            bodies: shaft + 1..drivetrain.inertias.len(),
            sign: -1.0,
        };
        let usable = |side: &Self| {
            let mut bodies = side.bodies.clone();
            side.bodies.clone().all(&known) && bodies.any(&acts)
        };
        let weight = |side: &Self| -> f64 {
            let inertias = &drivetrain.inertias[side.bodies.clone()];
            inertias.iter().map(Inertia::referred_moment).sum()
        };
        match (usable(&before), usable(&after)) {
            (false, false) => None,
            (false, true) => Some(after),
            (true, true) if weight(&after) < weight(&before) => Some(after),
            (true, _) => Some(before),
        }
    }

    /// By body: what its own torque adds to the torque of the shaft, of the opposite sign.
    fn signs(side: Option<&Self>, bodies: usize) -> Vec<f64> {
        let sign = |b| side.map_or(0.0, |s| if s.bodies.contains(&b) { -s.sign } else { 0.0 });
        (0..bodies).map(sign).collect()
    }

    /// Torque of the shaft, from the torques from `outside`.
    fn torque(
        &self,
        outside: &[Option<Vec<f64>>],
        absorption: &Absorption<'_>,
        n: usize,
    ) -> Vec<f64> {
        let at = |i: usize| {
            let bodies = self.bodies.clone();
            let applied = |b: usize| outside[b].as_ref().map_or(0.0, |o| o[i]);
            let sum: f64 = (bodies.clone())
                .map(|b| applied(b) - absorption.torque(b, i))
                .sum();
            // The loss of the torque carried is a part of the torque itself.
            let losses: f64 = bodies.map(|b| absorption.loss(b, i)).sum();
            let torque = self.sign * sum;
            torque / (1.0 + self.sign * losses * torque.signum())
        };
        (0..n).map(at).collect()
    }
}

/// The torques in the chain: the slow part by the loads on one side of each shaft, the fast part
/// by the response of the chain, where all loads are known. Smoothed over `width` samples.
pub(crate) fn torques(
    drivetrain: &Drivetrain,
    torsion: &Torsion,
    motion: &InertiaMotion,
    applied: &AppliedTorques<'_>,
    width: usize,
    dt_s: f64,
) -> ShaftTorques {
    let bodies = drivetrain.inertias.len();
    let n = motion.speed[0].len();
    let outside = applied.on_inertias(drivetrain, torsion, n);
    let all = outside.iter().all(Option::is_some);
    let driven = all.then(|| DrivenChain {
        drivetrain: drivetrain.clone(),
        outside: outside.iter().flatten().cloned().collect(),
        speed: motion.speed[0].clone(),
        dt_s,
        play: Vec::new(),
        encoders: Vec::new(),
    });
    let absorption = Absorption::new(drivetrain, motion, width, dt_s);
    let slow: Vec<Option<Vec<f64>>> = (outside.iter())
        .map(|o| o.as_ref().map(|o| smooth(o, width)))
        .collect();
    let known = |b: usize| outside[b].is_some();
    let acts = |b: usize| applied.act_on(b, drivetrain, torsion);
    let sides: Vec<Option<ShaftSide>> = (0..bodies - 1)
        .map(|shaft| ShaftSide::lighter(shaft, drivetrain, known, acts))
        .collect();
    let simulated = driven.as_ref().map(|d| d.carried().torque);
    let source = if simulated.is_some() { &slow } else { &outside };
    let torque = |(s, side): (usize, &Option<ShaftSide>)| {
        let mut torque = side.as_ref()?.torque(source, &absorption, n);
        if let Some(simulated) = &simulated {
            let slow_part = smooth(&simulated[s], width);
            for i in 0..n {
                torque[i] += simulated[s][i] - slow_part[i];
            }
        }
        Some(torque)
    };
    let shafts: Vec<Option<Vec<f64>>> = sides.iter().enumerate().map(torque).collect();
    let balance = all.then(|| balance(&slow, &shafts, &absorption, n));
    let response = driven.map(|driven| Response {
        carried: ShaftResponse::default(),
        driven,
        transition: torsion.discretised(dt_s),
        first_drive: torsion.states() + drivetrain.loads.len(),
        shafts: shaft_rows(torsion, drivetrain),
        stiffness: torsion.referred_stiffness().collect(),
        bodies: (drivetrain.inertias.iter())
            .map(|i| (i.referred_moment(), i.speed_ratio))
            .collect(),
        side: (sides.iter())
            .map(|side| ShaftSide::signs(side.as_ref(), bodies))
            .collect(),
    });
    ShaftTorques {
        shafts,
        balance,
        response,
    }
}

/// `sum loads - sum J dw/dt - sum c w - sum friction` of all bodies.
fn balance(
    slow: &[Option<Vec<f64>>],
    shafts: &[Option<Vec<f64>>],
    absorption: &Absorption<'_>,
    n: usize,
) -> Vec<f64> {
    // Of the shaft before it, or behind the first.
    let carried = |b: usize, i: usize| {
        let shaft = shafts.get(b.saturating_sub(1)).and_then(Option::as_ref);
        shaft.map_or(0.0, |torque| torque[i])
    };
    let missing = |b: usize, i: usize| {
        slow[b].as_ref().map_or(0.0, |o| o[i])
            - absorption.torque(b, i)
            - absorption.loss(b, i) * carried(b, i).abs()
    };
    (0..n)
        .map(|i| (0..slow.len()).map(|b| missing(b, i)).sum())
        .collect()
}
