//! The rotor: displacements everywhere and forces at the discs, from
//! displacements at a few nodes.
//!
//! A reduced finite-element model with the forces as states ([`filter`]), its
//! matrices over the speed. The full recursion runs until its gain has
//! converged; then the steady gain of the speed takes its place, until a
//! reading is missing or refused. An estimate may lag by some samples, of which
//! it knows more then ([`past`]). Where the innovations contradict the model, the
//! noise of the model is larger ([`mismatch`]); where one sensor contradicts the others, it is held out ([`votes`]).
//!
//! Source: Rezende et al. 2023, section 2.

mod active;
pub mod filter;
pub mod mismatch;
mod model;
mod output;
pub mod past;
mod shaft;
pub mod votes;

use heapless::Vec;

use crate::Error;
use crate::estimate::{Estimate, MAX_LOADS, SensorEstimate};
use crate::fault::Fault;
use crate::measurement::{Converter, Counter, Measurement, Unwrap};
use crate::phase::Phase;
use crate::raw::{MAX_CHANNELS, MAX_ENCODERS, RawSample};
use active::Active;
use filter::{Belief, Row, Turn, predict_covariance, predict_state, predicted, update};
use mismatch::{Change, Mismatch};
use past::{MAX_LAG, Moment, Past};
use shaft::{Shaft, turned};
use votes::Votes;

pub use model::{
    MAX_LEVELS, MAX_MODES, MAX_STATES, Noise, Numbers, RotorChannel, RotorModel, ShaftEncoder,
    Speeds, WAVES,
};

/// Samples without any after which a gap is a new start, and without a reading after which
/// the loads are not valid.
const LONGEST_GAP: u32 = 100;

/// Part of the speeds' range beyond its ends that is still estimated.
const MARGIN: f32 = 0.02;

/// The estimator of a rotor, fixed after start.
#[derive(Clone, Debug)]
pub struct Rotor<'a, const NZ: usize, const NX: usize> {
    model: RotorModel<'a>,
    converters: Vec<Converter, MAX_CHANNELS>,
    counters: Vec<Counter, MAX_ENCODERS>,
    rows: Vec<Row<f32, NZ>, MAX_CHANNELS>,
    constant: Turn<f32>,
    /// The noise of the description.
    described: Noise<'a>,
}

/// What changes from sample to sample.
#[derive(Clone, Debug)]
pub struct RotorState<const NZ: usize, const NX: usize> {
    unwrap: Unwrap,
    belief: Belief<f32, NX>,
    past: Past<NX>,
    votes: Votes,
    shaft: Shaft,
    active: Active<NZ, NX>,
    mismatch: Mismatch,
    /// Standard deviations of the level above, while a lower one is on trial.
    trial_std: [f32; MAX_LOADS],
    /// Samples in a row that used every sensor.
    calm: u32,
    /// Samples in a row that corrected those before them.
    corrected: u32,
    age: u16,
    started: bool,
}

impl<'a, const NZ: usize, const NX: usize> Rotor<'a, NZ, NX> {
    /// Checks a model and lays it out for the step.
    ///
    /// # Errors
    /// The name of the first field that is not finite, not positive where it
    /// must be, or of the wrong length for `NX` states.
    pub fn try_build(model: RotorModel<'a>) -> Result<Self, Error> {
        const { assert!(NZ <= MAX_MODES && NX <= MAX_STATES, "states of a rotor") };
        model.check(NZ, NX)?;
        let rows = model.channels.iter().map(|channel| {
            let mut modal = [0.0; NZ];
            for (slot, value) in modal.iter_mut().zip(&channel.row) {
                *slot = *value;
            }
            Row {
                modal,
                bias: channel.bias_state.map(usize::from),
            }
        });
        let described = *model.levels.first().ok_or(Error::OutOfRange("levels"))?;
        let (along, across) = turned(model.speeds.nominal * model.sample_s, 1.0);
        Ok(Self {
            rows: rows.collect(),
            converters: model.channels.iter().map(|c| c.converter).collect(),
            counters: model.encoder.iter().map(|e| e.counter).collect(),
            constant: Turn {
                turning: model.turning,
                pairs: model.loads.len() / 2,
                along,
                across,
                left: model.left,
            },
            described,
            model,
        })
    }

