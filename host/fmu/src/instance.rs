//! Runs the estimator of one FMU instance: sets inputs and gets outputs by value reference, takes
//! one raw sample in each step, which has to be one sample period long, and checks the order of
//! calls. Saves and restores the whole state as bytes.

use loadtwin_common::estimator::{Estimator, MAX_STATE_BYTES};
use loadtwin_common::image::Image;
use loadtwin_common::io::estimate::{Estimate, LoadEstimate, SensorEstimate};
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::signed_image;
use self_cell::self_cell;
use serde::{Deserialize, Serialize};

use crate::inputs::Inputs;
use crate::interface::Interface;
use crate::refusal::{Named, Phase, Refusal};
use crate::resources::Resources;
use crate::role::{LoadField, Role, SensorField, Type};
use crate::saved_state::State;
use crate::variable::{Variable, variables};

/// Part of a period by which a step may differ from it: masters add step sizes up.
const SIZE_TOLERANCE: f64 = 1e-6;

/// Part of a period by which a step may begin beside the end of the last one.
const POINT_TOLERANCE: f64 = 1e-3;

self_cell!(
    /// The estimator with the image that it reads its tables from.
    struct Line {
        owner: Vec<u8>,
        #[covariant]
        dependent: Built,
    }
);

/// On the heap: it is large.
type Built<'a> = Box<Estimator<'a>>;

/// A value of any type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// Of a real variable.
    Real(f64),
    /// Of an integer.
    Integer(i32),
    /// Of a truth.
    Boolean(bool),
}

/// Where an instance is, beside its estimator.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Progress {
    phase: Phase,
    inputs: Inputs,
    /// Level of the index at the last step.
    index_was: bool,
    estimate: Estimate,
    /// Number of the next sample.
    tick: u32,
    /// Where the next step begins (s).
    next_s: f64,
}

/// An instance.
pub struct Instance {
    interface: Interface,
    variables: Vec<Variable>,
    line: Line,
    progress: Progress,
}

impl Instance {
    /// A new one of the files in the FMU's resources, bound by `token` to its model description.
    ///
    /// # Errors
    /// When the files cannot be used or are of another FMU.
    pub fn new(resources: &Resources, token: &str) -> Result<Self, Refusal> {
        let allowed = resources.token();
        if token != allowed {
            let found = token.to_owned();
            return Err(Refusal::Token { found, allowed });
        }
        let interface = Interface::from_toml(&resources.interface)?;
        let (_, payload) = signed_image::open(&resources.image)?;
        Ok(Self {
            variables: variables(&interface),
            line: line(payload.to_vec())?,
            progress: Progress::new(&interface),
            interface,
        })
    }

    /// Begins anew.
    ///
    /// # Errors
    /// None that [`Self::new`] had not.
    pub fn reset(&mut self) -> Result<(), Refusal> {
        self.line = line(self.line.borrow_owner().clone())?;
        self.progress = Progress::new(&self.interface);
        Ok(())
    }

    /// Goes on from one phase to the next.
    ///
    /// # Errors
    /// When it is not in `from`.
    pub fn go(&mut self, call: &'static str, from: Phase, to: Phase) -> Result<(), Refusal> {
        let allowed = match from {
            Phase::Instantiated => "one before its initialisation",
            Phase::Initialisation => "one in initialisation mode",
            Phase::Stepping => "one in step mode",
            Phase::Terminated => "one that was terminated",
        };
        let found = self.progress.phase;
        if found != from {
            return Err(Refusal::Phase {
                call,
                found,
                allowed,
            });
        }
        self.progress.phase = to;
        Ok(())
    }

    /// Ends it.
    pub fn abandon(&mut self) {
        self.progress.phase = Phase::Terminated;
    }

    /// States the time of the first step (s).
    ///
    /// # Errors
    /// When it is no time.
    pub fn start_at(&mut self, start_s: f64) -> Result<(), Refusal> {
        if !start_s.is_finite() {
            return Err(Refusal::StartTime(start_s));
        }
        self.progress.next_s = start_s;
        Ok(())
    }

    fn variable(&self, reference: u32, of_type: Type) -> Result<&Variable, Refusal> {
        match self.variables.get(reference as usize) {
            Some(variable) if variable.role.of_type() == of_type => Ok(variable),
            _ => Err(self.other_type(reference)),
        }
    }

