//! Model images of every machine in `examples` and `tests/machines`, with every sensor set and
//! filter that can be built, and for each its simulated raw samples.

use std::path::PathBuf;

use loadtwin::image_build::{self, BuildError, Filter, Sensors};
use loadtwin::machine::{Kind, Machine};
use loadtwin_common::io::raw::RawSample;

use crate::firmware::root;
use crate::sample_faults::with_faults;
use crate::simulated;

/// Folders of descriptions, from the root of the project.
const FOLDERS: [&str; 6] = [
    "examples/bearing",
    "examples/gearbox",
    "examples/gearbox/housing",
    "examples/rotor",
    "examples/tool-drive",
    "tests/machines",
];

/// One machine with one set of sensors and one filter.
pub struct Variant {
    /// Description, set and filter, for messages.
    pub name: String,
    /// Its filter.
    pub filter: Filter,
    /// Its model image.
    pub image: Vec<u8>,
    machine: Machine,
    sensors: Sensors,
}

/// Every variant of every description.
///
/// # Panics
/// Where a description is refused or cannot be built.
pub fn variants() -> Vec<Variant> {
    let mut variants = Vec::new();
    for path in descriptions() {
        let machine = Machine::load(&path).expect("the description is valid");
        match machine.kind() {
            // Before it was calibrated, a bearing has no image.
            Some(Kind::Bearing(bearing)) if bearing.calibration.is_none() => continue,
            None => continue,
            _ => {}
        }
        let sets: Vec<Option<&str>> = if machine.sensor_sets.is_empty() {
            vec![None]
        } else {
            let sets = machine.sensor_sets.iter();
            sets.map(|set| Some(set.name.as_str())).collect()
        };
        for set in sets {
            for filter in [Filter::Aekf, Filter::Steady] {
                let mut sensors = Sensors::choose(&machine, set).expect("a set of the machine");
                sensors.filter = filter;
                let file = path.strip_prefix(root()).unwrap_or(&path).display();
                let name = format!("{file}, {}, {}", set.unwrap_or("all"), filter.name());
                match image_build::image(&machine, &sensors) {
                    Ok(image) => variants.push(Variant {
                        name,
                        filter,
                        image,
                        machine: machine.clone(),
                        sensors,
                    }),
                    Err(BuildError::NotSteady(_) | BuildError::OnlyDrivetrains) => {}
                    Err(error) => panic!("{name}: {error}"),
                }
            }
        }
    }
    variants
}

fn descriptions() -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = FOLDERS
        .iter()
        .flat_map(|folder| std::fs::read_dir(root().join(folder)).expect("a folder"))
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|end| end == "toml"))
        .filter(|path| !path.ends_with("calibration.toml"))
        .collect();
    paths.sort();
    paths
}

impl Variant {
    /// `seconds` of what the machine's board would see, with faults.
    ///
    /// # Panics
    /// Where the machine cannot be simulated.
    pub fn samples(&self, seconds: f64) -> Vec<RawSample> {
        let samples = simulated::samples(&self.machine, &self.sensors, self.scenario(), seconds);
        with_faults(samples, &self.sensors)
    }

    fn scenario(&self) -> &'static str {
        match self.machine.kind() {
            Some(Kind::Bearing(_)) => "lc1",
            _ => "constant",
        }
    }
}