    /// The state before the first sample, which fills it: empty, it is made where
    /// it stays, and not on the stack.
    #[inline]
    pub fn start(&self) -> RotorState<NZ, NX> {
        RotorState {
            unwrap: Unwrap::default(),
            belief: Belief {
                state: [0.0; NX],
                covariance: [[0.0; NX]; NX],
            },
            past: Past::new(Moment::unknown(self.model.speeds.nominal)),
            votes: Votes::default(),
            shaft: Shaft::new(self.model.speeds.nominal),
            active: Active::new(),
            mismatch: Mismatch::default(),
            trial_std: [0.0; MAX_LOADS],
            calm: 0,
            corrected: 0,
            age: u16::MAX,
            started: false,
        }
    }

    /// Samples by which the estimates lag.
    pub fn lag(&self) -> usize {
        usize::from(self.model.lag).min(MAX_LAG)
    }

    /// One sample: convert, predict, update with each usable reading.
    // Inlined, the stack would hold the temporaries of all sizes at once.
    #[inline(never)]
    pub fn step(&self, state: &mut RotorState<NZ, NX>, raw: &RawSample) -> Estimate {
        let index = self.model.index.as_ref();
        let m = (state.unwrap).convert(
            raw,
            &self.converters,
            &self.counters,
            index,
            Phase::default(),
        );
        let fresh = !state.started || m.lost > LONGEST_GAP;
        if fresh {
            self.restart(state);
        }
        if let Some(by) = m.rehomed {
            state.shaft.turn(by);
        }
        let speed = state.shaft.speed;
        let turn = self.turn(state, &m);
        let steady = state.calm >= self.noise(state).full_samples && !self.counts_nothing(&m);
        if !fresh && !m.stale {
            for _ in 0..=m.lost {
                if self.lag() > 0 {
                    state.past.push().take::<NZ>(&state.belief, speed);
                }
                predict_state(&mut state.belief.state, &state.active.dense, &turn);
                if !steady {
                    self.predict_covariance(state, &turn);
                }
            }
        }
        state.age = state.age.saturating_add(1);
        let mut estimate = Estimate {
            tick: m.tick,
            lost: m.lost,
            angle_rad: state.shaft.angle().to_rad(),
            homed: m.homed || index.is_none(),
            ..Estimate::default()
        };
        let zeros = self.zeros(&estimate);
        if !(steady && self.correct(state, &m, &zeros, &mut estimate)) {
            if steady {
                self.predict_covariance(state, &turn);
            }
            self.update(state, &m, &zeros, &mut estimate);
            state.started = self.believes(state);
        }
        self.loads(state, &mut estimate);
        self.judge(state, &m, &estimate.sensors);
        for angle in m.angles.iter().take(self.counters.len()) {
            let _ = estimate.sensors.push(SensorEstimate {
                measured: angle.map_or(0.0, Phase::to_rad),
                fault: angle.err().unwrap_or(Fault::None),
                ..SensorEstimate::default()
            });
        }
        estimate
    }

    /// Whether the innovations still agree with the noise in use.
    fn judge(&self, state: &mut RotorState<NZ, NX>, m: &Measurement, sensors: &[SensorEstimate]) {
        let levels = self.model.levels.len() as u8;
        if m.stale || levels < 2 {
            return;
        }
        if m.lost > 0 {
            state.mismatch.skip();
        }
        if let Some(change) = state.mismatch.push(sensors, levels) {
            self.turn_to(state, change);
        }
    }

