//! Checks whether a drivetrain recording can be diagnosed, and returns the reason where it is
//! refused: torque and speed are negligible, too few samples are known, the torque balance fails,
//! or gauges have the opposite sign.

use crate::drivetrain::decimated_signals::Signals;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Kind, ResidualSignal};
use crate::sample_statistics::mean_square;

/// Least duration of the recordings that are fitted, together [s].
pub(crate) const SHORTEST_S: f64 = 10.0;

/// Shortest recording [s]: half a block of the cross-validation remains between its ends.
pub(crate) const SHORTEST_OF_SEVERAL_S: f64 = 2.0;

/// Time of a recording that must be known, at most [s], and as part of it.
const LEAST_KNOWN: (f64, f64) = (0.5 * SHORTEST_S, 0.25);

/// Part of nominal that torque or speed must reach.
const LEAST: f64 = 0.02;

/// Torque that loads may leave beyond what inertias and drag take, root mean
/// square, part of nominal: no effect is as large.
const UNBALANCED: f64 = 0.4;

/// Why nothing can be learnt from `recording`; none where something can.
pub(crate) fn implausibility(recording: &DrivetrainResiduals) -> Option<String> {
    at_rest(&recording.signals)
        .or_else(|| no_overlap(recording))
        .or_else(|| torque_imbalance(recording))
        .or_else(|| sign_error(recording))
}

fn at_rest(signals: &Signals) -> Option<String> {
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, |a: f64, v| a.max(v.abs()));
    let torque = most(&mut signals.level.iter().copied());
    let speed = most(&mut signals.relative_speed());
    (torque < LEAST && speed < LEAST).then(|| {
        format!(
            "torque reaches {:.1} % and speed {:.1} % of nominal; at least {:.0} % of one of them are needed",
            100.0 * torque,
            100.0 * speed,
            100.0 * LEAST
        )
    })
}

fn no_overlap(recording: &DrivetrainResiduals) -> Option<String> {
    let known = |s: &ResidualSignal| s.residual.iter().filter(|r| r.is_finite()).count();
    let longest = recording.residuals.iter().map(known).max().unwrap_or(0);
    let least = (LEAST_KNOWN.1 * recording.signals.len() as f64)
        .min(LEAST_KNOWN.0 / recording.signals.dt_s);
    ((longest as f64) < least)
        .then(|| "there is no stretch in which angle, loads and readings are known together".into())
}

fn torque_imbalance(recording: &DrivetrainResiduals) -> Option<String> {
    let nominal = recording.signals.nominal_torque;
    let balance = recording
        .residuals
        .iter()
        .find(|s| s.kind == Kind::Balance)?;
    let left = mean_square(&balance.residual)?.sqrt() / nominal;
    (left > UNBALANCED).then(|| {
        format!(
            "the loads leave {:.0} % of nominal torque that neither inertias nor drag take; sign, direction or scale of a reference load contradict the description",
            100.0 * left
        )
    })
}

/// More than half of the gauges read with the sign opposite to the torque.
fn sign_error(recording: &DrivetrainResiduals) -> Option<String> {
    let gauges: Vec<&ResidualSignal> = recording
        .residuals
        .iter()
        .filter(|s| s.shaft.is_some())
        .collect();
    let against = gauges.iter().filter(|s| reads_opposite(s)).count();
    (against >= 2 && 2 * against > gauges.len()).then(|| {
        format!(
            "{against} of {} gauges read the opposite of what the reference loads say; a sign is wrong in the recording or in the description",
            gauges.len()
        )
    })
}

/// Whether `measured = a reading` comes out with a negative `a`.
fn reads_opposite(signal: &ResidualSignal) -> bool {
    let (mut product, mut square) = (0.0, 0.0);
    for (residual, reading) in signal
        .residual
        .iter()
        .zip(&signal.reading)
        .filter(|(r, _)| r.is_finite())
    {
        product += (residual + reading) * reading;
        square += reading * reading;
    }
    // Ten standard deviations of `a`.
    -product > 10.0 * signal.noise_std * square.sqrt()
}
