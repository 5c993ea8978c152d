//! Simulates an analogue channel: reading from the sensed quantity by sensitivity, disturbances
//! (creep, hysteresis, delay, temperature) and noise, quantised by the converter, with faults of
//! its words.

use std::collections::VecDeque;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use loadtwin_machine::Channel;

use crate::angle_function::AngleFunction;

/// What a disturbance may depend on.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Moment {
    /// Time since the start [s].
    pub t: f64,
    /// Sample period [s].
    pub dt: f64,
    /// Angle of the carrier [rad].
    pub angle: f64,
    /// Temperature less that at the start [K].
    pub warming: f64,
    /// Temperature [K].
    pub temperature: f64,
    /// What the channel senses, as part of nominal.
    pub level: f64,
    /// The described load that gauges read beside torque.
    pub bending: f64,
}

/// Adds to a reading, or changes it, before the converter.
pub(crate) trait Disturbance: Send {
    /// The disturbed reading; called once for each sample.
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64;
}

/// `dz/dt = (amplitude level - z) / time`, added to the reading.
pub(crate) struct Creep {
    described: loadtwin_machine::Creep,
    z: f64,
}

impl Creep {
    pub(crate) fn new(described: loadtwin_machine::Creep) -> Self {
        Self { described, z: 0.0 }
    }
}

impl Disturbance for Creep {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        let loadtwin_machine::Creep { at_nominal, time_s } = self.described;
        self.z += moment.dt / time_s * (at_nominal * moment.level - self.z);
        reading + self.z
    }
}

/// Hysteresis: memory of the load's history, as described.
struct Loop<F>(F);

impl<F: FnMut(f64) -> f64 + Send> Disturbance for Loop<F> {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        reading + (self.0)(moment.level)
    }
}

/// The reading of some time ago, between samples by straight lines.
pub(crate) struct Delay {
    seconds: f64,
    /// The newest reading first.
    past: VecDeque<f64>,
}

impl Delay {
    pub(crate) fn new(seconds: f64) -> Self {
        Self {
            seconds,
            past: VecDeque::new(),
        }
    }
}

impl Disturbance for Delay {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        let samples = self.seconds / moment.dt;
        let (whole, part) = (samples.floor() as usize, samples.fract());
        self.past.push_front(reading);
        self.past.truncate(whole + 2);
        // Before the start it stood where it started.
        let at = |i: usize| {
            self.past
                .get(i)
                .or(self.past.back())
                .copied()
                .unwrap_or(reading)
        };
        at(whole) * (1.0 - part) + at(whole + 1) * part
    }
}

/// Thermal model, as described.
pub(crate) struct Thermal {
    pub described: loadtwin_machine::Thermal,
    /// Reading at zero load [unit].
    pub offset: f64,
    /// Temperature at which the zero holds [K]; that at the start where absent.
    pub at_zero: Option<f64>,
    /// Time constant with which the gauge follows [s].
    pub lag_s: f64,
    /// How much warmer the gauge is, once known [K].
    pub warming: Option<f64>,
}

impl Disturbance for Thermal {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        let loadtwin_machine::Thermal {
            zero_per_k,
            gain_per_k,
        } = self.described;
        let around = (self.at_zero).map_or(moment.warming, |zero| moment.temperature - zero);
        let rate = 1.0 - (-moment.dt / self.lag_s).exp();
        let warming = self.warming.map_or(around, |z| z + rate * (around - z));
        self.warming = Some(warming);
        reading + warming * (zero_per_k + gain_per_k * (reading - self.offset))
    }
}

/// Changes what the converter delivers.
pub(crate) trait WordFault: Send {
    /// The word that is delivered, if any; called once for each sample.
    fn apply(&mut self, moment: &Moment, word: i64) -> Option<i64>;
}

/// `reading = offset + gain map(angle - shift) sensed`, then the disturbances,
/// the noise and the converter.
pub(crate) struct Gauge {
    /// Name of the channel.
    pub name: String,
    /// Group of the channel.
    pub group: Option<String>,
    /// Reading at zero load [unit].
    pub offset: f64,
    /// 1 for a gauge as described.
    pub gain: f64,
    /// How far the gauge sits from where it is said to be [rad of the carrier].
    pub shift: f64,
    /// Sensitivity over the carrier angle [unit/Nm, unit/(rad/s)].
    pub map: AngleFunction,
    /// Reading of one unit of that load [unit].
    pub bending: f64,
    /// Part of the reading by which it is larger at nominal load than in proportion.
    pub nonlinearity: f64,
    /// What is sensed at nominal load and speed, > 0.
    pub nominal: f64,
    /// Whether it responds to torque and is no measured drive.
    pub is_load_sensor: bool,
    /// In the order in which they act.
    pub disturbances: Vec<Box<dyn Disturbance>>,
    /// In the order in which they act.
    pub faults: Vec<Box<dyn WordFault>>,
    /// Standard deviation of the noise [unit].
    pub noise_std: f64,
    lsb: f64,
    zero: f64,
    lowest: f64,
    highest: f64,
    rng: ChaCha8Rng,
}

impl Gauge {
    pub(crate) fn new(
        channel: &Channel,
        map: AngleFunction,
        nominal: f64,
        is_load_sensor: bool,
        rng: ChaCha8Rng,
    ) -> Self {
        let half = (channel.converter().bits.clamp(2, 32) - 1) as i32;
        Self {
            name: channel.name.clone(),
            group: channel.group.clone(),
            offset: channel.offset,
            gain: 1.0,
            shift: 0.0,
            map,
            bending: channel.bending,
            nonlinearity: channel.nonlinearity,
            nominal,
            is_load_sensor,
            disturbances: {
                let creep = channel
                    .creep
                    .map(|c| Box::new(Creep::new(c)) as Box<dyn Disturbance>);
                let hysteresis = channel.hysteresis;
                let turning = hysteresis.map(|h| Box::new(Loop(h.walk())) as Box<dyn Disturbance>);
                creep.into_iter().chain(turning).collect()
            },
            faults: Vec::new(),
            noise_std: channel.noise_std,
            lsb: channel.unit.from_si(channel.lsb_si()),
            zero: f64::from(channel.zero_word()),
            lowest: -f64::from(half).exp2(),
            highest: f64::from(half).exp2() - 1.0,
            rng,
        }
    }

    /// Magnitude of the reading at nominal load [unit].
    pub(crate) fn span(&self) -> f64 {
        self.map.rms() * self.nominal
    }

    /// Reading of one count of the converter [unit/count].
    pub(crate) fn lsb(&self) -> f64 {
        self.lsb
    }

    /// The value that the recording holds; NaN where none was delivered.
    pub(crate) fn sample(&mut self, moment: &Moment, sensed: f64) -> f64 {
        let moment = &Moment {
            level: sensed / self.nominal,
            ..*moment
        };
        let sensitivity = self.gain * self.map.at(moment.angle - self.shift);
        let bent = sensed * (1.0 + self.nonlinearity * moment.level);
        let mut reading = self.offset + sensitivity * bent + self.bending * moment.bending;
        for disturbance in &mut self.disturbances {
            reading = disturbance.apply(moment, reading);
        }
        reading += self.noise_std * self.rng.sample::<f64, _>(StandardNormal);
        let word = ((reading / self.lsb).round() + self.zero).clamp(self.lowest, self.highest);
        let mut word = Some(word as i64);
        for fault in &mut self.faults {
            word = word.and_then(|word| fault.apply(moment, word));
        }
        word.map_or(f64::NAN, |word| {
            ((word as f64).clamp(self.lowest, self.highest) - self.zero) * self.lsb
        })
    }
}
