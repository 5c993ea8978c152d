//! Simulates a drivetrain on its test bench, sample by sample: steps the plant, and writes a row
//! with the readings of channels, encoders, index pulse, references and temperatures, with noise
//! and injected effects.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::angle_function::AngleFunction;
use crate::bench_torques::{Bench, place};
use crate::bending_load::BendingLoad;
use crate::chain_parameters::Chain;
use crate::drivetrain_plant::{Drive, Plant};
use crate::drivetrain_scenario::{Profile, Scenario};
use crate::error::SimulateError;
use crate::housing_temperature::Housing;
use crate::injected_effect::{Applied, Individual};
use crate::recorder::{Recorder, Sampled, check_duration};
use crate::rng::Draw;
use crate::simulated_encoder::{Encoder, Index};
use crate::simulated_gauge::{Delay, Gauge, Moment, Thermal};
use loadtwin_machine::{Auxiliary, Channel, Drivetrain, Machine, Reference, Senses};
use loadtwin_recording::{OutputColumn, Quantity, Unit};

/// Standard deviation of a reference, as part of nominal load: that of a torque flange of class
/// 0.05.
const REFERENCE_NOISE: f64 = 1e-4;

/// Resolution of a reference, as part of nominal load.
const REFERENCE_RESOLUTION: f64 = 2e-5;

/// Standard deviation of the temperature [K].
const TEMPERATURE_NOISE: f64 = 0.02;

/// Resolution of the temperature [K].
const TEMPERATURE_RESOLUTION: f64 = 0.01;

/// A recording of a drivetrain in the making.
pub type Simulation = Recorder<TestBench>;

/// A drivetrain on its bench, with its sensors.
pub struct TestBench {
    gauges: Vec<(Gauge, Sensed)>,
    encoders: Vec<Encoder>,
    index: Option<Index>,
    references: Vec<Flange>,
    temperatures: Vec<Unit>,
    bench: Bench,
    plant: Plant,
    housing: Housing,
    bending: Option<BendingLoad>,
    /// Noise of references and thermometers, as a part of the usual.
    noise: f64,
    rng: ChaCha8Rng,
    carrier: usize,
    /// What the index pulse latched since the last sample [counts].
    latched: Option<f64>,
    dt: f64,
    steps: u32,
}

/// What a channel responds to: where in the plant, and the factor from the
/// referred quantity to its own.
#[derive(Clone, Copy)]
enum Sensed {
    Shaft(usize, f64),
    Speed(usize, f64),
    Load(usize),
    Drive(usize),
}

/// A reference transducer on a load.
struct Flange {
    load: usize,
    nominal: f64,
    /// Standard deviation of the noise, part of nominal.
    noise_std: f64,
    reference: Reference,
}

impl Simulation {
    /// Sets up a recording.
    ///
    /// `seed` draws the noise and what happens in this recording; `individual`
    /// draws the machine's parameters, positions and offsets as far as
    /// `effects` make them differ from the description, `seed` where absent.
    ///
    /// # Errors
    /// [`SimulateError`] where the machine is no drivetrain or cannot be
    /// integrated, a map cannot be read, the duration is out of range, or an
    /// effect has nothing to act on.
    pub fn new(
        machine: &Machine,
        scenario: &Scenario,
        seed: u64,
        individual: Option<u64>,
        effects: &[Applied],
    ) -> Result<Self, SimulateError> {
        let drivetrain =
            machine
                .drivetrain
                .as_ref()
                .ok_or_else(|| SimulateError::NoDrivetrain {
                    machine: machine.name.clone(),
                })?;
        let duration_s = scenario.duration_s;
        check_duration(duration_s)?;
        let number = individual.unwrap_or(seed);
        let draw = |purpose: &str| Draw::new(purpose, number, seed);

        let mut individual = described(machine, drivetrain, &draw)?;
        for effect in effects {
            effect.apply(
                &mut individual,
                machine,
                duration_s,
                draw(&effect.purpose()),
            )?;
        }

        let profile = Profile::new(scenario, &mut draw("scenario"));
        let bench = Bench::new(machine, drivetrain, profile);
        let mut plant = Plant::new(&individual.chain, bench.held(), bench.bandwidth());
        let dt = 1.0 / machine.rate_hz;
        let steps = plant
            .steps_per_sample(dt)
            .map_err(|stiff| SimulateError::TooStiff {
                machine: machine.name.clone(),
                step_s: stiff.needed_s,
                least_s: stiff.least_s,
            })?;
        let mut rng = draw("bench").recording;
        let angle = rng.random_range(0.0..std::f64::consts::TAU);
        plant.settle(scenario.angle().unwrap_or(angle), &bench.steady(&plant));
        let sensed = machine
            .channels
            .iter()
            .map(|c| sensed(drivetrain, &c.senses));
        let bench = TestBench {
            gauges: individual.gauges.into_iter().zip(sensed).collect(),
            encoders: individual.encoders,
            index: simulated_index(machine),
            references: machine
                .references
                .iter()
                .map(|r| Flange::new(drivetrain, r))
                .collect(),
            temperatures: temperatures(machine).map(|(_, unit)| unit).collect(),
            bench,
            plant,
            housing: Housing::new(rng.random_range(2.0..6.0)),
            bending: (drivetrain.bending)
                .map(|described| BendingLoad::new(&described, dt, draw("bending").recording)),
            noise: 1.0,
            rng,
            carrier: drivetrain
                .carrier
                .as_ref()
                .map_or(0, |name| place(drivetrain, name)),
            latched: None,
            dt,
            steps,
        };
        let columns = columns(machine);
        Ok(Self::start(
            bench,
            columns,
            machine,
            scenario.name(),
            seed,
            duration_s,
        ))
    }

