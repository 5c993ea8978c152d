//! The static characteristic of a channel: offset, gain and drift of each run, and the terms that
//! are beyond chance; their sizes with intervals.

use super::FALSE_ALARM;
use super::candidate_term::{Course, SAME_LOAD, Start, Term};
use super::step_file::Step;
use super::weighted_fit::{Estimate, Fit, Observed, Test};

/// Searches of a nonlinear parameter, each within a factor of [`AROUND`] of the last.
const SEARCHES: usize = 24;
const AROUND: f64 = 5.0;

/// Step of the logarithm of a nonlinear parameter for its derivative.
const STEP: f64 = 0.01;

/// Loads and readings in the order of application, prepared for fits.
pub(super) struct Data<'a> {
    pub course: Course<'a>,
    pub observed: Observed,
    /// Steps of each plateau.
    pub plateaus: Vec<usize>,
    /// Offset, gain and, where the load turned, drift of each run.
    base: Vec<Vec<f64>>,
    /// Columns of offset and gain of each run.
    pub runs: Vec<[usize; 2]>,
    /// Number of each run.
    numbers: Vec<usize>,
    /// Column of the drift of each run.
    drifts: Vec<Option<usize>>,
    /// Columns as they are at each step, without rotation.
    plain: Vec<Vec<f64>>,
}

impl<'a> Data<'a> {
    /// `reading` of each step (SI) with its known variance.
    pub(super) fn new(course: Course<'a>, reading: &[f64], variance: &[f64]) -> Self {
        let steps = course.steps;
        let key = |step: &Step| (step.run, step.plateau);
        let plateaus: Vec<usize> = steps
            .chunk_by(|a, b| key(a) == key(b))
            .map(<[Step]>::len)
            .collect();
        let mut data = Self {
            course,
            observed: Observed::default(),
            plateaus,
            base: Vec::new(),
            runs: Vec::new(),
            numbers: Vec::new(),
            drifts: Vec::new(),
            plain: Vec::new(),
        };
        for run in steps.chunk_by(|a, b| a.run == b.run).map(|run| run[0].run) {
            if !data.numbers.contains(&run) {
                data.add_run(run);
            }
        }
        let plain = data.plain.iter();
        data.base = plain.map(|column| data.rotated(column)).collect();
        data.observed.reading = data.rotated(reading);
        let mut from = 0;
        for &count in &data.plateaus {
            for k in 0..count {
                let mean = if k == 0 { count as f64 } else { 1.0 };
                data.observed.variance.push(variance[from + k] / mean);
                data.observed.kind.push(usize::from(k > 0));
            }
            from += count;
        }
        data
    }

    /// Adds the columns of a run: offset, gain and, where its load turned, drift.
    fn add_run(&mut self, run: usize) {
        let course = &self.course;
        let steps = course.steps;
        let of = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let own = |i: usize| if steps[i].run == run { value(i) } else { 0.0 };
            (0..steps.len()).map(own).collect()
        };
        let members = || steps.iter().filter(|step| step.run == run);
        let offset = self.plain.len();
        self.numbers.push(run);
        self.runs.push([offset, offset + 1]);
        self.plain.push(of(&|_| 1.0));
        self.plain.push(of(&|i| course.load[i]));
        // Without a turn, drift is not separable from gain.
        let drifts = !course.are_means && course.turns_in(run);
        self.drifts.push(drifts.then_some(offset + 2));
        if drifts {
            let mean = members().map(|s| s.t_s).sum::<f64>() / members().count() as f64;
            let distances = members().map(|s| (s.t_s - mean).abs());
            let span = distances.fold(0.0, f64::max);
            self.plain.push(of(&|i| (steps[i].t_s - mean) / span));
        }
    }

    /// Mean of each plateau, then its orthonormal changes `(sum_(i<j) x_i - j x_j) / sqrt(j (j+1))`
    /// (Helmert): an error of the load is in the mean alone.
    fn rotated(&self, column: &[f64]) -> Vec<f64> {
        let mut out = Vec::with_capacity(column.len());
        let mut from = 0;
        for &count in &self.plateaus {
            let own = &column[from..from + count];
            out.push(own.iter().sum::<f64>() / count as f64);
            let mut sum = 0.0;
            for j in 1..count {
                sum += own[j - 1];
                let size = (j * (j + 1)) as f64;
                out.push((sum - j as f64 * own[j]) / size.sqrt());
            }
            from += count;
        }
        out
    }

    fn column(&self, term: Term) -> Vec<f64> {
        self.rotated(&term.column(&self.course))
    }

    fn columns(&self, terms: &[Term]) -> Vec<Vec<f64>> {
        let own = terms.iter().map(|term| self.column(*term));
        self.base.iter().cloned().chain(own).collect()
    }

    pub(super) fn fit(&self, terms: &[Term]) -> Fit {
        Fit::new(&self.columns(terms), &self.observed)
    }

    /// Readings less offset and drift of their run as fitted, at each step.
    pub(super) fn reduced(&self, fit: &Fit, reading: &[f64]) -> Vec<f64> {
        let mut out = reading.to_vec();
        let offsets = self.runs.iter().map(|run| run[0]);
        for j in offsets.chain(self.drifts.iter().flatten().copied()) {
            for (y, x) in out.iter_mut().zip(&self.plain[j]) {
                *y -= fit.coefficients[j] * x;
            }
        }
        out
    }

    /// Steps of a run at the largest load.
    fn largest_rows(&self, r: usize) -> Vec<usize> {
        let l = &self.course.load;
        let is_largest = |i: &usize| {
            self.course.steps[*i].run == self.numbers[r]
                && self.course.largest_sign * l[*i] > 1.0 - SAME_LOAD
        };
        (0..l.len()).filter(is_largest).collect()
    }

    /// Parts of the prediction for a run that the load causes, at the largest load of all runs.
    ///
    /// Loops are centred: they add nothing where the load turns.
    fn at_largest(&self, r: usize, terms: &[Term]) -> Vec<f64> {
        let mut c = vec![0.0; self.base.len() + terms.len()];
        let sign = self.course.largest_sign;
        let rows = self.largest_rows(r);
        let mean = |column: &[f64]| {
            rows.iter().map(|&i| column[i]).sum::<f64>() / rows.len().max(1) as f64
        };
        c[self.runs[r][1]] = sign;
        for (k, term) in terms.iter().enumerate() {
            c[self.base.len() + k] = match term {
                Term::Quadratic => 1.0,
                Term::Cubic => sign,
                Term::Speed => 0.0,
                Term::Hysteresis { .. } | Term::Creep { .. } => mean(&term.column(&self.course)),
            };
        }
        c
    }
}

