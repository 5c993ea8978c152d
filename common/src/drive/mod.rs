//! Estimates the unknown load on one axis of a drive from its driving torque or force and its
//! motion, one raw sample at a time, without strain gauges (`DriveEstimator::step`). Where the
//! driving torque or force is not measured, that is estimated instead.
//!
//! ```text
//! states    x, v, a, d    position, speed, acceleration, unknown load
//! predict   x+ = x + v dt + a dt^2/2,  v+ = v + a dt,  a and d walk at random
//! update    position = x,  speed = v,
//!           drive = offset + J a + b v + sum L_j + sum term_k(x, v, a, L, z) + d
//! ```
//!
//! The motion is kinematic and measured, and the balance of forces is an observation of it:
//! friction is evaluated at the motion that was estimated, so that nothing has to be integrated
//! through sticking and no inertia is too small. Directions `z` of friction follow the position
//! ([`term`]). Where the drive is not measured, it is what is estimated: the right side without
//! `d`.
//!
//! Source: Bosmans et al. 2023 for the augmented filter; Singer 1970 for the motion.

mod delay_line;
mod model;
mod signals;
pub mod term;

use heapless::Vec;
use nalgebra::{RowSVector, SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::drive::signals::{LONGEST_GAP, Readings, SignalHistory};
use crate::drive::term::{DirectionState, MAX_DIRECTIONS, Motion};
use crate::error::Error;
use crate::io::estimate::{Estimate, LoadEstimate, SensorEstimate};
use crate::io::fault::Fault;
use crate::io::measurement::{AdcScaling, Measured, SignalConditioner};
use crate::io::raw::{MAX_CHANNELS, RawSample};
use crate::kalman::gaussian::Gaussian;
use crate::kalman::innovation::{Gate, Innovation, Outcome};
use crate::kalman::transition::{ProcessNoise, RandomWalk, Transition};
use crate::kalman::{predict, update};
use crate::signal::phase::Phase;

pub use delay_line::MAX_DELAY;
pub use model::{DriveModel, MAX_KNOWN, MAX_UNIT, PositionSensor, Signal};

/// Position, speed, acceleration, unknown load.
const STATES: usize = 4;

/// Index of the position (rad, m).
const POSITION: usize = 0;

/// Index of the speed (rad/s, m/s).
const SPEED: usize = 1;

/// Index of the acceleration (rad/s^2, m/s^2).
const ACCELERATION: usize = 2;

/// Index of the unknown load (N m, N).
const LOAD: usize = 3;

/// Standard deviations of a reading that its noise spans: three to either side.
const REVERSAL: f32 = 6.0;

/// The estimator of one drive.
#[derive(Clone, Debug)]
pub struct DriveEstimator<'a> {
    model: DriveModel<'a>,
    converters: Vec<AdcScaling, MAX_CHANNELS>,
    transition: Transition<STATES, 1, RandomWalk>,
    process_noise: ProcessNoise<STATES>,
    initial: Gaussian<STATES>,
    /// Whether a term depends on where the position is zero.
    needs_homing: bool,
}

/// What changes from sample to sample.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DriveState {
    conditioner: SignalConditioner,
    signals: SignalHistory,
    /// The state's position is from here (counts).
    origin: i64,
    posterior: Gaussian<STATES>,
    directions: [DirectionState; MAX_DIRECTIONS],
    /// The position up to which directions have followed, from the state's origin [rad, m].
    followed: f32,
    /// The sign of the last motion that they followed, -1 or 1; 0 before any.
    heading: f32,
    /// The last reading of each known load.
    known: [f32; MAX_KNOWN],
    /// Samples since every reading that the estimate needs was there.
    age: u16,
    started: bool,
    /// Before the start, the position of the last sample (counts).
    before: Option<i64>,
}

impl<'a> DriveEstimator<'a> {
    /// Checks a model and lays it out for the step.
    ///
    /// # Errors
    /// The name of the first number that is out of its range.
    pub fn try_build(model: DriveModel<'a>) -> Result<Self, Error> {
        model.check()?;
        let t = model.sample_s;
        let motion = SMatrix::<f32, STATES, STATES>::from_row_slice(&[
            1.0,
            t,
            0.5 * t * t,
            0.0, //
            0.0,
            1.0,
            t,
            0.0, //
            0.0,
            0.0,
            1.0,
            0.0, //
            0.0,
            0.0,
            0.0,
            1.0,
        ]);
        let initial_std = SVector::from(model.initial_std);
        let needs_homing = model.terms.iter().any(|term| term.factor.needs_homing());
        Ok(Self {
            converters: model.signals().map(|signal| signal.converter).collect(),
            transition: Transition::try_new(&motion, RandomWalk)?,
            process_noise: ProcessNoise::try_new(&white_jerk(&model))?,
            initial: Gaussian::independent(
                SVector::zeros(),
                &initial_std.component_mul(&initial_std),
            )?,
            needs_homing,
            model,
        })
    }

