//! Reads a recording of a drive: removes outliers, computes position, speed and acceleration by
//! smoothing and differentiation, and keeps drive, loads and temperature. Decimates signals below a
//! cut-off frequency, and splits the recording into a part for the fit and one held out.

use std::path::{Path, PathBuf};

use crate::BalanceError;
use crate::gaussian_smoother::Smoother;
use crate::noise_levels;
use crate::outliers;
use loadtwin_machine::{Balance, Machine, QUANTISATION, Regime, Signal};
use loadtwin_recording::{Reader, Timing, Wanted};

/// Motion is smoothed this many times less than what is explained by it, so that
/// friction at a reversal is not smoothed twice.
const MOTION_BAND: f64 = 5.0;

/// Fewest rows of a recording.
const FEWEST_ROWS: usize = 32;

/// What a recording says, sample by sample.
#[derive(Clone)]
pub struct Motion {
    /// Where it was read from.
    pub path: PathBuf,
    /// What a row is.
    pub regime: Regime,
    /// Time [s].
    pub t: Vec<f64>,
    /// Coordinate [rad, m].
    pub position: Vec<f64>,
    /// [rad/s, m/s].
    pub speed: Vec<f64>,
    /// [rad/s^2, m/s^2].
    pub acceleration: Vec<f64>,
    /// The driving torque or force [the drive's unit].
    pub drive: Vec<f64>,
    /// Measured loads [the drive's unit].
    pub loads: Vec<Vec<f64>>,
    /// [K].
    pub temperature: Option<Vec<f64>>,
    /// Standard deviation of the smoothed position [rad, m].
    pub position_std: f64,
    /// Travel of one turn [rad, m].
    pub turn: Option<f64>,
    /// Whether the position is a recorded angle.
    pub is_angle: bool,
    /// Number of outliers that were left out.
    pub spikes: usize,
    /// Columns with the standard deviation of their white noise [the column's unit].
    pub noise: Vec<(String, f64)>,
    /// Samples at which the low-pass is evaluated: four a period of the cut-off.
    decimated: Vec<usize>,
    smoother: Smoother,
}

/// Columns of a recording as they were read.
struct Signals {
    /// Time [s].
    t: Vec<f64>,
    /// Values of each signal.
    columns: Vec<Vec<f64>>,
    /// Sample period [s].
    period_s: f64,
}

/// Reads each of `signals` from the recording in `path`.
fn read_signals(
    machine: &Machine,
    signals: &[&Signal],
    path: &Path,
) -> Result<Signals, BalanceError> {
    let wanted: Vec<Wanted<'_>> = signals
        .iter()
        .map(|s| Wanted {
            name: &s.name,
            unit: s.unit,
            required: true,
        })
        .collect();
    let mut reader = Reader::open(path, &machine.recording, &wanted)?;
    if machine.recording.timing == Timing::Resample {
        reader = reader.expect_period(1.0 / machine.rate_hz)?;
    }
    let period_s = reader.period_s();
    let mut t = Vec::new();
    let mut columns = vec![Vec::new(); signals.len()];
    for block in reader {
        let block = block?;
        t.extend(block.t);
        for (column, (values, signal)) in columns
            .iter_mut()
            .zip(block.columns.into_iter().zip(signals))
        {
            column.extend(values.into_iter().flatten().map(|v| signal.value(v)));
        }
    }
    Ok(Signals {
        t,
        columns,
        period_s,
    })
}

