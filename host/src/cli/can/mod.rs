//! The commands `loadtwin node`, `send`, `twin`, `monitor`, `prove`, `upload` and `dbc`: their
//! arguments, opening of model, bus or log, and printing of the summary. The work is done in the
//! crate `loadtwin_can`. `twin` and `prove` fail unless all frames are identical.

pub(super) mod record;

use std::collections::VecDeque;
use std::error::Error;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use loadtwin_common::io::raw::RawSample;
use loadtwin_common::io::signed_image;
use serde::Serialize;

use super::file_plan::{Plan, Replace};
use super::layout_option::{LayoutFile, load};
use super::printing::{note, print as output, say};
use super::progress::Progress;
use super::spool::spooled;
use crate::browser_monitor::{Labels, WebView};
use crate::can::bus::Bus;
use crate::can::dbc::{self, LoadScale};
use crate::can::estimator_node::{self, NodeArgs};
use crate::can::frame_comparison::Verdict;
use crate::can::frame_source::{DEVICE, Source};
use crate::can::live_display::View;
use crate::can::log::LogWriter;
use crate::can::logging_bus::{NoBus, Recorded};
use crate::can::monitor::{self, MonitorArgs};
use crate::can::paced_bus::Paced;
use crate::can::sample_sender::{self, SendArgs};
use crate::can::twin_and_prove::{self, ProveArgs, TwinArgs, TwinSummary};
use crate::can::{CanError, LOG, Model, live_display, stop_on_signal, upload};
use crate::files::{bounded, file_kind};
use crate::image_build::{self, Sensors};
use crate::machine::Machine;
use crate::replay::Samples;
use crate::upload_protocol::Uploader;

/// Largest model image (bytes): the flash of the largest boards has 2 MiB.
const LARGEST_IMAGE: u64 = 16 << 20;

/// The model to run.
#[derive(Debug, Args)]
struct ModelArgs {
    /// Machine description (TOML) or model image.
    machine: PathBuf,
    /// Set of sensors; the first of the description where absent.
    #[arg(long, value_name = "NAME")]
    sensors: Option<String>,
}

impl ModelArgs {
    /// The payload of the model image.
    fn load(&self) -> anyhow::Result<Vec<u8>> {
        Ok(self.load_with_sensors()?.0)
    }

    /// The same with the names of the sensors in the order of the estimates, where it is a
    /// description that has them.
    fn load_with_sensors(&self) -> anyhow::Result<(Vec<u8>, Vec<String>)> {
        if self.machine.extension().is_some_and(|end| end == "toml") {
            let machine = load(&self.machine)?;
            let sensors = Sensors::choose(&machine, self.sensors.as_deref())?;
            return Ok((image_build::image(&machine, &sensors)?, sensors.names()));
        }
        anyhow::ensure!(
            self.sensors.is_none(),
            "--sensors: found an image, {}, which has its sensors already; allowed: a description (.toml)",
            self.machine.display()
        );
        Ok((self.image()?, Vec::new()))
    }

    fn image(&self) -> anyhow::Result<Vec<u8>> {
        let bytes = bounded::read(&self.machine, LARGEST_IMAGE)
            .with_context(|| self.machine.display().to_string())?;
        if !bytes.starts_with(&signed_image::MAGIC) {
            let found = file_kind::named(&bytes);
            anyhow::ensure!(
                found == file_kind::BINARY,
                "{}: found {found}, allowed: a description (.toml) or a model image; it comes before the source",
                self.machine.display()
            );
            return Ok(bytes);
        }
        let (_, payload) =
            signed_image::open(&bytes).with_context(|| self.machine.display().to_string())?;
        Ok(payload.to_vec())
    }
}

/// Stand in for the microcontroller: raw frames in, estimate frames out.
#[derive(Debug, Args)]
pub struct Node {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    args: NodeArgs,
}

