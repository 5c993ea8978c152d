//! Headless browser for tests, controlled by the `DevTools` protocol.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use tungstenite::WebSocket;
use tungstenite::protocol::Message;

/// Longest wait for anything on the page.
const PATIENCE: Duration = Duration::from_secs(20);

pub struct Browser {
    process: Child,
    socket: WebSocket<TcpStream>,
    last: u64,
    complaints: Vec<String>,
    _profile: tempfile::TempDir,
}

fn chromium() -> &'static str {
    ["chromium", "chromium-browser", "google-chrome"]
        .into_iter()
        .find(|name| Command::new(name).arg("--version").output().is_ok())
        .expect(
            "chromium not found: `apt-get install chromium` (the page is tested in a real browser)",
        )
}

impl Browser {
    /// Opens `url`.
    pub fn open(url: &str) -> Self {
        let profile = tempfile::tempdir().expect("a folder");
        let mut process = Command::new(chromium())
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--no-first-run",
            ])
            .args([
                "--disable-background-networking",
                "--disable-component-update",
                "--disable-sync",
            ])
            .args(["--remote-debugging-port=0", "--window-size=1400,900"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(url)
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("starts");
        let mut lines = BufReader::new(process.stderr.take().expect("piped")).lines();
        let port = loop {
            let line = lines.next().expect("a line").expect("text");
            if let Some(address) = line.strip_prefix("DevTools listening on ws://") {
                let host = address.split('/').next().expect("a host").to_owned();
                break host;
            }
        };
        // What it prints later must not block it.
        std::thread::spawn(move || lines.for_each(drop));
        let page = page_of(&port);
        let stream = TcpStream::connect(&port).expect("connected");
        stream.set_read_timeout(Some(PATIENCE)).expect("a time");
        let (socket, _) = tungstenite::client(page.as_str(), stream).expect("a page");
        let mut browser = Self {
            process,
            socket,
            last: 0,
            complaints: Vec::new(),
            _profile: profile,
        };
        for domain in ["Runtime.enable", "Log.enable", "Page.enable"] {
            browser.call(domain, &json!({}));
        }
        browser
    }

    /// Opens another page.
    pub fn go(&mut self, url: &str) {
        self.call("Page.navigate", &json!({ "url": url }));
        self.wait(&format!(
            "location.href === {} && document.readyState === 'complete'",
            json!(url)
        ));
    }

    /// Errors that the console got since the last call.
    pub fn complaints(&mut self) -> Vec<String> {
        std::mem::take(&mut self.complaints)
    }

    fn hear(&mut self, event: &Value) {
        let parameters = &event["params"];
        let is_error = match event["method"].as_str() {
            Some("Runtime.exceptionThrown") => true,
            Some("Runtime.consoleAPICalled") => parameters["type"] == "error",
            Some("Log.entryAdded") => parameters["entry"]["level"] == "error",
            _ => false,
        };
        if is_error {
            self.complaints.push(parameters.to_string());
        }
    }

    pub fn call(&mut self, method: &str, parameters: &Value) -> Value {
        self.last += 1;
        let message = json!({ "id": self.last, "method": method, "params": parameters });
        self.socket
            .send(Message::text(message.to_string()))
            .expect("sent");
        loop {
            let Message::Text(text) = self.socket.read().expect("an answer") else {
                continue;
            };
            let answer: Value = serde_json::from_str(&text).expect("JSON");
            if answer["id"] == self.last {
                return answer["result"].clone();
            }
            self.hear(&answer);
        }
    }

    /// The value of an expression, or what a promise leads to.
    pub fn value(&mut self, expression: &str) -> Value {
        let parameters =
            json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let answer = self.call("Runtime.evaluate", &parameters);
        let failure = &answer["exceptionDetails"];
        assert!(failure.is_null(), "{failure}");
        answer["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    pub fn wait(&mut self, expression: &str) {
        let deadline = Instant::now() + PATIENCE;
        let guarded =
            format!("(() => {{ try {{ return {expression} }} catch {{ return false }} }})()");
        while self.value(&guarded) != true {
            let page = || "document.body.innerText";
            assert!(
                Instant::now() < deadline,
                "never {expression}:\n{}",
                self.value(page())
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Shows the page in another size and theme.
    pub fn show_as(&mut self, width: u32, height: u32, theme: &str) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500 });
        self.call("Emulation.setDeviceMetricsOverride", &size);
        let theme = json!({ "features": [{ "name": "prefers-color-scheme", "value": theme }] });
        self.call("Emulation.setEmulatedMedia", &theme);
        // Observers of sizes and themes, and what they draw.
        self.value(
            "new Promise(done => setTimeout(() => requestAnimationFrame(() => setTimeout(done, 50)), 150))",
        );
    }

    /// A picture of the page from its top, PNG, at most `highest` pixels high.
    pub fn picture(&mut self, highest: f64) -> Vec<u8> {
        let size = self.call("Page.getLayoutMetrics", &json!({}))["cssContentSize"].clone();
        let height = size["height"].as_f64().expect("a height").min(highest);
        let clip = json!({ "x": 0, "y": 0, "width": size["width"], "height": height, "scale": 1 });
        let parameters =
            json!({ "captureBeyondViewport": true, "optimizeForSpeed": true, "clip": clip });
        decoded(&self.call("Page.captureScreenshot", &parameters))
    }

    /// The page as it is printed.
    pub fn pdf(&mut self) -> Vec<u8> {
        let parameters = json!({ "printBackground": true, "preferCSSPageSize": true });
        decoded(&self.call("Page.printToPDF", &parameters))
    }
}

fn decoded(answer: &Value) -> Vec<u8> {
    STANDARD
        .decode(answer["data"].as_str().expect("data"))
        .expect("base64")
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The WebSocket of the page that is open.
fn page_of(host: &str) -> String {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let pages: Value = serde_json::from_str(&get(host, "/json/list")).expect("JSON");
        let page = pages
            .as_array()
            .into_iter()
            .flatten()
            .find(|page| page["type"] == "page");
        if let Some(url) = page.and_then(|page| page["webSocketDebuggerUrl"].as_str()) {
            return url.to_owned();
        }
        assert!(Instant::now() < deadline, "no page");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// The body of an answer over HTTP.
pub fn get(host: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(host).expect("connected");
    write!(
        stream,
        "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
    )
    .expect("sent");
    let mut answer = String::new();
    let mut reader = BufReader::new(&mut stream);
    let mut length = None;
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).expect("a line");
        if let Some((key, value)) = line.split_once(':')
            && key.eq_ignore_ascii_case("content-length")
        {
            length = value.trim().parse().ok();
        }
        if line.trim().is_empty() {
            break;
        }
    }
    reader
        .take(length.expect("a length"))
        .read_to_string(&mut answer)
        .expect("text");
    answer
}
