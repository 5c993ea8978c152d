//! Gives torque and speed of the drivetrain's test bench over time, as parts of nominal: built-in
//! scenarios, or the course of a recorded machine. Also generates random waves with the spectrum of
//! turbulent wind.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use rand::RngExt;

use crate::SimulateError;
use crate::rng::Draw;

/// A scenario: what the first load and the speed do, relative to nominal.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    kind: Kind,
    /// How long it lasts (s), > 0.
    pub duration_s: f64,
}

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    StartStop,
    Constant,
    TorqueRamps,
    Turbulent,
    Reversals,
    Steps,
    Recorded(Arc<Course>),
}

/// What a recorded machine did, sample by sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// Sample period (s).
    pub dt_s: f64,
    /// Carrier angle of the first sample (rad).
    pub angle: f64,
    /// The samples, at least one.
    pub demands: Vec<Demand>,
}

/// Name, kind, duration [s], description.
const TABLE: [(&str, Kind, f64, &str); 6] = [
    (
        "start-stop",
        Kind::StartStop,
        90.0,
        "speed and torque up in 20 s, held for 40 s, down with a negative torque spike",
    ),
    ("constant", Kind::Constant, 60.0, "nominal torque and speed"),
    (
        "torque-ramps",
        Kind::TorqueRamps,
        120.0,
        "torque slowly up and down at nominal speed",
    ),
    (
        "turbulent",
        Kind::Turbulent,
        120.0,
        "random torque up to 10 Hz, varying speed",
    ),
    (
        "reversals",
        Kind::Reversals,
        80.0,
        "torque through zero every 4 s, both ways of turning",
    ),
    (
        "steps",
        Kind::Steps,
        90.0,
        "steps of torque every 5 s, of speed every 15 s",
    ),
];

impl Scenario {
    /// The scenario of that name, with its usual duration.
    ///
    /// # Errors
    /// [`SimulateError::Scenario`], with the names that there are.
    pub fn by_name(name: &str) -> Result<Self, SimulateError> {
        let (_, kind, duration_s, _) =
            TABLE
                .iter()
                .find(|row| row.0 == name)
                .ok_or_else(|| SimulateError::Scenario {
                    found: name.into(),
                    allowed: Self::all()
                        .map(|(name, _)| name)
                        .collect::<Vec<_>>()
                        .join(", "),
                })?;
        Ok(Self {
            kind: kind.clone(),
            duration_s: *duration_s,
        })
    }

    /// The same again as a recorded machine did.
    pub fn recorded(course: Course) -> Self {
        Self {
            duration_s: course.dt_s * course.demands.len() as f64,
            kind: Kind::Recorded(Arc::new(course)),
        }
    }

    /// Carrier angle at which it starts [rad]; any where there is none.
    pub(crate) fn angle(&self) -> Option<f64> {
        match &self.kind {
            Kind::Recorded(course) => Some(course.angle),
            _ => None,
        }
    }

    /// Name and description of each scenario.
    pub fn all() -> impl Iterator<Item = (&'static str, &'static str)> {
        TABLE.iter().map(|row| (row.0, row.3))
    }

    /// What it is called.
    pub fn name(&self) -> &'static str {
        TABLE
            .iter()
            .find(|row| row.1 == self.kind)
            .map_or("recorded", |row| row.0)
    }
}

impl Course {
    /// Between the steps by straight lines, beyond the ends as at the ends.
    fn at(&self, t: f64) -> Demand {
        let position = (t / self.dt_s).max(0.0);
        let last = self.demands.len() - 1;
        let left = (position as usize).min(last);
        let (a, b) = (self.demands[left], self.demands[(left + 1).min(last)]);
        let part = (position - left as f64).clamp(0.0, 1.0);
        let between = |a: f64, b: f64| a + part * (b - a);
        Demand {
            torque: between(a.torque, b.torque),
            speed: between(a.speed, b.speed),
            held: a.held.zip(b.held).map(|(a, b)| between(a, b)),
        }
    }
}

