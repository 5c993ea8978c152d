//! The figures of a calibration certificate, by the definitions of VDI/VDE 2638, from the plateau
//! means of all runs: linearity deviation, reversibility error, repeatability, zero return, combined
//! error.

use super::candidate_term::SAME_LOAD;
use super::step_file::Step;

/// Limits of classes [%].
const CLASSES: [f64; 11] = [0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0];

/// Figures in % of the output at the largest load; none where the loads do not show it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Certificate {
    /// Largest deviation of the mean loading characteristic from the line through its zero for which
    /// that deviation is smallest.
    pub linearity: f64,
    /// Largest difference of the mean unloading characteristic from the loading one.
    pub reversibility: Option<f64>,
    /// Largest range of the loading characteristics of all runs at one load.
    pub repeatability: Option<f64>,
    /// Change of the output within 30 min under load.
    pub creep: Option<f64>,
    /// Mean change of the reading without load from the beginning to the end of a run.
    pub zero_return: Option<f64>,
    /// Largest deviation of the mean characteristics, loading and unloading, from that line.
    pub combined: f64,
}

impl Certificate {
    /// `reduced`: readings less offset and drift of the run, in parts of the output at the largest
    /// load; `drifting` the same with drift. `load` in parts of the largest.
    pub(super) fn new(steps: &[Step], load: &[f64], reduced: &[f64], drifting: &[f64]) -> Self {
        let plateaus = Plateau::all(steps, load, reduced);
        let runs: Vec<&[Plateau]> = plateaus.chunk_by(|a, b| a.run == b.run).collect();
        let up: Vec<Curve> = runs.iter().map(|run| Curve::of(run, true)).collect();
        let down: Vec<Curve> = runs.iter().map(|run| Curve::of(run, false)).collect();
        let rising = mean_curve(&up);
        let slope = line(&rising);
        let from_line = |points: &[(f64, f64)]| {
            points
                .iter()
                .map(|(l, y)| (y - slope * l).abs())
                .fold(0.0, f64::max)
        };
        let linearity = from_line(&rising);
        let falling = mean_curve(&down);
        let differences = falling.iter().filter_map(|(l, y)| {
            let there: Vec<f64> = up.iter().filter_map(|curve| curve.at(*l)).collect();
            let mean = there.iter().sum::<f64>() / there.len() as f64;
            (!there.is_empty()).then_some((y - mean).abs())
        });
        let reversibility = differences.fold(None, |most: Option<f64>, d| {
            Some(most.map_or(d, |most| most.max(d)))
        });
        Self {
            linearity: 100.0 * linearity,
            reversibility: reversibility.map(|v| 100.0 * v),
            repeatability: repeatability(&up).map(|b| 100.0 * b),
            creep: None,
            zero_return: zero_return(steps, load, drifting).map(|f| 100.0 * f),
            combined: 100.0 * linearity.max(from_line(&falling)),
        }
    }

    /// The smallest class that no figure exceeds; none above the largest.
    pub fn class(&self) -> Option<f64> {
        let figures = [
            Some(self.linearity),
            self.reversibility,
            self.repeatability,
            self.creep.map(f64::abs),
        ];
        let worst = figures.into_iter().flatten().fold(0.0, f64::max);
        CLASSES.into_iter().find(|class| worst <= *class)
    }
}

/// Mean over a stretch of the same load.
struct Plateau {
    run: usize,
    load: f64,
    reading: f64,
    /// Whether the magnitude of the load rose to it.
    is_loading: bool,
}

