//! Computes mass, stiffness and gyroscopic matrix (8 x 8) of a cylindrical Timoshenko beam element
//! of a shaft from its length, diameters and material.

/// Degrees of freedom of a node: `x`, `y`, `alpha` about x, `beta` about y.
pub const NODE: usize = 4;

/// Degrees of freedom of an element: its two nodes.
const SIZE: usize = 2 * NODE;

/// A square matrix over the degrees of freedom of an element.
pub type ElementMatrix = [[f64; SIZE]; SIZE];

/// A cylindrical element of a Timoshenko beam with gyroscopic terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaftElement {
    /// Length (m), > 0.
    pub length_m: f64,
    /// Outer diameter (m), > 0.
    pub outer_m: f64,
    /// Inner diameter (m), >= 0, < outer.
    pub inner_m: f64,
    /// Modulus of elasticity (Pa), > 0.
    pub young_pa: f64,
    /// Density [kg/m^3], > 0.
    pub density_kg_per_m3: f64,
    /// Poisson's ratio, > -1, < 0.5.
    pub poisson: f64,
}

/// Mass, stiffness and gyroscopic matrix of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementMatrices {
    /// `M` [kg, kg m, kg m^2].
    pub mass: ElementMatrix,
    /// `K` [N/m, N/rad, N m/rad].
    pub stiffness: ElementMatrix,
    /// `G`, antisymmetric: forces are `-speed G q'`.
    pub gyroscopic: ElementMatrix,
}

impl ShaftElement {
    /// Cross-section [m^2].
    pub fn area_m2(&self) -> f64 {
        std::f64::consts::PI / 4.0 * (self.outer_m.powi(2) - self.inner_m.powi(2))
    }

    /// Second moment of area about a diameter [m^4].
    pub fn second_moment_m4(&self) -> f64 {
        std::f64::consts::PI / 64.0 * (self.outer_m.powi(4) - self.inner_m.powi(4))
    }

    /// Shear coefficient of a hollow circle of the ratio `m = inner / outer`:
    /// `6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2)`.
    ///
    /// Source: Cowper, The shear coefficient in Timoshenko's beam theory,
    /// J. Appl. Mech. 33 (1966).
    pub fn shear_coefficient(&self) -> f64 {
        let (m2, nu) = ((self.inner_m / self.outer_m).powi(2), self.poisson);
        let square = (1.0 + m2).powi(2);
        6.0 * (1.0 + nu) * square / ((7.0 + 6.0 * nu) * square + (20.0 + 12.0 * nu) * m2)
    }

    /// The element's matrices, 8 x 8, first node first.
    ///
    /// `phi = 12 E I / (kappa G A l^2)`; with `phi = 0` and without rotatory
    /// inertia it is the beam of Euler and Bernoulli.
    ///
    /// Source: Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines
    /// (2010), section 5.4; Rezende et al. 2023, eq. (1).
    pub fn matrices(&self) -> ElementMatrices {
        let (l, area, inertia) = (self.length_m, self.area_m2(), self.second_moment_m4());
        let shear_pa = self.young_pa / (2.0 * (1.0 + self.poisson));
        let phi =
            12.0 * self.young_pa * inertia / (self.shear_coefficient() * shear_pa * area * l * l);
        let shear = 1.0 + phi;

        let bending = self.young_pa * inertia / (shear * l.powi(3));
        let stiffness = Bending {
            near: 12.0,
            tilt: 6.0 * l,
            turn: (4.0 + phi) * l * l,
            far: -12.0,
            far_tilt: 6.0 * l,
            far_turn: (2.0 - phi) * l * l,
        };
        let translation = self.density_kg_per_m3 * area * l / (840.0 * shear * shear);
        let moving = Bending {
            near: 312.0 + 588.0 * phi + 280.0 * phi * phi,
            tilt: (44.0 + 77.0 * phi + 35.0 * phi * phi) * l,
            turn: (8.0 + 14.0 * phi + 7.0 * phi * phi) * l * l,
            far: 108.0 + 252.0 * phi + 140.0 * phi * phi,
            far_tilt: -(26.0 + 63.0 * phi + 35.0 * phi * phi) * l,
            far_turn: -(6.0 + 14.0 * phi + 7.0 * phi * phi) * l * l,
        };
        let rotation = self.density_kg_per_m3 * inertia / (30.0 * l * shear * shear);
        let turning = Bending {
            near: 36.0,
            tilt: (3.0 - 15.0 * phi) * l,
            turn: (4.0 + 5.0 * phi + 10.0 * phi * phi) * l * l,
            far: -36.0,
            far_tilt: (3.0 - 15.0 * phi) * l,
            far_turn: (-1.0 - 5.0 * phi + 5.0 * phi * phi) * l * l,
        };

        let mut parts = ElementMatrices {
            mass: [[0.0; SIZE]; SIZE],
            stiffness: stiffness.in_both_planes(bending),
            // The polar moment of a slice is twice the diametral one.
            gyroscopic: turning.across_planes(2.0 * rotation),
        };
        let (moving, turning) = (
            moving.in_both_planes(translation),
            turning.in_both_planes(rotation),
        );
        for i in 0..SIZE {
            for j in 0..SIZE {
                parts.mass[i][j] = moving[i][j] + turning[i][j];
            }
        }
        parts
    }
}

/// The six different entries of a symmetric matrix over `w1, w1', w2, w2'`, the
/// deflections and slopes at both ends.
///
/// At the far end tilts have the other sign: `[near tilt far far_tilt; . turn
/// -far_tilt far_turn; . . near -tilt; . . . turn]`.
struct Bending {
    near: f64,
    tilt: f64,
    turn: f64,
    far: f64,
    far_tilt: f64,
    far_turn: f64,
}