/// What is asked of the bench at one instant, as parts of nominal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Demand {
    /// Torque of the first load.
    pub torque: f64,
    /// Speed.
    pub speed: f64,
    /// Torque of what holds the speed, where it was measured; elsewhere it
    /// follows from the speed.
    pub held: Option<f64>,
}

impl Demand {
    fn new(torque: f64, speed: f64) -> Self {
        Self {
            torque,
            speed,
            held: None,
        }
    }

    /// Change a second on the way to `next`, `dt_s` later.
    pub(crate) fn rate_to(&self, next: &Self, dt_s: f64) -> Self {
        let rate = |from: f64, to: f64| (to - from) / dt_s;
        Self {
            torque: rate(self.torque, next.torque),
            speed: rate(self.speed, next.speed),
            held: self.held.zip(next.held).map(|(from, to)| rate(from, to)),
        }
    }
}

/// A scenario with its random numbers drawn.
pub(crate) struct Profile {
    kind: Kind,
    duration: f64,
    torque: Waves,
    speed: Waves,
    levels: Vec<Demand>,
}

impl Profile {
    pub(crate) fn new(scenario: &Scenario, draw: &mut Draw) -> Self {
        let rng = &mut draw.recording;
        Self {
            kind: scenario.kind.clone(),
            duration: scenario.duration_s,
            torque: Waves::new(0.02, 10.0, rng),
            speed: Waves::new(0.01, 0.2, rng),
            levels: (0..64)
                .map(|_| Demand::new(rng.random_range(-0.2..1.1), rng.random_range(0.3..1.0)))
                .collect(),
        }
    }

    /// The demand at time `t` [s].
    pub(crate) fn at(&self, t: f64) -> Demand {
        match &self.kind {
            Kind::Recorded(recorded) => recorded.at(t),
            Kind::StartStop => start_stop(90.0 * t / self.duration),
            Kind::Constant => Demand::new(1.0, 1.0),
            Kind::TorqueRamps => Demand::new(triangle(t / 60.0), 1.0),
            Kind::Turbulent => {
                Demand::new(0.6 + 0.2 * self.torque.at(t), 0.8 + 0.1 * self.speed.at(t))
            }
            Kind::Reversals => Demand::new(
                0.5 * (2.0 * triangle(t / 8.0 + 0.25) - 1.0),
                0.6 * ((2.0 * triangle(t / 40.0 + 0.25) - 1.0) * 6.0).clamp(-1.0, 1.0),
            ),
            Kind::Steps => Demand::new(
                self.step(t, 5.0, 0.05, |d| d.torque),
                self.step(t, 15.0, 1.5, |d| d.speed),
            ),
        }
    }

    /// Levels held for `hold` s, with edges of `edge` s.
    fn step(&self, t: f64, hold: f64, edge: f64, of: fn(&Demand) -> f64) -> f64 {
        let n = self.levels.len();
        let i = (t / hold).floor().max(0.0);
        let (before, now) = ((i as usize + n - 1) % n, i as usize % n);
        let before = if i == 0.0 { now } else { before };
        let part = rise(t - i * hold, 0.0, edge);
        of(&self.levels[before]) * (1.0 - part) + of(&self.levels[now]) * part
    }
}

/// Bosmans et al. 2023, fig. 8: the times of its segments and of the spike.
fn start_stop(t: f64) -> Demand {
    let spike = rise(t, 70.5, 71.5) * (1.0 - rise(t, 72.0, 73.0));
    Demand::new(
        rise(t, 1.0, 19.0) * (1.0 - rise(t, 61.0, 70.0)) - 0.12 * spike,
        rise(t, 0.0, 18.0) * (1.0 - rise(t, 61.0, 78.0)),
    )
}

/// From 0 at `from` to 1 at `to`, half a cosine.
fn rise(t: f64, from: f64, to: f64) -> f64 {
    0.5 - 0.5 * (PI * ((t - from) / (to - from)).clamp(0.0, 1.0)).cos()
}

