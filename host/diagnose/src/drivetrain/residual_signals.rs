//! Defines the residual signals of a drivetrain recording and the regressors of effects (offset,
//! gain, resisting torque, encoder error, lost motion or shaft response), and computes the column
//! of each regressor in every signal.

use crate::drivetrain::chain_response::ShaftResponse;
use crate::drivetrain::decimated_signals::Signals;
use crate::drivetrain::decimation::interpolate_map;
use crate::residual_model::Columns;
use crate::smoothing::smooth;
use loadtwin_simulate::Course;

/// What kind of residual a signal is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A channel that responds to a torque, given that torque.
    Strain,
    /// Torque that the loads bring in and neither inertias nor drag nor described friction take
    /// [N m referred]: `sum loads - sum J dw/dt - sum c w - sum friction`, smoothed.
    Balance,
    /// Angle of a further encoder against the first, less the twist (rad).
    Angle,
    /// Innovation of a sensor over its standard deviation.
    Innovation,
}

/// Source of the torque that a recording's residuals are given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TorqueSource {
    /// Reference loads.
    References,
    /// All gauges of a shaft together: an error common to all is not observable.
    Gauges,
    /// The filter, where gauges are too few: an error that it estimates as load is not observable.
    Filter,
}

/// One residual, sample by sample of [`Signals`].
#[derive(Clone, Debug)]
pub struct ResidualSignal {
    /// Channel, `torque balance`, or encoder.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// Unit of the residual.
    pub unit: &'static str,
    /// Group of the channel.
    pub group: Option<String>,
    /// Measured less predicted; NaN where there is none.
    pub residual: Vec<f64>,
    /// The same of a fault-free simulation that did what the recording did; empty
    /// where there is none.
    pub fault_free: Vec<f64>,
    /// Full scale: what the signal reads at nominal load, root mean square.
    pub scale: f64,
    /// Standard deviation of a sample that the description expects.
    pub noise_std: f64,
    /// Reading for one newton metre, referred; empty but for strain.
    pub map: Vec<f64>,
    /// What the model reads without its zero; empty but for strain.
    pub reading: Vec<f64>,
    /// Change of that with the carrier angle [1/rad]; empty but for strain.
    pub slope: Vec<f64>,
    /// Reading for one newton metre, referred, over the carrier angle; empty
    /// where it is the same everywhere.
    pub table: Vec<f64>,
    /// The torque or speed that it responds to.
    pub sensed: Vec<f64>,
    /// Changes with the uncertain parameters of the machine, each by a standard deviation.
    pub parameter_sensitivities: Vec<Vec<f64>>,
    /// What may vibrate since before the recording, each by a standard deviation.
    pub initial_vibrations: Vec<Vec<f64>>,
    /// Number of the shaft whose torque it responds to.
    pub shaft: Option<usize>,
    /// For an angle: signs with which the twists of the shafts enter.
    pub twists: Vec<f64>,
    /// For an angle: number of the inertia of the first encoder and of its own.
    pub inertias: [usize; 2],
    /// Raw samples.
    pub samples: u64,
    /// Raw samples that stood out alone, beyond the tail of the noise.
    pub spikes: u64,
    /// Raw samples that repeated a word for longer than noise allows.
    pub stuck: u64,
}

/// A way in which a signal enters the residuals: what an effect predicts for
/// every signal follows from it.
#[derive(Clone, Debug)]
pub enum Regressor {
    /// `scale u` in each strain: a zero that moves; `u` in parts of full scale.
    Offset(Vec<f64>),
    /// `reading u`: a response that changes by the part `u`.
    Gain(Vec<f64>),
    /// A torque `u` in parts of nominal that resists inertia `body`: in the
    /// balance, and in each strain as far as it follows neither from the loads of
    /// the known side nor from the chain's own response to the loads.
    ResistingTorque {
        /// Number of the inertia.
        body: usize,
        /// Torque, part of nominal.
        u: Vec<f64>,
        /// Whether the vibration it excites depends on how it sticks, and is not predicted.
        sticks: bool,
    },
    /// An error `u` (rad) of the angle that the encoder on inertia `body` counts.
    EncoderError {
        /// Number of the inertia.
        body: usize,
        /// Error, referred (rad).
        u: Vec<f64>,
        /// The error about which the maps are linearised (rad).
        about: Vec<f64>,
    },
    /// Lost motion `u` in parts of the nominal twist of shaft `shaft`.
    LostMotion {
        /// Number of the shaft.
        shaft: usize,
        /// Part of the nominal twist.
        u: Vec<f64>,
    },
    /// What the shafts do beyond the model: torque in the strains, twist in the angles.
    ShaftResponse(ShaftResponse),
    /// One column for each signal; empty where nothing is predicted.
    PerSignal(Vec<Vec<f64>>),
}