    /// The same by references with noise of these standard deviations, part of nominal, where it is
    /// more than usual.
    #[must_use]
    pub fn with_reference_noise(mut self, stds: &[f64]) -> Self {
        for (flange, std) in self.sampled.references.iter_mut().zip(stds) {
            flange.noise_std = flange.noise_std.max(*std);
        }
        self
    }

    /// The same by sensors without noise, encoders that count in parts, and without what bends
    /// the machine at random.
    #[must_use]
    pub fn exact(mut self) -> Self {
        let bench = &mut self.sampled;
        bench.noise = 0.0;
        bench.bending = None;
        for (gauge, _) in &mut bench.gauges {
            gauge.noise_std = 0.0;
        }
        bench.encoders.iter_mut().for_each(Encoder::exact);
        self
    }
}

impl Sampled for TestBench {
    /// Channels, encoders, index, references, temperatures.
    fn sample(&mut self, row: u64, columns: &mut [Vec<f64>]) {
        let mut columns = columns.iter_mut();
        let mut put = |value: f64| {
            if let Some(column) = columns.next() {
                column.push(value);
            }
        };
        let (plant, bench) = (&self.plant, &self.bench);
        let moment = Moment {
            t: row as f64 * self.dt,
            dt: self.dt,
            angle: plant.angle_of(self.carrier),
            warming: self.housing.warming(),
            temperature: self.housing.temperature,
            level: 0.0,
            bending: self.bending.as_mut().map_or(0.0, BendingLoad::next),
        };
        for (gauge, sensed) in &mut self.gauges {
            let value = match *sensed {
                Sensed::Shaft(i, factor) => plant.torque_of(i) * factor,
                Sensed::Speed(i, factor) => plant.speed_of(i) * factor,
                Sensed::Load(i) => bench.load(plant, i),
                Sensed::Drive(i) => bench.measured_drive(plant, i),
            };
            put(gauge.sample(&moment, value));
        }
        for encoder in &mut self.encoders {
            put(encoder.count(plant.angle_of(encoder.inertia)));
        }
        if self.index.is_some() {
            put(self.latched.take().unwrap_or(f64::NAN));
        }
        for flange in &self.references {
            let noise = self.noise * flange.noise_std * self.rng.sample::<f64, _>(StandardNormal);
            put(flange.read(bench.load(plant, flange.load) / flange.nominal + noise));
        }
        for unit in &self.temperatures {
            let noise = self.noise * TEMPERATURE_NOISE * self.rng.sample::<f64, _>(StandardNormal);
            let kelvin = rounded(self.housing.temperature + noise, TEMPERATURE_RESOLUTION);
            put(unit.from_si(kelvin));
        }
    }

    fn advance(&mut self, row: u64) {
        let next = (row + 1) as f64 * self.dt;
        let (from, to) = self.bench.advance(&self.plant, next, self.dt);
        let h = self.dt / f64::from(self.steps);
        for step in 0..self.steps {
            let before = self.latch_angles();
            let part = (f64::from(step) + 0.5) / f64::from(self.steps);
            self.plant.step(h, &Drive::between(&from, &to, part));
            let after = self.latch_angles();
            if let Some(index) = self.index
                && let Some(part) = index.passed(before.0, after.0)
            {
                let at_pulse = before.1 + part * (after.1 - before.1);
                // Without encoder the column only says that the pulse came.
                let encoder = self.encoders.get_mut(index.encoder);
                self.latched = Some(encoder.map_or(1.0, |encoder| encoder.count(at_pulse)));
            }
        }
        self.housing.step(self.dt, self.bench.power(&self.plant));
    }
}

impl TestBench {
    /// Angle of the carrier and of the encoder that the index latches.
    fn latch_angles(&self) -> (f64, f64) {
        self.index.map_or((0.0, 0.0), |index| {
            let encoder = self.encoders.get(index.encoder);
            let inertia = encoder.map_or(self.carrier, |encoder| encoder.inertia);
            (
                self.plant.angle_of(self.carrier),
                self.plant.angle_of(inertia),
            )
        })
    }
}

impl Flange {
    fn new(drivetrain: &Drivetrain, reference: &Reference) -> Self {
        let load = drivetrain
            .loads
            .iter()
            .position(|l| l.name == reference.load)
            .unwrap_or(0);
        Self {
            load,
            nominal: drivetrain.loads[load].nominal_nm,
            noise_std: REFERENCE_NOISE,
            reference: reference.clone(),
        }
    }

