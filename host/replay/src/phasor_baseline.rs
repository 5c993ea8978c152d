//! Estimates the forces on a rotor over a replay by inversion of the once-per-revolution (1x)
//! phasors of the sensors, averaged over four turns, as a baseline beside the filter. Computes the
//! NMAE of each load.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use faer::c64;
use loadtwin_common::io::estimate::Estimate;
use serde::Serialize;

use super::Sample;
use super::error_figures::segments;
use loadtwin_design::image_build::Sensors;
use loadtwin_design::rotor::PhasorInversion;
use loadtwin_machine::{Channel, Kind, Machine};
use loadtwin_math::metrics::LoadError;

/// Turns that are averaged.
const TURNS: f64 = 4.0;

/// Forces from the last `TURNS` turns, held until the next ones are over.
pub struct Phasor {
    inversion: Option<PhasorInversion>,
    channels: Vec<Channel>,
    period_s: f64,
    angle: Option<f64>,
    turned: f64,
    count: f64,
    /// Sum of `exp(-i angle)`, and of each reading and its product with that.
    pointer: c64,
    sums: Vec<(f64, c64)>,
    forces: Vec<c64>,
    /// For each reference its load's component, name, nominal value and error.
    loads: Vec<(usize, String, f64, LoadError)>,
}

/// Errors of one load, in the keys of `--json`.
#[derive(Clone, Debug, Serialize)]
pub struct PhasorFigures {
    /// Mean absolute error, full and by segment [% of the nominal load].
    pub nmae_percent: BTreeMap<String, Option<f64>>,
}

impl Phasor {
    /// Nothing gathered yet; nothing to gather on a machine that is no rotor.
    pub fn new(machine: &Machine, sensors: &Sensors) -> Self {
        let rotor = match machine.kind() {
            Some(Kind::Rotor(rotor)) => Some(rotor),
            _ => None,
        };
        let segments = segments(machine);
        let all = machine.loads();
        let loads = (machine.references.iter())
            .filter_map(|reference| {
                let at = all.iter().position(|load| load.name == reference.load)?;
                let error = LoadError::new(segments.clone());
                Some((at, reference.load.clone(), all[at].nominal, error))
            })
            .collect();
        Self {
            inversion: rotor.map(|rotor| PhasorInversion::new(rotor, &sensors.channels)),
            channels: sensors.channels.clone(),
            period_s: 1.0 / machine.rate_hz,
            angle: None,
            turned: 0.0,
            count: 0.0,
            pointer: c64::new(0.0, 0.0),
            sums: vec![(0.0, c64::new(0.0, 0.0)); sensors.channels.len()],
            forces: Vec::new(),
            loads,
        }
    }

    /// Adds one sample; one without all readings is left out.
    pub fn push(&mut self, sample: &Sample<'_>, estimate: &Estimate) {
        let Some(inversion) = &self.inversion else {
            return;
        };
        let angle = f64::from(estimate.angle_rad);
        let last = self.angle.replace(angle).unwrap_or(angle);
        self.turned += (angle - last + PI).rem_euclid(TAU) - PI;
        let readings = || estimate.sensors.iter().take(self.sums.len());
        if readings().all(|sensor| sensor.fault.is_none()) {
            let pointer = c64::new(angle.cos(), -angle.sin());
            let sensors = estimate.sensors.iter().zip(&self.channels);
            for ((sensor, channel), sum) in sensors.zip(&mut self.sums) {
                let runout = channel.to_si(channel.runout_at(angle));
                let reading = f64::from(sensor.measured) - runout;
                sum.0 += reading;
                sum.1 += pointer * reading;
            }
            self.pointer += pointer;
            self.count += 1.0;
        }
        if self.turned.abs() >= TURNS * TAU {
            let (n, speed) = (self.count, self.turned / (self.count * self.period_s));
            let amplitudes: Vec<c64> = (self.sums.iter())
                .map(|(sum, product)| (*product - self.pointer * (*sum / n)) * (2.0 / n))
                .collect();
            self.forces = inversion.forces(speed, &amplitudes).unwrap_or_default();
            self.turned = 0.0;
            self.count = 0.0;
            self.pointer = c64::new(0.0, 0.0);
            self.sums.fill((0.0, c64::new(0.0, 0.0)));
        }
        let pointer = c64::new(angle.cos(), angle.sin());
        for ((component, .., error), reference) in self.loads.iter_mut().zip(sample.references) {
            if let Some(force) = self.forces.get(*component / 2) {
                let turned = *force * pointer;
                let value = if *component % 2 == 0 {
                    turned.re
                } else {
                    turned.im
                };
                error.push(sample.segment_t, value, *reference);
            }
        }
    }

    /// Errors of each load that has a reference; empty for other machines.
    pub fn figures(&self) -> BTreeMap<String, PhasorFigures> {
        let known = self.inversion.iter().flat_map(|_| &self.loads);
        known
            .map(|(_, name, nominal, error)| {
                let mut nmae =
                    BTreeMap::from([("full".to_owned(), error.full().nmae_percent(*nominal))]);
                nmae.extend(
                    (error.segments())
                        .map(|(segment, f)| (segment.to_owned(), f.nmae_percent(*nominal))),
                );
                (name.clone(), PhasorFigures { nmae_percent: nmae })
            })
            .collect()
    }
}
