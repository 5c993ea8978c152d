//! Candidate effects, friction that the model lacks at one inertia or between two neighbours:
//! Coulomb, Stribeck, viscous, load-dependent or presliding. Regressor: the resisting torque by its
//! law and the measured motion, as it shows in the torque balance and the strains.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::decimated_signals::Signals;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Kind, Regressor, ResidualSignal};
use loadtwin_machine::{CREEP, Inertia, Machine};

const BODY: NonlinearParameter = NonlinearParameter {
    name: "inertia",
    unit: "number",
    bounds: (0.0, 6.0),
    step: 0.0,
    logarithmic: false,
};

/// The same of friction that two neighbouring inertias share: 0.3 is 70 % on the first and 30 % on
/// the second.
const PLACE: NonlinearParameter = NonlinearParameter { step: 0.3, ..BODY };

/// Distance from one inertia, in steps from one to the next, within which the friction acts on it
/// alone.
const AT_ONE: f64 = 0.1;

/// Part of the vibration it excites that is modelled: 0 where it sticks and slips otherwise than
/// the chain would respond to a known torque, 1 where the chain responds so.
pub(crate) const SETS_OFF: NonlinearParameter = NonlinearParameter {
    name: "vibration modelled",
    unit: "part",
    bounds: (0.0, 1.0),
    step: 0.0,
    logarithmic: false,
};

/// Speed over which the torque changes sign about standstill: a regularisation, not a physical
/// parameter.
const REGULARISATION: NonlinearParameter = NonlinearParameter {
    name: "speed below which it creeps",
    unit: "part of nominal",
    bounds: (1e-4, 0.03),
    step: 0.8,
    logarithmic: true,
};

/// A torque that resists one inertia: `a u`, with `u` by its law.
pub struct Friction {
    info: EffectInfo,
    /// Values of the law's own parameter from which the search starts; none
    /// where it has none.
    starts: &'static [f64],
    /// Torque, part of its size.
    law: Law,
}

/// Dependence of the friction torque on the motion.
enum Law {
    /// Dry: it holds the inertia at standstill. Speeds in parts of nominal, angles of the main shaft.
    Dry(fn(&[f64]) -> loadtwin_machine::Friction),
    /// In proportion to speed.
    Drag,
    /// In proportion to what a mesh carries.
    Load,
}

const NONE: loadtwin_machine::Friction = loadtwin_machine::Friction {
    coulomb_nm: 0.0,
    load_part: 0.0,
    stribeck_nm: 0.0,
    stribeck_rad_s: None,
    presliding_rad: 0.0,
};

/// A torque of 1 at every speed.
const ONE: loadtwin_machine::Friction = loadtwin_machine::Friction {
    coulomb_nm: 1.0,
    ..NONE
};

/// All of the torque carried.
const ALL: loadtwin_machine::Friction = loadtwin_machine::Friction {
    load_part: 1.0,
    ..NONE
};

/// `a sign(w)`.
pub const COULOMB: Friction = Friction {
    info: EffectInfo {
        name: "coulomb-friction",
        description: "a torque that brakes with the same size at every speed",
        scope: Scope::Machine,
        linear: &[LinearParameter {
            name: "part of nominal torque",
            prior_std: 0.1,
        }],
        nonlinear: &[PLACE, REGULARISATION, SETS_OFF],
        recommended_experiment: "slow turning both ways without load, with standstill between",
    },
    starts: &[],
    law: Law::Dry(|_| ONE),
};

/// `a exp(-(|w| / w_s)^1.5) sign(w)`: what sticking adds near standstill.
pub const STRIBECK: Friction = Friction {
    info: EffectInfo {
        name: "stribeck-friction",
        description: "a torque that brakes near standstill and fades with speed",
        scope: Scope::Machine,
        linear: &[LinearParameter {
            name: "part of nominal torque",
            prior_std: 0.1,
        }],
        nonlinear: &[
            PLACE,
            NonlinearParameter {
                name: "speed over which it fades",
                unit: "part of nominal",
                bounds: (0.01, 0.5),
                step: 0.3,
                logarithmic: true,
            },
            REGULARISATION,
            SETS_OFF,
        ],
        recommended_experiment: "very slow starts and stops both ways",
    },
    starts: &[0.02, 0.05, 0.12, 0.3],
    law: Law::Dry(|shape| loadtwin_machine::Friction {
        stribeck_nm: 1.0,
        stribeck_rad_s: Some(shape[1]),
        ..NONE
    }),
};

/// `a w`.
pub const VISCOUS: Friction = Friction {
    info: EffectInfo {
        name: "viscous-friction",
        description: "a torque that brakes in proportion to speed",
        scope: Scope::Machine,
        linear: &[LinearParameter {
            name: "part of nominal torque",
            prior_std: 0.1,
        }],
        nonlinear: &[BODY],
        recommended_experiment: "several speeds without load",
    },
    starts: &[],
    law: Law::Drag,
};

