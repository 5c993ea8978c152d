//! Defines the description of a gearbox's planetary stage, helical stages and shaft bearings
//! (`[drivetrain.gears]`), from which `loadtwin reduce` computes forces on the housing. Checks
//! teeth and bearings, and computes ratio and pitch radii.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::field_checks::{Checked, at_least, nonzero, positive, range, unique, within};

/// A planetary stage with fixed ring gear, driven at its carrier, and helical
/// stages behind its sun.
///
/// Coordinates: z along the main shaft, in the sense in which the carrier's
/// positive turning is right-handed; x and y from its axis; the mid-plane of
/// the ring gear is z = 0. The sun's shaft is shaft 0 and lies on the axis;
/// each helical stage leads from one shaft to the next.
///
/// Source: Bosmans et al. 2023, section 4.1.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gears {
    /// The planetary stage.
    pub planetary: Planetary,
    /// Helical stages in the order of the chain.
    #[serde(default, rename = "helical")]
    pub helical: Vec<Helical>,
    /// Bearings in the housing, two for each shaft from the sun's on.
    #[serde(default, rename = "bearing")]
    pub bearings: Vec<ShaftBearing>,
}

/// A planetary stage whose planets share the load equally.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Planetary {
    /// Number of planets in equal steps, 1 to 12.
    pub planets: u32,
    /// Teeth of the sun, at least 5.
    pub sun_teeth: u32,
    /// Teeth of the ring gear, more than the sun's; with the sun's a multiple of the planets.
    pub ring_teeth: u32,
    /// Normal module (m), > 0.
    pub normal_module_m: f64,
    /// Pressure angle in the normal section (degrees), 5 to 45.
    pub pressure_angle_deg: f64,
    /// Helix angle of the ring gear (degrees), -45 to 45; positive where right-handed.
    #[serde(default)]
    pub helix_angle_deg: f64,
    /// Teeth of the ring gear that share a planet's force (the total contact ratio), 0 to
    /// 10; 0 for a point load (paper).
    #[serde(default)]
    pub contact_ratio: f64,
    /// Where the first planet stands when the carrier angle is 0 (degrees).
    #[serde(default)]
    pub first_planet_deg: f64,
}

/// A helical stage: the wheel on one shaft drives the pinion on the next.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Helical {
    /// Teeth of the wheel, at least 5.
    pub wheel_teeth: u32,
    /// Teeth of the pinion, at least 5.
    pub pinion_teeth: u32,
    /// Normal module (m), > 0.
    pub normal_module_m: f64,
    /// Pressure angle in the normal section (degrees), 5 to 45.
    pub pressure_angle_deg: f64,
    /// Helix angle of the wheel (degrees), -45 to 45; positive where right-handed.
    #[serde(default)]
    pub helix_angle_deg: f64,
    /// Where the middle of the mesh lies along the main shaft (m).
    pub z_m: f64,
    /// Direction from the wheel's axis to the pinion's [degrees from x to y].
    pub pinion_at_deg: f64,
}

/// A bearing in the housing.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ShaftBearing {
    /// What unit loads call it; not `ring`.
    pub name: String,
    /// Number of its shaft, 0 for the sun's.
    pub shaft: usize,
    /// Where it lies along the main shaft (m).
    pub z_m: f64,
    /// Whether it takes the axial force; one of the two of a shaft does.
    #[serde(default)]
    pub locating: bool,
}

impl Planetary {
    /// Pitch radius of a gear of `teeth` (m), `r = m_n z / (2 cos beta)`.
    pub fn radius(&self, teeth: u32) -> f64 {
        0.5 * self.normal_module_m * f64::from(teeth) / self.helix_angle_deg.to_radians().cos()
    }
}

impl Helical {
    /// Pitch radius of a gear of `teeth` (m), `r = m_n z / (2 cos beta)`.
    pub fn radius(&self, teeth: u32) -> f64 {
        0.5 * self.normal_module_m * f64::from(teeth) / self.helix_angle_deg.to_radians().cos()
    }
}

impl Gears {
    /// Turns of the last shaft per turn of the carrier; negative where it turns the other way.
    pub fn ratio(&self) -> f64 {
        let planetary =
            1.0 + f64::from(self.planetary.ring_teeth) / f64::from(self.planetary.sun_teeth);
        self.helical.iter().fold(planetary, |ratio, stage| {
            -ratio * f64::from(stage.wheel_teeth) / f64::from(stage.pinion_teeth)
        })
    }

