//! Defines the description of a torsional drivetrain (`[drivetrain]`): a chain of lumped inertias
//! and elastic shafts with one or two unknown loads. Checks its fields, and computes nominal values
//! and quantities referred to the main shaft.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::field_checks::{
    Checked, at_least, at_most, names, nonzero, one_of, positive, unique, within,
};
use super::{Drift, Friction, Gears, Senses};

/// Most inertias of a chain.
pub const MOST_INERTIAS: usize = 6;

/// A chain of 1 to 6 inertias joined by elastic shafts.
///
/// `J_i dw_i/dt = tau_(i-1) - tau_i - c_i w_i + loads`, all quantities referred to
/// the shaft with speed ratio 1; `tau_i = k_i delta_i + c_i d(delta_i)/dt` is the
/// torque that shaft i carries from inertia i to inertia i + 1.
///
/// Source: Bosmans et al. 2023, section 4.1.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Drivetrain {
    /// Inertias in the order of the chain, main shaft first, 1 to 6.
    #[serde(rename = "inertia")]
    pub inertias: Vec<Inertia>,
    /// The shafts or meshes between neighbours, one fewer than inertias.
    #[serde(default, rename = "shaft")]
    pub shafts: Vec<Shaft>,
    /// The unknown torques, 1 or 2.
    #[serde(rename = "load")]
    pub loads: Vec<Load>,
    /// Nominal speed of the main shaft [rad/s], > 0: the scale of the filter.
    pub nominal_speed_rad_s: f64,
    /// Name of the inertia whose angle the strain maps are over (the planet
    /// carrier), of speed ratio 1; the first where absent.
    pub carrier: Option<String>,
    /// A slow load that gauges read and that is not torque, a bending moment say, which the
    /// filter then estimates as a state; `std` in the unit that the channels' `bending` is for.
    pub bending: Option<Drift>,
    /// Gears and bearings, from which `loadtwin reduce` finds the forces on the housing.
    pub gears: Option<Gears>,
}

/// A lumped inertia.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Inertia {
    /// What encoders, loads and channels call it.
    pub name: String,
    /// Moment of inertia about its own axis [kg m^2], > 0.
    pub moment_kg_m2: f64,
    /// Standard deviation of that [kg m^2], >= 0; 5 % of it where absent. `loadtwin identify` writes it.
    pub moment_std_kg_m2: Option<f64>,
    /// Turns per turn of the main shaft, not 0; negative where it turns the other way.
    #[serde(default = "one")]
    pub speed_ratio: f64,
    /// Viscous drag to the housing, at its own speed [N m s/rad], >= 0.
    #[serde(default)]
    pub drag_nm_s_per_rad: f64,
    /// Standard deviation of that [N m s/rad], >= 0; 50 % of it where absent. `loadtwin identify` writes it.
    pub drag_std_nm_s_per_rad: Option<f64>,
    /// Dry friction to the housing.
    pub friction: Option<Friction>,
}

impl Drivetrain {
    /// Nominal torque at the main shaft: that of the largest load [N m].
    pub fn nominal_torque(&self) -> f64 {
        (self.loads.iter())
            .map(|l| l.nominal_nm * self.ratio(&l.inertia).abs())
            .fold(0.0, f64::max)
    }

    /// What a channel senses at nominal loads and speed [N m, rad/s].
    pub fn nominal_sensed(&self, senses: &Senses) -> f64 {
        match senses {
            Senses::Shaft(name) => {
                let shaft = self.shafts.iter().find(|s| s.name == *name);
                self.nominal_torque() / shaft.map_or(1.0, |s| s.speed_ratio.abs())
            }
            Senses::Load(name) => {
                let load = self.loads.iter().find(|l| l.name == *name);
                load.map_or(1.0, |l| l.nominal_nm)
            }
            Senses::Speed(name) => self.nominal_speed_rad_s * self.ratio(name).abs(),
            Senses::Drive(name) => self.nominal_torque() / self.ratio(name).abs(),
            // Refused where the description is checked.
            Senses::Displacement(_) | Senses::OuterRing(_) => 1.0,
            // Of this order: kelvins are read as they are.
            Senses::Temperature => 100.0,
        }
    }

