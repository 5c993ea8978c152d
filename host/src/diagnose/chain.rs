//! The torsional chain under the torques that a recording tells.

use faer::Mat;

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
    /// What further encoders tell of the twists.
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
    /// What it reads without twist [rad].
    pub zero: f64,
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
    /// `x+ = F x + G (u + lost)`, `tau = C x - lost`,
    ///
    /// with `lost` what a shaft with play carries less than one without. Flanks that are apart carry
    /// nothing, flanks that touch push and never pull; while they part or meet the step is divided.
    /// Where in the play they are, and how fast, encoders on both sides tell, as the loads do not.
    pub fn carried(&self) -> Carried {
        let torsion = Torsion::new(&self.drivetrain);
        let motion = Motion::new(self, &torsion);
        motion.from(motion.start())
    }

    /// Vibrations that a recording may begin with, two phases for each shaft, by what is expected of
    /// them.
    pub(super) fn beginnings(&self) -> Vec<Carried> {
        let mut still = self.clone();
        still.outside = vec![vec![0.0; self.speed.len()]; self.outside.len()];
        still.speed = vec![0.0; self.speed.len()];
        let torsion = Torsion::new(&self.drivetrain);
        let motion = Motion::new(&still, &torsion);
        let torque = BEGINNING * self.drivetrain.nominal_torque();
        let from = |s: usize| {
            let [before, behind] = motion.sides(s);
            let lighter = 1.0 / before + 1.0 / behind;
            let twist = torque / motion.stiffness[s];
            let mut twisted = vec![0.0; motion.states];
            twisted[1 + s] = twist;
            let mut turning = vec![0.0; motion.states];
            motion.turn(
                &mut turning,
                s,
                twist * (motion.stiffness[s] * lighter).sqrt(),
            );
            [twisted, turning]
        };
        let starts = (0..motion.rows.len()).flat_map(from);
        starts.map(|x| motion.from(x)).collect()
    }

    /// The same chain with `play` [rad] in shaft `s`; `plain`: what it carries without.
    pub fn with_play(&self, s: usize, play: f64, plain: &Carried) -> Self {
        let mut driven = self.clone();
        driven.play = vec![0.0; plain.torque.len()];
        driven.play[s] = play;
        let most = plain.torque[s].iter().fold(0.0_f64, |m, t| m.max(t.abs()));
        for seen in &mut driven.encoders {
            // Where the flanks are sure to touch.
            let mut zeros: Vec<f64> = (0..self.speed.len())
                .filter(|i| plain.torque[s][*i].abs() > TOUCHING * most)
                .map(|i| {
                    let side = 0.5 * play * plain.torque[s][i].signum();
                    let twists = seen.signs.iter().zip(&plain.twist);
                    let elastic: f64 = twists.map(|(sign, twist)| sign * twist[i]).sum();
                    seen.angle[i] - elastic - seen.signs[s] * side
                })
                .filter(|zero| zero.is_finite())
                .collect();
            let middle = zeros.len() / 2;
            if middle > 0 {
                seen.zero = *zeros.select_nth_unstable_by(middle, f64::total_cmp).1;
            }
        }
        driven
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
        for seen in &mut driven.encoders {
            seen.signs.insert(s + 1, seen.signs[s]);
        }
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

/// Torque of the vibrations that a recording may begin with, part of nominal.
const BEGINNING: f64 = 0.05;

/// Parts into which a step is divided while flanks part or meet.
const PARTS: usize = 8;

/// Part of the largest torque above which flanks touch for sure.
const TOUCHING: f64 = 0.2;

/// Torque that loads and drag do not tell, part of the first load's nominal: what moves flanks that
/// are apart otherwise than predicted.
const UNTOLD: f64 = 0.003;

/// The equations of a driven chain.
struct Motion<'a> {
    driven: &'a Driven,
    /// Torque of each shaft without play as a row over the states.
    rows: Vec<Vec<f64>>,
    stiffness: Vec<f64>,
    ratios: Vec<f64>,
    moments: Vec<f64>,
    /// Discretised over a sample and over a part of it.
    whole: Mat<f64>,
    part: Mat<f64>,
    states: usize,
    /// Column of the first torque from outside.
    first: usize,
}