/// The terms of a characteristic and their fit.
pub(super) struct Characteristic {
    pub terms: Vec<Term>,
    pub fit: Fit,
    /// Probability of each term by chance.
    pub p_values: Vec<f64>,
    /// Level of each single test.
    pub level: f64,
}

impl Characteristic {
    /// The best of four characteristics by Schwarz's criterion: of a preloaded and of a virgin
    /// structure, each from no term and from quadratic, cubic and loop together, since a term can
    /// hide another, and the start of a loop.
    ///
    /// Source: Schwarz 1978, Estimating the dimension of a model.
    pub(super) fn select(data: &Data<'_>) -> Self {
        let candidates = data.course.candidates();
        let level = FALSE_ALARM / candidates.len() as f64;
        let of_start = |wanted: Start| {
            let is_loop = |term: &Term| matches!(term, Term::Hysteresis { .. });
            let is_other =
                |term: &Term| matches!(term, Term::Hysteresis { start, .. } if *start != wanted);
            let own: Vec<Term> = (candidates.iter().copied())
                .filter(|term| !is_other(term))
                .collect();
            let first_loop = own.iter().copied().find(is_loop);
            let together = [Term::Quadratic, Term::Cubic].into_iter().chain(first_loop);
            [Vec::new(), together.collect()].map(|from| Self::among(data, &own, level, from))
        };
        let criterion = |of: &Self| {
            let cost = (data.observed.reading.len() as f64).ln();
            of.fit.deviance() + cost * of.terms.len() as f64
        };
        let [first, second] = [Start::Preloaded, Start::Virgin].map(of_start);
        // Of equals the first stays.
        (first.into_iter().chain(second))
            .reduce(|best, next| {
                if criterion(&next) < criterion(&best) {
                    next
                } else {
                    best
                }
            })
            .unwrap_or_else(|| Self::among(data, &candidates, level, Vec::new()))
    }

    /// Adds to `terms` the candidate with the largest Student's t, while it is beyond chance; then
    /// takes away what is not. [`FALSE_ALARM`] holds for all candidates together (Bonferroni).
    fn among(data: &Data<'_>, candidates: &[Term], level: f64, mut terms: Vec<Term>) -> Self {
        refine(data, &mut terms);
        let mut fit = data.fit(&terms);
        while let Some((term, _)) = (candidates.iter())
            .filter(|candidate| terms.iter().all(|t| t.name() != candidate.name()))
            .filter_map(|candidate| Some((*candidate, fit.test(&data.column(*candidate))?)))
            .filter(|(_, test)| test.p_value < level)
            .max_by(|a, b| a.1.t.total_cmp(&b.1.t))
        {
            terms.push(term);
            refine(data, &mut terms);
            fit = data.fit(&terms);
        }
        let mut p_values = own_p_values(data, &terms);
        while let Some(worst) = (0..terms.len())
            .filter(|&k| p_values[k] >= level)
            .max_by(|&a, &b| p_values[a].total_cmp(&p_values[b]))
        {
            terms.remove(worst);
            refine(data, &mut terms);
            p_values = own_p_values(data, &terms);
        }
        Self {
            fit: data.fit(&terms),
            terms,
            p_values,
            level,
        }
    }