impl Bending {
    fn in_one_plane(&self) -> [[f64; 4]; 4] {
        let Self {
            near,
            tilt,
            turn,
            far,
            far_tilt,
            far_turn,
        } = *self;
        [
            [near, tilt, far, far_tilt],
            [tilt, turn, -far_tilt, far_turn],
            [far, -far_tilt, near, -tilt],
            [far_tilt, far_turn, -tilt, turn],
        ]
    }

    /// Slopes are `x' = beta` and `y' = -alpha`.
    fn in_both_planes(&self, factor: f64) -> ElementMatrix {
        let plane = self.in_one_plane();
        let mut matrix = [[0.0; SIZE]; SIZE];
        for i in 0..4 {
            for j in 0..4 {
                let value = factor * plane[i][j];
                matrix[PLANE_X[i].0][PLANE_X[j].0] = value;
                matrix[PLANE_Y[i].0][PLANE_Y[j].0] = value * PLANE_Y[i].1 * PLANE_Y[j].1;
            }
        }
        matrix
    }

    /// Couples the slopes of one plane with those of the other, antisymmetric.
    fn across_planes(&self, factor: f64) -> ElementMatrix {
        let plane = self.in_one_plane();
        let mut matrix = [[0.0; SIZE]; SIZE];
        for i in 0..4 {
            for j in 0..4 {
                let (row, column) = (PLANE_X[i].0, PLANE_Y[j].0);
                let value = factor * plane[i][j] * PLANE_Y[j].1;
                matrix[row][column] = value;
                matrix[column][row] = -value;
            }
        }
        matrix
    }
}

/// Degrees of freedom of `w1, w1', w2, w2'` for bending in the plane of x, with their signs.
const PLANE_X: [(usize, f64); 4] = [(0, 1.0), (3, 1.0), (4, 1.0), (7, 1.0)];

/// The same in the plane of y, where a slope is `-alpha`.
const PLANE_Y: [(usize, f64); 4] = [(1, 1.0), (2, -1.0), (5, 1.0), (6, -1.0)];

#[cfg(test)]
mod tests {
    use super::*;

    const ELEMENT: ShaftElement = ShaftElement {
        length_m: 0.25,
        outer_m: 0.05,
        inner_m: 0.02,
        young_pa: 211e9,
        density_kg_per_m3: 7810.0,
        poisson: 0.3,
    };

    fn product(matrix: &ElementMatrix, v: [f64; SIZE]) -> [f64; SIZE] {
        matrix.map(|row| row.iter().zip(v).map(|(m, v)| m * v).sum())
    }

    #[test]
    fn rigid_motions_bend_nothing_and_carry_the_whole_mass() {
        let parts = ELEMENT.matrices();
        let shift = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        // About y by 1 rad: x' = beta.
        let tilt = [0.0, 0.0, 0.0, 1.0, ELEMENT.length_m, 0.0, 0.0, 1.0];
        let scale = parts.stiffness[0][0];
        for motion in [shift, tilt] {
            let force = product(&parts.stiffness, motion);
            assert!(force.iter().all(|f| f.abs() < 1e-12 * scale), "{force:?}");
        }
        let momentum = product(&parts.mass, shift);
        let mass = ELEMENT.density_kg_per_m3 * ELEMENT.area_m2() * ELEMENT.length_m;
        assert!((momentum[0] + momentum[4] - mass).abs() < 1e-12 * mass);
    }

    /// ROSS 2.3.0, `ShaftElement(L=2, idl=0, odl=0.02).Kst()` of that material: rows of `x` and
    /// `beta` over `y` and `alpha`, against the sign of `G` and without shear, which is little here.
    #[test]
    fn what_acceleration_adds_to_the_stiffness_is_that_of_ross_but_for_its_sign() {
        let slender = ShaftElement {
            length_m: 2.0,
            outer_m: 0.02,
            inner_m: 0.0,
            ..ELEMENT
        };
        let g = slender.matrices().gyroscopic;
        let (near, tilt, turn, far) = (
            7.360_751_587e-5,
            1.226_791_931e-5,
            3.271_445_150e-5,
            -8.178_612_875e-6,
        );
        let ross = [
            (0, [-near, tilt, near, tilt]),
            (3, [-tilt, turn, tilt, far]),
            (4, [near, -tilt, -near, -tilt]),
            (7, [-tilt, far, tilt, turn]),
        ];
        for (row, values) in ross {
            for (column, value) in [1, 2, 5, 6].into_iter().zip(values) {
                assert!(
                    (g[row][column] + value).abs() < 1e-3 * near,
                    "{row} {column}"
                );
            }
        }
    }

    /// A cantilever under a force at its end: `F l^3 / (3 E I) + F l / (kappa G A)`.
    #[test]
    fn a_cantilever_sags_as_by_hand() {
        let k = ELEMENT.matrices().stiffness;
        let (a, b, d) = (k[4][4], k[4][7], k[7][7]);
        let sag = d / (a * d - b * b);
        let inertia = ELEMENT.second_moment_m4();
        let shear_pa = ELEMENT.young_pa / 2.6;
        let expected = ELEMENT.length_m.powi(3) / (3.0 * ELEMENT.young_pa * inertia)
            + ELEMENT.length_m / (ELEMENT.shear_coefficient() * shear_pa * ELEMENT.area_m2());
        assert!((sag / expected - 1.0).abs() < 1e-12);
    }
}
