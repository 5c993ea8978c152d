//! Writes the DBC file (CAN database) of one machine for `loadtwin dbc`, from the template
//! `docs/loadtwin.dbc`: moves the identifiers to the machine's base, puts in names, scale and unit
//! of its loads and names of its sensors, and leaves out what it does not have.

use loadtwin_common::io::estimate::MAX_LOADS;
use loadtwin_common::io::frame::{DEFAULT_BASE, LoadFrame};

/// The description of all machines, loads in % of full scale, base 0x500.
pub const DBC: &str = include_str!("../loadtwin.dbc");

/// A load of the machine.
#[derive(Clone, Debug)]
pub struct LoadScale<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its unit.
    pub unit: &'a str,
    /// The load at the end of the scale, in `unit`.
    pub full_scale: f32,
}

/// The description of one machine: its identifiers, its loads by name and in their unit, its
/// `sensors` by name, all by number where none is given.
pub fn of_machine(base: u16, loads: &[LoadScale<'_>], sensors: &[&str]) -> String {
    let load_names = symbols(loads.iter().map(|load| load.name), "Load", 24);
    let sensor_names = symbols(sensors.iter().copied(), "Sensor", 19);
    let mut out = String::with_capacity(DBC.len() + 4096);
    let mut skipping = false;
    for line in DBC.lines() {
        let load = load_of(line);
        let sensor = number_in(line, "Sensor");
        let is_absent = load.is_some_and(|i| i >= loads.len())
            || sensor.is_some_and(|i| !sensors.is_empty() && i >= sensors.len());
        // A message of a load that this machine has not, with its signals.
        if line.starts_with("BO_ ") || line.is_empty() {
            skipping = is_absent;
        }
        if skipping || is_absent {
            continue;
        }
        let line = shift(line, base);
        let load = load.and_then(|i| Some((i, loads.get(i)?, load_names.get(i)?)));
        let sensor = sensor.and_then(|i| Some((i, sensor_names.get(i)?)));
        match (load, sensor) {
            (Some((i, load, name)), _) => {
                let line = scale(&line, i, load);
                out.push_str(&line.replace(&format!("Load{}", i + 1), name));
            }
            (None, Some((i, name))) => out.push_str(&line.replace(&format!("Sensor{i}"), name)),
            (None, None) => out.push_str(&line),
        }
        out.push('\n');
    }
    out
}

/// Names that a DBC takes: letters, digits, underscores, at most `longest` with a number where one
/// is there already, none twice.
fn symbols<'a>(names: impl Iterator<Item = &'a str>, kind: &str, longest: usize) -> Vec<String> {
    let mut symbols: Vec<String> = Vec::new();
    for (i, name) in names.enumerate() {
        let legal = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let mut symbol: String = name.chars().map(legal).take(longest).collect();
        if !symbol.starts_with(|c: char| c.is_ascii_alphabetic()) {
            symbol.insert_str(0, &format!("{kind}_"));
            symbol.truncate(longest);
        }
        let taken =
            |symbol: &String| symbols.contains(symbol) || DBC.contains(&format!(" {symbol}:"));
        let plain = symbol.clone();
        let mut number = i + 1;
        while taken(&symbol) {
            symbol = format!("{plain}_{number}");
            number += 1;
        }
        symbols.push(symbol);
    }
    symbols
}

/// The identifier that a line is about.
fn id_of(line: &str) -> Option<(usize, u16)> {
    let is_about = ["BO_ ", "CM_ ", "VAL_ ", "BA_ "]
        .iter()
        .any(|start| line.starts_with(start));
    let mut at = 0;
    for word in line.split(' ').take(4) {
        if is_about && let Ok(id) = word.parse() {
            return Some((at, id));
        }
        at += word.len() + 1;
    }
    None
}

/// The load, from 0, that a line is about: its signals, or the message by its identifier.
fn load_of(line: &str) -> Option<usize> {
    number_in(line, "Load").or_else(|| {
        let number = id_of(line)?.1.checked_sub(DEFAULT_BASE)?;
        let load = usize::from(number).checked_sub(1)?;
        (load < MAX_LOADS).then_some(load)
    })
}

/// The load or sensor, from 0, that a line names; of loads the description begins with 1.
fn number_in(line: &str, kind: &str) -> Option<usize> {
    let at = line.find(kind).filter(|at| line[..*at].ends_with(' '))?;
    let digit = line[at + kind.len()..].chars().next()?.to_digit(10)?;
    let first = u32::from(kind == "Load");
    Some(digit.checked_sub(first)? as usize)
}

/// The line with its identifier moved to the machine's block.
fn shift(line: &str, base: u16) -> String {
    match id_of(line) {
        Some((at, id)) if id >= DEFAULT_BASE => {
            let old = id.to_string();
            format!(
                "{}{}{}",
                &line[..at],
                id - DEFAULT_BASE + base,
                &line[at + old.len()..]
            )
        }
        _ => line.to_owned(),
    }
}

/// The line with the machine's factor, range and unit.
fn scale(line: &str, index: usize, load: &LoadScale<'_>) -> String {
    let full_scale = f64::from(load.full_scale);
    let (factor, low, high) = if line.contains(&format!("Load{}Value :", index + 1)) {
        let factor = full_scale / f64::from(LoadFrame::VALUE_STEPS);
        (factor, -full_scale, factor * f64::from(LoadFrame::FULL))
    } else if line.contains(&format!("Load{}Std :", index + 1)) {
        let factor = full_scale / f64::from(LoadFrame::STD_STEPS);
        (factor, 0.0, factor * f64::from(LoadFrame::NO_STD))
    } else {
        return line.replace("in percent of its full scale", &format!("in {}", load.unit));
    };
    match line.split_once('(') {
        Some((head, _)) => format!("{head}({factor},0) [{low}|{high}] \"{}\"  Host", load.unit),
        None => line.to_owned(),
    }
}