/// `a |level| sign(w)`: loss of a mesh in proportion to the torque carried.
pub const LOAD_DEPENDENT: Friction = Friction {
    info: EffectInfo {
        name: "load-friction",
        description: "a mesh loses a part of the torque that it carries",
        scope: Scope::Machine,
        linear: &[LinearParameter {
            name: "part of nominal torque",
            prior_std: 0.1,
        }],
        nonlinear: &[BODY],
        recommended_experiment: "torque ramps at constant speed, both ways",
    },
    starts: &[],
    law: Law::Load,
};

/// Friction that builds up over an angle: `du = (d(angle) - |d(angle)| u) / width`
/// (Dahl; Bouc-Wen with exponent 1).
pub const PRESLIDING: Friction = Friction {
    info: EffectInfo {
        name: "presliding-hysteresis",
        description: "friction that builds up over an angle and stays at standstill",
        scope: Scope::Machine,
        linear: &[LinearParameter {
            name: "part of nominal torque",
            prior_std: 0.1,
        }],
        nonlinear: &[
            PLACE,
            NonlinearParameter {
                name: "angle over which it builds up",
                unit: "rad of the main shaft",
                bounds: (1e-4, 2.0),
                step: 0.5,
                logarithmic: true,
            },
            SETS_OFF,
        ],
        recommended_experiment: "reversals of several sizes at low speed, with standstill between",
    },
    starts: &[0.001, 0.005, 0.025, 0.1],
    law: Law::Dry(|shape| loadtwin_machine::Friction {
        presliding_rad: shape[1],
        ..ONE
    }),
};

impl Effect<DrivetrainResiduals> for Friction {
    fn info(&self) -> &EffectInfo {
        &self.info
    }
    fn parameter_count(&self) -> usize {
        self.linear_parameters().len() + self.info.nonlinear.len()
            - usize::from(self.regularisation().is_some())
    }
    /// Each inertia with each start, where the torque balance is known.
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        if !recording.residuals.iter().any(|s| s.kind == Kind::Balance) {
            return Vec::new();
        }
        let laws: Vec<Vec<f64>> = match self.starts {
            [] => vec![Vec::new()],
            starts => starts.iter().map(|start| vec![*start]).collect(),
        };
        let sets_off: &[&[f64]] = match self.law {
            Law::Dry(_) => &[&[0.0], &[1.0]],
            Law::Drag | Law::Load => &[&[]],
        };
        (0..recording.signals.inertias.len())
            .flat_map(|body| laws.iter().map(move |law| (body, law)))
            .flat_map(|(body, law)| {
                let regularisation = self.regularisation().and(Some(CREEP));
                let shape = move |torque_source: &&[f64]| {
                    [
                        &[body as f64],
                        law.as_slice(),
                        regularisation.as_slice(),
                        torque_source,
                    ]
                    .concat()
                };
                sets_off.iter().map(shape)
            })
            .collect()
    }
    fn applies_to(&self, signal: &ResidualSignal) -> bool {
        signal.kind != Kind::Angle
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let parts = shared(shape[0], recording.signals.inertias.len());
        if let [(body, _)] = parts.as_slice() {
            return vec![self.at(*body, recording, shape)];
        }
        let mut sum = vec![Vec::new(); recording.residuals.len()];
        for (body, part) in parts {
            let own = recording.columns_of(&self.at(body, recording, shape));
            for (sum, own) in sum.iter_mut().zip(own) {
                sum.resize(own.len().max(sum.len()), 0.0);
                sum.iter_mut()
                    .zip(own)
                    .for_each(|(sum, x)| *sum += part * x);
            }
        }
        vec![Regressor::PerSignal(sum)]
    }
    fn location(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Option<String> {
        let names = &recording.signals.inertias;
        let parts = shared(shape[0], names.len());
        if let [(body, _)] = parts.as_slice() {
            return names.get(*body).cloned();
        }
        let each = (parts.iter())
            .map(|(body, part)| Some(format!("{} {:.0} %", names.get(*body)?, 100.0 * part)));
        each.collect::<Option<Vec<String>>>()
            .map(|each| each.join(", "))
    }
    fn apply_to_machine(
        &self,
        recording: &DrivetrainResiduals,
        shape: &[f64],
        parameters: &[f64],
        machine: &mut Machine,
    ) -> bool {
        let Some(chain) = &mut machine.drivetrain else {
            return false;
        };
        let names = &recording.signals.inertias;
        let mut changes = false;
        for (body, part) in shared(shape[0], names.len()) {
            let inertia = (chain.inertias.iter_mut()).find(|i| i.name == names[body]);
            changes |= inertia.is_some_and(|inertia| {
                self.apply_to_inertia(&recording.signals, shape, part * parameters[0], inertia)
            });
        }
        changes
    }
}

/// The inertias that share the friction at `place`, each with its part: `i` and `i + 1` of `bodies` with
/// `1 - f` and `f` at `i + f`.
fn shared(place: f64, bodies: usize) -> Vec<(usize, f64)> {
    let place = place.clamp(0.0, bodies.saturating_sub(1) as f64);
    if (place - place.round()).abs() < AT_ONE {
        return vec![(place.round() as usize, 1.0)];
    }
    let first = place.floor();
    vec![
        (first as usize, 1.0 - (place - first)),
        (first as usize + 1, place - first),
    ]
}

