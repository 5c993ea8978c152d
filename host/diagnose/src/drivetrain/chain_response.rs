//! Defines a torsional chain with what a recording says of it (`DrivenChain`: outside torques,
//! speed, encoders), its variants with backlash or a further gear, and the torque and twist of its
//! shafts (`ShaftResponse`, by `chain_simulation.rs`). Computes how these change with uncertain
//! stiffness, damping and inertia, and by vibrations at the start.

use crate::drivetrain::chain_simulation::BacklashSimulation;
use crate::drivetrain::inserted_gear::with_gear;
use loadtwin_design::gearbox::Torsion;
use loadtwin_machine::{Drivetrain, Inertia, Senses, Shaft};

/// Relative tolerance of inertias and stiffnesses, the standard deviation of nuisances and the
/// limit in null samples: how long a vibration stays in step with the simulated one.
const TOLERANCE: f64 = 0.002;

/// Relative tolerance of damping, which is never known better.
const DAMPING_TOLERANCE: f64 = 0.1;

/// Relative standard deviation of a parameter of the described chain: that stated, else its tolerance.
fn relative_std(stated: Option<f64>, value: f64, tolerance: f64) -> f64 {
    let stated = stated.filter(|_| value > 0.0);
    stated.map_or(tolerance, |std| std / value)
}

/// The same of the moment of `inertia`.
pub(crate) fn moment_std(inertia: &Inertia) -> f64 {
    relative_std(inertia.moment_std_kg_m2, inertia.moment_kg_m2, TOLERANCE)
}

/// The same of the stiffness of `shaft`.
pub(crate) fn stiffness_std(shaft: &Shaft) -> f64 {
    let stated = shaft.stiffness_std_nm_per_rad;
    relative_std(stated, shaft.stiffness_nm_per_rad, TOLERANCE)
}

/// The same of the damping of `shaft`.
pub(crate) fn damping_std(shaft: &Shaft) -> f64 {
    let stated = shaft.damping_std_nm_s_per_rad;
    relative_std(stated, shaft.damping_nm_s_per_rad, DAMPING_TOLERANCE)
}

/// Torque of the vibrations that a recording may begin with, part of nominal: as much as where a load is
/// put on at once.
const BEGINNING: f64 = 0.5;

/// Part of the largest torque above which flanks touch for sure.
const TOUCHING: f64 = 0.2;

/// A chain, what acts on it from outside, and its rigid motion.
#[derive(Clone, Debug)]
pub struct DrivenChain {
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
    /// Twists measured by further encoders.
    pub encoders: Vec<Encoders>,
}

/// The angle of an encoder against the first one, referred.
#[derive(Clone, Debug)]
pub struct Encoders {
    /// Signs with which the twists of the shafts enter.
    pub signs: Vec<f64>,
    /// Sample by sample [rad].
    pub angle: Vec<f64>,
    /// Standard deviation of a sample while it turns [rad].
    pub noise_std: f64,
    /// The larger one of the two encoders' counts [rad].
    pub count: f64,
    /// Reading without twist [rad].
    pub zero: f64,
}

/// What each shaft does, sample by sample, referred.
#[derive(Clone, Debug, Default)]
pub struct ShaftResponse {
    /// Torque [N m].
    pub torque: Vec<Vec<f64>>,
    /// Twist, lost motion included [rad].
    pub twist: Vec<Vec<f64>>,
}

impl DrivenChain {
    /// What the shafts do, the rigid motion being the measured one:
    ///
    /// `x+ = F x + G (u + lost)`, `tau = C x - lost`,
    ///
    /// with `lost` what a shaft with play carries less than one without. Flanks that are apart carry
    /// nothing, flanks that touch push and never pull; while they part or meet the step is divided.
    /// Their position and speed within the play are measured by encoders on both sides; they do not
    /// follow from the loads.
    pub fn carried(&self) -> ShaftResponse {
        let torsion = Torsion::new(&self.drivetrain);
        let motion = BacklashSimulation::new(self, &torsion);
        motion.from(motion.start())
    }