    /// Turns of inertia `name` per turn of the main shaft.
    fn ratio(&self, name: &str) -> f64 {
        let inertia = self.inertias.iter().find(|i| i.name == name);
        inertia.map_or(1.0, |i| i.speed_ratio)
    }
}

impl Inertia {
    /// Moment of inertia, referred to the main shaft [kg m^2].
    pub fn referred_moment(&self) -> f64 {
        self.moment_kg_m2 * self.speed_ratio * self.speed_ratio
    }

    /// Drag, referred to the main shaft [N m s/rad].
    pub fn referred_drag(&self) -> f64 {
        self.drag_nm_s_per_rad * self.speed_ratio * self.speed_ratio
    }

    /// Its dry friction, referred to the main shaft.
    pub fn referred_friction(&self) -> Option<Friction> {
        let ratio = self.speed_ratio.abs();
        Some(self.friction?.scaled(ratio, 1.0 / ratio))
    }
}

/// An elastic shaft, or a gear mesh, between two neighbouring inertias.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Shaft {
    /// What channels call it.
    pub name: String,
    /// Torsional stiffness [N m/rad] at `speed_ratio`, > 0.
    pub stiffness_nm_per_rad: f64,
    /// Standard deviation of that [N m/rad], >= 0; 10 % of it where absent. `loadtwin identify` writes it.
    pub stiffness_std_nm_per_rad: Option<f64>,
    /// Torsional damping [N m s/rad] at `speed_ratio`, >= 0.
    #[serde(default)]
    pub damping_nm_s_per_rad: f64,
    /// Standard deviation of that [N m s/rad], >= 0; 50 % of it where absent. `loadtwin identify` writes it.
    pub damping_std_nm_s_per_rad: Option<f64>,
    /// Turns per turn of the main shaft at which stiffness, damping and the
    /// carried torque are meant.
    #[serde(default = "one")]
    pub speed_ratio: f64,
}

/// An unknown torque that the filter estimates.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Load {
    /// Its name in tables, in JSON and in estimates.
    pub name: String,
    /// The inertia it acts on.
    pub inertia: String,
    /// Whether a positive load drives the inertia or brakes it.
    pub direction: Direction,
    /// Nominal torque at that inertia's own speed [N m], > 0: the errors'
    /// denominator and the scale of the filter.
    pub nominal_nm: f64,
    /// Standard deviation of the load's random walk over one second
    /// [N m/sqrt(s)], > 0: `Qd = walk^2 dt`. `loadtwin tune` finds it;
    /// a fifth of the nominal torque where absent.
    pub walk_nm_per_sqrt_s: Option<f64>,
    /// Measured error by sensor set (`all` without sets), beside what the filter states.
    /// `loadtwin tune` and `loadtwin calibrate --error-bands` find it; without it the
    /// covariance of the filter is stated, which a calm load is well inside of.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub error_bands: BTreeMap<String, ErrorBand>,
}

/// Error of a load in a calibration beside the standard deviation of the filter, such that twice the
/// stated standard deviation holds 95.45 % of the errors.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ErrorBand {
    /// Error over the standard deviation of the filter, > 0.
    pub error_over_std: f64,
    /// The standard deviation of the filter there [N m], > 0; what it has beyond it counts in full.
    pub std_nm: f64,
    /// Squared movement of the load there over that of its random walk, >= 0; a load that moves
    /// faster has a larger stated standard deviation.
    pub movement: f64,
}

/// Sign of a load.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// A positive load accelerates the inertia (a motor, a wind rotor).
    Drives,
    /// A positive load decelerates the inertia (a generator, a brake).
    Brakes,
}

impl Direction {
    /// +1 or -1.
    pub fn sign(self) -> f64 {
        match self {
            Self::Drives => 1.0,
            Self::Brakes => -1.0,
        }
    }
}

/// Checks a standard deviation, where one is stated.
fn stated(field: &str, std: Option<f64>) -> Checked {
    std.map_or(Ok(()), |std| at_least(field, std, 0.0))
}

fn one() -> f64 {
    1.0
}

