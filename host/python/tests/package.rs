//! Tests the Python package as it is installed: puts it together from the library that was built
//! and the modules beside it, runs the tests in Python of this folder on it, and opens the page of
//! a fleet of ten thousand machines in a browser. Needs a Python with `tests/requirements.txt`.

#[path = "../../tests/web/accessibility.rs"]
mod accessibility;
#[expect(dead_code, reason = "other test programs use the rest")]
#[path = "../../tests/web/browser.rs"]
mod browser;

use std::path::{Path, PathBuf};
use std::process::Command;

use browser::Browser;
use serde_json::{Value, json};
use tempfile::TempDir;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Python of `LOADTWIN_PYTHON`, or the one that `tests/run` sets up.
fn python() -> PathBuf {
    std::env::var_os("LOADTWIN_PYTHON")
        .map_or_else(|| root().join("target/venv/bin/python"), PathBuf::from)
}

/// Copies a folder of modules, without what Python compiled of them.
fn copy(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap();
        if path.is_file() {
            std::fs::copy(&path, to.join(name)).unwrap();
        } else if name != "__pycache__" {
            copy(&path, &to.join(name));
        }
    }
}

/// A folder with the package.
fn package() -> TempDir {
    let folder = TempDir::new().unwrap();
    let package = folder.path().join("loadtwin");
    let modules = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/loadtwin");
    copy(&modules, &package);
    // The library lies beside the test that was built with it.
    let built = std::env::current_exe().unwrap();
    let library = built.parent().unwrap().join("lib_loadtwin.so");
    std::fs::copy(&library, package.join("_loadtwin.abi3.so"))
        .unwrap_or_else(|error| panic!("{}: {error}", library.display()));
    folder
}

fn run(arguments: &[&str]) -> String {
    let folder = package();
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    // Beside the tests lies the command, with whose figures they compare.
    let built = std::env::current_exe().unwrap();
    let command = built.parent().unwrap().parent().unwrap().join("loadtwin");
    let output = Command::new(python())
        .args(arguments)
        .current_dir(root())
        .env("LOADTWIN", command)
        .env("MPLBACKEND", "agg")
        .env(
            "PYTHONPATH",
            std::env::join_paths([folder.path(), &tests]).unwrap(),
        )
        .output()
        .unwrap_or_else(|error| panic!("{}: {error}; tests/run sets it up", python().display()));
    let said = String::from_utf8_lossy(&output.stderr);
    let also = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{also}\n{said}");
    println!("{also}\n{said}");
    also.into_owned()
}

#[test]
fn tables_of_every_library_give_the_estimates_of_the_command() {
    run(&["-m", "unittest", "-v", "test_replay"]);
}

#[test]
fn wrong_input_is_an_exception() {
    run(&["-m", "unittest", "-v", "test_refused"]);
}

#[test]
fn every_example_has_the_figures_of_the_command() {
    run(&["-m", "unittest", "-v", "test_examples"]);
}

#[test]
fn package_is_complete_small_and_installs() {
    run(&["-m", "unittest", "-v", "test_install"]);
}

#[test]
fn examples_in_docstrings_run() {
    run(&["-m", "unittest", "-v", "test_docstrings"]);
}

#[test]
fn notebooks_run() {
    run(&["-m", "unittest", "-v", "test_notebooks"]);
}

#[test]
fn archives_have_the_bits_of_one_recording() {
    run(&["-m", "unittest", "-v", "test_archive"]);
}

#[test]
fn spark_gives_the_bits_of_one_process() {
    run(&["-m", "unittest", "-v", "test_spark"]);
}

/// Machines on the page of a fleet.
const FLEET: u64 = 10_000;

/// Types into the field of the search.
fn search(browser: &mut Browser, text: &str) {
    browser.value(&format!(
        "(() => {{ const field = document.getElementById('search'); field.value = {text:?}; \
         field.dispatchEvent(new Event('input')); }})()"
    ));
}

/// Loads the page anew.
fn reload(browser: &mut Browser) {
    browser.value("window.isOld = true");
    browser.call("Page.reload", &json!({}));
    browser.wait("!window.isOld && document.readyState === 'complete'");
}

fn rows(browser: &mut Browser) -> u64 {
    let rows = browser.value("document.querySelectorAll('#machines tbody tr').length");
    rows.as_u64().unwrap()
}

fn shown(browser: &mut Browser) -> String {
    let shown = browser.value("document.querySelector('#machines nav span').textContent");
    shown.as_str().unwrap().to_owned()
}

/// Pictures at the widths of a telephone, a tablet and a desk, light and dark; rules of accessibility.
fn look(browser: &mut Browser, page: &str) {
    for theme in ["light", "dark"] {
        for width in [360, 1024, 1600] {
            browser.show_as(width, 900, theme);
            // The widest font that a system may show it in, then its own.
            for font in ["monospace", ""] {
                browser.value(&format!("document.body.style.fontFamily = {font:?}"));
                let wide = browser.value("document.documentElement.scrollWidth");
                assert!(wide.as_u64() <= Some(u64::from(width)), "{wide} of {width}");
            }
            accessibility::keep(browser, &format!("{page}-{width}-{theme}"));
        }
        let back = browser.value("getComputedStyle(document.body).backgroundColor");
        assert_eq!(back == json!("rgb(20, 23, 26)"), theme == "dark", "{back}");
        assert_eq!(
            accessibility::violations(browser),
            [""; 0],
            "{page}, {theme}"
        );
    }
}