impl Plateau {
    fn all(steps: &[Step], load: &[f64], reading: &[f64]) -> Vec<Self> {
        let mut all: Vec<Self> = Vec::new();
        let mut from = 0;
        for same in steps.chunk_by(|a, b| (a.run, a.plateau) == (b.run, b.plateau)) {
            let mean =
                |of: &[f64]| of[from..from + same.len()].iter().sum::<f64>() / same.len() as f64;
            let (load, reading) = (mean(load), mean(reading));
            let before = all.last().filter(|before| before.run == same[0].run);
            let is_loading = before.is_none_or(|before| {
                let rise = load.abs() - before.load.abs();
                rise > 0.0 || (rise == 0.0 && before.is_loading)
            });
            all.push(Self {
                run: same[0].run,
                load,
                reading,
                is_loading,
            });
            from += same.len();
        }
        all
    }
}

/// Reading over load of one run and direction, by rising load.
struct Curve(Vec<(f64, f64)>);

impl Curve {
    fn of(run: &[Plateau], loading: bool) -> Self {
        let mut points: Vec<(f64, f64)> = run
            .iter()
            .filter(|plateau| plateau.is_loading == loading)
            .map(|plateau| (plateau.load, plateau.reading))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self(points)
    }

    /// Between its points, and a little beyond.
    fn at(&self, load: f64) -> Option<f64> {
        let points = &self.0;
        let ends = [points.first()?, points.last()?];
        let near = ends
            .into_iter()
            .find(|(l, _)| (l - load).abs() <= SAME_LOAD);
        let place = points.partition_point(|(l, _)| *l < load);
        if place == 0 || place == points.len() {
            // The output is in parts of that at the largest load: its slope is 1.
            return near.map(|(l, y)| y + (load - l));
        }
        let ((l0, y0), (l1, y1)) = (points[place - 1], points[place]);
        let part = if l1 > l0 {
            (load - l0) / (l1 - l0)
        } else {
            0.0
        };
        Some(y0 + part * (y1 - y0))
    }
}

/// Mean of the curves at the loads of the first.
fn mean_curve(curves: &[Curve]) -> Vec<(f64, f64)> {
    let Some(first) = curves.iter().find(|curve| !curve.0.is_empty()) else {
        return Vec::new();
    };
    let mean = |(load, _): &(f64, f64)| {
        let there: Vec<f64> = curves.iter().filter_map(|curve| curve.at(*load)).collect();
        (*load, there.iter().sum::<f64>() / there.len().max(1) as f64)
    };
    first.0.iter().map(mean).collect()
}

/// Slope of the line through zero from which the largest deviation is smallest, about 1.
fn line(points: &[(f64, f64)]) -> f64 {
    let worst = |slope: f64| {
        points
            .iter()
            .map(|(l, y)| (y - slope * l).abs())
            .fold(0.0, f64::max)
    };
    let (mut low, mut high) = (0.0, 2.0);
    // The largest of moduli of lines is convex in the slope.
    for _ in 0..100 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if worst(a) < worst(b) {
            high = b;
        } else {
            low = a;
        }
    }
    0.5 * (low + high)
}

fn repeatability(up: &[Curve]) -> Option<f64> {
    let (first, others) = up.split_first()?;
    if others.is_empty() {
        return None;
    }
    let ranges = first.0.iter().map(|(load, _)| {
        let there = || up.iter().filter_map(|curve| curve.at(*load));
        there().fold(f64::NEG_INFINITY, f64::max) - there().fold(f64::INFINITY, f64::min)
    });
    Some(ranges.fold(0.0, f64::max))
}

fn zero_return(steps: &[Step], load: &[f64], drifting: &[f64]) -> Option<f64> {
    let plateaus = Plateau::all(steps, load, drifting);
    let returns: Vec<f64> = plateaus
        .chunk_by(|a, b| a.run == b.run)
        .filter_map(|run| {
            let (first, last) = (run.first()?, run.last()?);
            let is_unloaded = |p: &Plateau| p.load.abs() <= SAME_LOAD;
            (run.len() > 2 && is_unloaded(first) && is_unloaded(last))
                .then_some(last.reading - first.reading)
        })
        .collect();
    (!returns.is_empty()).then(|| returns.iter().sum::<f64>() / returns.len() as f64)
}