    /// The fit with derivatives by the nonlinear parameters, and their columns.
    fn with_derivatives(&self, data: &Data<'_>) -> (Fit, Vec<Option<usize>>) {
        let mut columns = data.columns(&self.terms);
        let mut places = Vec::new();
        for (k, term) in self.terms.iter().enumerate() {
            let coefficient = self.fit.coefficients[data.base.len() + k];
            let inside = term.parameter(&data.course).filter(|(value, [low, high])| {
                *value > low * (1.0 + 2.0 * STEP) && *value < high * (1.0 - 2.0 * STEP)
            });
            places.push(inside.map(|(value, _)| {
                let [above, below] =
                    [STEP, -STEP].map(|step: f64| data.column(term.with(value * step.exp())));
                let slope = above.iter().zip(&below);
                let scale = coefficient / (2.0 * STEP);
                columns.push(slope.map(|(a, b)| (a - b) * scale).collect());
                columns.len() - 1
            }));
        }
        (self.fit.again(&columns, &data.observed), places)
    }

    /// Size of each term at the largest load, [`Term::size`], and its nonlinear parameter.
    pub(super) fn sizes(&self, data: &Data<'_>) -> Vec<(Estimate, Option<[f64; 3]>)> {
        let (fit, derivatives) = self.with_derivatives(data);
        let columns = fit.coefficients.len();
        let size_of = |(k, term): (usize, &Term)| {
            let j = data.base.len() + k;
            let mut c = vec![0.0; columns];
            c[j] = term.size(&data.course);
            let parameter = term.parameter(&data.course).map(|(value, limits)| {
                let Some(d) = derivatives[k].filter(|d| fit.is_independent(*d)) else {
                    return [value, limits[0], limits[1]];
                };
                let [above, below] =
                    [STEP, -STEP].map(|step: f64| term.with(value * step.exp()).size(&data.course));
                c[d] = self.fit.coefficients[j] * (above - below) / (2.0 * STEP);
                let mut unit = vec![0.0; columns];
                unit[d] = 1.0;
                let [low, high] = fit.linear(&unit).interval();
                let half = 0.5 * (high - low);
                [value, value * (-half).exp(), value * half.exp()]
            });
            let spread = fit.linear(&c);
            let value = self.fit.coefficients[j] * term.size(&data.course);
            (Estimate { value, ..spread }, parameter)
        };
        self.terms.iter().enumerate().map(size_of).collect()
    }

    /// Size of a term that was not found, were it added.
    pub(super) fn size_if_added(&self, data: &Data<'_>, term: Term) -> Option<Estimate> {
        let mut terms = self.terms.clone();
        terms.push(term);
        let fit = self.fit.again(&data.columns(&terms), &data.observed);
        let mut c = vec![0.0; fit.coefficients.len()];
        let last = c.len() - 1;
        c[last] = term.size(&data.course);
        (fit.is_independent(last) && fit.freedom() >= 1.0).then(|| fit.linear(&c))
    }

    /// Whether term `k` adds nothing beside `other`, which then fits as well.
    pub(super) fn is_as_well(&self, data: &Data<'_>, k: usize, other: Term) -> bool {
        let mut terms = self.terms.clone();
        terms[k] = other;
        let fit = self.fit.again(&data.columns(&terms), &data.observed);
        let beside = fit.test(&data.column(self.terms[k]));
        beside.is_none_or(|test| test.p_value > 0.05)
    }

    /// Reading without load, and at the largest load less that.
    ///
    /// Several runs: their mean, its standard deviation from their scatter (the random effect of
    /// a run); one run: that of the fit.
    pub(super) fn line(&self, data: &Data<'_>) -> [Estimate; 2] {
        let usable = self.complete_runs(data);
        let offset = |r: usize| {
            let mut c = vec![0.0; self.fit.coefficients.len()];
            c[data.runs[r][0]] = 1.0;
            c
        };
        let output = |r: usize| data.at_largest(r, &self.terms);
        [
            self.over_runs(&usable, &offset),
            self.over_runs(&usable, &output),
        ]
    }

    /// Runs whose offset and gain are separable and that reach the largest load; where none does
    /// both, the separable ones.
    fn complete_runs(&self, data: &Data<'_>) -> Vec<usize> {
        let separable: Vec<usize> = (0..data.runs.len())
            .filter(|&r| data.runs[r].iter().all(|j| self.fit.is_independent(*j)))
            .collect();
        let reaches = |r: &&usize| !data.largest_rows(**r).is_empty();
        let complete: Vec<usize> = separable.iter().filter(reaches).copied().collect();
        if complete.is_empty() {
            separable
        } else {
            complete
        }
    }

