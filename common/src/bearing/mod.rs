//! Estimates forces and moments on a wheel bearing from four strain gauges on its outer ring and
//! the wheel's encoder, one raw sample at a time (`BearingEstimator::step`), by an extended Kalman
//! filter for each of two hypotheses of the ball phases.
//!
//! Every sample is gathered into a [`harmonic_block`]; 100 times a second two hypotheses
//! ([`ekf`]) take in the block: the primary, whose loads are the estimate, and
//! an alternative with the rows' labels swapped or their phases moved. An alternative
//! that explains the readings better takes the primary's place. That is how the
//! phases are found at a start, and how a swap of labels at a reversal of the moment is undone.
//!
//! The work on a block is spread over the samples of the next one.
//!
//! Source: Kerst et al. 2019, section IV, in another form.

pub mod bias_prior;
pub mod contact;
pub mod ekf;
mod encoder_health;
mod gauge_exclusion;
mod gauge_health;
pub mod harmonic_block;
mod hypothesis_test;
mod isolation;
mod lock_detector;
mod model;
mod output;
mod slow_state_consistency;
mod wheel_pll;

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::bearing::bias_prior::{BiasPrior, Hold};
use crate::bearing::contact::{Contacts, Equilibrium};
use crate::bearing::ekf::{BlockInnovation, JointEkf, KNOWN_PHASE};
use crate::bearing::encoder_health::EncoderHealth;
use crate::bearing::gauge_exclusion::GaugeExclusion;
use crate::bearing::gauge_health::GaugeHealth;
use crate::bearing::harmonic_block::{HarmonicBlock, HarmonicSums};
use crate::bearing::hypothesis_test::{CANDIDATES, HypothesisTest, is_far_from_reversal};
use crate::bearing::isolation::Isolation;
use crate::bearing::lock_detector::LockDetector;
use crate::bearing::output::{NO_ESTIMATE, fill};
use crate::bearing::slow_state_consistency::Consistency;
use crate::bearing::wheel_pll::WheelPll;
use crate::io::estimate::{Estimate, LoadEstimate, MAX_LOADS};
use crate::io::fault::Fault;
use crate::io::measurement::{AdcScaling, EncoderScaling, SignalConditioner};
use crate::io::raw::{MAX_CHANNELS, RawSample};
use crate::signal::phase::Phase;

pub use crate::bearing::model::{BearingModel, GaugeModel, Tuning};

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
/// Functions of the phase that the samples of a block are projected on.
pub const BASIS: usize = 1 + 2 * HARMONICS;

/// Blocks a second.
pub const BLOCK_HZ: f32 = 100.0;

/// Lost samples that are counted at most: more are a new start of the sampling.
const LONGEST_GAP: u32 = 1000;

/// Jobs of a block: primary, alternative, assessment.
const STAGES: u16 = 2 * STAGES_PER_HYPOTHESIS + 1;

/// Jobs of a block for one hypothesis, in the order of `run_stage`.
const STAGES_PER_HYPOTHESIS: u16 = 8;

/// The estimator of a bearing, fixed after start.
#[derive(Clone, Debug)]
pub struct BearingEstimator {
    model: BearingModel,
    contacts: Contacts,
    converters: [AdcScaling; GAUGES],
    counters: [EncoderScaling; 1],
    dt_s: f32,
    block_samples: u16,
    stages_per_sample: u16,
    /// Equilibrium at the expected loads.
    rest: Equilibrium,
}

/// What changes from sample to sample.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BearingState {
    unwrap: SignalConditioner,
    wheel: WheelPll,
    sums: HarmonicSums,
    block: HarmonicBlock,
    stage: u16,
    /// Whether the primary's last job of a block was done with the last sample.
    updated: bool,
    primary: JointEkf,
    alternative: JointEkf,
    innovations: [BlockInnovation; GAUGES],
    health: GaugeHealth,
    exclusion: GaugeExclusion,
    isolation: Isolation,
    /// Gauges whose readings of the block the primary has refused.
    refused: [bool; GAUGES],
    encoder: EncoderHealth,
    cost: (f32, f32),
    lock: LockDetector,
    test: HypothesisTest,
    /// Preload and biases, as estimated while the rows were distinguished from their mirror image.
    offsets: BiasPrior,
    consistency: Consistency,
    running: bool,
    /// Loads that are known, on a rig [kN].
    known: Option<[f32; LOADS]>,
    published: [LoadEstimate; LOADS],
    age: u16,
}

