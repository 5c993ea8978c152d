//! Simulates a wheel bearing on its rig, sample by sample: adds noise, drift and effects to the
//! strains of the plant, quantises them as the converter does, and adds encoder counts and
//! reference loads.

mod injected_effect;
mod load_profile;
mod plant;
mod scenario;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::error::SimulateError;
use crate::recorder::{Recorder, Sampled, check_duration};
use crate::rng::Draw;
use crate::simulated_bearing::plant::{Individual, Plant};
use crate::simulated_bearing::scenario::Course;
use loadtwin_machine::{BEARING_LOADS, Bearing, Channel, Encoder, Machine, Reference, Senses};
use loadtwin_recording::{OutputColumn, Unit};

pub use crate::simulated_bearing::injected_effect::{BEARING_EFFECTS, BearingEffect};
pub use crate::simulated_bearing::load_profile::BearingCourse;
use crate::simulated_bearing::load_profile::Driven;
pub use crate::simulated_bearing::scenario::BearingScenario;

/// Noise of a gauge [um/m].
const STRAIN_NOISE: f64 = 0.8;

/// Noise of a reference, as part of its range.
const REFERENCE_NOISE: f64 = 1e-3;

/// A recording of a bearing in the making.
pub type BearingSimulation = Recorder<DrivenBearing>;

/// A bearing under its loads, with its sensors.
pub struct DrivenBearing {
    plant: Plant,
    course: Box<dyn Driven>,
    channels: Vec<(Channel, usize)>,
    encoders: Vec<Encoder>,
    references: Vec<(Reference, usize, f64)>,
    offsets: Vec<Drift>,
    effects: Vec<BearingEffect>,
    slip: [f64; 2],
    wheel: f64,
    rng: ChaCha8Rng,
    dt: f64,
}

/// Offset of a gauge and how it warms [um/m].
struct Drift {
    start: f64,
    warm: f64,
    time_s: f64,
    wander: f64,
}

impl BearingSimulation {
    /// Sets up a recording; `individual` draws the bearing, `seed` the recording.
    ///
    /// # Errors
    /// [`SimulateError`] where an effect has nothing to act on or the duration is out of range.
    pub fn new(
        machine: &Machine,
        bearing: &Bearing,
        scenario: BearingScenario,
        duration_s: f64,
        seed: u64,
        individual: Option<u64>,
        effects: &[BearingEffect],
    ) -> Result<Self, SimulateError> {
        check_duration(duration_s)?;
        let number = individual.unwrap_or(seed);
        let mut draw = Draw::new("bearing", number, seed);
        let mut part = Individual::draw(bearing, &mut draw.individual, scenario.on_road());
        for effect in effects {
            effect.apply(&mut part);
        }
        let mut rng = draw.recording;
        let course = Box::new(Course::new(scenario, duration_s, &mut rng));
        let driven = DrivenBearing::new(machine, bearing, part, course, effects, rng);
        let scenario = format!("{scenario:?}").to_lowercase();
        let columns = driven.columns();
        Ok(Self::start(
            driven, columns, machine, &scenario, seed, duration_s,
        ))
    }

    /// Sets up the recording of another bearing that does the same; `individual` draws it,
    /// seated on the rig or on the road.
    ///
    /// # Errors
    /// [`SimulateError`] where the duration is out of range.
    pub fn along(
        machine: &Machine,
        bearing: &Bearing,
        course: BearingCourse,
        seed: u64,
        individual: u64,
        on_road: bool,
    ) -> Result<Self, SimulateError> {
        let duration_s = course.duration_s();
        check_duration(duration_s)?;
        let mut draw = Draw::new("bearing", individual, seed);
        let part = Individual::draw(bearing, &mut draw.individual, on_road);
        let course = Box::new(course);
        let driven = DrivenBearing::new(machine, bearing, part, course, &[], draw.recording);
        let columns = driven.columns();
        Ok(Self::start(
            driven, columns, machine, "recorded", seed, duration_s,
        ))
    }
}

