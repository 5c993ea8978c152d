//! Defines the interface of the effects that the balance of a drive may lack (`Effect`) and their
//! list, one file each. Also computes the scales of recordings from which trial shapes are chosen,
//! and the states of friction (Dahl's model).
//!
//! A new effect is one file and one line in [`EFFECTS`].

mod backlash;
mod coulomb;
mod delay;
mod directional;
mod gravity;
mod held_at_rest;
mod load_friction;
mod load_nonlinearity;
mod nonlinear_drag;
mod position_friction;
mod position_ripple;
mod position_torque;
mod presliding;
mod shape_parameter;
mod stribeck;
mod temperature_dependence;
mod torque_ripple;
mod warm_up;

pub use shape_parameter::{ShapeParameter, ShapeUnit};

use crate::smoothed_motion::Motion;
use loadtwin_machine::Regime;

/// A physical effect: `sum_k coefficient_k column_k(motion; shape)` [the drive's unit].
pub trait Effect: Sync {
    /// What descriptions and reports call it.
    fn name(&self) -> &'static str;

    /// Shapes on trial for recordings of such a size; none where they cannot show the effect.
    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>>;

    /// What each number of a shape is.
    fn shape_parameters(&self) -> &'static [ShapeParameter];

    /// Which parts of a shape are positive numbers to be refined from the best on trial.
    fn refined(&self) -> &'static [usize] {
        &[]
    }

    /// The columns, one value a sample.
    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>>;

    /// What each coefficient is, with its unit in terms of the drive's.
    fn terms(&self, shape: &[f64], loads: usize) -> Vec<String>;

    /// The experiment that shows it apart from others.
    fn shown_by(&self) -> &'static str;

    /// How often it may be found, each time with another shape.
    fn repeats(&self) -> usize {
        1
    }
}

/// Every effect of the library.
pub static EFFECTS: &[&dyn Effect] = &[
    &coulomb::Coulomb,
    &stribeck::Stribeck,
    &presliding::Presliding,
    &directional::DirectionalFriction,
    &nonlinear_drag::NonlinearDrag,
    &load_friction::LoadFriction,
    &load_nonlinearity::LoadNonlinearity,
    &gravity::Gravity,
    &held_at_rest::HeldAtRest,
    &position_torque::PositionTorque,
    &position_friction::PositionFriction,
    &torque_ripple::TorqueRipple,
    &position_ripple::PositionRipple,
    &backlash::Backlash,
    &delay::Delay,
    &temperature_dependence::TemperatureDependence,
    &warm_up::WarmUp,
];

/// Size of what the recordings show: where to look for an effect's shape.
pub struct Scale {
    /// What a row is.
    pub regime: Regime,
    /// Least and greatest position (rad or m).
    pub span: (f64, f64),
    /// Speed that one sample in twenty exceeds (rad/s or m/s).
    pub speed: f64,
    /// Whether acceleration varies.
    pub accelerates: bool,
    /// Number of measured loads.
    pub loads: usize,
    /// Mean temperature, where it is measured and varies (K).
    pub temperature: Option<f64>,
    /// Travel of one turn (rad or m).
    pub turn: Option<f64>,
    /// Whether the position is a recorded angle.
    pub is_angle: bool,
    /// Resolution in time of decimated values (s).
    pub resolution_s: f64,
    /// Decimated values in all recordings.
    pub rows: usize,
    /// Greatest duration of a recording (s).
    pub duration_s: f64,
}

