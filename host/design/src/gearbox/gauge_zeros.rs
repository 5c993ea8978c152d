//! Selects the gauges whose zero the drivetrain filter estimates as a state: those that are
//! described to drift, and those whose unknown zero would change the load by more than 3 % of
//! nominal. Gives standard deviation and time constant of each.

use crate::gearbox::channel_tables::Tables;
use crate::gearbox::consistency_parameters::zero_std;
use crate::sensor_set::{Filter, Sensors};
use loadtwin_machine::{Channel, Drift, MAP_ENTRIES, Senses};

/// Error of a load from a gauge's zero above which the zero is a state, root mean square over a turn
/// of the carrier [parts of nominal]: the error that counts as wrong in `docs/reference/faults.md`.
const LARGEST_ERROR: f64 = 0.03;

/// Time constant of a zero that no description gives [s]: housings warm up within an hour.
const ZERO_TIME_S: f64 = 3600.0;

/// Gauges whose zero is a state of the filter, by number of channel, with its drift [SI].
///
/// A zero `z_i` of gauge `i` moves the load by `z_i w_i h_i / sum_j w_j h_j^2` at an angle where the
/// gauges respond to the nominal load by `h_j`, with noise of variance `1 / w_j`. Where a map passes
/// through zero and no other gauge responds, a zero of 0.5 % makes a load of any size. The
/// map's changes over the angle then separate zero and load.
pub(super) fn estimated_zeros(sensors: &Sensors, tables: &[Tables]) -> Vec<(usize, Drift)> {
    let gauges = || {
        let channels = sensors.channels.iter().zip(tables).enumerate();
        channels.filter(|(_, (channel, _))| !matches!(channel.senses, Senses::Drive(_)))
    };
    let mut information = [0.0; MAP_ENTRIES];
    for (_, (_, tables)) in gauges() {
        for (step, sum) in information.iter_mut().enumerate() {
            *sum += (tables.response(step) / tables.noise).powi(2);
        }
    }
    // A table of steady gains has no states of zeros.
    let estimates = sensors.filter == Filter::Aekf;
    let implied = |tables: &Tables| {
        let std = zero_std(tables);
        let errors = information.iter().enumerate().map(|(step, sum)| {
            (std * tables.response(step) / (tables.noise.powi(2) * sum)).powi(2)
        });
        let error = (errors.sum::<f64>() / MAP_ENTRIES as f64).sqrt();
        let time_s = ZERO_TIME_S;
        (estimates && error > LARGEST_ERROR).then_some(Drift { std, time_s })
    };
    let drift = |channel: &Channel, tables: &Tables| match channel.drift {
        Some(drift) => Some(Drift {
            std: channel.to_si(drift.std),
            ..drift
        }),
        None => implied(tables),
    };
    gauges()
        .filter_map(|(i, (channel, tables))| Some((i, drift(channel, tables)?)))
        .collect()
}
