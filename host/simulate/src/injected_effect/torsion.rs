//! Injects torsional effects into the simulated drivetrain: backlash, varying mesh stiffness,
//! torque ripple, resonance of a heavier gear between shaft and mesh.

use std::f64::consts::TAU;

use rand::RngExt;

use crate::chain_parameters::{Chain, Ripple};
use crate::injected_effect::{Acted, Apply, Dose, Effect};

/// A dead zone in the mesh of every shaft, 20 % of its twist at nominal torque.
pub(crate) const BACKLASH: Effect = Effect {
    name: "backlash",
    typical: "play of 20 % of the twist at nominal torque in each mesh",
    apply: Apply::Drivetrain(|chain, dose| {
        let nominal = chain.nominal_torque;
        for shaft in &mut chain.shafts {
            shaft.backlash = 0.2 * dose.strength * nominal / shaft.stiffness;
        }
        !chain.shafts.is_empty()
    }),
};

/// Stiffness of each mesh times `1 + 0.02 s cos(99 angle)`.
pub(crate) const MESH_STIFFNESS: Effect = Effect {
    name: "mesh-stiffness",
    typical: "stiffness of each mesh varies by 2 % with every tooth",
    apply: Apply::Drivetrain(|chain, dose| {
        for shaft in &mut chain.shafts {
            shaft.variation = (0.02 * dose.strength).min(0.5);
        }
        !chain.shafts.is_empty()
    }),
};

/// `0.01 s nominal cos(order angle + phase)` on the last inertia (cogging).
pub(crate) const RIPPLE: Effect = Effect {
    name: "torque-ripple",
    typical: "torque of 1 % of nominal over the shaft angle, order 6 to 24",
    apply: Apply::Drivetrain(ripple),
};

/// The gear between the first shaft and its mesh gains 20 % of its smaller neighbour's inertia.
pub(crate) const RESONANCE: Effect = Effect {
    name: "torsional-resonance",
    typical: "a gear with 20 % of its smaller neighbour's inertia in the first shaft",
    apply: Apply::Drivetrain(|chain, dose| {
        chain.shafts.first_mut().is_some_and(|shaft| {
            shaft.gear = (shaft.gear + 0.2 * dose.strength).min(0.5);
            true
        })
    }),
};

fn ripple(chain: &mut Chain, dose: &mut Dose) -> Acted {
    let rng = &mut dose.draw.individual;
    chain.ripples.push(Ripple {
        body: chain.bodies.len() - 1,
        amplitude: 0.01 * dose.strength * chain.nominal_torque,
        order: f64::from(rng.random_range(6..=24)),
        phase: TAU * rng.random::<f64>(),
    });
    true
}
