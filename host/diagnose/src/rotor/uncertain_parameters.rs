//! Lists the parameters of a rotor that are known only within a tolerance (modulus and damping of
//! the shaft, stiffness and damping of bearings, stiffness of acceleration) with their tolerances,
//! and changes them in a description.

use loadtwin_machine::Rotor;

/// A figure of the description.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UncertainParameter {
    /// Modulus of the shaft.
    Young,
    /// Damping of the shaft.
    Damping,
    /// Damping of the bearing of this number.
    BearingDamping(usize),
    /// Stiffness of the bearing of this number.
    BearingStiffness(usize),
    /// Stiffness of angular acceleration, which depends on how the rotor is driven.
    Acceleration,
}

impl UncertainParameter {
    /// All of `rotor`.
    pub fn all(rotor: &Rotor) -> Vec<Self> {
        let bearings = (0..rotor.bearings.len())
            .flat_map(|i| [Self::BearingDamping(i), Self::BearingStiffness(i)]);
        [Self::Young, Self::Damping, Self::Acceleration]
            .into_iter()
            .chain(bearings)
            .collect()
    }

    /// Whether any recording of a machine determines it better than its description; an error of a
    /// bearing's stiffness is an effect.
    pub fn is_nuisance(self) -> bool {
        !matches!(self, Self::BearingStiffness(_))
    }

    /// Part by which it is off, as a standard deviation.
    pub fn part(self) -> f64 {
        match self {
            Self::Young => 2e-3,
            Self::Damping | Self::BearingDamping(_) => 0.1,
            Self::BearingStiffness(_) => 5e-3,
            Self::Acceleration => 0.7,
        }
    }

    /// Multiplies it.
    pub fn scale(self, rotor: &mut Rotor, factor: f64) {
        match self {
            Self::Young => rotor
                .materials
                .iter_mut()
                .for_each(|m| m.young_pa *= factor),
            Self::Damping => rotor.sections.iter_mut().for_each(|section| {
                section.alpha_per_s *= factor;
                section.beta_s *= factor;
            }),
            Self::Acceleration => rotor.acceleration_stiffness *= factor,
            Self::BearingDamping(i) => {
                let bearing = &mut rotor.bearings[i];
                let table = bearing.table.iter_mut().map(|at| &mut at.damping_n_s_per_m);
                for damping in [&mut bearing.damping_n_s_per_m].into_iter().chain(table) {
                    damping.iter_mut().flatten().for_each(|c| *c *= factor);
                }
            }
            Self::BearingStiffness(i) => {
                let bearing = &mut rotor.bearings[i];
                let table = bearing.table.iter_mut().map(|at| &mut at.stiffness_n_per_m);
                for stiffness in bearing.stiffness_n_per_m.iter_mut().chain(table) {
                    stiffness.iter_mut().flatten().for_each(|k| *k *= factor);
                }
            }
        }
    }
}
