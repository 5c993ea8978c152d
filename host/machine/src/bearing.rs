//! Defines the description of a double-row wheel bearing (`[bearing]`): geometry, stiffness,
//! preload, ring compliance, load ranges, gauges, filter tuning. Checks its fields, and computes
//! the axial approach by the preload.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::field_checks::{Checked, at_least, names, positive, range, unique, within};

/// Shapes of the outer ring: `1, cos 2, sin 2, cos 3, sin 3` of the azimuth.
pub const SHAPES: usize = 5;

/// A double-row angular-contact ball bearing, mounted back to back, whose
/// outer ring stands still and carries four gauges.
///
/// `x` points forward, `y` along the axis, `z` up; the azimuth runs from `x`
/// towards `z`. Loads are those that the inner ring puts on the outer ring,
/// in the middle between the rows. `docs/reference/bearing.md` draws them.
///
/// Source: Kerst et al. 2019, section III and fig. 4.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Bearing {
    /// Balls in each row, 6 to 40.
    pub balls: u8,
    /// Diameter of a ball (mm), > 0.
    pub ball_mm: f64,
    /// Diameter of the circle of the balls' centres (mm), > `ball_mm`.
    pub pitch_mm: f64,
    /// Distance between the planes of the two rows (mm), >= 0.
    pub rows_mm: f64,
    /// Unloaded contact angle (deg), 5 to 60.
    pub contact_angle_deg: f64,
    /// Radius of the grooves over the diameter of a ball, 0.505 to 0.6.
    #[serde(default = "conformity")]
    pub conformity: f64,
    /// Load-deflection factor of a ball between both rings, `K_n` of eq. (4)
    /// [N/mm^1.5], > 0.
    pub stiffness_n_per_mm_1_5: f64,
    /// Approach of each row by the preload (um), 0 to 100.
    pub preload_um: f64,
    /// Direction in which `preload_um` is counted.
    #[serde(default)]
    pub preload_along: PreloadAlong,
    /// Radial compliance of the outer ring in its seat, eq. (7)-(8): row k,
    /// column l is the amplitude of shape k by a ball load of unit component in shape l
    /// [um/kN]; shapes `1, cos 2, sin 2, cos 3, sin 3`; symmetric, positive.
    pub compliance_um_per_kn: [[f64; SHAPES]; SHAPES],
    /// How much of a row's deformation reaches the other row, 0 to 0.95.
    pub row_coupling: f64,
    /// Ranges of the loads: the denominators of relative errors.
    pub range: LoadRanges,
    /// The four gauges.
    #[serde(rename = "gauge")]
    pub gauges: Vec<OuterRingGauge>,
    /// File written by `loadtwin calibrate`: how the gauges answer.
    pub calibration: Option<PathBuf>,
    /// How the filter is tuned.
    #[serde(default)]
    pub filter: BearingFilter,
}

/// Direction in which the preload's approach is counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PreloadAlong {
    /// Along the axis of turning: by how much the inner ring's halves are shorter.
    #[default]
    Axial,
    /// Along the line of contact: by how much a ball is pressed between the grooves.
    Normal,
}

/// From the smallest to the largest load that is expected.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LoadRanges {
    /// Longitudinal force (N).
    pub fx_n: [f64; 2],
    /// Axial force (N).
    pub fy_n: [f64; 2],
    /// Vertical force (N).
    pub fz_n: [f64; 2],
    /// Over-turning moment [N m].
    pub mx_nm: [f64; 2],
    /// Self-aligning moment [N m].
    pub mz_nm: [f64; 2],
}

impl LoadRanges {
    /// In the order of the estimates.
    pub fn all(&self) -> [[f64; 2]; 5] {
        [self.fx_n, self.fy_n, self.fz_n, self.mx_nm, self.mz_nm]
    }
}

/// Names of the loads in the order of the estimates.
pub const BEARING_LOADS: [&str; 5] = ["Fx", "Fy", "Fz", "Mx", "Mz"];

/// A gauge on the outer ring, midway between the rows.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OuterRingGauge {
    /// What channels call it.
    pub name: String,
    /// Azimuth (deg), from x towards z.
    pub azimuth_deg: f64,
}

/// Tuning of the bearing's joint filter.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BearingFilter {
    /// Standard deviation of a cage's slip, relative, > 0.
    pub slip_std: f64,
    /// Time in which slip forgets (s), > 0.
    pub slip_time_s: f64,
    /// Slip beyond which an estimate is not trusted, relative, > 0.
    pub slip_limit: f64,
    /// Random walk of the phase of ball passing [rad/sqrt(rad)], > 0.
    pub phase_walk: f64,
    /// Time in which loads return to those on the rig (s), > 0.
    pub load_time_s: f64,
    /// Standard deviation of the preload's approach (um), > 0.
    pub preload_std_um: f64,
    /// Its random walk [um/sqrt(s)], > 0.
    pub preload_walk_um: f64,
    /// Standard deviation of the bulk strains' offsets [um/m], > 0.
    pub bias_std: f64,
    /// Time in which an offset forgets (s), > 0.
    pub bias_time_s: f64,
    /// Error of the bulk strain's model [um/m], > 0.
    pub bulk_std: f64,
    /// Frequency of ball passing below which estimates are not valid (Hz), > 0.
    pub lowest_hz: f64,
}

