//! Zoom of a report page down to the samples of the recording, from the page and from the file beside it.

use std::path::Path;

use serde_json::{Value, json};

use super::pages::Bench;
use crate::appearance;
use crate::browser::Browser;

/// Time, estimate of the first load in its column of `--estimates`, as the table has them.
fn estimates(path: &Path) -> Vec<(f64, f64)> {
    let mut table = csv::Reader::from_path(path).expect("a table");
    let columns = table.headers().expect("columns").clone();
    let load = (columns
        .iter()
        .position(|name| name.starts_with("motor_torque")))
    .expect("a load");
    (table.records())
        .map(|row| {
            let row = row.expect("a row");
            let number = |k: usize| row[k].parse().expect("a number");
            (number(0), number(load))
        })
        .collect()
}

/// Times and values of the first curve that are in view.
fn in_view(browser: &mut Browser) -> Vec<(f64, f64)> {
    let rows = browser.value(
        "(() => { const { u, data: [x, y] } = charts[0], { min, max } = u.scales.x; \
         return x.map((t, i) => [t, y[i]]).filter(([t]) => t >= min && t <= max); })()",
    );
    let number = |value: &Value| value.as_f64().expect("a number");
    (rows.as_array().expect("rows").iter())
        .map(|row| (number(&row[0]), number(&row[1])))
        .collect()
}

/// Drags the mouse over the first plot, from one part of its width to another.
fn drag(browser: &mut Browser, from: f64, to: f64) {
    browser.value("charts[0].figure.scrollIntoView({ block: 'center' })");
    let frame = browser.value("(({ x, y, width, height }) => [x, y, width, height])(charts[0].u.over.getBoundingClientRect())");
    let [x, y, width, height] = [0, 1, 2, 3].map(|k| frame[k].as_f64().expect("a number"));
    for (kind, part) in [
        ("mouseMoved", from),
        ("mousePressed", from),
        ("mouseMoved", to),
        ("mouseReleased", to),
    ] {
        let at = json!({ "type": kind, "x": x + part * width, "y": y + height / 2.0, "button": "left", "clickCount": 1 });
        browser.call("Input.dispatchMouseEvent", &at);
        browser.value("new Promise(done => setTimeout(done, 80))");
    }
}

/// Zooms until every sample is drawn, and compares these with the table.
fn assert_zooms_to_samples(browser: &mut Browser, page: &Path, expected: &[(f64, f64)]) {
    browser.show_as(1600, 900, "light");
    browser.go(&format!("file://{}", page.display()));
    let drawn = "document.getElementById('drawn').textContent";
    let at_first = browser.value(drawn);
    assert!(
        at_first
            .as_str()
            .is_some_and(|text| text.contains("least and the greatest"))
    );
    for _ in 0..4 {
        drag(browser, 0.5, 0.6);
    }
    browser.wait(&format!("{drawn} === 'Every sample in view is drawn.'"));
    let found = in_view(browser);
    assert!(found.len() > 3, "{found:?}");
    let first = expected
        .iter()
        .position(|row| row.0 >= found[0].0 - 1e-9)
        .expect("a row");
    for (found, expected) in found.iter().zip(&expected[first..]) {
        let is_near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b.abs().max(1e-3);
        assert!(
            is_near(found.0, expected.0) && is_near(found.1, expected.1),
            "{found:?} {expected:?}"
        );
    }
    // A section that is opened now, what was zoomed, and all again.
    browser.value("document.querySelectorAll('details').forEach(details => details.open = true)");
    browser.wait("charts.length > 12");
    browser.wait(&format!("{drawn} === 'Every sample in view is drawn.'"));
    // No flag is set there: its curves lie on the axis.
    let blank = "charts.filter(c => c.plot.title !== 'Flags' && !inked(c)).map(c => c.plot.title)";
    assert_eq!(browser.value(blank), json!([]));
    let name = page.file_stem().expect("a name").display();
    appearance::keep(browser, &format!("zoom-{name}"));
    browser.value("actions.reset()");
    browser.wait(&format!("{drawn} === {at_first}"));
    assert_eq!(browser.value("errors"), json!([]));
    assert!(browser.complaints().is_empty());
}

#[test]
fn a_page_of_a_minute_is_zoomed_to_its_samples() {
    let mut bench = Bench::new();
    bench.run("simulate bench/machine.toml --scenario torque-ramps --duration-s 30 --seed 5 -o short.parquet");
    bench.run("replay bench/machine.toml short.parquet --report short.html --estimates short.csv");
    let (page, table) = (bench.path("short.html"), bench.path("short.csv"));
    assert_zooms_to_samples(&mut bench.browser, &page, &estimates(&table));
}

#[test]
fn a_page_of_a_long_recording_is_zoomed_by_the_file_beside_it() {
    let mut bench = Bench::new();
    bench.run("simulate bench/machine.toml --scenario torque-ramps --duration-s 200 --seed 6 -o long.parquet");
    bench.run("replay bench/machine.toml long.parquet --report long.html --report-samples --estimates long.csv");
    bench.run("replay bench/machine.toml long.parquet --report alone.html");
    let [page, table, file, alone] =
        ["long.html", "long.csv", "long.samples.js", "alone.html"].map(|name| bench.path(name));
    assert_zooms_to_samples(&mut bench.browser, &page, &estimates(&table));

    // Of another run, cut off, and gone: the page says so, and draws as before.
    let text = std::fs::read_to_string(&file).expect("text");
    let mark = text.trim_end().rfind("loadtwinSamples(").expect("a mark");
    for (content, says) in [
        (
            Some(format!("{}loadtwinSamples(\"0\");\n", &text[..mark])),
            "is of another run",
        ),
        (Some(text[..mark].to_owned()), "is not whole"),
        (None, "is not beside this page"),
    ] {
        match content {
            Some(content) => std::fs::write(&file, content).expect("written"),
            None => std::fs::remove_file(&file).expect("removed"),
        }
        bench.browser.go("about:blank");
        bench.browser.go(&format!("file://{}", page.display()));
        bench.browser.value("const { full } = groups.get('time'); show(groups.get('time'), full[1] / 2, full[1] / 2 + 0.1)");
        bench.browser.wait(&format!(
            "document.getElementById('drawn').textContent.includes({says:?})"
        ));
        assert_eq!(bench.browser.value("inked(charts[0])"), true);
    }
    bench.browser.complaints();

    bench.browser.go(&format!("file://{}", alone.display()));
    let words = bench
        .browser
        .value("document.querySelector('.drawn').textContent")
        .to_string();
    assert!(
        words.contains("--report-samples writes them beside it"),
        "{words}"
    );
}