/// From 0 up to 1 and back over one unit.
fn triangle(phase: f64) -> f64 {
    1.0 - (2.0 * phase.rem_euclid(1.0) - 1.0).abs()
}

/// A sum of waves with variance 1: the spectrum falls with f^(-5/3) as that of
/// turbulent wind and ends at the highest frequency.
pub(crate) struct Waves(Vec<[f64; 3]>);

impl Waves {
    /// Number of waves in the sum.
    const COUNT: usize = 48;

    pub(crate) fn new(lowest_hz: f64, highest_hz: f64, rng: &mut impl rand::Rng) -> Self {
        let ratio = highest_hz / lowest_hz;
        let mut waves: Vec<[f64; 3]> = (0..Self::COUNT)
            .map(|i| {
                // Logarithmic steps, each with its frequency drawn inside.
                let f =
                    lowest_hz * ratio.powf((i as f64 + rng.random::<f64>()) / Self::COUNT as f64);
                // S(f) df with df in proportion to f, flat below five times the lowest.
                let power = f * f.max(5.0 * lowest_hz).powf(-5.0 / 3.0);
                [power.sqrt(), TAU * f, TAU * rng.random::<f64>()]
            })
            .collect();
        let variance: f64 = waves.iter().map(|[a, ..]| 0.5 * a * a).sum();
        for wave in &mut waves {
            wave[0] /= variance.sqrt();
        }
        Self(waves)
    }

    pub(crate) fn at(&self, t: f64) -> f64 {
        self.0
            .iter()
            .map(|[a, w, phase]| a * (w * t + phase).sin())
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn profile(name: &str) -> Profile {
        Profile::new(
            &Scenario::by_name(name).unwrap(),
            &mut Draw::new("scenario", 1, 1),
        )
    }

    #[test]
    fn start_stop_has_the_segments_of_the_paper() {
        let p = profile("start-stop");
        assert_eq!(p.at(0.0), Demand::default());
        for t in [20.0, 40.0, 60.0] {
            assert_eq!(p.at(t), Demand::new(1.0, 1.0));
        }
        let lowest = (0..9000)
            .map(|i| f64::from(i) * 0.01)
            .min_by(|a, b| p.at(*a).torque.total_cmp(&p.at(*b).torque))
            .unwrap();
        assert!((70.0..75.0).contains(&lowest), "spike at {lowest} s");
        assert!(p.at(lowest).torque < -0.1 && p.at(lowest).speed > 0.05);
        assert_eq!(p.at(90.0), Demand::default());
    }

    #[test]
    fn reversals_turn_both_ways_under_both_signs_of_torque() {
        let p = profile("reversals");
        let mut quadrants = [false; 4];
        for i in 0..8000 {
            let d = p.at(f64::from(i) * 0.01);
            if d.torque.abs() > 0.3 && d.speed.abs() > 0.5 {
                quadrants[usize::from(d.torque > 0.0) * 2 + usize::from(d.speed > 0.0)] = true;
            }
        }
        assert_eq!(quadrants, [true; 4]);
    }

    #[test]
    fn turbulence_has_the_variance_asked_for() {
        let p = profile("turbulent");
        let torques: Vec<f64> = (0..60_000)
            .map(|i| p.at(f64::from(i) * 0.05).torque)
            .collect();
        let mean = torques.iter().sum::<f64>() / torques.len() as f64;
        let variance =
            torques.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / torques.len() as f64;
        assert!((mean - 0.6).abs() < 0.02 && (variance.sqrt() - 0.2).abs() < 0.02);
    }

    #[test]
    fn an_unknown_name_is_answered_with_the_known_ones() {
        let text = Scenario::by_name("storm").unwrap_err().to_string();
        for (name, _) in Scenario::all() {
            assert!(text.contains(name), "{text}");
            assert_eq!(Scenario::by_name(name).unwrap().name(), name);
        }
        assert!(text.contains("storm"));
    }
}
