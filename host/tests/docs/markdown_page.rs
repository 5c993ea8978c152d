//! Parser of a Markdown page into its fenced blocks with their attributes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::fragment::unknown_keys;

/// The page whose Python the tests of the Python package run.
const PYTHON: [&str; 2] = ["docs/how-to/python.md", "docs/how-to/archive.md"];

/// Languages of blocks that are no commands. `text` is for drawings and equations.
const DATA: [&str; 5] = ["toml", "python", "text", "csv", "json"];

pub struct Page {
    pub path: PathBuf,
    pub text: String,
    pub blocks: Vec<Block>,
}

/// A block between fences: language and attributes follow the opening one.
///
/// | attribute | the test |
/// |---|---|
/// | `file=NAME` | writes the block to this file |
/// | `exit=N` | expects this exit code, not 0 |
/// | `not-run="REASON"` | leaves it out |
pub struct Block {
    /// Of the opening fence, from 1.
    pub line: usize,
    pub language: String,
    pub attributes: BTreeMap<String, String>,
    pub text: String,
}

impl Page {
    pub fn read(path: &Path) -> Self {
        let text = std::fs::read_to_string(path)
            .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let mut blocks = Vec::new();
        let mut lines = text.lines().enumerate();
        while let Some((number, line)) = lines.next() {
            let Some(info) = line.trim_start().strip_prefix("```") else {
                continue;
            };
            let indent = line.len() - line.trim_start().len();
            let mut body = String::new();
            for (_, line) in lines.by_ref() {
                if line.trim_start().starts_with("```") {
                    break;
                }
                body.push_str(line.get(indent..).unwrap_or(""));
                body.push('\n');
            }
            let (language, attributes) = info.split_once(' ').unwrap_or((info, ""));
            blocks.push(Block {
                line: number + 1,
                language: language.to_owned(),
                attributes: attributes_of(attributes),
                text: body,
            });
        }
        Self {
            path: path.to_owned(),
            text,
            blocks,
        }
    }

    /// What of the page is no fenced block, with line numbers from 1.
    pub fn prose(&self) -> impl Iterator<Item = (usize, &str)> {
        let mut fenced = false;
        (1..).zip(self.text.lines()).filter(move |(_, line)| {
            let fence = line.trim_start().starts_with("```");
            fenced ^= fence;
            !fenced && !fence
        })
    }

    /// Whether what is no command is run elsewhere or can be used as it is shown.
    fn checked(&self, block: &Block, schema: &serde_json::Value) -> Result<(), String> {
        let is_written = block.attributes.contains_key("file");
        match block.language.as_str() {
            "toml" => {
                let part: toml::Table = block.text.parse().map_err(|e| format!("{e}"))?;
                let unknown = unknown_keys(&part, schema);
                match unknown.as_slice() {
                    [] => Ok(()),
                    keys => Err(format!("no keys of a description: {}", keys.join(", "))),
                }
            }
            "json" => (serde_json::from_str::<serde_json::Value>(&block.text))
                .map(drop)
                .map_err(|error| error.to_string()),
            "python" if !is_written && !PYTHON.iter().any(|page| self.path.ends_with(page)) => {
                Err(format!(
                    "Python is run in {} only; write it to a file and run this",
                    PYTHON.join(" and ")
                ))
            }
            "csv" if !is_written => Err("no file that a command reads".into()),
            _ => Ok(()),
        }
    }

    /// Blocks that are neither run nor data, and code by indentation alone.
    pub fn unclear(&self, schema: &serde_json::Value) -> Vec<String> {
        let at = |line: usize, what: &str| format!("{}:{line}: {what}", self.path.display());
        let mut found = Vec::new();
        for block in &self.blocks {
            let reason = block.attributes.get("not-run");
            if block.language != "console" && !DATA.contains(&block.language.as_str()) {
                found.push(at(
                    block.line,
                    "allowed languages: console, toml, python, text, csv, json",
                ));
            }
            if reason.is_some_and(|reason| reason.split_whitespace().count() < 2) {
                found.push(at(block.line, "not-run needs its reason"));
            }
            let unknown = |key: &&String| !["file", "exit", "not-run"].contains(&key.as_str());
            if let Some(key) = block.attributes.keys().find(unknown) {
                found.push(at(block.line, &format!("unknown attribute {key}")));
            }
            if block.language == "console" && !block.text.starts_with("$ ") {
                found.push(at(block.line, "console begins with `$ `"));
            }
            if reason.is_none()
                && let Err(what) = self.checked(block, schema)
            {
                found.push(at(block.line, &what));
            }
        }
        let (mut blank, mut list) = (true, false);
        for (number, line) in self.prose() {
            let indented = line.starts_with("    ");
            let item = line.trim_start().starts_with(['-', '*'])
                || line.trim_start().starts_with(|c: char| c.is_ascii_digit());
            if indented && blank && !list {
                found.push(at(number, "code by indentation; use a fenced block"));
            }
            list = item || list && (indented || line.starts_with("  ") || line.is_empty());
            blank = line.is_empty();
        }
        found
    }
}

/// `file=a.toml not-run="needs a board"`.
fn attributes_of(mut text: &str) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    while let Some((key, value)) = text.split_once('=') {
        let (value, further) = match value.strip_prefix('"') {
            Some(quoted) => quoted.split_once('"').unwrap_or((quoted, "")),
            None => value.split_once(' ').unwrap_or((value, "")),
        };
        found.insert(key.trim().to_owned(), value.to_owned());
        text = further;
    }
    found
}
