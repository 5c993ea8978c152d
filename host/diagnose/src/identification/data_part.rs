//! Selects the part of recordings that is fitted or held out (`DataPart`), and computes the residuals of
//! its sensors beside what nuisance columns explain of them.

use std::ops::Range;

use rayon::prelude::*;

use super::parameter::{Parameter, with_offsets};
use super::recorded_motion::{RecordedMotion, SensorResidual};
use crate::regression::normal_equations::dot;
use loadtwin_machine::Drivetrain;

/// Part of each recording, its end, that is held out.
const HELD_OUT: f64 = 1.0 / 3.0;

/// Least number of samples of a sensor in a part of a recording.
const LEAST_SAMPLES: usize = 100;

/// Squared part of a nuisance column that has to be independent of those before it.
const INDEPENDENT: f64 = 1e-6;

/// A part of each recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// All of it.
    Whole,
    /// All but the end.
    Fitted,
    /// The end.
    HeldOut,
}

impl Part {
    fn range(self, n: usize) -> Range<usize> {
        let held_out = n - (HELD_OUT * n as f64) as usize;
        match self {
            Self::Whole => 0..n,
            Self::Fitted => 0..held_out,
            Self::HeldOut => held_out..n,
        }
    }
}

/// A sensor in a part of one recording.
pub(super) struct Stretch {
    /// Numbers of recording and sensor.
    pub of: [usize; 2],
    /// Samples with a residual.
    pub known: Vec<usize>,
    /// Orthonormal columns of other errors.
    nuisances: Vec<Vec<f64>>,
}

impl Stretch {
    fn new(of: [usize; 2], sensor: &SensorResidual, range: Range<usize>) -> Self {
        let residual = &sensor.signal.residual;
        let known: Vec<usize> = range.filter(|i| residual[*i].is_finite()).collect();
        let mut nuisances: Vec<Vec<f64>> = Vec::new();
        for column in &sensor.nuisances {
            let mut column: Vec<f64> = known.iter().map(|i| column[*i]).collect();
            let before = dot(&column, &column);
            // Twice: the first pass leaves rounding of columns that are nearly dependent.
            annihilate(&mut column, &nuisances);
            annihilate(&mut column, &nuisances);
            let size = dot(&column, &column);
            if size > INDEPENDENT * before {
                for c in &mut column {
                    *c /= size.sqrt();
                }
                nuisances.push(column);
            }
        }
        Self {
            of,
            known,
            nuisances,
        }
    }

    /// What the nuisance columns leave of `x`.
    fn beside_nuisances(&self, x: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = self.known.iter().map(|i| x[*i]).collect();
        annihilate(&mut x, &self.nuisances);
        x
    }

    /// Number of independent samples of residual `r` beyond those that the nuisance columns take:
    ///
    /// `n / (1 + 2 sum_k |rho_k|) - q`, at least 1,
    ///
    /// the autocorrelation `rho_k` summed up to the first two lags in a row within `2 / sqrt(n)`, so that
    /// a vibration counts as what it is: alike for long. `q` columns.
    ///
    /// Source: Bartlett 1946, "On the theoretical specification and sampling properties of autocorrelated
    /// time-series" (effective sample size).
    pub fn independent_samples(&self, r: &[f64]) -> f64 {
        let n = r.len();
        let square = dot(r, r).max(f64::MIN_POSITIVE);
        let bound = 2.0 / (n as f64).sqrt();
        let (mut sum, mut small) = (0.0, 0);
        for lag in 1..n / 4 {
            let rho = (dot(&r[lag..], &r[..n - lag]) / square).abs();
            small = if rho < bound { small + 1 } else { 0 };
            if small == 2 {
                break;
            }
            sum += rho;
        }
        (n as f64 / (1.0 + 2.0 * sum) - self.nuisances.len() as f64).max(1.0)
    }
}

/// Subtracts what `orthonormal` columns explain of `x`.
fn annihilate(x: &mut [f64], orthonormal: &[Vec<f64>]) {
    for column in orthonormal {
        let along = dot(x, column);
        for (x, c) in x.iter_mut().zip(column) {
            *x -= along * c;
        }
    }
}

/// A part of recordings, with the parameters that their residuals depend on.
pub(super) struct DataPart<'a> {
    pub parameters: &'a [Parameter],
    drivetrain: &'a Drivetrain,
    recordings: &'a [RecordedMotion<'a>],
    /// Sensors of all recordings.
    pub stretches: Vec<Stretch>,
}

impl<'a> DataPart<'a> {
    /// The `part` of `recordings` of the machine that `drivetrain` describes with `parameters`.
    pub fn new(
        drivetrain: &'a Drivetrain,
        parameters: &'a [Parameter],
        recordings: &'a [RecordedMotion<'a>],
        part: Part,
    ) -> Self {
        let of_recording = |(i, recording): (usize, &RecordedMotion<'_>)| {
            let range = part.range(recording.signals.len());
            let sensors = recording.sensors.iter().enumerate();
            sensors
                .map(|(k, sensor)| Stretch::new([i, k], sensor, range.clone()))
                .filter(|stretch| stretch.known.len() >= LEAST_SAMPLES)
                .collect::<Vec<_>>()
        };
        Self {
            parameters,
            drivetrain,
            recordings,
            stretches: (recordings.iter().enumerate())
                .flat_map(of_recording)
                .collect(),
        }
    }

    /// The sensor of `stretch`.
    pub fn sensor(&self, stretch: &Stretch) -> &'a SensorResidual {
        &self.recordings[stretch.of[0]].sensors[stretch.of[1]]
    }

    /// Sample period of recordings [s].
    pub fn dt_s(&self) -> f64 {
        self.recordings[0].signals.dt_s
    }

    /// Residual of each stretch with the parameters at `offsets`, beside other errors.
    pub fn residuals(&self, offsets: &[f64]) -> Vec<Vec<f64>> {
        let drivetrain = with_offsets(self.drivetrain, self.parameters, offsets);
        let of_recordings: Vec<Vec<Vec<f64>>> = (self.recordings.par_iter())
            .map(|recording| recording.residuals(&drivetrain))
            .collect();
        let beside = |s: &Stretch| s.beside_nuisances(&of_recordings[s.of[0]][s.of[1]]);
        self.stretches.iter().map(beside).collect()
    }
}
