//! Part of `loadtwin calibrate` for static loads: the certificate of each channel as text or JSON,
//! and the calibrated description.

use std::time::Instant;

use anyhow::Context;
use serde_json::{Value, json};

use super::Calibrate;
use crate::atomic_file::publish;
use crate::calibrate::Description;
use crate::cli::printing::{say, shown, shown_all};
use crate::machine::{Channel, Machine};
use crate::static_calibration::{
    Absence, Certificate, Estimate, FALSE_ALARM, Finding, LoadSteps, Start, StaticCalibration,
    Term, fit,
};

/// Fits channels to applied loads in `column`; `--output` gets their settings.
pub(super) fn run(
    machine: &Machine,
    column: &str,
    options: &Calibrate,
    as_json: bool,
) -> anyhow::Result<()> {
    let started = Instant::now();
    let steps = LoadSteps::read(machine, column, &options.recordings)?;
    let files = || shown_all(&options.recordings).join(", ");
    let found = fit(machine, &steps)
        .map_err(anyhow::Error::msg)
        .with_context(files)?;
    if let Some(output) = &options.output {
        let mut changed = machine.clone();
        for calibration in &found {
            let channel = &mut changed.channels[calibration.channel];
            *channel = calibration.model.applied(channel);
        }
        publish(Description::read(&machine.path)?.with_gauges(machine, &changed, output)?)?;
    }
    let seconds = started.elapsed().as_secs_f64();
    if as_json {
        let channels: Vec<Value> = found.iter().map(|c| report(machine, c)).collect();
        let out = json!({
            "machine": machine.name, "recordings": shown_all(&options.recordings), "applied": column,
            "channels": channels, "false_alarm": FALSE_ALARM,
            "machine_out": options.output.as_ref().map(shown), "seconds": seconds,
        });
        say!("{out}");
    } else {
        for calibration in &found {
            print(machine, calibration);
        }
    }
    Ok(())
}

/// The certificate of a channel, one line for each figure.
fn print(machine: &Machine, calibration: &StaticCalibration) {
    let channel = &machine.channels[calibration.channel];
    let unit = channel.unit.symbol();
    let [low, high] = calibration.range;
    let runs = match calibration.runs {
        1 => "1 run".to_owned(),
        runs => format!("{runs} runs"),
    };
    say!(
        "{}: {} loads in {runs}, {} to {} Nm",
        channel.name,
        calibration.plateaus,
        digits(low),
        digits(high)
    );
    let own = |estimate: &Estimate| {
        let scaled = in_unit(channel, estimate);
        let [low, high] = scaled.interval();
        let places = places(scaled.std);
        format!(
            "{:.places$}  ({low:.places$} to {high:.places$})",
            scaled.value
        )
    };
    say!(
        "  sensitivity    {} {unit}/Nm",
        own(&calibration.sensitivity)
    );
    say!("  zero           {} {unit}", own(&calibration.zero));
    let certificate = &calibration.certificate;
    let figures = [
        ("linearity", certificate.linearity, "nonlinearity"),
        ("reversibility", certificate.reversibility, "hysteresis"),
        ("creep, 30 min", certificate.creep, "creep"),
        ("speed", None, "speed"),
    ];
    for (name, figure, kind) in figures {
        let said = said(calibration, kind);
        // Tables without a column `speed` are the usual.
        if kind == "speed" && said.is_none() {
            continue;
        }
        say!(
            "  {name:<15}{}  {}",
            percent(figure),
            said.unwrap_or_default()
        );
    }
    let between = calibration.between_runs_percent;
    say!(
        "  repeatability  {}  {}",
        percent(certificate.repeatability),
        between.map_or("one run up to the largest load".to_owned(), |std| {
            format!("standard deviation of the sensitivity between runs {std:.4} %")
        })
    );
    say!("  zero return    {}", percent(certificate.zero_return));
    say!(
        "  combined error {}  standard deviation of a load {:.4} %",
        percent(certificate.combined),
        calibration.deviation_percent
    );
    match certificate.class() {
        Some(class) => say!("  class          {class}"),
        None if certificate.linearity.is_none() => {
            say!("  class          none: three loads or more up to the largest show the linearity");
        }
        None => say!("  class          none: above 5 %"),
    }
    for note in &calibration.model.notes {
        say!("  {note}");
    }
}

/// A reading (SI) in the unit of its channel.
fn in_unit(channel: &Channel, reading: &Estimate) -> Estimate {
    reading.times(channel.unit.from_si(1.0))
}

fn percent(figure: Option<f64>) -> String {
    figure.map_or_else(
        || format!("{:>10}", "-"),
        |figure| format!("{figure:>8.4} %"),
    )
}

/// Decimal places that show two digits of a standard deviation.
fn places(std: f64) -> usize {
    let places = 1.0 - std.max(1e-12).log10().floor();
    places.clamp(0.0, 12.0) as usize
}

