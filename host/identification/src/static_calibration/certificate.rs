//! The figures of a calibration certificate, by the definitions of VDI/VDE 2638, from the plateau
//! means of all runs: linearity deviation, reversibility error, repeatability, zero return, combined
//! error.

use std::collections::BTreeSet;

use super::candidate_term::{Course, SAME_LOAD};

/// Limits of classes [%].
const CLASSES: [f64; 11] = [0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0];

/// Figures in % of the output at the largest load; none where the loads do not show it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Certificate {
    /// Largest deviation of the mean loading characteristic from the line through its zero for which
    /// that deviation is smallest; of three loads or more up to the largest.
    pub linearity: Option<f64>,
    /// Largest mean difference of the unloading characteristic of a run from its loading one.
    pub reversibility: Option<f64>,
    /// Largest range of the loading characteristics of all runs at one load.
    pub repeatability: Option<f64>,
    /// Change of the output within 30 min under load.
    pub creep: Option<f64>,
    /// Mean change of the reading without load from the beginning to the end of a run, less the
    /// output of the load that is left.
    pub zero_return: Option<f64>,
    /// Largest deviation of the mean characteristics, loading and unloading, from that line.
    pub combined: Option<f64>,
}

impl Certificate {
    /// `reading` in parts of the output at the largest load, and `reduced` the same less offset and
    /// drift of the run as fitted, which stand in for the zero of a run without a reading at no load.
    pub(super) fn new(course: &Course<'_>, reading: &[f64], reduced: &[f64]) -> Self {
        let runs = Run::all(course, reading, reduced);
        let up: Vec<Curve> = runs.iter().map(|run| run.curve(true)).collect();
        let down: Vec<Curve> = runs.iter().map(|run| run.curve(false)).collect();
        let points = |curves: &[Curve]| merged(curves.iter().flat_map(|c| c.0.clone()).collect());
        let (rising, falling) = (points(&up), points(&down));
        let reaches = |(load, _): &(f64, f64)| load.abs() >= 1.0 - SAME_LOAD;
        let slope = (rising.len() >= FEWEST && rising.iter().any(reaches)).then(|| line(&rising));
        let from_line = |points: &[(f64, f64)], slope: f64| {
            largest(points.iter().map(|(l, y)| (y - slope * l).abs())).unwrap_or(0.0)
        };
        let linearity = slope.map(|slope| from_line(&rising, slope));
        let combined = slope.map(|slope| from_line(&falling, slope));
        let differences = up.iter().zip(&down).flat_map(|(up, down)| {
            let of = |(l, y): &(f64, f64)| Some((*l, y - up.at(*l)?));
            // Both are 0 without load, less the zero and its drift.
            let loaded = down.0.iter().filter(|(l, _)| l.abs() > SAME_LOAD);
            loaded.filter_map(of).collect::<Vec<_>>()
        });
        let differences = merged(differences.collect());
        let returns: Vec<f64> = runs.iter().filter_map(|run| run.zero_return).collect();
        let zero_return =
            (!returns.is_empty()).then(|| returns.iter().sum::<f64>() / returns.len() as f64);
        let percent = |part: Option<f64>| part.map(|part| 100.0 * part);
        Self {
            linearity: percent(linearity),
            reversibility: percent(largest(differences.iter().map(|(_, d)| d.abs()))),
            repeatability: percent(repeatability(&rising, &up)),
            creep: None,
            zero_return: percent(zero_return),
            combined: percent(largest([linearity, combined].into_iter().flatten())),
        }
    }

    /// The smallest class that no figure exceeds; none above the largest, or without linearity.
    pub fn class(&self) -> Option<f64> {
        self.linearity?;
        let figures = [
            self.linearity,
            self.reversibility,
            self.repeatability,
            self.creep.map(f64::abs),
        ];
        let worst = figures.into_iter().flatten().fold(0.0, f64::max);
        CLASSES.into_iter().find(|class| worst <= *class)
    }
}

/// Loads that show a deviation from a line through zero beside the largest.
const FEWEST: usize = 3;

fn largest(of: impl Iterator<Item = f64>) -> Option<f64> {
    of.reduce(f64::max)
}

/// Mean over a stretch of the same load.
struct Plateau {
    t_s: f64,
    load: f64,
    reading: f64,
    /// Whether the magnitude of the load rose to it.
    is_loading: bool,
}

impl Plateau {
    fn is_unloaded(&self) -> bool {
        self.load.abs() <= SAME_LOAD
    }

    /// The reading without the load that is left: the output over the load is 1.
    fn zero(&self) -> f64 {
        self.reading - self.load
    }
}

/// Plateaus of a run less its zero and the drift of that.
struct Run {
    plateaus: Vec<Plateau>,
    zero_return: Option<f64>,
}