impl Scale {
    /// Sizes of `motions`, decimated below `cutoff_hz`.
    pub fn new(motions: &[Motion], cutoff_hz: f64) -> Self {
        let all = |f: fn(&Motion) -> &Vec<f64>| {
            motions
                .iter()
                .flat_map(f)
                .copied()
                .filter(|x| x.is_finite())
        };
        let mut speeds: Vec<f64> = all(|m| &m.speed).map(f64::abs).collect();
        speeds.sort_by(f64::total_cmp);
        let temperatures: Vec<f64> = motions
            .iter()
            .flat_map(|m| m.temperature.iter().flatten().copied())
            .filter(|x| x.is_finite())
            .collect();
        let mean = temperatures.iter().sum::<f64>() / temperatures.len().max(1) as f64;
        Self {
            regime: motions.first().map_or(Regime::Moving, |m| m.regime),
            span: all(|m| &m.position).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| {
                (a.min(x), b.max(x))
            }),
            speed: speeds.get(speeds.len() * 19 / 20).copied().unwrap_or(0.0),
            accelerates: all(|m| &m.acceleration).any(|a| a != 0.0),
            loads: motions.first().map_or(0, |m| m.loads.len()),
            temperature: temperatures
                .iter()
                .any(|t| (t - mean).abs() > 0.5)
                .then_some(mean),
            turn: motions.first().and_then(|m| m.turn),
            is_angle: motions.first().is_some_and(|m| m.is_angle),
            resolution_s: 0.5 / cutoff_hz,
            rows: motions.iter().map(|m| m.decimated_times().len()).sum(),
            duration_s: motions
                .iter()
                .filter_map(|m| Some(m.t.last()? - m.t.first()?))
                .fold(0.0, f64::max),
        }
    }

    /// Whether anything slides.
    fn slides(&self) -> bool {
        self.regime != Regime::Holding && self.speed > 0.0
    }

    /// The travel that distances are compared with: one turn at most.
    fn travel(&self) -> f64 {
        let travel = self.span.1 - self.span.0;
        self.turn.map_or(travel, |turn| turn.min(travel))
    }

    /// Distances over which friction may build up: none at steady speed.
    fn distances(&self, parts: &[f64]) -> Vec<f64> {
        if !self.slides() {
            Vec::new()
        } else if self.regime == Regime::Steady {
            vec![0.0]
        } else {
            parts.iter().map(|part| part * self.travel()).collect()
        }
    }

    /// A short distance: friction that is all there at once.
    fn sliding(&self) -> Vec<f64> {
        self.distances(&[1e-4])
    }

    /// Speeds below which friction may vanish; none at steady speed, where nothing rests.
    fn creeping(&self, parts: &[f64]) -> Vec<f64> {
        if self.slides() && self.regime != Regime::Steady {
            parts.iter().map(|part| part * self.speed).collect()
        } else {
            Vec::new()
        }
    }

    /// Centre and half width of the positions.
    fn window(&self) -> Option<[f64; 2]> {
        let half = 0.5 * (self.span.1 - self.span.0);
        (half > 0.0).then_some([0.5 * (self.span.1 + self.span.0), half])
    }
}

/// Numbers from `least` to `most` in `count` equal ratios.
fn geometric(least: f64, most: f64, count: usize) -> Vec<f64> {
    let ratio = most / least;
    (0..count)
        .map(|i| least * ratio.powf(i as f64 / (count - 1) as f64))
        .collect()
}

/// Standard deviations of the position that noise spans: three to either side.
const REVERSAL: f64 = 6.0;

/// `z` in [-1, 1]: friction's state over a distance `s` of sliding.
///
/// `dz = (sgn(dx) - z) |dx| / s`, Dahl's model of exponent 1, integrated exactly
/// over each step; `s = 0` is the sign of the motion, which it keeps at standstill. As in the estimator
/// the position has turned back once it is further from its turning point than its estimate is
/// uncertain: noise is no motion, and would let `z` fade.
///
/// Source: Dahl 1968, A solid friction model.
fn sliding_state(motion: &Motion, s: f64) -> Vec<f64> {
    if motion.regime == Regime::Steady {
        return each(&motion.speed, sign);
    }
    let uncertain = REVERSAL * motion.position_std;
    let (mut z, mut heading) = (0.0, 0.0);
    let mut before = motion.position.first().copied().unwrap_or(0.0);
    motion
        .position
        .iter()
        .map(|&x| {
            let dx = x - before;
            if dx * heading > 0.0 || dx.abs() > uncertain {
                heading = dx.signum();
                z = heading - (heading - z) * (-dx.abs() / s).exp();
                before = x;
            } else if before.is_nan() {
                before = x;
            }
            z
        })
        .collect()
}

/// The state of friction: that of sliding, or for `v_r > 0` one that vanishes at
/// rest, `v / sqrt(v^2 + v_r^2)`.
///
/// A drive that is switched off, braked, or whose integrator is reset once it
/// stands shows no friction there, though the parts in contact keep it.
fn friction_state(motion: &Motion, s: f64, v_r: f64) -> Vec<f64> {
    if v_r > 0.0 {
        each(&motion.speed, |v| v / v.hypot(v_r))
    } else {
        sliding_state(motion, s)
    }
}

/// The sign of a number, 0 of 0.
fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

/// The elementwise product.
fn times(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

/// A function of each value.
fn each(a: &[f64], f: impl Fn(f64) -> f64) -> Vec<f64> {
    a.iter().map(|a| f(*a)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_has_its_own_name() {
        let mut names: Vec<_> = EFFECTS.iter().map(|e| e.name()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), EFFECTS.len());
    }

    /// Noise at standstill leaves the state of friction; a way back is counted from its turning point.
    #[test]
    fn noise_is_no_reversal_and_a_reversal_loses_nothing() {
        let mut motion = Motion::at_rest(Regime::Moving);
        motion.position_std = 0.01;
        motion.position = vec![0.0, 1.0, 0.97, 1.0, 0.96, 0.95, 0.5];
        let z = sliding_state(&motion, 0.5);
        let slid = 1.0 - (-2.0_f64).exp();
        for held in &z[1..=5] {
            assert!((held - slid).abs() < 1e-12, "{z:?}");
        }
        let back = -1.0 + (1.0 + slid) * (-1.0_f64).exp();
        assert!((z[6] - back).abs() < 1e-12, "{z:?}");
    }
}
