//! Computes approach and angle of a ball's contact at any azimuth from the displacement of the
//! inner ring and the deformation of the outer ring; from all contacts the five bearing loads and
//! the ring deformation that they cause, towards which the cascade relaxes its own. Load model of
//! Kerst et al. 2019, eq. (4)-(9).

use std::f64::consts::TAU;

use loadtwin_common::bearing::contact::Geometry;
use loadtwin_common::bearing::{LOADS, ROWS};
use nalgebra::{SMatrix, SVector};

use crate::bearing::physical_parameters::{PhysicalParameters, geometry};
use crate::error::BuildError;
use loadtwin_machine::{Bearing, SHAPES};

/// Displacement of the inner ring `(dx, dy, dz, R gx, R gz)` [um].
pub type Displacement = SVector<f64, LOADS>;
/// Amplitudes of the outer ring's shapes [um].
pub type Ring = SVector<f64, SHAPES>;

/// One contact.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// Normal approach, eq. (5) [um].
    pub approach: f64,
    /// Contact angle, eq. (6) [rad].
    pub angle: f64,
}

/// A bearing as it is described.
pub struct LoadModel {
    geometry: Geometry,
    compliance: SMatrix<f64, SHAPES, SHAPES>,
    coupling: f64,
}

impl LoadModel {
    /// The model of a bearing as it is described.
    ///
    /// # Errors
    /// When the description makes no geometry.
    pub fn try_new(bearing: &Bearing) -> Result<Self, BuildError> {
        let compliance = &bearing.compliance_um_per_kn;
        Ok(Self {
            geometry: geometry(bearing, &PhysicalParameters::default())?,
            compliance: SMatrix::from_fn(|i, j| compliance[i][j]),
            coupling: bearing.row_coupling,
        })
    }

    /// The geometry.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Approach and angle at an azimuth of a row; with the rows' offset, and each row's own ring.
    ///
    /// Source: Kerst et al. 2019, eq. (5)-(6).
    pub fn contact(&self, inner: &Displacement, radial: f64, row: usize, psi: f64) -> Contact {
        let g = &self.geometry;
        let (cos0, sin0) = g.contact_angle;
        let (groove, side) = (f64::from(g.groove_um), side(row));
        let (sin, cos) = psi.sin_cos();
        let tilt = inner[4] * cos - inner[3] * sin;
        let across = groove * f64::from(cos0)
            + inner[0] * cos
            + inner[2] * sin
            + side * f64::from(g.row_offset) * tilt
            - radial;
        let along = groove * f64::from(sin0) + f64::from(g.preload_um) + side * (inner[1] + tilt);
        Contact {
            approach: across.hypot(along) - groove,
            angle: along.atan2(across),
        }
    }

    /// `Q` of an approach [kN]; none where there is none.
    ///
    /// Source: Kerst et al. 2019, eq. (4).
    pub fn load(&self, approach: f64) -> f64 {
        f64::from(self.geometry.stiffness) * approach.max(0.0).powf(1.5)
    }

    /// The approach that makes a load.
    pub fn approach(&self, load: f64) -> f64 {
        (load.max(0.0) / f64::from(self.geometry.stiffness)).powf(2.0 / 3.0)
    }

    /// `Fx, Fy, Fz, Mx / R, Mz / R` [kN] and the ring under each row that goes with them, with the
    /// lever `R sin(alpha) + h cos(alpha)` of each contact.
    ///
    /// Source: Kerst et al. 2019, eq. (7)-(9).
    pub fn loads(&self, inner: &Displacement, ring: &[Ring; ROWS]) -> (Displacement, [Ring; ROWS]) {
        let balls = self.geometry.balls;
        let lever = f64::from(self.geometry.row_offset);
        let mut loads = Displacement::zeros();
        let mut pushed = [Ring::zeros(); ROWS];
        for (row, (ring, pushed)) in ring.iter().zip(&mut pushed).enumerate() {
            for ball in 0..balls {
                let psi = TAU * f64::from(ball) / f64::from(balls);
                let shapes = shapes(psi);
                let contact = self.contact(inner, shapes.dot(ring), row, psi);
                let load = self.load(contact.approach);
                let (radial, axial) = (
                    load * contact.angle.cos(),
                    side(row) * load * contact.angle.sin(),
                );
                let turning = axial + side(row) * lever * radial;
                let (sin, cos) = psi.sin_cos();
                loads += SVector::from([
                    radial * cos,
                    axial,
                    radial * sin,
                    -turning * sin,
                    turning * cos,
                ]);
                *pushed += shapes * radial;
            }
        }
        let bent =
            |row: usize| self.compliance * (pushed[row] + pushed[ROWS - 1 - row] * self.coupling);
        (loads, [bent(0), bent(1)])
    }
}

/// The ring's shapes at an azimuth.
pub fn shapes(psi: f64) -> Ring {
    let (sin2, cos2) = (2.0 * psi).sin_cos();
    let (sin3, cos3) = (3.0 * psi).sin_cos();
    Ring::from([1.0, cos2, sin2, cos3, sin3])
}

/// Row 0 takes axial force along +y, row 1 along -y.
fn side(row: usize) -> f64 {
    if row == 0 { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use loadtwin_common::bearing::contact::Contacts;
    use loadtwin_machine::{Kind, Machine};

    /// The displacements at which the joint filter's equilibrium carries a load carry it here,
    /// and bend the ring as it is bent there.
    #[test]
    fn equilibrium_is_that_of_the_joint_filter() {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../examples/bearing/machine.toml"
        );
        let machine = Machine::load(path.as_ref()).unwrap();
        let Some(Kind::Bearing(bearing)) = machine.kind() else {
            unreachable!("the example is a bearing");
        };
        let model = LoadModel::try_new(bearing).unwrap();
        let applied = [-2.0_f32, 3.0, 7.0, 20.0, -5.0];
        let at = Contacts::try_new(model.geometry().clone())
            .unwrap()
            .solve_equilibrium(&applied, 0.0)
            .position
            .map(f64::from);
        let ring = [&at[LOADS..LOADS + SHAPES], &at[LOADS + SHAPES..]].map(Ring::from_row_slice);
        let (loads, bent) = model.loads(&Displacement::from_row_slice(&at[..LOADS]), &ring);
        for (load, applied) in loads.iter().zip(applied) {
            assert!(
                (load - f64::from(applied)).abs() < 0.3,
                "{loads} {applied:?}"
            );
        }
        for (bent, ring) in bent.iter().zip(&ring) {
            assert!((bent - ring).amax() < 0.5, "{bent} {ring}");
        }
    }
}
