//! The wheel bearing: forces and moments from gauges on the outer ring.
//!
//! Every sample is gathered into a [`block`]; 100 times a second two beliefs
//! ([`joint`]) take in the block: the champion, whose loads are the estimate, and
//! a challenger with the rows' labels swapped or their phases moved. A challenger
//! that explains the readings better takes the champion's place. That is how the
//! phases are found at a start, and how a swap of labels at a reversal of the moment is undone.
//!
//! The work on a block is spread over the samples of the next one.
//!
//! Source: Kerst et al. 2019, section IV, in another form.

pub mod block;
pub mod contact;
pub mod joint;
mod trust;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::estimate::{Estimate, LoadEstimate, MAX_LOADS, SensorEstimate};
use crate::fault::Fault;
use crate::image::LoadSignal;
use crate::measurement::{Converter, Counter, Measurement, Unwrap};
use crate::phase::{Phase, wrap_rad};
use crate::raw::{MAX_CHANNELS, RawSample};
use block::{Block, Sums};
use contact::{Contacts, Equilibrium, Geometry};
use joint::{Belief, LOAD, Told};
use trust::Trust;

/// Rows of balls.
pub const ROWS: usize = 2;
/// Gauges on the outer ring.
pub const GAUGES: usize = 4;
/// Loads: `Fx, Fy, Fz, Mx, Mz`.
pub const LOADS: usize = 5;
/// Harmonics of ball passing.
pub const HARMONICS: usize = 3;
/// Features of a contact that a gauge answers to.
pub const FEATURES: usize = 4;
/// Functions of the phase that a block is gathered over.
pub const BASIS: usize = 1 + 2 * HARMONICS;

/// Blocks a second.
pub const BLOCK_HZ: f32 = 100.0;

/// Jobs of a block: champion, challenger, judgement.
const JOBS: u16 = 2 * BELIEF_JOBS + 1;
const BELIEF_JOBS: u16 = 8;

/// Starting points of challengers: eight moves of the phases, and between them
/// swapped labels and loads anew.
const CANDIDATES: u8 = 16;
/// The one that swapped labels follow.
const BEFORE_MIRROR: u8 = CANDIDATES - 1;

/// Blocks of a duel, and those at its start that do not count.
const DUEL: u16 = 24;
const BURN_IN: u16 = 10;
/// The same before the champion has met its first challenge.
const FIRST_DUEL: u16 = 14;
const FIRST_BURN_IN: u16 = 6;

/// By how much the challenger's cost must be lower, and by how much it may be
/// higher before the duel is over.
const MARGIN: f32 = 30.0;
const HOPELESS: f32 = 400.0;

/// Natural frequency of the loop that follows the wheel [rad/s].
const WHEEL_BANDWIDTH: f32 = 30.0;

/// Blocks over which a gauge is judged.
const JUDGED_BLOCKS: f32 = 50.0;

/// A model of a bearing, as the image holds it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BearingModel {
    /// `Fx, Fy, Fz, Mx, Mz`; forces [N], moments [N m].
    pub loads: Vec<LoadSignal, MAX_LOADS>,
    /// The gauges in the order of the board's words.
    pub gauges: [GaugeModel; GAUGES],
    /// The wheel's encoder.
    pub counter: Counter,
    /// Balls that pass a point of the outer ring in a turn of the wheel, not 0.
    pub passes_per_turn: f32,
    /// The bearing.
    pub geometry: Geometry,
    /// The filter's tuning.
    pub tuning: Tuning,
}

/// How one gauge answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GaugeModel {
    /// Word to strain [um/m].
    pub converter: Converter,
    /// `N psi_g`: phase of ball passing at the gauge [rad].
    pub passing: f32,
    /// Standard deviation of a reading about the model [um/m], > 0.
    pub noise_std: f32,
    /// Error of the local strain's model, as part of the strain.
    pub model_error: f32,
    /// Bulk strain at no load when calibrated [um/m].
    pub offset: f32,
    /// Bulk strain by the loads [um/m / kN].
    pub bulk_load: [f32; LOADS],
    /// Bulk strain by the features of each row [um/m / kN].
    pub bulk_feature: [[f32; FEATURES]; ROWS],
    /// Local strain by row, harmonic and feature: real and imaginary part [um/m / kN].
    pub local: [[[[f32; 2]; FEATURES]; HARMONICS]; ROWS],
}

