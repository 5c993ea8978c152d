//! The command `loadtwin build`: makes the model image of a machine description for one set of
//! sensors, checks it for a board, signs it where a key is given, and packs it into an FMU on
//! request.

mod output;

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, ValueEnum};
use loadtwin_common::estimator::Estimator;
use loadtwin_common::hardware::{EMULATED, Hardware, NUCLEO_G474RE};
use loadtwin_common::image::{Image, Model};
use loadtwin_common::io::signed_image;

use self::output::Built;
use super::file_plan::{Plan, Replace};
use super::layout_option::load;
use super::printing::note;
use crate::atomic_file::{AtomicFile, Complete, publish};
use crate::files::file_kind::FileKind;
use crate::fmu::interface::Interface;
use crate::fmu::library::Library;
use crate::fmu::package::{FMU, FmiVersion, pack};
use crate::image_build::{self, Filter, Sensors};
use crate::key::SigningKey;
use crate::machine::{Converter, Machine};
use crate::seal::seal;

/// No image is larger (bytes): that of a board's flash bank is 256 kB.
const LARGEST_IMAGE: u64 = 1 << 20;

/// What is written as a model image.
const IMAGE: FileKind = FileKind {
    noun: "model image",
    suffixes: &["image", "img", "bin"],
    is_same: |file| Ok(signed_image::open(&file.whole(LARGEST_IMAGE)?).is_ok()),
};

/// Make the model image that firmware and host run.
#[derive(Debug, Args)]
pub struct Build {
    /// Machine description (TOML).
    machine: PathBuf,
    /// Set of sensors; the first of the description where absent.
    #[arg(long, value_name = "NAME")]
    sensors: Option<String>,
    /// The filter.
    #[arg(long, value_enum, default_value_t)]
    filter: Filter,
    /// Signs the image, so that a board takes it.
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    /// Number of the image, higher with each one that is published; the
    /// seconds since 1970 where absent.
    #[arg(long, value_name = "N")]
    issue: Option<u32>,
    /// A newer image, by its number, that this older one may replace on a board.
    #[arg(long, value_name = "N", requires = "key")]
    replaces: Option<u32>,
    /// The image.
    #[arg(short, long, value_name = "FILE", required_unless_present = "fmu")]
    output: Option<PathBuf>,
    /// The board that the image is for; one that it cannot serve is refused.
    #[arg(long, value_name = "BOARD", value_enum)]
    board: Option<BoardName>,
    /// Write the estimator as a co-simulation FMU to FILE.fmu: the image, and a shared library that
    /// runs it.
    #[arg(long, value_name = "FILE")]
    fmu: Option<PathBuf>,
    /// Version of FMI of the FMU.
    #[arg(
        long,
        value_name = "VERSION",
        value_enum,
        default_value_t,
        requires = "fmu"
    )]
    fmi: Fmi,
    /// The shared library of the FMU; `libloadtwin_fmu.so` beside the command where absent.
    #[arg(long, value_name = "FILE", requires = "fmu")]
    library: Option<PathBuf>,
    #[command(flatten)]
    replace: Replace,
}

/// Boards that there is firmware for.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum BoardName {
    /// NUCLEO-G474RE with an ADS131M04: 250 Hz to 16 kHz, four channels, one encoder of up to 16 bits
    #[value(name = "nucleo-g474re")]
    NucleoG474re,
    /// Emulated Cortex-M4F: any rate
    Emulated,
}

/// Length of the words of an ADS131M04 (bit).
const ADS131M04_BITS: u32 = 24;

impl BoardName {
    /// Whether the description understands the words of the board's converter; those of the emulated
    /// board may be any.
    fn check_words(self, machine: &Machine, sensors: &Sensors) -> anyhow::Result<()> {
        // The words of a drive's signals have a scale alone.
        if matches!(self, Self::Emulated) || machine.balance.is_some() {
            return Ok(());
        }
        for channel in &sensors.channels {
            let Some(adc) = &channel.adc else { continue };
            let name = &channel.name;
            anyhow::ensure!(
                adc.converter
                    .is_none_or(|converter| converter == Converter::Ads131m04),
                "channel `{name}`: adc.converter: found another one, allowed: \"ads131m04\""
            );
            anyhow::ensure!(
                adc.bits == ADS131M04_BITS,
                "channel `{name}`: adc.bits: found {}, allowed: {ADS131M04_BITS}",
                adc.bits
            );
        }
        Ok(())
    }

