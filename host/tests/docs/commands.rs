//! Runs the `console` blocks of a documentation page in order and compares their output.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::markdown_page::{Block, Page};

/// A command after `$ `, continued after a backslash, and the lines below it.
struct Step {
    command: String,
    output: String,
}

/// Runs the page in a folder with a copy of `examples`, as in the root of a clone.
pub fn run(page: &Page, root: &Path) -> Result<(), String> {
    let runs = |block: &Block| !block.attributes.contains_key("not-run");
    if !page
        .blocks
        .iter()
        .any(|block| block.language == "console" && runs(block))
    {
        return Ok(());
    }
    let folder = tempfile::tempdir().unwrap();
    copy(&root.join("examples"), &folder.path().join("examples"));
    copy(
        &root.join("docs/tutorial"),
        &folder.path().join("docs/tutorial"),
    );
    for block in page.blocks.iter().filter(|block| runs(block)) {
        let failed = |what: &str| format!("{}:{}: {what}", page.path.display(), block.line);
        if let Some(name) = block.attributes.get("file") {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, &block.text).unwrap();
        }
        if block.language == "console" {
            let exit = block.attributes.get("exit").map_or("0", String::as_str);
            for step in steps(&block.text) {
                run_step(&step, exit, folder.path()).map_err(|what| failed(&what))?;
            }
        }
    }
    Ok(())
}

fn run_step(step: &Step, exit: &str, folder: &Path) -> Result<(), String> {
    let output = Command::new("bash")
        .args([
            "-o",
            "pipefail",
            "-c",
            &format!("exec 2>&1; {}", step.command),
        ])
        .current_dir(folder)
        .env("PATH", path())
        .output()
        .unwrap();
    let printed = trimmed(&String::from_utf8_lossy(&output.stdout));
    let code = output.status.code().unwrap_or(-1).to_string();
    if code != exit {
        return Err(format!(
            "exit code {code}, not {exit}: {}\n{printed}",
            step.command
        ));
    }
    if !matches(&step.output, &printed) {
        return Err(format!(
            "{}\n--- the page shows\n{}--- it prints\n{printed}",
            step.command, step.output
        ));
    }
    Ok(())
}

/// The command under test first, then the Python tools of tests/requirements.txt.
fn path() -> std::ffi::OsString {
    let command = Path::new(env!("CARGO_BIN_EXE_loadtwin"));
    let python = std::env::var_os("LOADTWIN_PYTHON").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/venv/bin/python"),
        PathBuf::from,
    );
    let inherited = std::env::var_os("PATH").unwrap_or_default();
    let folders = [command, &python].map(|file| file.parent().unwrap().to_owned());
    std::env::join_paths(folders.into_iter().chain(std::env::split_paths(&inherited))).unwrap()
}

fn steps(text: &str) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    let mut continued = false;
    for line in text.lines() {
        let begun = line.strip_prefix("$ ");
        match (begun, steps.last_mut()) {
            (Some(command), _) => steps.push(Step {
                command: format!("{command}\n"),
                output: String::new(),
            }),
            (None, Some(step)) if continued => step.command += &format!("{line}\n"),
            (None, Some(step)) => step.output += &format!("{line}\n"),
            (None, None) => {}
        }
        continued = (begun.is_some() || continued) && line.ends_with('\\');
    }
    for step in &mut steps {
        step.output = trimmed(&step.output);
    }
    steps
}

/// Without spaces at the ends of lines and empty lines at the end.
fn trimmed(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
    let text = lines.join("\n");
    let text = text.trim_end();
    if text.is_empty() {
        String::new()
    } else {
        format!("{text}\n")
    }
}

/// Equal, where `...` matches any text.
fn matches(expected: &str, printed: &str) -> bool {
    let parts: Vec<&str> = expected.split("...").collect();
    let [first, between @ .., last] = parts.as_slice() else {
        return expected == printed;
    };
    let Some(mut rest) = printed.strip_prefix(first) else {
        return false;
    };
    for part in between {
        match rest.find(part) {
            Some(at) => rest = &rest[at + part.len()..],
            None => return false,
        }
    }
    rest.ends_with(last)
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}

#[test]
fn an_elision_stands_for_any_text_and_nothing_else_does() {
    assert!(matches("a\n", "a\n"));
    assert!(!matches("a\n", "a\nb\n"));
    assert!(matches("a\n...\nd 5\n", "a\nb\nc\nd 5\n"));
    assert!(!matches("a\n...\nd 5\n", "a\nb\nc\nd 6\n"));
    assert!(matches("size ... bytes\n", "size 17 bytes\n"));
    assert!(!matches("", "a\n"));
    assert!(matches("...\n", "a\nb\n"));
    let found = steps("$ a \\\n  b\nout\n$ c\n");
    assert_eq!(found.len(), 2);
    assert_eq!(found[0].command, "a \\\n  b\n");
    assert_eq!(found[0].output, "out\n");
    assert_eq!(found[1].output, "");
}
