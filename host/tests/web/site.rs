//! The documentation as a site: built without warnings, links lead somewhere, readable on a telephone and a desk, found
//! by its search.

use std::path::Path;
use std::process::Command;

use crate::appearance;
use crate::browser::Browser;

#[test]
fn the_documentation_is_a_site_that_can_be_read_and_searched() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .canonicalize()
        .expect("a folder");
    let output = Command::new("python3")
        .arg(root.join("docs/site.py"))
        .output()
        .expect("runs");
    let reason = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{reason}");
    let site = root.join("target/site/docs");
    let page = |name: &str| format!("file://{}", site.join(name).display());

    let mut browser = Browser::open(&page("index.html"));
    for (name, width) in [
        ("index", 360),
        ("index", 1600),
        ("reference/effects", 360),
        ("reference/effects", 1600),
        ("tutorial/four-gauges", 360),
    ] {
        browser.show_as(width, 900, "light");
        browser.go(&page(&format!("{name}.html")));
        browser.wait("document.querySelectorAll('mdbook-sidebar-scrollbox a').length > 40");
        let wide = browser.value("document.documentElement.scrollWidth - innerWidth");
        assert!(
            wide.as_f64() <= Some(0.0),
            "{name} at {width} px: {wide} px too wide"
        );
        appearance::keep(
            &mut browser,
            &format!("site-{}-{width}", name.replace('/', "-")),
        );
    }

    // Parts in the navigation, in their order.
    let parts = browser
        .value("[...document.querySelectorAll('.part-title')].map(e => e.textContent.trim())");
    let expected = [
        "Tutorials",
        "How to",
        "Reference",
        "Explanation",
        "Laboratory notes",
    ];
    assert_eq!(parts, serde_json::json!(expected));

    browser.go(&page("index.html"));
    browser.value("document.getElementById('mdbook-search-toggle').click()");
    browser.wait("document.activeElement.id === 'mdbook-searchbar'");
    browser.call(
        "Input.insertText",
        &serde_json::json!({ "text": "gauge-creep" }),
    );
    browser.wait(
        "[...document.querySelectorAll('#mdbook-searchresults a')].some(a => a.href.includes('reference/effects.html'))",
    );
    assert!(browser.complaints().is_empty());
}
