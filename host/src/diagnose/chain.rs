//! The torsional chain under the torques that a recording tells.

use crate::gearbox::Torsion;
use crate::machine::{Drivetrain, Inertia, Senses, Shaft};

/// Part to which inertias and stiffnesses are known: how long a vibration
/// stays in step with the simulated one.
pub(super) const TOLERANCE: f64 = 0.002;

/// The same of damping, which is never known better.
pub(super) const DAMPING_TOLERANCE: f64 = 0.1;

/// A chain, what acts on it from outside, and its rigid motion.
#[derive(Clone, Debug)]
pub struct Driven {
    /// The chain.
    pub drivetrain: Drivetrain,
    /// Torque on each inertia, referred [N m].
    pub outside: Vec<Vec<f64>>,
    /// Speed of the main shaft [rad/s].
    pub speed: Vec<f64>,
    /// Sample period [s].
    pub dt_s: f64,
    /// Lost motion of each shaft, referred, the whole width [rad]; empty where there is none.
    pub play: Vec<f64>,
}

/// What each shaft does, sample by sample, referred.
#[derive(Clone, Debug, Default)]
pub struct Carried {
    /// Torque [N m].
    pub torque: Vec<Vec<f64>>,
    /// Twist, lost motion included [rad].
    pub twist: Vec<Vec<f64>>,
}

impl Driven {
    /// What the shafts do, the rigid motion being the measured one:
    ///
    /// `x+ = F x + G (u + k clip(twist))`, `tau = C x - k clip(twist)`,
    ///
    /// where `clip` is the part of the twist within the lost motion.
    pub fn carried(&self) -> Carried {
        let torsion = Torsion::new(&self.drivetrain);
        let f = torsion.discretised(self.dt_s);
        let (states, bodies) = (torsion.states(), self.outside.len());
        let first = states + self.drivetrain.loads.len();
        let rows = shaft_rows(&torsion, &self.drivetrain);
        let stiffness: Vec<f64> = torsion.referred_stiffness().collect();
        let n = self.speed.len();
        let ratio = |b: usize| self.drivetrain.inertias[b].speed_ratio;
        let moments: Vec<f64> = (0..bodies)
            .map(|b| self.drivetrain.inertias[b].moment_kg_m2 * ratio(b) * ratio(b))
            .collect();
        let total: f64 = moments.iter().sum();
        let half = |s: usize| 0.5 * self.play.get(s).copied().unwrap_or(0.0);
        let clip = |x: &[f64]| -> Vec<f64> {
            (0..rows.len())
                .map(|s| stiffness[s] * x[1 + s].clamp(-half(s), half(s)))
                .collect()
        };
        let mut x = vec![0.0; states];
        x[states - bodies..].fill(self.speed[0]);
        let net: f64 = self.outside.iter().map(|o| o[0]).sum();
        let mut carried = 0.0;
        for (s, k) in stiffness.iter().enumerate() {
            carried += self.outside[s][0] - moments[s] / total * net;
            x[1 + s] = carried / k + half(s) * carried.signum();
        }
        let advance = |x: &[f64], i: usize, lost: &[f64]| -> Vec<f64> {
            let to = (i + 1).min(n - 1);
            let u: Vec<f64> = (0..bodies)
                .map(|b| {
                    // Between the samples by straight lines: their mean over the step.
                    let outside = 0.5 * (self.outside[b][i] + self.outside[b][to]);
                    let before = b.checked_sub(1).map_or(0.0, |s| lost[s]);
                    (outside + lost.get(b).copied().unwrap_or(0.0) - before) / ratio(b)
                })
                .collect();
            let mut next: Vec<f64> = (0..states)
                .map(|r| {
                    let own: f64 = x.iter().enumerate().map(|(c, x)| f[(r, c)] * x).sum();
                    let driven: f64 = (0..bodies).map(|b| f[(r, first + b)] * u[b]).sum();
                    own + driven
                })
                .collect();
            let speeds = states - bodies;
            let mean: f64 = (0..bodies)
                .map(|b| moments[b] / total * next[speeds + b])
                .sum();
            let shift = self.speed[to] - mean;
            next[speeds..].iter_mut().for_each(|w| *w += shift);
            next[0] = 0.0;
            next
        };
        let empty = || vec![Vec::with_capacity(n); rows.len()];
        let mut out = Carried {
            torque: empty(),
            twist: empty(),
        };
        for i in 0..n {
            let lost = clip(&x);
            for (s, row) in rows.iter().enumerate() {
                let elastic: f64 = row.iter().zip(&x).map(|(c, x)| c * x).sum();
                out.torque[s].push(elastic - lost[s]);
                out.twist[s].push(x[1 + s]);
            }
            let mut next = advance(&x, i, &lost);
            if !self.play.is_empty() {
                let mean: Vec<f64> = lost
                    .iter()
                    .zip(clip(&next))
                    .map(|(a, b)| 0.5 * (a + b))
                    .collect();
                next = advance(&x, i, &mean);
            }
            x = next;
        }
        out
    }