impl BearingEstimator {
    /// Checks a model and lays it out.
    ///
    /// # Errors
    /// The name of the first number that is out of its range.
    pub fn try_build(model: BearingModel, rate_hz: f32) -> Result<Self, Error> {
        model.check()?;
        let t = &model.tuning;
        let block = libm::roundf(rate_hz / BLOCK_HZ).clamp(1.0, 1000.0) as u16;
        let contacts = Contacts::try_new(model.geometry.clone())?;
        let rest = contacts.solve_equilibrium(&t.load_mean, 0.0);
        Ok(Self {
            converters: [0, 1, 2, 3].map(|g| model.gauges[g].converter),
            counters: [model.counter],
            dt_s: 1.0 / rate_hz,
            block_samples: block,
            stages_per_sample: STAGES.div_ceil(block),
            contacts,
            model,
            rest,
        })
    }

    /// The state before the first sample; the first block fills its posteriors.
    #[inline]
    pub fn start(&self) -> BearingState {
        BearingState {
            unwrap: SignalConditioner::default(),
            wheel: WheelPll::default(),
            sums: HarmonicSums::default(),
            block: HarmonicBlock::default(),
            stage: STAGES,
            updated: false,
            primary: JointEkf::zeroed(),
            alternative: JointEkf::zeroed(),
            innovations: [BlockInnovation::default(); GAUGES],
            health: GaugeHealth::default(),
            exclusion: GaugeExclusion::default(),
            isolation: Isolation::default(),
            refused: [false; GAUGES],
            encoder: EncoderHealth::default(),
            cost: (0.0, 0.0),
            test: HypothesisTest::default(),
            lock: LockDetector::default(),
            offsets: BiasPrior::expected(&self.model.tuning),
            consistency: Consistency::default(),
            running: false,
            known: None,
            published: [NO_ESTIMATE; LOADS],
            age: u16::MAX,
        }
    }

    /// One sample: gather it, and do the jobs of the block before that are due.
    pub fn step(&self, state: &mut BearingState, raw: &RawSample) -> Estimate {
        let mut estimate = Estimate::default();
        self.step_into(state, raw, &mut estimate);
        estimate
    }

    /// As [`Self::step`], in its place.
    #[inline(never)]
    pub fn step_into(&self, state: &mut BearingState, raw: &RawSample, estimate: &mut Estimate) {
        let m = (state.unwrap).convert(
            raw,
            &self.converters,
            &self.counters,
            None,
            Phase::default(),
        );
        if m.stale {
            return fill(estimate, state, &m);
        }
        let lost = m.lost.min(LONGEST_GAP) as u16;
        let phase = state.wheel.update(&m, self.dt_s, lost) * self.model.passes_per_turn;
        if state.wheel.lost {
            state.lose_phases();
        }
        let mut readings = [None; GAUGES];
        for (reading, value) in readings.iter_mut().zip(&m.values) {
            *reading = value.ok();
        }
        state.sums.add(phase, lost, &readings);
        state.updated = false;
        for _ in 0..self.stages_per_sample {
            state.updated |= state.stage == STAGES_PER_HYPOTHESIS - 1;
            self.run_stage(state);
        }
        if state.sums.count >= self.block_samples {
            self.close_block(state);
        }
        state.age = state.age.saturating_add(lost + 1);
        fill(estimate, state, &m);
    }

