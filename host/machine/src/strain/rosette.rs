//! Converts the readings of a three-gauge rosette to plane strain, and that to principal strains
//! and their direction (m/m, rad). A library function: no command uses it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Directions of the three grids `a`, `b`, `c`, counter-clockwise from the x axis.
///
/// A grid at the angle `phi` reads `ex cos^2 phi + ey sin^2 phi + gxy sin phi cos phi`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Rosette {
    /// Rectangular, 0/45/90 degrees: `ex = a`, `ey = c`, `gxy = 2 b - a - c`.
    #[serde(rename = "rectangular")]
    Rectangular,
    /// Rectangular with the x axis along the middle grid, -45/0/45 degrees:
    /// `ex = b`, `ey = a + c - b`, `gxy = c - a`.
    #[serde(rename = "rectangular-centred")]
    RectangularCentred,
    /// Delta, 0/60/120 degrees: `ex = a`, `ey = (2 b + 2 c - a) / 3`, `gxy = 2 (b - c) / sqrt 3`.
    #[serde(rename = "delta")]
    Delta,
}

/// Plane strain at a point of the surface, all in m/m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneStrain {
    /// Normal strain along x.
    pub x: f64,
    /// Normal strain along y.
    pub y: f64,
    /// Engineering shear strain, positive where the right angle between +x and +y gets smaller.
    pub shear: f64,
}

/// Principal strains, all strains in m/m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipalStrains {
    /// Larger principal strain.
    pub maximum: f64,
    /// Smaller principal strain.
    pub minimum: f64,
    /// Largest engineering shear strain in the plane, `maximum - minimum`.
    pub max_shear: f64,
    /// Angle from the x axis, counter-clockwise, to the direction of `maximum` (rad),
    /// -pi/2 to pi/2; 0 where both principal strains are equal.
    pub angle_rad: f64,
}

impl Rosette {
    /// Plane strain from the readings of the grids `a`, `b`, `c` [m/m].
    pub fn plane_strain(self, [a, b, c]: [f64; 3]) -> PlaneStrain {
        match self {
            Self::Rectangular => PlaneStrain {
                x: a,
                y: c,
                shear: 2.0 * b - a - c,
            },
            Self::RectangularCentred => PlaneStrain {
                x: b,
                y: a + c - b,
                shear: c - a,
            },
            Self::Delta => PlaneStrain {
                x: a,
                y: (2.0 * b + 2.0 * c - a) / 3.0,
                shear: 2.0 * (b - c) / 3f64.sqrt(),
            },
        }
    }
}

impl PlaneStrain {
    /// Principal strains by Mohr's circle.
    ///
    /// `e1, e2 = (ex + ey)/2 +- sqrt(((ex - ey)/2)^2 + (gxy/2)^2)`,
    /// `tan(2 angle) = gxy / (ex - ey)`
    pub fn principal(self) -> PrincipalStrains {
        let centre = f64::midpoint(self.x, self.y);
        let radius = f64::hypot((self.x - self.y) / 2.0, self.shear / 2.0);
        PrincipalStrains {
            maximum: centre + radius,
            minimum: centre - radius,
            max_shear: 2.0 * radius,
            angle_rad: f64::atan2(self.shear, self.x - self.y) / 2.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_principal(found: PrincipalStrains, expected: [f64; 4], tolerance: f64) {
        let degrees = found.angle_rad.to_degrees();
        let found = [found.maximum, found.minimum, found.max_shear, degrees];
        for (f, e) in found.iter().zip(expected) {
            assert!(
                (f - e).abs() < tolerance,
                "{found:?}, expected {expected:?}"
            );
        }
    }

    /// By hand, in um/m: 500/600/-100 gives gxy = 800, centre 200, radius sqrt(300^2 + 400^2).
    #[test]
    fn rectangular_worked_by_hand() {
        let principal = Rosette::Rectangular
            .plane_strain([500.0, 600.0, -100.0])
            .principal();
        assert_principal(principal, [700.0, -300.0, 1000.0, 26.565_051], 1e-6);
    }

    /// The same state measured by grids at -45/0/45: 200 - 400, 500, 200 + 400.
    #[test]
    fn rectangular_centred_worked_by_hand() {
        let plane = Rosette::RectangularCentred.plane_strain([-200.0, 500.0, 600.0]);
        assert_principal(plane.principal(), [700.0, -300.0, 1000.0, 26.565_051], 1e-6);
    }

    /// Readings 60/135/264 um/m: ex = 60, ey = 246, gxy = -149, e1 = 272, e2 = 33.9 um/m, e2 at
    /// 19.3 degrees below which e1 stands at right angles. Source: R. C. Hibbeler, Mechanics of
    /// Materials, example on the 60-degree rosette (three figures are given).
    #[test]
    fn delta_textbook_example() {
        let plane = Rosette::Delta.plane_strain([60.0, 135.0, 264.0]);
        assert!((plane.y - 246.0).abs() < 1e-9 && (plane.shear + 149.0).abs() < 0.1);
        assert_principal(plane.principal(), [272.1, 33.9, 238.3, -70.65], 0.1);
    }

    /// Any state, read by grids at any of the layouts' angles, comes back.
    #[test]
    fn layouts_agree_with_the_transformation_of_strain() {
        let state = PlaneStrain {
            x: 310e-6,
            y: -120e-6,
            shear: -455e-6,
        };
        for (rosette, degrees) in [
            (Rosette::Rectangular, [0.0, 45.0, 90.0]),
            (Rosette::RectangularCentred, [-45.0, 0.0, 45.0]),
            (Rosette::Delta, [0.0, 60.0, 120.0]),
        ] {
            let read = degrees.map(|d: f64| {
                let (s, c) = d.to_radians().sin_cos();
                state.x * c * c + state.y * s * s + state.shear * s * c
            });
            let found = rosette.plane_strain(read);
            for (f, e) in [
                (found.x, state.x),
                (found.y, state.y),
                (found.shear, state.shear),
            ] {
                assert!((f - e).abs() < 1e-15, "{rosette:?}: {found:?}");
            }
        }
    }

    #[test]
    fn equal_strain_in_all_directions_has_no_shear() {
        let principal = Rosette::Delta.plane_strain([1e-4; 3]).principal();
        assert!(principal.max_shear < 1e-18);
        assert!((principal.maximum - 1e-4).abs() < 1e-18);
    }
}
