//! Simulates the torque and twist of each shaft of a torsional chain, with or without backlash,
//! under known torques and the measured rigid motion. Encoders on both sides of a shaft correct its
//! twist within the backlash (alpha-beta filter).

use faer::Mat;

use crate::drivetrain::chain_response::{DrivenChain, Encoders, ShaftResponse, shaft_rows};
use loadtwin_design::gearbox::Torsion;
use loadtwin_machine::Inertia;

/// Parts into which a step is divided while flanks part or meet.
const PARTS: usize = 8;

/// Torque that loads and drag do not include, part of the first load's nominal: it moves flanks
/// that are apart otherwise than predicted.
const UNMODELLED_TORQUE: f64 = 0.003;

/// The equations of a driven chain.
pub(crate) struct BacklashSimulation<'a> {
    driven: &'a DrivenChain,
    /// Torque of each shaft without play as a row over the states.
    pub rows: Vec<Vec<f64>>,
    pub stiffness: Vec<f64>,
    ratios: Vec<f64>,
    moments: Vec<f64>,
    /// Discretised over a sample and over a part of it.
    whole: Mat<f64>,
    part: Mat<f64>,
    pub states: usize,
    /// Column of the first torque from outside.
    first: usize,
}

impl<'a> BacklashSimulation<'a> {
    pub fn new(driven: &'a DrivenChain, torsion: &Torsion) -> Self {
        let inertias = &driven.drivetrain.inertias;
        Self {
            driven,
            rows: shaft_rows(torsion, &driven.drivetrain),
            stiffness: torsion.referred_stiffness().collect(),
            ratios: inertias.iter().map(|i| i.speed_ratio).collect(),
            moments: inertias.iter().map(Inertia::referred_moment).collect(),
            whole: torsion.discretised(driven.dt_s),
            part: torsion.discretised(driven.dt_s / PARTS as f64),
            states: torsion.states(),
            first: torsion.states() + driven.drivetrain.loads.len(),
        }
    }

    fn half(&self, s: usize) -> f64 {
        0.5 * self.driven.play.get(s).copied().unwrap_or(0.0)
    }

    /// Turning steadily as the first sample does; encoders measure which flanks touch.
    pub fn start(&self) -> Vec<f64> {
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
        for (encoders, s, gap) in self.flank_gaps(&x, 0) {
            if gap.abs() > encoders.count {
                let measured = x[1 + s] + gap;
                let flank = self.half(s).copysign(measured);
                x[1 + s] = if (measured - flank).abs() < encoders.count {
                    flank
                } else {
                    measured
                };
            }
        }
        x
    }

    /// Encoders on both sides of a shaft with play, the shaft, and by how much its twist in sample
    /// `i` is larger than that of `x`.
    fn flank_gaps(&self, x: &[f64], i: usize) -> Vec<(&Encoders, usize, f64)> {
        let with_gap = |encoders: &'a Encoders| {
            let with_play = |s: &usize| encoders.signs[*s] != 0.0 && self.half(*s) > 0.0;
            let s = (0..self.rows.len()).find(with_play)?;
            let twists = encoders.signs.iter().zip(&x[1..]);
            let twisted: f64 = twists.map(|(sign, twist)| sign * twist).sum();
            let gap = (encoders.angle.get(i)? - encoders.zero - twisted) / encoders.signs[s];
            gap.is_finite().then_some((encoders, s, gap))
        };
        self.driven.encoders.iter().filter_map(with_gap).collect()
    }

    /// Corrects flanks that are apart at sample `i` by the encoders, with the steady gains of a
    /// filter of position and speed under an unknown torque.
    ///
    /// Source: Kalata 1984, "The tracking index: a generalized parameter for alpha-beta and
    /// alpha-beta-gamma target trackers".
    fn correct(&self, x: &mut [f64], i: usize) {
        let driven = self.driven;
        let unmodelled = UNMODELLED_TORQUE * driven.drivetrain.nominal_torque();
        for (encoders, s, gap) in self.flank_gaps(x, i) {
            if x[1 + s].abs() >= self.half(s) {
                continue;
            }
            // A count that does not change adds no information with further samples.
            let step = driven.speed[i].abs() * driven.dt_s;
            let noise_std = encoders.noise_std * (1.0 + encoders.count / (step + 1e-9)).sqrt();
            let [before, behind] = self.sides(s);
            let index =
                unmodelled * (1.0 / before + 1.0 / behind) * driven.dt_s.powi(2) / noise_std;
            let r = (4.0 + index - (8.0 * index + index * index).sqrt()) / 4.0;
            let (of_place, of_speed) = (1.0 - r * r, 2.0 * (1.0 - r).powi(2));
            x[1 + s] += of_place * gap;
            self.add_relative_speed(x, s, of_speed * gap / driven.dt_s);
        }
    }

    /// What the shafts do from `x` on.
    pub fn from(&self, mut x: Vec<f64>) -> ShaftResponse {
        let (shafts, n) = (self.rows.len(), self.driven.speed.len());
        let empty = || vec![Vec::with_capacity(n); shafts];
        let mut out = ShaftResponse {
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
    pub fn sides(&self, s: usize) -> [f64; 2] {
        let (before, behind) = self.moments.split_at(s + 1);
        [before, behind].map(|side| side.iter().sum())
    }

    /// Lets the two sides of shaft `s` turn against each other, faster by `speed`, about the rigid motion.
    pub fn add_relative_speed(&self, x: &mut [f64], s: usize, speed: f64) {
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
    fn torque_without_backlash(&self, s: usize, x: &[f64]) -> f64 {
        self.rows[s].iter().zip(x).map(|(c, x)| c * x).sum()
    }

    /// What shaft `s` carries.
    fn torque(&self, s: usize, x: &[f64]) -> f64 {
        let (torque_without_backlash, half) = (self.torque_without_backlash(s, x), self.half(s));
        let pushed = torque_without_backlash - self.stiffness[s] * x[1 + s].clamp(-half, half);
        if half == 0.0 {
            torque_without_backlash
        } else if x[1 + s] > half {
            pushed.max(0.0)
        } else if x[1 + s] < -half {
            pushed.min(0.0)
        } else {
            0.0
        }
    }

    fn backlash_torque(&self, x: &[f64]) -> Vec<f64> {
        (0..self.rows.len())
            .map(|s| self.torque_without_backlash(s, x) - self.torque(s, x))
            .collect()
    }

    /// The states a sample after `x` of sample `i`.
    fn after(&self, x: &[f64], i: usize) -> Vec<f64> {
        let next = self.advanced(&self.whole, x, i, [0.0, 1.0], &self.backlash_torque(x));
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
            let backlash_torque = self.backlash_torque(&x);
            let guess = self.advanced(&self.part, &x, i, span, &backlash_torque);
            let then = self.backlash_torque(&guess);
            let mean: Vec<f64> = backlash_torque
                .iter()
                .zip(then)
                .map(|(a, b)| 0.5 * (a + b))
                .collect();
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
        backlash_torque: &[f64],
    ) -> Vec<f64> {
        let driven = self.driven;
        let end = (i + 1).min(driven.speed.len() - 1);
        let at = |values: &[f64], part: f64| values[i] + part * (values[end] - values[i]);
        let middle = 0.5 * (from + to);
        let bodies = self.moments.len();
        let u: Vec<f64> = (0..bodies)
            .map(|b| {
                let before = b.checked_sub(1).map_or(0.0, |s| backlash_torque[s]);
                let behind = backlash_torque.get(b).copied().unwrap_or(0.0);
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
