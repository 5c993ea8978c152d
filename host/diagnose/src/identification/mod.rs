//! `loadtwin identify`: fits inertias, drag, stiffness and damping of a drivetrain to recordings with known
//! loads, from the description as prior; finds which of them the recordings show, alone or together with
//! others, and keeps what predicts held-out data better.

mod data_part;
mod held_out;
mod parameter;
mod posterior;
mod recorded_motion;
mod written_description;

use std::path::PathBuf;

use faer::Side;

use crate::diagnosis::DiagnoseError;
use data_part::{DataPart, Part};
use held_out::HeldOut;
use loadtwin_machine::Machine;
use posterior::Posterior;
use recorded_motion::RecordedMotion;

pub use held_out::{Gain, SensorError};
pub use parameter::{Parameter, Quantity};
pub use written_description::write_identified;

/// Standard deviation over that of the description up to which recordings show a parameter, or a
/// combination of parameters: three quarters of its variance are gone.
const SHOWN: f64 = 0.5;

/// Correlation of two parameters from which only a combination of them shows.
const TOGETHER: f64 = 0.9;

/// Part of a parameter in a combination, of unit length, from which it belongs to it.
const TAKES_PART: f64 = 0.3;

/// Standard deviations by which a parameter has to differ from its description to be written.
const DIFFERS: f64 = 2.0;

/// Least change of speed, part of nominal: below it no inertia shows.
const LEAST_SPEED_CHANGE: f64 = 0.02;

/// Whether recordings show a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Shown {
    /// They show it.
    Alone,
    /// They show a combination of it with others, and not how these share it.
    Together,
    /// They do not.
    No,
}

/// A parameter after the fit.
#[derive(Clone, Debug)]
pub struct Identified {
    /// As described.
    pub parameter: Parameter,
    /// Most probable value.
    pub fitted: f64,
    /// Standard deviation of that.
    pub std: f64,
    /// Whether the recordings show it.
    pub shown: Shown,
    /// Whether a fitted value takes the place of the described one. Never of a damping: where a drive's control
    /// damps the shaft, a reference that is late by less than a sample acts like damping.
    pub accepted: bool,
    /// Value after the identification: the fitted one where accepted, else the described one.
    pub value: f64,
}

impl Identified {
    /// Standard deviation over that of the description.
    pub fn ratio(&self) -> f64 {
        self.std / self.parameter.prior_std
    }

    /// Whether the fitted value differs from the described one by more than its interval.
    pub fn differs(&self) -> bool {
        (self.fitted - self.parameter.described).abs() > DIFFERS * self.std
    }
}

/// Parameters that recordings show together and not one by one.
#[derive(Clone, Debug)]
pub struct Combination {
    /// Numbers of the parameters, and their weights, of a unit length all together: of the change of each in
    /// standard deviations of the description.
    pub weights: Vec<(usize, f64)>,
    /// Standard deviation of the sum over that of the description.
    pub ratio: f64,
    /// The sum in standard deviations of the description.
    offset: f64,
}

/// What an identification found.
pub struct Identification {
    /// Every parameter.
    pub parameters: Vec<Identified>,
    /// Those of them that only show together.
    pub combinations: Vec<Combination>,
    /// Residuals of each sensor on held-out data, as described and with the values fitted to the other data.
    pub sensors: Vec<SensorError>,
    /// By how much the residuals of held-out data are smaller with what is accepted, or tried where nothing is.
    pub gain: Option<Gain>,
    /// Time of the held-out data (s).
    pub held_out_s: f64,
}

/// Identifies `machine` on the recordings at `paths`; reports the part done, 0 to 1.
///
/// # Errors
/// When the machine is no drivetrain, a recording cannot be read or lacks a reference load, or the speed
/// does not change.
pub fn identify(
    machine: &Machine,
    paths: &[PathBuf],
    progress: impl Fn(f64),
) -> Result<Identification, DiagnoseError> {
    let drivetrain = (machine.drivetrain.as_ref()).ok_or(DiagnoseError::OnlyDrivetrain)?;
    let recordings = paths
        .iter()
        .map(|path| RecordedMotion::read(machine, path))
        .collect::<Result<Vec<_>, _>>()?;
    check_speed(&recordings, paths)?;
    progress(0.1);
    let parameters = Parameter::all(drivetrain);
    let part = |part: Part| DataPart::new(drivetrain, &parameters, &recordings, part);
    let (fitted, whole, held_out) = (part(Part::Fitted), part(Part::Whole), part(Part::HeldOut));
    let trial = Posterior::fit(&fitted, |part| progress(0.1 + 0.4 * part));
    let posterior = trial.continued(&whole, |part| progress(0.5 + 0.4 * part));
    let combinations = combinations(&posterior);
    let shown = |i: usize| {
        let takes_part = |c: &Combination| c.weights.iter().any(|(k, _)| *k == i);
        if combinations.iter().any(takes_part) {
            Shown::Together
        } else if posterior.std(i) <= SHOWN {
            Shown::Alone
        } else {
            Shown::No
        }
    };
    let shown: Vec<Shown> = (0..parameters.len()).map(shown).collect();
    let held_out = HeldOut::new(&held_out, &fitted, &trial);
    let accepted = accepted(
        &parameters,
        &shown,
        &combinations,
        &posterior,
        &trial,
        &held_out,
    );
    let tried: Vec<bool> = if accepted.contains(&true) {
        accepted.clone()
    } else {
        shown.iter().map(|shown| *shown != Shown::No).collect()
    };
    let identified = |(i, parameter): (usize, &Parameter)| Identified {
        fitted: parameter.value(posterior.offsets[i]),
        std: posterior.std(i) * parameter.prior_std,
        shown: shown[i],
        accepted: accepted[i],
        value: if accepted[i] {
            parameter.value(posterior.offsets[i])
        } else {
            parameter.described
        },
        parameter: parameter.clone(),
    };
    let described = vec![0.0; parameters.len()];
    let with = only(&trial.offsets, &tried);
    let result = Identification {
        parameters: parameters.iter().enumerate().map(identified).collect(),
        sensors: held_out.sensor_errors(&described, &with),
        gain: held_out.gain(&described, &with),
        held_out_s: held_out.duration_s(),
        combinations,
    };
    progress(1.0);
    Ok(result)
}