impl<'a> Motion<'a> {
    fn new(driven: &'a Driven, torsion: &Torsion) -> Self {
        let inertias = &driven.drivetrain.inertias;
        let referred = |i: &Inertia| i.moment_kg_m2 * i.speed_ratio * i.speed_ratio;
        Self {
            driven,
            rows: shaft_rows(torsion, &driven.drivetrain),
            stiffness: torsion.referred_stiffness().collect(),
            ratios: inertias.iter().map(|i| i.speed_ratio).collect(),
            moments: inertias.iter().map(referred).collect(),
            whole: torsion.discretised(driven.dt_s),
            part: torsion.discretised(driven.dt_s / PARTS as f64),
            states: torsion.states(),
            first: torsion.states() + driven.drivetrain.loads.len(),
        }
    }

    fn half(&self, s: usize) -> f64 {
        0.5 * self.driven.play.get(s).copied().unwrap_or(0.0)
    }

    /// Turning steadily as the first sample does; encoders tell which flanks touch.
    fn start(&self) -> Vec<f64> {
        let driven = self.driven;
        let total: f64 = self.moments.iter().sum();
        let net: f64 = driven.outside.iter().map(|o| o[0]).sum();
        let mut x = vec![0.0; self.states];
        x[self.states - self.moments.len()..].fill(driven.speed[0]);
        let mut carried = 0.0;
        for (s, k) in self.stiffness.iter().enumerate() {
            carried += driven.outside[s][0] - self.moments[s] / total * net;
            x[1 + s] = carried / k + self.half(s) * carried.signum();
        }
        for (seen, s, gap) in self.gaps(&x, 0) {
            if gap.abs() > seen.count {
                let told = x[1 + s] + gap;
                let flank = self.half(s).copysign(told);
                x[1 + s] = if (told - flank).abs() < seen.count {
                    flank
                } else {
                    told
                };
            }
        }
        x
    }

