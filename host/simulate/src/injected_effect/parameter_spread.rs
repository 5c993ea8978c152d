//! Injects a spread of the drivetrain's parameters: multiplies each inertia, stiffness, damping and
//! drag of the plant by a random factor.

use rand::RngExt;
use rand_distr::StandardNormal;

use crate::chain_parameters::Chain;
use crate::injected_effect::{Acted, Apply, Dose, Effect};

/// Each inertia, stiffness, damping and drag times `1 + 0.1 s n`, `n` normal.
///
/// Source: Bosmans et al. 2023, section 5.3.2.
pub(crate) const SPREAD: Effect = Effect {
    name: "parameter-spread",
    typical: "standard deviation of 10 % on each inertia, stiffness, damping and drag",
    apply: Apply::Drivetrain(apply),
};

fn apply(chain: &mut Chain, dose: &mut Dose) -> Acted {
    let strength = dose.strength;
    // A parameter stays positive whatever is drawn.
    let mut factor = || {
        let n: f64 = dose.draw.individual.sample(StandardNormal);
        (1.0 + 0.1 * strength * n).clamp(0.3, 3.0)
    };
    for body in &mut chain.bodies {
        body.inertia *= factor();
        body.viscous *= factor();
    }
    for shaft in &mut chain.shafts {
        shaft.stiffness *= factor();
        shaft.damping *= factor();
    }
    true
}
