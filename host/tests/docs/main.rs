//! Test program of the documentation: commands are run and their output compared, links and
//! lists are checked; what `explain` finds in it; keys of `--json`.

mod commands;
mod explained;
mod fragment;
mod json_keys;
mod links;
mod markdown_page;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use markdown_page::Page;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .canonicalize()
        .unwrap()
}

/// Every Markdown file of the documentation, laboratory notes excepted.
fn documentation() -> Vec<Page> {
    let mut pages = Vec::new();
    let mut folders = vec![root().join("docs")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() && !path.ends_with("docs/lab") {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                pages.push(Page::read(&path));
            }
        }
    }
    pages.sort_by(|a, b| a.path.cmp(&b.path));
    pages
}

/// Of descriptions.
fn schema() -> serde_json::Value {
    let text = std::fs::read_to_string(root().join("docs/machine.schema.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Two pages at a time, each in a folder of its own.
#[test]
fn every_command_prints_what_the_page_shows() {
    let pages = documentation();
    let next = AtomicUsize::new(0);
    let failures = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(page) = pages.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Err(failure) = commands::run(page, &root()) {
                        failures.lock().unwrap().push(failure);
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().unwrap();
    assert!(failures.is_empty(), "\n{}", failures.join("\n\n"));
}

/// A block of code is run, is written to a file, is a part of a description with keys that exist, or states why it is
/// not run.
#[test]
fn every_block_of_code_is_run_or_states_why_not() {
    let schema = schema();
    let failures: Vec<String> = (documentation().iter())
        .flat_map(|page| page.unclear(&schema))
        .collect();
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

#[test]
fn every_link_leads_to_a_file_and_a_heading() {
    let root = root();
    let mut pages = documentation();
    for name in [
        "README.md",
        "CONTRIBUTING.md",
        "SECURITY.md",
        "CHANGELOG.md",
    ] {
        pages.push(Page::read(&root.join(name)));
    }
    let failures: Vec<String> = pages.iter().flat_map(links::broken).collect();
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

#[test]
fn the_index_and_the_navigation_list_every_page() {
    let [index, navigation] =
        ["README.md", "SUMMARY.md"].map(|name| Page::read(&root().join("docs").join(name)));
    for list in [&index, &navigation] {
        let listed = links::targets(list);
        for page in documentation() {
            let is_list = [&index.path, &navigation.path].contains(&&page.path);
            assert!(
                is_list || listed.contains(&page.path),
                "{} does not list {}",
                list.path.display(),
                page.path.display()
            );
        }
    }
}

/// What `loadtwin` prints.
fn printed(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(arguments)
        .output()
        .unwrap();
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn the_effects_page_has_every_effect_of_diagnose() {
    let page = Page::read(&root().join("docs/reference/effects.md")).text;
    let help = printed(&["diagnose", "--help"]);
    let (_, effects) = help.split_once("Effects:").unwrap();
    let names: Vec<&str> = (effects.lines())
        .filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next())
        .collect();
    assert!(names.len() > 30, "{names:?}");
    for name in names {
        assert!(page.contains(&format!("`{name}`")), "no {name}");
    }
}

#[test]
fn the_flags_page_has_every_fault_on_the_bus() {
    let page = Page::read(&root().join("docs/reference/flags.md")).text;
    let dbc = printed(&["dbc"]);
    let table = dbc
        .lines()
        .find(|line| line.starts_with("VAL_TABLE_ Fault"));
    let names: Vec<String> = (table.unwrap().split('"').skip(1).step_by(2))
        .map(|name| name.replace(' ', "_"))
        .filter(|name| name != "none")
        .collect();
    assert!(names.len() > 12, "{names:?}");
    for name in names {
        assert!(page.contains(&format!("`{name}`")), "no {name}");
    }
}