/// Tuning of the joint filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tuning {
    /// Time in which slip forgets [s], > 0.
    pub slip_time_s: f32,
    /// Standard deviation of slip, relative, > 0.
    pub slip_std: f32,
    /// Slip beyond which an estimate is not trusted, > 0.
    pub slip_limit: f32,
    /// Scatter of the phase [rad/sqrt(rad)].
    pub phase_walk: f32,
    /// Mean of the loads that are expected [kN].
    pub load_mean: [f32; LOADS],
    /// Lower factor of their covariance [kN]: those on the rig.
    pub load_factor: [[f32; LOADS]; LOADS],
    /// Time in which loads return to them [s], > 0.
    pub load_time_s: f32,
    /// Standard deviation of the preload [um] and its random walk [um/sqrt(s)].
    pub preload_std: f32,
    /// See `preload_std`.
    pub preload_walk: f32,
    /// Standard deviation of the biases [um/m] and the time in which they forget [s].
    pub bias_std: f32,
    /// See `bias_std`.
    pub bias_time_s: f32,
    /// Standard deviation of the local strains' gains and the time in which they forget [s].
    pub gain_std: f32,
    /// See `gain_std`.
    pub gain_time_s: f32,
    /// Error of the bulk strain's model from block to block [um/m].
    pub bulk_std: f32,
    /// Frequency of ball passing below which bulk and local strain cannot be told apart [Hz], > 0.
    pub lowest_hz: f32,
}

/// The estimator of a bearing, fixed after start.
#[derive(Clone, Debug)]
pub struct Bearing {
    model: BearingModel,
    contacts: Contacts,
    converters: [Converter; GAUGES],
    counters: [Counter; 1],
    dt_s: f32,
    block_samples: u16,
    jobs_per_sample: u16,
    /// Equilibrium at the expected loads.
    rest: Equilibrium,
}

/// What changes from sample to sample.
#[derive(Clone, Debug)]
pub struct BearingState {
    unwrap: Unwrap,
    wheel: Option<Phase>,
    /// Speed of the wheel [rad/s].
    speed: f32,
    sums: Sums,
    block: Block,
    job: u16,
    champion: Belief,
    challenger: Belief,
    told: [Told; GAUGES],
    health: [Health; GAUGES],
    cost: (f32, f32),
    trust: Trust,
    duel: Duel,
    running: bool,
    /// Loads that are known, on a rig [kN].
    known: Option<[f32; LOADS]>,
    published: [LoadEstimate; LOADS],
    age: u16,
}

/// The standing of a challenge.
#[derive(Clone, Copy, Debug, Default)]
struct Duel {
    candidate: u8,
    blocks: u16,
    /// Challenger's cost less the champion's.
    lead: f32,
    /// Challenges that the champion has met since it became one.
    won: u8,
}

/// A gauge's record over the last half second.
#[derive(Clone, Copy, Debug, Default)]
struct Health {
    nis: f32,
    read: f32,
    predicted: f32,
    fault: Fault,
}

