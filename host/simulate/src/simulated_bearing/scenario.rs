//! Gives the five loads and the speed of a simulated wheel bearing over time, for each built-in
//! load case: cornering and braking, slalom, a bend, calibration, stop and go.

use std::f64::consts::{PI, TAU};

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::SimulateError;
use crate::drivetrain_scenario::Waves;
use crate::simulated_bearing::load_profile::Driven;

/// A load case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BearingScenario {
    /// Cornering and braking on the rig.
    Lc1,
    /// Slalom on the rig.
    Lc2,
    /// A bend on the road.
    Lc3,
    /// Known loads over the whole range, on the rig.
    Calibration,
    /// Cornering with a stop in between.
    StopAndGo,
}

/// Name, case, duration [s], description.
const TABLE: [(&str, BearingScenario, f64, &str); 5] = [
    (
        "lc1",
        BearingScenario::Lc1,
        40.0,
        "bearing: cornering and braking at 1000 rpm",
    ),
    (
        "lc2",
        BearingScenario::Lc2,
        40.0,
        "bearing: slalom at 1000 rpm",
    ),
    (
        "lc3",
        BearingScenario::Lc3,
        100.0,
        "bearing: a bend of 50 m on the road, 35 to 60 km/h, other boundary conditions",
    ),
    (
        "calibration",
        BearingScenario::Calibration,
        166.0,
        "bearing: every load over its range on the rig",
    ),
    (
        "stop-and-go",
        BearingScenario::StopAndGo,
        40.0,
        "bearing: cornering, a stop, cornering again",
    ),
];

/// Radius of the tyre [m].
const TYRE_M: f64 = 0.32;

/// 1000 rpm [rad/s].
const RIG_SPEED: f64 = 1000.0 * TAU / 60.0;

impl BearingScenario {
    /// The scenario of that name and its usual duration (s).
    ///
    /// # Errors
    /// [`SimulateError::Scenario`], with the names that there are.
    pub fn by_name(name: &str) -> Result<(Self, f64), SimulateError> {
        TABLE
            .iter()
            .find(|row| row.0 == name)
            .map(|row| (row.1, row.2))
            .ok_or_else(|| SimulateError::Scenario {
                found: name.into(),
                allowed: TABLE.map(|row| row.0).join(", "),
            })
    }

    /// Name and description of each.
    pub fn all() -> impl Iterator<Item = (&'static str, &'static str)> {
        TABLE.iter().map(|row| (row.0, row.3))
    }

    /// Whether it is driven on the road.
    pub fn on_road(self) -> bool {
        self == Self::Lc3
    }
}

/// A scenario with its random numbers drawn.
pub(crate) struct Course {
    scenario: BearingScenario,
    duration: f64,
    waves: [Waves; 5],
    /// Levels of the steps, and phases.
    random: Vec<f64>,
}

impl Course {
    pub(crate) fn new(scenario: BearingScenario, duration: f64, rng: &mut ChaCha8Rng) -> Self {
        let (lowest, highest) = match scenario {
            BearingScenario::Calibration => (0.02, 1.0),
            _ => (0.3, 8.0),
        };
        Self {
            scenario,
            duration,
            waves: std::array::from_fn(|_| Waves::new(lowest, highest, rng)),
            random: (0..64).map(|_| rng.random::<f64>()).collect(),
        }
    }
}

impl Driven for Course {
    fn speed(&self, t: f64) -> f64 {
        match self.scenario {
            BearingScenario::Lc1 | BearingScenario::Lc2 => RIG_SPEED,
            BearingScenario::Lc3 => (35.0 + 25.0 * t / self.duration) / 3.6 / TYRE_M,
            BearingScenario::Calibration => RIG_SPEED * (0.75 + 0.3 * (TAU * t / 83.0).sin()),
            BearingScenario::StopAndGo => {
                let part = t / self.duration;
                0.6 * RIG_SPEED * (1.0 - rise(part, 0.35, 0.45) + rise(part, 0.55, 0.65))
            }
        }
    }