fn check_speed(recordings: &[RecordedMotion<'_>], paths: &[PathBuf]) -> Result<(), DiagnoseError> {
    let change = |recording: &RecordedMotion<'_>| {
        let speeds = || recording.signals.relative_speed();
        speeds().fold(f64::MIN, f64::max) - speeds().fold(f64::MAX, f64::min)
    };
    let most = recordings.iter().map(change).fold(0.0, f64::max);
    if most < LEAST_SPEED_CHANGE {
        return Err(DiagnoseError::TooLittle {
            recording: paths[0].clone(),
            reason: format!(
                "the speed changes by {:.2} % of nominal, at least {:.0} % are needed: inertias do not show; add a \
                 recording with a run-up",
                100.0 * most,
                100.0 * LEAST_SPEED_CHANGE
            ),
        });
    }
    Ok(())
}

/// `offsets` where `kept`, elsewhere as described.
fn only(offsets: &[f64], kept: &[bool]) -> Vec<f64> {
    let pairs = offsets.iter().zip(kept);
    pairs
        .map(|(z, kept)| if *kept { *z } else { 0.0 })
        .collect()
}

/// Combinations that show of the parameters that do not, or whose errors go together: eigenvectors of their
/// covariance.
fn combinations(posterior: &Posterior) -> Vec<Combination> {
    let covariance = &posterior.covariance;
    let all = 0..posterior.offsets.len();
    let goes_along = |i: usize| {
        let with = |j: usize| covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt();
        all.clone().any(|j| j != i && with(j).abs() > TOGETHER)
    };
    let hidden: Vec<usize> = (all.clone())
        .filter(|i| posterior.std(*i) > SHOWN || goes_along(*i))
        .collect();
    let own = faer::Mat::from_fn(hidden.len(), hidden.len(), |a, b| {
        covariance[(hidden[a], hidden[b])]
    });
    let Ok(eigen) = own.self_adjoint_eigen(Side::Lower) else {
        return Vec::new();
    };
    let (vectors, values) = (eigen.U(), eigen.S().column_vector());
    (0..hidden.len())
        .filter(|k| values[*k] <= SHOWN * SHOWN)
        .map(|k| {
            let all = (0..hidden.len()).map(|a| (hidden[a], vectors[(a, k)]));
            let sum: f64 = all.clone().map(|(_, weight)| weight).sum();
            let weights = all.map(|(i, weight)| (i, weight.copysign(weight * sum)));
            Combination {
                offset: (weights.clone())
                    .map(|(i, weight)| weight * posterior.offsets[i])
                    .sum(),
                weights: weights.filter(|w| w.1.abs() >= TAKES_PART).collect(),
                ratio: values[k].max(0.0).sqrt(),
            }
        })
        .filter(|combination| combination.weights.len() > 1)
        .collect()
}

/// Whether each parameter takes its fitted value: it shows, differs from its description by more than its
/// interval, and the held-out data are predicted worse where it is as described, the others as fitted,
/// by more than the interval of the difference. Damping never is. What is accepted has to be better than the description as well.
fn accepted(
    parameters: &[Parameter],
    shown: &[Shown],
    combinations: &[Combination],
    posterior: &Posterior,
    trial: &Posterior,
    held_out: &HeldOut<'_>,
) -> Vec<bool> {
    let is_damping = |i: &usize| parameters[*i].quantity == Quantity::Damping;
    let alone = (0..shown.len())
        .filter(|i| shown[*i] == Shown::Alone && !is_damping(i))
        .filter(|i| posterior.offsets[*i].abs() > DIFFERS * posterior.std(*i))
        .map(|i| vec![i]);
    let together = combinations
        .iter()
        .filter(|c| c.offset.abs() > DIFFERS * c.ratio)
        .filter(|c| !c.weights.iter().any(|(i, _)| is_damping(i)))
        .map(|c| c.weights.iter().map(|(i, _)| *i).collect());
    let groups: Vec<Vec<usize>> = alone.chain(together).collect();
    let kept = |groups: &[Vec<usize>]| -> Vec<bool> {
        (0..shown.len())
            .map(|i| groups.iter().any(|group| group.contains(&i)))
            .collect()
    };
    let none = vec![false; shown.len()];
    let at = |kept: &[bool]| only(&trial.offsets, kept);
    let all = kept(&groups);
    let better: Vec<Vec<usize>> = (groups.into_iter())
        .filter(|group| {
            let mut without = all.clone();
            for i in group {
                without[*i] = false;
            }
            held_out.is_better(&at(&without), &at(&all))
        })
        .collect();
    let better = kept(&better);
    if held_out.is_better(&at(&none), &at(&better)) {
        better
    } else {
        none
    }
}