    /// Mean of a quantity of each run.
    fn over_runs(&self, runs: &[usize], of: &dyn Fn(usize) -> Vec<f64>) -> Estimate {
        let n = runs.len() as f64;
        let each: Vec<f64> = runs
            .iter()
            .map(|&r| self.fit.linear(&of(r)).value)
            .collect();
        let mut mean = vec![0.0; self.fit.coefficients.len()];
        for &r in runs {
            mean.iter_mut().zip(of(r)).for_each(|(m, c)| *m += c / n);
        }
        let within = self.fit.linear(&mean);
        if runs.len() < 2 {
            return within;
        }
        let squares: f64 = each.iter().map(|x| (x - within.value).powi(2)).sum();
        let between = Estimate {
            value: within.value,
            std: (squares / (n - 1.0) / n).sqrt(),
            freedom: n - 1.0,
        };
        // Terms are of all runs together, and so is the rounding of readings: their error is in none
        // of the differences.
        let width = |e: &Estimate| e.interval()[1] - e.value;
        if width(&within) > width(&between) {
            within
        } else {
            between
        }
    }

    /// Standard deviation of the output at the largest load between runs, less what the scatter of
    /// readings explains.
    pub(super) fn output_std(&self, data: &Data<'_>) -> Option<f64> {
        let gains: Vec<Estimate> = (self.complete_runs(data).into_iter())
            .map(|r| {
                let mut c = vec![0.0; self.fit.coefficients.len()];
                c[data.runs[r][1]] = 1.0;
                self.fit.linear(&c)
            })
            .collect();
        let n = gains.len() as f64;
        let mean = gains.iter().map(|g| g.value).sum::<f64>() / n;
        let total = gains.iter().map(|g| (g.value - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let within = gains.iter().map(|g| g.std * g.std).sum::<f64>() / n;
        (gains.len() > 1).then(|| (total - within).max(0.0).sqrt())
    }

    /// Coefficient of term `k`.
    pub(super) fn coefficient(&self, data: &Data<'_>, k: usize) -> f64 {
        self.fit.coefficients[data.base.len() + k]
    }

    /// Mean offset and gain of the complete runs.
    pub(super) fn mean_line(&self, data: &Data<'_>) -> [f64; 2] {
        let runs = self.complete_runs(data);
        let n = runs.len().max(1) as f64;
        let sum = |k: usize| {
            runs.iter()
                .map(|&r| self.fit.coefficients[data.runs[r][k]])
                .sum::<f64>()
        };
        [0, 1].map(|k| sum(k) / n)
    }

    /// A characteristic of given terms, with their probabilities by chance.
    pub(super) fn of(data: &Data<'_>, mut terms: Vec<Term>, level: f64) -> Self {
        refine(data, &mut terms);
        Self {
            fit: data.fit(&terms),
            p_values: own_p_values(data, &terms),
            terms,
            level,
        }
    }
}

/// Probability of each term by chance, beside the others.
fn own_p_values(data: &Data<'_>, terms: &[Term]) -> Vec<f64> {
    let of = |k: usize| {
        let mut others = terms.to_vec();
        let term = others.remove(k);
        let test: Option<Test> = data.fit(&others).test(&data.column(term));
        test.map_or(1.0, |test| test.p_value)
    };
    (0..terms.len()).map(of).collect()
}

/// Nonlinear parameters with the least squares, one after the other, twice.
fn refine(data: &Data<'_>, terms: &mut [Term]) {
    let fit = data.fit(terms);
    for _ in 0..2 {
        for k in 0..terms.len() {
            let Some((value, [low, high])) = terms[k].parameter(&data.course) else {
                continue;
            };
            let squares = |log: f64| {
                let mut tried = terms.to_vec();
                tried[k] = terms[k].with(log.exp());
                fit.again(&data.columns(&tried), &data.observed)
                    .sum_of_squares()
            };
            let from = (value / AROUND).max(low).ln();
            let to = (value * AROUND).min(high).ln();
            let best = least(squares, from, to);
            terms[k] = terms[k].with(best.exp());
        }
    }
}

/// Place of the least value between `a` and `b`, by golden sections.
fn least(of: impl Fn(f64) -> f64, mut a: f64, mut b: f64) -> f64 {
    let part = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut c, mut d) = (b - part * (b - a), a + part * (b - a));
    let (mut at_c, mut at_d) = (of(c), of(d));
    for _ in 0..SEARCHES {
        if at_c < at_d {
            (b, d, at_d) = (d, c, at_c);
            c = b - part * (b - a);
            at_c = of(c);
        } else {
            (a, c, at_c) = (c, d, at_d);
            d = a + part * (b - a);
            at_d = of(d);
        }
    }
    0.5 * (a + b)
}
