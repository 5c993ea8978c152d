//! Builds the model image of a drive from its description: scaling of the signals, delays that
//! bring them to one time, inertia, drag, terms of friction and other effects, filter noise.

use loadtwin_common::drive::term::{Direction, Factor, Term};
use loadtwin_common::drive::{DriveModel, MAX_DELAY, PositionSensor, Signal};
use loadtwin_common::image::Model;
use loadtwin_common::io::measurement::{AdcScaling, EncoderScaling};
use loadtwin_common::load_signal::LoadSignal;
use loadtwin_common::signal::periodic_lookup::PeriodicLookup;
use loadtwin_common::signal::phase::{Phase, PhaseStep};

use super::effect_terms::{Effects, Part, PartFactor};
use super::filter_noise::Noise;
use crate::error::BuildError;
use crate::payload::packed;
use crate::sensor_set::Sensors;
use loadtwin_machine::{Balance, Estimated, Machine, UNKNOWN_LOAD, Violation};

/// Load at the end of the scale on the bus, in parts of nominal: a stall takes several times the
/// rated torque.
const FULL_SCALE: f64 = 8.0;

/// Standard deviation at which an estimate is no longer valid, in parts of nominal.
const VALID_STD: f64 = 1.0;

/// Least error of a model, in parts of nominal: beyond the resolution of f32.
const LEAST_MODEL_STD: f64 = 1e-6;

/// Places in one count of [`Factor::Periodic`].
const PLACES: f64 = 65_536.0;

/// The image's payload for a drive.
///
/// # Errors
/// When the description lacks what the estimator needs, or has an effect that it does not have.
pub fn image(
    machine: &Machine,
    balance: &Balance,
    sensors: &Sensors,
) -> Result<Vec<u8>, BuildError> {
    let refused = |violation| BuildError::Machine(machine.refused(violation));
    let nominal = balance.nominal.ok_or_else(|| {
        refused(Violation {
            field: "balance.nominal".into(),
            found: "nothing".into(),
            allowed: "the rated drive, > 0; `loadtwin diagnose -o` writes the RMS of a recording's"
                .into(),
        })
    })?;
    let effects = Effects::new(balance).map_err(refused)?;
    let delays = Delays::new(machine, balance, &effects).map_err(refused)?;
    let position = balance
        .position
        .as_ref()
        .map(|signal| position(machine, balance, signal, delays.motion));
    let tables: Vec<Vec<u8>> = effects.parts.iter().map(Part::bytes).collect();
    let (directions, terms) = terms(&effects, &tables, position.as_ref())?;
    let model_std =
        (balance.model_std).unwrap_or(machine.tuning.parameter_std.max(LEAST_MODEL_STD) * nominal);
    let noise = Noise::new(machine, balance, model_std, nominal);
    let (drive, speed) = (
        (balance.estimate == Estimated::Load).then(|| Signal {
            noise_std: noise.drive_std as f32,
            ..signal(balance, &balance.drive, delays.drive)
        }),
        (balance.speed.as_ref()).map(|s| signal(balance, s, delays.motion)),
    );
    let known = (balance.loads.iter().zip(&delays.loads))
        .map(|(load, delay)| signal(balance, load, *delay));
    let model = DriveModel {
        sample_s: (1.0 / machine.rate_hz) as f32,
        loads: loads(balance, nominal)?,
        unit: (balance.unit.to_string().as_str().try_into())
            .map_err(|_| BuildError::TooLarge("balance.unit"))?,
        drive,
        position,
        speed,
        known: known.collect(),
        offset: balance.offset as f32,
        inertia: balance.inertia as f32,
        drag: balance.drag as f32,
        jerk_density: noise.jerk_density as f32,
        load_variance: noise.load_variance as f32,
        model_std: model_std as f32,
        initial_std: noise.initial_std.map(|std| std as f32),
        directions,
        terms,
    };
    packed(machine, &sensors.channels, Model::Drive(model))
}

type Terms<'a, const D: usize, const T: usize> =
    (heapless::Vec<Direction, D>, heapless::Vec<Term<'a>, T>);

/// The effects as terms, and the directions that they share.
fn terms<'a, const D: usize, const T: usize>(
    effects: &Effects,
    tables: &'a [Vec<u8>],
    position: Option<&PositionSensor>,
) -> Result<Terms<'a, D, T>, BuildError> {
    let (mut directions, mut terms) = (heapless::Vec::new(), heapless::Vec::new());
    for (part, table) in effects.parts.iter().zip(tables) {
        let term = Term {
            coefficient: part.coefficient as f32,
            factor: factor(&part.factor, table, position)?,
            direction: (part.direction)
                .map(|direction| number(&mut directions, direction))
                .transpose()?,
        };
        (terms.push(term)).map_err(|_| BuildError::TooLarge("the number of terms of effects"))?;
    }
    Ok((directions, terms))
}

