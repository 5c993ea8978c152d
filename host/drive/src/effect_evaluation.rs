//! Makes the `Diagnosis` of a drive from the effects selected: verdict, notes, parameters,
//! remainder of the fitted recordings, and where the validation extrapolates. Errors on the
//! validation recordings, with intervals, of four models: the linear part as described and
//! refitted, each without and with the effects.

use std::path::PathBuf;

use crate::Request;
use crate::design_matrix;
use crate::design_matrix::Dataset;
use crate::diagnosis_result::{
    Alternative, BeforeAfter, Beyond, Diagnosis, Errors, Figure, FoundEffect, FoundEvidence,
    Linear, Parameters, Residuals, Validated,
};
use crate::least_squares::{Columns, fit};
use crate::remaining_residual::Remainder;
use crate::shape_parameter_std;
use crate::smoothed_motion::Motion;
use crate::stepwise::{Selection, next_experiment};
use loadtwin_machine::{Balance, BalanceEffect};
use loadtwin_math::metrics::{Stretch, prediction_interval, relative_variance};

/// Ratio of a quantity's range in the validation to that of the fit from which it is an
/// extrapolation.
const FAR_BEYOND: f64 = 2.0;

/// The same for the position, where a polynomial soon leaves what it was fitted to.
const POSITION_BEYOND: f64 = 1.2;

/// Part of the drive's RMS above which a contribution of the wrong sign is reported.
const WRONG_SIGN: f64 = 0.1;

/// Everything that was fitted, and its errors.
pub(crate) struct Outcome {
    pub(crate) linear: Linear,
    /// Those of the description, recalibrated, then those found.
    pub(crate) effects: Vec<BalanceEffect>,
    /// RMS of what the model leaves of recordings or blocks that were left out [the drive's unit].
    pub(crate) model_std: f64,
    /// Standard deviations of the shapes found.
    shape_stds: Vec<Vec<Option<f64>>>,
    error: Errors,
    validated: Vec<Validated>,
    remainder: Remainder,
    beyond: Vec<Beyond>,
    notes: Vec<String>,
    spikes: usize,
    residuals: Residuals,
}

impl Outcome {
    pub(crate) fn new(
        balance: &Balance,
        selection: &Selection<'_>,
        base: &Columns,
        (fitted, table): (&[Motion], &Dataset),
        (validation, held_out): (&[Motion], &Dataset),
    ) -> Self {
        let noise = selection.noise_variance();
        let with_offsets = selection.base();
        let full = selection.fitted().coefficients;
        // The offset that a recording has of its own is no part of the model.
        let (known, found) = (&full[..base.len()], &full[with_offsets.len()..]);
        let mut plain = fit(with_offsets, &table.drive, table, noise).coefficients;
        plain.truncate(base.len());
        let nominal = nominal_coefficients(balance);
        // The effects alone, beside a linear part that stays as described.
        let mut effects_here = Columns::default();
        let mut effects_there = Columns::default();
        for part in &selection.parts {
            effects_here.push(&part.columns, &part.prior);
            let columns = design_matrix::columns(validation, part.effect, &part.shape);
            effects_there.push(&columns, &part.prior);
        }
        let rest = without(&table.drive, &base.times(&nominal, table.len()));
        let offsets = with_offsets.after(base.len());
        let count = effects_here.len();
        let mut beside = fit(&effects_here.and(&offsets), &rest, table, noise).coefficients;
        beside.truncate(count);
        // What each of the four models leaves of recordings that it never saw.
        let base_there = crate::base(balance, validation);
        let rows = held_out.len();
        let none = vec![0.0; effects_there.len()];
        let residual = |linear: &[f64], effects: &[f64]| -> Vec<f64> {
            let rest = without(&held_out.drive, &base_there.times(linear, rows));
            without(&rest, &effects_there.times(effects, rows))
        };
        let before = residual(&plain, &none);
        let after = residual(known, found);
        let error = Errors {
            nominal: BeforeAfter {
                before: figure(&residual(&nominal, &none), held_out),
                after: figure(&residual(&nominal, &beside), held_out),
            },
            recalibrated: BeforeAfter {
                before: figure(&before, held_out),
                after: figure(&after, held_out),
            },
            recalibrated_own_offset: BeforeAfter {
                before: figure_about_means(&before, held_out),
                after: figure_about_means(&after, held_out),
            },
        };
        let loads = balance.loads.len();
        let left = without(
            &table.drive,
            &selection.columns(None).times(&full, table.len()),
        );
        let linear = Linear {
            offset: known[0],
            inertia: known[1],
            drag: known[2],
            load_gains: known[3..3 + loads].to_vec(),
        };
        let coefficients = [&known[3 + loads..], found].concat();
        let mut effects = effects(balance, selection, &coefficients);
        in_recalibrated_loads(&mut effects, fitted, &linear.load_gains);
        let beyond = beyond(fitted, validation);
        let spikes = fitted.iter().chain(validation).map(|m| m.spikes).sum();
        Self {
            notes: notes(&linear, &error, !found.is_empty(), (fitted, table), &beyond),
            linear,
            effects,
            model_std: (selection.fitted().left_out_squares() / table.len() as f64).sqrt(),
            shape_stds: shape_parameter_std::shape_stds(selection, fitted, table),
            error,
            validated: validated(validation, held_out, &before, &after),
            residuals: residuals(validation, held_out, before, after),
            remainder: Remainder::new(fitted, table, &left),
            beyond,
            spikes,
        }
    }

