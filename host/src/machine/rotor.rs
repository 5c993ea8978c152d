//! A rotor: a flexible shaft with discs on bearings.

use std::path::PathBuf;

use nalgebra::{Matrix2, Matrix4};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::rule::{Checked, at_least, listed, one_of, positive, range, refuse, unique, within};

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
    /// Modulus of elasticity [Pa], > 0.
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
    /// Length of the whole section [m], > 0.
    pub length_m: f64,
    /// Elements that it is divided into, 1 to 400.
    #[serde(default = "one_element")]
    pub elements: usize,
    /// Outer diameter [m], > 0.
    pub outer_m: f64,
    /// Inner diameter [m], >= 0, < `outer_m`.
    #[serde(default)]
    pub inner_m: f64,
    /// Its material; the first where absent.
    pub material: Option<String>,
    /// Damping in proportion to the mass [1/s], >= 0.
    #[serde(default)]
    pub alpha_per_s: f64,
    /// Damping in proportion to the stiffness [s], >= 0.
    #[serde(default)]
    pub beta_s: f64,
}

/// A rigid disc.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Disc {
    /// Node that it sits at.
    pub node: usize,
    /// Mass [kg], > 0.
    pub mass_kg: f64,
    /// Moment of inertia about the shaft [kg m^2], >= 0.
    pub polar_kg_m2: f64,
    /// Moment of inertia about a diameter [kg m^2], >= 0.
    pub diametral_kg_m2: f64,
}

/// A 2 x 2 matrix over x and y, row by row: `[[xx, xy], [yx, yy]]`.
pub type Coefficients = [[f64; 2]; 2];

/// A bearing, linear at each speed.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RotorBearing {
    /// Node that it holds.
    pub node: usize,
    /// Stiffness [N/m]; that of all bearings together holds the shaft.
    pub stiffness_n_per_m: Option<Coefficients>,
    /// Damping [N s/m].
    #[serde(default)]
    pub damping_n_s_per_m: Coefficients,
    /// Stiffness and damping over speed in place of the two, linear between
    /// and constant beyond the ends; speeds in rising order.
    #[serde(default)]
    pub table: Vec<BearingAt>,
}

/// A bearing at one speed.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BearingAt {
    /// Speed [rad/s].
    pub speed_rad_s: f64,
    /// Stiffness [N/m].
    pub stiffness_n_per_m: Coefficients,
    /// Damping [N s/m].
    #[serde(default)]
    pub damping_n_s_per_m: Coefficients,
}

/// An unknown force at a node.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RotorLoad {
    /// Names of its components along x and y.
    pub names: [String; 2],
    /// Node that it acts on.
    pub node: usize,
    /// Its size at `speed_rad_s` [N], > 0: the unit of errors, and the
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
/// sqrt(s): a mass that moves by 1 % in an hour.
const UNBALANCE_WALK: f64 = 0.01 / 60.0;

/// Most elements of a shaft.
const MOST_ELEMENTS: usize = 1000;

/// Loads of a rotor, two components each: what its filter has states for.
pub const MOST_LOADS: usize = 2;

