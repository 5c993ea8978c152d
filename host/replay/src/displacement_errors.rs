//! Computes the errors of a rotor's estimated displacements at every node against the true ones in
//! a recording: maximum and RMS for each segment, for `--json` and as plots over the nodes. Also
//! counts the samples with a raised noise level, notes an unstable rotor, and passes the
//! displacements to `orbits.rs`.

use std::collections::BTreeMap;

use loadtwin_common::estimator::Estimator;
use serde::Serialize;

use super::Sample;
use super::orbits::Orbits;
use loadtwin_design::image_build::{BuildError, Sensors};
use loadtwin_design::rotor::RotorFilterDesign;
use loadtwin_machine::{Kind, Machine};
use loadtwin_math::metrics::Segment;
use loadtwin_report::{Axis, Data, Plot, PlotSize, Role, Section, Series};

/// The columns of the true displacements: `node0_x`, `node0_y`, `node1_x`, ... (m).
pub fn displacement_columns(machine: &Machine) -> Vec<String> {
    match machine.kind() {
        Some(Kind::Rotor(rotor)) => (0..rotor.nodes())
            .flat_map(|node| ["x", "y"].map(|axis| format!("node{node}_{axis}")))
            .collect(),
        _ => Vec::new(),
    }
}

/// Errors of the displacements of one replay, gathered sample by sample.
pub struct Displacements {
    plan: Option<RotorFilterDesign>,
    orbits: Option<Orbits>,
    segments: Vec<Segment>,
    estimate: Vec<f64>,
    /// For each segment, the full recording first, and each node.
    errors: Vec<Vec<Error>>,
    peak: f64,
    samples: u64,
    mismatched: u64,
}

#[derive(Clone, Copy, Default)]
struct Error {
    largest: f64,
    squares: f64,
    count: u64,
}

/// One node's errors, in the keys of `--json`: full and by segment (µm).
#[derive(Clone, Debug, Serialize)]
pub struct NodeFigures {
    /// Largest error in either direction (µm).
    pub max_um: BTreeMap<String, f64>,
    /// Root mean square of both directions (µm).
    pub rms_um: BTreeMap<String, f64>,
}

impl Displacements {
    /// Nothing gathered yet; nothing to gather on a machine that is no rotor.
    ///
    /// # Errors
    /// When no model can be made of the rotor.
    pub fn new(machine: &Machine, sensors: &Sensors) -> Result<Self, BuildError> {
        let rotor = match machine.kind() {
            Some(Kind::Rotor(rotor)) => Some(rotor),
            _ => None,
        };
        let plan = rotor
            .map(|r| RotorFilterDesign::new(machine, r, &sensors.channels))
            .transpose()?;
        let nodes = plan.as_ref().map_or(0, RotorFilterDesign::nodes);
        let mut segments = vec![Segment {
            name: "full".into(),
            from_s: f64::NEG_INFINITY,
            to_s: f64::INFINITY,
        }];
        segments.extend(super::error_figures::segments(machine));
        // The whole recording where it has no parts.
        let parts = &segments[usize::from(segments.len() > 1)..];
        Ok(Self {
            orbits: rotor.map(|rotor| Orbits::new(machine, rotor, parts)),
            errors: vec![vec![Error::default(); nodes]; segments.len()],
            estimate: vec![0.0; 2 * nodes],
            plan,
            segments,
            peak: 0.0,
            samples: 0,
            mismatched: 0,
        })
    }

    /// Adds one sample, after the step of the estimator `line`.
    pub fn push(&mut self, sample: &Sample<'_>, line: &Estimator<'_>) {
        let (Some(plan), Some(orbits)) = (&self.plan, &mut self.orbits) else {
            return;
        };
        self.samples += 1;
        self.mismatched += u64::from(line.rotor_level() > 0);
        let speed = f64::from(line.rotor_speed());
        plan.displacements(line.rotor_state(), speed, &mut self.estimate);
        orbits.push(sample.segment_t, &self.estimate, sample.displacements);
        for (segment, errors) in self.segments.iter().zip(&mut self.errors) {
            if !(segment.from_s..segment.to_s).contains(&sample.segment_t) {
                continue;
            }
            for (k, (estimate, truth)) in
                (self.estimate.iter().zip(sample.displacements)).enumerate()
            {
                if truth.is_finite() {
                    errors[k / 2].push(estimate - truth);
                    self.peak = self.peak.max(truth.abs());
                }
            }
        }
    }