    /// The noise that the filter has at present.
    fn noise(&self, state: &RotorState<NZ, NX>) -> &Noise<'a> {
        let level = usize::from(state.mismatch.level());
        self.model.levels.get(level).unwrap_or(&self.described)
    }

    /// Another noise from now on. A larger one begins at its steady covariance and gain, and a
    /// smaller one too, but for that of the description, which converges by the full recursion.
    #[cold]
    fn turn_to(&self, state: &mut RotorState<NZ, NX>, change: Change) {
        let level = usize::from(state.mismatch.level());
        let described = level == 0;
        if change == Change::Lowered {
            for (j, std) in state.trial_std.iter_mut().enumerate() {
                *std = state.active.load_std[j % MAX_LOADS];
            }
        }
        let from = if described { level + 1 } else { level };
        if let Some(noise) = self.model.levels.get(from) {
            noise.covariance.fill(&mut state.belief.covariance);
        }
        let noise = self.noise(state);
        state.calm = if described { 0 } else { noise.full_samples };
        state.corrected = 0;
        state.votes = Votes::default();
        state.active.begin(&self.model, noise, state.shaft.speed);
    }

    /// Whether the forces and their variances are numbers.
    fn believes(&self, state: &RotorState<NZ, NX>) -> bool {
        let Belief { state, covariance } = &state.belief;
        (2 * NZ..2 * NZ + self.model.loads.len())
            .all(|d| state[d % NX].is_finite() && covariance[d % NX][d % NX].is_finite())
    }

    /// Whether no reading corrected the state for longer than a gap may be.
    fn silent(state: &RotorState<NZ, NX>) -> bool {
        u32::from(state.age) > LONGEST_GAP
    }

    fn restart(&self, state: &mut RotorState<NZ, NX>) {
        state.belief.state.fill(0.0);
        (self.model.initial_covariance).fill(&mut state.belief.covariance);
        state.mismatch = Mismatch::default();
        state.votes = Votes::default();
        state.shaft = Shaft::new(self.model.speeds.nominal);
        state.past = Past::new(Moment::unknown(state.shaft.speed));
        let noise = self.noise(state);
        state.active.begin(&self.model, noise, state.shaft.speed);
        state.calm = 0;
        state.corrected = 0;
        state.age = u16::MAX;
        state.started = true;
    }

    /// Whether a sensor is missing, or samples are, for which the steady gain was not made.
    fn counts_nothing(&self, m: &Measurement) -> bool {
        m.lost > 0 || m.values.iter().take(self.rows.len()).any(Result::is_err)
    }

    /// The shaft one sample on, and the matrices after its speed.
    fn turn(&self, state: &mut RotorState<NZ, NX>, m: &Measurement) -> Turn<f32> {
        // In a sample that comes twice, or late, no time passes.
        if m.stale {
            return self.constant;
        }
        let reading = m.angles.first().and_then(|angle| angle.ok());
        let (dt, samples) = (self.model.sample_s, m.lost.saturating_add(1));
        let encoder = self.model.encoder.as_ref();
        let motion = state
            .shaft
            .advance(dt, samples.min(LONGEST_GAP), reading, encoder);
        if encoder.is_none() {
            return self.constant;
        }
        let noise = self.noise(state);
        state.active.follow(&self.model, noise, motion.speed);
        // The turn of one of the samples that were lost.
        let each = motion.turned / samples as f32;
        let (along, across) = turned(each, motion.growth);
        Turn {
            along,
            across,
            ..self.constant
        }
    }

    /// Reading of each sensor of a shaft on its axis, as it stands; without runout where it is
    /// not known how it stands.
    fn zeros(&self, estimate: &Estimate) -> [f32; MAX_CHANNELS] {
        let channels = &self.model.channels;
        let mut waves = [[0.0; 2]; WAVES];
        if estimate.homed && channels.iter().any(|c| !c.runout.is_empty()) {
            let (cosine, sine) = (
                libm::cosf(estimate.angle_rad),
                libm::sinf(estimate.angle_rad),
            );
            let mut last = [1.0, 0.0];
            for wave in &mut waves {
                last = [
                    last[0] * cosine - last[1] * sine,
                    last[1] * cosine + last[0] * sine,
                ];
                *wave = last;
            }
        }
        let mut zeros = [0.0; MAX_CHANNELS];
        for (zero, channel) in zeros.iter_mut().zip(channels) {
            *zero = channel.zero(&waves);
        }
        zeros
    }

    /// Where no reading confirms the smaller noise, the larger one.
    fn predict_covariance(&self, state: &mut RotorState<NZ, NX>, turn: &Turn<f32>) {
        let largest = self.model.levels.last().filter(|_| Self::silent(state));
        let noise = &largest.unwrap_or_else(|| self.noise(state)).process;
        let p = &mut state.belief.covariance;
        predict_covariance(p, &state.active.dense, turn, |i| noise.get(i));
    }

    /// Every channel by the steady gain; false where one is outside of its gate,
    /// and the state as predicted.
    fn correct(
        &self,
        state: &mut RotorState<NZ, NX>,
        m: &Measurement,
        zeros: &[f32; MAX_CHANNELS],
        estimate: &mut Estimate,
    ) -> bool {
        let mut innovations = [0.0; MAX_CHANNELS];
        let sensors = (self.rows.iter().zip(zeros)).zip(&state.active.variance);
        for (((row, zero), variance), (slot, value)) in
            sensors.zip(innovations.iter_mut().zip(&m.values))
        {
            let Ok(value) = value else {
                return false;
            };
            let nu = value - zero - predicted(&state.belief.state, row);
            let within = nu * nu <= self.model.gate_nis * variance;
            if !within {
                return false;
            }
            *slot = nu;
        }
        let [newest, before @ ..] = &state.active.gains;
        let before = before.get(..self.lag()).unwrap_or_default();
        let innovations = innovations.get(..self.rows.len()).unwrap_or_default();
        state.past.correct(before, innovations);
        let gains = newest.iter().zip(&state.active.variance);
        for (((gain, variance), nu), (channel, value)) in
            (gains.zip(innovations)).zip(self.model.channels.iter().zip(&m.values))
        {
            for j in 0..NX {
                state.belief.state[j] += gain[j] * nu;
            }
            let sensor = SensorEstimate {
                measured: value.unwrap_or(0.0) * channel.unit,
                innovation: nu * channel.unit,
                innovation_variance: variance * (channel.unit * channel.unit),
                nis: nu * nu / variance,
                fault: Fault::None,
            };
            let _ = estimate.sensors.push(sensor);
        }
        estimate.steady = true;
        state.corrected = state.corrected.saturating_add(1);
        state.age = 0;
        true
    }

    /// Each channel by the full recursion.
    fn update(
        &self,
        state: &mut RotorState<NZ, NX>,
        m: &Measurement,
        zeros: &[f32; MAX_CHANNELS],
        estimate: &mut Estimate,
    ) {
        let sensors = self.rows.len();
        state.votes.begin(sensors);
        if !m.stale {
            state.corrected = 0;
        }
        // Of samples that were lost, no steady gain knows.
        let mut all = m.lost == 0;
        for (i, (row, channel)) in self.rows.iter().zip(&self.model.channels).enumerate() {
            let value = match m.values.get(i) {
                Some(Ok(value)) => *value,
                Some(Err(fault)) => {
                    all = false;
                    let _ = estimate.sensors.push(SensorEstimate {
                        fault: *fault,
                        ..SensorEstimate::default()
                    });
                    continue;
                }
                None => continue,
            };
            let votes = &mut state.votes;
            let (told, used) = update(
                &mut state.belief,
                row,
                value - zeros[i % MAX_CHANNELS],
                channel.variance,
                |nis| votes.admits(i, sensors, nis <= self.model.gate_nis),
            );
            if used {
                state.age = 0;
            }
            all &= used;
            let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
            let _ = estimate.sensors.push(SensorEstimate {
                measured: value * channel.unit,
                innovation: finite(told.innovation) * channel.unit,
                innovation_variance: finite(told.variance) * (channel.unit * channel.unit),
                nis: finite(told.nis),
                fault: if used {
                    Fault::None
                } else if told.nis.is_finite() {
                    Fault::Erratic
                } else {
                    Fault::NotValid
                },
            });
        }
        state.calm = match all {
            _ if m.stale => state.calm,
            true => state.calm.saturating_add(1),
            false => 0,
        };
    }
}
