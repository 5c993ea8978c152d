//! The command `loadtwin record`: builds the model of a description, opens the bus, and has the
//! crate `loadtwin_record` record the machine into an archive and publish its loads over MQTT.
//! Prints the summary.

use std::path::PathBuf;

use clap::Args;

use super::super::file_plan::{Plan, Replace};
use super::super::layout_option::load;
use super::super::printing::note;
use super::{noted, print};
use crate::can::frame_source::Source;
use crate::can::{Model, stop_on_signal};
use crate::image_build::{self, Sensors};
use crate::record::recorder::{self, RecordArgs};

/// Record a machine on a CAN bus into an archive, and publish its loads over MQTT.
#[derive(Debug, Args)]
pub struct Record {
    /// Machine description (TOML).
    machine: PathBuf,
    #[command(flatten)]
    args: RecordArgs,
    /// Set of sensors; the first of the description where absent.
    #[arg(long, value_name = "NAME")]
    sensors: Option<String>,
}

impl Record {
    pub(in super::super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let source = Source::of(&self.args.interface)?;
        Plan::new(Replace::default())
            .description(&self.machine)
            .reads(source.log())
            .check(as_json)?;
        let machine = load(&self.machine)?;
        let sensors = Sensors::choose(&machine, self.sensors.as_deref())?;
        let image = image_build::image(&machine, &sensors)?;
        let model = Model::from_bytes(&image)?;
        let stop = stop_on_signal()?;
        let bus = noted(source.open(Some(model.image.can_base), None)?);
        let warn = |text: &str| note(format_args!("{text}\n"));
        let described = (&machine, &sensors, &model);
        let recorded = recorder::run(described, bus, &self.args, &stop, &warn)?;
        print(&recorded, as_json)
    }
}
