//! `SimulateError`: the reasons why a recording cannot be simulated, such as unknown effects,
//! targets and scenarios.

use thiserror::Error;

use loadtwin_machine::MachineError;

/// Why a recording cannot be simulated; one line.
#[derive(Debug, Error)]
pub enum SimulateError {
    /// No scenario of that name.
    #[error("scenario: found {found:?}, allowed: {allowed}")]
    Scenario {
        /// What was asked for.
        found: String,
        /// What there is.
        allowed: String,
    },
    /// A duration that is none.
    #[error("duration: found {found} s, allowed: more than 0, at most {most} s")]
    Duration {
        /// What was asked for (s).
        found: f64,
        /// Longest (s).
        most: f64,
    },
    /// No effect of that name.
    #[error("effect: found {found:?}, allowed: {allowed}")]
    Effect {
        /// What was asked for.
        found: String,
        /// What there is.
        allowed: String,
    },
    /// A strength that is none.
    #[error("effect {effect}: found strength {found:?}, allowed: 0 to 100, 1 is typical")]
    Strength {
        /// The effect.
        effect: &'static str,
        /// What was asked for.
        found: String,
    },
    /// A strength that is none, of an effect with a range of its own.
    #[error("effect {effect}: found strength {found:?}, allowed: {allowed}")]
    OwnStrength {
        /// The effect.
        effect: &'static str,
        /// What was asked for.
        found: String,
        /// What is allowed.
        allowed: String,
    },
    /// No part of the machine of that name.
    #[error("effect {effect}: found target {found:?}, allowed: {allowed}")]
    Target {
        /// The effect.
        effect: &'static str,
        /// What was asked for.
        found: String,
        /// What there is.
        allowed: String,
    },
    /// The machine has no part that the effect could change.
    #[error("effect {effect}: this machine has nothing that it could act on")]
    NothingToActOn {
        /// The effect.
        effect: &'static str,
    },
    /// A machine that is no drivetrain.
    #[error("machine {machine:?}: found no drivetrain, allowed: a machine with one")]
    NoDrivetrain {
        /// Its name.
        machine: String,
    },
    /// Bearings that do not hold a rotor.
    #[error("machine {machine:?}: its bearings do not hold the rotor")]
    NotHeld {
        /// Its name.
        machine: String,
    },
    /// Shafts too stiff for their inertias.
    #[error(
        "machine {machine:?}: its fastest motion needs steps of {step_s:.1e} s, allowed: at least \
         {least_s:.1e} s at this sample rate; join inertias that are stiffly coupled"
    )]
    TooStiff {
        /// Its name.
        machine: String,
        /// Longest step that resolves the fastest motion (s).
        step_s: f64,
        /// Shortest step that is taken (s).
        least_s: f64,
    },
    /// A map that the description names cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineError),
}