impl Friction {
    /// All of it on inertia `body`.
    fn at(&self, body: usize, recording: &DrivetrainResiduals, shape: &[f64]) -> Regressor {
        Regressor::ResistingTorque {
            body,
            u: self.torque(&recording.signals, body, shape),
            sticks: matches!(self.law, Law::Dry(_)) && shape.last() == Some(&0.0),
        }
    }

    /// Adds friction of the size `part_of_nominal` to `inertia`; whether that changes it.
    fn apply_to_inertia(
        &self,
        signals: &Signals,
        shape: &[f64],
        part_of_nominal: f64,
        inertia: &mut Inertia,
    ) -> bool {
        let ratio = inertia.speed_ratio.abs();
        // At the inertia's own speed.
        let torque = part_of_nominal * signals.nominal_torque / ratio;
        let speed = ratio * signals.nominal_speed;
        let own = match &self.law {
            Law::Drag => {
                let drag = inertia.drag_nm_s_per_rad + torque / speed;
                inertia.drag_nm_s_per_rad = drag.max(0.0);
                return true;
            }
            Law::Dry(law) => {
                let mut own = is_observable(law(shape), signals).scaled(torque, ratio);
                own.stribeck_rad_s = own.stribeck_rad_s.map(|w| w * signals.nominal_speed);
                own
            }
            Law::Load => loadtwin_machine::Friction {
                load_part: part_of_nominal,
                ..NONE
            },
        };
        let both = (inertia.friction.unwrap_or_default())
            .joined(&own)
            .filter(|_| torque > 0.0);
        inertia.friction = both.or(inertia.friction);
        both.is_some()
    }

    /// Index of the regularisation speed among the nonlinear parameters.
    fn regularisation(&self) -> Option<usize> {
        self.info
            .nonlinear
            .iter()
            .position(|s| s.name == REGULARISATION.name)
    }

    fn torque(&self, signals: &Signals, body: usize, shape: &[f64]) -> Vec<f64> {
        // Part of nominal.
        let speeds = signals.vibrating_speed(body);
        let turned = signals.nominal_speed * signals.dt_s;
        let motion = speeds.zip(signals.level.iter().copied());
        let regularisation = self.regularisation().map_or(CREEP, |at| shape[at]);
        match self.law {
            Law::Dry(law) => {
                is_observable(law(shape), signals).course(motion, turned, regularisation)
            }
            Law::Drag => motion.map(|(speed, _)| speed).collect(),
            Law::Load => ALL.course(motion, turned, regularisation),
        }
    }
}

/// `friction` as an encoder may show it: what builds up within a count of it has no angle of its own.
fn is_observable(
    mut friction: loadtwin_machine::Friction,
    signals: &Signals,
) -> loadtwin_machine::Friction {
    if friction.presliding_rad > 0.0 {
        friction.presliding_rad = friction.presliding_rad.max(signals.count);
    }
    friction
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Back and forth in parts of nominal speed, 1 ms apart, with a count of 1 mrad.
    fn turning() -> Signals {
        let speed: Vec<f64> = (0..2000).map(|i| (0.005 * f64::from(i)).sin()).collect();
        Signals {
            dt_s: 0.001,
            nominal_speed: 1.0,
            count: 1e-3,
            level: vec![0.0; speed.len()],
            speeds: vec![speed],
            ..Signals::default()
        }
    }

    /// By hand: 0.3 of the way from the second of three inertias to the third.
    #[test]
    fn neighbours_share_friction_between_them() {
        assert_eq!(shared(1.0, 3), [(1, 1.0)]);
        assert_eq!(shared(1.05, 3), [(1, 1.0)]);
        assert_eq!(shared(7.0, 3), [(2, 1.0)]);
        let [(first, most), (second, rest)] = shared(1.3, 3)[..] else {
            panic!("two inertias")
        };
        assert_eq!((first, second), (1, 2));
        assert!((most - 0.7).abs() < 1e-12 && (rest - 0.3).abs() < 1e-12);
    }

    #[test]
    fn what_builds_up_within_a_count_has_no_angle_of_its_own() {
        let signals = turning();
        let over = |angle: f64| PRESLIDING.torque(&signals, 0, &[0.0, angle, 1.0]);
        assert_eq!(over(1e-4), over(1e-3));
        assert_ne!(over(1e-3), over(4e-3));
    }

    /// By hand: `w / sqrt(w^2 + w_0^2)` of either sharpness.
    #[test]
    fn dry_friction_turns_about_as_sharply_as_it_is_said_to() {
        let signals = turning();
        for regularisation in [3e-4, 0.03] {
            let torque = COULOMB.torque(&signals, 0, &[0.0, regularisation, 1.0]);
            for (torque, w) in torque.iter().zip(&signals.speeds[0]) {
                let expected = w / w.hypot(regularisation);
                assert!((torque - expected).abs() < 1e-12 || *w == 0.0);
            }
        }
    }
}