impl Default for BearingFilter {
    fn default() -> Self {
        Self {
            slip_std: 0.004,
            slip_time_s: 1.0,
            slip_limit: 0.06,
            phase_walk: 0.01,
            load_time_s: 0.4,
            preload_std_um: 0.3,
            preload_walk_um: 0.2,
            bias_std: 15.0,
            bias_time_s: 8_200.0,
            bulk_std: 3.0,
            lowest_hz: 10.0,
        }
    }
}

fn conformity() -> f64 {
    0.52
}

impl Bearing {
    /// Distance of the grooves' centres without load, `A = (2 f - 1) D` (um).
    pub fn groove_um(&self) -> f64 {
        (2.0 * self.conformity - 1.0) * self.ball_mm * 1e3
    }

    /// The preload's approach along the axis (um), at a contact angle (rad).
    ///
    /// Of an approach `delta` along the line of contact: `p` with
    /// `(A cos a0)^2 + (A sin a0 + p)^2 = (A + delta)^2`, rows without other load.
    pub fn axial_preload_um(&self, contact_angle: f64) -> f64 {
        let (sin, cos) = contact_angle.sin_cos();
        let a = self.groove_um();
        match self.preload_along {
            PreloadAlong::Axial => self.preload_um,
            PreloadAlong::Normal => {
                ((a + self.preload_um).powi(2) - (a * cos).powi(2)).sqrt() - a * sin
            }
        }
    }

    pub(super) fn check(&self) -> Checked {
        let field = |name: &str| format!("bearing.{name}");
        let balls = self.balls;
        within(&field("balls"), balls, (6..=40).contains(&balls), "6 to 40")?;
        positive(&field("ball_mm"), self.ball_mm)?;
        within(
            &field("pitch_mm"),
            self.pitch_mm,
            self.pitch_mm > self.ball_mm && self.pitch_mm.is_finite(),
            "more than ball_mm",
        )?;
        at_least(&field("rows_mm"), self.rows_mm, 0.0)?;
        range(
            &field("contact_angle_deg"),
            self.contact_angle_deg,
            5.0,
            60.0,
        )?;
        range(&field("conformity"), self.conformity, 0.505, 0.6)?;
        positive(
            &field("stiffness_n_per_mm_1_5"),
            self.stiffness_n_per_mm_1_5,
        )?;
        range(&field("preload_um"), self.preload_um, 0.0, 100.0)?;
        range(&field("row_coupling"), self.row_coupling, 0.0, 0.95)?;
        for (k, row) in self.compliance_um_per_kn.iter().enumerate() {
            for (l, value) in row.iter().enumerate() {
                let mirrored = self.compliance_um_per_kn[l][k];
                within(
                    &field("compliance_um_per_kn"),
                    value,
                    value.is_finite() && *value == mirrored,
                    "finite, and equal to its mirror in the diagonal",
                )?;
            }
        }
        for (name, [from, to]) in BEARING_LOADS.into_iter().zip(self.range.all()) {
            within(
                &format!("bearing.range.{}", name.to_lowercase()),
                format!("[{from}, {to}]"),
                from < to && from.is_finite() && to.is_finite(),
                "[smallest, largest]",
            )?;
        }
        let gauges = self.gauges.len();
        within(
            "bearing.gauge",
            gauges,
            gauges == loadtwin_common::bearing::GAUGES,
            "4 tables",
        )?;
        unique("bearing.gauge", &names(&self.gauges, |g| &g.name))?;
        for (i, gauge) in self.gauges.iter().enumerate() {
            let field = format!("bearing.gauge[{}].azimuth_deg", i + 1);
            range(&field, gauge.azimuth_deg, -360.0, 360.0)?;
        }
        let f = &self.filter;
        for (name, value) in [
            ("slip_std", f.slip_std),
            ("slip_time_s", f.slip_time_s),
            ("slip_limit", f.slip_limit),
            ("phase_walk", f.phase_walk),
            ("load_time_s", f.load_time_s),
            ("preload_std_um", f.preload_std_um),
            ("preload_walk_um", f.preload_walk_um),
            ("bias_std", f.bias_std),
            ("bias_time_s", f.bias_time_s),
            ("bulk_std", f.bulk_std),
            ("lowest_hz", f.lowest_hz),
        ] {
            positive(&format!("bearing.filter.{name}"), value)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `A = 0.04 * 12.5 mm = 500 um` at 30 degrees: an approach of 10 um along the contact takes
    /// `sqrt(510^2 - 433.0127^2) - 250 = 19.4436 um` along the axis.
    #[test]
    fn a_preload_along_the_contact_is_counted_along_the_axis() {
        let text = r"
            balls = 13
            ball_mm = 12.5
            pitch_mm = 66
            rows_mm = 19
            contact_angle_deg = 30
            conformity = 0.52
            stiffness_n_per_mm_1_5 = 3.0e5
            preload_um = 10
            preload_along = 'normal'
            compliance_um_per_kn = [[0.1, 0, 0, 0, 0], [0, 0.1, 0, 0, 0], [0, 0, 0.1, 0, 0], [0, 0, 0, 0.1, 0], [0, 0, 0, 0, 0.1]]
            row_coupling = 0.5
            range = { fx_n = [0, 1], fy_n = [0, 1], fz_n = [0, 1], mx_nm = [0, 1], mz_nm = [0, 1] }
            gauge = []
        ";
        let mut bearing: Bearing = toml::from_str(text).unwrap();
        let angle = 30.0_f64.to_radians();
        assert!((bearing.axial_preload_um(angle) - 19.443_6).abs() < 1e-3);
        bearing.preload_along = PreloadAlong::Axial;
        assert!((bearing.axial_preload_um(angle) - 10.0).abs() < 1e-12);
    }
}
