//! Test program of pages in a real browser. Here the live page of `monitor --web` (values, bits,
//! reconnection); in `pages` those of reports, in `zoom` their zoom, in `site` the documentation's.

mod appearance;
mod browser;
mod pages;
mod site;
mod zoom;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use browser::{Browser, get};

struct Server {
    process: Child,
    host: String,
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples")
}

fn bench() -> PathBuf {
    examples().join("bench/machine.toml")
}

fn loadtwin(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
    command.args(arguments).current_dir(folder);
    command
}

/// A minute of a bench on a bus at 2000 samples a second.
fn log(folder: &Path) {
    let bench = bench();
    let bench = bench.to_str().expect("a name");
    let simulate = [
        "simulate",
        bench,
        "--scenario",
        "torque-ramps",
        "--duration-s",
        "60",
        "--seed",
        "1",
        "-o",
        "rec.parquet",
    ];
    for arguments in [
        &simulate[..],
        &["send", bench, "rec.parquet", "--fd", "--log", "raw.log"],
        &["node", bench, "raw.log", "-o", "bus.log"],
    ] {
        let output = loadtwin(folder, arguments).output().expect("runs");
        let reason = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {reason}");
    }
}

fn serve(folder: &Path, log: &str, address: &str) -> Server {
    let bench = bench();
    let arguments = [
        "monitor",
        log,
        bench.to_str().expect("a name"),
        "--web",
        address,
        "--speed",
        "4",
    ];
    let mut process = loadtwin(folder, &arguments)
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    let mut lines = BufReader::new(process.stderr.take().expect("piped")).lines();
    let line = lines.next().expect("a line").expect("text");
    let host = line
        .strip_prefix("page: http://")
        .and_then(|rest| rest.split('/').next());
    let host = host.unwrap_or_else(|| panic!("{line}")).to_owned();
    Server { process, host }
}

#[test]
fn loads_sensors_and_bits_are_on_the_page_which_connects_again() {
    let folder = tempfile::tempdir().expect("a folder");
    log(folder.path());
    let server = serve(folder.path(), "bus.log", "0");
    let page = get(&server.host, "/");
    for outside in [
        "src=",
        "href=",
        "url(",
        "@import",
        "fetch(",
        "XMLHttpRequest",
    ] {
        assert!(!page.contains(outside), "the page contains {outside}");
    }

    let mut browser = Browser::open(&format!("http://{}/", server.host));
    browser.wait("received > 20 && charts.length === 3");
    browser.wait("document.getElementById('bits').textContent === 'bits identical'");
    assert_eq!(browser.value("errors"), serde_json::json!([]));
    assert_eq!(
        browser.value("document.getElementById('machine').textContent"),
        "bench 3"
    );
    let text = browser.value("document.body.innerText").to_string();
    for part in [
        "motor_torque",
        "brake_torque",
        "Nm",
        "2σ",
        "left_upper",
        "right_lower",
        "valid",
        "running",
    ] {
        assert!(text.contains(part), "no {part} in {text}");
    }
    // The band is two deviations wide around the values, and no row is without them.
    let band = browser.value(
        "rows.slice(2).every((r, i) => { const [up, low, most, least] = charts[0].columns(); const k = i + 2; \
         const wide = up[k] - most[k] - 2 * r.loads[0].std; return Math.abs(wide) < 1e-6 && low[k] < least[k]; })",
    );
    assert_eq!(band, true);
    // A curve is drawn.
    let drawn = "[...document.querySelectorAll('canvas')].every(c => { const d = c.getContext('2d')\
         .getImageData(0, 0, c.width, c.height).data; let n = 0; for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n > 500; })";
    browser.wait(drawn);

    appearance::check(&mut browser, "monitor");

    let address = server.host.clone();
    drop(server);
    browser.wait("document.getElementById('link').textContent === 'not connected'");
    let again = serve(folder.path(), "bus.log", &address);
    assert_eq!(again.host, address);
    browser.wait("document.getElementById('link').textContent === 'connected' && rows.length > 3");
    assert_eq!(browser.value("errors"), serde_json::json!([]));
}