    /// The same chain with a gear in shaft `s`, between two equal halves of it,
    /// with the moment `part` of the smaller neighbour's, half taken from each.
    pub fn with_gear(&self, s: usize, part: f64) -> Self {
        let mut driven = self.clone();
        let d = &mut driven.drivetrain;
        let referred = |i: &Inertia| i.moment_kg_m2 * i.speed_ratio * i.speed_ratio;
        let moment = part * referred(&d.inertias[s]).min(referred(&d.inertias[s + 1]));
        for neighbour in &mut d.inertias[s..=s + 1] {
            neighbour.moment_kg_m2 -= 0.5 * moment / neighbour.speed_ratio.powi(2);
        }
        let gear = Inertia {
            name: "gear".into(),
            moment_kg_m2: moment,
            speed_ratio: 1.0,
            drag_nm_s_per_rad: 0.0,
            friction: None,
        };
        d.inertias.insert(s + 1, gear);
        d.shafts[s].stiffness_nm_per_rad *= 2.0;
        d.shafts[s].damping_nm_s_per_rad *= 2.0;
        let behind = Shaft {
            name: "behind the gear".into(),
            ..d.shafts[s].clone()
        };
        d.shafts.insert(s + 1, behind);
        driven.outside.insert(s + 1, vec![0.0; driven.speed.len()]);
        driven
    }

    /// How the torque and the twist of each shaft change with the stiffness and
    /// with the damping of each, by what these are known to.
    pub(super) fn tolerances(&self, as_described: &Carried) -> Vec<Carried> {
        let mut changes = Vec::new();
        for s in 0..self.drivetrain.shafts.len() {
            let mut stiffer = self.clone();
            stiffer.drivetrain.shafts[s].stiffness_nm_per_rad *= 1.0 + TOLERANCE;
            let mut damped = self.clone();
            damped.drivetrain.shafts[s].damping_nm_s_per_rad *= 1.0 + DAMPING_TOLERANCE;
            changes.extend([stiffer, damped].map(|d| d.carried().less(as_described)));
        }
        changes
    }
}

impl Carried {
    /// The difference of the two.
    pub fn less(&self, other: &Self) -> Self {
        let difference = |a: &[Vec<f64>], b: &[Vec<f64>]| {
            a.iter()
                .zip(b)
                .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect())
                .collect()
        };
        Self {
            torque: difference(&self.torque, &other.torque),
            twist: difference(&self.twist, &other.twist),
        }
    }
}

/// Torque of each shaft as a row over the states, referred.
pub(super) fn shaft_rows(torsion: &Torsion, drivetrain: &Drivetrain) -> Vec<Vec<f64>> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;
    use std::path::Path;

    /// The example's chain under a torque that swings through zero.
    fn swinging() -> Driven {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/gearbox/machine.toml");
        let drivetrain = Machine::load(&path).unwrap().drivetrain.unwrap();
        let torque: Vec<f64> = (0..2000)
            .map(|i| 1e5 * (f64::from(i) * 0.008 * 0.3).cos())
            .collect();
        let braking = torque.iter().map(|t| -t).collect();
        Driven {
            drivetrain,
            outside: vec![torque, braking],
            speed: vec![0.0; 2000],
            dt_s: 0.008,
            play: Vec::new(),
        }
    }

    #[test]
    fn a_gear_of_next_to_no_inertia_changes_next_to_nothing() {
        let plain = swinging();
        let (without, with) = (plain.carried(), plain.with_gear(0, 1e-6).carried());
        for (a, b) in without.torque[0].iter().zip(&with.torque[1]) {
            assert!((a - b).abs() < 1e-3 * 1e5, "{a} {b}");
        }
    }

    /// By hand: slowly, the shaft carries the torque whatever its play, and its
    /// twist is `tau / k`, and half the play more.
    #[test]
    fn play_is_added_to_the_twist_of_a_slow_torque() {
        let mut driven = swinging();
        driven.play = vec![0.002];
        let stiffness = driven.drivetrain.shafts[0].stiffness_nm_per_rad;
        let carried = driven.carried();
        // Before the first crossing of zero.
        for i in 0..500 {
            let torque = driven.outside[0][i];
            assert!((carried.torque[0][i] - torque).abs() < 0.02 * 1e5);
            let twist = torque / stiffness + 0.001;
            assert!((carried.twist[0][i] - twist).abs() < 1e-4);
        }
    }
}