/// A recording as residuals and the signals that may explain them.
#[derive(Clone, Debug)]
pub struct DrivetrainResiduals {
    /// The signals.
    pub signals: Signals,
    /// The residuals.
    pub residuals: Vec<ResidualSignal>,
    /// Nominal twist of each shaft, referred (rad).
    pub twist: Vec<f64>,
    /// Torque and speed over time by which a simulation repeats the recording; none where the first
    /// load is not known.
    pub operating_profile: Option<Course>,
    /// Source of the torque.
    pub torque_source: TorqueSource,
    /// References without a value, where others have one.
    pub missing_references: Vec<String>,
    /// Standard deviation of the noise of each reference load, part of nominal.
    pub reference_noise: Vec<f64>,
}

impl DrivetrainResiduals {
    /// The column of `term` in each signal.
    pub fn columns_of(&self, term: &Regressor) -> Columns {
        match term {
            Regressor::Offset(u) => self.each(|s| match s.kind {
                Kind::Strain => scaled(u, s.scale),
                _ => Vec::new(),
            }),
            Regressor::Gain(u) => self.each(|s| product(&s.reading, u)),
            Regressor::ResistingTorque { body, u, sticks } => self.brake(*body, u, *sticks),
            Regressor::EncoderError { body, u, about } => self.angle(*body, u, about),
            Regressor::LostMotion { shaft, u } => self.each(|s| match s.kind {
                Kind::Angle => scaled(u, s.twists[*shaft] * self.twist[*shaft]),
                _ => Vec::new(),
            }),
            Regressor::ShaftResponse(change) => self.each(|s| match (s.kind, s.shaft) {
                (Kind::Strain, Some(shaft)) => product(&s.map, &change.torque[shaft]),
                (Kind::Angle, _) => s.along_twists(&change.twist),
                _ => Vec::new(),
            }),
            Regressor::PerSignal(columns) => columns.clone(),
        }
    }

    /// Masks standstills of a strain whose map is so steep that the resolution of the encoder
    /// limits its prediction, and those of an angle, if it moves at all: there the error of both
    /// is constant for as long as the machine rests.
    pub(crate) fn mask_quantised_standstill(&mut self) {
        let signals = &self.signals;
        let rests = |w: &f64| w.abs() * signals.dt_s < signals.count;
        let moves = !signals.speed.iter().all(rests);
        for signal in &mut self.residuals {
            let steep = signal.over_angle();
            let is_coarse = |i: usize| match signal.kind {
                Kind::Angle => moves,
                _ => steep && signal.slope[i].abs() * signals.count > signal.noise_std,
            };
            for (i, w) in signals.speed.iter().enumerate() {
                if rests(w) && is_coarse(i) {
                    signal.residual[i] = f64::NAN;
                }
            }
        }
    }

    fn each(&self, column: impl Fn(&ResidualSignal) -> Vec<f64>) -> Columns {
        self.residuals.iter().map(column).collect()
    }

    fn brake(&self, body: usize, u: &[f64], sticks: bool) -> Columns {
        let signals = &self.signals;
        let brake = scaled(u, signals.nominal_torque);
        let slow = smooth(&brake, signals.smoothing);
        let torques = if sticks {
            signals.unmodelled_slow_torque(body, &slow)
        } else {
            signals.unmodelled_torque(body, &brake)
        };
        self.each(|s| match (s.kind, &torques, s.shaft) {
            (Kind::Balance, ..) => slow.clone(),
            (Kind::Strain, Some(torques), Some(shaft)) => product(&s.map, &torques[shaft]),
            _ => Vec::new(),
        })
    }

