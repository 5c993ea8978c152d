//! Assembles the finite-element model of a rotor from its description: mass, gyroscopic, damping
//! and stiffness matrices of shaft, discs and bearings, at any speed.

use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, c64};

use crate::rotor::RotorError;
use crate::rotor::beam_element::{ElementMatrix, NODE, ShaftElement};
use loadtwin_machine::{Rotor, RotorBearing};

/// Degrees of freedom beyond the diagonal that a row reaches: an element's 8.
pub(crate) const BAND: usize = 2 * NODE - 1;

/// `M q'' + (C + speed G) q' + (K + speed' K_st) q = f` over `4 x` nodes degrees of freedom:
/// node by node `x`, `y`, `alpha`, `beta`.
///
/// Source: Rezende et al. 2023, eq. (1).
#[derive(Clone, Debug)]
pub struct RotorModel {
    /// Number of nodes.
    pub nodes: usize,
    /// `M` of shaft and discs.
    pub mass: Mat<f64>,
    /// `G` of shaft and discs.
    pub gyroscopic: Mat<f64>,
    /// Damping of the shaft.
    shaft_damping: Mat<f64>,
    /// Stiffness of the shaft.
    shaft_stiffness: Mat<f64>,
    /// `K_st` as a part of `G`.
    accelerating: f64,
    bearings: Vec<RotorBearing>,
}

impl RotorModel {
    /// Assembles a rotor that has been checked.
    pub fn new(rotor: &Rotor) -> Self {
        let nodes = rotor.nodes();
        let n = NODE * nodes;
        let mut model = Self {
            nodes,
            mass: Mat::zeros(n, n),
            gyroscopic: Mat::zeros(n, n),
            shaft_damping: Mat::zeros(n, n),
            shaft_stiffness: Mat::zeros(n, n),
            accelerating: rotor.acceleration_stiffness,
            bearings: rotor.bearings.clone(),
        };
        let mut node = 0;
        for section in &rotor.sections {
            let Some(material) = rotor.material(section) else {
                continue;
            };
            let element = ShaftElement {
                length_m: section.length_m / section.elements as f64,
                outer_m: section.outer_m,
                inner_m: section.inner_m,
                young_pa: material.young_pa,
                density_kg_per_m3: material.density_kg_per_m3,
                poisson: material.poisson,
            };
            let parts = element.matrices();
            for _ in 0..section.elements {
                add(&mut model.mass, node, &parts.mass, 1.0);
                add(&mut model.gyroscopic, node, &parts.gyroscopic, 1.0);
                add(&mut model.shaft_stiffness, node, &parts.stiffness, 1.0);
                let damping = &mut model.shaft_damping;
                add(damping, node, &parts.mass, section.alpha_per_s);
                add(damping, node, &parts.stiffness, section.beta_s);
                node += 1;
            }
        }
        for disc in &rotor.discs {
            let at = NODE * disc.node;
            for (k, inertia) in [
                disc.mass_kg,
                disc.mass_kg,
                disc.diametral_kg_m2,
                disc.diametral_kg_m2,
            ]
            .into_iter()
            .enumerate()
            {
                model.mass[(at + k, at + k)] += inertia;
            }
            model.gyroscopic[(at + 2, at + 3)] += disc.polar_kg_m2;
            model.gyroscopic[(at + 3, at + 2)] -= disc.polar_kg_m2;
        }
        model
    }

    /// Degrees of freedom.
    pub fn len(&self) -> usize {
        NODE * self.nodes
    }

    /// Whether there are none; never so.
    pub fn is_empty(&self) -> bool {
        self.nodes == 0
    }

    /// `K` at a speed [rad/s].
    pub fn stiffness(&self, speed_rad_s: f64) -> Mat<f64> {
        let mut k = self.shaft_stiffness.clone();
        for bearing in &self.bearings {
            let (stiffness, _) = bearing.at(speed_rad_s);
            add_at(&mut k, bearing.node, &stiffness);
        }
        k
    }

