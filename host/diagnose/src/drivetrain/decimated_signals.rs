//! Holds the signals of a drivetrain recording from which regressors are computed, decimated to
//! about 125 samples a second (`Signals`). Computes the change of the shaft torques by a torque,
//! gear or inertia that the model lacks.

use faer::Mat;

use crate::drivetrain::chain_response::{DrivenChain, ShaftResponse, moment_std};
use crate::smoothing::smooth;

/// Samples by which torques and angles of one row may be apart: read at once, or as means.
const APART: f64 = 0.5;

/// Response of one torsional chain to a torque that its model lacks.
#[derive(Clone, Debug)]
pub struct Response {
    /// The chain and the torques known to act on it.
    pub driven: DrivenChain,
    /// What its shafts do then, as described.
    pub carried: ShaftResponse,
    /// `[F G]` over a sample of [`Signals`], as [`loadtwin_design::gearbox::Torsion::discretised`].
    pub transition: Mat<f64>,
    /// Column of the first inertia's drive torque.
    pub first_drive: usize,
    /// Row of each shaft's torque over the states, referred.
    pub shafts: Vec<Vec<f64>>,
    /// Stiffness of each shaft, referred [N m/rad].
    pub stiffness: Vec<f64>,
    /// Moment and speed ratio of each inertia, moments referred [kg m^2].
    pub bodies: Vec<(f64, f64)>,
    /// For shaft i and a resisting torque on inertia j: the part of it that is missing in
    /// the shaft's torque computed from the loads of one side, -1, 0 or 1.
    pub side: Vec<Vec<f64>>,
}

/// Signals that effects are made of, sample by sample, about 125 a second.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// Sample period (s).
    pub dt_s: f64,
    /// Raw samples of which one is the mean.
    pub means_of: usize,
    /// Time, continuous over all recordings (s).
    pub t: Vec<f64>,
    /// Carrier angle, continuous over turns (rad).
    pub angle: Vec<f64>,
    /// Speed of the main shaft [rad/s].
    pub speed: Vec<f64>,
    /// Speed of each inertia with its vibrations, referred [rad/s].
    pub speeds: Vec<Vec<f64>>,
    /// Acceleration of the main shaft [rad/s^2].
    pub acceleration: Vec<f64>,
    /// Torque of the first shaft, referred, as part of nominal.
    pub level: Vec<f64>,
    /// Temperature rise above the reference temperature (K).
    pub warming: Option<Vec<f64>>,
    /// Noise of the reference temperature, where that is the first reading (K).
    pub zero_noise_k: f64,
    /// Lag of the gauges behind the thermometer that is described, and in it (s).
    pub lag_s: f64,
    /// Speed of the main shaft that counts as nominal [rad/s].
    pub nominal_speed: f64,
    /// Torque of the main shaft that counts as nominal [N m].
    pub nominal_torque: f64,
    /// Names of the inertias.
    pub inertias: Vec<String>,
    /// Speed ratio of each inertia.
    pub ratios: Vec<f64>,
    /// For each inertia the number of that whose encoder measures its motion.
    pub encoder_inertia: Vec<usize>,
    /// Moving means of this many samples, three times over, smooth the
    /// accelerations; odd.
    pub smoothing: usize,
    /// Angle of one count of the encoder that measures the carrier angle (rad).
    pub count: f64,
    /// None where the loads of the chain are not all known.
    pub response: Option<Response>,
}

impl Signals {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Change of `level`, smoothed [1/s].
    pub fn change(&self) -> Vec<f64> {
        self.rate(&smooth(&self.level, self.smoothing))
    }

    /// What times are known to (s).
    pub fn time_tolerance_s(&self) -> f64 {
        APART * self.dt_s / self.means_of as f64
    }

    /// How the acceleration differs where angles are read later than torques, by what times are known
    /// to [rad/s^2].
    pub fn time_skew(&self) -> Vec<f64> {
        let later_s = self.time_tolerance_s();
        let rate = self.rate(&self.acceleration).into_iter();
        rate.map(|rate| later_s * rate).collect()
    }

    /// Change of `x` over a sample before and one behind, in a second.
    fn rate(&self, x: &[f64]) -> Vec<f64> {
        let last = x.len().saturating_sub(1);
        (0..x.len())
            .map(|i| (i.saturating_sub(1), (i + 1).min(last)))
            .map(|(from, to)| (x[to] - x[from]) / (self.dt_s * (to - from).max(1) as f64))
            .collect()
    }

    /// Speed as part of nominal.
    pub fn relative_speed(&self) -> impl Iterator<Item = f64> {
        self.speed.iter().map(|w| w / self.nominal_speed)
    }

