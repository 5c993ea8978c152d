//! The command `loadtwin replay`: runs the estimator on a recording with one set of sensors or all,
//! and prints error, flags and NIS; writes estimates, filter state and a page with plots.
//! `--archive` goes to `archive.rs`.

mod archive;
mod text_output;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, anyhow, bail};
use clap::Args;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::estimate::Estimate;
use serde_json::{Value, json};

use crate::atomic_file::{AtomicFile, publish};
use crate::cli::file_plan::{Plan, Replace};
use crate::cli::layout_option::LayoutFile;
use crate::cli::printing::{say, shown};
use crate::cli::progress::Progress;
use crate::cli::spool::spooled;
use crate::files::bounded::read;
use crate::files::file_kind::FileKind;
use crate::image_build::{self, Filter, Sensors};
use crate::machine::{Machine, Rotor};
use crate::origin::{image_fact, with_origin};
use crate::replay::{
    Baselines, Consistency, Displacements, ESTIMATES, EstimateWriter, Figures, LARGEST_STATE,
    NodeChoice, NodeColumns, Phasor, ReplayError, ReportPage, Run, STATE_MARK, Sample, Speeds,
};
use crate::report::{PAGE, Report, SAMPLES, samples_beside};

pub(super) use text_output::print_table;
use text_output::{print_baselines, print_displacements, print_flags, print_phasor, print_sizes};

/// Run the estimator on a recording and report its error.
#[derive(Debug, Args)]
pub struct Replay {
    /// Machine description (TOML).
    #[arg(required_unless_present = "archive")]
    machine: Option<PathBuf>,
    /// Recording (CSV, Parquet or MDF4); - is standard input.
    #[arg(required_unless_present = "archive")]
    recording: Option<PathBuf>,
    /// Set of sensors; the first of the description where absent.
    #[arg(long, value_name = "NAME", conflicts_with = "all_sensors")]
    sensors: Option<String>,
    /// The filter.
    #[arg(long, value_enum, default_value_t)]
    filter: Filter,
    /// Run the algorithms of the paper beside the filter, on a bearing.
    #[arg(long, conflicts_with = "all_sensors")]
    baselines: bool,
    /// One line for each set of sensors of the description.
    #[arg(long, conflicts_with_all = ["estimates", "report"])]
    all_sensors: bool,
    /// Write the estimates to FILE (.csv, .parquet or .mf4); - is CSV to standard output.
    #[arg(long, value_name = "FILE")]
    estimates: Option<PathBuf>,
    /// Write a rotor's displacements at nodes, `all` or numbers as in 3,17, with their standard
    /// deviations, its speed, angle and modal displacements too.
    #[arg(long, value_name = "NODES", requires = "estimates")]
    nodes: Option<NodeChoice>,
    /// Continue from the state that FILE holds, as --state-out wrote it.
    #[arg(long, value_name = "FILE", conflicts_with = "all_sensors")]
    state_in: Option<PathBuf>,
    /// Write the state to FILE.state, from which the next recording goes on to the bit. Samples
    /// whose estimates lag come with it.
    #[arg(long, value_name = "FILE", conflicts_with = "all_sensors")]
    state_out: Option<PathBuf>,
    /// Write a page with plots to FILE.html.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write every sample to FILE.samples.js beside the page, for zooming. Short recordings fit the
    /// page.
    #[arg(long, requires = "report")]
    report_samples: bool,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    layout: LayoutFile,
    #[command(flatten)]
    archive: archive::ArchiveOptions,
}

/// What is written as the state of a replay.
const STATE: FileKind = FileKind {
    noun: "saved state",
    suffixes: &["state"],
    is_same: |file| Ok(file.start().starts_with(STATE_MARK)),
};

/// A recording as a part of a longer one.
#[derive(Clone, Copy, Default)]
struct Part<'a> {
    /// State after the part before.
    state: Option<(&'a Path, &'a [u8])>,
    /// Whether another part follows.
    more: bool,
}

/// What one replay found.
pub(super) struct Outcome {
    pub(super) set: String,
    /// Names of its sensors.
    pub(super) sensors: Vec<String>,
    pub(super) filter: Filter,
    pub(super) figures: Figures,
    pub(super) consistency: Consistency,
    pub(super) displacements: Displacements,
    pub(super) phasor: Phasor,
    pub(super) speeds: Speeds,
    pub(super) baselines: Option<Baselines>,
    /// How the recording was read, where it is not as usual.
    pub(super) reading: Vec<String>,
    pub(super) seconds: f64,
    /// Hash of the model image, for the head of a page.
    image: [String; 2],
    /// The state at the end, where another part follows.
    state: Option<Vec<u8>>,
}

impl Outcome {
    fn page(&self, page: ReportPage, machine: &Machine, sensors: &Sensors, name: &str) -> Report {
        let mut report = page.finish(
            machine,
            (sensors, name),
            (&self.figures, &self.consistency),
            &self.displacements,
            &self.phasor,
        );
        report.facts.push(self.image.clone());
        report
            .tables
            .extend(self.baselines.as_ref().map(Baselines::table));
        report
    }
}

