//! The page of `--json` has every command, and every key that the fast ones print on the shipped
//! examples.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use crate::markdown_page::Page;
use crate::{printed, root};

/// Part of the page, and the command that prints its keys; later ones read files of earlier ones.
///
/// Not run, for they take many seconds, a board or the results of a finite-element package:
/// `calibrate` of a bearing, `diagnose` of rotors and bearings, `tables`, `tune` of a rotor,
/// `reduce`, `upload`, `build --fmu`, and `loadtwin` alone.
const RUNS: [(&str, &str); 33] = [
    ("init", "init examples/gearbox/start-stop.parquet"),
    (
        "simulate",
        "simulate bench.toml --scenario reversals --duration-s 20 --effect coulomb-friction -o fit.parquet",
    ),
    ("replay", "replay bench.toml fit.parquet"),
    (
        "replay --all-sensors",
        "replay examples/gearbox/calibrated.toml examples/gearbox/start-stop.parquet --all-sensors",
    ),
    (
        "simulate",
        "simulate examples/rotor/machine.toml --duration-s 0.5 -o rotor.parquet",
    ),
    ("replay", "replay examples/rotor/machine.toml rotor.parquet"),
    (
        "simulate",
        "simulate bench.toml --duration-s 2 -o archive/recordings/machine=bench/day=2026-11-01/a.parquet",
    ),
    ("replay --archive", "replay --archive archive"),
    (
        "calibrate",
        "calibrate bench.toml fit.parquet --error-bands -o calibrated.toml",
    ),
    (
        "calibrate --static",
        "calibrate bench.toml examples/bench/static-loads.csv --static motor_flange -o static.toml",
    ),
    ("identify", "identify bench.toml fit.parquet"),
    ("diagnose", "diagnose bench.toml fit.parquet"),
    (
        "simulate",
        "simulate examples/feed-drive/plant.toml --scenario reversals --duration-s 10 --individual 1 \
         --effect coulomb-friction=3 -o drive.csv",
    ),
    (
        "diagnose of a drive",
        "diagnose examples/feed-drive/drive.toml drive.csv",
    ),
    (
        "replay",
        "replay bench.toml fit.parquet --estimates estimates.parquet",
    ),
    ("life", "life estimates.parquet --sn 1e4:400,2e6:100"),
    ("life", "life fit.parquet --load motor_flange"),
    ("tune", "tune bench.toml fit.parquet"),
    (
        "zero",
        "zero bench.toml left_upper unloaded.csv --date 2026-11-26 --shunt shunted.csv --shunt-ohm 87150 \
         -o zeroed.toml",
    ),
    ("build", "build bench.toml --filter steady -o bench.image"),
    ("build", "build examples/rotor/machine.toml -o rotor.image"),
    ("key", "key --machine bench -o key"),
    ("key", "key --machine press --public key.pub -o press.page"),
    (
        "simulate",
        "simulate bench.toml --scenario constant --duration-s 2 -o bench.parquet",
    ),
    ("send", "send bench.toml bench.parquet --log raw.log"),
    ("node", "node bench.toml raw.log -o bus.log"),
    ("twin, prove", "twin bench.toml bus.log"),
    ("twin, prove", "prove bench.toml bus.log"),
    ("monitor", "monitor bus.log bench.toml"),
    (
        "record",
        "record bench.toml bus.log -o recorded --name bench-1",
    ),
    ("explain", "explain stuck"),
    ("explain", "explain"),
    ("replay", "replay bench.toml bench.parquet --filter steady"),
];

/// A key after those above it; `[]` is an element of a list.
type KeyPath = Vec<String>;

/// Keys that a row of the page describes.
struct Row {
    keys: Vec<KeyPath>,
    /// Heading of the part whose keys stand below each of them.
    part: Option<String>,
}

impl Row {
    /// Of `` | `a[].b`, `.c` | unit | meaning [part](#part) | ``, where `.c` is `a[].c`.
    fn new(line: &str) -> Self {
        let cell = line.split(" | ").next().unwrap_or_default();
        let mut keys: Vec<KeyPath> = Vec::new();
        for name in cell.split('`').skip(1).step_by(2) {
            let first = keys.first().filter(|_| name.starts_with('.'));
            let above = first.map_or(&[][..], |first| &first[..first.len() - 1]);
            let own = name.trim_start_matches('.').replace("[]", ".[]");
            let own = own.split('.').map(str::to_owned);
            let key = above.iter().cloned().chain(own).collect();
            keys.push(key);
        }
        let link = line
            .split_once("](#")
            .and_then(|(_, to)| to.split_once(')'));
        Self {
            keys,
            part: link.map(|(part, _)| part.to_owned()),
        }
    }
}

/// Rows of the parts of the page, by their headings.
fn rows(page: &Page) -> BTreeMap<String, Vec<Row>> {
    let mut parts: BTreeMap<String, Vec<Row>> = BTreeMap::new();
    let mut part = None;
    for (_, line) in page.prose() {
        if let Some(heading) = line.strip_prefix("## ") {
            part = Some(heading.to_owned());
        } else if let Some(part) = &part
            && line.starts_with("| `")
        {
            parts.entry(part.clone()).or_default().push(Row::new(line));
        }
    }
    parts
}

/// Keys of a part, with those of the parts that it links.
fn documented(part: &str, rows: &BTreeMap<String, Vec<Row>>) -> Vec<KeyPath> {
    let of_part = rows.get(part);
    let of_part = of_part.unwrap_or_else(|| panic!("the page has no keys of {part}"));
    let mut all = Vec::new();
    for row in of_part {
        all.extend(row.keys.iter().cloned());
        let below = row.part.as_ref().map(|part| documented(part, rows));
        for below in below.iter().flatten() {
            all.extend(row.keys.iter().map(|key| [&key[..], &below[..]].concat()));
        }
    }
    all
}