    /// Why a call for a type that no variable has is refused.
    pub fn other_type(&self, reference: u32) -> Refusal {
        match self.variables.get(reference as usize) {
            Some(variable) => Refusal::OtherType {
                name: variable.name.clone(),
                allowed: Named(variable.role.of_type()),
            },
            None => Refusal::NoSuchVariable {
                found: reference,
                last: self.variables.len() - 1,
            },
        }
    }

    /// The value of a variable.
    ///
    /// # Errors
    /// When there is none of that type.
    pub fn get(&self, reference: u32, of_type: Type) -> Result<Value, Refusal> {
        let Progress {
            inputs, estimate, ..
        } = &self.progress;
        let load = |i: usize| estimate.loads.get(i).copied().unwrap_or_default();
        let sensor = |i: usize| estimate.sensors.get(i).copied().unwrap_or_default();
        let wide = |value: f32| Value::Real(f64::from(value));
        let fault = |fault: Fault| Value::Integer(i32::from(fault as u8));
        let at = |values: &[f64], i: usize| Value::Real(values.get(i).copied().unwrap_or(0.0));
        let is = |values: &[bool], i: usize| Value::Boolean(values.get(i).is_some_and(|v| *v));
        Ok(match self.variable(reference, of_type)?.role {
            Role::Time => Value::Real(self.progress.next_s),
            Role::Reading(i) => at(&inputs.readings, i),
            Role::Angle(i) => at(&inputs.angles, i),
            Role::ReadingDelivered(i) => is(&inputs.delivered.0, i),
            Role::AngleDelivered(i) => is(&inputs.delivered.1, i),
            Role::Index => Value::Boolean(inputs.index),
            Role::SinceIndex => Value::Real(inputs.since_index),
            Role::Load(i, LoadField::Value) => wide(load(i).value),
            Role::Load(i, LoadField::Std) => wide(load(i).std),
            Role::Load(i, LoadField::Valid) => Value::Boolean(load(i).fault.is_none()),
            Role::Load(i, LoadField::Fault) => fault(load(i).fault),
            Role::Sensor(i, SensorField::Innovation) => wide(sensor(i).innovation),
            Role::Sensor(i, SensorField::Nis) => wide(sensor(i).nis),
            Role::Sensor(i, SensorField::Fault) => fault(sensor(i).fault),
            Role::ShaftAngle => wide(estimate.angle_rad),
            Role::Homed => Value::Boolean(estimate.homed),
            Role::Steady => Value::Boolean(estimate.steady),
        })
    }

    /// Sets inputs, all or none.
    ///
    /// # Errors
    /// When one is no input of the type of its value, or no finite number.
    pub fn set(&mut self, values: &[(u32, Value)]) -> Result<(), Refusal> {
        let mut inputs = self.progress.inputs.clone();
        for (reference, value) in values {
            self.set_one(&mut inputs, *reference, *value)?;
        }
        self.progress.inputs = inputs;
        Ok(())
    }

    fn set_one(&self, inputs: &mut Inputs, reference: u32, value: Value) -> Result<(), Refusal> {
        let variable = self.variable(reference, value.of_type())?;
        if let Value::Real(found) = value
            && !found.is_finite()
            && variable.role.is_input()
        {
            return Err(self.not_finite(variable, found));
        }
        let Inputs {
            readings,
            angles,
            delivered,
            ..
        } = inputs;
        match (variable.role, value) {
            (Role::Reading(i), Value::Real(value)) => put(readings, i, value),
            (Role::Angle(i), Value::Real(value)) => put(angles, i, value),
            (Role::ReadingDelivered(i), Value::Boolean(value)) => put(&mut delivered.0, i, value),
            (Role::AngleDelivered(i), Value::Boolean(value)) => put(&mut delivered.1, i, value),
            (Role::Index, Value::Boolean(value)) => inputs.index = value,
            (Role::SinceIndex, Value::Real(value)) => inputs.since_index = value,
            _ => return Err(Refusal::NoInput(variable.name.clone())),
        }
        Ok(())
    }

