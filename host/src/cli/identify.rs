//! The command `loadtwin identify`: fits inertias, stiffness, damping and drag of a drivetrain to recordings
//! with reference loads, and writes those that predict held-out data better.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::{Value, json};

use super::file_plan::{Plan, Replace};
use super::layout_option::LayoutFile;
use super::printing::{say, shown, shown_all};
use super::progress::Progress;
use crate::diagnose::{
    Combination, Gain, Identification, Identified, Quantity, SensorError, Shown, identify,
    write_identified,
};
use crate::machine::Machine;

/// Fit inertias, stiffness, damping and drag to recordings with reference loads.
///
/// Begins with the description and its standard deviations, stated or by default. The last third of each
/// recording takes no part in the fit: what does not predict it better is not written.
#[derive(Debug, Args)]
pub struct Identify {
    /// Machine description (TOML), calibrated.
    machine: PathBuf,
    /// Recordings (CSV, Parquet or MDF4) with a reference for each load, whose speed changes.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Write the description with the values that are accepted, and their standard deviations.
    #[arg(short, long, alias = "out", value_name = "FILE.toml")]
    output: Option<PathBuf>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    layout: LayoutFile,
}

impl Identify {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let started = Instant::now();
        Plan::new(self.replace)
            .description(&self.machine)
            .reads(self.layout.file())
            .reads_once(&self.recordings)
            .writes_description("--output", self.output.as_deref())
            .check(as_json)?;
        let machine = self.layout.machine(&self.machine)?;
        let progress = Progress::new("identify");
        let found = identify(&machine, &self.recordings, |part| progress.show(part))?;
        drop(progress);
        let changes = found.parameters.iter().any(|p| p.accepted);
        let output = self.output.as_ref().filter(|_| changes);
        if let Some(path) = output {
            write_identified(&machine, &found, path)?;
        }
        let seconds = started.elapsed().as_secs_f64();
        if as_json {
            let mut out = report(&machine, &found);
            if let Some(object) = out.as_object_mut() {
                object.insert("recordings".into(), json!(shown_all(&self.recordings)));
                object.insert("machine_out".into(), json!(output.map(shown)));
                object.insert("seconds".into(), json!(seconds));
            }
            say!("{out}");
        } else {
            print(&found);
            if !changes {
                say!("the description stays as it is");
            }
            say!("{seconds:.1} s");
        }
        Ok(())
    }
}

fn report(machine: &Machine, found: &Identification) -> Value {
    let parameter = |identified: &Identified| {
        let parameter = &identified.parameter;
        json!({
            "quantity": parameter.quantity.name(),
            "part": parameter.part,
            "unit": parameter.quantity.unit(),
            "described": parameter.described,
            "described_std": parameter.prior_std,
            "fitted": identified.fitted,
            "std": identified.std,
            "ratio": identified.ratio(),
            "shown": identified.shown,
            "accepted": identified.accepted,
            "value": identified.value,
        })
    };
    let combination = |combination: &Combination| {
        let weight = |(i, weight): &(usize, f64)| {
            let parameter = &found.parameters[*i].parameter;
            json!({
                "quantity": parameter.quantity.name(),
                "part": parameter.part,
                "weight": weight,
            })
        };
        let weights: Vec<Value> = combination.weights.iter().map(weight).collect();
        json!({ "parameters": weights, "ratio": combination.ratio })
    };
    let sensor = |sensor: &SensorError| {
        json!({
            "name": sensor.name, "unit": sensor.unit,
            "rms_before": sensor.rms_before, "rms_after": sensor.rms_after,
        })
    };
    json!({
        "machine": machine.name,
        "parameters": found.parameters.iter().map(parameter).collect::<Vec<_>>(),
        "combinations": found.combinations.iter().map(combination).collect::<Vec<_>>(),
        "held_out": {
            "duration_s": found.held_out_s,
            "sensors": found.sensors.iter().map(sensor).collect::<Vec<_>>(),
            "smaller_percent": found.gain.map(|gain| 100.0 * gain.value),
            "interval_percent": found.gain.map(|gain| gain.interval.map(|bound| 100.0 * bound)),
        },
    })
}

fn print(found: &Identification) {
    say!(
        "{:<26}{:<10}{:>11}{:>10}{:>11}{:>10}{:>7}{:>11}  result",
        "parameter",
        "unit",
        "described",
        "+-",
        "fitted",
        "+-",
        "ratio",
        "value"
    );
    for identified in &found.parameters {
        let parameter = &identified.parameter;
        say!(
            "{:<26}{:<10}{:>11}{:>10}{:>11}{:>10}{:>7.3}{:>11}  {}",
            name(identified),
            parameter.quantity.unit(),
            digits(parameter.described, 5),
            digits(parameter.prior_std, 2),
            digits(identified.fitted, 5),
            digits(identified.std, 2),
            identified.ratio(),
            digits(identified.value, 5),
            outcome(identified)
        );
    }
    for Combination { weights, ratio, .. } in &found.combinations {
        let term =
            |(i, weight): &(usize, f64)| format!("{weight:+.2} {}", name(&found.parameters[*i]));
        let sum: Vec<String> = weights.iter().map(term).collect();
        say!(
            "only together, in standard deviations of the description: {}: ratio {ratio:.3}",
            sum.join(" ")
        );
    }
    say!(
        "{:<26}{:<10}{:>11}{:>11}",
        "held-out residual",
        "unit",
        "before",
        "after"
    );
    for sensor in &found.sensors {
        say!(
            "{:<26}{:<10}{:>11}{:>11}",
            sensor.name,
            sensor.unit,
            digits(sensor.rms_before, 3),
            digits(sensor.rms_after, 3)
        );
    }
    if let Some(Gain { value, interval }) = found.gain {
        let percent = interval.map(|bound| format!("{:.2}", 100.0 * bound));
        say!(
            "residuals of {:.0} s held out are smaller by {:.2} % ({} to {} %)",
            found.held_out_s,
            100.0 * value,
            percent[0],
            percent[1]
        );
    }
}

fn name(identified: &Identified) -> String {
    let parameter = &identified.parameter;
    format!("{} {}", parameter.quantity.name(), parameter.part)
}

fn outcome(identified: &Identified) -> &'static str {
    let is_damping = identified.parameter.quantity == Quantity::Damping;
    match (identified.shown, identified.accepted) {
        (Shown::Alone, false) if identified.differs() && is_damping => {
            "differs: no damping is written"
        }
        (Shown::Alone, false) if identified.differs() => "differs, not confirmed by held-out data",
        (Shown::No, _) => "not shown: as described",
        (Shown::Alone, true) => "accepted",
        (Shown::Together, true) => "accepted, shown together with others",
        (Shown::Alone, false) => "agrees with the description",
        (Shown::Together, false) => "agrees, shown together with others",
    }
}

/// `value` with so many digits.
fn digits(value: f64, count: usize) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let before = value.abs().log10().floor() as i32 + 1;
    if !(-3..=7).contains(&before) {
        return format!("{value:.*e}", count - 1);
    }
    let behind = usize::try_from(count as i32 - before).unwrap_or(0);
    format!("{value:.behind$}")
}
