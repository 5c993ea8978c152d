//! Candidate terms of a static characteristic beside offset and gain: quadratic, cubic, hysteresis,
//! creep, speed; the column of each over the steps.

use super::load_steps::LoadSteps;
use super::step_file::Step;
use loadtwin_machine::Hysteresis;

/// Levels of hysteresis that are tried, in parts of the range of the load: from a loop with
/// parallel sides to a lens.
const LEVELS: [f64; 3] = [0.05, 0.2, 1.0];

/// Largest level of a centred loop, in parts of the range: a parabola to a hundredth of its width, as
/// the loop of Rayleigh and of Preisach's uniform density.
const LENS: f64 = 2.0;

/// Largest level of a loop that the estimator gets, in parts of the range: of larger ones the lag by
/// which it ignores noise, a fiftieth of the level, is no longer small against the width.
const WRITTEN: f64 = 0.5;

/// Ratio of one time constant of creep that is tried to the next.
const TIME_STEP: f64 = 3.0;

/// Most time constants that are tried.
const MOST_TIMES: usize = 8;

/// Loads within this part of the largest one count as the same.
pub(super) const SAME_LOAD: f64 = 0.01;

/// State of the hysteresis at the first load of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// As after the same loads before: the structure was preloaded, as VDI/VDE 2638 asks.
    Preloaded,
    /// As without any load before.
    Virgin,
}

/// A term; loads `l` are in parts of the largest one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Term {
    /// `l^2`.
    Quadratic,
    /// `l^3`.
    Cubic,
    /// `z`, `dz = (dl - |dl| z) / level`, as [`loadtwin_machine::Hysteresis`].
    Hysteresis {
        /// Part of the largest load over which it turns.
        level: f64,
        /// Before the first load.
        start: Start,
        /// Whether it is less the mean of both branches of the closed loop over the range of the load:
        /// then other terms are of that mean, and the loop is zero where the load turns.
        is_centred: bool,
    },
    /// `z`, `dz/dt = (l - z) / time_s`, as [`loadtwin_machine::Creep`]; in equilibrium at the first load.
    Creep {
        /// Time constant (s).
        time_s: f64,
    },
    /// Speed of the main shaft in parts of the largest.
    Speed,
}

impl Term {
    /// Its name in tables and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Quadratic => "quadratic",
            Self::Cubic => "cubic",
            Self::Hysteresis { .. } => "hysteresis",
            Self::Creep { .. } => "creep",
            Self::Speed => "speed",
        }
    }

    /// The nonlinear parameter, and the range that is searched for it.
    pub(super) fn parameter(self, course: &Course<'_>) -> Option<(f64, [f64; 2])> {
        match self {
            Self::Hysteresis {
                level, is_centred, ..
            } => {
                let [low, high] = course.range();
                let most = (high - low) * if is_centred { LENS } else { WRITTEN };
                // What the description allows.
                let [low, high] = course.levels.map(|level| level.min(most));
                Some((level.clamp(low, high), [low, high]))
            }
            Self::Creep { time_s } => Some((time_s, course.times?)),
            _ => None,
        }
    }

    /// With another nonlinear parameter.
    #[must_use]
    pub(super) fn with(self, value: f64) -> Self {
        match self {
            Self::Hysteresis {
                start, is_centred, ..
            } => Self::Hysteresis {
                level: value,
                start,
                is_centred,
            },
            Self::Creep { .. } => Self::Creep { time_s: value },
            other => other,
        }
    }

    /// Its value at each step.
    pub(super) fn column(self, course: &Course<'_>) -> Vec<f64> {
        let l = &course.load;
        match self {
            Self::Quadratic => l.iter().map(|l| l * l).collect(),
            Self::Cubic => l.iter().map(|l| l.powi(3)).collect(),
            Self::Speed => {
                let fastest = course.fastest();
                course.steps.iter().map(|s| s.speed / fastest).collect()
            }
            Self::Hysteresis {
                level,
                start,
                is_centred,
            } => {
                let mut column = course.walked(level, start);
                if is_centred {
                    for (z, load) in column.iter_mut().zip(l) {
                        let [up, down] = course.branches(level, *load);
                        *z -= 0.5 * (up + down);
                    }
                }
                column
            }
            Self::Creep { time_s } => course.crept(time_s),
        }
    }

    /// What one unit of its coefficient adds at the largest load, of hysteresis the width of the
    /// loop at half of it, of speed at the largest speed.
    pub(super) fn size(self, course: &Course<'_>) -> f64 {
        match self {
            Self::Quadratic | Self::Speed => 1.0,
            Self::Cubic | Self::Creep { .. } => course.largest_sign,
            Self::Hysteresis { level, .. } => {
                let [up, down] = course.branches(level, 0.5 * course.largest_sign);
                down - up
            }
        }
    }
}

/// The loads over time.
pub(super) struct Course<'a> {
    pub steps: &'a [Step],
    /// In parts of the largest.
    pub load: Vec<f64>,
    /// Sign of the largest load.
    pub largest_sign: f64,
    /// Levels that a description allows, from and to.
    levels: [f64; 2],
    /// Time constants that are searched, where times are measured.
    times: Option<[f64; 2]>,
    /// Rows are means at speeds: their order says nothing.
    pub are_means: bool,
}

