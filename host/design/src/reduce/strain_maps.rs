//! Computes the strain map of each gauge over the carrier angle (strain per N m): superposition of
//! the finite-element load cases, weighted by the forces of the equilibrium, at each candidate node
//! in the patch of the gauge.

use std::f64::consts::TAU;
use std::path::Path;

use faer::Mat;

use crate::reduce::equilibrium::{Force, HousingForces};
use crate::reduce::{Axis, LoadCase, Node, ReduceError, distance};
use loadtwin_machine::{Channel, Machine, Senses};

/// Size of each load case over the carrier angle, per N m of carrier torque.
///
/// `strain(theta) = sum_k forces(theta, k) strain_k`
///
/// Source: Bosmans et al. 2023, section 4.1.
pub struct Reduction {
    /// Entries over a turn x load cases.
    forces: Mat<f64>,
}

/// The maps of one gauge.
#[derive(Clone, Debug)]
pub struct GaugeMaps {
    /// Number of the channel in the machine.
    pub channel: usize,
    /// Node next to the gauge's described position: number of the first of `candidates`.
    pub node: u64,
    /// How far that node is from there (m).
    pub distance_m: f64,
    /// Node and sensitivity over the carrier angle [m/m/Nm], the nearest first.
    pub candidates: Vec<(u64, Vec<f64>)>,
}

impl GaugeMaps {
    /// Sensitivity over the carrier angle at the described position [m/m/Nm].
    pub fn described(&self) -> &[f64] {
        self.candidates.first().map_or(&[], |(_, map)| map)
    }

    /// Largest magnitude of that [m/m/Nm].
    pub fn peak(&self) -> f64 {
        self.described()
            .iter()
            .fold(0.0, |peak, m| peak.max(m.abs()))
    }
}

impl Reduction {
    /// Equilibrium of the machine's gears against the load cases in `path`, in
    /// `entries` steps of the carrier angle.
    ///
    /// A contact between two positions of the ring gear's load cases takes its
    /// influence by trigonometric interpolation over all positions, as the mean over
    /// the arc that its teeth share.
    ///
    /// # Errors
    /// When the machine has no gears, a load case is missing, twice there or of
    /// no known place, or those of the ring gear are not in equal steps.
    pub fn new(
        machine: &Machine,
        cases: &[LoadCase],
        path: &Path,
        entries: usize,
    ) -> Result<Self, ReduceError> {
        let gears = machine
            .drivetrain
            .as_ref()
            .and_then(|drivetrain| drivetrain.gears.as_ref())
            .ok_or_else(|| {
                ReduceError::misfit(
                    &machine.path,
                    "no [drivetrain.gears], from which forces follow",
                )
            })?;
        let known = |name: &str| name == "ring" || gears.bearings.iter().any(|b| b.name == name);
        if let Some(i) = cases.iter().position(|case| !known(&case.place)) {
            let names: Vec<&str> = gears.bearings.iter().map(|b| b.name.as_str()).collect();
            return Err(ReduceError::misfit(
                path,
                format!(
                    "step {}: found place {:?}, allowed: ring, {}",
                    i + 1,
                    cases[i].place,
                    names.join(", ")
                ),
            ));
        }
        let equilibrium = HousingForces::new(gears);
        let mut forces = Mat::zeros(entries, cases.len());
        for (bearing, force) in gears.bearings.iter().zip(&equilibrium.bearings) {
            for (axis, force) in AXES.into_iter().zip(force) {
                // A bearing that takes no force needs no load case.
                if *force == 0.0 {
                    continue;
                }
                let case = only(cases, &bearing.name, axis, path)?;
                for i in 0..entries {
                    forces[(i, case)] = force / cases[case].force_n;
                }
            }
        }
        let contact: [bool; 3] = [true, true, equilibrium.contact.axial != 0.0];
        for (axis, _) in AXES.into_iter().zip(contact).filter(|(_, needed)| *needed) {
            let ring = positions(cases, axis, path)?;
            for i in 0..entries {
                let carrier = TAU * i as f64 / entries as f64;
                for planet in &equilibrium.planets {
                    let angle = carrier + planet;
                    let force: Force = equilibrium.contact.at(angle);
                    for &k in &ring {
                        forces[(i, k)] += force[axis as usize]
                            * interpolation(
                                angle - cases[k].angle_rad,
                                ring.len(),
                                equilibrium.arc_rad,
                            )
                            / cases[k].force_n;
                    }
                }
            }
        }
        Ok(Self { forces })
    }

    /// Strain along `direction` at `node` over the carrier angle [m/m per N m at the carrier].
    pub fn map(&self, node: &Node, direction: [f64; 3]) -> Vec<f64> {
        let strain: Vec<f64> = (0..self.forces.ncols())
            .map(|case| node.along(direction, case))
            .collect();
        (0..self.forces.nrows())
            .map(|i| {
                strain
                    .iter()
                    .enumerate()
                    .map(|(k, e)| self.forces[(i, k)] * e)
                    .sum()
            })
            .collect()
    }