impl DrivenBearing {
    fn new(
        machine: &Machine,
        bearing: &Bearing,
        part: Individual,
        course: Box<dyn Driven>,
        effects: &[BearingEffect],
        mut rng: ChaCha8Rng,
    ) -> Self {
        let cage = [rng.random_range(0.0..1.0), rng.random_range(0.0..1.0)];
        let offsets = (0..bearing.gauges.len())
            .map(|_| Drift {
                start: 12.0 * rng.sample::<f64, _>(StandardNormal),
                warm: 15.0 + 8.0 * rng.sample::<f64, _>(StandardNormal),
                time_s: rng.random_range(60.0..200.0),
                wander: 0.0,
            })
            .collect();
        let gauge_of = |channel: &Channel| match &channel.senses {
            Senses::OuterRing(name) => bearing.gauges.iter().position(|g| g.name == *name),
            _ => None,
        };
        let channels: Vec<(Channel, usize)> = machine
            .channels
            .iter()
            .filter_map(|channel| Some((channel.clone(), gauge_of(channel)?)))
            .collect();
        let ranges = bearing.range.all();
        let references: Vec<(Reference, usize, f64)> = machine
            .references
            .iter()
            .filter_map(|r| {
                let load = BEARING_LOADS.iter().position(|name| *name == r.load)?;
                Some((r.clone(), load, ranges[load][1] - ranges[load][0]))
            })
            .collect();
        Self {
            plant: Plant::new(part, cage, course.loads(0.0)),
            course,
            channels,
            encoders: machine.encoders.clone(),
            references,
            offsets,
            effects: effects.to_vec(),
            slip: [0.0; 2],
            wheel: rng.random_range(0.0..1.0),
            rng,
            dt: 1.0 / machine.rate_hz,
        }
    }

    fn columns(&self) -> Vec<OutputColumn> {
        (self.channels.iter().map(|(c, _)| (c.name.clone(), c.unit)))
            .chain((self.encoders.iter()).map(|e| (e.name.clone(), Unit::COUNTS)))
            .chain((self.references.iter()).map(|(r, ..)| (r.name.clone(), r.unit)))
            .map(|(name, unit)| OutputColumn {
                name,
                unit,
                single: false,
            })
            .collect()
    }

    fn normal(&mut self) -> f64 {
        self.rng.sample(StandardNormal)
    }
}

impl Sampled for DrivenBearing {
    fn sample(&mut self, row: u64, columns: &mut [Vec<f64>]) {
        let t = row as f64 * self.dt;
        let speed = self.course.speed(t);
        let strains = self.plant.strains();
        let mut place = 0;
        let mut put = |value: f64| {
            if let Some(column) = columns.get_mut(place) {
                column.push(value);
            }
            place += 1;
        };
        for i in 0..self.channels.len() {
            let gauge = self.channels[i].1;
            let noise = STRAIN_NOISE * self.normal();
            let wander = 0.15 * self.dt.sqrt() * self.normal();
            let drift = &mut self.offsets[gauge];
            drift.wander += wander;
            let mut strain = strains[gauge]
                + drift.start
                + drift.warm * (1.0 - (-t / drift.time_s).exp())
                + drift.wander;
            for effect in &self.effects {
                strain = effect.read(gauge, t, speed, strain);
            }
            let channel = &self.channels[i].0;
            let reading = (strain + noise) * 1e-6;
            // What the converter delivers, in the channel's unit.
            let word = channel.word(reading);
            put(channel
                .unit
                .from_si(f64::from(word - channel.zero_word()) * channel.lsb_si()));
        }
        for encoder in &self.encoders {
            let counts = self.wheel / std::f64::consts::TAU * encoder.counts_per_turn;
            put(counts.floor());
        }
        let loads = self.course.loads(t);
        for i in 0..self.references.len() {
            let noise = REFERENCE_NOISE * self.normal();
            let (reference, load, range) = &self.references[i];
            let value = (loads[*load] + range * noise) / reference.gain;
            put(reference.unit.from_si(value) + reference.zero);
        }
    }

    fn advance(&mut self, row: u64) {
        let t = (row + 1) as f64 * self.dt;
        let speed = self.course.speed(t);
        let turned = speed * self.dt;
        self.wheel += turned;
        for row in 0..2 {
            // Slip forgets within 2 s; standard deviation 0.2 %.
            let noise = 0.002 * (self.dt).sqrt() * self.normal();
            self.slip[row] += -0.5 * self.dt * self.slip[row] + noise;
        }
        let more: f64 = self.effects.iter().map(BearingEffect::slip).sum();
        let loads = self.course.loads(t);
        let warming: f64 = self
            .effects
            .iter()
            .map(|effect| effect.warming(t))
            .product();
        self.plant.warm(warming);
        self.plant
            .advance(turned, self.slip.map(|slip| slip - more), loads);
    }
}
