//! Defines the description of a rotor's bearings: stiffness and damping matrices, constant or as
//! tables over speed, interpolated linearly. Checks that together they hold the shaft.

use nalgebra::{Matrix2, Matrix4};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Rotor;
use super::field_checks::{Checked, listed, refuse, within};

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

/// Part of the stiffest below which a stiffness holds nothing.
const SINGULAR: f64 = 1e-9;

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

impl Rotor {
    pub(super) fn check_bearings(&self) -> Checked {
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
        let tabulated =
            (self.bearings.iter()).flat_map(|b| b.table.iter().map(|at| at.speed_rad_s));
        for speed in tabulated.chain([self.speed_rad_s]) {
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
