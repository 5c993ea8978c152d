//! Pictures of a page that is open in a browser, and the rules of accessibility (axe-core) that it breaks.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::browser::Browser;

/// Of a picture, in pixels; below are further plots alike.
const HIGHEST: f64 = 6000.0;

/// The library of accessibility rules axe-core, from the npm registry, unchanged, with its licence beside it.
const AXE: &str = include_str!("axe-4.14.1.min.js");

/// Folder of the pictures; they stay after the test, to be looked at.
pub fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pages");
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

/// Writes a picture of the page that is open under `name`.
pub fn keep(browser: &mut Browser, name: &str) {
    let path = folder().join(format!("{name}.png"));
    std::fs::write(path, browser.picture(HIGHEST)).expect("written");
}

/// Rules of accessibility that the page breaks, with impact serious or critical.
pub fn violations(browser: &mut Browser) -> Vec<String> {
    if browser.value("typeof axe") == "undefined" {
        browser.value(&format!("{AXE};0"));
    }
    strings(&browser.value(
        "axe.run(document, { resultTypes: ['violations'], preload: false }).then(({ violations }) => violations\
         .filter(v => v.impact === 'serious' || v.impact === 'critical')\
         .map(v => `${v.id}: ${v.help}: ${v.nodes.length} of ${v.nodes.slice(0, 3).map(n => n.html.slice(0, 160)).join(' ')}: ${v.nodes[0].failureSummary}`))",
    ))
}

pub fn strings(list: &Value) -> Vec<String> {
    let list = list.as_array().expect("a list");
    list.iter()
        .map(|text| text.as_str().expect("text").to_owned())
        .collect()
}