    fn not_finite(&self, variable: &Variable, found: f64) -> Refusal {
        let role = match variable.role {
            Role::Reading(i) => Some(Role::ReadingDelivered(i)),
            Role::Angle(i) => Some(Role::AngleDelivered(i)),
            _ => None,
        };
        let delivered = self.variables.iter().find(|v| Some(v.role) == role);
        Refusal::NotFinite {
            name: variable.name.clone(),
            found,
            otherwise: delivered.map_or_else(String::new, |v| {
                format!("; a reading that is missing is {} = false", v.name)
            }),
        }
    }

    /// Takes one sample from the inputs and estimates.
    ///
    /// # Errors
    /// When the step is not that from the end of the last one to the next sample.
    pub fn step(&mut self, point_s: f64, size_s: f64) -> Result<(), Refusal> {
        self.go("a step", Phase::Stepping, Phase::Stepping)?;
        let period = self.interface.period_s();
        // A time of that size is not known better.
        let rounding = 4.0 * f64::EPSILON * point_s.abs();
        let is_near = |a: f64, b: f64, part: f64| (a - b).abs() <= part * period + rounding;
        if !is_near(size_s, period, SIZE_TOLERANCE) {
            return Err(Refusal::StepSize {
                found: size_s,
                allowed: period,
            });
        }
        if !is_near(point_s, self.progress.next_s, POINT_TOLERANCE) {
            return Err(Refusal::StepPoint {
                found: point_s,
                allowed: self.progress.next_s,
            });
        }
        let Progress {
            inputs,
            tick,
            index_was,
            ..
        } = &self.progress;
        let raw = inputs.sample(&self.interface, *tick, *index_was);
        self.progress.estimate = (self.line).with_dependent_mut(|_, line| line.step(&raw));
        self.progress.index_was = self.progress.inputs.index;
        self.progress.tick = raw.tick.wrapping_add(1);
        self.progress.next_s = point_s + size_s;
        Ok(())
    }

    /// The state as bytes.
    ///
    /// # Errors
    /// None: the buffer holds every state.
    pub fn save(&self) -> Result<Vec<u8>, Refusal> {
        let mut line = vec![0; MAX_STATE_BYTES];
        let estimator = self.line.borrow_dependent();
        let length = estimator.save(self.line.borrow_owner(), &mut line)?;
        line.truncate(length);
        State {
            line,
            progress: self.progress.clone(),
        }
        .to_bytes()
    }

    /// Goes on from a saved state to the bit.
    ///
    /// # Errors
    /// When it is none, is damaged or is of another model; the instance is as it was then.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), Refusal> {
        let State { line, progress } = State::from_bytes(bytes)?;
        let restored =
            (self.line).with_dependent_mut(|image, estimator| estimator.restore(image, &line));
        restored.map_err(|_| {
            Refusal::State("of another model, or damaged; allowed: one of this FMU")
        })?;
        self.progress = progress;
        Ok(())
    }
}

impl Value {
    fn of_type(self) -> Type {
        match self {
            Self::Real(_) => Type::Real,
            Self::Integer(_) => Type::Integer,
            Self::Boolean(_) => Type::Boolean,
        }
    }
}

impl Progress {
    fn new(interface: &Interface) -> Self {
        let load = LoadEstimate {
            std: f32::MAX,
            fault: Fault::NotValid,
            ..LoadEstimate::default()
        };
        let sensor = SensorEstimate {
            fault: Fault::NotValid,
            ..SensorEstimate::default()
        };
        let sensors = interface.channels.len() + interface.encoders.len();
        Self {
            phase: Phase::Instantiated,
            inputs: Inputs::default(),
            index_was: false,
            estimate: Estimate {
                loads: interface.loads.iter().map(|_| load).collect(),
                sensors: (0..sensors).map(|_| sensor).collect(),
                ..Estimate::default()
            },
            tick: 0,
            next_s: 0.0,
        }
    }
}

fn line(image: Vec<u8>) -> Result<Line, Refusal> {
    let built = Line::try_new(image, |image| {
        Estimator::try_build(Image::from_bytes(image)?).map(Box::new)
    });
    built.map_err(Refusal::Image)
}

fn put<T>(values: &mut [T], i: usize, value: T) {
    if let Some(slot) = values.get_mut(i) {
        *slot = value;
    }
}
