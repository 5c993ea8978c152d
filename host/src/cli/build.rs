//! The command `loadtwin build`: makes the model image of a machine description, signs it where a
//! key is given, and prints its size and the error of a rotor's model reduction.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::{Image, Model};
use loadtwin_common::io::signed_image;
use serde_json::json;

use super::file_plan::{Plan, Replace};
use super::layout_option::load;
use super::printing::{say, shown};
use crate::atomic_file::AtomicFile;
use crate::build::{self, Filter, Sensors};
use crate::files::content::Content;
use crate::key::SigningKey;
use crate::machine::{Kind, Rotor};
use crate::rotor::RotorFilterDesign;
use crate::seal::seal;

/// Part of a start's motion that a reduction may lose without a word.
const MUCH_LOST: f64 = 0.1;

/// No image is larger [bytes]: that of a board's flash bank is 256 kB.
const LARGEST_IMAGE: u64 = 1 << 20;

/// What is written as a model image.
const IMAGE: Content = Content {
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
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    replace: Replace,
}

impl Build {
    fn write(&self, image: &[u8]) -> anyhow::Result<()> {
        let written = AtomicFile::create(&self.output).and_then(|mut file| {
            file.write_all(image)?;
            file.finish()
        });
        written.with_context(|| self.output.display().to_string())
    }

    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let started = std::time::Instant::now();
        Plan::new(self.replace)
            .description(&self.machine)
            .reads(&self.key)
            .writes("--output", Some(&self.output), IMAGE)
            .check(as_json)?;
        let machine = load(&self.machine)?;
        let sensors = Sensors::choose(&machine, self.sensors.as_deref())?.filtered_by(self.filter);
        let payload = build::image(&machine, &sensors)?;
        let image = Image::from_bytes(&payload)?;
        let steady_speed = match &image.model {
            Model::Gearbox(model) => model
                .steady
                .map(|gains| gains.turn().map(|turn| f64::from(turn) * machine.rate_hz)),
            Model::Rotor(_) | Model::Bearing(_) | Model::Drive(_) => None,
        };
        Estimator::try_build(image)?;
        let issue = self.issue.map_or_else(seconds_since_1970, Ok)?;
        let key = self.key.as_deref().map(SigningKey::read).transpose()?;
        let image = seal(&payload, machine.id(), issue, self.replaces, key.as_ref())?;
        self.write(&image)?;
        let plan = match machine.kind() {
            Some(Kind::Rotor(rotor)) => {
                Some(RotorFilterDesign::new(&machine, rotor, &sensors.channels)?)
            }
            _ => None,
        };
        let reduction = plan.as_ref().map(RotorFilterDesign::reduction_error);
        let instability = plan.as_ref().and_then(RotorFilterDesign::instability);
        let stability_note = instability.map(|found| found.note());
        let reduction_note = (reduction.as_ref())
            .filter(|r| r.error_m > MUCH_LOST * r.peak_m)
            .map(|r| {
                format!(
                    "the reduction loses {:.0} % of a start's motion at {:.1} rad/s, more than {:.0} %: \
                     estimates err by that until it has died out",
                    100.0 * r.error_m / r.peak_m,
                    r.speed_rad_s,
                    100.0 * MUCH_LOST
                )
            });
        let lag = machine.rotor.as_ref().map_or(0, Rotor::lag);
        let seconds = started.elapsed().as_secs_f64();
        if as_json {
            let names = |names: Vec<&String>| json!(names);
            let report = json!({
                "machine": machine.name,
                "machine_id": machine.id(),
                "image": shown(&self.output),
                "bytes": image.len(),
                "issue": issue,
                "signed": key.is_some(),
                "filter": self.filter.name(),
                "steady_from_to_rad_s": steady_speed,
                "lag_samples": lag,
                "channels": names(sensors.channels.iter().map(|c| &c.name).collect()),
                "encoders": names(sensors.encoders.iter().map(|e| &e.name).collect()),
                "reduction": reduction.map(|r| json!({
                    "error_um": 1e6 * r.error_m,
                    "peak_um": 1e6 * r.peak_m,
                    "speed_rad_s": r.speed_rad_s,
                })),
                "reduction_note": reduction_note,
                "instability": instability,
                "stability_note": stability_note,
                "seconds": seconds,
            });
            say!("{report}");
        } else {
            let signed = if key.is_some() {
                format!("signed for the board of machine {:?}", machine.id())
            } else {
                "not signed: for the host only".into()
            };
            say!(
                "{}: {} bytes, issue {issue}, {signed}",
                self.output.display(),
                image.len()
            );
            if lag > 0 {
                say!(
                    "estimates lag {lag} samples, {} ms",
                    1e3 * f64::from(lag) / machine.rate_hz
                );
            }
            if let Some(r) = reduction {
                say!(
                    "reduction: error up to {:.3} µm of {:.1} µm, at {:.1} rad/s",
                    1e6 * r.error_m,
                    1e6 * r.peak_m,
                    r.speed_rad_s
                );
            }
            for note in reduction_note.into_iter().chain(stability_note) {
                say!("{note}");
            }
        }
        Ok(())
    }
}

fn seconds_since_1970() -> anyhow::Result<u32> {
    let since = std::time::UNIX_EPOCH
        .elapsed()
        .context("the clock is before 1970; give --issue")?;
    u32::try_from(since.as_secs()).context("the clock is past 2106; give --issue")
}