    /// The value in the column at `level`, the load as part of nominal.
    fn read(&self, level: f64) -> f64 {
        let load = rounded(level, REFERENCE_RESOLUTION) * self.nominal;
        let unit = self.reference.unit;
        if unit == Unit::COUNTS {
            (load / self.reference.gain + self.reference.zero).round()
        } else {
            unit.from_si(load / self.reference.gain) + self.reference.zero
        }
    }
}

/// The machine as described, before any effect.
fn described(
    machine: &Machine,
    drivetrain: &Drivetrain,
    draw: &impl Fn(&str) -> Draw,
) -> Result<Individual, SimulateError> {
    Ok(Individual {
        chain: Chain::new(drivetrain),
        gauges: machine
            .channels
            .iter()
            .map(|channel| gauge(machine, drivetrain, channel, draw(&channel.name).recording))
            .collect::<Result<_, _>>()?,
        encoders: machine
            .encoders
            .iter()
            .map(|encoder| {
                let inertia = place(drivetrain, &encoder.inertia);
                let ratio = drivetrain.inertias[inertia].speed_ratio;
                Encoder::new(encoder, inertia, ratio, draw(&encoder.name).recording)
            })
            .collect(),
    })
}

/// The index pulse on the encoder that it homes.
fn simulated_index(machine: &Machine) -> Option<Index> {
    machine.index.as_ref().map(|index| {
        let encoder = machine
            .encoders
            .iter()
            .position(|e| e.name == index.encoder);
        Index::new(index, encoder.unwrap_or(0))
    })
}

fn rounded(value: f64, resolution: f64) -> f64 {
    (value / resolution).round() * resolution
}

fn gauge(
    machine: &Machine,
    drivetrain: &Drivetrain,
    channel: &Channel,
    rng: ChaCha8Rng,
) -> Result<Gauge, SimulateError> {
    let sensitivity = channel.sensitivity_over_angle(machine)?;
    let in_unit = |si: f64| channel.unit.from_si(si);
    let map = AngleFunction::new(sensitivity.into_iter().map(in_unit).collect());
    let nominal = drivetrain.nominal_sensed(&channel.senses);
    let is_load_sensor = matches!(channel.senses, Senses::Shaft(_) | Senses::Load(_));
    let mut gauge = Gauge::new(channel, map, nominal, is_load_sensor, rng);
    if let Some(described) = channel.thermal {
        gauge.disturbances.push(Box::new(Thermal {
            described,
            offset: channel.offset,
            at_zero: machine.thermometer().and_then(Auxiliary::zero_k),
            lag_s: machine.thermometer().map_or(0.0, |t| t.lag_s),
            warming: None,
        }));
    }
    if channel.late_s > 0.0 {
        gauge
            .disturbances
            .push(Box::new(Delay::new(channel.late_s)));
    }
    Ok(gauge)
}

fn sensed(drivetrain: &Drivetrain, senses: &Senses) -> Sensed {
    match senses {
        Senses::Shaft(name) => {
            let i = drivetrain
                .shafts
                .iter()
                .position(|s| s.name == *name)
                .unwrap_or(0);
            Sensed::Shaft(
                i,
                drivetrain
                    .shafts
                    .get(i)
                    .map_or(1.0, |s| 1.0 / s.speed_ratio),
            )
        }
        Senses::Speed(name) => {
            let i = place(drivetrain, name);
            Sensed::Speed(i, drivetrain.inertias[i].speed_ratio)
        }
        Senses::Load(name) => Sensed::Load(
            drivetrain
                .loads
                .iter()
                .position(|l| l.name == *name)
                .unwrap_or(0),
        ),
        Senses::Drive(name) => Sensed::Drive(place(drivetrain, name)),
        // Refused where the description is checked.
        Senses::Displacement(_) | Senses::OuterRing(_) | Senses::Temperature => Sensed::Load(0),
    }
}

/// The auxiliary columns that the plant has a value for.
fn temperatures(machine: &Machine) -> impl Iterator<Item = (&str, Unit)> {
    machine
        .auxiliaries
        .iter()
        .filter(|a| a.unit.quantity() == Quantity::Temperature)
        .map(|a| (a.name.as_str(), a.unit))
}

fn columns(machine: &Machine) -> Vec<OutputColumn> {
    let channels = machine.channels.iter().map(|c| (c.name.as_str(), c.unit));
    let encoders = machine
        .encoders
        .iter()
        .map(|e| (e.name.as_str(), Unit::COUNTS));
    let pulse = if machine.encoders.is_empty() {
        Unit::ONE
    } else {
        Unit::COUNTS
    };
    let index = machine.index.iter().map(|i| (i.name.as_str(), pulse));
    let references = machine.references.iter().map(|r| (r.name.as_str(), r.unit));
    channels
        .chain(encoders)
        .chain(index)
        .chain(references)
        .chain(temperatures(machine))
        .map(|(name, unit)| OutputColumn {
            name: name.to_owned(),
            unit,
            single: false,
        })
        .collect()
}
