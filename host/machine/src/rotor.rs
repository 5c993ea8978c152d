//! Defines the description of a flexible rotor (`[rotor]`): shaft sections, materials, discs,
//! unknown forces with their random walk, model reduction, range of speeds. Checks its fields, and
//! computes the bank of noise levels of the filter and usual random walks.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::RotorBearing;
use super::field_checks::{Checked, at_least, one_of, positive, range, unique, within};

/// A shaft of beam elements with discs, bearings and forces.
///
/// `M q'' + (C + speed G) q' + (K + speed' K_st) q = S f`, four degrees of freedom at a node:
/// `x`, `y`, and the rotations about them. Nodes count from 0 at the left end of
/// the first section; each element adds one.
///
/// Source: Rezende et al. 2023, eq. (1).
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rotor {
    /// Rotational speed [rad/s], > 0: where nothing measures it, the speed of
    /// the machine; for the reduction, the speed at which its errors are weighed.
    pub speed_rad_s: f64,
    /// Lowest and highest speed that the model is made for [rad/s]; `speed_rad_s`
    /// alone where absent. Outside of it a machine is not estimated.
    pub schedule_rad_s: Option<[f64; 2]>,
    /// Samples by which estimates lag, 0 to 4: a force moves a sensor only samples later, so
    /// that one that may do anything is known far better then. Where absent, 2 with a load of kind
    /// `walk`, and 0 without.
    pub lag_samples: Option<u8>,
    /// Standard deviation of how far the rotor is from its description, in usual tolerances (bearings
    /// 30 %, shaft 1 %, sensor gains 0.6 %), 0.02 to 5: less than 1 where its response was measured.
    #[serde(default = "one")]
    pub tolerance: f64,
    /// A model of the shaft, its discs and its bearings as ROSS saves it
    /// (TOML or JSON), in place of `section`, `disc` and `bearing`.
    pub ross_model: Option<PathBuf>,
    /// What each rad/s^2 of angular acceleration adds to the stiffness, as a part of `G`, 0 to 1.
    /// Torque in the shaft turns with the shaft, which leaves 0.5; where the shaft tilts at the
    /// drive it is more if the drive's torque stays along the bearings' axis, less if it turns with
    /// the shaft.
    #[serde(default = "one_half")]
    pub acceleration_stiffness: f64,
    /// Materials of the shaft.
    #[serde(default, rename = "material")]
    pub materials: Vec<Material>,
    /// Sections of the shaft from left to right.
    #[serde(default, rename = "section")]
    pub sections: Vec<Section>,
    /// Rigid discs.
    #[serde(default, rename = "disc")]
    pub discs: Vec<Disc>,
    /// Bearings.
    #[serde(default, rename = "bearing")]
    pub bearings: Vec<RotorBearing>,
    /// Unknown forces, two components each; at most 2.
    #[serde(rename = "load")]
    pub loads: Vec<RotorLoad>,
    /// How the model is made small enough for a microcontroller.
    #[serde(default)]
    pub reduction: Reduction,
}

/// A material.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// What sections call it.
    pub name: String,
    /// Modulus of elasticity (Pa), > 0.
    pub young_pa: f64,
    /// Density [kg/m^3], > 0.
    pub density_kg_per_m3: f64,
    /// Poisson's ratio, 0 to 0.49.
    pub poisson: f64,
}

/// A cylindrical section of the shaft.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Section {
    /// Length of the whole section (m), > 0.
    pub length_m: f64,
    /// Elements that it is divided into, at least 1; all sections together 1000 at most.
    #[serde(default = "one_element")]
    pub elements: usize,
    /// Outer diameter (m), > 0.
    pub outer_m: f64,
    /// Inner diameter (m), >= 0, < `outer_m`.
    #[serde(default)]
    pub inner_m: f64,
    /// Its material; the first where absent.
    pub material: Option<String>,
    /// Damping in proportion to the mass [1/s], >= 0.
    #[serde(default)]
    pub alpha_per_s: f64,
    /// Damping in proportion to the stiffness (s), >= 0.
    #[serde(default)]
    pub beta_s: f64,
}