    /// Speed of inertia `body` with its vibrations as part of nominal.
    pub fn vibrating_speed(&self, body: usize) -> impl Iterator<Item = f64> {
        self.speeds[body].iter().map(|w| w / self.nominal_speed)
    }

    /// The part of `x` above the smoothing of the torque computed from the loads of one side.
    pub fn fast(&self, x: &[f64]) -> Vec<f64> {
        let slow = smooth(x, self.smoothing);
        x.iter().zip(slow).map(|(x, slow)| x - slow).collect()
    }

    /// What the shafts do more with a gear in shaft `s` that has the moment `part` of the smaller
    /// neighbour's, the torque of `s` being that behind it; none where the loads are not all known.
    pub fn with_gear(&self, s: usize, part: f64) -> Option<ShaftResponse> {
        let response = self.response.as_ref()?;
        let moment = part * response.bodies[s].0.min(response.bodies[s + 1].0);
        let with = response.driven.with_gear(s, part).carried();
        let with = with.behind_the_gear(s);
        let mut change = self.high_passed(with.difference(&response.carried));
        // The slow part follows from the loads of one side, without the gear.
        let sign = if response.side[s][s + 1] == 0.0 {
            0.5
        } else {
            -0.5
        };
        for (torque, a) in change.torque[s].iter_mut().zip(&self.acceleration) {
            *torque += sign * moment * a;
        }
        Some(change)
    }

    /// What the shafts do more where one inertia after another is larger by what moments are known to.
    pub fn inertia_sensitivities(&self) -> Vec<ShaftResponse> {
        let Some(response) = &self.response else {
            return Vec::new();
        };
        let changes = response
            .driven
            .inertia_sensitivities(&response.carried)
            .into_iter();
        let inertias = &response.driven.drivetrain.inertias;
        let bodies = response.bodies.iter().enumerate();
        bodies
            .zip(changes)
            .map(|((body, (moment, _)), change)| {
                let mut change = self.high_passed(change);
                // The slow part follows from the loads of one side, with the moment described.
                for (torque, side) in change.torque.iter_mut().zip(&response.side) {
                    let unmodelled = moment_std(&inertias[body]) * moment * side[body];
                    for (torque, a) in torque.iter_mut().zip(&self.acceleration) {
                        *torque += unmodelled * a;
                    }
                }
                change
            })
            .collect()
    }

    /// Vibrations that a recording may begin with where shaft `s` has that gear.
    pub fn initial_vibrations_with_gear(&self, s: usize, part: f64) -> Vec<ShaftResponse> {
        let Some(response) = &self.response else {
            return Vec::new();
        };
        let vibrations = response.driven.with_gear(s, part).initial_vibrations();
        (vibrations.into_iter())
            .map(|vibration| self.high_passed(vibration.behind_the_gear(s)))
            .collect()
    }

    /// `carried` with the fast part of its torques alone.
    pub fn high_passed(&self, mut carried: ShaftResponse) -> ShaftResponse {
        for torque in &mut carried.torque {
            *torque = self.fast(torque);
        }
        carried
    }

    /// Part of a slow torque `brake` [N m referred] on inertia `body` that is missing in the
    /// torque of each shaft computed from the loads of one side [N m]; empty where nothing is.
    pub fn unmodelled_slow_torque(&self, body: usize, brake: &[f64]) -> Option<Vec<Vec<f64>>> {
        let unmodelled = |side: &Vec<f64>| match side[body] {
            0.0 => Vec::new(),
            sign => brake.iter().map(|b| sign * b).collect(),
        };
        Some(
            self.response
                .as_ref()?
                .side
                .iter()
                .map(unmodelled)
                .collect(),
        )
    }

