//! Makes the output of `loadtwin tune` for a drivetrain: table of the tuned noise, hold-out
//! results, warnings (a response short of the cut-off), JSON with a Monte Carlo check of the
//! process noise, and the CSV file of the frequency response.

use std::path::Path;

use serde_json::{Map, Value, json};

use super::printing::say;
use super::tune::Set;
use crate::atomic_file::{AtomicFile, Complete};
use crate::machine::{Channel, Machine};
use crate::replay::Comparison;
use crate::tune::{Check, LoadNoise, MeasurementNoise, reached_hz, rms, sampled_process_noise};

/// First column of a response.
pub(super) const FREQUENCY: &str = "f [Hz]";

/// Samples of the Monte Carlo check of the process noise.
const SAMPLES: usize = 2000;

/// What a set comes to on the hold-out data.
pub(super) fn check_lines(check: &Check) -> Vec<String> {
    let line = |noise: &str, c: &Comparison| {
        let worse = match c.steady_load() {
            Some((load, percent)) => {
                format!(": not written, for {load} varies by {percent:.1} % of nominal only")
            }
            None if c.is_shown_no_worse() => String::new(),
            None => ": not written".into(),
        };
        format!("{} [{noise}]{worse}", c.line())
    };
    let tuned = check.tuned.iter().map(|c| line("tuned", c));
    tuned
        .chain(check.measured.iter().map(|c| line("walk as described", c)))
        .collect()
}

pub(super) fn check_report(check: &Check) -> Value {
    json!({
        "sensors": check.sensors,
        "tuned": check.tuned,
        "walk_as_described": check.measured,
        "walk_is_written": check.takes_walks(),
    })
}

/// Frequency up to which the response of each load is above -3 dB (Hz).
pub(super) fn reached(machine: &Machine, set: &Set) -> Value {
    let loads = load_names(machine).enumerate();
    let of =
        |(j, name): (usize, &str)| (name.to_owned(), json!(reached_hz(&set.tuned.response, j)));
    Value::Object(loads.map(of).collect())
}

/// Where the response does not reach the cut-off frequency.
pub(super) fn shortfalls(machine: &Machine, sets: &[Set], cutoff_hz: f64) -> Vec<String> {
    let mut lines = Vec::new();
    for set in sets {
        let pass = || set.tuned.response.iter().filter(|(f, _)| *f < cutoff_hz);
        let Some((last_hz, last)) = pass().next_back() else {
            continue;
        };
        for (j, load) in load_names(machine).enumerate() {
            let reached = reached_hz(&set.tuned.response, j).unwrap_or(0.0);
            if reached < *last_hz {
                lines.push(format!(
                    "{}: the response of {load} is {:.2} at {last_hz:.3} Hz and above 0.71 up to {reached:.3} Hz; \
                     1 is asked for up to {cutoff_hz} Hz",
                    set.name, last[j]
                ));
            }
        }
    }
    lines
}

/// Largest ratio of drawn to first-order standard deviations over the states.
pub(super) fn process_noise(machine: &Machine) -> Value {
    let Some(drivetrain) = &machine.drivetrain else {
        return Value::Null;
    };
    let (dt_s, std) = (1.0 / machine.rate_hz, machine.tuning.parameter_std);
    let sampled = sampled_process_noise(drivetrain, dt_s, std, SAMPLES, 1);
    let zero = vec![0.0; sampled.nrows()];
    let first = crate::gearbox::process_noise(drivetrain, dt_s, std, &zero);
    let ratios: Vec<f64> = (0..sampled.nrows())
        .filter(|i| first[(*i, *i)] > 0.0)
        .map(|i| (sampled[(i, i)] / first[(i, i)]).sqrt())
        .collect();
    json!({ "parameter_std": std, "draws": SAMPLES, "drawn_to_first_order_std": ratios })
}