#[test]
fn page_of_ten_thousand_machines() {
    let folder = TempDir::new().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fleet_page.py");
    let page = run(&[
        script.to_str().unwrap(),
        folder.path().to_str().unwrap(),
        &FLEET.to_string(),
    ]);
    let index = page.trim();
    for file in ["index.html", "machine.html", "paged_table.js", "style.css"] {
        let text = std::fs::read_to_string(Path::new(index).with_file_name(file)).unwrap();
        for outside in ["src=\"http", "href=\"http", "url(", "@import", "fetch("] {
            assert!(!text.contains(outside), "{file} contains {outside}");
        }
    }
    let mut browser = Browser::open(&format!("file://{index}"));
    browser.wait("document.querySelectorAll('#machines tbody tr').length === 100");
    // What contradicts comes first.
    let first = "document.querySelector('#machines tbody tr').innerText.split('\\t')";
    assert_eq!(browser.value(first)[1], "contradicts");
    assert_eq!(shown(&mut browser), format!("1 to 100 of {FLEET}"));
    // The page has the remaining life of machines with damage, and of no others.
    let other =
        "fleet.machine.filter((_, k) => (fleet.remaining_s[k] > 0) !== (fleet.damage[k] > 0))";
    assert_eq!(browser.value(&format!("{other}.length")), 0);
    // Pages, search, states, order: each at once.
    browser.value("document.querySelectorAll('#machines nav button')[1].click()");
    assert_eq!(shown(&mut browser), format!("101 to 200 of {FLEET}"));
    let slowest = browser.value(
        "Math.max(...['e', 'ma', 'machine-99', ''].map((text) => { const from = performance.now(); \
         search.value = text; search.dispatchEvent(new Event('input')); return performance.now() - from; }), \
         ...[0, 5, 6].map((k) => { const from = performance.now(); \
         document.querySelectorAll('#machines th button')[k].click(); return performance.now() - from; }))",
    );
    assert!(slowest.as_f64().unwrap() < 1000.0, "{slowest} ms");
    println!("slowest search or order: {slowest} ms");
    search(&mut browser, "machine-123");
    assert_eq!(rows(&mut browser), 11);
    search(&mut browser, "nothing of this name");
    assert_eq!(
        (rows(&mut browser), shown(&mut browser)),
        (0, "none".into())
    );
    search(&mut browser, "");
    browser.value("document.querySelector('#states .fits').click()");
    let fits = browser.value("document.querySelector('#states .fits').textContent.split(' ')[1]");
    assert_eq!(
        shown(&mut browser),
        format!("1 to 100 of {}", fits.as_str().unwrap())
    );
    for life in ["remaining hours", "by design"] {
        let shown_lives = browser.value(&format!(
            "(() => {{ const at = [...document.querySelectorAll('#machines thead th')] \
             .findIndex((th) => th.innerText.includes('{life}')); \
             return [...document.querySelectorAll('#machines tbody tr')] \
             .filter((row) => Number(row.cells[at].innerText) > 0).length; }})()",
        ));
        assert_eq!(shown_lives, 100, "{life}");
    }
    browser.value("document.querySelectorAll('#machines th button')[0].click()");
    let sorted =
        browser.value("document.querySelectorAll('#machines th')[0].getAttribute('aria-sort')");
    assert_eq!(sorted, "ascending");
    look(&mut browser, "fleet");
    // The address has the view.
    reload(&mut browser);
    browser.wait("document.querySelectorAll('#machines tbody tr').length === 100");
    let pressed =
        browser.value("document.querySelector('#states .fits').getAttribute('aria-pressed')");
    assert_eq!(pressed, "true");
    // One click to the machine's own page, whatever its name has.
    search(&mut browser, "g<b>1");
    assert_eq!(rows(&mut browser), 1);
    browser.value("document.querySelector('#machines tbody a').click()");
    browser.wait("document.querySelectorAll('#days tbody tr').length === 4");
    let name = browser.value("document.getElementById('machine').textContent");
    assert_eq!(name, "g<b>1 & \"2'");
    let plots =
        browser.value("[...document.querySelectorAll('figcaption')].map((f) => f.textContent)");
    let plots: Vec<&str> = plots
        .as_array()
        .unwrap()
        .iter()
        .filter_map(Value::as_str)
        .collect();
    assert_eq!(
        plots[..4],
        [
            "valid [%]",
            "NIS",
            "contradicts, worst sensor [%]",
            "damage, main_shaft"
        ]
    );
    assert!(plots.len() > 4, "{plots:?}");
    look(&mut browser, "machine");
    // Faults are on the page of their machine.
    browser.value(&format!(
        "location.href = {:?}",
        format!("file://{index}#search=undescribed")
    ));
    browser.wait("document.querySelectorAll('#machines tbody a').length === 1");
    browser.value("document.querySelector('#machines tbody a').click()");
    browser.wait("document.querySelectorAll('#faults tbody tr').length === 2");
}
