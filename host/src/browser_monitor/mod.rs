//! Shows a CAN bus in browsers for `loadtwin monitor --web` (`WebView`, a `View` of the crate
//! `loadtwin_can`): one page with loads, sensors and state, fed over a WebSocket ten times a
//! second.
//!
//! Each tenth of a second the least and the largest value of each signal are sent, so that no peak
//! is lost and the amount does not grow with the sample rate. A browser that connects, or connects
//! again, gets the last minute.

mod server;

use std::io;
use std::net::SocketAddr;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use loadtwin_can::live_display::{LoadRow, Page, SensorRow, View};
use serde::Serialize;
use serde_json::json;

use server::Channel;

/// Time that a row of the page's plots stands for.
const PERIOD: Duration = Duration::from_millis(100);

/// What the page calls things.
#[derive(Clone, Debug, Default)]
pub struct Labels {
    /// Name of the machine.
    pub machine: String,
    /// Unit of each load.
    pub units: Vec<String>,
    /// Name of each sensor.
    pub sensors: Vec<String>,
}

/// A view in browsers.
pub struct WebView {
    channel: Arc<Channel>,
    labels: Labels,
    /// Where it is served.
    pub address: SocketAddr,
    row: Row,
    due: Instant,
    head: String,
}

/// What came in one period.
#[derive(Debug, Default)]
struct Row {
    loads: Vec<Extremes>,
    sensors: Vec<Extremes>,
}

/// Least and largest value, and the last deviation and fault.
#[derive(Clone, Debug, Default, Serialize)]
struct Extremes {
    least: Option<f64>,
    most: Option<f64>,
    std: Option<f64>,
    fault: &'static str,
    cause: &'static str,
}

impl Extremes {
    fn take(&mut self, value: Option<f64>) {
        let Some(value) = value.filter(|value| value.is_finite()) else {
            return;
        };
        self.least = Some(self.least.map_or(value, |least| least.min(value)));
        self.most = Some(self.most.map_or(value, |most| most.max(value)));
    }

    fn load(&mut self, row: &LoadRow) {
        // A load that is not valid is a gap.
        self.take(row.value.filter(|_| row.fault.is_none()));
        self.std = row.std.or(self.std);
        self.fault = row.fault.name();
        self.cause = row.fault.cause();
    }

    fn sensor(&mut self, row: &SensorRow) {
        self.take(row.nis.map(f64::from));
        self.fault = row.fault.name();
        self.cause = row.fault.cause();
    }
}

impl WebView {
    /// Serves the page at `address`; with port 0 at one that is free.
    ///
    /// # Errors
    /// When the address cannot be listened at.
    pub fn new(address: SocketAddr, labels: Labels) -> io::Result<Self> {
        let channel = Arc::new(Channel::default());
        let address = server::listen(address, &channel)?;
        Ok(Self {
            channel,
            labels,
            address,
            row: Row::default(),
            due: Instant::now(),
            head: String::new(),
        })
    }

    /// Names and units, sent first; again when a load or sensor is new.
    fn head(&self, page: &Page) -> String {
        let loads: Vec<_> = (page.loads.iter().enumerate())
            .map(|(i, load)| {
                let unit = self.labels.units.get(i).map_or("", String::as_str);
                json!({ "name": load.name, "unit": unit, "full": load.full_scale })
            })
            .collect();
        let sensors: Vec<_> = (0..page.sensors.len())
            .map(|i| {
                self.labels
                    .sensors
                    .get(i)
                    .cloned()
                    .unwrap_or_else(|| format!("sensor {}", i + 1))
            })
            .collect();
        json!({ "head": { "machine": self.labels.machine, "loads": loads, "sensors": sensors } })
            .to_string()
    }

    fn row(&self, page: &Page) -> String {
        let verdict = page
            .verdict
            .map(|verdict| serde_json::to_value(verdict).unwrap_or_default());
        let status = page.status.map(|status| {
            json!({
                "state": status.state.name(), "overruns": status.overruns, "missed": status.missed,
                "bus_off": status.bus_off, "queue": status.queue_overflow,
            })
        });
        let counts: Vec<_> = page
            .counts
            .iter()
            .map(|(name, count)| json!([name, count]))
            .collect();
        json!({
            "t": self.channel.elapsed_s(), "loads": self.row.loads, "sensors": self.row.sensors,
            "verdict": verdict, "status": status, "counts": counts, "note": page.note,
        })
        .to_string()
    }
}

impl View for WebView {
    fn due(&mut self, _now: Duration) -> bool {
        // By the clock of the browser: a log may run faster.
        let now = Instant::now();
        let is_due = now >= self.due;
        if is_due {
            self.due = now + PERIOD;
        }
        is_due
    }

    fn take(&mut self, page: &Page) {
        self.row.loads.resize(page.loads.len(), Extremes::default());
        self.row
            .sensors
            .resize(page.sensors.len(), Extremes::default());
        for (extremes, load) in self.row.loads.iter_mut().zip(&page.loads) {
            extremes.load(load);
        }
        for (extremes, sensor) in self.row.sensors.iter_mut().zip(&page.sensors) {
            extremes.sensor(sensor);
        }
    }

    fn show(&mut self, page: &Page) -> io::Result<ControlFlow<()>> {
        let head = self.head(page);
        if head != self.head {
            self.channel.set_head(&head);
            self.head = head;
        }
        self.channel.push(self.row(page));
        self.row = Row::default();
        Ok(ControlFlow::Continue(()))
    }
}
