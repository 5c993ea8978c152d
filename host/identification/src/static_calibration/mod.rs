//! `loadtwin calibrate --static`: the characteristic of a strain bridge or load cell from static
//! loads, put on and taken off.
//!
//! `y = a_r + g_r l + d_r t + q l^2 + c l^3 + h z_h(l) + k z_c(l, t) + n speed + e`: offset, gain and
//! linear drift of each run `r`, then the terms that are beyond chance ([`Term`]); `e` has one
//! variance for means of plateaus and one for changes within them.
//!
//! Source: VDI/VDE 2638 (terms and figures of the certificate).

mod candidate_term;
mod certificate;
mod channel_model;
mod characteristic;
mod load_steps;
mod plateaus;
mod step_file;
mod weighted_fit;

pub use candidate_term::{Start, Term};
pub use certificate::Certificate;
pub use channel_model::ChannelModel;
pub use load_steps::{LoadSteps, Readings};
pub use step_file::Step;
pub use weighted_fit::Estimate;

use crate::calibrate::GaugeFault;
use candidate_term::Course;
use characteristic::{Characteristic, Data};
use loadtwin_machine::{Channel, Drivetrain, Machine, Senses};

/// Probability that a characteristic without terms shows any, over all candidates together.
pub const FALSE_ALARM: f64 = 0.01;

/// Output that is rounding, in parts of the largest reading: below a count of any converter (32 bits).
const ROUNDING: f64 = 1e-10;

/// Time after which creep is stated (s), as certificates do.
pub const CREEP_S: f64 = 1800.0;

/// A term that is beyond chance; sizes in % of the output at the largest load.
#[derive(Clone, Debug)]
pub struct Finding {
    /// The term, loads in parts of the largest.
    pub term: Term,
    /// Its part of the output at the largest load; of hysteresis the width of the loop at half of
    /// it, positive where the reading is larger while the load falls.
    pub percent: Estimate,
    /// Probability of as much without the term.
    pub p_value: f64,
    /// Level of hysteresis (part of the largest load) or time constant of creep (s), with the 95 %
    /// interval.
    pub parameter: Option<[f64; 3]>,
    /// A term that fits these loads as well.
    pub alternative: Option<&'static str>,
}

