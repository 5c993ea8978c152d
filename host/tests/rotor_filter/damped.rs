//! Rotor filter on heavily damped bearings (soft springs with dampers, squeeze films, films that
//! couple x and y): the reduced model loses less than 1.5 % of a start, and settled displacements
//! err by at most 0.2 µm (unbalances) or 2.4 µm (random walks).

use loadtwin::image_build::Sensors;
use loadtwin::machine::{Coefficients, LoadKind, Machine};
use loadtwin::rotor::RotorFilterDesign;

use super::{Case, machine};

/// Stiffness [N/m] and damping [N s/m] of both bearings of the paper's rotor: as heavy as the plant's
/// modes show dampers to 0.1 µm.
const BEARINGS: [(&str, Coefficients, Coefficients); 5] = [
    (
        "dampers, soft",
        [[2e5, 0.0], [0.0, 2e5]],
        [[2e3, 0.0], [0.0, 2e3]],
    ),
    (
        "dampers",
        [[1e6, 0.0], [0.0, 1e6]],
        [[2e3, 0.0], [0.0, 2e3]],
    ),
    (
        "squeeze films",
        [[1e6, 0.0], [0.0, 1e6]],
        [[5e3, 0.0], [0.0, 5e3]],
    ),
    (
        "squeeze films, softer",
        [[5e5, 0.0], [0.0, 1e6]],
        [[5e3, 0.0], [0.0, 4e3]],
    ),
    (
        "fluid films",
        [[5e6, 5e5], [-5e5, 8e6]],
        [[5e3, -5e2], [-5e2, 7e3]],
    ),
];

fn with(name: &str, stiffness: Coefficients, damping: Coefficients) -> Machine {
    let mut machine = machine();
    machine.name = name.into();
    for bearing in &mut machine.rotor.as_mut().unwrap().bearings {
        bearing.stiffness_n_per_m = Some(stiffness);
        bearing.damping_n_s_per_m = damping;
    }
    machine
}

/// Part of a start's motion that the reduction loses, and errors after the start: about what they
/// are on bearings that let everything swing.
#[test]
fn what_bearings_damp_too_much_to_swing_is_not_lost() {
    for (name, stiffness, damping) in BEARINGS {
        let machine = with(name, stiffness, damping);
        let sensors = Sensors::choose(&machine, None).unwrap();
        let rotor = machine.rotor.as_ref().unwrap();
        let plan = RotorFilterDesign::new(&machine, rotor, &sensors.channels).unwrap();
        let reduction = plan.reduction_error();
        let lost = reduction.error_m / reduction.peak_m;
        println!("{name}: {:.2} % of a start lost", 100.0 * lost);
        assert!(lost < 0.015, "{name}: {lost}");
        for (kind, settled_um) in [(LoadKind::Unbalance, 0.2), (LoadKind::Walk, 2.4)] {
            let outcome = Case::noisy(kind, 1e-7).run(machine.clone(), 3);
            assert!(
                outcome.settled_um <= settled_um,
                "{name}, {kind:?}: {}",
                outcome.settled_um
            );
            assert!(
                outcome.start_um <= 4.0,
                "{name}, {kind:?}: {}",
                outcome.start_um
            );
        }
    }
}