impl Replay {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let sensors = self.sensors.as_deref();
        if self.archive.run(sensors, self.filter, as_json)? {
            return Ok(());
        }
        let (Some(description), Some(named)) = (&self.machine, &self.recording) else {
            // The parser asks for both.
            bail!("found no machine and recording, allowed: both, or --archive DIR");
        };
        let recording = spooled(named)?;
        Plan::new(self.replace)
            .description(description)
            .reads(self.layout.file())
            .reads([&recording.path])
            .writes("--estimates", self.estimates.as_deref(), ESTIMATES)
            .reads(&self.state_in)
            .writes("--state-out", self.state_out.as_deref(), STATE)
            .writes("--report", self.report.as_deref(), PAGE)
            .writes("--report-samples", self.samples().as_deref(), SAMPLES)
            .check(as_json)?;
        let machine = self.layout.machine(description)?;
        if self.all_sensors {
            let outcomes = every_set(&machine, &recording.path, self.filter)?;
            if as_json {
                let sets: Vec<Value> = outcomes
                    .iter()
                    .map(|o| report(&machine, named, o))
                    .collect();
                say!("{}", json!({ "machine": machine.name, "sets": sets }));
            } else {
                print_table(&machine, &outcomes);
                for outcome in &outcomes {
                    if let Some(note) = outcome.consistency.note() {
                        say!("{}: {note}", outcome.set);
                    }
                }
            }
            return Ok(());
        }
        let outcome = self.replay(&machine, &recording.path, named)?;
        if as_json {
            say!("{}", report(&machine, named, &outcome));
        } else {
            print_table(&machine, std::slice::from_ref(&outcome));
            print_sizes(&machine, &outcome.figures);
            print_flags(&outcome.figures);
            if self.filter == Filter::Steady {
                let share =
                    outcome.figures.steady_samples() as f64 / outcome.figures.samples() as f64;
                say!("by steady gains: {:.1} % of the samples", 100.0 * share);
            }
            for note in (outcome.reading.iter().cloned())
                .chain(outcome.speeds.note())
                .chain(outcome.consistency.note())
                .chain(outcome.figures.segment_note())
                .chain(outcome.displacements.note())
                .chain(outcome.displacements.doubt_note())
            {
                say!("{note}");
            }
            print_displacements(&outcome.displacements);
            print_phasor(&machine, &outcome.phasor);
            if let Some(baselines) = &outcome.baselines {
                print_baselines(&baselines.table());
            }
        }
        Ok(())
    }

    /// The file of samples beside the page, where there is to be one.
    fn samples(&self) -> Option<PathBuf> {
        (self.report.as_deref().filter(|_| self.report_samples)).map(samples_beside)
    }

    /// `named`: what the recording is called.
    fn replay(&self, machine: &Machine, recording: &Path, named: &Path) -> anyhow::Result<Outcome> {
        let sensors = Sensors::choose(machine, self.sensors.as_deref())?.filtered_by(self.filter);
        let nodes = (self.nodes.as_ref())
            .map(|choice| NodeColumns::new(machine, &sensors, choice))
            .transpose()?;
        let mut estimates = match &self.estimates {
            Some(path) => Some(EstimateWriter::create(path, machine, &sensors, nodes)?),
            None => None,
        };
        let mut page = (self.report.as_ref()).map(|path| {
            let mut page = ReportPage::new(machine, &sensors);
            if self.report_samples {
                page.write_samples_beside(path);
            }
            page
        });
        let mut written = Ok(());
        let baselines = (self.baselines.then(|| Baselines::try_new(machine))).transpose()?;
        let state = (self.state_in.as_ref())
            .map(|path| read(path, LARGEST_STATE).with_context(|| path.display().to_string()))
            .transpose()?;
        let part = Part {
            state: self.state_in.as_deref().zip(state.as_deref()),
            more: self.state_out.is_some(),
        };
        let outcome = one_set(
            machine,
            &sensors,
            (recording, part),
            baselines,
            |sample, estimate, line| {
                if let (Some(writer), true) = (&mut estimates, written.is_ok()) {
                    written = writer.push(sample.t, estimate, line);
                }
                if let Some(page) = &mut page {
                    page.push(sample, estimate);
                }
            },
        )?;
        written?;
        let mut files = Vec::new();
        if let Some(writer) = estimates {
            files.push(writer.complete()?);
        }
        if let (Some(page), Some(path)) = (page, &self.report) {
            let named = named.display().to_string();
            let mut page = outcome.page(page, machine, &sensors, &named);
            if let Some(samples) = &mut page.samples {
                let samples = samples.complete();
                files.extend(samples.with_context(|| samples_beside(path).display().to_string())?);
            }
            files.push(with_origin(page, Some(&machine.path)).complete(path)?);
        }
        if let (Some(state), Some(path)) = (&outcome.state, &self.state_out) {
            let written = AtomicFile::create(path).and_then(|mut file| {
                file.write_all(state)?;
                file.complete()
            });
            files.push(written.with_context(|| path.display().to_string())?);
        }
        publish(files)?;
        Ok(outcome)
    }
}

