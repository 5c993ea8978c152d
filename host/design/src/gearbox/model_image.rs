//! Builds the payload of a drivetrain's model image from description and sensor set: plans the
//! states and their scales, and fills in transition, process noise, channels, encoders, friction
//! and, for the steady filter, its gains.

use faer::Mat;
use heapless::Vec as FixedVec;
use loadtwin_common::drivetrain::{
    Bias, Channel, Encoder, Friction, GaugeResponse, GearboxModel, LOADS, MAX_FRICTIONS, Role,
};
use loadtwin_common::estimator::STATES;
use loadtwin_common::image::Model;
use loadtwin_common::io::measurement::{AdcScaling, IndexPulse};
use loadtwin_common::signal::periodic_lookup::PeriodicLookup;

use crate::encoder_scaling;
use crate::error::BuildError;
use crate::gearbox::channel_tables::Tables;
use crate::gearbox::consistency_parameters::{consistency, model_error};
use crate::gearbox::gauge_zeros::estimated_zeros;
use crate::gearbox::load_signals::{error_bands, load_signals};
use crate::gearbox::process_noise::process_noise;
use crate::gearbox::steady_gains::{SteadyTable, steady_gains};
use crate::gearbox::torsional_model::Torsion;
use crate::payload::packed;
use crate::sensor_set::{Filter, Sensors};
use loadtwin_machine::{Auxiliary, CREEP, Drift, Drivetrain, Machine, Senses, extreme_words};

/// Random walk of a load whose description gives none, in nominal loads per sqrt(s).
const DEFAULT_WALK: f64 = 0.2;

/// Time over which a temperature is smoothed [s]: long against its noise, short against the
/// warming of a housing.
const WARMING_S: f64 = 10.0;

/// Size of an encoder's unknown zero [rad], the scale of its state.
const ZERO_SCALE: f64 = 1e-3;

/// The image's payload for `machine` with `sensors`, as postcard bytes.
///
/// # Errors
/// When a map cannot be read or the model does not fit an image.
pub fn image(
    machine: &Machine,
    drivetrain: &Drivetrain,
    sensors: &Sensors,
) -> Result<Vec<u8>, BuildError> {
    let tables: Vec<Tables> = sensors
        .channels
        .iter()
        .map(|c| Tables::new(machine, drivetrain, c))
        .collect::<Result<_, _>>()?;
    let mut plan = Plan::new(machine, drivetrain, sensors, &tables);
    plan.size_drifts(&tables);
    let channels = sensors
        .channels
        .iter()
        .zip(&tables)
        .enumerate()
        .map(|(i, (channel, tables))| plan.channel(i, channel, tables, machine.thermometer()))
        .collect::<Result<_, _>>()?;
    let full = plan.model(machine, drivetrain, sensors, channels)?;
    let table = match sensors.filter {
        Filter::Aekf => None,
        Filter::Steady => Some(plan.steady_table(&full)?),
    };
    let model = GearboxModel {
        steady: table.as_ref().map(SteadyTable::gains),
        ..full
    };
    packed(machine, &sensors.channels, Model::Gearbox(model))
}

/// Index and size of each state.
struct Plan {
    torsion: Torsion,
    dt_s: f64,
    /// SI size of the unit of each state: mechanics, zeros of encoders, loads.
    scale: Vec<f64>,
    mechanical: usize,
    /// Zeros of the encoders after the first.
    zeros: usize,
    /// What drifts, in SI units: channels by number, and last the load that they share, without.
    drifts: Vec<(Option<usize>, Drift)>,
    /// States that nothing depends on.
    fill: usize,
    loads: usize,
    nominal_speed: f64,
    /// Nominal torque at the main shaft.
    nominal_torque: f64,
}

