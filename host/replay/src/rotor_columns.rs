//! Computes the columns that the table of estimates has for a rotor beside its loads: speed, angle,
//! noise level, modal displacements, and displacements (m) at chosen nodes with standard
//! deviations.

use std::str::FromStr;

use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_design::image_build::Sensors;
use loadtwin_design::rotor::{NodeDeviations, RotorFilterDesign, Uncertainty};
use loadtwin_machine::{Kind, Machine};
use loadtwin_recording::{OutputColumn, Unit};

use super::ReplayError;

/// Nodes whose displacements are written: all, or some.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeChoice {
    /// Every node of the rotor.
    All,
    /// These, in this order.
    Some(Vec<usize>),
}

impl FromStr for NodeChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(Self::All);
        }
        (text.split(','))
            .map(|node| node.trim().parse())
            .collect::<Result<_, _>>()
            .map(Self::Some)
            .map_err(|_| {
                format!("found {text:?}, allowed: all, or node numbers with commas such as 3,17")
            })
    }
}

/// What is written of a rotor beside its loads.
pub struct NodeColumns {
    plan: RotorFilterDesign,
    deviations: NodeDeviations,
    chosen: Vec<usize>,
    modes: usize,
    displacements: Vec<f64>,
    spread: Vec<f64>,
}

impl NodeColumns {
    /// The nodes of `choice` on the rotor of `machine`.
    ///
    /// # Errors
    /// When the machine is no rotor, has no such node, or no filter can be made of it.
    pub fn new(
        machine: &Machine,
        sensors: &Sensors,
        choice: &NodeChoice,
    ) -> Result<Self, ReplayError> {
        let Some(Kind::Rotor(rotor)) = machine.kind() else {
            return Err(ReplayError::NoNodes(machine.name.clone()));
        };
        let nodes = rotor.nodes();
        let chosen = match choice {
            NodeChoice::All => (0..nodes).collect(),
            NodeChoice::Some(chosen) => chosen.clone(),
        };
        if let Some(found) = chosen.iter().copied().find(|node| *node >= nodes) {
            return Err(ReplayError::NoSuchNode {
                found,
                last: nodes - 1,
            });
        }
        let plan = RotorFilterDesign::new(machine, rotor, &sensors.channels)?;
        Ok(Self {
            deviations: plan.deviations(rotor, &sensors.channels)?,
            modes: plan.modes(),
            plan,
            chosen,
            displacements: vec![0.0; 2 * nodes],
            spread: vec![0.0; 2 * nodes],
        })
    }

    /// Whether a column is called so that is neither of a load, a sensor nor a node.
    pub(super) fn is_state(name: &str) -> bool {
        let is_mode = |mode: &str| mode.parse::<usize>().is_ok();
        ["speed", "angle", "noise_level"].contains(&name)
            || name.strip_prefix("modal").is_some_and(is_mode)
    }

    /// The columns: speed, angle, noise level, modal displacements, then for each node `x`, its
    /// standard deviation, `y` and its own.
    pub(super) fn columns(&self) -> Vec<OutputColumn> {
        let column = |name: String, unit| OutputColumn {
            name,
            unit,
            single: true,
        };
        let mut columns = vec![
            column("speed".into(), Unit::RADIAN_PER_SECOND),
            column("angle".into(), Unit::RADIAN),
            column("noise_level".into(), Unit::ONE),
        ];
        columns.extend((1..=self.modes).map(|mode| column(format!("modal{mode}"), Unit::ONE)));
        for node in &self.chosen {
            for axis in ["x", "y"] {
                columns.push(column(format!("node{node}_{axis}"), Unit::METRE));
                columns.push(column(format!("node{node}_{axis}_std"), Unit::METRE));
            }
        }
        columns
    }

    /// The values of a sample, after the step of the estimator `line`.
    pub(super) fn values(
        &mut self,
        estimate: &Estimate,
        line: &Estimator<'_>,
    ) -> impl Iterator<Item = f64> {
        let (state, speed) = (line.rotor_state(), line.rotor_speed());
        self.plan
            .displacements(state, f64::from(speed), &mut self.displacements);
        let uncertainty = Uncertainty {
            level: line.rotor_level(),
            tolerance: line.rotor_tolerance(),
            covariance: line.rotor_covariance(),
        };
        let place = self.plan.place_of_speed(f64::from(speed));
        self.deviations.fill(&uncertainty, place, &mut self.spread);
        let first = [speed, estimate.angle_rad, f32::from(line.rotor_level())];
        let modal = state.iter().take(self.modes);
        let (displacements, spread) = (&self.displacements, &self.spread);
        let nodes = self
            .chosen
            .iter()
            .flat_map(|node| [2 * node, 2 * node + 1].map(|i| [displacements[i], spread[i]]));
        (first.into_iter().chain(modal.copied()).map(f64::from)).chain(nodes.flatten())
    }
}

#[cfg(test)]
mod tests {
    use super::NodeChoice;

    #[test]
    fn nodes_are_all_or_numbers() {
        assert_eq!("all".parse(), Ok(NodeChoice::All));
        assert_eq!("3, 17".parse(), Ok(NodeChoice::Some(vec![3, 17])));
        let refused = "3-17".parse::<NodeChoice>().unwrap_err();
        assert!(
            refused.contains("3-17") && refused.contains("all"),
            "{refused}"
        );
    }
}
