//! Defines the deviations of a bearing from its description (stiffness, preload, contact angle, row
//! coupling, ring compliance) and their prior standard deviations. Computes from description and
//! deviations the contact geometry that the filter uses (`geometry`).

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use loadtwin_common::bearing::GAUGES;
use loadtwin_common::bearing::contact::{Geometry, RING};
use serde::{Deserialize, Serialize};

use crate::error::BuildError;
use loadtwin_machine::{Bearing, SHAPES};

/// Numbers of a [`PhysicalParameters`].
pub const PARAMETERS: usize = 4 + SHAPES * (SHAPES + 1) / 2;

/// A bearing against its description: all 0 where it is as described.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhysicalParameters {
    /// Of the contact stiffness, relative.
    pub stiffness: f64,
    /// Of the preload's approach, relative.
    pub preload: f64,
    /// Of the unloaded contact angle (deg).
    pub contact_angle_deg: f64,
    /// Of the coupling of the rows.
    pub row_coupling: f64,
    /// `S` of the compliance `L (1 + S) L'`, `L L'` the described one; its lower triangle counts.
    pub compliance: [[f64; SHAPES]; SHAPES],
}

/// Largest coupling of the rows, `row_coupling` with its deviation: at 1 both rows have one
/// deformation, and the compliance no inverse.
const CLOSEST_ROWS: f64 = 0.95;

/// Prior standard deviations of a production part in its seat: relative ones, the contact angle in
/// degrees. Assumed, not measured.
const EXPECTED: PhysicalParameters = {
    let mut compliance = [[0.08; SHAPES]; SHAPES];
    let mut k = 0;
    while k < SHAPES {
        compliance[k][k] = 0.2;
        k += 1;
    }
    PhysicalParameters {
        stiffness: 0.1,
        preload: 0.15,
        contact_angle_deg: 1.0,
        row_coupling: 0.1,
        compliance,
    }
};

impl PhysicalParameters {
    /// In units of the standard deviations that are expected.
    pub fn normalised(&self) -> [f64; PARAMETERS] {
        let (value, unit) = (self.numbers(), EXPECTED.numbers());
        std::array::from_fn(|k| value[k] / unit[k])
    }

    /// From units of the standard deviations that are expected.
    pub fn from_normalised(parts: &[f64; PARAMETERS]) -> Self {
        let unit = EXPECTED.numbers();
        let part = |k: usize| parts[k] * unit[k];
        let mut compliance = [[0.0; SHAPES]; SHAPES];
        let mut k = 4;
        for i in 0..SHAPES {
            for slot in &mut compliance[i][..=i] {
                *slot = part(k);
                k += 1;
            }
        }
        Self {
            stiffness: part(0),
            preload: part(1),
            contact_angle_deg: part(2),
            row_coupling: part(3),
            compliance,
        }
    }

    fn numbers(&self) -> [f64; PARAMETERS] {
        let own = [
            self.stiffness,
            self.preload,
            self.contact_angle_deg,
            self.row_coupling,
        ];
        let mut compliance = (0..SHAPES).flat_map(|i| (0..=i).map(move |j| self.compliance[i][j]));
        std::array::from_fn(|k| match own.get(k) {
            Some(number) => *number,
            None => compliance.next().unwrap_or(0.0),
        })
    }
}

/// The bearing as the filter takes it: mm, um, kN.
///
/// # Errors
/// When the compliance is not positive.
pub fn geometry(bearing: &Bearing, physical: &PhysicalParameters) -> Result<Geometry, BuildError> {
    let angle = (bearing.contact_angle_deg + physical.contact_angle_deg).to_radians();
    let radius =
        0.5 * bearing.pitch_mm + (bearing.conformity - 0.5) * bearing.ball_mm * angle.cos();
    let refused = || BuildError::Model(loadtwin_common::Error::NotPositive("compliance_um_per_kn"));
    let described = Mat::from_fn(SHAPES, SHAPES, |i, j| bearing.compliance_um_per_kn[i][j]);
    let factor = described.llt(Side::Lower).map_err(|_| refused())?;
    let changed = Mat::from_fn(SHAPES, SHAPES, |i, j| {
        physical.compliance[i.max(j)][i.min(j)] + if i == j { 1.0 } else { 0.0 }
    });
    let one_row = factor.L() * &changed * factor.L().transpose();
    let coupling = (bearing.row_coupling + physical.row_coupling).min(CLOSEST_ROWS);
    let n = 2 * SHAPES;
    let compliance = Mat::from_fn(n, n, |i, j| {
        let same = i / SHAPES == j / SHAPES;
        one_row[(i % SHAPES, j % SHAPES)] * if same { 1.0 } else { coupling }
    });
    let stiffness = compliance
        .llt(Side::Lower)
        .map_err(|_| refused())?
        .solve(Mat::<f64>::identity(n, n));
    let mut ring = heapless::Vec::<f32, RING>::new();
    for j in 0..n {
        for i in 0..=j {
            ring.push(stiffness[(i, j)] as f32).map_err(|_| refused())?;
        }
    }
    let mut gauges_rad = [0.0; GAUGES];
    for (rad, gauge) in gauges_rad.iter_mut().zip(&bearing.gauges) {
        *rad = gauge.azimuth_deg.to_radians() as f32;
    }
    Ok(Geometry {
        balls: bearing.balls,
        radius_mm: radius as f32,
        row_offset: (0.5 * bearing.rows_mm / radius) as f32,
        groove_um: bearing.groove_um() as f32,
        ball_over_pitch: (bearing.ball_mm / bearing.pitch_mm) as f32,
        contact_angle: (angle.cos() as f32, angle.sin() as f32),
        // N / mm^1.5 to kN / um^1.5.
        stiffness: (bearing.stiffness_n_per_mm_1_5 * (1.0 + physical.stiffness) * 1e-3
            / 1e3_f64.powf(1.5)) as f32,
        preload_um: (bearing.axial_preload_um(angle) * (1.0 + physical.preload)) as f32,
        ring,
        gauges_rad,
    })
}
