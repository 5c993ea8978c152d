//! `loadtwin build`.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use loadtwin_common::image::Image;
use loadtwin_common::line::Line;
use serde_json::json;

use crate::atomic_file::AtomicFile;
use crate::build::{self, Sensors};
use crate::machine::Machine;

/// Make the model image that firmware and host run.
#[derive(Debug, Args)]
pub struct Build {
    /// Machine description (TOML).
    machine: PathBuf,
    /// Set of sensors; the first of the description where absent.
    #[arg(long, value_name = "NAME")]
    sensors: Option<String>,
    /// The image.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

impl Build {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let started = std::time::Instant::now();
        let machine = Machine::load(&self.machine)?;
        let sensors = Sensors::choose(&machine, self.sensors.as_deref())?;
        let payload = build::image(&machine, &sensors)?;
        Line::try_build(Image::from_bytes(&payload)?)?;
        let mut file = AtomicFile::create(&self.output)?;
        file.write_all(&payload)?;
        file.finish()?;
        let seconds = started.elapsed().as_secs_f64();
        if as_json {
            let names = |names: Vec<&String>| json!(names);
            let report = json!({
                "machine": machine.name,
                "image": self.output,
                "bytes": payload.len(),
                "channels": names(sensors.channels.iter().map(|c| &c.name).collect()),
                "encoders": names(sensors.encoders.iter().map(|e| &e.name).collect()),
                "seconds": seconds,
            });
            println!("{report}");
        } else {
            println!("{}: {} bytes", self.output.display(), payload.len());
        }
        Ok(())
    }
}