/// Keys with a value, and whether that is empty: `null`, `[]` or `{}`.
fn add_keys(value: &Value, path: &[String], keys: &mut BTreeSet<(KeyPath, bool)>) {
    let below = |key: &str| [path, &[key.to_owned()]].concat();
    match value {
        Value::Object(entries) if !entries.is_empty() => {
            for (key, value) in entries {
                add_keys(value, &below(key), keys);
            }
        }
        Value::Array(items) if items.iter().any(Value::is_object) => {
            for item in items {
                add_keys(item, &below("[]"), keys);
            }
        }
        value => {
            let is_empty = value.is_null() || *value == json!([]) || *value == json!({});
            keys.insert((path.to_vec(), is_empty));
        }
    }
}

/// Printed keys that are not among `documented`, where `<load>` stands for any name. What is empty
/// may be described by the keys that it has elsewhere.
fn missing(value: &Value, documented: &[KeyPath]) -> Vec<String> {
    let mut keys = BTreeSet::new();
    add_keys(value, &[], &mut keys);
    let fits = |key: &KeyPath, path: &KeyPath, is_empty: bool| {
        let mut names = key.iter().zip(path);
        (key.len() == path.len() || is_empty && key.len() > path.len())
            && names.all(|(key, name)| key == name || key.starts_with('<') && name != "[]")
    };
    (keys.iter())
        .filter(|(path, is_empty)| !documented.iter().any(|key| fits(key, path, *is_empty)))
        .map(|(path, _)| path.join(".").replace(".[]", "[]"))
        .collect()
}

/// Files that the commands read, beside those of `examples`.
fn write_inputs(folder: &Path) {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let bench = std::fs::read_to_string(root().join("examples/bench/machine.toml")).unwrap();
    write(
        "bench.toml",
        &bench.replace("rate_hz = 2000", "rate_hz = 500"),
    );
    let bridge = |zero: f64| format!("t [s],left_upper [mV/V]\n0,{zero}\n0.002,{zero}\n");
    write("unloaded.csv", &bridge(0.0182));
    write("shunted.csv", &bridge(-0.9781));
    let day = "archive/recordings/machine=bench/day=2026-11-01";
    std::fs::create_dir_all(folder.join(day)).unwrap();
    write(
        "archive/descriptions.csv",
        "machine,from,description\nbench,2026-01-01,../bench.toml\n",
    );
}

/// The object that a command prints.
fn object(line: &str, folder: &Path) -> Value {
    let arguments = line.split(' ').map(|word| {
        let is_example = word.starts_with("examples/");
        if is_example {
            root().join(word)
        } else {
            word.into()
        }
    });
    let output = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(arguments)
        .arg("--json")
        .current_dir(folder)
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{line}: {error}");
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{line}: {error}"))
}

#[test]
fn the_json_page_has_every_key() {
    let rows = rows(&Page::read(&root().join("docs/reference/json.md")));
    let folder = tempfile::tempdir().unwrap();
    write_inputs(folder.path());
    let mut absent = BTreeSet::new();
    for (part, line) in RUNS {
        let found = missing(&object(line, folder.path()), &documented(part, &rows));
        absent.extend(found.iter().map(|key| format!("{part}: {key}")));
    }
    let absent: Vec<String> = absent.into_iter().collect();
    assert!(
        absent.is_empty(),
        "docs/reference/json.md lacks\n{}",
        absent.join("\n")
    );
}

/// A command has a part of its own, or is named before the first part.
#[test]
fn the_json_page_has_every_command() {
    let text = Page::read(&root().join("docs/reference/json.md")).text;
    let (head, _) = text.split_once("\n## ").unwrap();
    let headings: Vec<&str> = (text.lines())
        .filter_map(|line| line.strip_prefix("## "))
        .flat_map(|heading| heading.split([',', ' ']))
        .collect();
    let help = printed(&["--help"]);
    let (_, commands) = help.split_once("Commands:\n").unwrap();
    let names: Vec<&str> = (commands.lines())
        .map_while(|line| line.split_whitespace().next())
        .filter(|name| *name != "help")
        .collect();
    assert!(names.len() > 20, "{names:?}");
    for name in names {
        let is_there = headings.contains(&name) || head.contains(&format!("`{name}`"));
        assert!(is_there, "no {name}");
    }
}

#[test]
fn a_key_that_the_page_does_not_have_is_found() {
    let row = |line: &str| Row::new(line);
    let rows = BTreeMap::from([
        (
            "a".to_owned(),
            vec![
                row("| `name` | | |"),
                row("| `loads.<load>.rms`, `.mean` | N | |"),
                row("| `sets[]` | | of each set: [b](#b) |"),
            ],
        ),
        ("b".to_owned(), vec![row("| `cause.kind` | | |")]),
    ]);
    let found = |value: &Value| missing(value, &documented("a", &rows));
    let full = json!({
        "name": "x", "loads": { "left": { "rms": 1, "mean": null } }, "sets": [{ "cause": { "kind": "y" } }],
    });
    assert!(found(&full).is_empty());
    assert!(found(&json!({ "loads": {}, "sets": [{ "cause": null }] })).is_empty());
    assert_eq!(
        found(&json!({ "loads": { "left": { "rmse": 1 } } })),
        ["loads.left.rmse"]
    );
    assert_eq!(
        found(&json!({ "sets": [{ "cause": { "what": 1 } }], "more": null })),
        ["more", "sets[].cause.what"]
    );
    assert_eq!(found(&json!({ "loads": { "left": 1 } })), ["loads.left"]);
}