    /// What torque of each shaft is unexplained when a torque `brake`
    /// [N m referred] acts on inertia `body` and the model lacks it [N m]:
    ///
    /// `(1 - L) R(brake) + side L(brake)`,
    ///
    /// `R` the response of the chain, `L` the smoothing below which the torque
    /// follows from the loads and accelerations of one side.
    pub fn unmodelled_torque(&self, body: usize, brake: &[f64]) -> Option<Vec<Vec<f64>>> {
        let r = self.response.as_ref()?;
        let states = r.transition.nrows();
        let bodies = r.bodies.len();
        let total: f64 = r.bodies.iter().map(|b| b.0).sum();
        let mut x = vec![0.0; states];
        let mut next = vec![0.0; states];
        let mut torques = vec![Vec::with_capacity(brake.len()); r.shafts.len()];
        let column = r.first_drive + body;
        // It starts where the torque at first has settled: twists relative to the rigid motion.
        let mut carried = 0.0;
        for (i, stiffness) in r.stiffness.iter().enumerate() {
            let own = if i == body { brake[0] } else { 0.0 };
            carried += r.bodies[i].0 / total * brake[0] - own;
            x[1 + i] = carried / stiffness;
        }
        // Over each step the mean of its ends: what is held from its start comes half a step late.
        let ends = brake.iter().zip(brake[1..].iter().chain(brake.last()));
        for (start, end) in ends {
            for (row, torque) in r.shafts.iter().zip(&mut torques) {
                torque.push(row.iter().zip(&x).map(|(c, x)| c * x).sum());
            }
            let u = -0.5 * (start + end) / r.bodies[body].1;
            for (i, slot) in next.iter_mut().enumerate() {
                let mut sum = r.transition[(i, column)] * u;
                for (j, x) in x.iter().enumerate() {
                    sum += r.transition[(i, j)] * x;
                }
                *slot = sum;
            }
            // Rigid motion is measured and not predicted: it is subtracted.
            let first = states - bodies;
            let mean: f64 = (0..bodies)
                .map(|i| r.bodies[i].0 / total * next[first + i])
                .sum();
            next[first..].iter_mut().for_each(|w| *w -= mean);
            next[0] = 0.0;
            std::mem::swap(&mut x, &mut next);
        }
        let slow_brake = smooth(brake, self.smoothing);
        for (torque, side) in torques.iter_mut().zip(&r.side) {
            let slow = smooth(torque, self.smoothing);
            for ((value, slow), brake) in torque.iter_mut().zip(slow).zip(&slow_brake) {
                *value += side[body] * brake - slow;
            }
        }
        Some(torques)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drivetrain::chain_response::shaft_rows;
    use loadtwin_design::gearbox::Torsion;
    use loadtwin_machine::{Inertia, Machine};
    use std::f64::consts::TAU;
    use std::path::Path;

    /// By hand, two masses: a torque `f` on the second twists the shaft by
    /// `f / J2 / ((k + j w c) (1 / J1 + 1 / J2) - w^2)`. In step with that, as held samples are not.
    #[test]
    fn a_vibrating_torque_twists_the_shaft_in_step() {
        const PERIOD: usize = 25;
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/gearbox/machine.toml");
        let drivetrain = Machine::load(&path).unwrap().drivetrain.unwrap();
        let torsion = Torsion::new(&drivetrain);
        let dt_s = 0.008;
        let inertias = &drivetrain.inertias;
        let moment: Vec<f64> = inertias.iter().map(Inertia::referred_moment).collect();
        let signals = Signals {
            smoothing: PERIOD,
            response: Some(Response {
                driven: DrivenChain {
                    drivetrain: drivetrain.clone(),
                    outside: Vec::new(),
                    speed: Vec::new(),
                    dt_s,
                    play: Vec::new(),
                    encoders: Vec::new(),
                },
                carried: ShaftResponse::default(),
                transition: torsion.discretised(dt_s),
                first_drive: torsion.states() + drivetrain.loads.len(),
                shafts: shaft_rows(&torsion, &drivetrain),
                stiffness: torsion.referred_stiffness().collect(),
                bodies: inertias
                    .iter()
                    .map(|i| (i.referred_moment(), i.speed_ratio))
                    .collect(),
                side: vec![vec![0.0; 2]],
            }),
            ..Signals::default()
        };
        let phase = |i: usize| TAU * i as f64 / PERIOD as f64;
        let brake: Vec<f64> = (0..80 * PERIOD).map(|i| phase(i).cos()).collect();
        let torque = &signals.unmodelled_torque(1, &brake).unwrap()[0];
        let settled = 70 * PERIOD..75 * PERIOD;
        let along = |wave: fn(f64) -> f64| -> f64 {
            let of = |i: usize| torque[i] * wave(phase(i));
            2.0 / (5 * PERIOD) as f64 * settled.clone().map(of).sum::<f64>()
        };
        let (real, imaginary) = (along(f64::cos), -along(f64::sin));

        let w = TAU / (PERIOD as f64 * dt_s);
        let (k, c) = (torsion.referred_stiffness().next().unwrap(), {
            let shaft = &drivetrain.shafts[0];
            shaft.damping_nm_s_per_rad * shaft.speed_ratio.powi(2)
        });
        let lighter = 1.0 / moment[0] + 1.0 / moment[1];
        let elastic = (k, w * c);
        let below = (k * lighter - w * w, w * c * lighter);
        let square = below.0 * below.0 + below.1 * below.1;
        let expected = (
            (elastic.0 * below.0 + elastic.1 * below.1) / square / moment[1],
            (elastic.1 * below.0 - elastic.0 * below.1) / square / moment[1],
        );
        let turned = imaginary.atan2(real) - expected.1.atan2(expected.0);
        assert!(turned.abs() < 0.01, "{turned} rad");
        let larger = real.hypot(imaginary) / expected.0.hypot(expected.1);
        assert!((larger - 1.0).abs() < 0.02, "{larger}");
    }
}