/// Samples by which signals are delayed so that all are of one time.
struct Delays {
    drive: f64,
    motion: f64,
    loads: Vec<f64>,
}

impl Delays {
    fn new(machine: &Machine, balance: &Balance, effects: &Effects) -> Result<Self, Violation> {
        let rate = machine.rate_hz;
        let motion = effects.late_to_motion_s * rate;
        let loads: Vec<f64> = (effects.late_to_loads_s.iter()).map(|s| s * rate).collect();
        // A drive that is no input need not be waited for.
        let drive = (balance.estimate == Estimated::Load).then_some(0.0);
        let all = || loads.iter().copied().chain([motion]).chain(drive);
        let latest = all().fold(f64::INFINITY, f64::min);
        let longest = all().fold(0.0, f64::max) - latest;
        if longest >= f64::from(MAX_DELAY) {
            return Err(Violation {
                field: "balance.effect".into(),
                found: format!("a delay of {longest:.1} samples"),
                allowed: format!("delays below {MAX_DELAY} samples of `rate_hz`"),
            });
        }
        Ok(Self {
            drive: -latest,
            motion: motion - latest,
            loads: loads.into_iter().map(|delay| delay - latest).collect(),
        })
    }
}

fn loads<const N: usize>(
    balance: &Balance,
    nominal: f64,
) -> Result<heapless::Vec<LoadSignal, N>, BuildError> {
    let name = match balance.estimate {
        Estimated::Load => UNKNOWN_LOAD,
        Estimated::Drive => &balance.drive.name,
    };
    let load = LoadSignal {
        name: (name.try_into()).map_err(|_| BuildError::TooLarge("a load's name"))?,
        full_scale: (FULL_SCALE * nominal) as f32,
        valid_std: (VALID_STD * nominal) as f32,
    };
    Ok([load].into_iter().collect())
}

fn signal(balance: &Balance, signal: &loadtwin_machine::Signal, delay: f64) -> Signal {
    let lsb = balance.lsb(signal);
    Signal {
        converter: AdcScaling {
            zero: (signal.zero / lsb).round() as i32,
            gain: (signal.gain * lsb) as f32,
            lowest: i32::MIN,
            highest: i32::MAX,
            stuck_after: 0,
        },
        noise_std: balance.noise_std(signal) as f32,
        delay: delay as f32,
    }
}

fn position(
    machine: &Machine,
    balance: &Balance,
    signal: &loadtwin_machine::Signal,
    delay: f64,
) -> PositionSensor {
    let count = signal.gain * balance.lsb(signal);
    let at_zero = -signal.gain * signal.zero;
    PositionSensor {
        counter: EncoderScaling {
            step: PhaseStep(0),
            bits: signal.bits as u8,
        },
        count: count as f32,
        at_zero: at_zero as f32,
        at_pulse: (machine.index.as_ref())
            .map(|index| ((index.angle_rad - at_zero) / count).round() as i32),
        noise_std: balance.noise_std(signal) as f32,
        delay: delay as f32,
    }
}

/// The number of `direction` in the list of all, each of which is there once.
fn number<const N: usize>(
    directions: &mut heapless::Vec<Direction, N>,
    direction: Direction,
) -> Result<u8, BuildError> {
    let place = directions.iter().position(|known| *known == direction);
    if let Some(place) = place {
        return Ok(place as u8);
    }
    (directions.push(direction))
        .map_err(|_| BuildError::TooLarge("the number of directions of friction"))?;
    Ok((directions.len() - 1) as u8)
}

fn factor<'a>(
    part: &PartFactor,
    table: &'a [u8],
    position: Option<&PositionSensor>,
) -> Result<Factor<'a>, BuildError> {
    Ok(match part {
        PartFactor::Plain(factor) => *factor,
        PartFactor::Periodic { period, .. } => {
            let (count, at_zero) =
                position.map_or((1.0, 0.0), |p| (f64::from(p.count), f64::from(p.at_zero)));
            Factor::Periodic {
                step: PhaseStep(turns(count / period / PLACES)),
                origin: Phase(turns(at_zero / period)),
                table: PeriodicLookup::try_new(table, "effect").map_err(BuildError::Model)?,
            }
        }
    })
}

/// Turns as the estimator counts phases.
fn turns(turns: f64) -> u64 {
    ((turns - turns.floor()) * 18_446_744_073_709_551_616.0) as u64
}

impl Part {
    fn bytes(&self) -> Vec<u8> {
        match &self.factor {
            PartFactor::Plain(_) => Vec::new(),
            PartFactor::Periodic { table, .. } => {
                table.iter().flat_map(|entry| entry.to_le_bytes()).collect()
            }
        }
    }
}
