//! Defines the result types of the diagnosis of a drive, as `--json` has them: verdict, effects
//! found, validation errors, refitted linear part.

use serde::Serialize;

use crate::Remainder;

/// Result of the diagnosis of a drive; its fields are the keys of `--json`.
#[derive(Debug, Serialize)]
pub struct Diagnosis {
    /// `none`, `effect`, `effects`, `inseparable` or `unknown`.
    pub verdict: &'static str,
    /// What was missing, in the order found.
    pub effects: Vec<FoundEffect>,
    /// For each effect, others that would do as well in its place.
    pub alternatives: Vec<Alternative>,
    /// The experiment that distinguishes them.
    pub next_experiment: Option<String>,
    /// Error on the validation recordings [% of the drive's RMS there].
    pub error: Errors,
    /// The linear part, fitted anew together with the effects.
    pub recalibrated: Linear,
    /// What no effect explains.
    pub remainder: Remainder,
    /// Where the validation recordings go beyond the fitted ones: the error there
    /// says what extrapolation is worth, not what the model is.
    pub beyond: Vec<Beyond>,
    /// What to know of the recordings or the result before it is used.
    pub notes: Vec<String>,
    /// Number of outliers that were left out.
    pub spikes: usize,
    /// The balance is evaluated below this (Hz).
    pub cutoff_hz: f64,
    /// Recordings that were fitted.
    pub fitted_on: Vec<String>,
    /// Recordings that took no part in the fit.
    pub validated_on: Vec<Validated>,
    /// The improved description.
    pub machine_out: Option<String>,
    /// What the model leaves of the validation recordings, for plots.
    #[serde(skip)]
    pub residuals: Residuals,
}

/// Rows of the validation recordings, one after the other, below the cut-off.
#[derive(Debug, Default)]
pub struct Residuals {
    /// Time in its recording, s.
    pub t: Vec<f64>,
    /// Which recording.
    pub recording: Vec<usize>,
    /// [rad or m].
    pub position: Vec<f64>,
    /// [rad/s or m/s].
    pub speed: Vec<f64>,
    /// [the drive's unit].
    pub drive: Vec<f64>,
    /// What the linear part, fitted anew, leaves of the drive [its unit].
    pub before: Vec<f64>,
    /// The same with the effects.
    pub after: Vec<f64>,
}

/// An effect that was missing.
#[derive(Debug, Serialize)]
pub struct FoundEffect {
    /// Its name in the library.
    pub name: &'static str,
    /// Where it acts.
    pub channels: Vec<String>,
    /// Its shape, and the coefficient of each term.
    pub parameters: Parameters,
    /// How sure that is.
    pub evidence: FoundEvidence,
}

/// Parameters of an effect.
#[derive(Debug, Serialize)]
pub struct Parameters {
    /// Its shape: one number for each of `shape_names`.
    pub shape: Vec<f64>,
    /// Name of each number of the shape, with its unit.
    pub shape_names: Vec<String>,
    /// Standard deviation of each; none of those that are chosen, not refined.
    pub shape_std: Vec<Option<f64>>,
    /// Term and coefficient.
    pub terms: Vec<(String, f64)>,
}

/// How sure an effect is.
#[derive(Debug, Serialize)]
pub struct FoundEvidence {
    /// Fall of the error on what was left out of the fit, when it is added last [%].
    pub gain_percent: f64,
    /// Probability of that by chance, corrected for the number of candidates.
    pub p_value: f64,
}

/// Effects that would do as well as one that was found.
#[derive(Debug, Serialize)]
pub struct Alternative {
    /// The one that was found.
    pub effect: &'static str,
    /// The others, with their error in parts of its error.
    pub instead: Vec<(&'static str, f64)>,
}

/// An error before and after, with the linear part as described and fitted anew.
#[derive(Debug, Serialize)]
pub struct Errors {
    /// The linear part as described.
    pub nominal: BeforeAfter,
    /// The linear part fitted anew.
    pub recalibrated: BeforeAfter,
    /// The same without the mean error of each recording, where sensors are
    /// zeroed before each.
    pub recalibrated_own_offset: BeforeAfter,
}

/// An error without and with the effects.
#[derive(Debug, Serialize)]
pub struct BeforeAfter {
    /// Without.
    pub before: Figure,
    /// With.
    pub after: Figure,
}

/// An error with its interval.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Figure {
    /// RMS of what is unexplained [% of the drive's RMS]; none where no row has one.
    pub value_percent: Option<f64>,
    /// 95 % prediction interval: the error on as many other recordings, as long, of the
    /// same kind of motion. None where the recordings do not say how much the error varies.
    pub interval_percent: Option<[f64; 2]>,
}

/// The linear part of a balance.
#[derive(Clone, Debug, Serialize)]
pub struct Linear {
    /// [the drive's unit]
    pub offset: f64,
    /// Drive per acceleration, in its unit per rad/s^2 or m/s^2.
    pub inertia: f64,
    /// Drive per speed, in its unit per rad/s or m/s.
    pub drag: f64,
    /// Factor on each measured load.
    pub load_gains: Vec<f64>,
}

/// Error on one validation recording.
#[derive(Debug, Serialize)]
pub struct Validated {
    /// Which.
    pub recording: String,
    /// Linear part fitted anew, without effects [% of the drive's RMS there].
    pub before_percent: f64,
    /// With effects.
    pub after_percent: f64,
}

/// A variable that goes far beyond what was fitted.
#[derive(Debug, Serialize)]
pub struct Beyond {
    /// Which.
    pub what: &'static str,
    /// Its greatest size in the fitted recordings (SI); of the position, its
    /// greatest distance from the middle of those fitted.
    pub fitted: f64,
    /// The same in the validation recordings (SI).
    pub validated: f64,
}
