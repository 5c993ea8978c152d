//! Simulates the readings of displacement sensors on a rotor whose shaft turns as recorded, at
//! varying speed, under forces of given orders of the shaft. Gives one regressor for each unit
//! force and initial motion (`columns`), or the reading for given amplitudes, for
//! `loadtwin diagnose`.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par, Scale, unzip, zip};

use crate::rotor::RotorError;
use crate::rotor::fe_model::RotorModel;
use crate::rotor::undamped_mode_reduction::Reduced;
use loadtwin_machine::{Channel, Rotor, Senses};
use loadtwin_math::exponential::exponential;

/// Undamped modes that motion is made of, beside what forces bend statically.
const MODES: usize = 8;

/// Speeds at which a motion is discretised where the speed varies.
const SPEEDS: usize = 33;

/// Angular acceleration, as a part of the highest speed squared, whose stiffness is negligible
/// beside inertia.
const STEADY: f64 = 1e-4;

/// `A` and `B` over a sample.
type Step = (Mat<f64>, Mat<f64>);

/// [`Step`] at a steady speed, and what the highest acceleration adds to `A`.
struct Steps {
    steady: Step,
    accelerated: Mat<f64>,
}

/// How a shaft turns, sample by sample.
#[derive(Clone, Debug)]
pub struct ShaftRotation {
    /// Sample period (s).
    pub dt_s: f64,
    /// Angle (rad).
    pub angle: Vec<f64>,
    /// Speed [rad/s].
    pub speed: Vec<f64>,
    /// Angular acceleration [rad/s^2].
    pub acceleration: Vec<f64>,
}

impl ShaftRotation {
    /// Whether angular acceleration may appear in the bending of the shaft.
    pub fn accelerates(&self) -> bool {
        let most = |of: &[f64]| {
            of.iter()
                .fold(0.0, |most: f64, value| most.max(value.abs()))
        };
        most(&self.acceleration) > STEADY * most(&self.speed).powi(2)
    }
}

/// A pair of forces along x and y at a node: a phasor of `order` turns a turn of the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SynchronousForce {
    /// Node that it acts on.
    pub node: usize,
    /// Turns a turn of the shaft; negative where it turns backward.
    pub order: f64,
    /// Whether it grows with the speed squared, as an unbalance [kg m], or stays (N).
    pub grows: bool,
}

/// A rotor under forces that turn, from sample to sample:
/// `x+ = A(speed, speed') x + B(speed) f`, `y = h z`, `x = (z, z')`.
pub struct ForcedRotor {
    forces: Vec<SynchronousForce>,
    speeds: Range<f64>,
    /// The highest angular acceleration, either way [rad/s^2].
    acceleration: f64,
    steps: Vec<Steps>,
    /// Row of each sensor over `x`.
    rows: Mat<f64>,
    modes: usize,
}

impl ForcedRotor {
    /// `rotor` under `forces`, measured by displacement sensors `channels`, turning as `turning`.
    ///
    /// # Errors
    /// [`RotorError`] where the rotor is not held.
    pub fn new(
        rotor: &Rotor,
        channels: &[Channel],
        forces: &[SynchronousForce],
        turning: &ShaftRotation,
    ) -> Result<Self, RotorError> {
        let model = RotorModel::new(rotor);
        let directions = |node: usize| {
            [0.0, std::f64::consts::FRAC_PI_2].map(|angle| model.direction(node, angle))
        };
        let inputs: Vec<Vec<f64>> = forces.iter().flat_map(|f| directions(f.node)).collect();
        let reduced = Reduced::with_statics(&model, rotor.speed_rad_s, MODES, &inputs)?;
        let mut rows = Mat::<f64>::zeros(channels.len(), 2 * reduced.len());
        for (k, channel) in channels.iter().enumerate() {
            if let Senses::Displacement(at) = &channel.senses {
                let row = model.direction(at.node, at.direction_deg.to_radians());
                let sensitivity = channel.sensitivity.unwrap_or(1.0);
                for (j, part) in reduced.row(&row).iter().enumerate() {
                    rows[(k, j)] = sensitivity * part;
                }
            }
        }
        let lowest = turning.speed.iter().copied().fold(f64::INFINITY, f64::min);
        let highest = turning.speed.iter().copied().fold(0.0, f64::max);
        let acceleration =
            (turning.acceleration.iter()).fold(0.0, |most: f64, a| most.max(a.abs()));
        let count = if highest - lowest > 1e-6 * highest {
            SPEEDS
        } else {
            1
        };
        let step = (highest - lowest) / (count.max(2) - 1) as f64;
        let steps = (0..count)
            .map(|k| {
                let speed = lowest + step * k as f64;
                let motion = reduced.motion(&model, speed, turning.dt_s, inputs.len());
                let at = |acceleration: f64| {
                    let turns = (speed, acceleration);
                    held(
                        motion.clone(),
                        &reduced,
                        turns,
                        forces,
                        &inputs,
                        turning.dt_s,
                    )
                };
                let steady = at(0.0);
                let accelerated = at(acceleration).0 - &steady.0;
                Steps {
                    steady,
                    accelerated,
                }
            })
            .collect();
        Ok(Self {
            forces: forces.to_vec(),
            speeds: lowest..highest,
            acceleration,
            steps,
            rows,
            modes: reduced.len().min(MODES),
        })
    }