    pub(crate) fn diagnosis(
        self,
        request: &Request<'_>,
        machine_out: Option<PathBuf>,
        selection: &Selection<'_>,
        balance: &Balance,
    ) -> Diagnosis {
        let effects = self.found_effects(selection, balance);
        let alternatives: Vec<Alternative> = selection
            .parts
            .iter()
            .filter(|part| !part.alternatives.is_empty())
            .map(|part| Alternative {
                effect: part.effect.name(),
                instead: part.alternatives.clone(),
            })
            .collect();
        let verdict = self.verdict(selection);
        let next_experiment = next_experiment(selection);
        Diagnosis {
            verdict,
            effects,
            alternatives,
            next_experiment,
            error: self.error,
            recalibrated: self.linear,
            remainder: self.remainder,
            beyond: self.beyond,
            notes: self.notes,
            spikes: self.spikes,
            cutoff_hz: request.cutoff_hz,
            fitted_on: (request.fit.iter())
                .map(|path| path.display().to_string())
                .collect(),
            validated_on: self.validated,
            residuals: self.residuals,
            machine_out: machine_out.map(|path| path.display().to_string()),
        }
    }

    fn found_effects(&self, selection: &Selection<'_>, balance: &Balance) -> Vec<FoundEffect> {
        selection
            .parts
            .iter()
            .zip(self.effects.iter().skip(balance.effects.len()))
            .zip(&self.shape_stds)
            .map(|((part, found), shape_std)| FoundEffect {
                name: part.effect.name(),
                channels: vec![balance.drive.name.clone()],
                parameters: Parameters {
                    shape: part.shape.clone(),
                    shape_names: (part.effect.shape_parameters().iter())
                        .map(|parameter| parameter.label(balance))
                        .collect(),
                    shape_std: shape_std.clone(),
                    terms: part
                        .effect
                        .terms(&part.shape, balance.loads.len())
                        .into_iter()
                        .zip(found.coefficients.iter().copied())
                        .collect(),
                },
                evidence: FoundEvidence {
                    gain_percent: 100.0 * part.evidence.gain,
                    p_value: part.evidence.p_value,
                },
            })
            .collect()
    }

