//! Computes the parameters of the estimator's consistency tests of gauges and speeds: averaging
//! window, bounds of the averaged squared residuals for one false alarm in a million samples, model
//! error of a channel, largest plausible turn in a sample.

use loadtwin_common::drivetrain::Consistency;

use crate::gearbox::channel_tables::Tables;
use loadtwin_machine::Channel;

/// Standard deviations that a Gaussian exceeds once in a million samples: the false-alarm rate.
const QUANTILE: f64 = 4.9;

/// Time constant of the window over which residuals are averaged [s]: long against the noise of
/// a sample, short against the two seconds within which a load must be right or not valid.
const WINDOW_S: f64 = 0.1;

/// Share of a gauge's response that its map is off by, one standard deviation: strain maps of
/// finite elements, and calibrations on other units of a series, are off by 1 to 3 %.
const MAP_STD: f64 = 0.03;

/// Offset of a zero that was taken before a recording, in nominal responses, one standard deviation.
const ZERO_STD: f64 = 0.005;

/// Speeds that are plausible, in nominal ones: a runaway doubles the nominal speed, an encoder
/// aliased by a turn a sample has hundreds.
const FASTEST: f64 = 5.0;

/// Tests at samples `dt_s` apart of a machine with the nominal speed `speed` [rad/s].
///
/// An exponential window with forgetting `a` averages as many samples as `2 / a - 1` independent
/// ones; the quantile of chi-squared over n, over n, is `(1 - 2 / 9n + q sqrt(2 / 9n))^3`.
///
/// Source: Wilson, Hilferty 1931.
pub(super) fn consistency(dt_s: f64, speed: f64) -> Consistency {
    let forgetting = (dt_s / WINDOW_S).min(0.2);
    let ninth = 2.0 / (9.0 * (2.0 / forgetting - 1.0));
    let noise_bound = (1.0 - ninth + QUANTILE * ninth.sqrt()).powi(3);
    Consistency {
        forgetting: forgetting as f32,
        noise_bound: noise_bound as f32,
        model_bound: (QUANTILE * QUANTILE) as f32,
        most_turn: (FASTEST * speed.abs() * dt_s).max(1e-6) as f32,
    }
}

/// Standard deviation of a gauge's zero that no description gives [SI].
pub(super) fn zero_std(tables: &Tables) -> f64 {
    ZERO_STD * tables.rms_response()
}

/// Standard deviation of the reading's model error at any load, and at nominal load beside it
/// [the channel's unit].
pub(super) fn model_error(channel: &Channel, tables: &Tables) -> [f32; 2] {
    let response = tables.rms_response() / tables.unit;
    let drift = (channel.drift).map_or(0.0, |drift| channel.to_si(drift.std) / tables.unit);
    [
        (zero_std(tables) / tables.unit).hypot(drift) as f32,
        (MAP_STD * response) as f32,
    ]
}