    /// `C` at a speed [rad/s], without gyroscopic terms.
    pub fn damping(&self, speed_rad_s: f64) -> Mat<f64> {
        let mut c = self.shaft_damping.clone();
        for bearing in &self.bearings {
            let (_, damping) = bearing.at(speed_rad_s);
            add_at(&mut c, bearing.node, &damping);
        }
        c
    }

    /// `C + speed G` at a speed [rad/s].
    pub fn turning_damping(&self, speed_rad_s: f64) -> Mat<f64> {
        self.damping(speed_rad_s) + faer::Scale(speed_rad_s) * &self.gyroscopic
    }

    /// `K_st = c G`: what `K` gains for each rad/s^2 of angular acceleration [N m s^2/rad^2], with
    /// `c = 1/2` unless described otherwise.
    ///
    /// Of the angular momentum `I_p speed t` of a slice, along its axis `t = (beta, -alpha, 1)`, the
    /// change has `speed G q'` and `speed' G q` across the shaft. Torque in the shaft, `T t`,
    /// balances the second but for `T dt/ds`; where both planes bend by a shape `f` that is
    /// `integral T f f' ds = [T f^2] / 2 - integral T' f^2 / 2` with `T' = I_p speed'`: half of
    /// `speed' G` remains. `[T f^2] / 2` at the end that is driven comes to it where the torque
    /// stays along the axis of the bearings, is taken from it where it turns with the shaft, and
    /// is not there where a joint shares its bend between both (a semitangential torque, the
    /// Lagrangian `speed (q' . G q) / 2`).
    ///
    /// ROSS 2.3.0 has `Kst` in one of the two planes alone, as for a spin counted about one
    /// fixed axis, with the other sign than its own `G`, and without shear: no rotor that is
    /// the same in every direction has it.
    ///
    /// Source: Ziegler, Principles of Structural Stability (1968), torques that turn; Zorzi,
    /// Nelson, The dynamics of rotor-bearing systems with axial torque, J. Mech. Design 102 (1980).
    pub fn accelerating_stiffness(&self) -> Mat<f64> {
        faer::Scale(self.accelerating) * &self.gyroscopic
    }

    /// Nodes that bearings hold.
    pub(crate) fn held_nodes(&self) -> impl Iterator<Item = usize> + '_ {
        self.bearings.iter().map(|bearing| bearing.node)
    }

    /// A unit force along a direction (rad) at a node, or the row that measures
    /// the displacement there.
    pub fn direction(&self, node: usize, angle_rad: f64) -> Vec<f64> {
        let mut row = vec![0.0; self.len()];
        row[NODE * node] = angle_rad.cos();
        row[NODE * node + 1] = angle_rad.sin();
        row
    }

    /// `s^2 M + s (C + speed G) + K`, sparse.
    pub(crate) fn dynamic_stiffness(
        &self,
        s: c64,
        damping: &Mat<f64>,
        stiffness: &Mat<f64>,
    ) -> Result<SparseColMat<usize, c64>, RotorError> {
        let n = self.len();
        let mut entries = Vec::with_capacity(n * (2 * BAND + 1));
        for j in 0..n {
            for i in j.saturating_sub(BAND)..n.min(j + BAND + 1) {
                let value = s * s * self.mass[(i, j)] + s * damping[(i, j)] + stiffness[(i, j)];
                if value != c64::new(0.0, 0.0) {
                    entries.push(Triplet::new(i, j, value));
                }
            }
        }
        SparseColMat::try_new_from_triplets(n, n, &entries).map_err(|_| RotorError::NoEigenvalues)
    }
}

fn add(matrix: &mut Mat<f64>, node: usize, part: &ElementMatrix, factor: f64) {
    let at = NODE * node;
    for (i, row) in part.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            matrix[(at + i, at + j)] += factor * value;
        }
    }
}

fn add_at(matrix: &mut Mat<f64>, node: usize, part: &[[f64; 2]; 2]) {
    let at = NODE * node;
    for (i, row) in part.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            matrix[(at + i, at + j)] += value;
        }
    }
}