impl Plan {
    fn new(
        machine: &Machine,
        drivetrain: &Drivetrain,
        sensors: &Sensors,
        tables: &[Tables],
    ) -> Self {
        let torsion = Torsion::new(drivetrain);
        let n = drivetrain.inertias.len();
        let nominal: Vec<f64> = drivetrain.loads.iter().map(|l| l.nominal_nm).collect();
        let nominal_torque = drivetrain.nominal_torque();
        let mut scale = vec![1.0];
        scale.extend(torsion.referred_stiffness().map(|k| nominal_torque / k));
        scale.extend(std::iter::repeat_n(drivetrain.nominal_speed_rad_s, n));
        let mechanical = scale.len();
        let zeros = sensors.encoders.len().saturating_sub(1);
        let mut drifts: Vec<(Option<usize>, Drift)> = estimated_zeros(sensors, tables)
            .into_iter()
            .map(|(channel, drift)| (Some(channel), drift))
            .collect();
        let bends = |c: &loadtwin_machine::Channel| {
            c.bending != 0.0 && !matches!(c.senses, Senses::Drive(_))
        };
        let bending = drivetrain.bending.map(|bending| (None, bending));
        drifts.extend(bending.filter(|_| sensors.channels.iter().any(bends)));
        // Up to a number of states that a filter is compiled for.
        let needed = mechanical + zeros + drifts.len() + LOADS;
        let compiled = STATES
            .into_iter()
            .find(|states| *states >= needed)
            .unwrap_or(needed);
        let fill = compiled - needed;
        scale.extend(std::iter::repeat_n(ZERO_SCALE, zeros + drifts.len() + fill));
        scale.extend(&nominal);
        scale.resize(compiled, 1.0);
        Self {
            torsion,
            dt_s: 1.0 / machine.rate_hz,
            scale,
            mechanical,
            zeros,
            drifts,
            fill,
            loads: nominal.len(),
            nominal_speed: drivetrain.nominal_speed_rad_s,
            nominal_torque,
        }
    }

    fn states(&self) -> usize {
        self.scale.len()
    }

    fn first_load(&self) -> usize {
        self.mechanical + self.zeros + self.drifts.len() + self.fill
    }

    /// The state that holds the drift of a channel, or that of the load that they share.
    fn drift_state(&self, of: Option<usize>) -> Option<usize> {
        let at = self.drifts.iter().position(|(channel, _)| *channel == of)?;
        Some(self.mechanical + self.zeros + at)
    }

    /// What is added to the reading of channel `i`, in its unit.
    fn biases(
        &self,
        i: usize,
        channel: &loadtwin_machine::Channel,
        unit: f64,
    ) -> [Option<Bias>; 2] {
        let bias = |state: usize, factor: f64| Bias {
            state: state as u8,
            factor: (factor * self.scale[state] / unit) as f32,
        };
        let shared = self.drift_state(None).filter(|_| channel.bending != 0.0);
        [
            self.drift_state(Some(i)).map(|state| bias(state, 1.0)),
            shared.map(|state| bias(state, channel.to_si(channel.bending))),
        ]
    }

    /// A drift is estimated in the unit of its channel's reading, a load in its deviation.
    fn size_drifts(&mut self, tables: &[Tables]) {
        for (at, (channel, drift)) in self.drifts.iter().enumerate() {
            let unit = channel.map_or(drift.std, |channel| tables[channel].unit);
            self.scale[self.mechanical + self.zeros + at] = unit;
        }
    }

    /// Decay over a sample of state `i` above the mechanical ones, and the variance of
    /// its process noise, in its own unit.
    fn walk(&self, i: usize) -> (f64, f64) {
        // A zero stays; the filter only must not freeze. A state that nothing
        // depends on is forgotten.
        let still = 1e-12;
        match i.checked_sub(self.mechanical + self.zeros) {
            None => (1.0, still),
            Some(at) => self.drifts.get(at).map_or((0.0, still), |(_, drift)| {
                let left = (-self.dt_s / drift.time_s).exp();
                let std = drift.std / self.scale[i];
                (left, std * std * (1.0 - left * left))
            }),
        }
    }

    /// A row over mechanics and loads, in the scale of the filter.
    fn scaled_row(&self, row: &[f64]) -> Vec<f64> {
        let mut scaled = vec![0.0; self.states()];
        for (i, value) in row.iter().enumerate() {
            let state = if i < self.mechanical {
                i
            } else {
                self.first_load() + i - self.mechanical
            };
            scaled[state] = value * self.scale[state];
        }
        scaled
    }