/// Six digits.
fn digits(value: f64) -> String {
    crate::machine::six_digits(value).to_string()
}

/// What was found of a kind of term; none where the loads do not show it and nobody expects it.
fn said(calibration: &StaticCalibration, kind: &str) -> Option<String> {
    let absent = calibration.absent.iter().find(|(name, _)| *name == kind);
    match absent {
        Some((_, Absence::Below(bound))) => return Some(format!("none found, below {bound:.4} %")),
        Some((_, Absence::NotShown(_))) if kind == "speed" => return None,
        Some((_, Absence::NotShown(needed))) => return Some(format!("not stated: {needed}")),
        None => {}
    }
    let of_kind = |finding: &&Finding| {
        let name = finding.term.name();
        name == kind || (kind == "nonlinearity" && matches!(name, "quadratic" | "cubic"))
    };
    let parts = calibration.found.iter().filter(of_kind).map(sentence);
    Some(parts.collect::<Vec<_>>().join("; "))
}

fn sentence(finding: &Finding) -> String {
    let [low, high] = finding.percent.interval();
    // Beyond this the tails of the scatter are not known.
    let p_value = match finding.p_value {
        small if small < 1e-6 => "p < 1e-6".to_owned(),
        p => format!("p {p:.1e}"),
    };
    let mut text = format!(
        "{} {:.4} % ({low:.4} to {high:.4}), {p_value}",
        finding.term.name(),
        finding.percent.value,
    );
    if let Some([value, low, high]) = finding.parameter {
        text += &match finding.term {
            Term::Creep { .. } => format!(", time constant {value:.0} s ({low:.0} to {high:.0})"),
            _ => format!(", turns over {value:.2} of the largest load ({low:.2} to {high:.2})"),
        };
    }
    if let Some(other) = finding.alternative {
        text += &format!("; a {other} fits as well");
    }
    text
}

/// One object for each channel, in its unit.
fn report(machine: &Machine, calibration: &StaticCalibration) -> Value {
    let channel = &machine.channels[calibration.channel];
    let own = |estimate: &Estimate| {
        let scaled = in_unit(channel, estimate);
        json!({ "value": scaled.value, "interval": scaled.interval() })
    };
    let found: Vec<Value> = calibration.found.iter().map(finding).collect();
    let absent: serde_json::Map<String, Value> = (calibration.absent.iter())
        .map(|(kind, absence)| {
            let said = match absence {
                Absence::Below(bound) => json!({ "below_percent": bound }),
                Absence::NotShown(needed) => json!({ "not_stated": needed }),
            };
            ((*kind).to_owned(), said)
        })
        .collect();
    let Certificate {
        linearity,
        reversibility,
        repeatability,
        creep,
        zero_return,
        combined,
    } = calibration.certificate;
    json!({
        "name": channel.name, "unit": channel.unit.symbol(),
        "runs": calibration.runs, "loads": calibration.plateaus, "range_nm": calibration.range,
        "sensitivity": own(&calibration.sensitivity), "zero": own(&calibration.zero),
        "found": found, "absent": absent,
        "certificate_percent": {
            "linearity": linearity, "reversibility": reversibility, "repeatability": repeatability,
            "creep_30_min": creep, "zero_return": zero_return, "combined": combined,
            "class": calibration.certificate.class(),
        },
        "deviation_percent": calibration.deviation_percent,
        "between_runs_percent": calibration.between_runs_percent,
        "written": written(channel, &calibration.model.applied(channel)),
        "notes": calibration.model.notes,
    })
}

fn finding(finding: &Finding) -> Value {
    let parameter = finding.parameter.map(|[value, low, high]| {
        let (name, unit) = match finding.term {
            Term::Creep { .. } => ("time_s", "s"),
            _ => ("level", "largest load"),
        };
        json!({ "name": name, "unit": unit, "value": value, "interval": [low, high] })
    });
    let start = match finding.term {
        Term::Hysteresis { start, .. } => Some(match start {
            Start::Preloaded => "preloaded",
            Start::Virgin => "virgin",
        }),
        _ => None,
    };
    json!({
        "term": finding.term.name(), "percent": finding.percent.value,
        "interval_percent": finding.percent.interval(), "p_value": finding.p_value,
        "parameter": parameter, "start": start, "alternative": finding.alternative,
    })
}

/// The settings that the description gets, in its units.
fn written(was: &Channel, is: &Channel) -> Value {
    let mut out = json!({ "offset": is.offset, "sensitivity": is.sensitivity });
    if is.nonlinearity != 0.0 || was.nonlinearity != 0.0 {
        out["nonlinearity"] = json!(is.nonlinearity);
    }
    if is.hysteresis.is_some() || was.hysteresis.is_some() {
        out["hysteresis"] = json!(is.hysteresis);
    }
    if is.creep.is_some() || was.creep.is_some() {
        out["creep"] = json!(is.creep);
    }
    out
}