/// Replays `recording` with the machine's first set of sensors and writes the page.
pub(super) fn write_page(machine: &Machine, recording: &Path, path: &Path) -> anyhow::Result<()> {
    let sensors = Sensors::choose(machine, None)?;
    let mut page = ReportPage::new(machine, &sensors);
    let whole = (recording, Part::default());
    let outcome = one_set(machine, &sensors, whole, None, |sample, estimate, _| {
        page.push(sample, estimate);
    })?;
    let name = recording.file_name().unwrap_or_default().to_string_lossy();
    let page = outcome.page(page, machine, &sensors, &name);
    with_origin(page, Some(&machine.path)).write(path)?;
    Ok(())
}

/// Replays `recording` with one set of sensors.
fn one_set(
    machine: &Machine,
    sensors: &Sensors,
    (recording, part): (&Path, Part<'_>),
    mut baselines: Option<Baselines>,
    mut each: impl FnMut(&Sample<'_>, &Estimate, &Estimator<'_>),
) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    let progress = Progress::new("replay");
    let mut figures = Figures::new(machine);
    let mut consistency = Consistency::new(machine, sensors);
    let mut displacements = Displacements::new(machine, sensors)?;
    let mut phasor = Phasor::new(machine, sensors);
    let mut speeds = Speeds::new(machine);
    let image = image_build::image(machine, sensors)?;
    let mut run = match part.state {
        Some((path, state)) => Run::continued(machine, sensors, &image, recording, state).map_err(
            |error| match error {
                ReplayError::State(_) => anyhow!(error).context(path.display().to_string()),
                error => error.into(),
            },
        )?,
        None => Run::open(machine, sensors, &image, recording)?,
    };
    let mut push = |sample: &Sample<'_>, estimate: &Estimate, line: &Estimator<'_>| {
        figures.push(sample, estimate);
        consistency.push(sample, estimate);
        phasor.push(sample, estimate);
        displacements.push(sample, line);
        speeds.push(sample, estimate);
        if let Some(baselines) = &mut baselines {
            baselines.push(sample, estimate);
        }
        each(sample, estimate, line);
    };
    while run.next_block(&mut push)? {
        progress.show(run.progress());
    }
    let reading = run.notes();
    let state = if part.more {
        Some(run.save()?)
    } else {
        run.finish(push);
        None
    };
    let seconds = started.elapsed().as_secs_f64();
    Ok(Outcome {
        consistency: consistency.explained(machine, sensors, recording),
        set: sensors.name.clone(),
        sensors: (sensors.channels.iter().map(|c| c.name.clone()))
            .chain(sensors.encoders.iter().map(|e| e.name.clone()))
            .collect(),
        filter: sensors.filter,
        figures,
        displacements,
        phasor,
        speeds,
        baselines,
        reading,
        seconds,
        image: image_fact(&image),
        state,
    })
}

/// Replays `recording` with each set of sensors of the machine.
pub(super) fn every_set(
    machine: &Machine,
    recording: &Path,
    filter: Filter,
) -> anyhow::Result<Vec<Outcome>> {
    Sensors::set_names(machine)
        .into_iter()
        .map(|name| {
            one_set(
                machine,
                &Sensors::choose(machine, Some(name))?.filtered_by(filter),
                (recording, Part::default()),
                None,
                |_, _, _| (),
            )
        })
        .collect()
}

/// The object that `--json` prints.
pub(super) fn report(machine: &Machine, recording: &Path, outcome: &Outcome) -> Value {
    let figures = &outcome.figures;
    let loads: serde_json::Map<String, Value> = figures
        .loads()
        .map(|(name, load)| (name.to_owned(), json!(load)))
        .collect();
    let whiteness: serde_json::Map<String, Value> = (outcome.sensors.iter())
        .zip(figures.whiteness())
        .map(|(name, of)| (name.clone(), json!(of)))
        .collect();
    json!({
        "machine": machine.name,
        "recording": shown(recording),
        "sensors": outcome.set,
        "samples": figures.samples(),
        "rate_hz": machine.rate_hz,
        "filter": outcome.filter.name(),
        "steady_samples": figures.steady_samples(),
        "lag_samples": machine.rotor.as_ref().map_or(0, Rotor::lag),
        "samples_per_second": figures.samples() as f64 / outcome.seconds,
        "loads": loads,
        "nis_mean": figures.nis_mean(),
        "whiteness": whiteness,
        "reading_notes": outcome.reading,
        "flags": figures.flags(),
        "virtual": outcome.displacements.nodes(),
        "speed_note": outcome.speeds.note(),
        "consistency": outcome.consistency,
        "consistency_note": outcome.consistency.note(),
        "segment_note": outcome.figures.segment_note(),
        "stability_note": outcome.displacements.note(),
        "doubted_samples": outcome.displacements.doubted_samples(),
        "doubt_note": outcome.displacements.doubt_note(),
        "phasor_inversion": outcome.phasor.figures(),
        "baselines": outcome.baselines.as_ref().map(Baselines::figures),
    })
}
