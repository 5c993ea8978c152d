//! Model images of every machine in `examples` and `tests/machines`, with every sensor set and filter that can be
//! built, and for each its raw samples with every fault in turn.

use std::path::PathBuf;

use loadtwin::build::{self, BuildError, Filter, Sensors};
use loadtwin::machine::{Kind, Machine};
use loadtwin_common::io::raw::{MAX_CHANNELS, RawSample};

use crate::firmware::root;
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
                match build::image(&machine, &sensors) {
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
    /// `seconds` of what the machine's board would see, with everything that a
    /// converter, an encoder, an index and a bus do wrong now and then, on every
    /// channel in turn.
    ///
    /// # Panics
    /// Where the machine cannot be simulated.
    pub fn samples(&self, seconds: f64) -> Vec<RawSample> {
        let samples = simulated::samples(&self.machine, &self.sensors, self.scenario(), seconds);
        let mut spoilt: Vec<RawSample> = Vec::with_capacity(samples.len());
        for sample in samples {
            let raw = self.spoil(sample, spoilt.last());
            match () {
                // Dropped.
                () if due(&sample, 977) => {}
                // Sent twice.
                () if due(&sample, 1301) => spoilt.extend([raw, raw]),
                // Sent before the one that it follows.
                () if due(&sample, 1303) => spoilt.insert(spoilt.len().saturating_sub(1), raw),
                () => spoilt.push(raw),
            }
        }
        spoilt
    }

    fn scenario(&self) -> &'static str {
        match self.machine.kind() {
            Some(Kind::Bearing(_)) => "lc1",
            _ => "constant",
        }
    }

    fn spoil(&self, sample: RawSample, before: Option<&RawSample>) -> RawSample {
        let (channels, encoders) = (self.sensors.channels.len(), self.sensors.encoders.len());
        let turn = |every: u32, of: usize| (sample.tick / every) as usize % of;
        let mut raw = sample;
        if channels > 0 {
            if due(&sample, 311) {
                // Not delivered, or not a number.
                raw.valid &= !(1 << turn(311, channels));
            }
            if due(&sample, 401) {
                raw.words[turn(401, channels)] = [i32::MAX, i32::MIN][turn(401, 2)];
            }
            if sample.tick % 1499 > 1450 {
                let stuck = turn(1499, channels);
                raw.words[stuck] = before.map_or(0, |before| before.words[stuck]);
            }
        }
        for (k, encoder) in self.sensors.encoders.iter().enumerate() {
            // Every counter wraps soon after the start.
            let mask = u32::MAX >> (32 - encoder.bits);
            let mut count = sample.encoders[k].wrapping_sub(100);
            if due(&sample, 701) && k == turn(701, encoders) {
                count = count.wrapping_add(turn(701, 64) as u32);
            }
            raw.encoders[k] = count & mask;
            if due(&sample, 1201) && k == turn(1201, encoders) {
                raw.valid &= !(1 << (MAX_CHANNELS + k));
            }
            if k == 0 {
                raw.index = raw.index.map(|count| count.wrapping_sub(100) & mask);
                if due(&sample, 1709) {
                    // A pulse where none belongs.
                    raw.index = Some(raw.encoders[0]);
                } else if sample.tick % 2000 > 1500 {
                    // Pulses that do not come.
                    raw.index = None;
                }
            }
        }
        raw
    }
}

fn due(sample: &RawSample, every: u32) -> bool {
    sample.tick % every == every - 1
}