/// Warnings where the walk estimated from a set differs from the one that is written for it.
pub(super) fn warnings(machine: &Machine, sets: &[Set], walks: &[Vec<f64>]) -> Vec<String> {
    /// Factor between the two walks from which a warning is given.
    const FACTOR: f64 = 10.0;
    let mut warnings = Vec::new();
    for (set, chosen) in sets.iter().zip(walks) {
        let estimated = &set.tuned.methods[0].1.walk;
        for (load, (walk, chosen)) in load_names(machine).zip(estimated.iter().zip(chosen)) {
            if !(chosen / FACTOR..=chosen * FACTOR).contains(walk) {
                warnings.push(format!(
                    "{}: alone it has a walk of {load} of {walk:.3e} N m/sqrt(s), most others {chosen:.3e}, \
                     which is used: its model or its noise may be wrong",
                    set.name
                ));
            }
        }
    }
    warnings
}

pub(super) fn load_names(machine: &Machine) -> impl Iterator<Item = &str> {
    let loads = machine.drivetrain.iter().flat_map(|d| &d.loads);
    loads.map(|load| load.name.as_str())
}

pub(super) fn report(machine: &Machine, set: &Set, walk: &[f64]) -> Value {
    let loads = |noise: &LoadNoise| -> Map<String, Value> {
        load_names(machine)
            .map(str::to_owned)
            .zip(noise.walk.iter().zip(&noise.log10_qd))
            .map(|(name, (walk, qd))| (name, json!({ "walk_nm_per_sqrt_s": walk, "log10_qd": qd })))
            .collect()
    };
    let methods: Map<String, Value> = set
        .tuned
        .methods
        .iter()
        .map(|(method, noise)| {
            let mut entry = loads(noise);
            if let Some(outcome) = noise.outcome {
                entry.insert("misfit".into(), json!(outcome.misfit));
                entry.insert("error_percent".into(), json!(outcome.error_percent));
                entry.insert("innovation_norm".into(), json!(outcome.innovation));
                entry.insert("solution_norm".into(), json!(outcome.load));
            }
            (method.name().to_owned(), Value::Object(entry))
        })
        .collect();
    let chosen: Map<String, Value> = load_names(machine)
        .zip(walk)
        .map(|(name, walk)| (name.to_owned(), json!(walk)))
        .collect();
    json!({
        "sensors": set.name, "methods": methods, "walk_nm_per_sqrt_s": chosen, "seconds": set.seconds,
    })
}

pub(super) fn print(machine: &Machine, sets: &[Set]) {
    let mut header = format!("{:<24}{:<13}", "log10 Qd", "method");
    for load in load_names(machine) {
        header += &format!("{load:>18}");
    }
    say!("{header}{:>12}{:>12}{:>8}", "misfit", "innovation", "s");
    for set in sets {
        for (method, noise) in &set.tuned.methods {
            let mut line = format!("{:<24}{:<13}", set.name, method.name());
            for qd in &noise.log10_qd {
                line += &format!("{qd:>18.2}");
            }
            if let Some(outcome) = noise.outcome {
                line += &format!("{:>12.3}{:>12.3}", outcome.misfit, outcome.innovation);
            } else {
                line += &format!("{:>12}{:>12}", "-", "-");
            }
            say!("{line}{:>8.1}", set.seconds);
        }
    }
}

pub(super) fn noise_report(channel: &Channel, noise: &MeasurementNoise) -> Value {
    let own = |values: &[f64]| channel.unit.from_si(rms(values));
    json!({
        "channel": channel.name, "unit": channel.unit.symbol(),
        "std": own(&noise.scaled), "std_eq_15": own(&noise.plain),
    })
}

/// `|H|` of each load and set over the frequency.
pub(super) fn complete_response(
    machine: &Machine,
    sets: &[Set],
    path: &Path,
) -> anyhow::Result<Complete> {
    let loads: Vec<&str> = load_names(machine).collect();
    let mut text = String::from(FREQUENCY);
    for set in sets {
        for load in &loads {
            text += &format!(",{} {load} [1]", set.name);
        }
    }
    text.push('\n');
    let rows = sets.first().map_or(0, |set| set.tuned.response.len());
    for i in 0..rows {
        text += &format!("{:.4}", sets[0].tuned.response[i].0);
        for set in sets {
            for magnitude in &set.tuned.response[i].1 {
                text += &format!(",{magnitude:.5}");
            }
        }
        text.push('\n');
    }
    let mut file = AtomicFile::create(path)?;
    std::io::Write::write_all(&mut file, text.as_bytes())?;
    Ok(file.complete()?)
}