    /// Vibrations that a recording may begin with, two phases for each shaft, by what is expected of
    /// them; and each as it grows with time, which is by how much it falls out of step with the
    /// simulated one.
    pub(crate) fn initial_vibrations(&self) -> Vec<ShaftResponse> {
        let mut still = self.clone();
        still.outside = vec![vec![0.0; self.speed.len()]; self.outside.len()];
        still.speed = vec![0.0; self.speed.len()];
        let torsion = Torsion::new(&self.drivetrain);
        let motion = BacklashSimulation::new(&still, &torsion);
        let torque = BEGINNING * self.drivetrain.nominal_torque();
        let from = |s: usize| {
            let [before, behind] = motion.sides(s);
            let lighter = 1.0 / before + 1.0 / behind;
            let twist = torque / motion.stiffness[s];
            let mut twisted = vec![0.0; motion.states];
            twisted[1 + s] = twist;
            let mut turning = vec![0.0; motion.states];
            motion.add_relative_speed(
                &mut turning,
                s,
                twist * (motion.stiffness[s] * lighter).sqrt(),
            );
            let std = stiffness_std(&self.drivetrain.shafts[s]);
            let out_of_step = std * (motion.stiffness[s] * lighter).sqrt();
            [twisted, turning].map(|start| {
                let vibration = motion.from(start);
                let times_elapsed = vibration.times_elapsed(out_of_step * self.dt_s);
                [vibration, times_elapsed]
            })
        };
        (0..motion.rows.len()).flat_map(from).flatten().collect()
    }

    /// The same chain with `play` [rad] in shaft `s`; `plain`: its response without.
    pub fn with_play(&self, s: usize, play: f64, plain: &ShaftResponse) -> Self {
        let mut driven = self.clone();
        driven.play = vec![0.0; plain.torque.len()];
        driven.play[s] = play;
        let most = plain.torque[s].iter().fold(0.0_f64, |m, t| m.max(t.abs()));
        for encoders in &mut driven.encoders {
            // Where the flanks are sure to touch.
            let mut zeros: Vec<f64> = (0..self.speed.len())
                .filter(|i| plain.torque[s][*i].abs() > TOUCHING * most)
                .map(|i| {
                    let side = 0.5 * play * plain.torque[s][i].signum();
                    let twists = encoders.signs.iter().zip(&plain.twist);
                    let elastic: f64 = twists.map(|(sign, twist)| sign * twist[i]).sum();
                    encoders.angle[i] - elastic - encoders.signs[s] * side
                })
                .filter(|zero| zero.is_finite())
                .collect();
            let middle = zeros.len() / 2;
            if middle > 0 {
                encoders.zero = *zeros.select_nth_unstable_by(middle, f64::total_cmp).1;
            }
        }
        driven
    }

    /// The same with [`inserted_gear`](crate::drivetrain::inserted_gear).
    pub fn with_gear(&self, s: usize, part: f64) -> Self {
        let mut driven = self.clone();
        driven.drivetrain = with_gear(&self.drivetrain, s, part);
        driven.outside.insert(s + 1, vec![0.0; driven.speed.len()]);
        for encoders in &mut driven.encoders {
            encoders.signs.insert(s + 1, encoders.signs[s]);
        }
        driven
    }

    /// How the torque and the twist of each shaft change with the stiffness and
    /// with the damping of each, by what these are known to.
    pub(crate) fn stiffness_sensitivities(
        &self,
        as_described: &ShaftResponse,
    ) -> Vec<ShaftResponse> {
        let mut changes = Vec::new();
        for s in 0..self.drivetrain.shafts.len() {
            let mut stiffer = self.clone();
            let shaft = &mut stiffer.drivetrain.shafts[s];
            shaft.stiffness_nm_per_rad *= 1.0 + stiffness_std(shaft);
            let mut damped = self.clone();
            let shaft = &mut damped.drivetrain.shafts[s];
            shaft.damping_nm_s_per_rad *= 1.0 + damping_std(shaft);
            changes.extend([stiffer, damped].map(|d| d.carried().difference(as_described)));
        }
        changes
    }

    /// The same with the moment of each inertia.
    pub(crate) fn inertia_sensitivities(&self, as_described: &ShaftResponse) -> Vec<ShaftResponse> {
        let bodies = 0..self.drivetrain.inertias.len();
        let inertia_sensitivities = |body: usize| {
            let mut inertia_sensitivities = self.clone();
            let inertia = &mut inertia_sensitivities.drivetrain.inertias[body];
            inertia.moment_kg_m2 *= 1.0 + moment_std(inertia);
            inertia_sensitivities.carried().difference(as_described)
        };
        bodies.map(inertia_sensitivities).collect()
    }
}