impl Bearing {
    /// Checks a model and lays it out.
    ///
    /// # Errors
    /// The name of the first number that is out of its range.
    pub fn try_build(model: BearingModel, rate_hz: f32) -> Result<Self, Error> {
        if model.loads.len() != LOADS {
            return Err(Error::OutOfRange("number of loads"));
        }
        let t = &model.tuning;
        let positive = [
            ("slip_time_s", t.slip_time_s),
            ("slip_std", t.slip_std),
            ("load_time_s", t.load_time_s),
            ("slip_limit", t.slip_limit),
            ("preload_std", t.preload_std),
            ("bias_std", t.bias_std),
            ("bias_time_s", t.bias_time_s),
            ("bulk_std", t.bulk_std),
            ("gain_std", t.gain_std),
            ("gain_time_s", t.gain_time_s),
            ("lowest_hz", t.lowest_hz),
            ("noise_std", model.gauges[0].noise_std),
            ("noise_std", model.gauges[1].noise_std),
            ("noise_std", model.gauges[2].noise_std),
            ("noise_std", model.gauges[3].noise_std),
        ];
        for (name, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::NotPositive(name));
            }
        }
        for (i, row) in t.load_factor.iter().enumerate() {
            if !(row[i] > 0.0 && row.iter().all(|value| value.is_finite())) {
                return Err(Error::NotPositive("load_factor"));
            }
        }
        if !(model.passes_per_turn != 0.0 && model.passes_per_turn.is_finite()) {
            return Err(Error::OutOfRange("passes_per_turn"));
        }
        let block = libm::roundf(rate_hz / BLOCK_HZ).clamp(1.0, 1000.0) as u16;
        let contacts = Contacts::try_new(model.geometry.clone())?;
        let rest = contacts.settle(&t.load_mean, 0.0);
        Ok(Self {
            converters: [0, 1, 2, 3].map(|g| model.gauges[g].converter),
            counters: [model.counter],
            dt_s: 1.0 / rate_hz,
            block_samples: block,
            jobs_per_sample: JOBS.div_ceil(block),
            contacts,
            model,
            rest,
        })
    }

    /// The state before the first sample; the first block fills its beliefs.
    #[inline]
    pub fn start(&self) -> BearingState {
        BearingState {
            unwrap: Unwrap::default(),
            wheel: None,
            speed: 0.0,
            sums: Sums::default(),
            block: Block::default(),
            job: JOBS,
            champion: Belief::blank(),
            challenger: Belief::blank(),
            told: [Told::default(); GAUGES],
            health: [Health::default(); GAUGES],
            cost: (0.0, 0.0),
            duel: Duel::default(),
            trust: Trust::default(),
            running: false,
            known: None,
            published: [UNKNOWN; LOADS],
            age: u16::MAX,
        }
    }

    /// One sample: gather it, and do the jobs of the block before that are due.
    #[inline(never)]
    pub fn step(&self, state: &mut BearingState, raw: &RawSample) -> Estimate {
        let m = (state.unwrap).convert(
            raw,
            &self.converters,
            &self.counters,
            None,
            Phase::default(),
        );
        let phase = self.follow_wheel(state, &m);
        let mut readings = [None; GAUGES];
        for (reading, value) in readings.iter_mut().zip(&m.values) {
            *reading = value.ok();
        }
        state.sums.add(phase, &readings);
        for _ in 0..self.jobs_per_sample {
            self.work(state);
        }
        if state.sums.count >= self.block_samples {
            self.close_block(state);
        }
        state.age = state.age.saturating_add(1);
        estimate(state, &m)
    }

    /// Phase of ball passing since the last sample [rad], from the wheel's
    /// counter through a loop that smooths its steps.
    fn follow_wheel(&self, state: &mut BearingState, m: &Measurement) -> f32 {
        let elapsed = self.dt_s * (m.lost.min(1000) + 1) as f32;
        let mut turned = state.speed * elapsed;
        let angle = m
            .angles
            .first()
            .copied()
            .unwrap_or(Err(Fault::Missing))
            .ok();
        match (state.wheel, angle) {
            (Some(wheel), Some(angle)) => {
                let predicted = wheel.turned_by(Phase::from_rad(turned));
                let error = angle.since(predicted).to_rad();
                let by_angle = (core::f32::consts::SQRT_2 * WHEEL_BANDWIDTH * elapsed).min(1.0);
                turned += by_angle * error;
                state.speed += WHEEL_BANDWIDTH * WHEEL_BANDWIDTH * elapsed * error;
                state.wheel = Some(wheel.turned_by(Phase::from_rad(turned)));
            }
            (Some(wheel), None) => state.wheel = Some(wheel.turned_by(Phase::from_rad(turned))),
            (None, found) => {
                state.wheel = found;
                turned = 0.0;
            }
        }
        turned * self.model.passes_per_turn
    }

    fn close_block(&self, state: &mut BearingState) {
        let passing_hz = (state.speed * self.model.passes_per_turn).abs() / core::f32::consts::TAU;
        let fast_enough = passing_hz >= self.model.tuning.lowest_hz;
        if !fast_enough {
            // Hysteresis is not needed: a start is a search whatever its cause.
            state.running = false;
            state.job = JOBS;
            state.published = [UNKNOWN; LOADS];
        } else if !state.running {
            state.running = true;
            self.begin(&mut state.champion);
            state.duel = Duel::default();
            state.trust = Trust::default();
            self.challenge(state);
        }
        if state.running {
            state.block = state.sums.whitened();
            state.job = 0;
        }
        state.sums = Sums::default();
    }

    fn begin(&self, belief: &mut Belief) {
        belief.begin(&self.model.tuning, &self.contacts, &self.rest);
    }

    /// The next job of the current block.
    fn work(&self, state: &mut BearingState) {
        let job = state.job;
        if job >= JOBS {
            return;
        }
        state.job = job + 1;
        let tuning = &self.model.tuning;
        let dt_s = self.dt_s * f32::from(state.block.count);
        let challenger = job >= BELIEF_JOBS;
        let belief = if challenger {
            &mut state.challenger
        } else {
            &mut state.champion
        };
        match job % BELIEF_JOBS {
            _ if job == JOBS - 1 => self.judge(state),
            0 => {
                belief.predict(tuning, state.block.phase, dt_s);
                if let Some(known) = state.known {
                    belief.know(&known);
                }
            }
            part @ 1..=4 => {
                let g = usize::from(part) - 1;
                let used =
                    state.block.whole[g % GAUGES] && state.health[g % GAUGES].fault.is_none();
                let told = belief.update(
                    &self.model.gauges[g % GAUGES],
                    tuning,
                    &state.block,
                    g,
                    used,
                );
                let cost = if used { told.cost } else { 0.0 };
                if challenger {
                    state.cost.1 += cost;
                } else {
                    state.cost.0 += cost;
                    state.told[g % GAUGES] = told;
                    self.watch(state, g);
                    if part == 4 {
                        self.scrutinise(state);
                        self.publish(state);
                    }
                }
            }
            5 => belief.balance(&self.contacts),
            part => {
                let first = 2 * (usize::from(part) - 6);
                belief.refresh(&self.contacts, first);
                belief.refresh(&self.contacts, first + 1);
            }
        }
    }

    /// Judges the champion by what the gauges said of the block.
    fn scrutinise(&self, state: &mut BearingState) {
        let mut used = state.block.whole;
        for (used, health) in used.iter_mut().zip(&state.health) {
            *used &= health.fault.is_none();
        }
        let prior = state.champion.prior(&self.model.tuning);
        (state.trust).take(&state.told, used, &self.model.gauges, prior);
    }

    /// Follows what one gauge says over half a second.
    fn watch(&self, state: &mut BearingState, g: usize) {
        let (told, health) = (&state.told[g % GAUGES], &mut state.health[g % GAUGES]);
        if !state.block.whole[g % GAUGES] {
            return;
        }
        let share = 1.0 / JUDGED_BLOCKS;
        health.nis += share * (told.nis - health.nis);
        health.read += share * (told.local.0 - health.read);
        health.predicted += share * (told.local.1 - health.predicted);
        let noise = self.model.gauges[g % GAUGES].noise_std;
        let silent = health.read < 3.0 * noise && health.predicted > 6.0 * noise;
        let heard = health.read > 4.0 * noise;
        health.fault = match health.fault {
            Fault::None if silent => Fault::Stuck,
            Fault::Stuck if heard => Fault::None,
            fault => fault,
        };
    }

    /// Ends the block: who explains the readings better?
    fn judge(&self, state: &mut BearingState) {
        let (champion, challenger) = state.cost;
        state.cost = (0.0, 0.0);
        if state.known.is_none() && state.trust.is_lost() {
            state.running = false;
            return;
        }
        let duel = &mut state.duel;
        if state.known.is_none() && state.trust.begins_to_doubt() && duel.won > 0 {
            duel.candidate = BEFORE_MIRROR;
            self.challenge(state);
            return;
        }
        duel.blocks = duel.blocks.saturating_add(1);
        let (length, burn_in) = if duel.won > 0 {
            (DUEL, BURN_IN)
        } else {
            (FIRST_DUEL, FIRST_BURN_IN)
        };
        if duel.blocks > burn_in {
            duel.lead += challenger - champion;
        }
        let broken = !state.champion.is_finite();
        if duel.blocks >= length || duel.lead > HOPELESS || broken {
            let prior = state.challenger.prior(&self.model.tuning)
                - state.champion.prior(&self.model.tuning);
            if broken || duel.lead + prior < -MARGIN {
                core::mem::swap(&mut state.champion, &mut state.challenger);
                if broken || state.champion.is_apart(&state.challenger) {
                    state.duel.won = 0;
                    state.duel.candidate = BEFORE_MIRROR;
                    state.trust = Trust::default();
                }
                if !state.champion.is_finite() {
                    self.begin(&mut state.champion);
                }
            } else {
                state.duel.won = duel.won.saturating_add(1);
            }
            self.challenge(state);
        }
    }

    /// Sends the next challenger out.
    fn challenge(&self, state: &mut BearingState) {
        let tuning = &self.model.tuning;
        let duel = &mut state.duel;
        duel.candidate = (duel.candidate + 1) % CANDIDATES;
        duel.blocks = 0;
        duel.lead = 0.0;
        state.challenger = state.champion.clone();
        let next = &mut state.challenger;
        let moved = duel.candidate / 2 + 1;
        let mirrored = duel.candidate.is_multiple_of(4);
        match duel.candidate % 4 {
            0 => next.swap_rows(),
            2 => next.forget_loads(tuning),
            _ => {
                // Thirds of a turn in both phases, all but (0, 0).
                let third = core::f32::consts::TAU / 3.0;
                next.turn(0, third * f32::from(moved % 3));
                next.turn(1, third * f32::from(moved / 3));
            }
        }
        for row in 0..ROWS {
            next.widen(row, 0.5);
            next.widen(ROWS + row, tuning.slip_std * tuning.slip_std);
        }
        next.widen_loads(tuning, 0.25);
        if duel.won == 0 || mirrored && state.trust.is_doubted() {
            // Later they are what is known best, and tell the labels apart.
            next.forget_gauges(tuning);
        }
        next.balance(&self.contacts);
        next.balance(&self.contacts);
        for g in 0..GAUGES {
            next.refresh(&self.contacts, g);
        }
    }

    fn publish(&self, state: &mut BearingState) {
        state.age = 0;
        let locked = state.is_locked();
        let radius = self.model.geometry.radius_mm;
        let slipped = (0..ROWS).any(|row| {
            state.champion.gaussian.state[ROWS + row].abs() > self.model.tuning.slip_limit
        });
        for i in 0..LOADS {
            // kN; moments over the radius [mm] in kN: N m.
            let unit = if i < 3 { 1000.0 } else { radius };
            let value = state.champion.gaussian.state[LOAD + i] * unit;
            let variance = state.champion.gaussian.upper[LOAD + i][LOAD + i];
            let std = libm::sqrtf(variance.max(0.0)) * unit;
            let limit = self.model.loads.get(i).map_or(0.0, |load| load.valid_std);
            state.published[i] = if locked && value.is_finite() && std <= limit {
                LoadEstimate {
                    value,
                    std,
                    age: 0,
                    fault: if slipped { Fault::Slipped } else { Fault::None },
                }
            } else {
                UNKNOWN
            };
        }
    }
}