    /// Encoders on both sides of a shaft with play, the shaft, and by how much its twist in sample
    /// `i` is larger than that of `x`.
    fn gaps(&self, x: &[f64], i: usize) -> Vec<(&Encoders, usize, f64)> {
        let told = |seen: &'a Encoders| {
            let with_play = |s: &usize| seen.signs[*s] != 0.0 && self.half(*s) > 0.0;
            let s = (0..self.rows.len()).find(with_play)?;
            let twists = seen.signs.iter().zip(&x[1..]);
            let twisted: f64 = twists.map(|(sign, twist)| sign * twist).sum();
            let gap = (seen.angle.get(i)? - seen.zero - twisted) / seen.signs[s];
            gap.is_finite().then_some((seen, s, gap))
        };
        self.driven.encoders.iter().filter_map(told).collect()
    }

    /// Takes what encoders tell of flanks that are apart at sample `i`, by the steady gains of a
    /// filter of place and speed under an unknown torque.
    ///
    /// Source: Kalata 1984, "The tracking index: a generalized parameter for alpha-beta and
    /// alpha-beta-gamma target trackers".
    fn correct(&self, x: &mut [f64], i: usize) {
        let driven = self.driven;
        let untold = UNTOLD * driven.drivetrain.nominal_torque();
        for (seen, s, gap) in self.gaps(x, i) {
            if x[1 + s].abs() >= self.half(s) {
                continue;
            }
            // A count that stays tells no more with every sample.
            let step = driven.speed[i].abs() * driven.dt_s;
            let noise_std = seen.noise_std * (1.0 + seen.count / (step + 1e-9)).sqrt();
            let [before, behind] = self.sides(s);
            let index = untold * (1.0 / before + 1.0 / behind) * driven.dt_s.powi(2) / noise_std;
            let r = (4.0 + index - (8.0 * index + index * index).sqrt()) / 4.0;
            let (of_place, of_speed) = (1.0 - r * r, 2.0 * (1.0 - r).powi(2));
            x[1 + s] += of_place * gap;
            self.turn(x, s, of_speed * gap / driven.dt_s);
        }
    }

    /// What the shafts do from `x` on.
    fn from(&self, mut x: Vec<f64>) -> Carried {
        let (shafts, n) = (self.rows.len(), self.driven.speed.len());
        let empty = || vec![Vec::with_capacity(n); shafts];
        let mut out = Carried {
            torque: empty(),
            twist: empty(),
        };
        for i in 0..n {
            for s in 0..shafts {
                out.torque[s].push(self.torque(s, &x));
                out.twist[s].push(x[1 + s]);
            }
            x = self.after(&x, i);
            self.correct(&mut x, i + 1);
        }
        out
    }

    /// Moments before and behind shaft `s`.
    fn sides(&self, s: usize) -> [f64; 2] {
        let (before, behind) = self.moments.split_at(s + 1);
        [before, behind].map(|side| side.iter().sum())
    }

    /// Lets the two sides of shaft `s` turn against each other, faster by `speed`, about the rigid motion.
    fn turn(&self, x: &mut [f64], s: usize, speed: f64) {
        let [before, behind] = self.sides(s);
        let speeds = self.states - self.moments.len();
        for (b, w) in x[speeds..].iter_mut().enumerate() {
            *w += if b <= s {
                speed * behind / (before + behind)
            } else {
                -speed * before / (before + behind)
            };
        }
    }

    /// What shaft `s` would carry without play.
    fn elastic(&self, s: usize, x: &[f64]) -> f64 {
        self.rows[s].iter().zip(x).map(|(c, x)| c * x).sum()
    }

    /// What shaft `s` carries.
    fn torque(&self, s: usize, x: &[f64]) -> f64 {
        let (elastic, half) = (self.elastic(s, x), self.half(s));
        let pushed = elastic - self.stiffness[s] * x[1 + s].clamp(-half, half);
        if half == 0.0 {
            elastic
        } else if x[1 + s] > half {
            pushed.max(0.0)
        } else if x[1 + s] < -half {
            pushed.min(0.0)
        } else {
            0.0
        }
    }

    fn lost(&self, x: &[f64]) -> Vec<f64> {
        (0..self.rows.len())
            .map(|s| self.elastic(s, x) - self.torque(s, x))
            .collect()
    }

    /// The states a sample after `x` of sample `i`.
    fn after(&self, x: &[f64], i: usize) -> Vec<f64> {
        let next = self.advanced(&self.whole, x, i, [0.0, 1.0], &self.lost(x));
        let touching = |s: usize, x: &[f64]| {
            let side = |x: &[f64]| self.torque(s, x).total_cmp(&0.0);
            side(x).is_ne() && side(x) == side(&next)
        };
        if (0..self.rows.len()).all(|s| self.half(s) == 0.0 || touching(s, x)) {
            return next;
        }
        let mut x = x.to_vec();
        for part in 0..PARTS {
            let span = [part, part + 1].map(|p| p as f64 / PARTS as f64);
            let lost = self.lost(&x);
            let guess = self.advanced(&self.part, &x, i, span, &lost);
            let then = self.lost(&guess);
            let mean: Vec<f64> = lost.iter().zip(then).map(|(a, b)| 0.5 * (a + b)).collect();
            x = self.advanced(&self.part, &x, i, span, &mean);
        }
        x
    }

    /// `x` on from one to the other part of the way from sample `i` to the next.
    fn advanced(
        &self,
        f: &Mat<f64>,
        x: &[f64],
        i: usize,
        [from, to]: [f64; 2],
        lost: &[f64],
    ) -> Vec<f64> {
        let driven = self.driven;
        let end = (i + 1).min(driven.speed.len() - 1);
        let at = |values: &[f64], part: f64| values[i] + part * (values[end] - values[i]);
        let middle = 0.5 * (from + to);
        let bodies = self.moments.len();
        let u: Vec<f64> = (0..bodies)
            .map(|b| {
                let before = b.checked_sub(1).map_or(0.0, |s| lost[s]);
                let behind = lost.get(b).copied().unwrap_or(0.0);
                (at(&driven.outside[b], middle) + behind - before) / self.ratios[b]
            })
            .collect();
        let mut next: Vec<f64> = (0..self.states)
            .map(|r| {
                let own: f64 = x.iter().enumerate().map(|(c, x)| f[(r, c)] * x).sum();
                let driven: f64 = (0..bodies).map(|b| f[(r, self.first + b)] * u[b]).sum();
                own + driven
            })
            .collect();
        let speeds = self.states - bodies;
        let total: f64 = self.moments.iter().sum();
        let rigid: f64 = (0..bodies)
            .map(|b| self.moments[b] / total * next[speeds + b])
            .sum();
        let shift = at(&driven.speed, to) - rigid;
        next[speeds..].iter_mut().for_each(|w| *w += shift);
        next[0] = 0.0;
        next
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
