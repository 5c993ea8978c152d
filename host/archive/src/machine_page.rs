//! Writer of the data of a machine's HTML page: verdict, NIS, worst sensor, load ranges and damage
//! of each day, and the faults of the machine.

use serde_json::{Value, json};

use crate::day::{Day, Days, SensorOfDay};
use crate::layout::Results;
use crate::overview::faults;
use crate::verdict::worst;
use crate::{ArchiveError, complete_file};

/// Folder of the pages in the results.
pub(crate) const FOLDER: &str = "page";

/// A number with as many decimals.
pub(crate) fn rounded(value: f64, decimals: usize) -> f64 {
    format!("{value:.decimals$}").parse().unwrap_or(value)
}

/// Writes the data of a machine's page, where it is absent or the machine has new days.
///
/// # Errors
/// [`ArchiveError::Io`] when it cannot be written.
pub(crate) fn write(
    results: &Results,
    machine: &str,
    days: &Days,
    is_new: bool,
) -> Result<(), ArchiveError> {
    let folder = results.folder.join(FOLDER).join("machines");
    let path = folder.join(format!("{machine}.js"));
    if !is_new && path.is_file() {
        return Ok(());
    }
    let text = format!("show({});\n", data(machine, days));
    complete_file::write(&path, text.as_bytes())
}

fn data(machine: &str, days: &Days) -> Value {
    let last = days.values().next_back();
    json!({
        "machine": machine,
        "name": last.map(|day| &day.name),
        "description": last.map(|day| &day.description),
        "sha256": last.map(|day| &day.description_sha256),
        "days": days.iter().map(|(name, day)| of_day(name, day)).collect::<Vec<_>>(),
        "faults": faults(days),
    })
}

fn of_day(name: &str, day: &Day) -> Value {
    let sums = &day.sums;
    let worst = worst(&sums.sensors);
    let used: u64 = sums.sensors.iter().map(|sensor| sensor.used).sum();
    let nis: f64 = sums.sensors.iter().map(|sensor| sensor.nis).sum();
    let percent = 100.0 * sums.valid as f64 / sums.samples as f64;
    let loads = sums.loads.iter();
    let loads = loads.map(|load| json!([load.name, load.unit, load.lowest, load.highest]));
    let damage = day.damage();
    json!({
        "day": name,
        "verdict": day.verdict.name(),
        "seconds": rounded(sums.seconds, 3),
        "valid": (sums.samples > 0).then(|| rounded(percent, 2)),
        "nis": (used > 0).then(|| rounded(nis / used as f64, 4)),
        "sensor": worst.map(|sensor| &sensor.name),
        "contradicting": worst.map(|sensor| rounded(100.0 * SensorOfDay::share(sensor), 2)),
        "loads": loads.collect::<Vec<_>>(),
        "load": damage.map(|(load, _)| load),
        "damage": damage.map(|(_, damage)| damage),
    })
}