    /// What each sensor reads under each force of unit size, in phase with the shaft and a
    /// quarter turn later, then of each motion before the first sample: `[column][sensor]`.
    pub fn columns(&self, turning: &ShaftRotation) -> Vec<Vec<Vec<f64>>> {
        let (n, driven) = (self.steps[0].accelerated.nrows(), 2 * self.forces.len());
        let count = driven + 2 * self.modes;
        let mut x = Mat::<f64>::zeros(n, count);
        for mode in 0..self.modes {
            x[(mode, driven + mode)] = 1.0;
            x[(n / 2 + mode, driven + self.modes + mode)] = 1.0;
        }
        self.run(turning, x, |pushed, x| {
            for (column, pushed) in pushed.col_iter().enumerate() {
                let mut x = x.as_mut().col_mut(column);
                x += pushed;
            }
        })
    }

    /// What each sensor reads with `sizes` of the columns.
    pub fn reading(&self, turning: &ShaftRotation, sizes: &[f64]) -> Vec<Vec<f64>> {
        let (n, driven) = (self.steps[0].accelerated.nrows(), 2 * self.forces.len());
        let mut x = Mat::<f64>::zeros(n, 1);
        for mode in 0..self.modes {
            x[(mode, 0)] = sizes[driven + mode];
            x[(n / 2 + mode, 0)] = sizes[driven + self.modes + mode];
        }
        let sizes = Mat::from_fn(driven, 1, |j, _| sizes[j]);
        let all = self.run(turning, x, |pushed, x| *x += pushed * &sizes);
        all.into_iter().next().unwrap_or_default()
    }

    fn run(
        &self,
        turning: &ShaftRotation,
        mut x: Mat<f64>,
        push: impl Fn(&Mat<f64>, &mut Mat<f64>),
    ) -> Vec<Vec<Vec<f64>>> {
        let samples = turning.angle.len();
        let mut all = vec![vec![Vec::with_capacity(samples); self.rows.nrows()]; x.ncols()];
        // Room for what is computed for each sample.
        let (mut a, mut b) = self.steps[0].steady.clone();
        let (mut pushed, mut moved) = (b.clone(), x.clone());
        let mut read = Mat::<f64>::zeros(self.rows.nrows(), x.ncols());
        for i in 0..samples {
            matmul(&mut read, Accum::Replace, &self.rows, &x, 1.0, Par::Seq);
            for (read, of_column) in read.col_iter().zip(&mut all) {
                for (reading, readings) in read.iter().zip(of_column) {
                    readings.push(*reading);
                }
            }
            let next = turning.speed[(i + 1).min(samples - 1)];
            let speed = 0.5 * (turning.speed[i] + next);
            self.step(speed, turning.acceleration[i], &mut a, &mut b);
            matmul(&mut moved, Accum::Replace, &a, &x, 1.0, Par::Seq);
            std::mem::swap(&mut x, &mut moved);
            self.pushed(&b, turning, i, &mut pushed);
            push(&pushed, &mut x);
        }
        all
    }