    /// The state before the first sample.
    pub fn start(&self) -> DriveState {
        DriveState {
            conditioner: SignalConditioner::default(),
            signals: SignalHistory::empty(),
            origin: 0,
            posterior: self.initial,
            directions: [DirectionState::default(); MAX_DIRECTIONS],
            followed: 0.0,
            heading: 0.0,
            known: [0.0; MAX_KNOWN],
            age: u16::MAX,
            started: false,
            before: None,
        }
    }

    /// One sample: convert, predict, update with each usable reading.
    pub fn step(&self, state: &mut DriveState, raw: &RawSample) -> Estimate {
        let mut estimate = Estimate::default();
        self.step_into(state, raw, &mut estimate);
        estimate
    }

    /// As [`Self::step`], in its place.
    #[inline(never)]
    pub fn step_into(&self, state: &mut DriveState, raw: &RawSample, estimate: &mut Estimate) {
        let m = (state.conditioner).convert(raw, &self.converters, &[], None, Phase::default());
        estimate.begin(m.tick, m.lost);
        if m.lost > LONGEST_GAP {
            state.signals.forget_readings();
            state.started = false;
        }
        if !m.stale {
            state.signals.push(&self.model, &m, raw);
            if state.started {
                for _ in 0..=m.lost {
                    self.predict(state);
                }
            } else {
                self.begin(state, m.lost == 0);
            }
        }
        let readings = (state.signals).readings(&self.model, state.origin, m.stale);
        estimate.homed = self.is_homed(state);
        self.observe(state, &readings, estimate);
        self.recentre(state);
    }

    // Inlined into the loop over lost samples, every number of its matrices is loaded before the
    // loop, stored to the stack and loaded again.
    #[inline(never)]
    fn predict(&self, state: &mut DriveState) {
        predict(&mut state.posterior, &self.transition, &self.process_noise);
    }

    /// The state before the first sample, at the position and speed that are measured then; without
    /// a sensor of speed, at that between the first two positions that follow each other.
    ///
    /// Source: Bar-Shalom, Li, Kirubarajan 2001, section 5.5.3, two-point differencing.
    fn begin(&self, state: &mut DriveState, follows: bool) {
        state.posterior = self.initial;
        state.directions = [DirectionState::default(); MAX_DIRECTIONS];
        state.followed = 0.0;
        state.heading = 0.0;
        state.known = [0.0; MAX_KNOWN];
        state.age = u16::MAX;
        let before = state.before.take().filter(|_| follows);
        let Ok(position) = state.signals.position(self.model.position.as_ref()) else {
            return;
        };
        state.origin = position;
        state.before = Some(position);
        if self.model.speed.is_some() {
            if let Ok(speed) = state.signals.speed(&self.model) {
                state.posterior.state[SPEED] = speed;
                state.started = true;
            }
        } else if let (Some(before), Some(sensor)) = (before, &self.model.position) {
            let per_count = sensor.count / self.model.sample_s;
            let std = sensor.noise_std / self.model.sample_s;
            state.posterior.state[SPEED] = position.wrapping_sub(before) as f32 * per_count;
            state.posterior.reset_variance(SPEED, 2.0 * std * std);
            state.started = true;
        }
    }

    fn is_homed(&self, state: &DriveState) -> bool {
        let relative = (self.model.position).is_some_and(|sensor| sensor.at_pulse.is_some());
        state.signals.home().is_some() || !relative
    }