impl Drivetrain {
    pub(super) fn check(&self) -> Checked {
        let n = self.inertias.len();
        within(
            "drivetrain.inertia",
            n,
            (1..=MOST_INERTIAS).contains(&n),
            &format!("1 to {MOST_INERTIAS} tables"),
        )?;
        let shafts = self.shafts.len();
        within(
            "drivetrain.shaft",
            shafts,
            shafts + 1 == n,
            &format!("{} tables, one fewer than inertias", n - 1),
        )?;
        let loads = self.loads.len();
        within(
            "drivetrain.load",
            loads,
            (1..=2).contains(&loads),
            "1 or 2 tables",
        )?;
        let inertias = names(&self.inertias, |j| &j.name);
        unique("drivetrain.inertia", &inertias)?;
        unique("drivetrain.shaft", &names(&self.shafts, |s| &s.name))?;
        unique("drivetrain.load", &names(&self.loads, |l| &l.name))?;
        if let Some(bending) = &self.bending {
            positive("drivetrain.bending.std", bending.std)?;
            positive("drivetrain.bending.time_s", bending.time_s)?;
        }
        self.check_parts(&inertias)?;
        positive("drivetrain.nominal_speed_rad_s", self.nominal_speed_rad_s)?;
        self.check_carrier(&inertias)?;
        match (&self.gears, self.inertias.last()) {
            (Some(gears), Some(last)) => gears.check(last.speed_ratio),
            _ => Ok(()),
        }
    }

    /// Checks the fields of inertias, shafts and loads.
    fn check_parts(&self, inertias: &[&str]) -> Checked {
        for (i, inertia) in self.inertias.iter().enumerate() {
            let field = |name: &str| format!("drivetrain.inertia[{}].{name}", i + 1);
            positive(&field("moment_kg_m2"), inertia.moment_kg_m2)?;
            nonzero(&field("speed_ratio"), inertia.speed_ratio)?;
            at_least(&field("drag_nm_s_per_rad"), inertia.drag_nm_s_per_rad, 0.0)?;
            stated(&field("moment_std_kg_m2"), inertia.moment_std_kg_m2)?;
            stated(
                &field("drag_std_nm_s_per_rad"),
                inertia.drag_std_nm_s_per_rad,
            )?;
            if let Some(friction) = &inertia.friction {
                friction.check(&field("friction"))?;
            }
        }
        for (i, shaft) in self.shafts.iter().enumerate() {
            let field = |name: &str| format!("drivetrain.shaft[{}].{name}", i + 1);
            positive(&field("stiffness_nm_per_rad"), shaft.stiffness_nm_per_rad)?;
            at_least(
                &field("damping_nm_s_per_rad"),
                shaft.damping_nm_s_per_rad,
                0.0,
            )?;
            stated(
                &field("stiffness_std_nm_per_rad"),
                shaft.stiffness_std_nm_per_rad,
            )?;
            stated(
                &field("damping_std_nm_s_per_rad"),
                shaft.damping_std_nm_s_per_rad,
            )?;
            nonzero(&field("speed_ratio"), shaft.speed_ratio)?;
        }
        for (i, load) in self.loads.iter().enumerate() {
            let field = |name: &str| format!("drivetrain.load[{}].{name}", i + 1);
            one_of(&field("inertia"), &load.inertia, inertias)?;
            positive(&field("nominal_nm"), load.nominal_nm)?;
            if let Some(walk) = load.walk_nm_per_sqrt_s {
                positive(&field("walk_nm_per_sqrt_s"), walk)?;
            }
            for (set, band) in &load.error_bands {
                let field = |name: &str| field(&format!("error_bands.{set}.{name}"));
                positive(&field("error_over_std"), band.error_over_std)?;
                positive(&field("std_nm"), band.std_nm)?;
                at_least(&field("movement"), band.movement, 0.0)?;
            }
            at_most(
                &field("name"),
                load.name.len(),
                loadtwin_common::load_signal::MAX_NAME,
            )?;
        }
        Ok(())
    }

    /// Checks that the carrier is an inertia of speed ratio 1.
    fn check_carrier(&self, inertias: &[&str]) -> Checked {
        let carrier = self.carrier.as_deref().unwrap_or(inertias[0]);
        one_of("drivetrain.carrier", carrier, inertias)?;
        let ratio = self
            .inertias
            .iter()
            .find(|j| j.name == carrier)
            .map_or(0.0, |j| j.speed_ratio);
        let allowed = "an inertia with speed_ratio 1, since strain maps are over its angle";
        within(
            "drivetrain.carrier",
            format!("speed_ratio {ratio}"),
            ratio == 1.0,
            allowed,
        )
    }
}
