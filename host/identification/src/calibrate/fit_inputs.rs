//! Computes the inputs of the calibration fit of one channel, delayed as the channel is: carrier
//! angle, nonlinear load term with its gain by temperature, and zero shift by creep, hysteresis and
//! temperature.

use std::borrow::Cow;

use loadtwin_machine::{Channel, Machine, earlier};

/// What the reading of a channel is in proportion to, and how its zero moves; where the carrier was.
pub(super) struct FitInputs<'a> {
    /// Carrier angle when each reading was taken [rad]; NaN where it is not known.
    pub(super) angle: Cow<'a, [f64]>,
    /// As [`Channel::bent`], warmed.
    pub(super) bent: Vec<f64>,
    /// Creep, hysteresis and temperature rise [SI].
    pub(super) zero: Vec<f64>,
}

impl<'a> FitInputs<'a> {
    pub(super) fn new(
        machine: &Machine,
        channel: &Channel,
        angle: &'a [f64],
        sensed: &[f64],
        warming: Option<&[f64]>,
    ) -> Self {
        let late = channel.late_s * machine.rate_hz;
        let sensed = &earlier(sensed, late);
        let nominal = (machine.drivetrain.as_ref())
            .map_or(1.0, |drivetrain| drivetrain.nominal_sensed(&channel.senses));
        let level = |s: &f64| if s.is_finite() { s / nominal } else { 0.0 };
        let crept = channel.creep.map_or(vec![0.0; sensed.len()], |creep| {
            creep.course(sensed.iter().map(level), 1.0 / machine.rate_hz)
        });
        let mut last = 0.0;
        let held = sensed.iter().map(|s| {
            if s.is_finite() {
                last = s / nominal;
            }
            last
        });
        let turned = (channel.hysteresis).map_or(vec![0.0; sensed.len()], |h| h.course(held));
        let thermal = channel.thermal.unwrap_or_default();
        let warm = |i: usize| warming.and_then(|w| w.get(i)).copied().unwrap_or(0.0);
        Self {
            angle: earlier(angle, late),
            bent: (sensed.iter().enumerate())
                .map(|(i, s)| channel.bent(*s, nominal) * (1.0 + thermal.gain_per_k * warm(i)))
                .collect(),
            zero: (crept.into_iter().zip(turned).enumerate())
                .map(|(i, (z, q))| channel.to_si(z + q + thermal.zero_per_k * warm(i)))
                .collect(),
        }
    }
}
