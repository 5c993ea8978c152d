//! Runs a diagnosis on the residuals of recordings and their null samples (`DiagnosisInput`):
//! selection of effects, hold-out, residual tests, verdict, corrections and errors. Defines its
//! result (`Diagnosis`) and why it may fail (`DiagnoseError`).

use std::path::PathBuf;

use thiserror::Error;

use crate::assessment::empirical_correction::{self, Correction};
use crate::assessment::residual_excess::{ResidualExcess, residual_excesses};
use crate::assessment::residual_tests::{ResidualTests, residual_tests};
use crate::assessment::verdict::{self, Verdict};
use crate::candidate_effect::Effect;
use crate::candidate_effect::fitted::FittedEffect;
use crate::diagnosable::Diagnosable;
use crate::diagnosis_report::json::largest_excess;
use crate::error_interval::LoadErrors;
use crate::null_samples::NullSamples;
use crate::selection::stepwise::{self, Selection};
use loadtwin_design::image_build::BuildError;
use loadtwin_design::rotor::RotorError;
use loadtwin_identification::calibrate::CalibrateError;
use loadtwin_machine::MachineError;
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
    /// The machine has no chain of inertias and shafts.
    #[error(
        "the machine has no [drivetrain]; only inertias, stiffness, damping and drag of a drivetrain can be identified"
    )]
    OnlyDrivetrain,
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
    /// A load that can imitate any effect.
    #[error(
        "rotor.load[{0}].kind: found \"walk\", allowed: \"unbalance\"; beside a load that may be anything no effect can be distinguished"
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
pub struct Diagnosis<S: Diagnosable> {
    /// The residuals that it rests on.
    pub recordings: Vec<S>,
    /// Those that took no part in it.
    pub holdout: Vec<S>,
    /// The effects that explain them.
    pub selection: Selection<S>,
    /// Excess of the residuals over those of the machine without effect.
    pub residual_excesses: Vec<ResidualExcess>,
    /// The correlations of the residuals.
    pub residual_tests: Vec<ResidualTests>,
    /// The result.
    pub verdict: Verdict,
    /// Part of the excess that the effects found do not explain, where it is beyond chance.
    pub unexplained_part: Option<f64>,
    /// What may be subtracted where something is missing that no candidate explains.
    pub corrections: Vec<Correction>,
    /// Errors on the hold-out recordings; on the fitted ones where there are none.
    pub errors: LoadErrors,
}

impl<S: Diagnosable> Diagnosis<S> {
    /// States the excess that the effects named do not explain, where it is beyond chance.
    pub fn remainder(&self) -> Option<String> {
        let part = self.unexplained_part.filter(|_| !self.named().is_empty())?;
        let worst = largest_excess(&self.residual_excesses);
        let worst = worst.first()?;
        Some(format!(
            "these leave {:.1} % of the excess unexplained, the most in {}: {:.1} times the mean square of the described machine",
            100.0 * part,
            worst.channel,
            worst.after
        ))
    }

    /// The effects that the verdict names.
    pub fn named(&self) -> &[FittedEffect<S>] {
        self.verdict.named(&self.selection)
    }
}

/// Seed of the null samples.
pub(crate) const SEED: u64 = 20_261_121;

/// What recordings show, and what they would show without any effect.
pub struct DiagnosisInput<S: Diagnosable> {
    pub(crate) recordings: Vec<S>,
    pub(crate) holdout: Vec<S>,
    pub(crate) null_samples: NullSamples,
    /// Part of the nominal load below which an effect is negligible.
    pub relevant_part: f64,
}

impl<S: Diagnosable> DiagnosisInput<S> {
    /// The effects of `candidates` that explain them.
    pub fn diagnose(
        &self,
        candidates: &[&'static dyn Effect<S>],
        progress: impl Fn(f64),
    ) -> Diagnosis<S> {
        let mut selection = stepwise::select(
            &self.recordings,
            &self.null_samples,
            candidates,
            self.relevant_part,
            progress,
        );
        if !self.holdout.is_empty() {
            selection.validate_on(&self.recordings, &self.holdout);
        }
        self.assess(selection)
    }

    /// The diagnosis that follows from the effects of `selection`.
    pub(crate) fn assess(&self, selection: Selection<S>) -> Diagnosis<S> {
        let (recordings, holdout, null_samples) =
            (&self.recordings, &self.holdout, &self.null_samples);
        let residual_excesses = residual_excesses(recordings, &selection, null_samples);
        let residual_tests = residual_tests(recordings, &selection, null_samples);
        let unexplained_part =
            verdict::unexplained_part(recordings, &selection, &residual_excesses, null_samples);
        let verdict = Verdict::of(
            recordings,
            &selection,
            unexplained_part,
            &residual_excesses,
            &residual_tests,
        );
        let corrections = match verdict {
            Verdict::Unknown => empirical_correction::corrections(recordings, &residual_excesses),
            _ => Vec::new(),
        };
        // What explains too little is not named, and changes nothing.
        let named = verdict.named(&selection);
        let errors = if holdout.is_empty() {
            S::errors(recordings, named)
        } else {
            let lasting = named.iter().filter(|f| f.effect.is_machine_property());
            S::errors(holdout, &lasting.cloned().collect::<Vec<_>>())
        };
        Diagnosis {
            recordings: recordings.clone(),
            holdout: holdout.clone(),
            unexplained_part,
            selection,
            residual_excesses,
            residual_tests,
            verdict,
            corrections,
            errors,
        }
    }
}
