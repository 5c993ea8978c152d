//! Predicts what encoders and gauges of a drivetrain read under the loads of a recording, for any inertias,
//! stiffnesses, damping and drag (`RecordedMotion`); lists the errors of sensors and references that are
//! not to be taken for an error of these (nuisance columns).

use std::path::Path;

use crate::diagnosis::DiagnoseError;
use crate::drivetrain::decimated_signals::Signals;
use crate::drivetrain::residual_computation::RecordingContext;
use crate::drivetrain::residual_reader::{read_given, recording};
use crate::drivetrain::residual_signals::{Kind, ResidualSignal, TorqueSource, product};
use crate::smoothing::smooth;
use loadtwin_design::gearbox::Torsion;
use loadtwin_machine::{Drivetrain, Machine, earlier};

/// Part of nominal speed over which dry friction changes its sign.
const STANDSTILL: f64 = 0.002;

/// Part of nominal torque over which the flanks of a mesh change sides.
const FLANK_CHANGE: f64 = 0.01;

/// Time constants of creep in gauges that cover seconds to minutes [s].
const CREEP_S: [f64; 2] = [3.0, 20.0];

/// A recording with known loads, and residuals of its sensors.
pub(super) struct RecordedMotion<'a> {
    context: RecordingContext<'a>,
    /// Signals of the machine as described.
    pub signals: Signals,
    /// The residuals that respond to the parameters.
    pub sensors: Vec<SensorResidual>,
}

/// Residual of one sensor for the parameters described.
pub(super) struct SensorResidual {
    /// Name, unit, residual.
    pub signal: ResidualSignal,
    /// Raw samples by which the sensor is late.
    late: f64,
    /// What other errors do to it.
    pub nuisances: Vec<Vec<f64>>,
}

impl SensorResidual {
    /// Name of the sensors that err alike: a group of gauges, or the sensor itself.
    pub fn group(&self) -> String {
        let signal = &self.signal;
        let group = signal.group.as_ref().unwrap_or(&signal.name);
        format!("{:?} {group}", signal.kind)
    }
}

impl<'a> RecordedMotion<'a> {
    /// Reads `path`.
    ///
    /// # Errors
    /// When it cannot be read, or a load has no reference in it.
    pub fn read(machine: &'a Machine, path: &Path) -> Result<Self, DiagnoseError> {
        let mut context = read_given(machine, path, TorqueSource::References)?;
        let loads = context.drivetrain.loads.iter().zip(&context.known);
        let unknown: Vec<&str> = loads
            .filter_map(|(load, known)| known.is_none().then_some(load.name.as_str()))
            .collect();
        if !unknown.is_empty() {
            return Err(DiagnoseError::TooLittle {
                recording: path.to_owned(),
                reason: format!(
                    "no values of a reference for {}; the loads must be known: add [[reference]] and its column",
                    unknown.join(", ")
                ),
            });
        }
        let applied = context.known.iter_mut().chain(&mut context.drives);
        for torque in applied.flatten() {
            *torque = between_samples(torque);
        }
        context.torques = context.torques_of(context.drivetrain);
        let mut residuals = recording(&context, TorqueSource::References, &[])?;
        residuals.mask_quantised_standstill();
        let signals = residuals.signals;
        // A described bending load is estimated from the gauges, which then say nothing of the torque alone.
        let is_bent = context.drivetrain.bending.is_some();
        let responds = |signal: &ResidualSignal| match signal.kind {
            Kind::Strain => signal.shaft.is_some() && !is_bent,
            Kind::Balance | Kind::Angle => true,
            Kind::Innovation => false,
        };
        let sensor = |signal: ResidualSignal| {
            let channel = machine.channels.iter().find(|c| c.name == signal.name);
            SensorResidual {
                late: channel.map_or(0.0, |c| c.late_s) / context.recorded.dt_s,
                nuisances: nuisances(&signal, &signals),
                signal,
            }
        };
        let sensors = residuals.residuals.into_iter().filter(responds);
        Ok(Self {
            sensors: sensors.map(sensor).collect(),
            context,
            signals,
        })
    }