/// Part of the stiffest below which a stiffness holds nothing.
const SINGULAR: f64 = 1e-9;

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

    fn check_bearings(&self) -> Checked {
        for (i, bearing) in self.bearings.iter().enumerate() {
            let field = |name: &str| format!("rotor.bearing[{}].{name}", i + 1);
            self.check_node(&field("node"), bearing.node)?;
            match (&bearing.stiffness_n_per_m, bearing.table.as_slice()) {
                (Some(_), [_, ..]) => {
                    refuse(&field("table"), "both", "either stiffness_n_per_m or table")?;
                }
                (None, []) => refuse(
                    &field("stiffness_n_per_m"),
                    "nothing",
                    "[[xx, xy], [yx, yy]] in N/m, or a table over speed",
                )?,
                (Some(stiffness), []) => {
                    all_finite(&field("stiffness_n_per_m"), stiffness)?;
                    all_finite(&field("damping_n_s_per_m"), &bearing.damping_n_s_per_m)?;
                }
                (None, table) => {
                    let mut last = f64::NEG_INFINITY;
                    for (k, at) in table.iter().enumerate() {
                        let field = |name: &str| field(&format!("table[{}].{name}", k + 1));
                        within(
                            &field("speed_rad_s"),
                            at.speed_rad_s,
                            at.speed_rad_s > last && at.speed_rad_s.is_finite(),
                            "speeds in rising order",
                        )?;
                        last = at.speed_rad_s;
                        all_finite(&field("stiffness_n_per_m"), &at.stiffness_n_per_m)?;
                        all_finite(&field("damping_n_s_per_m"), &at.damping_n_s_per_m)?;
                    }
                }
            }
        }
        let mut nodes: Vec<usize> = self.bearings.iter().map(|b| b.node).collect();
        nodes.sort_unstable();
        nodes.dedup();
        within(
            "rotor.bearing",
            format!("bearings at {} nodes", nodes.len()),
            nodes.len() >= 2,
            "at 2 nodes or more: with fewer the rotor is not held",
        )?;
        let told = (self.bearings.iter()).flat_map(|b| b.table.iter().map(|at| at.speed_rad_s));
        for speed in told.chain([self.speed_rad_s]) {
            // A seal or a damper need not hold the shaft, where bearings beside it do.
            if self.is_held_at(speed) {
                continue;
            }
            for (i, bearing) in self.bearings.iter().enumerate() {
                let field = match bearing.table.as_slice() {
                    [] => format!("rotor.bearing[{}].stiffness_n_per_m", i + 1),
                    _ => format!("rotor.bearing[{}].table at {speed} rad/s", i + 1),
                };
                holds(&field, &bearing.at(speed).0)?;
            }
        }
        Ok(())
    }

    /// Whether the bearings together hold a rigid shaft, displaced by `x` and tilted by `a`.
    ///
    /// `sum J' K J` over the bearings is positive definite, `J (x, a) = x + s a`, with `s` the
    /// bearing's place in lengths of the shaft.
    fn is_held_at(&self, speed_rad_s: f64) -> bool {
        let places: Vec<f64> = (self.sections.iter())
            .flat_map(|s| std::iter::repeat_n(s.length_m / s.elements as f64, s.elements))
            .scan(0.0, |end, length| {
                *end += length;
                Some(*end)
            })
            .collect();
        let length = places.last().copied().unwrap_or(1.0);
        let mut held = Matrix4::<f64>::zeros();
        for bearing in &self.bearings {
            let k = Matrix2::from(bearing.at(speed_rad_s).0);
            let k = 0.5 * (k + k.transpose());
            let place = match bearing.node {
                0 => 0.0,
                node => places[node - 1] / length,
            };
            for (row, a) in [1.0, place].into_iter().enumerate() {
                for (column, b) in [1.0, place].into_iter().enumerate() {
                    let mut block = held.fixed_view_mut::<2, 2>(2 * row, 2 * column);
                    block += a * b * k;
                }
            }
        }
        let stiffness = held.symmetric_eigenvalues();
        stiffness.min() > SINGULAR * stiffness.max()
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
            let most = loadtwin_common::image::MAX_NAME;
            for name in &load.names {
                let used = names.iter().filter(|other| *other == name).count();
                within(
                    &field("names"),
                    format!("{name:?}"),
                    (1..=most).contains(&name.len()) && used == 1,
                    &format!("two names of at most {most} bytes that no other load has"),
                )?;
            }
            let first = self.loads.iter().position(|l| l.node == load.node);
            within(
                &field("node"),
                load.node,
                first == Some(i),
                "a node that no other load acts on",
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

impl RotorBearing {
    /// Stiffness [N/m] and damping [N s/m] at `speed_rad_s`.
    pub fn at(&self, speed_rad_s: f64) -> (Coefficients, Coefficients) {
        let (Some(first), Some(last)) = (self.table.first(), self.table.last()) else {
            let stiffness = self.stiffness_n_per_m.unwrap_or_default();
            return (stiffness, self.damping_n_s_per_m);
        };
        let after = self
            .table
            .iter()
            .position(|at| at.speed_rad_s >= speed_rad_s);
        let (low, high) = match after {
            None => (last, last),
            Some(0) => (first, first),
            Some(k) => (&self.table[k - 1], &self.table[k]),
        };
        let span = high.speed_rad_s - low.speed_rad_s;
        let part = if span > 0.0 {
            (speed_rad_s - low.speed_rad_s) / span
        } else {
            0.0
        };
        let between = |a: &Coefficients, b: &Coefficients| {
            std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + part * (b[i][j] - a[i][j])))
        };
        (
            between(&low.stiffness_n_per_m, &high.stiffness_n_per_m),
            between(&low.damping_n_s_per_m, &high.damping_n_s_per_m),
        )
    }
}

/// That a stiffness holds the shaft in both directions.
fn holds(field: &str, k: &Coefficients) -> Checked {
    all_finite(field, k)?;
    let mean = 0.5 * (k[0][1] + k[1][0]);
    let stiffest = k[0][0].abs().max(k[1][1].abs());
    let determinant = k[0][0] * k[1][1] - mean * mean;
    let is = k[0][0] > 0.0 && determinant > SINGULAR * stiffest * stiffest;
    let shown = format!("[[{}, {}], [{}, {}]]", k[0][0], k[0][1], k[1][0], k[1][1]);
    within(
        field,
        shown,
        is,
        "a positive definite matrix: this one is singular or pushes",
    )
}

fn all_finite(field: &str, matrix: &Coefficients) -> Checked {
    let is = matrix.iter().flatten().all(|value| value.is_finite());
    within(
        field,
        format!("{matrix:?}"),
        is,
        &listed(&["finite numbers"]),
    )
}

fn one_half() -> f64 {
    0.5
}

fn one_element() -> usize {
    1
}
