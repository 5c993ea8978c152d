//! Estimates the torque of each shaft, sample by sample, as the weighted median of what its gauges
//! give: reading less offset over the sensitivity at the carrier angle. Used where no reference
//! measures the torque; a shaft needs at least three gauges.

use std::borrow::Cow;

use crate::drivetrain::decimation::{forward_filled, interpolate_map};
use crate::drivetrain::inverse_dynamics::ShaftTorques;
use crate::drivetrain::recorded_samples::DrivetrainRecording;
use loadtwin_machine::{Channel, Drivetrain, Machine, MachineError, Senses, earlier};

/// Fewest gauges of a shaft for a median that tolerates one faulty gauge.
pub(crate) const MIN_GAUGES: usize = 3;

/// A gauge that responds to the torque of a shaft.
struct GaugeTorque<'a> {
    /// What it read, at the samples where it was so [SI].
    reading: Cow<'a, [f64]>,
    /// Reading at no torque [SI].
    offset: f64,
    /// Reading for one newton metre, referred, over the carrier angle.
    table: Vec<f64>,
    /// By how much larger a part the response is for each newton metre, referred.
    per_torque: f64,
    noise_std: f64,
}

/// Torque of each shaft as the weighted median of what its gauges say,
/// sample by sample:
///
/// `median of (y_k - o_k) / m_k(angle) with weights |m_k| / s_k`.
///
/// A median, so that what ails one gauge stays in its own residual. None where
/// a shaft has fewer than [`MIN_GAUGES`] gauges.
///
/// # Errors
/// When a map cannot be read.
pub(crate) fn torques(
    machine: &Machine,
    drivetrain: &Drivetrain,
    recorded: &DrivetrainRecording,
) -> Result<ShaftTorques, MachineError> {
    let shafts = drivetrain
        .shafts
        .iter()
        .map(|shaft| {
            let gauges = machine
                .channels
                .iter()
                .enumerate()
                .filter(|(_, c)| c.senses == Senses::Shaft(shaft.name.clone()))
                .map(|(k, c)| {
                    let reading = earlier(&recorded.channels[k], -c.late_s / recorded.dt_s);
                    GaugeTorque::new(machine, drivetrain, reading, c, shaft.speed_ratio)
                })
                .collect::<Result<Vec<_>, _>>()?;
            Ok((gauges.len() >= MIN_GAUGES).then(|| weighted_median_torque(&gauges, recorded)))
        })
        .collect::<Result<_, MachineError>>()?;
    Ok(ShaftTorques {
        shafts,
        balance: None,
        response: None,
    })
}

impl<'a> GaugeTorque<'a> {
    fn new(
        machine: &Machine,
        drivetrain: &Drivetrain,
        reading: Cow<'a, [f64]>,
        channel: &Channel,
        ratio: f64,
    ) -> Result<Self, MachineError> {
        let noise = channel.noise_over_angle(machine)?;
        Ok(Self {
            reading,
            offset: channel.to_si(channel.offset),
            table: channel
                .sensitivity_over_angle(machine)?
                .iter()
                .map(|m| m / ratio)
                .collect(),
            per_torque: channel.nonlinearity / (ratio * drivetrain.nominal_sensed(&channel.senses)),
            noise_std: (noise.iter().map(|s| s * s).sum::<f64>() / noise.len() as f64).sqrt(),
        })
    }

    /// The torque whose nonlinear response is `bent`: `s (1 + n s) = bent`.
    fn linearise(&self, bent: f64) -> f64 {
        2.0 * bent / (1.0 + (1.0 + 4.0 * self.per_torque * bent).max(0.0).sqrt())
    }
}

fn weighted_median_torque(gauges: &[GaugeTorque<'_>], recorded: &DrivetrainRecording) -> Vec<f64> {
    let mut estimates: Vec<(f64, f64)> = Vec::with_capacity(gauges.len());
    let torque: Vec<f64> = (0..recorded.len())
        .map(|i| {
            estimates.clear();
            estimates.extend(gauges.iter().filter_map(|gauge| {
                let over_angle = gauge.table.len() > 1;
                let angle = if over_angle { recorded.angle[i] } else { 0.0 };
                let (m, _) = interpolate_map(&gauge.table, angle);
                let bent = (gauge.reading[i] - gauge.offset) / m;
                let torque = gauge.linearise(bent);
                torque
                    .is_finite()
                    .then_some((torque, m.abs() / gauge.noise_std))
            }));
            if estimates.len() < MIN_GAUGES {
                return f64::NAN;
            }
            median(&mut estimates)
        })
        .collect();
    forward_filled(&torque)
}

/// The value on both sides of which lies half of the weight of at least one vote: between the two
/// next to it by a straight line over the weight.
pub(crate) fn median(estimates: &mut [(f64, f64)]) -> f64 {
    estimates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * estimates.iter().map(|v| v.1).sum::<f64>();
    let (mut below, mut before) = (0.0, estimates[0]);
    let mut middle_before = f64::NEG_INFINITY;
    for vote in estimates.iter() {
        // Weight up to the middle of this vote.
        let middle = below + 0.5 * vote.1;
        if middle >= half {
            if !middle_before.is_finite() {
                return vote.0;
            }
            let part = (half - middle_before) / (middle - middle_before);
            return before.0 + part * (vote.0 - before.0);
        }
        below += vote.1;
        (before, middle_before) = (*vote, middle);
    }
    before.0
}

#[cfg(test)]
mod tests {
    use super::median;

    #[test]
    fn one_wrong_vote_hardly_moves_the_median() {
        assert_eq!(median(&mut [(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)]), 2.0);
        let with_outlier = median(&mut [(1.0, 1.0), (2.0, 1.0), (3.0, 1.0), (1e6, 1.0)]);
        assert_eq!(with_outlier, 2.5);
        // Half of the weight, 6, lies between the middles 5 and 10.5 of the first two.
        assert_eq!(
            median(&mut [(1.0, 10.0), (2.0, 1.0), (3.0, 1.0)]),
            1.0 + 1.0 / 5.5
        );
    }
}
