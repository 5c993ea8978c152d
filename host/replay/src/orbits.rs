//! Plots the orbits of a rotor's shaft, estimated and true, for the report of a replay: y over x in
//! µm at ends, bearings, loads and sensors, for each segment of the recording.

use loadtwin_machine::{Machine, Rotor, Senses};
use loadtwin_math::metrics::Segment;
use loadtwin_report::{Axis, Data, Mark, Plot, PlotSize, Role, ScatterSample, Section, Series};

/// Points of an orbit, estimated and true ones together.
const POINTS: usize = 1500;

/// Orbits of some nodes in each part of a recording.
pub(super) struct Orbits {
    nodes: Vec<usize>,
    /// Whether any true displacement was there.
    known: bool,
    parts: Vec<(Segment, Vec<ScatterSample>)>,
}

impl Orbits {
    /// At the ends, bearings, loads and sensors of `rotor`, for each of `parts`.
    pub fn new(machine: &Machine, rotor: &Rotor, parts: &[Segment]) -> Self {
        let mut nodes = vec![0, rotor.nodes() - 1];
        nodes.extend(rotor.bearings.iter().map(|bearing| bearing.node));
        nodes.extend(rotor.loads.iter().map(|load| load.node));
        nodes.extend(machine.channels.iter().filter_map(|c| match &c.senses {
            Senses::Displacement(at) => Some(at.node),
            _ => None,
        }));
        nodes.sort_unstable();
        nodes.dedup();
        let empty = vec![ScatterSample::new(POINTS); nodes.len()];
        Self {
            parts: parts.iter().map(|p| (p.clone(), empty.clone())).collect(),
            known: false,
            nodes,
        }
    }

    /// Adds the displacements of all nodes at time `t` [s], along x and y, node by node [m].
    pub fn push(&mut self, t: f64, estimate: &[f64], truth: &[f64]) {
        for (part, samples) in &mut self.parts {
            if !(part.from_s..part.to_s).contains(&t) {
                continue;
            }
            for (node, sample) in self.nodes.iter().zip(samples) {
                let at = |q: &[f64]| {
                    let along = |k: usize| q.get(2 * node + k).map_or(f64::NAN, |q| 1e6 * q);
                    [along(0), along(1)]
                };
                let ([x, y], [true_x, true_y]) = (at(estimate), at(truth));
                sample.push(&[x, y, f64::NAN]);
                sample.push(&[true_x, f64::NAN, true_y]);
                self.known |= true_x.is_finite();
            }
        }
    }

    /// A section of plots for each part.
    pub fn sections(&self) -> Vec<Section> {
        (self.parts.iter().enumerate())
            .map(|(k, (part, samples))| Section {
                title: format!("Orbits, {}", part.name),
                note:
                    "Displacement along y over that along x at ends, bearings, loads and sensors."
                        .into(),
                open: k + 1 == self.parts.len(),
                tables: Vec::new(),
                plots: (self.nodes.iter().zip(samples))
                    .map(|(node, sample)| self.plot(*node, sample))
                    .collect(),
            })
            .collect()
    }

    fn plot(&self, node: usize, sample: &ScatterSample) -> Plot {
        let mut columns = sample.columns().into_iter();
        let mut next = || columns.next().unwrap_or_default();
        let (x, estimate, reference) = (next(), next(), next());
        let mut series = vec![(
            Series::new("estimate", Role::Estimate, Mark::Points),
            estimate,
        )];
        if self.known {
            let reference = (
                Series::new("reference", Role::Reference, Mark::Points),
                reference,
            );
            series.push(reference);
        }
        Plot {
            title: format!("Node {node}"),
            size: PlotSize::Third,
            x: Axis::new("x", "µm"),
            y: Axis::new("y", "µm"),
            data: Data::Own { x, series },
            ..Plot::default()
        }
    }
}
