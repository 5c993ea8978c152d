//! A simulated bridge on a dead-weight machine: Preisach relays, cubic, drift and a spread between
//! runs. It shares no equation of hysteresis with what is fitted.

use loadtwin::machine::Machine;
use loadtwin::static_calibration::{LoadSteps, Readings, Step};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// The machine of the example whose gauge is calibrated: `left_upper` of 0.6 µm/m in one Nm.
pub const MACHINE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/bench/machine.toml"
);

/// Sensitivity of the bridge [1/(N m)] and its largest load [N m].
pub const SENSITIVITY: f64 = 0.61e-6;
pub const LARGEST: f64 = 500.0;

/// Relays on each side of the triangle of Preisach; no load of a tenth is a threshold.
const RELAYS: usize = 40;

/// What is simulated; parts of the output at the largest load in %.
#[derive(Clone, Copy)]
pub struct Bridge {
    /// Readings by which the largest load is above proportion.
    pub quadratic: f64,
    pub cubic: f64,
    /// Width of the loop at half of the largest load.
    pub hysteresis: f64,
    /// Play: a loop with parallel sides, where all relays have about the same width.
    pub has_play: bool,
    /// Standard deviation of a reading.
    pub noise: f64,
    /// Loads of both signs.
    pub both_signs: bool,
    pub runs: usize,
    /// Steps from no load to the largest.
    pub steps: usize,
}

impl Bridge {
    /// Good ones: readings to 0.002 %.
    pub const CLEAN: Self = Self {
        quadratic: 0.0,
        cubic: 0.0,
        hysteresis: 0.0,
        has_play: false,
        noise: 0.002,
        both_signs: false,
        runs: 3,
        steps: 10,
    };

    /// Loads of one run in parts of the largest, from zero to zero.
    pub fn loads(&self) -> Vec<f64> {
        let n = self.steps as i32;
        let up = 0..=n;
        let down = (0..n).rev();
        let half: Vec<i32> = up.chain(down).collect();
        let other: Vec<i32> = half.iter().skip(1).map(|k| -k).collect();
        let all = half.iter().chain(other.iter().filter(|_| self.both_signs));
        all.map(|k| f64::from(*k) / f64::from(n)).collect()
    }

    /// Reading of each run at each load, in parts of the output at the largest load.
    pub fn readings(&self, seed: u64) -> Vec<Vec<f64>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let loads = self.loads();
        let mut relays = Relays::new(if self.both_signs { -1.0 } else { 0.0 }, self.has_play);
        for _ in 0..3 {
            for load in &loads {
                relays.apply(*load);
            }
        }
        let width = relays.width(&loads);
        let scale = 0.01 * self.hysteresis / width;
        // Temperature: slow against a run, a fiftieth of a percent over all of them.
        let (phase, speed) = (normal(), 0.3 / loads.len() as f64);
        let mut time = 0.0;
        (0..self.runs)
            .map(|_| {
                let zero = 2e-4 * normal();
                let gain = 1.0 + 5e-5 * normal();
                let mut read = |load: &f64| {
                    time += 1.0;
                    let drift = 1e-4 * (phase + speed * time).sin();
                    let hysteresis = scale * relays.apply(*load);
                    let bent = 0.01 * (self.quadratic * load.powi(2) + self.cubic * load.powi(3));
                    zero + gain * load + bent + hysteresis + drift + 0.01 * self.noise * normal()
                };
                loads.iter().map(&mut read).collect()
            })
            .collect()
    }

    /// As [`LoadSteps::read`] gives them of a table.
    pub fn steps(&self, machine: &Machine, seed: u64) -> LoadSteps {
        let loads = self.loads();
        let span = SENSITIVITY * LARGEST;
        let (mut steps, mut values) = (Vec::new(), Vec::new());
        for (run, readings) in self.readings(seed).iter().enumerate() {
            for (load, reading) in loads.iter().zip(readings) {
                let row = steps.len();
                steps.push(Step {
                    file: 0,
                    run,
                    plateau: row,
                    t_s: row as f64,
                    since_s: (row as f64 - 1.0).max(0.0),
                    load: load * LARGEST,
                    speed: 0.0,
                });
                values.push(span * reading);
            }
        }
        let channel = machine
            .channels
            .iter()
            .position(|c| c.name == "left_upper")
            .unwrap();
        LoadSteps {
            readings: vec![Readings {
                channel,
                variance: vec![0.0; values.len()],
                saturated: 0,
                values,
            }],
            steps,
            is_timed: false,
            are_means: false,
            load: 0,
        }
    }

    /// A table of all runs as CSV, in microstrain.
    pub fn table(&self, seed: u64) -> String {
        let loads = self.loads();
        let mut text = "run,motor_flange [Nm],left_upper [µm/m]\n".to_owned();
        for (run, readings) in self.readings(seed).iter().enumerate() {
            for (load, reading) in loads.iter().zip(readings) {
                let strain = 1e6 * SENSITIVITY * LARGEST * reading;
                text += &format!("{},{},{strain:.5}\n", run + 1, load * LARGEST);
            }
        }
        text
    }
}

/// Hysteresis of Preisach: relays that switch up at `alpha` and down at `beta`, of uniform density.
struct Relays {
    thresholds: Vec<(f64, f64)>,
    up: Vec<bool>,
}

impl Relays {
    fn new(low: f64, has_play: bool) -> Self {
        let at = |k: usize| low + (1.0 - low) * (k as f64 + 0.5) / RELAYS as f64;
        let pairs = (0..RELAYS).flat_map(|a| (0..=a).map(move |b| (a, b)));
        let pairs = pairs.filter(|(a, b)| !has_play || (4..8).contains(&(a - b)));
        let thresholds: Vec<_> = pairs.map(|(a, b)| (at(a), at(b))).collect();
        Self {
            up: vec![false; thresholds.len()],
            thresholds,
        }
    }

    /// Mean state of the relays at `load`, -1 to 1.
    fn apply(&mut self, load: f64) -> f64 {
        for ((alpha, beta), up) in self.thresholds.iter().zip(&mut self.up) {
            if load >= *alpha {
                *up = true;
            } else if load <= *beta {
                *up = false;
            }
        }
        let up = self.up.iter().filter(|up| **up).count() as f64;
        2.0 * up / self.up.len() as f64 - 1.0
    }

    /// Difference at half of the largest load, from rising to falling.
    fn width(&mut self, loads: &[f64]) -> f64 {
        let top = loads.iter().position(|load| *load == 1.0).unwrap();
        let states: Vec<f64> = loads.iter().map(|load| self.apply(*load)).collect();
        let at_half = |rows: std::ops::Range<usize>| {
            let row =
                rows.min_by(|&a, &b| (loads[a] - 0.5).abs().total_cmp(&(loads[b] - 0.5).abs()));
            states[row.unwrap()]
        };
        at_half(top + 1..loads.len()) - at_half(0..top)
    }
}