    fn loads(&self, t: f64) -> [f64; 5] {
        let rough = |i: usize| self.waves[i].at(t);
        let corner = |mx: f64, fx: f64, extra: f64| {
            // The weight moves to the outer wheel with the moment; the tyre
            // force that makes the moment is the axial force.
            let fy = mx / TYRE_M;
            let fz = 4500.0 + 2.4 * mx + 0.1 * fx.abs() + extra;
            [fx, fy, fz, mx, -60.0 - 0.02 * fx - 0.07 * mx]
        };
        match self.scenario {
            BearingScenario::Lc1 => {
                // Four bends of growing sharpness, braked in each.
                let period = self.duration / 4.0;
                let (i, part) = ((t / period).floor(), (t / period).fract());
                let sharp = 700.0 + 420.0 * i.min(3.0) * (0.8 + 0.4 * self.random[0]);
                let bend = sharp * (rise(part, 0.1, 0.3) - rise(part, 0.75, 0.92));
                let brake = (2500.0 + 2400.0 * self.random[2 + i as usize % 8])
                    * (rise(part, 0.4, 0.47) - rise(part, 0.62, 0.7));
                let mut l = corner(150.0 + bend.min(1850.0), -150.0 - brake, 80.0 * rough(2));
                l[0] += 30.0 * rough(0);
                l[3] += 10.0 * rough(3);
                l
            }
            BearingScenario::Lc2 => {
                let phase = TAU * (0.35 * t + self.random[0]);
                let swell = 0.8 + 0.2 * (TAU * t / 17.0).sin();
                let mut l = corner(
                    650.0 + 1350.0 * swell * phase.sin(),
                    -250.0 + 200.0 * (0.5 * phase).cos(),
                    60.0 * rough(2),
                );
                l[0] += 30.0 * rough(0);
                l
            }
            BearingScenario::Lc3 => {
                let v = self.speed(t) * TYRE_M;
                let mx = 0.85 * (v * v / 50.0) / 5.6 * 1900.0 * rise(t, 1.0, 6.0);
                let mut l = corner(
                    mx + 45.0 * rough(3),
                    -300.0 - 0.8 * mx + 120.0 * rough(0),
                    300.0 * rough(2),
                );
                l[4] += 12.0 * rough(4);
                l[1] += 150.0 * rough(1);
                l
            }
            BearingScenario::Calibration => {
                // Each load by itself over its range, with steps between levels.
                let level = |i: usize, hold: f64| {
                    let k = (t / hold).floor() as usize;
                    let part = rise((t / hold).fract(), 0.0, 0.25);
                    let at = |k: usize| self.random[(7 * i + k) % 64];
                    at(k) * (1.0 - part) + at(k + 1) * part
                };
                let mix = |i: usize, hold: f64, from: f64, to: f64| {
                    let share = 1.15 * level(i, hold) - 0.075 + 0.06 * rough(i);
                    from + (to - from) * share.clamp(-0.05, 1.05)
                };
                let mx = mix(3, 3.1, -700.0, 2100.0);
                [
                    mix(0, 3.7, -5500.0, 500.0),
                    mx / TYRE_M + mix(1, 4.3, -1200.0, 1200.0),
                    mix(2, 2.3, 1500.0, 10000.0),
                    mx,
                    mix(4, 5.3, -400.0, 200.0),
                ]
            }
            BearingScenario::StopAndGo => corner(
                600.0 + 500.0 * (TAU * t / 9.0 + TAU * self.random[0]).sin(),
                -400.0,
                60.0 * rough(2),
            ),
        }
    }
}

/// From 0 at `from` to 1 at `to`, half a cosine.
fn rise(t: f64, from: f64, to: f64) -> f64 {
    0.5 - 0.5 * (PI * ((t - from) / (to - from)).clamp(0.0, 1.0)).cos()
}