    fn close_block(&self, state: &mut BearingState) {
        let passing_hz =
            (state.wheel.speed * self.model.passes_per_turn).abs() / core::f32::consts::TAU;
        let fast_enough = passing_hz >= self.model.tuning.lowest_hz;
        if !state.wheel.is_settled() {
            // Neither a start nor a stop: the speed is being found.
        } else if !fast_enough {
            // Hysteresis is not needed: a start is a search whatever its cause.
            state.running = false;
            state.exclusion.restart();
            state.encoder.update(&state.sums, &self.model.gauges);
            state.stage = STAGES;
            state.published = [NO_ESTIMATE; LOADS];
            // At rest a machine is serviced, and it cools: what comes after is compared anew.
            state.consistency = Consistency::default();
        } else if !state.running {
            state.encoder = EncoderHealth::default();
            state.running = true;
            self.begin(&mut state.primary, &state.offsets);
            state.exclusion.restart();
            state.test = HypothesisTest::default();
            state.lock = LockDetector::default();
            self.propose_alternative(state);
        }
        if state.running {
            state.block = state.sums.solve();
            state.stage = 0;
        }
        state.sums = HarmonicSums::default();
    }

    fn begin(&self, hypothesis: &mut JointEkf, offsets: &BiasPrior) {
        hypothesis.initialise(&self.model.tuning, &self.contacts, &self.rest, offsets);
    }

    /// The next job of the current block.
    fn run_stage(&self, state: &mut BearingState) {
        let stage = state.stage;
        if stage >= STAGES {
            return;
        }
        state.stage = stage + 1;
        let tuning = &self.model.tuning;
        let dt_s = self.dt_s * f32::from(state.block.elapsed);
        let alternative = stage >= STAGES_PER_HYPOTHESIS;
        let hypothesis = if alternative {
            &mut state.alternative
        } else {
            &mut state.primary
        };
        match stage % STAGES_PER_HYPOTHESIS {
            _ if stage == STAGES - 1 => self.decide(state),
            0 => {
                hypothesis.predict(tuning, state.block.phase, dt_s);
                if let Some(known) = state.known {
                    hypothesis.condition_on_loads(&known);
                }
                let strayed = tuning.slip_std * state.block.phase;
                if strayed * strayed > KNOWN_PHASE {
                    // Over a gap the cages slip by more than is known of them.
                    state.lose_phases();
                }
            }
            part @ 1..=4 => {
                self.update_by_gauge(state, usize::from(part) - 1, alternative);
                if part == 4 && !alternative {
                    self.update_monitors(state);
                    self.publish(state);
                }
            }
            5 => hypothesis.newton_step(&self.contacts),
            part => {
                let first = 2 * (usize::from(part) - 6);
                hypothesis.update_features(&self.contacts, first);
                hypothesis.update_features(&self.contacts, first + 1);
            }
        }
    }

    /// Updates a hypothesis with what one gauge read in the block, and adds its cost.
    fn update_by_gauge(&self, state: &mut BearingState, g: usize, alternative: bool) {
        let g = g % GAUGES;
        let (model, tuning) = (&self.model.gauges[g], &self.model.tuning);
        let mut used = state.block.complete[g] && state.fault(g).is_none();
        let hold = state.hold(alternative);
        if alternative {
            used &= !state.refused[g] && !state.isolation.leaves_out(g);
            let next = &mut state.alternative;
            let innovation = next.update(model, tuning, &state.block, g, used, hold);
            state.cost.1 += if used { innovation.cost } else { 0.0 };
            return;
        }
        let before = state.primary.gaussian;
        let innovation = (state.primary).update(model, tuning, &state.block, g, used, hold);
        state.refused[g] = used && state.exclusion.refuses(g, &innovation);
        if state.refused[g] {
            state.primary.gaussian = before;
        } else if used {
            state.cost.0 += innovation.cost;
        }
        state.innovations[g] = innovation;
    }