    pub(super) fn hardware(self) -> Hardware {
        match self {
            Self::NucleoG474re => NUCLEO_G474RE,
            Self::Emulated => EMULATED,
        }
    }
}

/// Versions of FMI.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum Fmi {
    /// Of 2022
    #[default]
    #[value(name = "3.0")]
    V3,
    /// Of 2014, for older simulators
    #[value(name = "2.0")]
    V2,
}

impl Fmi {
    fn version(self) -> FmiVersion {
        match self {
            Self::V3 => FmiVersion::V3,
            Self::V2 => FmiVersion::V2,
        }
    }
}

impl Build {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        Plan::new(self.replace)
            .description(&self.machine)
            .reads(&self.key)
            .reads(&self.library)
            .writes("--output", self.output.as_deref(), IMAGE)
            .writes("--fmu", self.fmu.as_deref(), FMU)
            .check(as_json)?;
        let built = self.build()?;
        built.report(self, as_json)
    }

    /// A board reads words: of a channel without converter it would read anything.
    fn check_converters(&self, sensors: &Sensors) -> anyhow::Result<()> {
        let without = sensors.channels.iter().find(|c| c.adc.is_none());
        without.map_or(Ok(()), |channel| {
            anyhow::bail!(
                "{}: channel `{}` has no `adc`; allowed: `adc = {{ lsb = ... }}`, by which a board reads its words",
                self.machine.display(),
                channel.name
            )
        })
    }

    /// Notes on standard error that the key page beside the key is that of another machine.
    fn note_page_of_another_machine(&self, machine: &str) {
        let Some(key) = &self.key else { return };
        if let Some(page) = SigningKey::page_of_another_machine(key, machine) {
            note(format_args!(
                "{}: key page of another machine; a board with it refuses this image; make the page of this \
                 machine's board: loadtwin key --public {}.pub --machine {machine:?} -o FILE.page\n",
                page.display(),
                key.display()
            ));
        }
    }

    /// Builds and writes.
    fn build(&self) -> anyhow::Result<Built> {
        let started = std::time::Instant::now();
        let machine = load(&self.machine)?;
        let sensors = Sensors::choose(&machine, self.sensors.as_deref())?.filtered_by(self.filter);
        if self.output.is_some() {
            self.check_converters(&sensors)?;
        }
        let payload = image_build::image(&machine, &sensors)?;
        let image = Image::from_bytes(&payload)?;
        if let Some(board) = self.board {
            let name = board.to_possible_value();
            let name = name.as_ref().map_or("", |value| value.get_name());
            let place = || format!("{}: board {name}", self.machine.display());
            board.hardware().serves(&image).with_context(place)?;
            board.check_words(&machine, &sensors).with_context(place)?;
        }
        let steady = match &image.model {
            Model::Gearbox(model) => model
                .steady
                .map(|gains| gains.turn().map(|turn| f64::from(turn) * machine.rate_hz)),
            Model::Rotor(_) | Model::Bearing(_) | Model::Drive(_) => None,
        };
        Estimator::try_build(image)?;
        let issue = self.issue.map_or_else(seconds_since_1970, Ok)?;
        let key = self.key.as_deref().map(SigningKey::read).transpose()?;
        let image = seal(&payload, machine.id(), issue, self.replaces, key.as_ref())?;
        let mut files = Vec::new();
        if let Some(path) = &self.output {
            files.push(complete(path, &image)?);
        }
        let mut fmu = None;
        if let Some(path) = &self.fmu {
            let interface = Interface::new(&machine, &sensors.channels, &sensors.encoders);
            let library = Library::find(self.library.as_deref())?;
            let packed = pack(&interface, &image, &library, self.fmi.version())?;
            files.push(complete(path, &packed)?);
            fmu = Some(packed.len());
        }
        publish(files)?;
        self.note_page_of_another_machine(machine.id());
        Ok(Built {
            seconds: started.elapsed().as_secs_f64(),
            is_signed: key.is_some(),
            machine,
            sensors,
            issue,
            image,
            fmu,
            steady,
        })
    }
}

/// A whole file, still without its name.
fn complete(path: &Path, bytes: &[u8]) -> anyhow::Result<Complete> {
    let written = AtomicFile::create(path).and_then(|mut file| {
        file.write_all(bytes)?;
        file.complete()
    });
    written.with_context(|| path.display().to_string())
}

fn seconds_since_1970() -> anyhow::Result<u32> {
    let since = std::time::UNIX_EPOCH
        .elapsed()
        .context("the clock is before 1970; give --issue")?;
    u32::try_from(since.as_secs()).context("the clock is past 2106; give --issue")
}