/// Put a recording's raw samples on a bus.
#[derive(Debug, Args)]
pub struct Send {
    /// Machine description (TOML).
    machine: PathBuf,
    /// The recording; - is standard input.
    recording: PathBuf,
    #[command(flatten)]
    args: SendArgs,
    /// Set of sensors; the first of the description where absent.
    #[arg(long, value_name = "NAME")]
    sensors: Option<String>,
    #[command(flatten)]
    layout: LayoutFile,
}

/// Recompute what a machine sends and compare it bit for bit.
#[derive(Debug, Args)]
pub struct Twin {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    args: TwinArgs,
}

/// Watch a bus.
#[derive(Debug, Args)]
pub struct Monitor {
    #[command(flatten)]
    args: MonitorArgs,
    /// Machine description (TOML) or model image, for names and units.
    machine: Option<PathBuf>,
}

/// As twin, on a log taken earlier.
#[derive(Debug, Args)]
pub struct Prove {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    args: ProveArgs,
}

/// Send a signed model image to a board; it runs after the board's restart.
#[derive(Debug, Args)]
pub struct Upload {
    /// The image, from `loadtwin build --key`.
    image: PathBuf,
    /// Bus: an interface (can0) or an adapter (`slcan:/dev/ttyACM0@500000`).
    #[arg(value_name = "SOURCE")]
    interface: String,
}

/// Print the DBC file.
#[derive(Debug, Args)]
pub struct Dbc {
    /// Machine description (TOML) or model image, for its identifiers, names
    /// and units; in % of full scale where absent. An image has no names of sensors.
    machine: Option<PathBuf>,
    /// Set of sensors; the first of the description where absent.
    #[arg(long, value_name = "NAME", requires = "machine")]
    sensors: Option<String>,
}

/// The bus, with what is to be known of it on standard error.
fn noted(bus: Box<dyn Bus>) -> Box<dyn Bus> {
    if let Some(remark) = bus.remark() {
        note(format_args!("{remark}\n"));
    }
    bus
}

/// Opens a bus; with `log`, all that it carries is written there.
fn opened(
    source: Source<'_>,
    block: Option<u16>,
    log: Option<&Path>,
) -> Result<Box<dyn Bus>, CanError> {
    let bus = noted(source.open(block, None)?);
    let Some(log) = log else {
        return Ok(bus);
    };
    let writer = LogWriter::create(log, source.device())?;
    Ok(Box::new(Recorded::new(
        bus,
        writer,
        source.log().is_some(),
    )?))
}

/// Where a command shows itself while it runs: with a log, which is over at once, nowhere.
fn shown_of(is_log: bool) -> std::io::Result<Box<dyn View>> {
    if is_log {
        return Ok(Box::new(live_display::Quiet));
    }
    live_display::live()
}

/// Prints a summary; as text, one key a line.
fn print(summary: &impl Serialize, as_json: bool) -> anyhow::Result<()> {
    let value = serde_json::to_value(summary)?;
    match value.as_object() {
        Some(entries) if !as_json => {
            for (key, value) in entries.iter().filter(|(_, value)| !value.is_null()) {
                say!("{:24} {value}", key.replace('_', " "));
            }
        }
        _ => say!("{value}"),
    }
    Ok(())
}

impl Node {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let source = Source::of(&self.args.interface)?;
        let log = self.args.log.as_deref();
        anyhow::ensure!(
            source.log().is_none() || log.is_some(),
            "{}: a log takes no frames; -o FILE names the log that is written",
            self.args.interface
        );
        Plan::new(Replace::default())
            .description(&self.model.machine)
            .reads(source.log())
            .writes_new("--log", log, LOG)
            .check(as_json)?;
        let image = self.model.load()?;
        let model = Model::from_bytes(&image)?;
        let stop = stop_on_signal()?;
        let bus = opened(source, Some(model.image.can_base), log)?;
        let mut view = shown_of(source.log().is_some())?;
        let summary = estimator_node::run(&model, bus, &self.args, &mut *view, &stop)?;
        print(&summary, as_json)
    }
}