    fn verdict(&self, selection: &Selection<'_>) -> &'static str {
        // The effect that explains most decides whether the finding is certain.
        let main = selection
            .parts
            .iter()
            .max_by(|a, b| a.evidence.gain.total_cmp(&b.evidence.gain));
        match selection.parts.len() {
            0 if self.remainder.unknown => "unknown",
            0 => "none",
            // What makes the error greater where it was not fitted is not known.
            _ if is_worse(&self.error) => "unknown",
            _ if main.is_some_and(|m| !m.alternatives.is_empty()) => "inseparable",
            1 => "effect",
            _ => "effects",
        }
    }
}

/// Whether the effects make the error on the validation recordings greater.
fn is_worse(error: &Errors) -> bool {
    let [before, after] = [error.recalibrated.before, error.recalibrated.after];
    (before.value_percent.zip(after.value_percent)).is_some_and(|(before, after)| after > before)
}

/// What to know before the result is used.
fn notes(
    linear: &Linear,
    error: &Errors,
    has_effects: bool,
    (fitted, table): (&[Motion], &Dataset),
    beyond: &[Beyond],
) -> Vec<String> {
    let mut notes = Vec::new();
    if has_effects && is_worse(error) {
        let where_to: Vec<_> = beyond.iter().map(|b| b.what).collect();
        notes.push(if where_to.is_empty() {
            "the effects make the error on the validation recordings greater: they are \
             not what these recordings lack"
                .into()
        } else {
            format!(
                "the effects make the error on the validation recordings greater, which go \
                 beyond what was fitted in {}",
                where_to.join(", ")
            )
        });
    }
    let power = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>();
    let accelerations = fitted.iter().flat_map(|m| m.decimated(&m.acceleration));
    let inertial = power(&mut accelerations.map(|a| a * linear.inertia));
    let drive = power(&mut table.drive.iter().copied());
    if linear.inertia < 0.0 && inertial > WRONG_SIGN * WRONG_SIGN * drive {
        notes.push(
            "the inertia fits with a negative sign: does the position count against the drive?"
                .into(),
        );
    }
    notes
}

/// Brings coefficients that were fitted beside the loads as described to the loads
/// as recalibrated, which are those of the improved description.
///
/// A column is a power of the loads, or free of them: recalibrated it is a
/// multiple of what it was.
fn in_recalibrated_loads(effects: &mut [BalanceEffect], fitted: &[Motion], factors: &[f64]) {
    if factors.is_empty() {
        return;
    }
    let scaled: Vec<Motion> = fitted.iter().map(|m| m.with_loads_times(factors)).collect();
    for known in effects {
        let Some(effect) = crate::find(&known.name) else {
            continue;
        };
        let here = design_matrix::columns(fitted, effect, &known.shape);
        let there = design_matrix::columns(&scaled, effect, &known.shape);
        for ((c, here), there) in known.coefficients.iter_mut().zip(&here).zip(&there) {
            let dot = |b: &[f64]| there.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let power = dot(there);
            if power > 0.0 {
                *c *= dot(here) / power;
            }
        }
    }
}

/// Rows of each recording.
fn rows_by_recording(table: &Dataset) -> Vec<f64> {
    let mut rows = vec![0.0; table.recording.iter().max().map_or(0, |r| r + 1)];
    for &k in &table.recording {
        rows[k] += 1.0;
    }
    rows
}

/// A residual without the mean that it has in each recording.
fn centred(rest: &[f64], table: &Dataset) -> Vec<f64> {
    let rows = rows_by_recording(table);
    let mut means = vec![0.0; rows.len()];
    for (r, &k) in rest.iter().zip(&table.recording) {
        means[k] += r / rows[k];
    }
    let recordings = table.recording.iter();
    rest.iter()
        .zip(recordings)
        .map(|(r, &k)| r - means[k])
        .collect()
}

/// The difference of two signals.
fn without(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// The effects of the description, then those found, with the coefficients `c` of both.
fn effects(balance: &Balance, selection: &Selection<'_>, c: &[f64]) -> Vec<BalanceEffect> {
    let described = balance
        .effects
        .iter()
        .map(|e| (e.name.clone(), e.shape.clone(), e.coefficients.len()));
    let found = selection
        .parts
        .iter()
        .map(|p| (p.effect.name().into(), p.shape.clone(), p.columns.len()));
    let mut rest = c;
    described
        .chain(found)
        .map(|(name, shape, count)| {
            let (coefficients, more) = rest.split_at(count);
            rest = more;
            BalanceEffect {
                name,
                shape,
                coefficients: coefficients.to_vec(),
            }
        })
        .collect()
}

/// The error on each recording, from the residuals `before` and `after`.
fn validated(
    motions: &[Motion],
    held_out: &Dataset,
    before: &[f64],
    after: &[f64],
) -> Vec<Validated> {
    let power = |x: &[f64], k: usize| -> f64 {
        let here = held_out.recording.iter().zip(x).filter(|(r, _)| **r == k);
        here.map(|(_, x)| x * x).sum()
    };
    let percent = |rest: &[f64], k| 100.0 * (power(rest, k) / power(&held_out.drive, k)).sqrt();
    motions
        .iter()
        .enumerate()
        .map(|(k, motion)| Validated {
            recording: motion.path.display().to_string(),
            before_percent: percent(before, k),
            after_percent: percent(after, k),
        })
        .collect()
}

/// What the model leaves of the recordings, row by row.
fn residuals(
    motions: &[Motion],
    held_out: &Dataset,
    before: Vec<f64>,
    after: Vec<f64>,
) -> Residuals {
    let joined = |of: fn(&Motion) -> &Vec<f64>| {
        let each = motions.iter().flat_map(|m| m.decimated(of(m)));
        each.collect::<Vec<f64>>()
    };
    Residuals {
        t: held_out.t.clone(),
        recording: held_out.recording.clone(),
        position: joined(|m| &m.position),
        speed: joined(|m| &m.speed),
        drive: held_out.drive.clone(),
        before,
        after,
    }
}

/// Where the validation goes far beyond what was fitted.
fn beyond(fitted: &[Motion], validation: &[Motion]) -> Vec<Beyond> {
    let greatest = |motions: &[Motion], of: fn(&Motion) -> &Vec<f64>| {
        let values = motions.iter().flat_map(|m| m.decimated(of(m)));
        values.fold(0.0, |a: f64, b| a.max(b.abs()))
    };
    let compared = |what, of: fn(&Motion) -> &Vec<f64>| Beyond {
        what,
        fitted: greatest(fitted, of),
        validated: greatest(validation, of),
    };
    let positions = |motions: &[Motion]| -> (f64, f64) {
        let values = motions.iter().flat_map(|m| m.decimated(&m.position));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| {
            (a.min(x), b.max(x))
        })
    };
    let ((a, b), (c, d)) = (positions(fitted), positions(validation));
    let middle = 0.5 * (a + b);
    let position = Beyond {
        what: "position",
        fitted: b - middle,
        validated: (d - middle).max(middle - c),
    };
    let others = [
        compared("speed", |m| &m.speed),
        compared("acceleration", |m| &m.acceleration),
        compared("drive", |m| &m.drive),
    ];
    let beyond = |b: &Beyond, times: f64| b.validated > times * b.fitted;
    std::iter::once(position)
        .filter(|b| beyond(b, POSITION_BEYOND))
        .chain(others.into_iter().filter(|b| beyond(b, FAR_BEYOND)))
        .collect()
}

/// The description's own coefficients, in the order of the columns.
fn nominal_coefficients(balance: &Balance) -> Vec<f64> {
    let mut c = vec![balance.offset, balance.inertia, balance.drag];
    c.extend(balance.loads.iter().map(|_| 1.0));
    c.extend(
        balance
            .effects
            .iter()
            .flat_map(|e| e.coefficients.iter().copied()),
    );
    c
}

/// [`figure`] of what is about the mean of each recording; none where that mean is all there is.
fn figure_about_means(rest: &[f64], table: &Dataset) -> Figure {
    if table.has_means(rows_by_recording(table).len()) {
        figure(&centred(rest, table), table)
    } else {
        Figure {
            value_percent: None,
            interval_percent: None,
        }
    }
}

/// RMS of a residual over that of the drive, with the interval in which it is on as
/// many other recordings.
///
/// Power `p = p_own + p_rest`: that of the offsets of the recordings, and that of the residual about
/// them. Each recording of `n_k` rows has one offset, normal about 0: the relative variance of `p` is `(p_own / p)^2 2 sum n_k^2 / (sum n_k)^2 + (p_rest / p)^2 v`,
/// with `v` from stretch to stretch.
fn figure(rest: &[f64], table: &Dataset) -> Figure {
    let rows = rows_by_recording(table);
    let about = if table.has_means(rows.len()) {
        centred(rest, table)
    } else {
        rest.to_vec()
    };
    let mut stretches: Vec<Stretch> = Vec::new();
    for (i, r) in about.iter().enumerate() {
        if table.stretch[i] == stretches.len() {
            stretches.push(Stretch {
                recording: table.recording[i],
                error: 0.0,
                size: 0.0,
            });
        }
        let stretch = &mut stretches[table.stretch[i]];
        stretch.error += r * r;
        stretch.size += table.drive[i] * table.drive[i];
    }
    let power = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
    let whole = power(rest);
    let part = if whole > 0.0 {
        power(&about) / whole
    } else {
        1.0
    };
    let of_offsets = 2.0 * power(&rows) / rows.iter().sum::<f64>().powi(2);
    let variance = relative_variance(&stretches)
        .map(|about| (1.0 - part).powi(2) * of_offsets + part * part * about);
    let value_percent =
        Some(100.0 * (whole / power(&table.drive)).sqrt()).filter(|v| v.is_finite());
    Figure {
        value_percent,
        interval_percent: (value_percent.zip(variance))
            .and_then(|(value, variance)| prediction_interval(value, variance)),
    }
}