impl Run {
    fn all(course: &Course<'_>, reading: &[f64], reduced: &[f64]) -> Vec<Self> {
        let steps = course.steps;
        let numbers: BTreeSet<usize> = steps.iter().map(|step| step.run).collect();
        let of = |number: usize| {
            let own: Vec<usize> = (0..steps.len())
                .filter(|&i| steps[i].run == number)
                .collect();
            let is_unloaded = |i: &usize| course.load[*i].abs() <= SAME_LOAD;
            let has_zero = own.iter().any(is_unloaded);
            let reading = if has_zero { reading } else { reduced };
            let mut plateaus: Vec<Plateau> = own
                .chunk_by(|a, b| steps[*a].plateau == steps[*b].plateau)
                .map(|rows| {
                    let mean = |of: &dyn Fn(usize) -> f64| {
                        rows.iter().map(|&i| of(i)).sum::<f64>() / rows.len() as f64
                    };
                    Plateau {
                        t_s: mean(&|i| steps[i].t_s),
                        load: mean(&|i| course.load[i]),
                        reading: mean(&|i| reading[i]),
                        is_loading: true,
                    }
                })
                .collect();
            // Means at speeds have no history.
            if !course.are_means {
                set_directions(&mut plateaus);
            }
            let mut run = Self {
                plateaus,
                zero_return: None,
            };
            if has_zero {
                run.take_zero_away(!course.are_means);
            }
            run
        };
        numbers.into_iter().map(of).collect()
    }

    /// Takes away the line through the first and the last reading without load, and the middle of
    /// their residuals: loads of both signs pass zero on either branch of a loop.
    fn take_zero_away(&mut self, has_order: bool) {
        let all = &self.plateaus;
        let unloaded: Vec<usize> = (0..all.len()).filter(|&i| all[i].is_unloaded()).collect();
        let (Some(&first), Some(&last)) = (unloaded.first(), unloaded.last()) else {
            return;
        };
        let was_loaded = all[first..last].iter().any(|p| !p.is_unloaded());
        let mut rate = 0.0;
        if has_order && was_loaded {
            let change = all[last].zero() - all[first].zero();
            rate = change / (all[last].t_s - all[first].t_s);
            let is_whole = first == 0 && last + 1 == all.len();
            self.zero_return = is_whole.then_some(change);
        }
        let t_s = all[first].t_s;
        let left = || {
            unloaded
                .iter()
                .map(|&i| all[i].zero() - rate * (all[i].t_s - t_s))
        };
        let middle =
            0.5 * (left().fold(f64::INFINITY, f64::min) + left().fold(f64::NEG_INFINITY, f64::max));
        for plateau in &mut self.plateaus {
            plateau.reading -= middle + rate * (plateau.t_s - t_s);
        }
    }

    /// Its points while the load rises, or falls.
    fn curve(&self, loading: bool) -> Curve {
        let own = self.plateaus.iter().filter(|p| p.is_loading == loading);
        Curve(merged(own.map(|p| (p.load, p.reading)).collect()))
    }
}

/// The first load of a run is on the branch of the second.
fn set_directions(plateaus: &mut [Plateau]) {
    let rise = |a: &Plateau, b: &Plateau| b.load.abs() - a.load.abs();
    let mut is_loading = match plateaus {
        [first, second, ..] => rise(first, second) >= 0.0,
        _ => true,
    };
    for i in 0..plateaus.len() {
        if i > 0 {
            let rise = rise(&plateaus[i - 1], &plateaus[i]);
            is_loading = rise > 0.0 || (rise == 0.0 && is_loading);
        }
        plateaus[i].is_loading = is_loading;
    }
}

/// Points by rising load, of the same load their mean.
fn merged(mut points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut means = Vec::new();
    while let Some((lowest, _)) = points.first().copied() {
        let n = points.partition_point(|(load, _)| load - lowest <= SAME_LOAD);
        let sum = points
            .drain(..n)
            .fold((0.0, 0.0), |sum, p| (sum.0 + p.0, sum.1 + p.1));
        means.push((sum.0 / n as f64, sum.1 / n as f64));
    }
    means
}

/// Reading over load of one run and direction, by rising load.
struct Curve(Vec<(f64, f64)>);

impl Curve {
    /// Whether it has a point at this load.
    fn has(&self, load: f64) -> bool {
        self.0.iter().any(|(l, _)| (l - load).abs() <= SAME_LOAD)
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
        Some(y0 + (load - l0) / (l1 - l0) * (y1 - y0))
    }
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

fn repeatability(rising: &[(f64, f64)], up: &[Curve]) -> Option<f64> {
    largest(rising.iter().filter_map(|(load, _)| {
        let there = || {
            let own = up.iter().filter(|curve| curve.has(*load));
            own.filter_map(|curve| curve.at(*load))
        };
        let range =
            there().fold(f64::NEG_INFINITY, f64::max) - there().fold(f64::INFINITY, f64::min);
        (there().count() > 1).then_some(range)
    }))
}