    /// Checks ranges, and the teeth against the train's `speed_ratio`.
    pub(super) fn check(&self, speed_ratio: f64) -> Checked {
        self.check_planetary()?;
        self.check_helical()?;
        let ratio = self.ratio();
        within(
            "drivetrain.gears",
            format!("teeth of ratio {ratio:.3}"),
            (ratio / speed_ratio - 1.0).abs() < 1e-3,
            &format!("{speed_ratio}, the speed_ratio of the last inertia, to 0.1 %"),
        )?;
        self.check_bearings()
    }

    fn check_planetary(&self) -> Checked {
        let field = |name: &str| format!("drivetrain.gears.planetary.{name}");
        let p = &self.planetary;
        within(
            &field("planets"),
            p.planets,
            (1..=12).contains(&p.planets),
            "1 to 12",
        )?;
        within(
            &field("sun_teeth"),
            p.sun_teeth,
            p.sun_teeth >= 5,
            "at least 5",
        )?;
        within(
            &field("ring_teeth"),
            p.ring_teeth,
            p.ring_teeth > p.sun_teeth && (p.ring_teeth + p.sun_teeth).is_multiple_of(p.planets),
            "more than sun_teeth, and with sun_teeth a multiple of planets, so that these stand in equal steps",
        )?;
        positive(&field("normal_module_m"), p.normal_module_m)?;
        range(&field("contact_ratio"), p.contact_ratio, 0.0, 10.0)?;
        range(
            &field("pressure_angle_deg"),
            p.pressure_angle_deg,
            5.0,
            45.0,
        )?;
        range(&field("helix_angle_deg"), p.helix_angle_deg, -45.0, 45.0)?;
        range(
            &field("first_planet_deg"),
            p.first_planet_deg,
            -360.0,
            360.0,
        )
    }

    fn check_helical(&self) -> Checked {
        for (i, stage) in self.helical.iter().enumerate() {
            let field = |name: &str| format!("drivetrain.gears.helical[{}].{name}", i + 1);
            within(
                &field("wheel_teeth"),
                stage.wheel_teeth,
                stage.wheel_teeth >= 5,
                "at least 5",
            )?;
            within(
                &field("pinion_teeth"),
                stage.pinion_teeth,
                stage.pinion_teeth >= 5,
                "at least 5",
            )?;
            positive(&field("normal_module_m"), stage.normal_module_m)?;
            range(
                &field("pressure_angle_deg"),
                stage.pressure_angle_deg,
                5.0,
                45.0,
            )?;
            range(
                &field("helix_angle_deg"),
                stage.helix_angle_deg,
                -45.0,
                45.0,
            )?;
            at_least(&field("z_m"), stage.z_m, -100.0)?;
            range(&field("pinion_at_deg"), stage.pinion_at_deg, -360.0, 360.0)?;
        }
        Ok(())
    }

    fn check_bearings(&self) -> Checked {
        let names: Vec<&str> = self.bearings.iter().map(|b| b.name.as_str()).collect();
        unique("drivetrain.gears.bearing", &names)?;
        for (i, bearing) in self.bearings.iter().enumerate() {
            let field = |name: &str| format!("drivetrain.gears.bearing[{}].{name}", i + 1);
            within(
                &field("name"),
                &bearing.name,
                bearing.name != "ring",
                "any but ring",
            )?;
            within(
                &field("shaft"),
                bearing.shaft,
                bearing.shaft <= self.helical.len(),
                &format!("0 to {}", self.helical.len()),
            )?;
            at_least(&field("z_m"), bearing.z_m, -100.0)?;
        }
        for shaft in 0..=self.helical.len() {
            let of_shaft: Vec<&ShaftBearing> =
                self.bearings.iter().filter(|b| b.shaft == shaft).collect();
            let locating = of_shaft.iter().filter(|b| b.locating).count();
            within(
                "drivetrain.gears.bearing",
                format!(
                    "{} on shaft {shaft}, {locating} of them locating",
                    of_shaft.len()
                ),
                of_shaft.len() == 2 && locating == 1,
                "2 on each shaft, one of them locating",
            )?;
            if let [a, b] = of_shaft[..] {
                nonzero(
                    &format!(
                        "drivetrain.gears.bearing: distance of {} and {}",
                        a.name, b.name
                    ),
                    b.z_m - a.z_m,
                )?;
            }
        }
        Ok(())
    }
}
