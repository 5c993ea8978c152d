//! Collects the parameters of the drivetrain plant from the description, referred to speed ratio 1:
//! inertias, shafts, friction. Backlash, varying mesh stiffness and torque ripple are zero until an
//! injected effect changes them.

use loadtwin_machine::{Drivetrain, Inertia};

/// A chain of inertias and shafts, all referred to the shaft with speed
/// ratio 1; an effect changes its fields before the plant is built.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    /// 1 to 6, in the order of the machine description.
    pub bodies: Vec<Body>,
    /// One fewer than bodies.
    pub shafts: Vec<Shaft>,
    /// Torques that depend on the angle of the main shaft.
    pub ripples: Vec<Ripple>,
    /// Pre-sliding frictions.
    pub presliding: Vec<Presliding>,
    /// Speed of the main shaft that counts as nominal [rad/s], > 0.
    pub nominal_speed: f64,
    /// Torque of the main shaft that counts as nominal [N m], > 0.
    pub nominal_torque: f64,
}

/// An inertia and what brakes it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Body {
    /// Moment of inertia [kg m^2], > 0.
    pub inertia: f64,
    /// Viscous drag [N m s/rad].
    pub viscous: f64,
    /// Coulomb friction [N m].
    pub coulomb: f64,
    /// What sticking adds to it at standstill (N m), and `exp(-(w / stribeck_speed)^2)` of that at
    /// speed `w`.
    pub stribeck: f64,
    /// Speed over which that fades [rad/s]; where 0, a part of nominal speed.
    pub stribeck_speed: f64,
}

/// A shaft with a gear mesh at its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shaft {
    /// Stiffness of shaft and mesh in series [N m/rad], > 0.
    pub stiffness: f64,
    /// Damping of the two in series [N m s/rad].
    pub damping: f64,
    /// Whole width of the dead zone of the mesh [rad].
    pub backlash: f64,
    /// Relative amplitude by which the mesh's stiffness varies.
    pub variation: f64,
    /// Part of the torque that is lost before it, where it leaves the first body.
    pub loss_before: f64,
    /// Part of the torque that the mesh loses.
    pub loss: f64,
    /// Inertia of the gear between shaft and mesh, as part of the smaller
    /// neighbour's, 0 to 0.5.
    pub gear: f64,
}

/// `amplitude cos(order angle + phase)` on one body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ripple {
    /// Which body.
    pub body: usize,
    /// [N m].
    pub amplitude: f64,
    /// Periods per turn of the main shaft.
    pub order: f64,
    /// [rad].
    pub phase: f64,
}

/// Dahl friction: `dz/dt = w (1 - z sign(w) / torque) torque / angle`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Presliding {
    /// Which body.
    pub body: usize,
    /// Friction once it slides [N m], > 0.
    pub torque: f64,
    /// Angle over which it breaks away [rad], > 0.
    pub angle: f64,
}

/// Part of the smaller neighbour's inertia that sits between shaft and mesh.
///
/// Small enough for its resonance to stay far above the 10 Hz that the
/// estimator is asked for.
const GEAR: f64 = 0.01;

impl Chain {
    pub(crate) fn new(drivetrain: &Drivetrain) -> Self {
        let ratio = |name: &str| {
            drivetrain
                .inertias
                .iter()
                .find(|i| i.name == name)
                .map_or(1.0, |i| i.speed_ratio)
        };
        let dry = |inertia: &Inertia| inertia.referred_friction().unwrap_or_default();
        let presliding = (drivetrain.inertias.iter().enumerate())
            .map(|(body, inertia)| (body, dry(inertia)))
            .filter(|(_, dry)| dry.presliding_rad > 0.0 && dry.coulomb_nm > 0.0)
            .map(|(body, dry)| Presliding {
                body,
                torque: dry.coulomb_nm,
                angle: dry.presliding_rad,
            })
            .collect();
        Self {
            bodies: drivetrain
                .inertias
                .iter()
                .map(|i| {
                    let dry = dry(i);
                    let builds_up = dry.presliding_rad > 0.0;
                    Body {
                        inertia: i.moment_kg_m2 * i.speed_ratio * i.speed_ratio,
                        viscous: i.drag_nm_s_per_rad * i.speed_ratio * i.speed_ratio,
                        coulomb: if builds_up { 0.0 } else { dry.coulomb_nm },
                        stribeck: dry.stribeck_nm,
                        stribeck_speed: dry.stribeck_rad_s.unwrap_or(0.0),
                    }
                })
                .collect(),
            shafts: drivetrain
                .shafts
                .iter()
                .enumerate()
                .map(|(i, s)| Shaft {
                    stiffness: s.stiffness_nm_per_rad * s.speed_ratio * s.speed_ratio,
                    damping: s.damping_nm_s_per_rad * s.speed_ratio * s.speed_ratio,
                    backlash: 0.0,
                    variation: 0.0,
                    loss_before: if i == 0 {
                        dry(&drivetrain.inertias[0]).load_part
                    } else {
                        0.0
                    },
                    loss: dry(&drivetrain.inertias[i + 1]).load_part,
                    gear: GEAR,
                })
                .collect(),
            ripples: Vec::new(),
            presliding,
            nominal_speed: drivetrain.nominal_speed_rad_s,
            nominal_torque: drivetrain
                .loads
                .first()
                .map_or(1.0, |l| l.nominal_nm * ratio(&l.inertia).abs()),
        }
    }
}