impl Send {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let log = self.args.log.as_deref();
        Plan::new(Replace::default())
            .description(&self.machine)
            .writes_new("--log", log, LOG)
            .check(as_json)?;
        let recording = spooled(&self.recording)?;
        let machine = self.layout.machine(&self.machine)?;
        let sensors = Sensors::choose(&machine, self.sensors.as_deref())?;
        let image = image_build::image(&machine, &sensors)?;
        let model = Model::from_bytes(&image)?;
        let samples = RawSamples::open(&machine, &sensors, &recording.path)?;
        let stop = stop_on_signal()?;
        let bus: Box<dyn Bus> = match (&self.args.interface, log) {
            (Some(name), log) => opened(Source::of(name)?, Some(model.image.can_base), log)?,
            (None, Some(log)) => {
                let writer = LogWriter::create(log, DEVICE)?;
                Box::new(Recorded::new(NoBus::default(), writer, false)?)
            }
            (None, None) => Box::new(NoBus::default()),
        };
        let mut view = shown_of(self.args.interface.is_none())?;
        let summary = sample_sender::run(&model, bus, samples, &self.args, &mut *view, &stop)?;
        print(&summary, as_json)
    }
}

impl Upload {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let name = self.image.display().to_string();
        let image = bounded::read(&self.image, LARGEST_IMAGE).with_context(|| name.clone())?;
        let uploader = Uploader::new(image).context(name)?;
        let stop = stop_on_signal()?;
        let bus = noted(Source::of(&self.interface)?.open(None, None)?);
        let progress = Progress::new("upload");
        let summary = upload::run(uploader, bus, |part| progress.show(part), &stop)?;
        drop(progress);
        print(&summary, as_json)
    }
}

/// The raw samples of a recording, one by one.
struct RawSamples {
    samples: Samples,
    block: VecDeque<RawSample>,
}

impl RawSamples {
    fn open(machine: &Machine, sensors: &Sensors, path: &Path) -> anyhow::Result<Self> {
        Ok(Self {
            samples: Samples::open(machine, sensors, path)?,
            block: VecDeque::new(),
        })
    }
}

impl Iterator for RawSamples {
    type Item = Result<RawSample, Box<dyn Error + std::marker::Send + Sync>>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.block.is_empty() {
            let block = &mut self.block;
            match self
                .samples
                .next_block(|sample| block.push_back(sample.raw))
            {
                Ok(true) => {}
                Ok(false) => return None,
                Err(error) => return Some(Err(error.into())),
            }
        }
        self.block.pop_front().map(Ok)
    }
}

/// Prints what a comparison found; anything but identity is a failure.
fn report_verdict(summary: &TwinSummary, as_json: bool) -> anyhow::Result<()> {
    print(summary, as_json)?;
    let f = &summary.figures;
    match summary.verdict {
        Verdict::Identical => Ok(()),
        Verdict::Different => match &f.first_difference {
            Some(d) => bail!(
                "frames differ; the first: tick {}, {:03X}: {}",
                d.tick,
                d.id,
                d.what
            ),
            None => bail!("frames differ"),
        },
        Verdict::OtherModel => bail!(
            "the machine runs model {:08x}, this is {:08x}",
            f.machine_model.unwrap_or(0),
            summary.model
        ),
        Verdict::Incomplete => {
            bail!(
                "not everything could be compared: frames are missing or damaged, or the machine \
                 had run before"
            )
        }
        Verdict::Nothing => {
            let has_samples = f.samples + f.incomplete_samples + f.damaged_frames > 0;
            let hint = if has_samples {
                "; of a log of several buses choose one with `prove --interface NAME`"
            } else {
                ""
            };
            bail!("nothing to compare: no raw samples with estimates of this machine{hint}")
        }
    }
}