    /// Updates with the readings and evaluates the balance at what they make of the motion.
    fn observe(&self, state: &mut DriveState, readings: &Readings, estimate: &mut Estimate) {
        let model = &self.model;
        let position = model.position.map(|sensor| {
            let noise = sensor.noise_std;
            update_sensor(state, &unit_row(POSITION), 0.0, readings.position, noise)
        });
        let speed = model.speed.map(|signal| {
            update_sensor(
                state,
                &unit_row(SPEED),
                0.0,
                readings.speed,
                signal.noise_std,
            )
        });
        self.follow(state, readings.position);
        let mut complete =
            position.is_none_or(|s| s.fault.is_none()) && speed.is_none_or(|s| s.fault.is_none());
        for (held, reading) in (state.known.iter_mut().zip(&readings.known)).take(model.known.len())
        {
            match reading {
                Ok(value) => *held = *value,
                Err(_) => complete = false,
            }
        }
        let terms = self.terms(state, estimate.homed);
        let row = RowSVector::from([0.0, model.drag, model.inertia, 1.0]);
        let drive = model.drive.map(|signal| {
            // Where a known load is not measured in this sample, the drive is not used either.
            let all = readings.known.iter().take(model.known.len());
            let reading = all.fold(readings.drive, |drive, load| load.and(drive));
            update_sensor(state, &row, terms, reading, signal.noise_std)
        });
        complete &= drive.is_none_or(|s| s.fault.is_none());
        state.age = if complete {
            0
        } else {
            state.age.saturating_add(1)
        };
        for sensor in drive.into_iter().chain(speed) {
            let _ = estimate.sensors.push(sensor);
        }
        for reading in readings.known.iter().take(model.known.len()) {
            let _ = estimate.sensors.push(SensorEstimate {
                measured: reading.unwrap_or(0.0),
                fault: reading.err().unwrap_or_default(),
                ..SensorEstimate::default()
            });
        }
        if let Some(sensor) = position {
            let _ = estimate.sensors.push(sensor);
            let at = self.absolute(state);
            estimate.angle_rad = crate::signal::phase::wrap_rad(at);
        }
        let load = self.load(state, &row, terms, estimate.homed);
        let _ = estimate.loads.push(load);
    }

    /// Directions follow the position as it is read. It has turned back once it is further from its
    /// turning point than its noise spans, and then has come the whole way from there: noise is no
    /// motion, and a reversal loses nothing. The estimated position overshoots where a motion stops
    /// faster than the filter's band, and its return is no reversal either.
    fn follow(&self, state: &mut DriveState, position: Measured<f32>) {
        // A position that nothing measures is the integral of a speed, without noise of its own.
        let (x, uncertain) = match &self.model.position {
            Some(sensor) => (
                position.unwrap_or(state.followed),
                REVERSAL * sensor.noise_std,
            ),
            None => (state.posterior.state[POSITION], 0.0),
        };
        let ahead = x - state.followed;
        let onward = ahead * state.heading > 0.0;
        let moved = if onward || libm::fabsf(ahead) > uncertain {
            state.heading = libm::copysignf(1.0, ahead);
            state.followed = x;
            ahead
        } else {
            0.0
        };
        let speed = state.posterior.state[SPEED];
        for (direction, z) in self.model.directions.iter().zip(&mut state.directions) {
            direction.follow(z, moved, speed);
        }
    }

    /// Position [rad, m]; as long as it is not homed, from where it started.
    fn absolute(&self, state: &DriveState) -> f32 {
        self.model.position.map_or(0.0, |sensor| {
            let counts = state.origin.wrapping_add(state.signals.home().unwrap_or(0));
            sensor.at_zero + counts as f32 * sensor.count + state.posterior.state[POSITION]
        })
    }

    /// `offset + sum L_j + sum term_k`, without what waits for homing.
    fn terms(&self, state: &DriveState, homed: bool) -> f32 {
        let model = &self.model;
        let x = &state.posterior.state;
        let known = state.known.get(..model.known.len()).unwrap_or(&[]);
        let motion = Motion {
            place: homed.then(|| self.place(state)),
            position: self.absolute(state),
            speed: x[SPEED],
            acceleration: x[ACCELERATION],
            loads: known,
        };
        let mut sum = model.offset;
        for load in known {
            sum += load;
        }
        for term in &model.terms {
            if let Some(value) = term.factor.at(&motion) {
                let direction = (term.direction)
                    .and_then(|d| state.directions.get(usize::from(d)))
                    .map_or(1.0, |d| d.z);
                sum += term.coefficient * value * direction;
            }
        }
        sum
    }

    /// Position in 2^-16 counts.
    fn place(&self, state: &DriveState) -> i64 {
        let counts = state.origin.wrapping_add(state.signals.home().unwrap_or(0));
        let count = self.model.position.map_or(1.0, |sensor| sensor.count);
        let part = state.posterior.state[POSITION] / count * PLACES;
        counts.wrapping_mul(PLACES as i64).wrapping_add(part as i64)
    }

