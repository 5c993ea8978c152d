//! Computes process and measurement noise of a drive's filter from the bandwidths that are required
//! of motion and load and from the noise of the sensors: density of the jerk, variance of the
//! load's random walk, standard deviations at the start.

use std::f64::consts::TAU;

use loadtwin_machine::{Balance, Machine, Regime};

/// The motion is estimated to this many times the load's cut-off, as `loadtwin diagnose` smooths it.
const MOTION_BAND: f64 = 5.0;

/// Highest band of the motion, in parts of the sample rate: about ten samples determine an
/// acceleration.
const WIDEST: f64 = 0.08;

/// Band of positions that are held one by one, in parts of the sample rate: each row counts alone.
const ROW_BY_ROW: f64 = 0.3;

/// The numbers that a filter's bands follow from.
pub(super) struct Noise {
    /// Standard deviation of the drive about the model: what is unexplained would else be taken for
    /// an acceleration.
    pub drive_std: f64,
    /// Power density of the jerk.
    pub jerk_density: f64,
    /// Variance that the load gains in a sample.
    pub load_variance: f64,
    /// Standard deviation of position, speed, acceleration and load at the start.
    pub initial_std: [f64; 4],
}

impl Noise {
    /// The steady filter of a motion whose jerk is white has the band
    /// `w = (q / (r dt))^(1/2n)`, with `n` integrators from the jerk to what is measured and `r` the
    /// variance of its noise; that of a random walk `w = sqrt(q / (r dt))`.
    ///
    /// Source: Kalata 1984, The tracking index, eq. (7).
    pub(super) fn new(machine: &Machine, balance: &Balance, model_std: f64, nominal: f64) -> Self {
        let dt = 1.0 / machine.rate_hz;
        let cutoff = machine.tuning.cutoff_hz;
        let [motion, load] = match balance.regime {
            Regime::Holding => [ROW_BY_ROW / dt; 2],
            Regime::Moving | Regime::Steady => [
                (MOTION_BAND * cutoff).min(WIDEST / dt),
                cutoff.min(ROW_BY_ROW / dt),
            ],
        };
        let [motion, load] = [TAU * motion, TAU * load];
        let power = |signal, order| balance.noise_std(signal).powi(2) * dt * motion.powi(order);
        let of_position = balance.position.as_ref().map(|s| power(s, 6));
        let of_speed = balance.speed.as_ref().map(|s| power(s, 4));
        let jerk_density = of_position.into_iter().chain(of_speed).fold(0.0, f64::max);
        // What an acceleration is not known to is no load either.
        let inertial = jerk_density * balance.inertia.powi(2) * (load / motion).powi(6) * dt;
        let drive_std = balance.noise_std(&balance.drive).hypot(model_std);
        let measured = (drive_std * load * dt).powi(2);
        let x = (balance.position.as_ref()).map_or(1.0, |s| 10.0 * balance.noise_std(s));
        let v = (balance.speed.as_ref()).map_or(x * motion, |s| 10.0 * balance.noise_std(s));
        Self {
            drive_std,
            jerk_density,
            load_variance: measured.max(inertial),
            initial_std: [x, v, v * motion, nominal],
        }
    }
}