/// What is said after a sample.
fn estimate(state: &BearingState, m: &Measurement) -> Estimate {
    let mut estimate = Estimate {
        tick: m.tick,
        lost: m.lost,
        angle_rad: wrap_rad(state.wheel.map_or(0.0, Phase::to_rad)),
        homed: true,
        ..Estimate::default()
    };
    for load in &state.published {
        let _ = estimate.loads.push(LoadEstimate {
            age: state.age,
            ..*load
        });
    }
    for (g, (told, health)) in state.told.iter().zip(&state.health).enumerate() {
        let reading = m.values.get(g).copied().unwrap_or(Err(Fault::Missing));
        let known = if state.running {
            *told
        } else {
            Told::default()
        };
        let _ = estimate.sensors.push(SensorEstimate {
            measured: reading.unwrap_or(0.0) * STRAIN,
            innovation: known.mean.0 * STRAIN,
            innovation_variance: known.mean.1 * (STRAIN * STRAIN),
            nis: known.nis,
            fault: reading.err().unwrap_or(health.fault),
        });
    }
    let angle = m.angles.first().copied().unwrap_or(Err(Fault::Missing));
    let _ = estimate.sensors.push(SensorEstimate {
        measured: angle.map_or(0.0, Phase::to_rad),
        fault: angle.err().unwrap_or(Fault::None),
        ..SensorEstimate::default()
    });
    estimate
}
/// A load of which nothing is known.
const UNKNOWN: LoadEstimate = LoadEstimate {
    value: 0.0,
    std: f32::MAX,
    age: u16::MAX,
    fault: Fault::NotValid,
};

/// SI size of the strains' unit.
const STRAIN: f32 = 1e-6;

const _: () = assert!(GAUGES <= MAX_CHANNELS && LOADS <= MAX_LOADS);

impl BearingState {
    /// Tells the filter the loads [kN], on a rig; moments over the radius.
    pub fn know(&mut self, loads: [f32; LOADS]) {
        self.known = Some(loads);
    }

    /// The champion and the block that it took in last, once it has taken it in
    /// whole: at the sample that ends the jobs of that block.
    pub fn taken_in(&self) -> Option<(&Block, &Belief)> {
        (self.running && self.job == JOBS - 1).then_some((&self.block, &self.champion))
    }

    /// Whether the champion can be believed: it has met a challenge, explains the
    /// readings and is plausible; with known loads, that it has met every challenge.
    pub fn is_locked(&self) -> bool {
        let met = if self.known.is_some() {
            self.duel.won >= CANDIDATES
        } else {
            self.duel.won > 0 && self.trust.is_earned()
        };
        self.running && met
    }
}
