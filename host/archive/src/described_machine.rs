//! Reads the machine description that a row of the table of descriptions names, checks its SHA-256
//! and the name of the counted load, chooses the sensor set and builds the model image
//! (`Described`).

use std::path::Path;

use loadtwin_design::image_build::{self, Sensors};
use loadtwin_files::hex::hex;
use loadtwin_machine::{Machine, named_files};
use sha2::{Digest, Sha256};

use crate::Options;
use crate::description_table::{Entry, TABLE};
use crate::error::message;

/// A description with what is built of it.
pub(crate) struct Described {
    pub(crate) machine: Machine,
    pub(crate) sensors: Sensors,
    pub(crate) image: Vec<u8>,
    /// Hash of the description, followed by the files that it names in the order of their paths.
    pub(crate) sha256: String,
}

impl Described {
    /// Reads the description of a row of the table.
    ///
    /// # Errors
    /// In words, when it is refused, or has another hash than stated.
    pub(crate) fn read(entry: &Entry, options: &Options) -> Result<Self, String> {
        let path = Path::new(&entry.path);
        if !path.is_file() {
            return Err(format!("{}: no such description ({TABLE})", entry.path));
        }
        let machine = Machine::load(path).map_err(|error| message(&error))?;
        let sha256 = hash(path).map_err(|error| format!("{}: {error}", entry.path))?;
        if let Some(stated) = entry.sha256.as_ref().filter(|stated| **stated != sha256) {
            let path = &entry.path;
            return Err(format!(
                "{path}: its SHA-256 is {sha256}, {TABLE} has {stated}"
            ));
        }
        let loads = machine.loads();
        if let Some(load) = &entry.load
            && !loads.iter().any(|known| known.name == load)
        {
            let allowed: Vec<&str> = loads.iter().map(|load| load.name).collect();
            let allowed = allowed.join(", ");
            return Err(format!("{TABLE}: found load '{load}', allowed: {allowed}"));
        }
        let sensors = Sensors::choose(&machine, options.sensors.as_deref());
        let sensors = sensors.map_err(|error| message(&error))?;
        let sensors = sensors.filtered_by(options.filter());
        let image = image_build::image(&machine, &sensors).map_err(|error| message(&error))?;
        Ok(Self {
            machine,
            sensors,
            image,
            sha256,
        })
    }
}

fn hash(path: &Path) -> std::io::Result<String> {
    let mut digest = Sha256::new();
    digest.update(std::fs::read(path)?);
    let mut named = named_files(path);
    named.sort();
    for path in named {
        digest.update(std::fs::read(path)?);
    }
    Ok(hex(digest.finalize()))
}
