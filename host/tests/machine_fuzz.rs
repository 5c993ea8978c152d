//! Fuzz test of machine descriptions: damaged text gives an error or a machine, never a panic.

use std::io::Write;
use std::path::Path;

use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::{Machine, named_files};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use toml::Value;

const MACHINE: &str = include_str!("data/two_inertias.toml");
const MAP: &str = include_str!("data/two_inertias_map.csv");

/// Words that a person, or a program, may put in the wrong place.
const WORDS: [&str; 16] = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "-1e-308",
    "\"\"",
    "[]",
    "{}",
    "true",
    "[[channel]]",
    "[",
    "= =",
    "\u{0}",
    "9223372036854775807",
    "\"rotor\"",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]
    #[test]
    fn a_damaged_description_is_refused_or_built(
        cuts in proptest::collection::vec((0..MACHINE.len(), 0usize..12, 0..WORDS.len()), 1..5),
        numbers_only in any::<bool>(),
    ) {
        let mut text = MACHINE.as_bytes().to_vec();
        for (at, length, word) in cuts {
            // Half of the cases replace a value, so that the damage gets past the parser.
            let (from, to) = if numbers_only {
                let Some(equals) = text.iter().skip(at).position(|b| *b == b'=') else { continue };
                let from = at.min(text.len()) + equals + 1;
                (from, text[from..].iter().position(|b| *b == b'\n').map_or(text.len(), |n| from + n))
            } else {
                let from = at.min(text.len());
                (from, (from + length).min(text.len()))
            };
            text.splice(from..to, WORDS[word].bytes());
        }
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("two_inertias_map.csv"), MAP).unwrap();
        let path = folder.path().join("machine.toml");
        std::fs::File::create(&path).unwrap().write_all(&text).unwrap();
        if let Ok(machine) = Machine::load(&path) {
            built(&machine);
        }
    }
}

/// Descriptions of every kind of machine; the files that they name are copied beside them.
const EXAMPLES: [&str; 10] = [
    "bearing/calibrated.toml",
    "bearing/machine.toml",
    "direct-drive-motor/hold.toml",
    "gearbox/calibrated.toml",
    "gearbox/machine.toml",
    "lead-screw-drive/machine.toml",
    "positioning-axis/machine.toml",
    "rotor/machine.toml",
    "tool-drive/balance.toml",
    "tool-drive/machine.toml",
];

/// One change of a value somewhere in a description.
#[derive(Clone, Debug)]
enum Change {
    Replace(usize),
    Remove,
    Rename,
    /// So many times in a list.
    Repeat(usize),
    /// By the value of another place.
    Copy(usize),
}

fn change() -> impl Strategy<Value = (usize, Change)> {
    let change = prop_oneof![
        4 => (0..WORDS.len()).prop_map(Change::Replace),
        2 => Just(Change::Remove),
        1 => Just(Change::Rename),
        1 => (2usize..80).prop_map(Change::Repeat),
        2 => any::<usize>().prop_map(Change::Copy),
    ];
    (any::<usize>(), change)
}

/// Every value in a description, tables and lists as well: how it is reached from the root.
fn places(value: &Value) -> Vec<Vec<Step>> {
    let mut found = Vec::new();
    let mut open = vec![(Vec::new(), value)];
    while let Some((path, value)) = open.pop() {
        let mut below = |step: Step, value| {
            let mut path: Vec<Step> = path.clone();
            path.push(step);
            open.push((path, value));
        };
        match value {
            Value::Table(table) => {
                table
                    .iter()
                    .for_each(|(key, value)| below(Step::Key(key.clone()), value));
            }
            Value::Array(values) => {
                values
                    .iter()
                    .enumerate()
                    .for_each(|(i, value)| below(Step::Index(i), value));
            }
            _ => {}
        }
        found.push(path);
    }
    found
}

#[derive(Clone, Debug)]
enum Step {
    Key(String),
    Index(usize),
}

fn at<'a>(root: &'a mut Value, path: &[Step]) -> Option<&'a mut Value> {
    path.iter().try_fold(root, |value, step| match step {
        Step::Key(key) => value.get_mut(key),
        Step::Index(i) => value.get_mut(*i),
    })
}

fn apply(root: &mut Value, place: usize, change: &Change) {
    let places = places(root);
    let path = &places[place % places.len()];
    let Some((last, parent)) = path.split_last() else {
        return;
    };
    let copied = match change {
        Change::Copy(other) => at(root, &places[other % places.len()]).cloned(),
        Change::Replace(word) => {
            let read: Result<toml::Table, _> = toml::from_str(&format!("a = {}", WORDS[*word]));
            read.ok().and_then(|mut table| table.remove("a"))
        }
        _ => None,
    };
    if let Some(value) = copied {
        *at(root, path).unwrap() = value;
        return;
    }
    match (at(root, parent), last, change) {
        (Some(Value::Table(table)), Step::Key(key), Change::Remove) => {
            table.remove(key);
        }
        (Some(Value::Table(table)), Step::Key(key), Change::Rename) => {
            if let Some(value) = table.remove(key) {
                table.insert(format!("{key}s"), value);
            }
        }
        (Some(Value::Array(values)), Step::Index(i), Change::Remove) => {
            values.remove(*i);
        }
        (Some(Value::Array(values)), Step::Index(i), Change::Repeat(times)) => {
            let repeated = values[*i].clone();
            values.extend(std::iter::repeat_n(repeated, *times));
        }
        _ => {}
    }
}

/// The files that the example names, by their name there, with bytes.
fn copied(example: &Path, folder: &Path, damage: Option<(usize, usize)>) {
    for (i, named) in named_files(example).iter().enumerate() {
        let mut bytes = std::fs::read(named).unwrap();
        if let Some((at, word)) = damage.filter(|_| i == 0 && !bytes.is_empty()) {
            let at = at % bytes.len();
            let to = (at + 1 + at % 9).min(bytes.len());
            bytes.splice(at..to, WORDS[word].bytes());
        }
        std::fs::write(folder.join(named.file_name().unwrap()), bytes).unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, rng_seed: RngSeed::Fixed(2), ..ProptestConfig::default() })]
    #[test]
    fn a_changed_description_of_any_kind_is_refused_or_built(
        example in 0..EXAMPLES.len(),
        changes in proptest::collection::vec(change(), 0..4),
        damage in proptest::option::of((any::<usize>(), 0..WORDS.len())),
    ) {
        let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples");
        let example = examples.join(EXAMPLES[example]);
        let mut root: Value = toml::from_str(&std::fs::read_to_string(&example).unwrap()).unwrap();
        for (place, change) in &changes {
            apply(&mut root, *place, change);
        }
        let folder = tempfile::tempdir().unwrap();
        copied(&example, folder.path(), damage);
        let path = folder.path().join("machine.toml");
        std::fs::write(&path, toml::to_string(&root).unwrap()).unwrap();
        match Machine::load(&path) {
            Ok(machine) => built(&machine),
            // The place is a line of this file, or of one that it names.
            Err(error) => assert!(error.to_string().starts_with(&folder.path().display().to_string())),
        }
    }
}

/// Builds what can be built; what was built must be a whole image.
fn built(machine: &Machine) {
    if let Ok(sensors) = Sensors::choose(machine, None)
        && let Ok(payload) = image_build::image(machine, &sensors)
    {
        loadtwin_common::image::Image::from_bytes(&payload).unwrap();
    }
}