    /// Residual of each sensor for the parameters of `drivetrain`; NaN where there is none.
    ///
    /// A gauge reads the torque of its shaft, an encoder against the first one the sum of twists
    /// `tau / k`, the torque balance `sum loads - sum J dw/dt - sum c w - friction`.
    pub fn residuals(&self, drivetrain: &Drivetrain) -> Vec<Vec<f64>> {
        let (context, thin) = (&self.context, &self.context.thin);
        let torques = context.torques_of(drivetrain);
        let torsion = Torsion::new(drivetrain);
        let stiffness: Vec<f64> = torsion.referred_stiffness().collect();
        let described: Vec<f64> = context.torsion.referred_stiffness().collect();
        let n = context.recorded.len();
        let change = |s: usize, per: [f64; 2]| -> Vec<f64> {
            match (&torques.shafts[s], &context.torques.shafts[s]) {
                (Some(now), Some(was)) => (now.iter().zip(was))
                    .map(|(now, was)| now / per[1] - was / per[0])
                    .collect(),
                _ => vec![0.0; n],
            }
        };
        let residual = |sensor: &SensorResidual| {
            let signal = &sensor.signal;
            let change = match (signal.kind, signal.shaft) {
                (Kind::Balance, _) => {
                    let balance = torques.balance.as_deref().unwrap_or_default();
                    return thin.residual(balance);
                }
                (Kind::Strain, Some(s)) => {
                    let torque = change(s, [1.0, 1.0]);
                    product(&signal.map, &thin.means(&earlier(&torque, sensor.late)))
                }
                _ => {
                    let mut angle = vec![0.0; n];
                    for (s, sign) in signal.twists.iter().enumerate() {
                        let twist = change(s, [described[s], stiffness[s]]);
                        for (angle, twist) in angle.iter_mut().zip(twist) {
                            *angle += sign * twist;
                        }
                    }
                    thin.means(&angle)
                }
            };
            let pairs = signal.residual.iter().zip(change);
            pairs.map(|(r, c)| r - c).collect()
        };
        self.sensors.iter().map(residual).collect()
    }
}

/// The torque `u` with what the simulation of the chain takes from it, which holds over each step the mean of its
/// ends: a mode that it excites at `w` answers by the part `sin(w dt) / (w dt)`, `1 - (w dt)^2 / 6`.
///
/// `u_i - (u_(i-1) - 2 u_i + u_(i+1)) / 6`
fn between_samples(u: &[f64]) -> Vec<f64> {
    let last = u.len().saturating_sub(1);
    (0..u.len())
        .map(|i| {
            let around = u[i.saturating_sub(1)] + u[(i + 1).min(last)];
            u[i] - (around - 2.0 * u[i]) / 6.0
        })
        .collect()
}

/// What other errors do to a sensor: its zero and gain, a bend, a delay, creep, warmth; friction on either
/// side of a gauge; zero, gain and time of a reference in the balance; lost motion in an angle; vibrations
/// that the recording begins with.
fn nuisances(signal: &ResidualSignal, signals: &Signals) -> Vec<Vec<f64>> {
    let n = signals.len();
    let sign: Vec<f64> = (signals.relative_speed())
        .map(|w| (w / STANDSTILL).tanh())
        .collect();
    let load: Vec<f64> = signals.level.iter().map(|l| l.abs()).collect();
    let loss = product(&sign, &load);
    let mut columns = vec![vec![1.0; n]];
    match signal.kind {
        Kind::Balance => {
            let slow = |x: &[f64]| smooth(x, signals.smoothing);
            columns.extend([slow(&sign), slow(&loss), slow(&signals.level)]);
            columns.push(signals.time_skew());
        }
        Kind::Angle => {
            let lost = |l: &f64| (l / FLANK_CHANGE).tanh();
            columns.push(signals.level.iter().map(lost).collect());
        }
        Kind::Strain | Kind::Innovation => {
            let reading = &signal.reading;
            columns.extend([reading.clone(), product(reading, &load)]);
            columns.extend([rate(reading), signal.slope.clone()]);
            let speed: Vec<f64> = signals.relative_speed().collect();
            columns.extend([sign, speed, loss].map(|u| product(&signal.map, &u)));
            columns.extend(CREEP_S.map(|time_s| lagging(&signals.level, signals.dt_s / time_s)));
            columns.extend(signals.warming.clone());
            columns.push(signals.t.clone());
        }
    }
    columns.extend(signal.initial_vibrations.iter().cloned());
    columns.retain(|column| column.len() == n);
    columns
}

/// Differences of neighbours.
fn rate(x: &[f64]) -> Vec<f64> {
    let last = x.len().saturating_sub(1);
    (0..x.len())
        .map(|i| x[(i + 1).min(last)] - x[i.saturating_sub(1)])
        .collect()
}

/// `x` behind a first-order lag of `1 / part` samples.
fn lagging(x: &[f64], part: f64) -> Vec<f64> {
    let part = -(-part).exp_m1();
    let mut state = x.first().copied().unwrap_or(0.0);
    x.iter()
        .map(|x| {
            state += part * (x - state);
            state
        })
        .collect()
}
