//! `loadtwin diagnose`: which physical effect a model lacks, by what a
//! recording shows.
//!
//! A recording becomes residuals ([`Session`]: strain given the reference
//! torque, torque balance, angles) and signals. Each [`effect::Effect`]
//! predicts every residual from the signals; its linear parameters come from
//! least squares, its shape from search, its evidence from blocks that were
//! left out, against draws of the same machine without any effect.
#![forbid(unsafe_code)]

mod bearing;
mod bins;
mod chain;
mod columns;
mod confirm;
mod consensus;
mod correct;
mod doubt;
mod drivetrain;
pub mod effect;
mod empirical;
mod error;
mod filtered;
mod fit;
mod forms;
mod innovations;
mod known;
mod motion;
mod null;
mod observe;
mod observed;
mod oddity;
mod page;
mod rank;
mod recorded;
mod refit;
mod rotor;
mod seen;
mod select;
mod shape;
mod shared;
mod signals;
mod spread;
mod statistics;
mod stream;
mod structure;
mod sums;
mod taken;
mod thin;
mod torque;
mod trial;
mod verdict;

use std::path::PathBuf;

use thiserror::Error;

pub use bearing::BearingSession;
pub use correct::corrected;
pub use empirical::Correction;
pub use error::{Interval, LoadErrors, load_errors};
pub use innovations::{Innovations, SensorInnovations, innovations};
pub use observe::observe;
pub use observed::{Abscissa, Observed, Shaft};
pub use oddity::{Oddity, oddities};
pub use page::{page, sentence};
pub use rank::Ranked;
pub use rotor::RotorSession;
pub use select::{Found, Selection};
pub use signals::Signals;
pub use stream::{Kind, Session, Stream, Term, Told};
pub use structure::{Structure, Test, Tested, structures};
pub use verdict::{Verdict, by_name, cannot_show, report};

use effect::Effect;
use loadtwin_design::build::BuildError;
use loadtwin_design::rotor::RotorError;
use loadtwin_identification::calibrate::CalibrateError;
use loadtwin_machine::{Machine, MachineError};
use loadtwin_recording::RecordingError;
use loadtwin_replay::RecordedError;
use loadtwin_replay::ReplayError;
use loadtwin_simulate::SimulateError;

/// Why nothing can be said.
#[derive(Debug, Error)]
pub enum DiagnoseError {
    /// The machine is none whose residuals are known.
    #[error(
        "the machine has none of [drivetrain], [rotor] and [bearing]; only these can be diagnosed"
    )]
    NoDrivetrain,
    /// The recording does not say enough.
    #[error("{}: {reason}", recording.display())]
    TooLittle {
        /// The recording.
        recording: PathBuf,
        /// What it lacks and what is needed.
        reason: String,
    },
    /// The motion of the machine cannot be read.
    #[error(transparent)]
    Motion(#[from] CalibrateError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A file of the description cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// The recording of a rotor cannot be read.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// The sensors cannot be used together.
    #[error(transparent)]
    Sensors(#[from] BuildError),
    /// A load that may do what any effect does.
    #[error(
        "rotor.load[{0}].kind: found \"walk\", allowed: \"unbalance\"; beside a load that may be anything no effect can be told"
    )]
    AnyLoad(usize),
    /// The rotor cannot be computed.
    #[error("rotor: {0}")]
    Rotor(#[from] RotorError),
    /// The loads of a bearing are not known.
    #[error(transparent)]
    Loads(#[from] RecordedError),
    /// The machine without effect cannot be simulated.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// No room for the simulations.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// What a diagnosis found.
pub struct Diagnosis<S: Observed = Session> {
    /// The residuals that it rests on.
    pub sessions: Vec<S>,
    /// Those that took no part in it.
    pub unseen: Vec<S>,
    /// What explains them.
    pub selection: Selection<S>,
    /// What is left and unlike the machine without effect.
    pub oddities: Vec<Oddity>,
    /// What the residuals go with.
    pub structures: Vec<Structure>,
    /// What is said.
    pub verdict: Verdict,
    /// What may be subtracted where something is missing that no candidate explains.
    pub corrections: Vec<Correction>,
    /// Errors on the unseen recordings; on the fitted ones where there are none.
    pub errors: LoadErrors,
}

/// Seed of the draws without effect.
const SEED: u64 = 20_261_121;

/// Diagnoses `machine` on `recordings` with the whole library of its kind;
/// errors are told on `validation`, or, where there is none, on the fitted
/// recordings themselves.
///
/// # Errors
/// [`DiagnoseError`] when the machine has no residuals, or a recording cannot
/// be read or says too little.
pub fn diagnose<S: Observed>(
    machine: &Machine,
    recordings: &[PathBuf],
    validation: &[PathBuf],
    progress: impl Fn(f64),
) -> Result<Diagnosis<S>, DiagnoseError> {
    let residuals = S::read(machine, recordings, validation, |part| {
        progress(0.5 * part);
    })?;
    Ok(residuals.explained_by(S::library(), |part| progress(0.5 + 0.5 * part)))
}

/// What recordings show, and what they would show without any effect.
pub struct Residuals<S: Observed = Session> {
    sessions: Vec<S>,
    unseen: Vec<S>,
    draws: null::Draws,
}

impl<S: Observed> Residuals<S> {
    /// What of `candidates` explains them.
    pub fn explained_by(
        &self,
        candidates: &[&'static dyn Effect<S>],
        progress: impl Fn(f64),
    ) -> Diagnosis<S> {
        let (sessions, unseen, draws) = (&self.sessions, &self.unseen, &self.draws);
        let mut selection = select::select(sessions, draws, candidates, progress);
        if !unseen.is_empty() {
            selection.confirm(sessions, unseen);
        }
        let oddities = oddities(sessions, &selection, draws);
        let structures = structures(sessions, &selection, draws);
        let verdict = Verdict::of(sessions, &selection, &oddities, &structures, draws);
        let corrections = match verdict {
            Verdict::Unknown => empirical::corrections(sessions, &oddities),
            _ => Vec::new(),
        };
        // What explains too little is not named, and mends nothing.
        let named: &[Found<S>] = match verdict {
            Verdict::Unknown => &[],
            _ => &selection.found,
        };
        let errors = if unseen.is_empty() {
            S::errors(sessions, named)
        } else {
            let lasting = named.iter().filter(|f| f.effect.lasts());
            S::errors(unseen, &lasting.cloned().collect::<Vec<_>>())
        };
        Diagnosis {
            sessions: sessions.clone(),
            unseen: unseen.clone(),
            selection,
            oddities,
            structures,
            verdict,
            corrections,
            errors,
        }
    }
}