/// What the loads say of a term that was not found.
#[derive(Clone, Debug, PartialEq)]
pub enum Absence {
    /// It is smaller than this with 97.5 % probability [%].
    Below(f64),
    /// These loads cannot show it.
    NotShown(&'static str),
}

/// The static calibration of a channel; readings in SI.
#[derive(Clone, Debug)]
pub struct StaticCalibration {
    /// Number of the channel in the machine.
    pub channel: usize,
    /// Stretches of the same load, and runs.
    pub plateaus: usize,
    /// Series of loads.
    pub runs: usize,
    /// Lowest and highest load that it sensed [N m].
    pub range: [f64; 2],
    /// Reading without load.
    pub zero: Estimate,
    /// Output at the largest load over that load [1/(N m)].
    pub sensitivity: Estimate,
    /// Standard deviation of a plateau mean about the characteristic [% of the output].
    pub deviation_percent: f64,
    /// Standard deviation of the sensitivity between runs [%].
    pub between_runs_percent: Option<f64>,
    /// What is beyond chance.
    pub found: Vec<Finding>,
    /// Nonlinearity, hysteresis, creep and speed, as far as they were not found.
    pub absent: Vec<(&'static str, Absence)>,
    /// Figures of the certificate.
    pub certificate: Certificate,
    /// What the estimator gets.
    pub model: ChannelModel,
}

/// Fits every channel of `steps` that senses a load with constant sensitivity.
///
/// # Errors
/// One line on the channel whose readings are too few, or that no load can reach.
pub fn fit(machine: &Machine, steps: &LoadSteps) -> Result<Vec<StaticCalibration>, String> {
    let drivetrain = machine
        .drivetrain
        .as_ref()
        .ok_or("the machine has no [drivetrain]")?;
    let mut all = Vec::new();
    for readings in &steps.readings {
        let channel = &machine.channels[readings.channel];
        let Some(factor) = sensed(drivetrain, steps.load, &channel.senses) else {
            continue;
        };
        let place = |reason: String| format!("channel {:?}: {reason}", channel.name);
        if channel.sensitivity_map.is_some() || channel.patch_map.is_some() {
            return Err(place(
                "its sensitivity is a map over the angle, which static loads do not show; allowed: a constant \
                 `sensitivity` (calibrate fits maps to recordings in motion)"
                    .into(),
            ));
        }
        all.push(fit_channel(channel, drivetrain, steps, readings, factor).map_err(place)?);
    }
    if all.is_empty() {
        let is_load = |c: &&Channel| sensed(drivetrain, steps.load, &c.senses).is_some();
        let names: Vec<&str> = machine
            .channels
            .iter()
            .filter(is_load)
            .map(|c| c.name.as_str())
            .collect();
        return Err(format!(
            "no column of a channel that senses a load; allowed: {}",
            names.join(", ")
        ));
    }
    Ok(all)
}

/// What `senses` reads of one unit of the applied load; none of what is no load.
///
/// Static loads are in balance, and a shaft carries that of either side.
fn sensed(drivetrain: &Drivetrain, applied: usize, senses: &Senses) -> Option<f64> {
    let place = |inertia: &str| drivetrain.inertias.iter().position(|i| i.name == inertia);
    let load = &drivetrain.loads[applied];
    let at = place(&load.inertia)?;
    let pushes = load.direction.sign() * drivetrain.inertias[at].speed_ratio;
    match senses {
        Senses::Load(name) => {
            let other = drivetrain
                .loads
                .iter()
                .position(|load| load.name == *name)?;
            if other == applied {
                return Some(1.0);
            }
            let other = &drivetrain.loads[other];
            let ratio = drivetrain.inertias[place(&other.inertia)?].speed_ratio;
            Some(-pushes / (other.direction.sign() * ratio))
        }
        Senses::Shaft(name) => {
            let shaft = drivetrain
                .shafts
                .iter()
                .position(|shaft| shaft.name == *name)?;
            let side = if at <= shaft { 1.0 } else { -1.0 };
            Some(side * pushes / drivetrain.shafts[shaft].speed_ratio)
        }
        _ => None,
    }
}

fn fit_channel(
    channel: &Channel,
    drivetrain: &Drivetrain,
    all: &LoadSteps,
    readings: &Readings,
    factor: f64,
) -> Result<StaticCalibration, String> {
    let known: Vec<usize> = (0..all.steps.len())
        .filter(|&i| readings.values[i].is_finite() && readings.variance[i].is_finite())
        .collect();
    let steps: Vec<Step> = (known.iter().map(|&i| all.steps[i]))
        .map(|step| Step {
            load: step.load * factor,
            ..step
        })
        .collect();
    let values: Vec<f64> = known.iter().map(|&i| readings.values[i]).collect();
    let variance: Vec<f64> = known.iter().map(|&i| readings.variance[i]).collect();
    let loads = || steps.iter().map(|step| step.load);
    let range = [
        loads().fold(f64::INFINITY, f64::min),
        loads().fold(f64::NEG_INFINITY, f64::max),
    ];
    let largest = range[0].abs().max(range[1].abs());
    let nominal = drivetrain.nominal_sensed(&channel.senses);
    if range[1] <= range[0] {
        return Err(format!(
            "found readings at {} load; allowed: two loads or more",
            usize::from(!steps.is_empty())
        ));
    }
    let course = Course::new(&steps, largest, nominal, all);
    let data = Data::new(course, &values, &variance);
    check_enough(&data)?;
    let found = Characteristic::select(&data);
    let [zero, output] = found.line(&data);
    let [low, high] = output.interval();
    let rounding = ROUNDING * values.iter().fold(0.0, |most: f64, y| most.max(y.abs()));
    if !(low > rounding || high < -rounding) {
        return Err(format!(
            "its output at the largest load is 0 within its 95 % interval ({:.3e} to {:.3e} {}) and rounding; \
             allowed: a reading that follows the load",
            channel.unit.from_si(low),
            channel.unit.from_si(high),
            channel.unit.symbol()
        ));
    }
    let per_output = 100.0 / output.value;
    let findings = findings(&data, &found, per_output);
    let absent = absent(&data, &found, per_output);
    let mut model = ChannelModel::new(&data, &found, &absent, [largest, nominal]);
    let gain = output.value * data.course.largest_sign / largest / channel.sensitivity_si();
    let fault = GaugeFault::of_gain(gain);
    model.notes.extend(fault.map(|fault| {
        format!("{fault} of the described sensitivity: check its sign and unit, those of the load, and the wiring")
    }));
    if readings.saturated > 0 {
        let note = format!(
            "{} saturated readings of the converter: left out",
            readings.saturated
        );
        model.notes.push(note);
    }
    Ok(StaticCalibration {
        channel: readings.channel,
        plateaus: data.plateaus.len(),
        runs: data.runs.len(),
        range,
        zero,
        sensitivity: output.times(data.course.largest_sign / largest),
        deviation_percent: found.fit.deviation() * per_output.abs(),
        between_runs_percent: found.output_std(&data).map(|std| std * per_output.abs()),
        certificate: certificate(&data, &found, &values, output.value, &findings),
        model,
        found: findings,
        absent,
    })
}

fn check_enough(data: &Data<'_>) -> Result<(), String> {
    let line = data.fit(&[]);
    if line.freedom() >= 1.0 {
        return Ok(());
    }
    Err(format!(
        "found {} loads for {} parameters, of offset, gain and drift of each run; allowed: at least one more",
        data.plateaus.len(),
        line.coefficients.len(),
    ))
}

/// The figures of the readings, and creep as fitted.
fn certificate(
    data: &Data<'_>,
    found: &Characteristic,
    values: &[f64],
    output: f64,
    findings: &[Finding],
) -> Certificate {
    // The output over the load is then 1.
    let scale = data.course.largest_sign / output;
    let scaled = |readings: &[f64]| -> Vec<f64> { readings.iter().map(|y| y * scale).collect() };
    let reduced = scaled(&data.reduced(&found.fit, values));
    let creep = findings.iter().find_map(|finding| match finding.term {
        Term::Creep { time_s } => Some(finding.percent.value * (1.0 - (-CREEP_S / time_s).exp())),
        _ => None,
    });
    Certificate {
        creep,
        ..Certificate::new(&data.course, &scaled(values), &reduced)
    }
}

fn findings(data: &Data<'_>, found: &Characteristic, percent: f64) -> Vec<Finding> {
    let sizes = found.sizes(data);
    let of = |(k, (size, parameter)): (usize, (Estimate, Option<[f64; 3]>))| {
        let term = found.terms[k];
        let other = match term {
            Term::Quadratic => Some(Term::Cubic),
            Term::Cubic => Some(Term::Quadratic),
            _ => None,
        };
        let both = other.is_some_and(|other| found.terms.contains(&other));
        let alternative = other
            .filter(|other| !both && found.is_as_well(data, k, *other))
            .map(Term::name);
        Finding {
            term,
            percent: size.times(percent),
            p_value: found.p_values[k],
            parameter,
            alternative,
        }
    };
    sizes.into_iter().enumerate().map(of).collect()
}

/// Bounds of the terms that were not found.
fn absent(data: &Data<'_>, found: &Characteristic, percent: f64) -> Vec<(&'static str, Absence)> {
    let candidates = data.course.candidates();
    let has = |names: &[&str]| found.terms.iter().any(|term| names.contains(&term.name()));
    let kinds: [(&str, &[&str], &str); 4] = [
        (
            "nonlinearity",
            &["quadratic", "cubic"],
            "three loads or more show it",
        ),
        (
            "hysteresis",
            &["hysteresis"],
            if data.course.are_means {
                "rows with a speed are means in any order"
            } else {
                "loads up and down show it"
            },
        ),
        (
            "creep",
            &["creep"],
            "a column `t` and readings at one load show it",
        ),
        ("speed", &["speed"], "a column `speed` shows it"),
    ];
    let mut absent = Vec::new();
    for (kind, names, needed) in kinds {
        if has(names) {
            continue;
        }
        let bounds = (candidates.iter())
            .filter(|term| names.contains(&term.name()))
            .filter_map(|term| found.size_if_added(data, *term))
            .map(|size| {
                let [low, high] = size.times(percent).interval();
                low.abs().max(high.abs())
            });
        let largest = bounds.fold(None, |most: Option<f64>, b| {
            Some(most.map_or(b, |m| m.max(b)))
        });
        absent.push((
            kind,
            largest.map_or(Absence::NotShown(needed), Absence::Below),
        ));
    }
    absent
}
