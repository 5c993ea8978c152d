//! The part of `loadtwin tune` for rotors: tunes the noise by likelihood and by differential
//! evolution, compares the chosen noise with the described noise on hold-out data, and writes it
//! unless it is worse.

use std::path::Path;
use std::time::Instant;

use serde_json::{Map, Value, json};

use super::printing::{say, shown, shown_all};
use super::progress::Progress;
use super::tune::{Choice as Asked, Tune};
use crate::atomic_file::{Complete, publish};
use crate::calibrate::Description;
use crate::image_build::Sensors;
use crate::machine::{Machine, Rotor, RotorLoad, six_digits};
use crate::origin::with_origin;
use crate::replay::{Comparison, SETTLING_S};
use crate::rotor_tune::{Choice, Evaluation, Method, evaluate, page, tune};

impl Tune {
    /// Both methods on the recordings of a rotor; the chosen one is compared on hold-out data.
    pub(super) fn run_rotor(
        &self,
        described: &Machine,
        rotor: &Rotor,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let method = self.rotor_method()?;
        let started = Instant::now();
        let sensors = Sensors::choose(described, self.sensors.as_deref())?;
        let progress = Progress::new("tune");
        let choices = tune(described, rotor, &sensors, self.training(), |part| {
            progress.show(part);
        })?;
        drop(progress);
        let recording = self.validate.as_ref().unwrap_or(&self.recordings[0]);
        let choices = (choices.into_iter())
            .map(|choice| {
                let evaluation = evaluate(&choice.machine, self.sensors.as_deref(), recording)?;
                Ok((choice, evaluation))
            })
            .collect::<anyhow::Result<Vec<_>>>()?;
        let chosen = choices.iter().find(|(choice, _)| choice.method == method);
        let set = self.sensors.as_deref();
        let comparison = (chosen.as_ref())
            .map(|(choice, _)| self.holdout().compare(described, &choice.machine, set))
            .transpose()?;
        let is_worse = comparison.as_ref().is_some_and(Comparison::is_worse);
        if let (Some(comparison), true, Some(_)) = (&comparison, is_worse, &self.output) {
            anyhow::bail!(
                "nothing is written: the tuned noise is worse than the described noise ({}): {}; give recordings \
                 that are more alike those of use, another --method, or leave the description as it is",
                self.holdout_text(),
                comparison.line()
            );
        }
        if comparison.as_ref().is_some_and(Comparison::is_empty) && self.output.is_some() {
            anyhow::bail!(
                "nothing is written ({}): it has nothing to compare after its first {SETTLING_S} s; give longer \
                 recordings",
                self.holdout_text()
            );
        }
        let mut files = Vec::new();
        if let (Some(path), Some((choice, _))) = (&self.output, chosen) {
            files = complete(described, &choice.machine, path)?;
        }
        if let Some(path) = &self.report {
            let page = page(described, &choices, &recording.display().to_string());
            files.push(with_origin(page, Some(&described.path)).complete(path)?);
        }
        publish(files)?;
        if as_json {
            let methods: Map<String, Value> = (choices.iter())
                .map(|(choice, evaluation)| {
                    (choice.method.name().to_owned(), report(choice, evaluation))
                })
                .collect();
            let out = json!({
                "machine": described.name,
                "recordings": shown_all(&self.recordings),
                "method": method.name(),
                "methods": methods,
                "evaluated_on": shown(recording),
                // The former name.
                "judged_on": shown(recording),
                "holdout": {
                    "recordings": shown_all(self.holdout().recordings),
                    "last_part": self.holdout().part,
                    "comparison": comparison,
                    "is_worse": is_worse,
                },
                "machine_out": self.output.as_ref().map(shown),
                "seconds": started.elapsed().as_secs_f64(),
            });
            say!("{out}");
        } else {
            print(&choices, recording, self.validate.is_none());
            if let Some(comparison) = &comparison {
                say!("{}: {}", self.holdout_text(), comparison.line());
            }
        }
        Ok(())
    }