impl Motion {
    /// Reads the recording in `path`; what is explained of it is the drive below
    /// `cutoff_hz`.
    ///
    /// # Errors
    /// When it cannot be read, lacks a column, or has too few rows.
    pub fn read(
        machine: &Machine,
        balance: &Balance,
        path: &Path,
        cutoff_hz: f64,
    ) -> Result<Self, BalanceError> {
        let signals: Vec<&Signal> = balance.signals().map(|(_, signal)| signal).collect();
        let Signals {
            t,
            mut columns,
            period_s,
        } = read_signals(machine, &signals, path)?;
        // Rows of other regimes have no neighbours that they must be like.
        let spikes = if balance.regime == Regime::Moving {
            columns.iter_mut().map(|x| outliers::remove(x)).sum()
        } else {
            0
        };
        let noise = column_noise(balance, &signals, &columns);
        let mut next = columns.into_iter();
        let mut take = |is: bool| is.then(|| next.next()).flatten();
        let drive = take(true).unwrap_or_default();
        let position = take(balance.position.is_some());
        let speed = take(balance.speed.is_some());
        let temperature = take(balance.temperature.is_some());
        let mut motion = Self {
            path: path.to_owned(),
            regime: balance.regime,
            loads: next.collect(),
            position: vec![0.0; t.len()],
            speed: vec![0.0; t.len()],
            acceleration: vec![0.0; t.len()],
            drive,
            temperature,
            position_std: 0.0,
            turn: balance.turn,
            is_angle: balance.is_angle(),
            spikes,
            noise,
            decimated: Vec::new(),
            smoother: Smoother::new(f64::INFINITY),
            t,
        };
        if motion.t.len() < FEWEST_ROWS {
            return Err(BalanceError::TooShort {
                recording: path.to_owned(),
                found: motion.t.len(),
                allowed: FEWEST_ROWS,
            });
        }
        match balance.regime {
            Regime::Moving => {
                motion.derive(
                    balance,
                    [position.as_deref(), speed.as_deref()],
                    period_s,
                    cutoff_hz,
                );
            }
            Regime::Holding => {
                motion.position = position.unwrap_or_default();
                motion.decimated = (0..motion.t.len())
                    .filter(|&i| motion.is_whole(i))
                    .collect();
            }
            Regime::Steady => motion.average(speed),
        }
        Ok(motion)
    }

    /// Position, speed and acceleration from whichever of them was recorded.
    fn derive(
        &mut self,
        balance: &Balance,
        [position, speed]: [Option<&[f64]>; 2],
        period_s: f64,
        cutoff_hz: f64,
    ) {
        // A kernel of fewer than about ten samples determines no acceleration.
        let motion = Smoother::new((MOTION_BAND * cutoff_hz).min(0.08 / period_s));
        if let (Some(position), Some(signal)) = (position, &balance.position) {
            let rounding = QUANTISATION * (signal.gain * balance.lsb(signal)).abs();
            let noise =
                noise_levels::white_noise_std(position).map_or(rounding, |std| std.max(rounding));
            self.position_std = noise * motion.noise_gain(period_s);
        }
        for i in 0..self.t.len() {
            if let Some(position) = position {
                let nearest = finite_near(position, i);
                [self.position[i], self.speed[i], self.acceleration[i]] =
                    motion.cubic(&self.t, position, nearest);
            }
            if let Some(speed) = speed {
                let nearest = finite_near(speed, i);
                let [v, a, _] = motion.cubic(&self.t, speed, nearest);
                (self.speed[i], self.acceleration[i]) = (v, a);
            }
        }
        if position.is_none() {
            for i in 1..self.t.len() {
                let step = 0.5 * (self.speed[i] + self.speed[i - 1]) * (self.t[i] - self.t[i - 1]);
                self.position[i] = self.position[i - 1] + if step.is_finite() { step } else { 0.0 };
            }
        }
        // A kernel narrower than a sample period would interpolate nothing.
        if cutoff_hz < 0.4 / period_s {
            self.smoother = Smoother::new(cutoff_hz);
        }
        let step = (0.25 / (cutoff_hz * period_s)).round().max(1.0) as usize;
        let reach = self.smoother.reach_s();
        let (first, last) = (self.t[0] + reach, self.t[self.t.len() - 1] - reach);
        self.decimated = (0..self.t.len())
            .step_by(step)
            .filter(|&i| (first..=last).contains(&self.t[i]) && self.is_whole(i))
            .collect();
    }

    /// One row: the means.
    fn average(&mut self, speed: Option<Vec<f64>>) {
        let mean = |x: &[f64]| {
            let finite: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
            vec![finite.iter().sum::<f64>() / finite.len() as f64]
        };
        self.speed = mean(&speed.unwrap_or_default());
        self.drive = mean(&self.drive);
        self.loads = self.loads.iter().map(|l| mean(l)).collect();
        self.temperature = self.temperature.as_deref().map(mean);
        self.t = vec![0.0];
        self.position = vec![0.0];
        self.acceleration = vec![0.0];
        self.decimated = vec![0];
    }