    /// The maps of every channel of `machine` that has a place, per N m of the
    /// shaft that it senses.
    ///
    /// # Errors
    /// When such a channel senses no shaft, or no node of `nodes` (from `path`) is in its patch.
    pub fn gauges(
        &self,
        machine: &Machine,
        nodes: &[Node],
        path: &Path,
    ) -> Result<Vec<GaugeMaps>, ReduceError> {
        let mut gauges = Vec::new();
        for (channel, described) in machine.channels.iter().enumerate() {
            let Some(place) = &described.place else {
                continue;
            };
            let carrier_per_sensed = carrier_per_sensed(machine, described)?;
            let mut patch: Vec<(f64, &Node)> = nodes
                .iter()
                .map(|node| (distance(node.position_m, place.position_m), node))
                .filter(|(distance, _)| *distance <= place.patch_m)
                .collect();
            patch.sort_by(|a, b| a.0.total_cmp(&b.0));
            let Some(&(distance_m, nearest)) = patch.first() else {
                return Err(ReduceError::misfit(
                    path,
                    format!(
                        "channel {}: no node with strain within {} m of {:?} m",
                        described.name, place.patch_m, place.position_m
                    ),
                ));
            };
            let candidates = patch
                .iter()
                .map(|(_, node)| {
                    let mut map = self.map(node, place.direction);
                    for m in &mut map {
                        *m *= carrier_per_sensed;
                    }
                    (node.number, map)
                })
                .collect();
            gauges.push(GaugeMaps {
                channel,
                node: nearest.number,
                distance_m,
                candidates,
            });
        }
        Ok(gauges)
    }
}

const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

/// Torque at the carrier per torque that `channel` senses.
fn carrier_per_sensed(machine: &Machine, channel: &Channel) -> Result<f64, ReduceError> {
    let shaft = match &channel.senses {
        Senses::Shaft(name) => machine
            .drivetrain
            .as_ref()
            .and_then(|d| d.shafts.iter().find(|s| s.name == *name)),
        _ => None,
    };
    shaft.map(|shaft| shaft.speed_ratio).ok_or_else(|| {
        ReduceError::misfit(
            &machine.path,
            format!(
                "channel {}: found senses other than a shaft, allowed: senses = {{ shaft = ... }} for a channel with a place",
                channel.name
            ),
        )
    })
}

/// The one load case at `place` along `axis`.
fn only(cases: &[LoadCase], place: &str, axis: Axis, path: &Path) -> Result<usize, ReduceError> {
    let found: Vec<usize> = (0..cases.len())
        .filter(|&k| cases[k].place == place && cases[k].axis == axis)
        .collect();
    match found[..] {
        [case] => Ok(case),
        _ => Err(ReduceError::misfit(
            path,
            format!(
                "found {} load cases at {place:?} along {axis:?}, allowed: 1",
                found.len()
            ),
        )),
    }
}

/// The load cases of the ring gear along `axis`; refused unless in equal steps.
fn positions(cases: &[LoadCase], axis: Axis, path: &Path) -> Result<Vec<usize>, ReduceError> {
    let mut ring: Vec<usize> = (0..cases.len())
        .filter(|&k| cases[k].place == "ring" && cases[k].axis == axis)
        .collect();
    let turned = |k: usize| cases[k].angle_rad.rem_euclid(TAU);
    ring.sort_by(|a, b| turned(*a).total_cmp(&turned(*b)));
    if ring.len() < 8 {
        return Err(ReduceError::misfit(
            path,
            format!(
                "found {} load cases on the ring along {axis:?}, allowed: at least 8 in equal steps",
                ring.len()
            ),
        ));
    }
    let step = TAU / ring.len() as f64;
    for (i, &k) in ring.iter().enumerate() {
        let expected = turned(ring[0]) + step * i as f64;
        if (turned(k) - expected).abs() > 1e-3 * step {
            return Err(ReduceError::misfit(
                path,
                format!(
                    "step {}: found the ring at {:.4} degrees, allowed: {:.4}, as {} positions along {axis:?} in equal steps",
                    k + 1,
                    turned(k).to_degrees(),
                    expected.to_degrees(),
                    ring.len()
                ),
            ));
        }
    }
    Ok(ring)
}

/// Weight of a value at distance `x` [rad] in the trigonometric interpolation of
/// `n` values over a turn, as the mean over an arc of width `arc` [rad].
///
/// `D(x) = 1/n (1 + 2 sum_(k < n/2) c_k cos(k x) + c_(n/2) cos(n x/2))`, `c_k = sin(k arc/2) /
/// (k arc/2)`; the last term for even n only.
fn interpolation(x: f64, n: usize, arc: f64) -> f64 {
    let term = |k: usize| {
        let (order, half) = (k as f64, 0.5 * k as f64 * arc);
        let mean = if half == 0.0 { 1.0 } else { half.sin() / half };
        mean * (order * x).cos()
    };
    let inner: f64 = (1..n.div_ceil(2)).map(term).sum();
    let last = if n.is_multiple_of(2) {
        term(n / 2)
    } else {
        0.0
    };
    (1.0 + 2.0 * inner + last) / n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_is_exact_below_half_the_positions() {
        for (n, arc) in [(12_usize, 0.0), (13, 0.0), (12, 0.6)] {
            // The mean over an arc of each order, in closed form.
            let mean = |order: f64| {
                if arc == 0.0 {
                    1.0
                } else {
                    (0.5 * order * arc).sin() / (0.5 * order * arc)
                }
            };
            let value = |angle: f64, spread: bool| {
                let factor = |order| if spread { mean(order) } else { 1.0 };
                0.3 + factor(5.0) * (5.0 * angle + 0.4).cos()
                    - 2.0 * factor(2.0) * (2.0 * angle).sin()
            };
            for i in -40..40 {
                let angle = 0.317 * f64::from(i);
                let found: f64 = (0..n)
                    .map(|k| TAU * k as f64 / n as f64 + 0.1)
                    .map(|at| value(at, false) * interpolation(angle - at, n, arc))
                    .sum();
                assert!((found - value(angle, true)).abs() < 1e-12, "{n} {angle}");
            }
        }
    }
}
