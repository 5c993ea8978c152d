//! Reasons why an FMU refuses a call (`Refusal`), the phase of an instance, and their messages.

use loadtwin_common::io::signed_image::ImageError;
use thiserror::Error;

use crate::interface::InterfaceError;
use crate::role::Type;

/// Why a call is refused; the instance is as it was then.
#[derive(Debug, Error)]
pub enum Refusal {
    /// A null or misaligned pointer.
    #[error(
        "{0}: found a pointer that is null or not aligned, allowed: one to what the call needs"
    )]
    Pointer(&'static str),
    /// Two numbers that have to agree do not.
    #[error("{what}: found {found}, allowed: {allowed}")]
    Count {
        /// Of what.
        what: &'static str,
        /// The number.
        found: usize,
        /// What it has to be.
        allowed: usize,
    },
    /// A text that is no UTF-8, or no `file:` URI of this machine.
    #[error("{0}: found bytes that are no UTF-8")]
    Text(&'static str),
    /// No variable has this value reference.
    #[error("value reference: found {found}, allowed: 0 to {last}")]
    NoSuchVariable {
        /// The reference.
        found: u32,
        /// The last one.
        last: usize,
    },
    /// The function is for variables of another type.
    #[error("variable {name}: found a call for another type, allowed: those for {allowed}")]
    OtherType {
        /// The variable.
        name: String,
        /// Its type.
        allowed: Named,
    },
    /// A variable that the environment does not set.
    #[error("variable {0}: found a call that sets it, allowed: inputs")]
    NoInput(String),
    /// No number.
    #[error("input {name}: found {found}, allowed: a finite number{otherwise}")]
    NotFinite {
        /// The input.
        name: String,
        /// Its value.
        found: f64,
        /// What to do where there is none.
        otherwise: String,
    },
    /// A call in the wrong order.
    #[error("{call}: found an instance {found}, allowed: {allowed}")]
    Phase {
        /// The call.
        call: &'static str,
        /// Where the instance is.
        found: Phase,
        /// Where it would have to be.
        allowed: &'static str,
    },
    /// A step of another size than one sample.
    #[error("communicationStepSize: found {found} s, allowed: {allowed} s, one sample")]
    StepSize {
        /// The size (s).
        found: f64,
        /// Time between two samples (s).
        allowed: f64,
    },
    /// A step that does not begin where the last one ended.
    #[error(
        "currentCommunicationPoint: found {found} s, allowed: {allowed} s, the end of the last step"
    )]
    StepPoint {
        /// The point (s).
        found: f64,
        /// Where it has to be (s).
        allowed: f64,
    },
    /// What no time can be.
    #[error("startTime: found {0}, allowed: a finite number")]
    StartTime(f64),
    /// The FMU's files are of another FMU.
    #[error("instantiationToken: found {found:?}, allowed: {allowed:?}, that of the resources")]
    Token {
        /// The token.
        found: String,
        /// That of the files.
        allowed: String,
    },
    /// A resource that cannot be read.
    #[error("{path}: {reason}")]
    Resource {
        /// The file.
        path: String,
        /// Why.
        reason: String,
    },
    /// A description that cannot be used.
    #[error("machine.toml: {0}")]
    Interface(#[from] InterfaceError),
    /// A container that cannot be used.
    #[error("machine.image: {0}")]
    Container(#[from] ImageError),
    /// A model that cannot be used.
    #[error("machine.image: the model is refused: {0}")]
    Image(#[from] loadtwin_common::Error),
    /// No state, or a damaged one.
    #[error("FMU state: {0}")]
    State(&'static str),
    /// What this FMU does not do.
    #[error("{0}: this FMU does not have it; allowed: co-simulation with a fixed step")]
    Unsupported(&'static str),
    /// A fault of this library.
    #[error("{0}: a fault of this library; the instance can only be freed")]
    Panic(&'static str),
}

/// Where an instance is between its beginning and its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Phase {
    /// New or reset.
    Instantiated,
    /// Between enter and exit of the initialisation mode.
    Initialisation,
    /// Between two steps.
    Stepping,
    /// After the last step.
    Terminated,
}

impl std::fmt::Display for Phase {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Instantiated => "before its initialisation",
            Self::Initialisation => "in initialisation mode",
            Self::Stepping => "in step mode",
            Self::Terminated => "that was terminated",
        })
    }
}

/// A type as FMI names it.
#[derive(Clone, Copy, Debug)]
pub struct Named(pub Type);

impl std::fmt::Display for Named {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self.0 {
            Type::Real => "Float64 (Real)",
            Type::Integer => "Int32 (Integer)",
            Type::Boolean => "Boolean",
        })
    }
}
