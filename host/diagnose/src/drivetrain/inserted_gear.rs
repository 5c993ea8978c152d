//! Inserts a gear into a drivetrain: splits a shaft in two, and puts a small inertia between the
//! halves that is taken from its neighbours.

use loadtwin_machine::{Drivetrain, Inertia, Shaft};

/// The same chain with a gear in shaft `s`, between two equal halves of it, with the moment
/// `part` of the smaller neighbour's, half taken from each. The half behind the gear keeps the
/// shaft's name: a mesh, whose torque gauges sense, is behind its gear.
#[must_use]
pub(super) fn with_gear(chain: &Drivetrain, s: usize, part: f64) -> Drivetrain {
    let mut with = chain.clone();
    let neighbours = [s, s + 1].map(|i| chain.inertias[i].referred_moment());
    let moment = part * neighbours[0].min(neighbours[1]);
    for neighbour in &mut with.inertias[s..=s + 1] {
        neighbour.moment_kg_m2 -= 0.5 * moment / neighbour.speed_ratio.powi(2);
    }
    let gear = Inertia {
        name: format!("{}_gear", chain.shafts[s].name),
        moment_kg_m2: moment,
        moment_std_kg_m2: None,
        speed_ratio: 1.0,
        drag_nm_s_per_rad: 0.0,
        drag_std_nm_s_per_rad: None,
        friction: None,
    };
    with.inertias.insert(s + 1, gear);
    let behind = &mut with.shafts[s];
    behind.stiffness_nm_per_rad *= 2.0;
    behind.damping_nm_s_per_rad *= 2.0;
    for std in [
        &mut behind.stiffness_std_nm_per_rad,
        &mut behind.damping_std_nm_s_per_rad,
    ] {
        *std = std.map(|std| 2.0 * std);
    }
    let before = Shaft {
        name: format!("{}_before_gear", behind.name),
        ..behind.clone()
    };
    with.shafts.insert(s, before);
    with
}
