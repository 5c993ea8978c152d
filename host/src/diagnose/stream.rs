//! Residuals: what was measured less what today's model says, a stream for
//! each thing that is measured.

use super::signals::{Signals, smooth};
use crate::simulate::Course;

/// What kind of residual a stream is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A channel that answers to a torque, given that torque.
    Strain,
    /// Torque that the loads bring in and neither inertias nor drag take
    /// [N m referred]: `sum loads - sum J dw/dt - sum c w`, smoothed.
    Balance,
    /// Angle of a further encoder against the first, less the twist [rad].
    Angle,
}

/// What tells the torque that a recording's residuals are given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Told {
    /// Reference loads.
    References,
    /// All gauges of a shaft together: what they have in common is not seen.
    Gauges,
}

/// One residual, sample by sample of [`Signals`].
#[derive(Clone, Debug)]
pub struct Stream {
    /// Channel, `torque balance`, or encoder.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// Group of the channel.
    pub group: Option<String>,
    /// Measured less predicted; NaN where there is none.
    pub residual: Vec<f64>,
    /// The same of a clean simulation that did what the recording did; empty
    /// where there is none.
    pub clean: Vec<f64>,
    /// Full scale: what the stream reads at nominal load, root mean square.
    pub scale: f64,
    /// Standard deviation of a sample that the description expects.
    pub noise_std: f64,
    /// Reading for one newton metre, referred; empty but for strain.
    pub map: Vec<f64>,
    /// What the model reads without its zero; empty but for strain.
    pub reading: Vec<f64>,
    /// Change of that with the carrier angle [1/rad]; empty but for strain.
    pub slope: Vec<f64>,
    /// Number of the shaft whose torque it answers to.
    pub shaft: Option<usize>,
    /// Whether the maps are over the carrier angle.
    pub over_angle: bool,
    /// For an angle: signs with which the twists of the shafts enter.
    pub twists: Vec<f64>,
    /// For an angle: number of the inertia of the first encoder and of its own.
    pub inertias: [usize; 2],
    /// Raw samples, how many of them stood out alone, repeated a word, were missing.
    pub samples: u64,
    /// Raw samples that stood out alone.
    pub spikes: u64,
    /// Raw samples that repeated a word for longer than noise allows.
    pub stuck: u64,
}

/// A way in which a signal enters the residuals: what an effect predicts for
/// every stream follows from it.
#[derive(Clone, Debug)]
pub enum Term {
    /// `scale u` in each strain: a zero that moves; `u` in parts of full scale.
    Zero(Vec<f64>),
    /// `reading u`: a response that changes by the part `u`.
    Gain(Vec<f64>),
    /// A torque `u` in parts of nominal that brakes inertia `body`: in the
    /// balance, and in each strain as far as the loads of the known side do
    /// not tell it.
    Brake {
        /// Number of the inertia.
        body: usize,
        /// Torque, part of nominal.
        u: Vec<f64>,
        /// Whether it changes faster than the loads of one side tell the
        /// torque, so that the chain's own response matters.
        fast: bool,
    },
    /// An error `u` [rad] of the angle that the encoder on inertia `body` counts.
    Angle {
        /// Number of the inertia.
        body: usize,
        /// Error, referred [rad].
        u: Vec<f64>,
    },
    /// Lost motion `u` in parts of the nominal twist of shaft `shaft`.
    Twist {
        /// Number of the shaft.
        shaft: usize,
        /// Part of the nominal twist.
        u: Vec<f64>,
    },
    /// One column for each stream; empty where nothing is predicted.
    Each(Vec<Vec<f64>>),
}

/// A recording as residuals and the signals that may explain them.
#[derive(Clone, Debug)]
pub struct Session {
    /// The signals.
    pub signals: Signals,
    /// The residuals.
    pub streams: Vec<Stream>,
    /// Nominal twist of each shaft, referred [rad].
    pub twist: Vec<f64>,
    /// What would have to be done to see the same again; none where the first
    /// load is not known.
    pub course: Option<Course>,
    /// What tells the torque.
    pub told: Told,
}

/// Columns of one linear parameter, one for each stream; empty where it
/// predicts nothing.
pub type Columns = Vec<Vec<f64>>;

impl Session {
    /// The column of `term` in each stream.
    pub fn columns(&self, term: &Term) -> Columns {
        match term {
            Term::Zero(u) => self.each(|s| match s.kind {
                Kind::Strain => scaled(u, s.scale),
                _ => Vec::new(),
            }),
            Term::Gain(u) => self.each(|s| product(&s.reading, u)),
            Term::Brake { body, u, fast } => self.brake(*body, u, *fast),
            Term::Angle { body, u } => self.angle(*body, u),
            Term::Twist { shaft, u } => self.each(|s| match s.kind {
                Kind::Angle => scaled(u, s.twists[*shaft] * self.twist[*shaft]),
                _ => Vec::new(),
            }),
            Term::Each(columns) => columns.clone(),
        }
    }

    fn each(&self, column: impl Fn(&Stream) -> Vec<f64>) -> Columns {
        self.streams.iter().map(column).collect()
    }

    fn brake(&self, body: usize, u: &[f64], fast: bool) -> Columns {
        let signals = &self.signals;
        let brake = scaled(u, signals.nominal_torque);
        let slow = smooth(&brake, signals.smoothing);
        let unexplained = if fast {
            signals.unexplained_torque(body, &brake)
        } else {
            signals.response.as_ref().map(|r| {
                let told = |side: &Vec<f64>| match side[body] {
                    0.0 => Vec::new(),
                    sign => scaled(&slow, sign),
                };
                r.side.iter().map(told).collect()
            })
        };
        self.each(|s| match (s.kind, &unexplained, s.shaft) {
            (Kind::Balance, ..) => slow.clone(),
            (Kind::Strain, Some(torques), Some(shaft)) => product(&s.map, &torques[shaft]),
            _ => Vec::new(),
        })
    }

    fn angle(&self, body: usize, u: &[f64]) -> Columns {
        let signals = &self.signals;
        let acceleration = second_difference(u, signals.smoothing, signals.dt_s);
        let moment = signals.response.as_ref().map_or(0.0, |r| r.bodies[body].0);
        self.each(|s| match s.kind {
            Kind::Balance if moment > 0.0 => scaled(&acceleration, -moment),
            Kind::Angle if s.inertias[0] == body => scaled(u, -1.0),
            Kind::Angle if s.inertias[1] == body => u.to_vec(),
            // The first encoder tells the carrier angle of the maps.
            Kind::Strain if s.over_angle && body == 0 => {
                product(&s.slope, u).iter().map(|v| -v).collect()
            }
            _ => Vec::new(),
        })
    }
}

/// `x u`, sample by sample; empty where either is.
pub fn product(x: &[f64], u: &[f64]) -> Vec<f64> {
    x.iter().zip(u).map(|(x, u)| x * u).collect()
}

fn scaled(u: &[f64], factor: f64) -> Vec<f64> {
    u.iter().map(|u| u * factor).collect()
}

/// Second derivative as the balance takes it: of moving means, over their width.
fn second_difference(u: &[f64], width: usize, dt_s: f64) -> Vec<f64> {
    let mean = super::signals::moving_mean(u, width);
    let last = u.len().saturating_sub(1);
    let at = |i: isize| mean[i.clamp(0, last as isize) as usize];
    let (h, span) = (width as isize, width as f64 * dt_s);
    (0..u.len() as isize)
        .map(|i| (at(i + h) - 2.0 * at(i) + at(i - h)) / (span * span))
        .collect()
}