    fn angle(&self, body: usize, u: &[f64], about: &[f64]) -> Columns {
        let signals = &self.signals;
        let acceleration = second_difference(u, signals.smoothing, signals.dt_s);
        // Sum of the inertias whose motion this encoder measures, each weighted by its `part`.
        let moment_of = |part: &dyn Fn(usize) -> f64| -> f64 {
            let bodies = signals.response.iter().flat_map(|r| &r.bodies).enumerate();
            let torque_source = bodies.filter(|(b, _)| signals.encoder_inertia[*b] == body);
            torque_source.map(|(b, (moment, _))| part(b) * moment).sum()
        };
        let side =
            |shaft: usize, b: usize| signals.response.as_ref().map_or(0.0, |r| r.side[shaft][b]);
        self.each(|s| match s.kind {
            Kind::Balance => scaled(&acceleration, -moment_of(&|_| 1.0)),
            Kind::Angle if s.inertias[0] == body => scaled(u, -1.0),
            Kind::Angle if s.inertias[1] == body => u.to_vec(),
            Kind::Strain => {
                let moment = s.shaft.map_or(0.0, |shaft| -moment_of(&|b| side(shaft, b)));
                let by_torque = product(&s.map, &scaled(&acceleration, moment));
                // The first encoder measures the carrier angle of the maps.
                if s.over_angle() && body == signals.encoder_inertia[0] {
                    let secant = self.secant(s, |i| about[i]);
                    let by_map = product(&secant, u);
                    by_torque.iter().zip(by_map).map(|(t, m)| t - m).collect()
                } else if moment == 0.0 {
                    Vec::new()
                } else {
                    by_torque
                }
            }
            _ => Vec::new(),
        })
    }

    /// `(reading(angle) - reading(angle - shift)) / shift` [1/rad]: the slope
    /// of the reading where the shift is small.
    pub fn secant(&self, signal: &ResidualSignal, shift: impl Fn(usize) -> f64) -> Vec<f64> {
        /// Shift below which the slope itself is taken [rad]: a difference over less is rounding.
        const SMALL: f64 = 1e-6;
        let angle = &self.signals.angle;
        signal
            .slope
            .iter()
            .enumerate()
            .map(|(i, slope)| {
                let by = shift(i);
                if by.abs() < SMALL {
                    return *slope;
                }
                let (here, tangent) = interpolate_map(&signal.table, angle[i]);
                let (there, _) = interpolate_map(&signal.table, angle[i] - by);
                // Only what the slope, a mean over the sample, does not say.
                slope + signal.sensed[i] * ((here - there) / by - tangent)
            })
            .collect()
    }
}

impl ResidualSignal {
    /// Whether its map is over the carrier angle.
    pub fn over_angle(&self) -> bool {
        !self.table.is_empty()
    }

    /// For an angle: whether it grows or falls as the shafts are twisted, 1 or -1; else 1.
    pub(crate) fn sign_of_twist(&self) -> f64 {
        let first = self.twists.iter().find(|sign| **sign != 0.0);
        first.map_or(1.0, |sign| sign.signum())
    }

    /// For an angle: what the twists of the shafts come to.
    pub fn along_twists(&self, twist: &[Vec<f64>]) -> Vec<f64> {
        let n = twist.first().map_or(0, Vec::len);
        (0..n)
            .map(|i| {
                self.twists
                    .iter()
                    .zip(twist)
                    .map(|(sign, t)| sign * t[i])
                    .sum()
            })
            .collect()
    }
}

/// `x u`, sample by sample; empty where either is.
pub fn product(x: &[f64], u: &[f64]) -> Vec<f64> {
    x.iter().zip(u).map(|(x, u)| x * u).collect()
}

fn scaled(u: &[f64], factor: f64) -> Vec<f64> {
    u.iter().map(|u| u * factor).collect()
}

/// Second derivative as in the balance: of moving means, over their width.
fn second_difference(u: &[f64], width: usize, dt_s: f64) -> Vec<f64> {
    let mean = crate::smoothing::moving_mean(u, width);
    let last = u.len().saturating_sub(1);
    let at = |i: isize| mean[i.clamp(0, last as isize) as usize];
    let (h, span) = (width as isize, width as f64 * dt_s);
    (0..u.len() as isize)
        .map(|i| (at(i + h) - 2.0 * at(i) + at(i - h)) / (span * span))
        .collect()
}
