//! Checks of a page in a browser: faults at several widths, in light and dark and on paper; overlaps
//! and text that cannot be read.

#[path = "accessibility.rs"]
mod accessibility;

use std::path::Path;

use serde_json::json;

use self::accessibility::{folder, strings};
pub use self::accessibility::{keep, violations};
use crate::browser::Browser;

/// Widths of a telephone, a tablet and a desk.
const WIDTHS: [u32; 3] = [360, 1024, 1600];

/// 186 mm, between the margins of A4, in CSS pixels.
const PRINTED_WIDTH: u32 = 703;

/// Asserts that the page that is open has no fault at any width, light and dark, and for people who do not see it
/// well; and writes its pictures under `name`.
pub fn check(browser: &mut Browser, name: &str) {
    let mut found = Vec::new();
    for theme in ["light", "dark"] {
        for width in WIDTHS {
            browser.show_as(width, 900, theme);
            for fault in faults(browser) {
                found.push(format!("{width} px, {theme}: {fault}"));
            }
            keep(browser, &format!("{name}-{width}-{theme}"));
        }
        for fault in violations(browser) {
            found.push(format!("{theme}: {fault}"));
        }
    }
    found.extend(browser.complaints());
    assert!(found.is_empty(), "{name}:\n{}", found.join("\n"));
}

/// As [`check`] of a report in `file`, whose plots must all be drawn or say that they have no data, also on paper.
pub fn check_report(browser: &mut Browser, file: &Path, name: &str) {
    browser.show_as(1024, 900, "light");
    browser.go(&format!("file://{}#all", file.display()));
    check(browser, name);
    let plots = browser.value(
        "({ errors, missing: page.plots.length - charts.length - document.querySelectorAll('.problem').length, blank: charts.filter(c => !inked(c)).map(c => c.plot.title) })",
    );
    assert_eq!(
        plots,
        json!({ "errors": [], "missing": 0, "blank": [] }),
        "{name}"
    );
    print(browser, name);
}

/// A PDF on A4, plots on pages after the tables, no plot or table of it wider than the paper.
fn print(browser: &mut Browser, name: &str) {
    let pdf = browser.pdf();
    let text = String::from_utf8_lossy(&pdf);
    let pages = text.matches("/Type /Page\n").count();
    let boxes: Vec<&str> = text.split("/MediaBox [").skip(1).collect();
    let is_a4 = |mediabox: &&str| {
        let numbers: Vec<f64> = (mediabox.split(']').next().unwrap_or(""))
            .split_whitespace()
            .filter_map(|number| number.parse().ok())
            .collect();
        matches!(numbers[..], [_, _, w, h] if (w - 595.0).abs() < 2.0 && (h - 842.0).abs() < 2.0)
    };
    std::fs::write(folder().join(format!("{name}.pdf")), &pdf).expect("written");
    // Plots begin a page of their own.
    let has_plots = browser.value("page.plots.length > 0") == true;
    assert!(
        pages > usize::from(has_plots),
        "{name}: {pages} pages of PDF"
    );
    assert!(boxes.iter().all(is_a4), "{name}: not on A4");

    let hidden = |is_hidden: bool| json!({ "hidden": is_hidden });
    browser.call("Emulation.setScrollbarsHidden", &hidden(true));
    browser.show_as(PRINTED_WIDTH, 1000, "light");
    browser.call("Emulation.setEmulatedMedia", &json!({ "media": "print" }));
    browser.value("dispatchEvent(new Event('beforeprint'))");
    let wide = browser.value(
        "[document.documentElement, ...document.querySelectorAll('.table')].filter(e => e.scrollWidth > e.clientWidth + 1)\
         .map(e => `${e.scrollWidth} of ${e.clientWidth} pixels: ${e.innerText.slice(0, 60)}`)",
    );
    browser.value("dispatchEvent(new Event('afterprint'))");
    browser.call("Emulation.setEmulatedMedia", &json!({ "media": "" }));
    browser.call("Emulation.setScrollbarsHidden", &hidden(false));
    assert_eq!(wide, json!([]), "{name}, printed");
    println!("{name}: {pages} pages of PDF");
}

/// What cannot be read at the present size.
pub fn faults(browser: &mut Browser) -> Vec<String> {
    strings(&browser.value(include_str!("appearance.js")))
}