    /// Assesses primary and gauges by what was read in the block.
    fn update_monitors(&self, state: &mut BearingState) {
        let (innovations, gauges) = (&state.innovations, &self.model.gauges);
        // Its loss changed nothing where the gauge was left out before.
        let was_excluded = (0..GAUGES).any(|g| !state.exclusion.fault(g).is_none());
        let fell_silent = state.health.update(innovations, &state.block, gauges) && !was_excluded;
        let valid = state.is_locked()
            && state.consistency.is_settled()
            && is_far_from_reversal(&state.primary);
        (state.exclusion).update(innovations, state.refused, &state.block, gauges, valid);
        if state.holds_slow_states() {
            // A search with three gauges starts from what all of them have shown.
            state.offsets = state.consistency.reference().unwrap_or(state.offsets);
        }
        let mut used = state.block.complete;
        for (g, used) in used.iter_mut().enumerate() {
            *used &= state.fault(g).is_none() && !state.refused[g];
        }
        let prior = state.primary.prior_cost(&self.model.tuning);
        state.lock.update(innovations, used, gauges, prior);
        let silent_from_start =
            |g| !state.health.fault(g).is_none() && state.exclusion.fault(g).is_none();
        if (0..GAUGES).any(silent_from_start) {
            // Three gauges explain the loads by other slow states than four.
            state.consistency = Consistency::default();
        } else if !state.holds_slow_states() && state.known.is_none() {
            let locked = state.is_locked();
            let dt_s = self.dt_s * f32::from(state.block.elapsed);
            (state.consistency).update(&state.primary.offsets(), locked, &self.model.tuning, dt_s);
        }
        // What was estimated from a dead gauge before it was detected is discarded.
        state.running &= !fell_silent;
    }
}

const _: () = assert!(GAUGES <= MAX_CHANNELS && LOADS <= MAX_LOADS);

impl BearingState {
    /// The fault for which a gauge is left out, or none.
    pub(crate) fn fault(&self, g: usize) -> Fault {
        let silent = self.health.fault(g);
        if silent.is_none() {
            self.exclusion.fault(g)
        } else {
            silent
        }
    }

    /// Whether a gauge is left out, so that slow states are not updated.
    pub(crate) fn holds_slow_states(&self) -> bool {
        (0..GAUGES).any(|g| !self.exclusion.fault(g).is_none() || !self.block.complete[g])
    }

    /// Whether fewer than three gauges are left, of which no loads follow.
    pub(crate) fn lacks_gauges(&self) -> bool {
        let left_out =
            |g: &usize| !self.fault(*g).is_none() || !self.block.complete[*g] || self.refused[*g];
        (0..GAUGES).filter(left_out).count() > 1
    }

    /// Which slow states a hypothesis does not update.
    fn hold(&self, alternative: bool) -> Hold {
        let by_isolation = self.isolation.holds();
        if alternative && by_isolation != Hold::Nothing {
            by_isolation
        } else if self.holds_slow_states() && self.consistency.reference().is_some() {
            Hold::All
        } else {
            Hold::Nothing
        }
    }

    /// The phases are to be found again, and slow states to be compared from then on.
    fn lose_phases(&mut self) {
        self.test.tests_passed = 0;
        self.consistency = Consistency::default();
    }

    /// Sets loads that are known, on a rig: forces (kN), moments over the radius (kN).
    pub fn set_known_loads(&mut self, loads: [f32; LOADS]) {
        self.known = Some(loads);
    }

    /// The primary and the block that it took in last, once it has taken it in
    /// whole: at the sample that ends its jobs on that block.
    pub fn updated(&self) -> Option<(&HarmonicBlock, &JointEkf)> {
        (self.running && self.updated).then_some((&self.block, &self.primary))
    }

    /// Whether the primary hypothesis is accepted: it has passed a test, is distinguished from its
    /// mirror image, explains the readings and is plausible; with known loads, that it has met
    /// every test.
    pub fn is_locked(&self) -> bool {
        let met = if self.known.is_some() {
            self.test.tests_passed >= CANDIDATES
        } else {
            self.test.tests_passed > 0 && self.test.mirror_resolved && self.lock.is_confirmed()
        };
        self.running && met
    }
}