impl<'a> Course<'a> {
    /// `largest`: the largest magnitude of the load [N m]; `nominal` that of the description.
    pub(super) fn new(steps: &'a [Step], largest: f64, nominal: f64, all: &LoadSteps) -> Self {
        let (is_timed, are_means) = (all.is_timed && !all.are_means, all.are_means);
        let load: Vec<f64> = steps.iter().map(|step| step.load / largest).collect();
        let peak = load
            .iter()
            .copied()
            .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
        let holds = steps
            .iter()
            .map(|step| step.t_s - step.since_s)
            .filter(|t| *t > 0.0);
        let shortest = holds.fold(f64::INFINITY, f64::min);
        let file = |number: usize| steps.iter().filter(move |step| step.file == number);
        let longest = (0..=steps.last().map_or(0, |step| step.file))
            .map(|number| {
                let ends =
                    |of: fn(f64, f64) -> f64, from| file(number).map(|s| s.t_s).fold(from, of);
                ends(f64::max, f64::NEG_INFINITY) - ends(f64::min, f64::INFINITY)
            })
            .fold(0.0, f64::max);
        Self {
            steps,
            load,
            largest_sign: peak.signum(),
            levels: Hysteresis::LEVELS.map(|level| level * nominal / largest),
            times: (is_timed && shortest < longest).then_some([shortest, longest]),
            are_means,
        }
    }

    /// The terms that these loads can show, each with the nonlinear parameters that are tried.
    pub(super) fn candidates(&self) -> Vec<Term> {
        let mut terms = vec![Term::Quadratic, Term::Cubic];
        if !self.are_means && self.steps.iter().any(|step| self.turns_in(step.run)) {
            let [low, high] = self.range();
            let levels = LEVELS.map(|l| (l * (high - low)).clamp(self.levels[0], self.levels[1]));
            for start in [Start::Preloaded, Start::Virgin] {
                terms.extend(levels.map(|level| Term::Hysteresis {
                    level,
                    start,
                    is_centred: true,
                }));
            }
        }
        if let Some([shortest, longest]) = self.times {
            let times = std::iter::successors(Some(shortest), |time| Some(time * TIME_STEP));
            let times = times.take_while(|time| *time <= longest).take(MOST_TIMES);
            terms.extend(times.map(|time_s| Term::Creep { time_s }));
        }
        if self.fastest() > 0.0 {
            terms.push(Term::Speed);
        }
        terms
    }

    /// Whether a load was put on and taken off in a run.
    pub(super) fn turns_in(&self, run: usize) -> bool {
        let rows: Vec<usize> = (0..self.load.len())
            .filter(|&i| self.steps[i].run == run)
            .collect();
        let moves = || {
            rows.windows(2)
                .map(|pair| self.load[pair[1]] - self.load[pair[0]])
        };
        moves().any(|by| by > SAME_LOAD) && moves().any(|by| by < -SAME_LOAD)
    }

    fn fastest(&self) -> f64 {
        self.steps.iter().map(|s| s.speed.abs()).fold(0.0, f64::max)
    }

    /// Lowest and highest load; one of them 0 for loads of one sign.
    fn range(&self) -> [f64; 2] {
        let fold = |of: fn(f64, f64) -> f64| self.load.iter().copied().fold(0.0, of);
        [fold(f64::min), fold(f64::max)]
    }

    /// Hysteresis at each step, exactly: `z+ = s - (s - z) exp(-|dl| / level)`, `s` the sign of `dl`.
    fn walked(&self, level: f64, start: Start) -> Vec<f64> {
        let mut column = vec![0.0; self.load.len()];
        let mut from = 0;
        for file in self.steps.chunk_by(|a, b| a.file == b.file) {
            let loads = &self.load[from..from + file.len()];
            let (mut z, mut at) = (0.0, 0.0);
            let mut walk = |to: f64| {
                let sign = (to - at).signum();
                z = sign - (sign - z) * (-(to - at).abs() / level).exp();
                at = to;
                z
            };
            if start == Start::Preloaded {
                // Three preloads, as the guideline has them.
                for _ in 0..3 {
                    for load in loads {
                        walk(*load);
                    }
                }
            }
            for (slot, load) in column[from..].iter_mut().zip(loads) {
                *slot = walk(*load);
            }
            from += file.len();
        }
        column
    }

    /// The closed loop over the range of the load at `load`, while it rises and while it falls.
    fn branches(&self, level: f64, load: f64) -> [f64; 2] {
        let [low, high] = self.range();
        let peak = (0.5 * (high - low) / level).tanh();
        let up = 1.0 - (1.0 + peak) * (-(load - low) / level).exp();
        let down = -1.0 + (1.0 + peak) * (-(high - load) / level).exp();
        [up, down]
    }

    /// Creep at each step, exactly: `z+ = l + (z - l) exp(-dt / time_s)`.
    fn crept(&self, time_s: f64) -> Vec<f64> {
        let mut column = Vec::with_capacity(self.load.len());
        let mut from = 0;
        for file in self.steps.chunk_by(|a, b| a.file == b.file) {
            let loads = &self.load[from..from + file.len()];
            let mut z = loads[0];
            let (mut before, mut t_s) = (loads[0], file[0].since_s);
            let mut follow = |load: f64, until_s: f64| {
                z = load + (z - load) * (-(until_s - t_s).max(0.0) / time_s).exp();
                t_s = until_s;
                z
            };
            for (step, load) in file.iter().zip(loads) {
                if *load != before {
                    follow(before, step.since_s);
                    before = *load;
                }
                column.push(follow(*load, step.t_s));
            }
            from += file.len();
        }
        column
    }
}