    fn load(
        &self,
        state: &DriveState,
        row: &RowSVector<f32, STATES>,
        terms: f32,
        homed: bool,
    ) -> LoadEstimate {
        let model = &self.model;
        let posterior = &state.posterior;
        let measured = model.drive.is_some();
        let (value, variance) = if measured {
            (posterior.state[LOAD], posterior.variances()[LOAD])
        } else {
            let held = f32::from(state.age) * model.load_variance;
            let row = RowSVector::from([0.0, row[SPEED], row[ACCELERATION], 0.0]);
            let motion = (row * posterior.covariance() * row.transpose())[0];
            (terms + (row * posterior.state)[0], motion + held)
        };
        let std = libm::sqrtf(variance + model.model_std * model.model_std);
        let limits = model.loads.first();
        let fault = if !(value.is_finite() && std.is_finite()) {
            Fault::NotValid
        } else if limits.is_some_and(|l| libm::fabsf(value) > l.full_scale) {
            Fault::Implausible
        } else if !state.started || limits.is_some_and(|l| std > l.valid_std) {
            Fault::NotValid
        } else if self.needs_homing && !homed {
            Fault::NotHomed
        } else {
            Fault::None
        };
        LoadEstimate {
            value,
            std,
            age: state.age,
            fault,
        }
    }

    /// Keeps the state's position within a count of its origin: f32 resolves it over any travel.
    fn recentre(&self, state: &mut DriveState) {
        let x = state.posterior.state[POSITION];
        if !state.posterior.state.iter().all(|x| x.is_finite()) {
            state.started = false;
            return;
        }
        if let Some(sensor) = &self.model.position {
            let counts = libm::rintf(x / sensor.count);
            let by = counts * sensor.count;
            state.origin = state.origin.wrapping_add(counts as i64);
            state.posterior.state[POSITION] -= by;
            state.followed -= by;
        } else {
            // Nothing measures the position, and nothing depends on it but how far it moved.
            let variance = self.initial.variances()[POSITION];
            state.posterior.reset_variance(POSITION, variance);
            state.posterior.state[POSITION] = 0.0;
            state.followed -= x;
        }
        if self.model.drive.is_none() {
            let variance = self.initial.variances()[LOAD];
            state.posterior.reset_variance(LOAD, variance);
        }
    }
}

/// Places in one count at which a periodic term is resolved.
const PLACES: f32 = 65_536.0;

fn unit_row(state: usize) -> RowSVector<f32, STATES> {
    let mut row = RowSVector::zeros();
    row[state] = 1.0;
    row
}

/// `y = terms + row x + noise`.
fn update_sensor(
    state: &mut DriveState,
    row: &RowSVector<f32, STATES>,
    terms: f32,
    reading: Measured<f32>,
    noise_std: f32,
) -> SensorEstimate {
    let value = match reading {
        Ok(value) => value,
        Err(fault) => {
            return SensorEstimate {
                fault,
                ..SensorEstimate::default()
            };
        }
    };
    let mut nu = value - terms;
    for i in 0..STATES {
        nu -= row[i] * state.posterior.state[i];
    }
    let variance = noise_std * noise_std;
    let Innovation {
        value: innovation,
        variance,
        nis,
        outcome,
    } = update(&mut state.posterior, row, nu, variance, &mut Gate::open());
    SensorEstimate {
        measured: value,
        innovation,
        innovation_variance: variance,
        nis,
        fault: match outcome {
            Outcome::Used => Fault::None,
            Outcome::Gated | Outcome::Invalid => Fault::NotValid,
        },
    }
}

/// Process noise of a motion whose jerk is white, and of the walk of the load.
///
/// Source: Bar-Shalom, Li, Kirubarajan 2001, eq. (6.2.3-5), one order higher.
fn white_jerk(model: &DriveModel<'_>) -> SMatrix<f32, STATES, STATES> {
    let (t, q) = (model.sample_s, model.jerk_density);
    let [xx, xv, xa] = [
        t * t * t * t * t / 20.0,
        t * t * t * t / 8.0,
        t * t * t / 6.0,
    ];
    let [vv, va, aa] = [t * t * t / 3.0, t * t / 2.0, t];
    let mut noise = SMatrix::<f32, STATES, STATES>::from_row_slice(&[
        xx, xv, xa, 0.0, //
        xv, vv, va, 0.0, //
        xa, va, aa, 0.0, //
        0.0, 0.0, 0.0, 0.0,
    ]) * q;
    noise[(LOAD, LOAD)] = model.load_variance;
    noise
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
