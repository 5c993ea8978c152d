//! Injects friction into the simulated drivetrain that the model lacks: Coulomb, Stribeck, viscous
//! and pre-sliding (Dahl) friction on the first inertia, load-dependent losses in each mesh.

use crate::chain_parameters::Presliding;
use crate::injected_effect::{Apply, Effect};

/// `torque sign(w)` on the first inertia.
pub(crate) const COULOMB: Effect = Effect {
    name: "coulomb-friction",
    typical: "2 % of nominal torque on the first inertia",
    apply: Apply::Drivetrain(|chain, dose| {
        chain.bodies[0].coulomb += 0.02 * dose.strength * chain.nominal_torque;
        true
    }),
};

/// `torque exp(-(w/ws)^2) sign(w)`, `ws` the described `stribeck_rad_s`, else 5 % of nominal speed.
pub(crate) const STRIBECK: Effect = Effect {
    name: "stribeck-friction",
    typical: "4 % of nominal torque at standstill, fading over 5 % of nominal speed",
    apply: Apply::Drivetrain(|chain, dose| {
        chain.bodies[0].stribeck += 0.04 * dose.strength * chain.nominal_torque;
        true
    }),
};

/// `c w` on the first inertia.
pub(crate) const VISCOUS: Effect = Effect {
    name: "viscous-friction",
    typical: "2 % of nominal torque at nominal speed on the first inertia",
    apply: Apply::Drivetrain(|chain, dose| {
        chain.bodies[0].viscous +=
            0.02 * dose.strength * chain.nominal_torque / chain.nominal_speed;
        true
    }),
};

/// Each mesh loses a part of the torque that it carries.
pub(crate) const LOAD_DEPENDENT: Effect = Effect {
    name: "load-friction",
    typical: "each mesh loses 2 % of its torque",
    apply: Apply::Drivetrain(|chain, dose| {
        for shaft in &mut chain.shafts {
            shaft.loss = (shaft.loss + 0.02 * dose.strength).min(0.9);
        }
        !chain.shafts.is_empty()
    }),
};

/// Dahl's model on the first inertia: friction that builds up over an angle.
pub(crate) const PRESLIDING: Effect = Effect {
    name: "presliding-hysteresis",
    typical: "Dahl friction of 2 % of nominal torque on the first inertia",
    apply: Apply::Drivetrain(|chain, dose| {
        chain.presliding.push(Presliding {
            body: 0,
            torque: 0.02 * dose.strength * chain.nominal_torque,
            // Broken away after 2 ms at nominal speed.
            angle: 0.002 * chain.nominal_speed,
        });
        true
    }),
};
