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
mod consistency;
pub mod contact;
mod duel;
mod health;
pub mod joint;
mod model;
pub mod offsets;
mod output;
mod trust;
mod wheel;

use crate::Error;
use crate::estimate::{Estimate, LoadEstimate, MAX_LOADS};
use crate::measurement::{Converter, Counter, Unwrap};
use crate::phase::Phase;
use crate::raw::{MAX_CHANNELS, RawSample};
use block::{Block, Sums};
use consistency::Consistency;
use contact::{Contacts, Equilibrium};
use duel::{CANDIDATES, Duel};
use health::Health;
use joint::{Belief, KNOWN_PHASE, Told};
use offsets::Offsets;
use output::{UNKNOWN, estimate};
use trust::Trust;
use wheel::Wheel;

pub use model::{BearingModel, GaugeModel, Tuning};

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

/// Lost samples that are counted at most: more are a new start of the sampling.
const LONGEST_GAP: u32 = 1000;

/// Jobs of a block: champion, challenger, judgement.
const JOBS: u16 = 2 * BELIEF_JOBS + 1;
const BELIEF_JOBS: u16 = 8;

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
    wheel: Wheel,
    sums: Sums,
    block: Block,
    job: u16,
    /// Whether the champion's last job of a block was done with the last sample.
    taken_in: bool,
    champion: Belief,
    challenger: Belief,
    told: [Told; GAUGES],
    health: Health,
    cost: (f32, f32),
    trust: Trust,
    duel: Duel,
    /// What was learnt of preload and biases by rows that were told from their mirror image.
    offsets: Offsets,
    consistency: Consistency,
    running: bool,
    /// Loads that are known, on a rig [kN].
    known: Option<[f32; LOADS]>,
    published: [LoadEstimate; LOADS],
    age: u16,
}

impl Bearing {
    /// Checks a model and lays it out.
    ///
    /// # Errors
    /// The name of the first number that is out of its range.
    pub fn try_build(model: BearingModel, rate_hz: f32) -> Result<Self, Error> {
        model.check()?;
        let t = &model.tuning;
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
            wheel: Wheel::default(),
            sums: Sums::default(),
            block: Block::default(),
            job: JOBS,
            taken_in: false,
            champion: Belief::blank(),
            challenger: Belief::blank(),
            told: [Told::default(); GAUGES],
            health: Health::default(),
            cost: (0.0, 0.0),
            duel: Duel::default(),
            trust: Trust::default(),
            offsets: Offsets::expected(&self.model.tuning),
            consistency: Consistency::default(),
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
        if m.stale {
            return estimate(state, &m);
        }
        let lost = m.lost.min(LONGEST_GAP) as u16;
        let phase = state.wheel.follow(&m, self.dt_s, lost) * self.model.passes_per_turn;
        if state.wheel.lost {
            state.lose_phases();
        }
        let mut readings = [None; GAUGES];
        for (reading, value) in readings.iter_mut().zip(&m.values) {
            *reading = value.ok();
        }
        state.sums.add(phase, lost, &readings);
        state.taken_in = false;
        for _ in 0..self.jobs_per_sample {
            state.taken_in |= state.job == BELIEF_JOBS - 1;
            self.work(state);
        }
        if state.sums.count >= self.block_samples {
            self.close_block(state);
        }
        state.age = state.age.saturating_add(lost + 1);
        estimate(state, &m)
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
            state.job = JOBS;
            state.published = [UNKNOWN; LOADS];
            // At rest a machine is serviced, and it cools: what comes after is compared anew.
            state.consistency = Consistency::default();
        } else if !state.running {
            state.running = true;
            self.begin(&mut state.champion, &state.offsets);
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

    fn begin(&self, belief: &mut Belief, offsets: &Offsets) {
        belief.begin(&self.model.tuning, &self.contacts, &self.rest, offsets);
    }

    /// The next job of the current block.
    fn work(&self, state: &mut BearingState) {
        let job = state.job;
        if job >= JOBS {
            return;
        }
        state.job = job + 1;
        let tuning = &self.model.tuning;
        let dt_s = self.dt_s * f32::from(state.block.elapsed);
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
                let strayed = tuning.slip_std * state.block.phase;
                if strayed * strayed > KNOWN_PHASE {
                    // Over a gap the cages slip by more than is known of them.
                    state.lose_phases();
                }
            }
            part @ 1..=4 => {
                let g = usize::from(part) - 1;
                let used = state.block.whole[g % GAUGES] && state.health.fault(g).is_none();
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

    /// Judges champion and gauges by what was read in the block.
    fn scrutinise(&self, state: &mut BearingState) {
        let (told, gauges) = (&state.told, &self.model.gauges);
        let fell_silent = state.health.take(told, &state.block, gauges);
        let mut used = state.block.whole;
        for (g, used) in used.iter_mut().enumerate() {
            *used &= state.health.fault(g).is_none();
        }
        let prior = state.champion.prior(&self.model.tuning);
        state.trust.take(told, used, gauges, prior);
        if (0..GAUGES).any(|g| !state.health.fault(g).is_none()) {
            // Three gauges explain the loads by other slow states than four.
            state.consistency = Consistency::default();
        } else if state.known.is_none() {
            let locked = state.is_locked();
            let dt_s = self.dt_s * f32::from(state.block.elapsed);
            (state.consistency).take(&state.champion.offsets(), locked, &self.model.tuning, dt_s);
        }
        // What a dead gauge has told until it was found out is believed no longer.
        state.running &= !fell_silent;
    }
}

const _: () = assert!(GAUGES <= MAX_CHANNELS && LOADS <= MAX_LOADS);

impl BearingState {
    /// The phases are to be found again, and slow states to be compared from then on.
    fn lose_phases(&mut self) {
        self.duel.won = 0;
        self.consistency = Consistency::default();
    }

    /// Tells the filter the loads [kN], on a rig; moments over the radius.
    pub fn know(&mut self, loads: [f32; LOADS]) {
        self.known = Some(loads);
    }

    /// The champion and the block that it took in last, once it has taken it in
    /// whole: at the sample that ends its jobs on that block.
    pub fn taken_in(&self) -> Option<(&Block, &Belief)> {
        (self.running && self.taken_in).then_some((&self.block, &self.champion))
    }

    /// Whether the champion can be believed: it has met a challenge, is told from its mirror image, explains the
    /// readings and is plausible; with known loads, that it has met every challenge.
    pub fn is_locked(&self) -> bool {
        let met = if self.known.is_some() {
            self.duel.won >= CANDIDATES
        } else {
            self.duel.won > 0 && self.duel.settled && self.trust.is_earned()
        };
        self.running && met
    }
}
