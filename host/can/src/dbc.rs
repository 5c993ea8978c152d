//! The description of the frames: `docs/loadtwin.dbc`, for one machine.

use std::fmt::Write;

use loadtwin_common::frame::{DEFAULT_BASE, LoadFrame};

/// The description of all machines, loads in % of full scale, base 0x500.
pub const DBC: &str = include_str!("../../../docs/loadtwin.dbc");

/// A load of the machine.
#[derive(Clone, Debug)]
pub struct LoadScale<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its unit.
    pub unit: &'a str,
    /// The load at the end of the scale.
    pub full_scale: f32,
}

/// The description of one machine: its identifiers, its loads by name and in
/// their unit.
pub fn of_machine(base: u16, loads: &[LoadScale<'_>]) -> String {
    let names = symbols(loads);
    let mut out = String::with_capacity(DBC.len() + 4096);
    let mut skipping = false;
    for line in DBC.lines() {
        // A message of a load that this machine has not, with its signals.
        if line.starts_with("BO_ ") || line.is_empty() {
            skipping = load_of(line).is_some_and(|i| i >= loads.len());
        }
        if skipping || load_of(line).is_some_and(|i| i >= loads.len()) {
            continue;
        }
        let line = shift(line, base);
        match load_of(&line).and_then(|i| Some((i, loads.get(i)?, names.get(i)?))) {
            Some((i, load, name)) => {
                let line = scale(&line, i, load);
                out.push_str(&line.replace(&format!("Load{}", i + 1), name));
            }
            None => out.push_str(&line),
        }
        out.push('\n');
    }
    out
}

/// Names that a DBC takes: letters, digits, underscores, at most 24, none twice.
fn symbols(loads: &[LoadScale<'_>]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for (i, load) in loads.iter().enumerate() {
        let mut name: String = load
            .name
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
            .take(24)
            .collect();
        if name.is_empty() || !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
            name.insert_str(0, "Load_");
        }
        let taken =
            |name: &str| names.iter().any(|n| n == name) || DBC.contains(&format!(" {name}:"));
        if taken(&name) {
            let _ = write!(name, "_{}", i + 1);
        }
        names.push(name);
    }
    names
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

/// The load, from 0, that a line is about.
fn load_of(line: &str) -> Option<usize> {
    let rest = match line.find("Load").filter(|at| line[..*at].ends_with(' ')) {
        Some(at) => &line[at + 4..],
        None => return None,
    };
    let digit = rest.chars().next()?.to_digit(10)?;
    (1..=6).contains(&digit).then(|| digit as usize - 1)
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
