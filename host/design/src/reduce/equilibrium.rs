//! Computes the quasi-static forces of planets and shaft bearings on a gearbox's housing for 1 N m
//! of carrier torque from the gear geometry, without losses, weight and inertia (`HousingForces`).
//! `axes` gives the places of the shafts' axes.

use std::f64::consts::TAU;

use loadtwin_machine::{Gears, Helical};

/// Force on the housing per unit of torque at the carrier [N/(N m)]: x, y, z.
pub type Force = [f64; 3];

/// What the carrier's torque does to the housing, per N m.
#[derive(Clone, Debug)]
pub struct HousingForces {
    /// On the ring gear, from each planet: along the carrier's sense of turning,
    /// away from the axis, along z.
    pub contact: Contact,
    /// Arc of the ring gear over which each planet's force is spread evenly (rad).
    pub arc_rad: f64,
    /// Angles of the planets at carrier angle 0 (rad).
    pub planets: Vec<f64>,
    /// On the seat of each bearing, in the order of the description.
    pub bearings: Vec<Force>,
}

/// Force of a tooth contact in the directions of its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Along the carrier's sense of turning.
    pub tangential: f64,
    /// Away from the axis.
    pub radial: f64,
    /// Along z.
    pub axial: f64,
}

impl Contact {
    /// The force at `angle` (rad) around the main shaft.
    pub fn at(&self, angle: f64) -> Force {
        let (s, c) = angle.sin_cos();
        [
            self.radial * c - self.tangential * s,
            self.radial * s + self.tangential * c,
            self.axial,
        ]
    }
}

/// A force on a shaft and where it acts, from the shaft's axis.
struct Acting {
    at: [f64; 3],
    force: Force,
}

impl HousingForces {
    /// The forces at 1 N m of carrier torque, without losses, weight and
    /// inertia.
    ///
    /// Ring gear: `T_r = T z_r / (z_r + z_s)` in the carrier's sense, shared
    /// equally: `F_t = T_r / (N r_r)`, `F_r = F_t tan(alpha_n) / cos(beta)` outwards,
    /// `F_z = -F_t tan(beta)` for a right-handed ring gear. Wheel on shaft i with
    /// torque `T_i`: `F_t = T_i / r_w` against its turning, `F_r` towards its axis,
    /// `F_z = -F_theta tan(beta)`; the pinion the opposite. Bearings a and b of each
    /// shaft from `sum F = 0` and `sum M = 0` about x and y, the axial force at the
    /// locating one.
    ///
    /// Source: Bosmans et al. 2023, section 4.1; ISO 21771 for the directions.
    pub fn new(gears: &Gears) -> Self {
        let p = &gears.planetary;
        let teeth = f64::from(p.ring_teeth + p.sun_teeth);
        let n = f64::from(p.planets);
        let beta = p.helix_angle_deg.to_radians();
        let tangential = f64::from(p.ring_teeth) / teeth / (n * p.radius(p.ring_teeth));
        let radial = tangential * p.pressure_angle_deg.to_radians().tan() / beta.cos();
        let axial = -tangential * beta.tan();
        // The sun gets what the ring gear gets, the other way: planets float.
        let mut forces: Vec<Vec<Acting>> = (0..=gears.helical.len()).map(|_| Vec::new()).collect();
        forces[0].push(Acting {
            at: [0.0; 3],
            force: [0.0, 0.0, -n * axial],
        });
        // Torque that drives shaft i, signed about z.
        let mut torque = f64::from(p.sun_teeth) / teeth;
        for (i, stage) in gears.helical.iter().enumerate() {
            let (on_wheel, on_pinion) = mesh(stage, torque);
            forces[i].push(on_wheel);
            forces[i + 1].push(on_pinion);
            torque *= -f64::from(stage.pinion_teeth) / f64::from(stage.wheel_teeth);
        }
        let first = p.first_planet_deg.to_radians();
        Self {
            contact: Contact {
                tangential,
                radial,
                axial,
            },
            arc_rad: TAU * p.contact_ratio / f64::from(p.ring_teeth),
            planets: (0..p.planets)
                .map(|k| first + TAU * f64::from(k) / n)
                .collect(),
            bearings: gears
                .bearings
                .iter()
                .map(|bearing| {
                    let other = gears
                        .bearings
                        .iter()
                        .find(|b| b.shaft == bearing.shaft && b.name != bearing.name)
                        .map_or(f64::INFINITY, |b| b.z_m);
                    reaction(&forces[bearing.shaft], bearing.z_m, other, bearing.locating)
                })
                .collect(),
        }
    }
}

/// Forces on wheel and pinion where the wheel is driven by `torque`, signed about z.
fn mesh(stage: &Helical, torque: f64) -> (Acting, Acting) {
    let (s, c) = stage.pinion_at_deg.to_radians().sin_cos();
    let beta = stage.helix_angle_deg.to_radians();
    let (wheel, pinion) = (
        stage.radius(stage.wheel_teeth),
        stage.radius(stage.pinion_teeth),
    );
    let around = -torque / wheel;
    let outwards = -around.abs() * stage.pressure_angle_deg.to_radians().tan() / beta.cos();
    let force = Contact {
        tangential: around,
        radial: outwards,
        axial: -around * beta.tan(),
    }
    .at(stage.pinion_at_deg.to_radians());
    let place = |radius: f64| [radius * c, radius * s, stage.z_m];
    (
        Acting {
            at: place(wheel),
            force,
        },
        Acting {
            at: place(-pinion),
            force: force.map(|f| -f),
        },
    )
}