    /// Errors of the displacements over the nodes, and orbits, for each part of the recording; none for
    /// other machines.
    pub fn sections(&self) -> Vec<Section> {
        let orbits = self.orbits.iter().flat_map(Orbits::sections);
        self.error_section().into_iter().chain(orbits).collect()
    }

    /// Error at every node; none without true displacements.
    fn error_section(&self) -> Option<Section> {
        let nodes: Vec<usize> = (0..self.errors.first().map_or(0, Vec::len))
            .filter(|node| self.errors[0][*node].count > 0)
            .collect();
        // The whole recording last: its errors are the largest.
        let roles = [
            Role::Estimate,
            Role::Measured,
            Role::Innovation,
            Role::Other,
        ];
        let plot = |title: &str, of: fn(&Error) -> f64| Plot {
            title: title.into(),
            size: PlotSize::Half,
            x: Axis::new("Node", ""),
            y: Axis::new("Error of the displacement", "µm"),
            data: Data::Own {
                x: nodes.iter().map(|node| *node as f64).collect(),
                series: (self.segments.iter().zip(&self.errors).enumerate())
                    .map(|(k, (segment, errors))| {
                        let values = nodes.iter().map(|node| 1e6 * of(&errors[*node]));
                        let role = roles[k.min(roles.len() - 1)];
                        (Series::line(&segment.name, role), values.collect())
                    })
                    .collect(),
            },
            ..Plot::default()
        };
        (!nodes.is_empty()).then(|| Section {
            title: "Displacements".into(),
            note: "Estimated against true displacement, both directions, at every node of the shaft; a node \
                   without a sensor is estimated from the others."
                .into(),
            open: true,
            tables: Vec::new(),
            plots: vec![
                plot("Largest error", |e| e.largest),
                plot("RMS error", Error::rms),
            ],
        })
    }

    /// One line where the rotor as described is unstable.
    pub fn note(&self) -> Option<String> {
        Some(self.plan.as_ref()?.instability()?.note())
    }

    /// Samples in which the rotor was estimated as one that is not as described.
    pub fn doubted_samples(&self) -> u64 {
        self.mismatched
    }

    /// Where there were such, that in one line.
    pub fn doubt_note(&self) -> Option<String> {
        let percent = 100.0 * self.mismatched as f64 / self.samples as f64;
        (self.mismatched > 0).then(|| {
            format!(
                "model: in {percent:.0} % of the samples the innovations contradict the description, which \
                 is held to less closely there: noise goes further into the estimates; `loadtwin diagnose` \
                 looks for the cause"
            )
        })
    }

    /// Largest displacement of the recording at any node (m).
    pub fn peak_m(&self) -> f64 {
        self.peak
    }

    /// The nodes that the recording has displacements of, by name.
    pub fn nodes(&self) -> BTreeMap<String, NodeFigures> {
        let nodes = self.errors.first().map_or(0, Vec::len);
        (0..nodes)
            .filter(|node| self.errors[0][*node].count > 0)
            .map(|node| {
                let by_segment = |of: fn(&Error) -> f64| {
                    (self.segments.iter().zip(&self.errors))
                        .filter(|(_, errors)| errors[node].count > 0)
                        .map(|(segment, errors)| (segment.name.clone(), 1e6 * of(&errors[node])))
                        .collect()
                };
                let figures = NodeFigures {
                    max_um: by_segment(|e| e.largest),
                    rms_um: by_segment(Error::rms),
                };
                (format!("node{node}"), figures)
            })
            .collect()
    }

    /// Largest error over all nodes, full and by segment (m).
    pub fn worst_m(&self) -> BTreeMap<String, f64> {
        (self.segments.iter().zip(&self.errors))
            .filter(|(_, errors)| errors.iter().any(|e| e.count > 0))
            .map(|(segment, errors)| {
                let largest = errors.iter().map(|e| e.largest).fold(0.0, f64::max);
                (segment.name.clone(), largest)
            })
            .collect()
    }
}

impl Error {
    fn rms(&self) -> f64 {
        (self.squares / self.count as f64).sqrt()
    }

    fn push(&mut self, error: f64) {
        // An estimate that is no number must not look like none.
        self.largest = if error.is_nan() {
            f64::INFINITY
        } else {
            self.largest.max(error.abs())
        };
        self.squares += error * error;
        self.count += 1;
    }
}