    fn is_whole(&self, i: usize) -> bool {
        [&self.drive, &self.position, &self.speed, &self.acceleration]
            .into_iter()
            .chain(&self.loads)
            .all(|x| x[i].is_finite())
    }

    /// Time at which each decimated value stands [s].
    pub fn decimated_times(&self) -> Vec<f64> {
        self.decimated.iter().map(|&i| self.t[i]).collect()
    }

    /// A signal below the cut-off, with four values a period of it.
    pub fn decimated(&self, signal: &[f64]) -> Vec<f64> {
        self.decimated
            .iter()
            .map(|&i| self.smoother.mean(&self.t, signal, i))
            .collect()
    }

    /// Samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }
}

/// The white noise of each column that has a course in time: rows of positions held have none.
fn column_noise(
    balance: &Balance,
    signals: &[&Signal],
    columns: &[Vec<f64>],
) -> Vec<(String, f64)> {
    if balance.regime == Regime::Holding {
        return Vec::new();
    }
    let of = |(signal, column): (&&Signal, &Vec<f64>)| {
        let std = noise_levels::white_noise_std(column)? / signal.gain.abs();
        Some((signal.name.clone(), std))
    };
    signals.iter().zip(columns).filter_map(of).collect()
}

#[cfg(test)]
impl Motion {
    /// A recording in motion, every row of which is evaluated.
    pub(crate) fn moving(
        t: Vec<f64>,
        [position, speed, acceleration, drive]: [Vec<f64>; 4],
    ) -> Self {
        Self {
            decimated: (0..t.len()).collect(),
            t,
            position,
            speed,
            acceleration,
            drive,
            ..Self::at_rest(Regime::Moving)
        }
    }

    /// A recording without rows.
    pub(crate) fn at_rest(regime: Regime) -> Self {
        Self {
            path: PathBuf::new(),
            regime,
            t: Vec::new(),
            position: Vec::new(),
            speed: Vec::new(),
            acceleration: Vec::new(),
            drive: Vec::new(),
            loads: Vec::new(),
            temperature: None,
            position_std: 0.0,
            turn: None,
            is_angle: false,
            spikes: 0,
            noise: Vec::new(),
            decimated: Vec::new(),
            smoother: Smoother::new(f64::INFINITY),
        }
    }
}

/// The index nearest to `i` with a value.
fn finite_near(x: &[f64], i: usize) -> usize {
    (0..x.len())
        .flat_map(|d| [i.checked_sub(d), Some(i + d)])
        .flatten()
        .find(|&k| x.get(k).is_some_and(|v| v.is_finite()))
        .unwrap_or(i)
}

impl Motion {
    /// The same motion twice, decimated in two parts: without and with the last third;
    /// of positions held, without and with each third.
    #[must_use]
    pub fn split(self) -> (Self, Self) {
        let mut rest = self.clone();
        let mut fit = self;
        let n = fit.decimated.len();
        let regime = fit.regime;
        let is_rest = |i: usize| match regime {
            Regime::Moving => 3 * i >= 2 * n,
            _ => i % 3 == 1,
        };
        let part = |rest: bool| {
            (0..n)
                .filter(|&i| is_rest(i) == rest)
                .map(|i| fit.decimated[i])
                .collect()
        };
        (rest.decimated, fit.decimated) = (part(true), part(false));
        (fit, rest)
    }

    /// The same motion with each load times its factor.
    #[must_use]
    pub fn with_loads_times(&self, factors: &[f64]) -> Self {
        let mut scaled = self.clone();
        for (load, factor) in scaled.loads.iter_mut().zip(factors) {
            for load in load {
                *load *= factor;
            }
        }
        scaled
    }

    /// Whether neighbouring rows are neighbours in time.
    pub fn is_sequence(&self) -> bool {
        self.regime == Regime::Moving
    }
}