/// A rigid disc.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Disc {
    /// Node that it sits at.
    pub node: usize,
    /// Mass (kg), > 0.
    pub mass_kg: f64,
    /// Moment of inertia about the shaft [kg m^2], >= 0.
    pub polar_kg_m2: f64,
    /// Moment of inertia about a diameter [kg m^2], >= 0.
    pub diametral_kg_m2: f64,
}

/// An unknown force at a node.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RotorLoad {
    /// Names of its components along x and y.
    pub names: [String; 2],
    /// Node that it acts on.
    pub node: usize,
    /// Its size at `speed_rad_s` (N), > 0: the unit of errors, and the
    /// standard deviation before the first sample.
    pub nominal_n: f64,
    /// How it moves from sample to sample.
    #[serde(default)]
    pub kind: LoadKind,
    /// Random walk of each component [N/sqrt(s)], > 0. For an unbalance, of the
    /// part that does not turn with the shaft. `loadtwin tune` finds it.
    pub walk_n_per_sqrt_s: Option<f64>,
}

/// How an unknown force moves from sample to sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LoadKind {
    /// Fixed to the rotor: turns with the shaft and grows with its speed squared.
    #[default]
    Unbalance,
    /// Anything: stays what it is.
    Walk,
}

/// How many degrees of freedom the filter's model keeps.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Reduction {
    /// Pairs of eigenvalues beside one for each component of the loads, at least 2; as many as
    /// fit where absent.
    pub modes: Option<usize>,
    /// Standard deviation of what the model lacks in one sample, as part of each
    /// mode's motion under the nominal loads, 0 to 1.
    pub model_std: f64,
    /// Standard deviation of the rotor's motion before the first sample, as part of
    /// that under the nominal loads, 0 to 10: 1 where recordings begin on a machine
    /// that runs, near 0 where they begin at rest.
    pub initial_std: f64,
}

impl Default for Reduction {
    fn default() -> Self {
        Self {
            modes: None,
            model_std: 1e-6,
            initial_std: 1.0,
        }
    }
}

/// Random walk of an unbalance whose description gives none, in nominal loads per
/// sqrt(s): a mass that moves by 0.1 % in an hour.
const UNBALANCE_WALK: f64 = 0.001 / 60.0;

/// Model error of a rotor that its innovations do not contradict, in the usual tolerances of a
/// description: finite elements, their reduction and rounded sizes, 0.6 % of a bearing's stiffness.
const DESCRIBED_ERROR: f64 = 0.02;

/// Noise levels for rotors that are not as described: what the model lacks in a sample
/// ([`Reduction::model_std`]), the walk of an unbalance in nominal loads per sqrt(s), both at least,
/// and the model error that the level allows for, in the usual tolerances of a description.
///
/// The first is what errs least of rotors that are off by 0.04 to 3 % of their modulus; from level to
/// level the noise is ten times as large, up to a load that goes round in less than a second. The
/// errors are those of rotors with bearings 0.65 to 1.5 times as stiff as described.
const LEVELS: [(f64, f64, f64); 3] = [(3e-4, 0.005, 0.3), (3e-3, 0.05, 1.0), (2e-2, 0.7, 5.0)];

/// Lag of a rotor with a load that may do anything, whose description gives none [samples].
const WALK_LAG: u8 = 2;

/// Most elements of a shaft.
const MOST_ELEMENTS: usize = 1000;

/// Loads of a rotor, two components each: what its filter has states for.
pub const MOST_LOADS: usize = 2;

