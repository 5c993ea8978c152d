//! Runs `loadtwin` without a command: replays the two shipped recordings of a gearbox with every
//! set of sensors, prints the errors, and writes `out/report.html` on the first recording with the
//! first set.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde_json::json;

use super::file_plan::{Plan, Replace};
use super::printing::{say, shown};
use super::replay;
use crate::image_build::Filter;
use crate::machine::Machine;
use crate::report::PAGE;

/// The example's recordings, each with the description of its machine: with the
/// effects that the model lacks, calibrated on other recordings of that machine;
/// and of a machine that is as described.
const RECORDINGS: [(&str, &str, &str); 2] = [
    (
        "calibrated.toml",
        "start-stop.parquet",
        "start-stop cycle, with the effects that the model lacks",
    ),
    (
        "machine.toml",
        "start-stop-clean.parquet",
        "the same without those effects",
    ),
];

/// Replays the shipped recordings with every set of sensors.
///
/// # Errors
/// When the example is not there or cannot be replayed.
pub fn run(as_json: bool) -> anyhow::Result<()> {
    let folder = example()?;
    let page = Path::new("out/report.html");
    std::fs::create_dir_all("out").context("out")?;
    let mut plan = Plan::new(Replace::default()).writes("report", Some(page), PAGE);
    for (description, file, _) in RECORDINGS {
        plan = plan.description(&folder.join(description));
        plan = plan.reads([folder.join(file)]);
    }
    plan.check(as_json)?;
    let mut recordings = Vec::new();
    for (description, file, title) in RECORDINGS {
        let machine = Machine::load(&folder.join(description))?;
        let recording = folder.join(file);
        let outcomes = replay::every_set(&machine, &recording, Filter::default())?;
        if as_json {
            let sets: Vec<_> = outcomes
                .iter()
                .map(|o| replay::report(&machine, &recording, o))
                .collect();
            recordings.push(json!({ "recording": shown(&recording), "sets": sets }));
        } else {
            say!("{}: {title}", machine.name);
            replay::print_table(&machine, &outcomes);
            say!();
        }
    }
    let (description, file, _) = RECORDINGS[0];
    replay::write_page(
        &Machine::load(&folder.join(description))?,
        &folder.join(file),
        page,
    )?;
    if as_json {
        say!(
            "{}",
            json!({ "recordings": recordings, "report": shown(page) })
        );
    } else {
        say!("report: {}", page.display());
    }
    Ok(())
}

/// The example's folder: below the current one, or where the source lies.
pub(super) fn example() -> anyhow::Result<PathBuf> {
    let relative = Path::new("examples/gearbox");
    let source = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .join(relative);
    [relative.to_owned(), source]
        .into_iter()
        .find(|folder| folder.join("machine.toml").is_file())
        .context("examples/gearbox/machine.toml is not there; run loadtwin in a checkout, or see loadtwin --help")
}