    /// `B f` for each force of unit size at sample `i`, in phase and a quarter turn later.
    fn pushed(&self, b: &Mat<f64>, turning: &ShaftRotation, i: usize, pushed: &mut Mat<f64>) {
        for (k, force) in self.forces.iter().enumerate() {
            for quarter in 0..2 {
                let [along_x, along_y] = force.at(turning, i, quarter);
                for row in 0..b.nrows() {
                    pushed[(row, 2 * k + quarter)] =
                        along_x * b[(row, 2 * k)] + along_y * b[(row, 2 * k + 1)];
                }
            }
        }
    }

    /// Sets `a` and `b` to `A` and `B` at a speed and an acceleration, between those of the table.
    fn step(&self, speed: f64, acceleration: f64, a: &mut Mat<f64>, b: &mut Mat<f64>) {
        let last = self.steps.len() - 1;
        let span = (self.speeds.end - self.speeds.start) / last as f64;
        let place = if last == 0 {
            0.0
        } else {
            ((speed - self.speeds.start) / span).clamp(0.0, last as f64)
        };
        let low = (place as usize).min(last.saturating_sub(1));
        let part = place - low as f64;
        let (low, high) = (&self.steps[low], &self.steps[(low + 1).min(last)]);
        let set = |slot: &mut f64, value: f64| *slot = value;
        between(&low.steady.0, &high.steady.0, part, set, a);
        between(&low.steady.1, &high.steady.1, part, set, b);
        if acceleration != 0.0 {
            let of_highest = acceleration / self.acceleration;
            let add = |slot: &mut f64, value: f64| *slot += of_highest * value;
            between(&low.accelerated, &high.accelerated, part, add, a);
        }
    }
}

/// Gives each number between those of two tables to `take`, with its place in `into`.
fn between(
    low: &Mat<f64>,
    high: &Mat<f64>,
    part: f64,
    take: impl Fn(&mut f64, f64),
    into: &mut Mat<f64>,
) {
    zip!(into, low, high).for_each(|unzip!(into, low, high)| {
        take(into, low + part * (high - low));
    });
}

impl SynchronousForce {
    /// Along x and y at sample `i`, `quarter` quarter turns on.
    fn at(&self, turning: &ShaftRotation, i: usize, quarter: usize) -> [f64; 2] {
        let phase = std::f64::consts::FRAC_PI_2 * quarter as f64;
        let (sine, cosine) = (self.order * turning.angle[i] + phase).sin_cos();
        if self.grows {
            let (w, along) = (turning.speed[i], turning.acceleration[i]);
            [w * w * cosine + along * sine, w * w * sine - along * cosine]
        } else {
            [cosine, sine]
        }
    }
}

/// `A` and `B` over a sample at `(speed, speed')` for forces that turn within it, exact at a
/// steady speed; `a`: as [`Reduced::motion`] has it there, with room for the forces.
///
/// Source: Van Loan, IEEE Trans. Autom. Control 23 (1978).
fn held(
    mut a: Mat<f64>,
    reduced: &Reduced,
    (speed, acceleration): (f64, f64),
    forces: &[SynchronousForce],
    inputs: &[Vec<f64>],
    dt_s: f64,
) -> Step {
    let (r, m) = (reduced.len(), inputs.len());
    let n = 2 * r;
    let mut pulled = a.submatrix_mut(r, 0, r, r);
    pulled -= Scale(acceleration * dt_s) * reduced.accelerating_stiffness();
    for (j, input) in inputs.iter().enumerate() {
        for (i, value) in reduced.row(input).iter().enumerate() {
            a[(r + i, n + j)] = value * dt_s;
        }
    }
    for (k, force) in forces.iter().enumerate() {
        let turned = force.order * speed * dt_s;
        a[(n + 2 * k, n + 2 * k + 1)] = -turned;
        a[(n + 2 * k + 1, n + 2 * k)] = turned;
    }
    let e = exponential(&a);
    (
        e.submatrix(0, 0, n, n).to_owned(),
        e.submatrix(0, n, n, m).to_owned(),
    )
}