    fn channel<'a>(
        &self,
        i: usize,
        channel: &loadtwin_machine::Channel,
        tables: &'a Tables,
        thermometer: Option<&Auxiliary>,
    ) -> Result<Channel<'a>, BuildError> {
        // Of a measurement the filter takes off the offset itself.
        let offset = match channel.senses {
            Senses::Drive(_) => (channel.to_si(channel.offset) / channel.lsb_si()).round() as i32,
            _ => 0,
        };
        let [lowest, highest] = extreme_words(channel.converter().bits);
        let converter = AdcScaling {
            zero: channel.zero_word().saturating_add(offset),
            gain: (channel.lsb_si() / tables.unit) as f32,
            lowest,
            highest,
            stuck_after: channel.stuck_after(),
        };
        let (row, role) = if let Senses::Drive(name) = &channel.senses {
            let transition = self.torsion.discretised(self.dt_s);
            let column = self.mechanical + self.loads + self.torsion.inertia(name);
            let mut row = vec![0.0; self.states()];
            for i in 0..self.mechanical {
                // The reading is in `unit`s of drive torque over its sensitivity.
                row[i] = transition[(i, column)] / self.scale[i] * tables.unit / tables.mean;
            }
            (row, Role::Drive)
        } else if channel.senses == Senses::Temperature {
            let described = thermometer.map(|t| t.lag_s).filter(|lag_s| *lag_s > 0.0);
            let time_s = described.unwrap_or(WARMING_S);
            let role = Role::Temperature {
                at_zero: thermometer
                    .and_then(Auxiliary::zero_k)
                    .map(|zero| zero as f32),
                rate: (1.0 - (-self.dt_s / time_s).exp()) as f32,
            };
            (vec![0.0; self.states()], role)
        } else {
            let row = self.scaled_row(&self.torsion.sensed_row(&channel.senses));
            let role = Role::Measure {
                offset: (channel.to_si(channel.offset) / tables.unit) as f32,
                map: PeriodicLookup::try_new(&tables.map, "map").map_err(BuildError::Model)?,
                map_mean: (tables.mean * tables.sensed / tables.unit) as f32,
                map_deviation: (tables.deviation * tables.sensed / tables.unit) as f32,
                variance: PeriodicLookup::try_new(&tables.variance, "variance")
                    .map_err(BuildError::Model)?,
                biases: (self.biases(i, channel, tables.unit).into_iter().flatten()).collect(),
                response: self.response(channel, tables),
                error: model_error(channel, tables),
            };
            (row.iter().map(|c| c / tables.sensed).collect(), role)
        };
        Ok(Channel {
            converter,
            unit: tables.unit as f32,
            row: fixed(&row)?,
            role,
        })
    }

    /// As the filter has it: what is sensed in parts of nominal.
    fn response(&self, channel: &loadtwin_machine::Channel, tables: &Tables) -> GaugeResponse {
        let creep = channel.creep.as_ref();
        let hysteresis = channel.hysteresis.as_ref();
        let thermal = channel.thermal.unwrap_or_default();
        GaugeResponse {
            bend: channel.nonlinearity as f32,
            creep: creep.map_or(0.0, |c| channel.to_si(c.at_nominal) / tables.unit) as f32,
            creep_rate: creep.map_or(0.0, |c| 1.0 - (-self.dt_s / c.time_s).exp()) as f32,
            hysteresis: hysteresis.map_or(0.0, |h| channel.to_si(h.half_width) / tables.unit)
                as f32,
            turning: hysteresis.map_or(0.0, |h| 1.0 / h.level) as f32,
            zero_per_k: (channel.to_si(thermal.zero_per_k) / tables.unit) as f32,
            gain_per_k: thermal.gain_per_k as f32,
            late: (channel.late_s / self.dt_s) as f32,
        }
    }

    /// Dry friction, in parts of nominal torque and nominal speed.
    fn frictions(
        &self,
        drivetrain: &Drivetrain,
    ) -> Result<FixedVec<Friction, MAX_FRICTIONS>, BuildError> {
        let transition = self.torsion.discretised(self.dt_s);
        let mut frictions = FixedVec::new();
        for (k, inertia) in drivetrain.inertias.iter().enumerate() {
            let Some(referred) = inertia.referred_friction() else {
                continue;
            };
            let part = |torque: f64| (torque / self.nominal_torque) as f32;
            let drive = self.mechanical + self.loads + k;
            let mut column = vec![0.0; self.states()];
            for (i, slot) in column.iter_mut().take(self.mechanical).enumerate() {
                let braked = -transition[(i, drive)] / inertia.speed_ratio;
                *slot = braked * self.nominal_torque / self.scale[i];
            }
            let per_angle = |angle: f64| self.nominal_speed * self.dt_s / angle;
            let positive = |value: f64| (value > 0.0).then_some(value);
            frictions
                .push(Friction {
                    speed_state: (1 + drivetrain.shafts.len() + k) as u8,
                    column: fixed(&column)?,
                    twist_state: 1 + k.saturating_sub(1) as u8,
                    sliding: part(referred.coulomb_nm),
                    losing: referred.load_part as f32,
                    sticking: part(referred.stribeck_nm),
                    fading: (referred.stribeck_rad_s)
                        .map_or(0.0, |speed| (self.nominal_speed / speed) as f32),
                    creeping: CREEP as f32,
                    building: positive(referred.presliding_rad).map_or(0.0, per_angle) as f32,
                })
                .map_err(|_| BuildError::TooLarge("inertias with friction"))?;
        }
        Ok(frictions)
    }

    fn encoder(
        &self,
        k: usize,
        encoder: &loadtwin_machine::Encoder,
    ) -> Result<Encoder, BuildError> {
        let counts = encoder.counts_per_turn * self.torsion.ratio(&encoder.inertia);
        let mut row = self.scaled_row(&self.torsion.angle_row(&encoder.inertia));
        let offset_state = match k {
            0 => 0,
            _ => self.mechanical + k - 1,
        };
        if k > 0 {
            row[offset_state] = ZERO_SCALE;
        }
        let noise = encoder.noise_std_counts() * std::f64::consts::TAU / counts;
        Ok(Encoder {
            counter: encoder_scaling::counter(encoder, self.torsion.ratio(&encoder.inertia)),
            row: fixed(&row)?,
            variance: (noise * noise) as f32,
            offset_state: offset_state as u8,
        })
    }

    fn model<'a>(
        &self,
        machine: &Machine,
        drivetrain: &Drivetrain,
        sensors: &Sensors,
        channels: FixedVec<Channel<'a>, 8>,
    ) -> Result<GearboxModel<'a>, BuildError> {
        let (n, top) = (self.states(), self.first_load());
        let q = process_noise(
            drivetrain,
            self.dt_s,
            machine.tuning.parameter_std,
            &self.scale,
        );
        let mut noise = Vec::new();
        for i in 0..top {
            for j in 0..=i {
                noise.push(self.noise_entry(&q, i, j));
            }
        }
        Ok(GearboxModel {
            scale: fixed(&self.scale)?,
            transition: fixed(&self.transition())?,
            process_noise: fixed(&noise)?,
            load_noise: self.load_noise(drivetrain, sensors),
            initial_state: fixed(&vec![0.0; n])?,
            initial_std: fixed(&self.initial_std())?,
            gate_nis: machine.tuning.gate_nis as f32,
            loads: load_signals(drivetrain)?,
            bands: error_bands(drivetrain, sensors),
            channels,
            encoders: sensors
                .encoders
                .iter()
                .enumerate()
                .map(|(k, encoder)| self.encoder(k, encoder))
                .collect::<Result<_, _>>()?,
            index: index_pulse(machine, sensors),
            frictions: self.frictions(drivetrain)?,
            consistency: consistency(self.dt_s, self.nominal_speed),
            steady: None,
        })
    }

    /// Rows of the transition up to the loads, between scaled states.
    fn transition(&self) -> Vec<f64> {
        let (n, top) = (self.states(), self.first_load());
        let f = self.torsion.discretised(self.dt_s);
        let mut transition = Vec::with_capacity(top * n);
        for i in 0..top {
            for j in 0..n {
                let entry = if i >= self.mechanical {
                    if i == j { self.walk(i).0 } else { 0.0 }
                } else if j < self.mechanical {
                    f[(i, j)]
                } else if (top..top + self.loads).contains(&j) {
                    f[(i, self.mechanical + j - top)]
                } else {
                    0.0
                };
                transition.push(entry * self.scale[j] / self.scale[i]);
            }
        }
        transition
    }

    /// Variance of each load's random walk in a sample, in parts of its nominal value.
    fn load_noise(&self, drivetrain: &Drivetrain, sensors: &Sensors) -> [f32; LOADS] {
        let mut load_noise = [1e-18_f32; LOADS];
        for (slot, load) in load_noise.iter_mut().zip(&drivetrain.loads) {
            let walk = sensors
                .walks
                .get(&load.name)
                .copied()
                .or(load.walk_nm_per_sqrt_s)
                .unwrap_or(DEFAULT_WALK * load.nominal_nm);
            *slot = (walk * walk * self.dt_s / (load.nominal_nm * load.nominal_nm)) as f32;
        }
        load_noise
    }

    fn steady_table(&self, model: &GearboxModel<'_>) -> Result<SteadyTable, BuildError> {
        if model.encoders.is_empty() {
            return Err(BuildError::NotSteady("no encoder measures the angle"));
        }
        if model.channels.iter().any(Channel::has_bias) {
            return Err(BuildError::NotSteady("a channel has a bias state"));
        }
        if model.channels.iter().any(|c| c.late().is_some()) {
            return Err(BuildError::NotSteady("a channel comes late"));
        }
        steady_gains(model, self.nominal_speed * self.dt_s)
            .ok_or(BuildError::NotSteady("a load or a state is not observed"))
    }

    fn noise_entry(&self, q: &Mat<f64>, i: usize, j: usize) -> f64 {
        if i < self.mechanical {
            q[(i, j)] / (self.scale[i] * self.scale[j])
        } else if i == j {
            self.walk(i).1
        } else {
            0.0
        }
    }

    /// Twists and loads up to nominal, any speed, zeros as large as all twists.
    fn initial_std(&self) -> Vec<f64> {
        let n = self.mechanical / 2;
        let twists: f64 = self.scale[1..n].iter().sum();
        let mut std = vec![1.0; self.states()];
        std[0] = twists + 1e-3;
        std[n..self.mechanical].fill(2.0);
        std[self.mechanical..self.first_load()].fill(2.0 * (twists + 1e-3) / ZERO_SCALE);
        for (at, (_, drift)) in self.drifts.iter().enumerate() {
            let state = self.mechanical + self.zeros + at;
            std[state] = drift.std / self.scale[state];
        }
        std[self.first_load() + self.loads..].fill(1e-9);
        std
    }
}

fn fixed<const N: usize>(values: &[f64]) -> Result<FixedVec<f32, N>, BuildError> {
    values
        .iter()
        .map(|value| *value as f32)
        .try_fold(FixedVec::new(), |mut fixed, value| {
            fixed.push(value).map(|()| fixed).ok()
        })
        .ok_or(BuildError::TooLarge("the number of states"))
}

/// The index pulse with the encoder that it homes.
fn index_pulse(machine: &Machine, sensors: &Sensors) -> Option<IndexPulse> {
    machine.index.as_ref().and_then(|index| {
        let mut encoders = sensors.encoders.iter().zip(0..);
        match encoders.find(|(encoder, _)| encoder.name == index.encoder) {
            Some((encoder, number)) => Some(encoder_scaling::pulse(index, number, Some(encoder))),
            // Without encoder the pulse itself is the measurement of the angle.
            None => (sensors.encoders.is_empty()).then(|| encoder_scaling::pulse(index, 0, None)),
        }
    })
}