/// What a bearing at `z` passes to the housing; the shaft's other one is at `other`.
fn reaction(forces: &[Acting], z: f64, other: f64, locating: bool) -> Force {
    // Moments about the point on the axis at the other bearing.
    let mut reaction = [0.0; 3];
    for Acting { at, force } in forces {
        let lever = at[2] - other;
        reaction[0] += (lever * force[0] - at[0] * force[2]) / (z - other);
        reaction[1] += (lever * force[1] - at[1] * force[2]) / (z - other);
        reaction[2] += if locating { force[2] } else { 0.0 };
    }
    reaction
}

/// Axes of the shafts (m), in x and y.
pub fn axes(gears: &Gears) -> Vec<[f64; 2]> {
    let mut axes = vec![[0.0; 2]];
    for stage in &gears.helical {
        let [x, y] = axes[axes.len() - 1];
        let distance = stage.radius(stage.wheel_teeth) + stage.radius(stage.pinion_teeth);
        let (s, c) = stage.pinion_at_deg.to_radians().sin_cos();
        axes.push([x + distance * c, y + distance * s]);
    }
    axes
}

#[cfg(test)]
mod tests {
    use super::*;
    use loadtwin_machine::{Planetary, ShaftBearing};

    fn gears(hand: f64) -> Gears {
        let stage = |wheel, pinion, module, helix, z, at| Helical {
            wheel_teeth: wheel,
            pinion_teeth: pinion,
            normal_module_m: module,
            pressure_angle_deg: 20.0,
            helix_angle_deg: hand * helix,
            z_m: z,
            pinion_at_deg: at,
        };
        let bearing = |name: &str, shaft, z, locating| ShaftBearing {
            name: name.into(),
            shaft,
            z_m: z,
            locating,
        };
        Gears {
            planetary: Planetary {
                planets: 3,
                sun_teeth: 18,
                ring_teeth: 90,
                normal_module_m: 0.011,
                pressure_angle_deg: 20.0,
                helix_angle_deg: hand * 7.0,
                contact_ratio: 0.0,
                first_planet_deg: 10.0,
            },
            helical: vec![
                stage(103, 28, 0.008, 10.0, 0.5, 25.0),
                stage(70, 25, 0.006, -12.0, 0.62, 100.0),
            ],
            bearings: vec![
                bearing("sun a", 0, 0.4, true),
                bearing("sun b", 0, 0.7, false),
                bearing("middle a", 1, 0.4, false),
                bearing("middle b", 1, 0.7, true),
                bearing("fast a", 2, 0.4, false),
                bearing("fast b", 2, 0.7, true),
            ],
        }
    }

    /// The housing gets what rotor and generator put in: no force, and the moment
    /// `T - T / i` about z; about x and y nothing is left but what shafts at other
    /// places carry, which these do not.
    #[test]
    fn the_housing_is_in_equilibrium_with_both_ends_of_the_train() {
        for hand in [-1.0, 0.0, 1.0] {
            let gears = gears(hand);
            let forces = HousingForces::new(&gears);
            let axes = axes(&gears);
            let (mut force, mut moment) = ([0.0; 3], [0.0; 3]);
            let mut add = |at: [f64; 3], f: Force| {
                for i in 0..3 {
                    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                    force[i] += f[i];
                    moment[i] += at[j] * f[k] - at[k] * f[j];
                }
            };
            let radius = gears.planetary.radius(90);
            for angle in &forces.planets {
                let (s, c) = angle.sin_cos();
                add([radius * c, radius * s, 0.0], forces.contact.at(*angle));
            }
            for (bearing, f) in gears.bearings.iter().zip(&forces.bearings) {
                let [x, y] = axes[bearing.shaft];
                add([x, y, bearing.z_m], *f);
            }
            assert!(force.iter().all(|f| f.abs() < 1e-12), "{force:?}");
            let expected = [0.0, 0.0, 1.0 - 1.0 / gears.ratio()];
            for (found, expected) in moment.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-12, "{moment:?}");
            }
        }
    }

    /// By hand, spur gears: ring torque 90/108, radius 0.495, 3 planets: 0.5612 N;
    /// wheel: 18/108 over 0.412: 0.4045 N, of which the bearing at 0.4 takes
    /// (0.7 - 0.5) / (0.7 - 0.4) = 2/3.
    #[test]
    fn spur_gears_worked_by_hand() {
        let forces = HousingForces::new(&gears(0.0));
        assert!((forces.contact.tangential - 0.561_167_2).abs() < 1e-6);
        assert!((forces.contact.radial - 0.204_248).abs() < 1e-5);
        assert_eq!(forces.contact.axial, 0.0);
        let [x, y, z] = forces.bearings[0];
        let size = 2.0 / 3.0 * (18.0 / 108.0 / 0.412) / 20.0_f64.to_radians().cos();
        assert!((f64::hypot(x, y) - size).abs() < 1e-9 && z == 0.0);
        // Against the turning of the wheel and towards its axis: 25 - 90 - 20 degrees.
        let direction = f64::atan2(y, x).to_degrees();
        assert!((direction + 85.0).abs() < 1e-9, "{direction}");
    }
}