impl Rotor {
    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.sections.iter().map(|s| s.elements).sum::<usize>() + 1
    }

    /// Lowest and highest speed [rad/s].
    pub fn schedule(&self) -> [f64; 2] {
        self.schedule_rad_s
            .unwrap_or([self.speed_rad_s, self.speed_rad_s])
    }

    /// Samples by which estimates lag.
    pub fn lag(&self) -> u8 {
        let walks = self.loads.iter().any(|load| load.kind == LoadKind::Walk);
        self.lag_samples.unwrap_or(if walks { WALK_LAG } else { 0 })
    }

    /// The bank of noise levels, each with the model error that it allows for in the usual
    /// tolerances: first as described, then, where a load turns, larger ones.
    pub fn levels(&self) -> Vec<(Self, f64)> {
        let turning = |load: &&mut RotorLoad| load.kind == LoadKind::Unbalance;
        let turns = self.loads.iter().any(|l| l.kind == LoadKind::Unbalance);
        let larger = LEVELS.iter().filter(|_| turns).map(|(model, walk, error)| {
            let mut level = self.clone();
            level.reduction.model_std = self.reduction.model_std.max(*model);
            for load in level.loads.iter_mut().filter(turning) {
                let least = walk * load.nominal_n;
                load.walk_n_per_sqrt_s = Some(load.walk(self.speed_rad_s).max(least));
            }
            (level, *error)
        });
        std::iter::once((self.clone(), DESCRIBED_ERROR))
            .chain(larger)
            .collect()
    }

    /// The material of `section`.
    pub fn material(&self, section: &Section) -> Option<&Material> {
        match &section.material {
            Some(name) => self.materials.iter().find(|m| m.name == *name),
            None => self.materials.first(),
        }
    }

    pub(super) fn check(&self) -> Checked {
        positive("rotor.speed_rad_s", self.speed_rad_s)?;
        let [low, high] = self.schedule();
        within(
            "rotor.schedule_rad_s",
            format!("[{low}, {high}]"),
            low >= 0.0 && low <= high && high.is_finite(),
            "[lowest, highest], 0 <= lowest <= highest",
        )?;
        within(
            "rotor.speed_rad_s",
            self.speed_rad_s,
            (low..=high).contains(&self.speed_rad_s),
            &format!("within the schedule, {low} to {high}"),
        )?;
        within(
            "rotor.tolerance",
            self.tolerance,
            (DESCRIBED_ERROR..=5.0).contains(&self.tolerance),
            "0.02 to 5",
        )?;
        let most = loadtwin_common::rotor::fixed_lag_smoother::MAX_LAG;
        within(
            "rotor.lag_samples",
            self.lag(),
            usize::from(self.lag()) <= most,
            &format!("0 to {most}"),
        )?;
        range(
            "rotor.acceleration_stiffness",
            self.acceleration_stiffness,
            0.0,
            1.0,
        )?;
        self.check_shaft()?;
        for (i, disc) in self.discs.iter().enumerate() {
            let field = |name: &str| format!("rotor.disc[{}].{name}", i + 1);
            self.check_node(&field("node"), disc.node)?;
            positive(&field("mass_kg"), disc.mass_kg)?;
            at_least(&field("polar_kg_m2"), disc.polar_kg_m2, 0.0)?;
            at_least(&field("diametral_kg_m2"), disc.diametral_kg_m2, 0.0)?;
        }
        self.check_bearings()?;
        self.check_loads()?;
        range(
            "rotor.reduction.model_std",
            self.reduction.model_std,
            0.0,
            1.0,
        )?;
        range(
            "rotor.reduction.initial_std",
            self.reduction.initial_std,
            0.0,
            10.0,
        )?;
        if let Some(modes) = self.reduction.modes {
            within("rotor.reduction.modes", modes, modes >= 2, ">= 2")?;
        }
        Ok(())
    }

    fn check_shaft(&self) -> Checked {
        let materials: Vec<&str> = self.materials.iter().map(|m| m.name.as_str()).collect();
        unique("rotor.material", &materials)?;
        for (i, material) in self.materials.iter().enumerate() {
            let field = |name: &str| format!("rotor.material[{}].{name}", i + 1);
            positive(&field("young_pa"), material.young_pa)?;
            positive(&field("density_kg_per_m3"), material.density_kg_per_m3)?;
            range(&field("poisson"), material.poisson, 0.0, 0.49)?;
        }
        within(
            "rotor.section",
            self.sections.len(),
            !self.sections.is_empty(),
            "at least 1 table, or ross_model",
        )?;
        for (i, section) in self.sections.iter().enumerate() {
            let field = |name: &str| format!("rotor.section[{}].{name}", i + 1);
            positive(&field("length_m"), section.length_m)?;
            positive(&field("outer_m"), section.outer_m)?;
            within(
                &field("inner_m"),
                section.inner_m,
                section.inner_m >= 0.0 && section.inner_m < section.outer_m,
                &format!(">= 0, < outer_m = {}", section.outer_m),
            )?;
            within(
                &field("elements"),
                section.elements,
                (1..=MOST_ELEMENTS).contains(&section.elements),
                &format!("1 to {MOST_ELEMENTS}"),
            )?;
            at_least(&field("alpha_per_s"), section.alpha_per_s, 0.0)?;
            at_least(&field("beta_s"), section.beta_s, 0.0)?;
            match &section.material {
                Some(name) => one_of(&field("material"), name, &materials)?,
                None => within(
                    "rotor.material",
                    0,
                    !materials.is_empty(),
                    "at least 1 table",
                )?,
            }
        }
        let elements = self.nodes() - 1;
        within(
            "rotor.section",
            format!("{elements} elements"),
            elements <= MOST_ELEMENTS,
            &format!("at most {MOST_ELEMENTS} elements"),
        )
    }

    fn check_loads(&self) -> Checked {
        within(
            "rotor.load",
            self.loads.len(),
            (1..=MOST_LOADS).contains(&self.loads.len()),
            &format!("1 to {MOST_LOADS} tables"),
        )?;
        let names: Vec<&str> = (self.loads.iter())
            .flat_map(|l| l.names.iter().map(String::as_str))
            .collect();
        for (i, load) in self.loads.iter().enumerate() {
            let field = |name: &str| format!("rotor.load[{}].{name}", i + 1);
            self.check_node(&field("node"), load.node)?;
            positive(&field("nominal_n"), load.nominal_n)?;
            if let Some(walk) = load.walk_n_per_sqrt_s {
                positive(&field("walk_n_per_sqrt_s"), walk)?;
            }
            let most = loadtwin_common::load_signal::MAX_NAME;
            for name in &load.names {
                let used = names.iter().filter(|other| *other == name).count();
                within(
                    &field("names"),
                    format!("{name:?}"),
                    (1..=most).contains(&name.len()) && used == 1,
                    &format!("two names of at most {most} bytes that no other load has"),
                )?;
            }
            let alike = |l: &RotorLoad| l.node == load.node && l.kind == load.kind;
            let first = self.loads.iter().position(alike);
            within(
                &field("node"),
                load.node,
                first == Some(i),
                "a node that no other load of the same kind acts on",
            )?;
        }
        Ok(())
    }

    /// That there is such a node.
    pub(super) fn check_node(&self, field: &str, node: usize) -> Checked {
        let last = self.nodes() - 1;
        within(field, node, node <= last, &format!("a node, 0 to {last}"))
    }
}

impl RotorLoad {
    /// Its random walk as described, or what is usual on a rotor that turns at
    /// `speed_rad_s` [N/sqrt(s)].
    pub fn walk(&self, speed_rad_s: f64) -> f64 {
        let usual = match self.kind {
            LoadKind::Unbalance => UNBALANCE_WALK,
            // Its size in one turn: it may be what turns with the shaft.
            LoadKind::Walk => (speed_rad_s / std::f64::consts::TAU).sqrt(),
        };
        self.walk_n_per_sqrt_s.unwrap_or(usual * self.nominal_n)
    }
}

fn one() -> f64 {
    1.0
}

fn one_half() -> f64 {
    0.5
}

fn one_element() -> usize {
    1
}
