//! Gathers the load, sensor and status frames of a machine for an MQTT broker: each second it
//! stores a message with the statistics of each load, and sets the health of board, loads and
//! sensors where it has changed or is 10 s old.

use std::io;

use loadtwin_common::io::frame::{SensorFrame, Status, StatusPage};
use serde_json::{Value, json};

use super::bus_rows::Load;
use super::load_statistics::LoadStatistics;
use super::publisher::{Shared, locked};

/// Longest time between two messages of health (s).
const HEALTH_S: u64 = 10;

/// Loads and sensors of a machine since the last messages.
pub struct Telemetry<'a> {
    shared: &'a Shared,
    topic: String,
    loads: Vec<(String, String)>,
    sensors: Vec<String>,
    statistics: Vec<LoadStatistics>,
    second: Option<u64>,
    faults: Vec<&'static str>,
    nis: Vec<(Option<f32>, &'static str)>,
    status: Option<Status>,
    model: Option<u32>,
    last_health: Option<(u64, Value)>,
}

impl<'a> Telemetry<'a> {
    /// For loads with their units, and sensors.
    pub fn new(
        shared: &'a Shared,
        topic: String,
        loads: Vec<(String, String)>,
        sensors: Vec<String>,
    ) -> Self {
        Self {
            shared,
            topic,
            statistics: vec![LoadStatistics::default(); loads.len()],
            faults: vec!["none"; loads.len()],
            nis: vec![(None, "none"); sensors.len()],
            loads,
            sensors,
            second: None,
            status: None,
            model: None,
            last_health: None,
        }
    }

    /// Takes a load.
    pub fn load(&mut self, index: usize, load: &Load) {
        if let Some(statistics) = self.statistics.get_mut(index) {
            statistics.push(load);
        }
        if let Some(fault) = self.faults.get_mut(index) {
            *fault = load.fault.name();
        }
    }

    /// Takes a sensor.
    pub fn sensor(&mut self, index: usize, sensor: &SensorFrame) {
        if let Some(slot) = self.nis.get_mut(index) {
            *slot = (sensor.nis(), sensor.fault.name());
        }
    }

    /// Takes a status.
    pub fn status(&mut self, newer: &Status, page: StatusPage) {
        self.status.get_or_insert_default().merge(newer, page);
        if let StatusPage::Image(hash) = page {
            self.model = Some(hash);
        }
    }

    /// Stores the messages of the second that has ended at `now_s`.
    ///
    /// # Errors
    /// When they cannot be stored.
    pub fn tick(&mut self, now_s: u64) -> io::Result<()> {
        let second = *self.second.get_or_insert(now_s);
        if second == now_s {
            return Ok(());
        }
        self.second = Some(now_s);
        self.health(now_s);
        let mut store = locked(&self.shared.store);
        let mut messages: Vec<(String, String)> = Vec::new();
        for ((load, unit), statistics) in self.loads.iter().zip(&mut self.statistics) {
            let sequence = store.next() + messages.len() as u64;
            let statistics = std::mem::take(statistics);
            if let Some(message) = statistics.message(sequence, second, (load, unit)) {
                let topic = format!("{}/loads/{load}", self.topic);
                messages.push((topic, serde_json::to_string(&message)?));
            }
        }
        if messages.is_empty() {
            return Ok(());
        }
        store.append(&messages)
    }

    /// Sets the health that is to be published, where it has changed or is [`HEALTH_S`] old.
    fn health(&mut self, now_s: u64) {
        let loads = (self.loads.iter().zip(&self.faults))
            .map(|((name, _), fault)| (name.clone(), json!({ "fault": fault })));
        let faults = (self.sensors.iter().zip(&self.nis))
            .map(|(name, (_, fault))| (name.clone(), json!({ "fault": fault })));
        let state = json!({
            "loads": loads.collect::<serde_json::Map<_, _>>(),
            "sensors": faults.collect::<serde_json::Map<_, _>>(),
            "machine_state": self.status.map(|status| status.state.name()),
            "model": self.model.map(|model| format!("{model:08x}")),
        });
        let is_due = self
            .last_health
            .as_ref()
            .is_none_or(|(t, last)| now_s.saturating_sub(*t) >= HEALTH_S || *last != state);
        if !is_due {
            return;
        }
        let mut health = json!({ "state": "online", "t": now_s });
        if let (Some(all), Some(state)) = (health.as_object_mut(), state.as_object()) {
            all.extend(state.clone());
            let status = self.status.unwrap_or_default();
            all.insert("overruns".into(), status.overruns.into());
            all.insert("missed".into(), status.missed.into());
            all.insert("bus_off".into(), status.bus_off.into());
            for (name, (nis, _)) in self.sensors.iter().zip(&self.nis) {
                if let Some(nis) = nis.filter(|nis| nis.is_finite()) {
                    all["sensors"][name]["nis"] = nis.into();
                }
            }
        }
        *locked(&self.shared.health) = Some(health.to_string());
        self.last_health = Some((now_s, state));
    }
}