    /// The chosen method; options that a rotor does not have are refused.
    fn rotor_method(&self) -> anyhow::Result<Method> {
        let method = match self.method {
            None | Some(Asked::Likelihood) => Method::Likelihood,
            Some(Asked::Evolution) => Method::Evolution,
            Some(_) => anyhow::bail!("--method: allowed on a rotor: likelihood, evolution"),
        };
        for (given, option) in [
            (self.cutoff.is_some(), "--cutoff"),
            (self.keep_r, "--keep-r"),
            (self.compare, "--compare"),
            (self.response.is_some(), "--response"),
        ] {
            anyhow::ensure!(!given, "{option}: for a drivetrain only; found a rotor");
        }
        Ok(method)
    }
}

fn report(choice: &Choice, evaluation: &Evaluation) -> Value {
    let machine = &choice.machine;
    let loads: Map<String, Value> = (machine.rotor.iter())
        .flat_map(|rotor| {
            let walk = |load: &RotorLoad| json!(load.walk(rotor.speed_rad_s));
            rotor
                .loads
                .iter()
                .map(move |l| (l.names.join(","), walk(l)))
        })
        .collect();
    let sensors: Map<String, Value> = (machine.channels.iter())
        .map(|channel| (channel.name.clone(), json!(channel.noise_std)))
        .collect();
    let reduction = machine.rotor.as_ref().map(|rotor| &rotor.reduction);
    json!({
        "walk_n_per_sqrt_s": loads,
        "model_std": reduction.map(|r| r.model_std),
        "initial_std": reduction.map(|r| r.initial_std),
        "noise_std": sensors,
        "misfit": choice.outcome.misfit,
        "objectives": choice.outcome.objectives,
        "evaluation": evaluation,
        // The former name.
        "judged": evaluation,
    })
}

fn print(choices: &[(Choice, Evaluation)], recording: &Path, is_tuned_on: bool) {
    say!(
        "{:<12}{:>10}{:>11}{:>11}{:>8}  error of a displacement at any node",
        "method",
        "misfit",
        "f1",
        "f2",
        "NIS"
    );
    for (choice, evaluation) in choices {
        let [first, second] = choice.outcome.objectives;
        let errors: Vec<String> = (evaluation.displacement_um.iter())
            .map(|(segment, worst)| format!("{segment} {worst:.3} µm"))
            .collect();
        say!(
            "{:<12}{:>10.4}{:>11.2e}{:>11.2e}{:>8.2}  {}",
            choice.method.name(),
            choice.outcome.misfit,
            first,
            second,
            evaluation.nis_mean.unwrap_or(f64::NAN),
            errors.join(", ")
        );
    }
    let note = if is_tuned_on {
        ", which was tuned on: give another with --validate"
    } else {
        ""
    };
    say!("evaluated on {}{note}", recording.display());
}

/// The description with the noise of `tuned`, without a name yet.
fn complete(described: &Machine, tuned: &Machine, path: &Path) -> anyhow::Result<Vec<Complete>> {
    let mut description = Description::read(&described.path)?;
    if let Some(rotor) = &tuned.rotor {
        for (i, load) in rotor.loads.iter().enumerate() {
            let walk = load.walk(rotor.speed_rad_s);
            description.set_number_at("rotor.load", i, "walk_n_per_sqrt_s", walk);
        }
        if let Some(file) = &rotor.ross_model {
            let folder = described.path.parent().unwrap_or(Path::new(""));
            let file = std::path::absolute(folder.join(file))?;
            description.set_in("rotor", "ross_model", file.to_string_lossy().as_ref());
        }
        for (key, value) in [
            ("model_std", rotor.reduction.model_std),
            ("initial_std", rotor.reduction.initial_std),
        ] {
            description.set_in("rotor.reduction", key, six_digits(value));
        }
    }
    Ok(description.with_gauges(described, tuned, path)?)
}