impl ShaftResponse {
    /// The two halves of shaft `s` before and behind a gear as one shaft, whose torque is that behind.
    pub(crate) fn behind_the_gear(mut self, s: usize) -> Self {
        self.torque.remove(s);
        let before = self.twist.remove(s);
        for (twist, before) in self.twist[s].iter_mut().zip(before) {
            *twist += before;
        }
        self
    }

    /// The same times `part` for each sample since the start.
    fn times_elapsed(&self, part: f64) -> Self {
        let times = |of: &[Vec<f64>]| {
            let grown = |x: &Vec<f64>| (0..).zip(x).map(|(i, x)| f64::from(i) * part * x).collect();
            of.iter().map(grown).collect()
        };
        Self {
            torque: times(&self.torque),
            twist: times(&self.twist),
        }
    }

    /// The difference of the two.
    pub fn difference(&self, other: &Self) -> Self {
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
pub(crate) fn shaft_rows(torsion: &Torsion, drivetrain: &Drivetrain) -> Vec<Vec<f64>> {
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
    use loadtwin_machine::Machine;
    use std::path::Path;

    /// The example's chain under a torque that swings through zero.
    fn swinging() -> DrivenChain {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/gearbox/machine.toml");
        let drivetrain = Machine::load(&path).unwrap().drivetrain.unwrap();
        let torque: Vec<f64> = (0..2000)
            .map(|i| 1e5 * (f64::from(i) * 0.008 * 0.3).cos())
            .collect();
        let braking = torque.iter().map(|t| -t).collect();
        DrivenChain {
            drivetrain,
            outside: vec![torque, braking],
            speed: vec![0.0; 2000],
            dt_s: 0.008,
            play: Vec::new(),
            encoders: Vec::new(),
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

    /// By hand: both halves twisted, each by half, are the shaft twisted.
    #[test]
    fn before_and_behind_a_gear_of_next_to_no_inertia_it_vibrates_as_one_shaft() {
        let plain = swinging();
        let with = plain.with_gear(0, 1e-6).initial_vibrations();
        let halves = [&with[0], &with[4]].map(|half| half.clone().behind_the_gear(0));
        let whole = &plain.initial_vibrations()[0].twist[0];
        let most = whole.iter().fold(0.0_f64, |m, t| m.max(t.abs()));
        for (i, twist) in whole.iter().enumerate() {
            let sum = halves[0].twist[0][i] + halves[1].twist[0][i];
            assert!((sum - twist).abs() < 1e-3 * most, "{i}: {sum} {twist}");
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

    /// By hand: flanks that are apart carry nothing, and teeth push only.
    #[test]
    fn teeth_never_pull() {
        let mut driven = swinging();
        driven.play = vec![0.002];
        let carried = driven.carried();
        let twists = carried.torque[0].iter().zip(&carried.twist[0]);
        let apart = twists.clone().filter(|(_, twist)| twist.abs() < 0.001);
        assert!(apart.clone().count() > 10 && apart.clone().all(|(torque, _)| *torque == 0.0));
        assert!(twists.clone().all(|(torque, twist)| torque * twist >= 0.0));
    }

    /// By hand: it begins at the torque expected of it, and dies away.
    #[test]
    fn a_vibration_at_the_start_dies_away() {
        let driven = swinging();
        let initial_vibrations = driven.initial_vibrations();
        let expected = BEGINNING * driven.drivetrain.nominal_torque();
        let most = |torque: &[f64]| torque.iter().fold(0.0_f64, |m, t| m.max(t.abs()));
        assert_eq!(initial_vibrations.len(), 4);
        for of_start in initial_vibrations.chunks(2) {
            let torque = &of_start[0].torque[0];
            assert!((most(&torque[..100]) / expected - 1.0).abs() < 0.1);
            assert!(most(&torque[1900..]) < 0.2 * expected);
            // Out of step by what stiffness is known to: 3.2 Hz for 0.8 s.
            let times_elapsed = &of_start[1].torque[0];
            let out_of_step = TOLERANCE * std::f64::consts::TAU * 3.2 * 0.8;
            assert!((times_elapsed[100] / torque[100] / out_of_step - 1.0).abs() < 0.02);
        }
    }
}