impl Twin {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let source = Source::of(&self.args.interface)?;
        Plan::new(Replace::default())
            .description(&self.model.machine)
            .reads(source.log())
            .writes_new("--log", self.args.log.as_deref(), LOG)
            .check(as_json)?;
        let image = self.model.load()?;
        let model = Model::from_bytes(&image)?;
        let stop = stop_on_signal()?;
        let bus = noted(source.open(Some(model.image.can_base), None)?);
        let mut view = shown_of(source.log().is_some())?;
        let summary = twin_and_prove::run(&model, bus, &self.args, &mut *view, &stop)?;
        report_verdict(&summary, as_json)
    }
}

impl Prove {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let image = self.model.load()?;
        let model = Model::from_bytes(&image)?;
        let stop = stop_on_signal()?;
        report_verdict(
            &twin_and_prove::prove(&model, &self.args, &mut live_display::Quiet, &stop)?,
            as_json,
        )
    }
}

impl Monitor {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let description = &self.args.interface;
        anyhow::ensure!(
            Path::new(description)
                .extension()
                .is_none_or(|end| end != "toml"),
            "{description}: found a machine description, allowed: a bus or a log first, the description after it, as \
             in `loadtwin monitor can0 {description}`"
        );
        let (image, sensors) = match &self.machine {
            Some(machine) => {
                let machine = machine.clone();
                let model = ModelArgs {
                    machine,
                    sensors: None,
                };
                let (image, sensors) = model.load_with_sensors()?;
                (Some(image), sensors)
            }
            None => (None, Vec::new()),
        };
        let model = image.as_deref().map(Model::from_bytes).transpose()?;
        let stop = stop_on_signal()?;
        // The whole bus: what is not the machine's is counted too.
        let source = Source::of(&self.args.interface)?;
        let mut bus = noted(source.open(None, None)?);
        let mut view: Box<dyn View> = match self.args.web {
            None => shown_of(source.log().is_some())?,
            Some(address) => {
                if source.log().is_some() {
                    bus = Box::new(Paced::new(bus, self.args.speed));
                }
                let view = WebView::new(address, labels(model.as_ref(), sensors))
                    .with_context(|| format!("--web {address}"))?;
                note(format_args!(
                    "page: http://{}/ (Ctrl-C ends)\n",
                    view.address
                ));
                Box::new(view)
            }
        };
        let summary = monitor::run(model.as_ref(), bus, &self.args, &mut *view, &stop)?;
        print(&summary, as_json)?;
        if let Some((machine, given)) = summary.other_model() {
            bail!(
                "the machine runs model {machine:08x}, the description gives {given:08x}: names and scales may be \
                 wrong; allowed: the description and sensor set that the machine runs, or none"
            );
        }
        Ok(())
    }
}

/// What the page in browsers calls loads and sensors.
fn labels(model: Option<&Model<'_>>, sensors: Vec<String>) -> Labels {
    let Some(model) = model else {
        return Labels::default();
    };
    let loads = model.image.loads().len();
    Labels {
        machine: model.image.machine.to_owned(),
        units: (0..loads)
            .map(|place| model.image.load_unit(place).to_owned())
            .collect(),
        sensors,
    }
}

impl Dbc {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        let Some(machine) = &self.machine else {
            output(format_args!("{}", dbc::DBC));
            return Ok(());
        };
        let args = ModelArgs {
            machine: machine.clone(),
            sensors: self.sensors.clone(),
        };
        let (image, sensors) = args.load_with_sensors()?;
        let model = Model::from_bytes(&image)?;
        let loads: Vec<_> = (model.image.loads().iter().enumerate())
            .map(|(place, load)| LoadScale {
                name: &load.name,
                unit: model.image.load_unit(place),
                full_scale: load.full_scale,
            })
            .collect();
        let sensors: Vec<&str> = sensors.iter().map(String::as_str).collect();
        output(format_args!(
            "{}",
            dbc::of_machine(model.image.can_base, &loads, &sensors)
        ));
        Ok(())
    }
}
