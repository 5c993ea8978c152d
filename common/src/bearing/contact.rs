//! Computes the static equilibrium of a bearing with two ball rows in a flexible outer ring under
//! given loads and preload, by steps of Newton's method (`Contacts`). At an equilibrium it gives
//! the ball loads at each gauge, of which the strain is a function (`Features`), with their
//! derivatives, and the rate of ball passing of each row.
//!
//! Degrees of freedom `z` (um): inner ring `(dx, dy, dz, R gx, R gz)`, then the
//! amplitudes of the outer ring's shapes under row 0 and under row 1. Loads
//! `(Fx, Fy, Fz, Mx / R, Mz / R)` (kN). `y` is the axis of turning; row 0 lies
//! at `y = -h`, row 1 at `y = +h`, mounted back to back.
#![expect(
    clippy::range_plus_one,
    reason = "an inclusive range carries a flag that keeps its loop from being unrolled"
)]

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::bearing::{FEATURES, GAUGES, LOADS, ROWS};
use crate::kalman::unroll::unroll;
use crate::signal::trigonometry::{inverse_sqrt, sqrt};

/// Shapes of the ring under one row: `1, cos 2, sin 2, cos 3, sin 3`.
pub const SHAPES: usize = 5;

/// Azimuths over which the balls of a row are averaged.
const NODES: usize = 16;

/// Degrees of freedom.
pub const DOF: usize = LOADS + ROWS * SHAPES;

/// Degrees of freedom that a contact of a row moves with: inner ring, shapes of the row.
const CONTACT_DOF: usize = LOADS + SHAPES;

/// Entries of the ring's stiffness, upper triangle by columns.
pub const RING: usize = ROWS * SHAPES * (ROWS * SHAPES + 1) / 2;

/// Directions in which the equilibrium is differentiated: the loads, the preload.
pub const INPUTS: usize = LOADS + 1;

/// Longest step of Newton's method [um].
const LONGEST_STEP: f32 = 15.0;

/// Weight of the unloaded contact angle in the mean that sets the rate of a cage [kN]: counts only
/// where a row carries next to nothing.
const UNLOADED: f32 = 0.01;

/// Approach over which the onset of contact is rounded off [um]: an unloaded contact keeps a small
/// slope, so that the filter can return to load.
const SMOOTHING_UM: f32 = 1.0;

/// Dimensions of the bearing in the units of the filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geometry {
    /// Balls in a row, 4 to 40.
    pub balls: u8,
    /// `R_i`: radius of the inner groove's centre (mm), > 0.
    pub radius_mm: f32,
    /// `h / R_i`: offset of a row from the middle over the radius, >= 0.
    pub row_offset: f32,
    /// `A`: unloaded distance of the groove centres (um), > 0.
    pub groove_um: f32,
    /// Diameter of a ball over that of the circle of their centres, 0 to 1.
    pub ball_over_pitch: f32,
    /// Cosine and sine of the unloaded contact angle.
    pub contact_angle: (f32, f32),
    /// `K_n` of eq. (4) [kN/um^1.5], > 0.
    pub stiffness: f32,
    /// Axial approach of each row by the preload (um), >= 0.
    pub preload_um: f32,
    /// Stiffness of the ring against its shapes, upper triangle by columns [kN/um].
    pub ring: heapless::Vec<f32, RING>,
    /// Azimuth of each gauge, from x towards z (rad).
    pub gauges_rad: [f32; GAUGES],
}

/// Direction of an azimuth and the ring's shapes there.
#[derive(Clone, Copy, Debug, Default)]
struct Azimuth {
    cos: f32,
    sin: f32,
    shapes: [f32; SHAPES],
}

impl Azimuth {
    fn new(psi: f32) -> Self {
        let (sin, cos) = libm::sincosf(psi);
        let (sin2, cos2) = libm::sincosf(2.0 * psi);
        let (sin3, cos3) = libm::sincosf(3.0 * psi);
        Self {
            cos,
            sin,
            shapes: [1.0, cos2, sin2, cos3, sin3],
        }
    }
}

/// One contact, and how its approach moves with the degrees of freedom of its
/// row: inner ring, shapes of the row.
struct Contact {
    /// `Q` [kN].
    load: f32,
    /// `dQ / d delta` [kN/um].
    slope: f32,
    cos: f32,
    sin: f32,
    /// Distance of the groove centres [um].
    distance: f32,
    /// `d delta / dz`.
    normal: [f32; CONTACT_DOF],
    /// Of the direction across, `(distance) d alpha / dz`.
    across: [f32; CONTACT_DOF],
}

/// Geometry laid out for the step.
#[derive(Clone, Debug)]
pub struct Contacts {
    geometry: Geometry,
    nodes: [Azimuth; NODES],
    /// At each gauge, and half a ball spacing before and after it.
    gauges: [[Azimuth; 3]; GAUGES],
}

/// Position after a step of Newton's method; the other fields are those of the position before it.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Equilibrium {
    /// `z` (um).
    pub position: [f32; DOF],
    /// `dz / d(loads, preload)`, by columns [um/kN, um/um].
    pub slope: [[f32; DOF]; INPUTS],
    /// Largest entry of the force out of balance (kN).
    pub residual: f32,
    /// Rate of ball passing of each row over that at the unloaded contact angle.
    pub pace: [f32; ROWS],
}

/// Functions of the ball load `Q` that the strain of each gauge is linear in, for each row: `Q`,
/// `Q sin(alpha - alpha0)`, half the difference and the curvature of `Q` over a ball spacing.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Features {
    /// Values (kN).
    pub value: [[[f32; FEATURES]; ROWS]; GAUGES],
    /// Derivatives by loads and preload [kN/kN, kN/um].
    pub slope: [[[[f32; INPUTS]; FEATURES]; ROWS]; GAUGES],
}

impl Contacts {
    /// Checks and lays out a geometry.
    ///
    /// # Errors
    /// The name of the first number that is out of its range.
    pub fn try_new(geometry: Geometry) -> Result<Self, Error> {
        if !(4..=40).contains(&geometry.balls) {
            return Err(Error::OutOfRange("balls"));
        }
        for (name, value) in [
            ("radius_mm", geometry.radius_mm),
            ("groove_um", geometry.groove_um),
            ("ball_over_pitch", geometry.ball_over_pitch),
            ("stiffness", geometry.stiffness),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::NotPositive(name));
            }
        }
        for (name, value) in [
            ("row_offset", geometry.row_offset),
            ("preload_um", geometry.preload_um),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::OutOfRange(name));
            }
        }
        let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
        if geometry.ring.len() != RING || !finite(&geometry.ring) {
            return Err(Error::OutOfRange("ring"));
        }
        let (cos, sin) = geometry.contact_angle;
        if !finite(&geometry.gauges_rad) || !finite(&[cos, sin]) {
            return Err(Error::NotFinite("angles"));
        }
        let half = core::f32::consts::PI / f32::from(geometry.balls);
        let mut nodes = [Azimuth::default(); NODES];
        for (i, node) in nodes.iter_mut().enumerate() {
            *node = Azimuth::new(core::f32::consts::TAU * i as f32 / NODES as f32);
        }
        let gauges = geometry
            .gauges_rad
            .map(|psi| [psi, psi - half, psi + half].map(Azimuth::new));
        Ok(Self {
            geometry,
            nodes,
            gauges,
        })
    }

    /// The geometry.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Approach, contact angle and load at one azimuth of one row.
    ///
    /// `d = A cos a0 + dx cos + dz sin + c h/R T - u_r`,
    /// `w = A sin a0 + p + c (dy + T)`, `T = R gz cos - R gx sin`, `c` = 1 for
    /// row 0 and -1 for row 1; `delta = |(d, w)| - A`, `Q = K_n delta^1.5`, rounded off about
    /// `delta = 0`.
    ///
    /// Source: Kerst et al. 2019, eq. (4)-(6), with the rows' offset `h`.
    #[inline]
    fn contact(&self, z: &[f32; DOF], preload: f32, row: usize, at: &Azimuth) -> Contact {
        let g = &self.geometry;
        let c = if row == 0 { 1.0 } else { -1.0 };
        let lever = c * g.row_offset;
        let tilt = z[4] * at.cos - z[3] * at.sin;
        let mut d = g.groove_um * g.contact_angle.0 + z[0] * at.cos + z[2] * at.sin + lever * tilt;
        for (k, amplitude) in at.shapes.iter().enumerate() {
            d -= amplitude * z[packed_index(row, LOADS + k)];
        }
        let w = g.groove_um * g.contact_angle.1 + preload + c * (z[1] + tilt);
        let square = d * d + w * w;
        let inverse = inverse_sqrt(square);
        let distance = square * inverse;
        // Rounded off about zero, so that a row without load keeps a slope towards load.
        let delta = distance - g.groove_um;
        let rounded = sqrt(delta * delta + SMOOTHING_UM * SMOOTHING_UM);
        let approach = 0.5 * (delta + rounded);
        let root = sqrt(approach) * g.stiffness;
        let load = root * approach;
        let slope = 1.5 * root * approach / rounded;
        let (cos, sin) = (d * inverse, w * inverse);
        let (mut normal, mut across) = ([0.0; CONTACT_DOF], [0.0; CONTACT_DOF]);
        let by_d = [at.cos, 0.0, at.sin, -lever * at.sin, lever * at.cos];
        let by_w = [0.0, c, 0.0, -c * at.sin, c * at.cos];
        for i in 0..LOADS {
            normal[i] = cos * by_d[i] + sin * by_w[i];
            across[i] = cos * by_w[i] - sin * by_d[i];
        }
        for (k, shape) in at.shapes.iter().enumerate() {
            normal[LOADS + k] = -cos * shape;
            across[LOADS + k] = sin * shape;
        }
        Contact {
            load,
            slope,
            cos,
            sin,
            distance,
            normal,
            across,
        }
    }

    /// One step of Newton's method from `position` towards equilibrium with
    /// `loads` (kN) and `preload` (um).
    ///
    /// `sum Q d delta/dz + K_ring a = (loads, 0)`; the balls of a row are
    /// averaged over the azimuth. What is left out of the stiffness, `Q` over the distance
    /// of the groove centres, is 2 % of it, and changes no solution.
    ///
    /// Source: Kerst et al. 2019, eq. (7)-(9).
    pub fn newton(&self, position: &[f32; DOF], loads: &[f32; LOADS], preload: f32) -> Equilibrium {
        let share = f32::from(self.geometry.balls) / NODES as f32;
        let preload = self.geometry.preload_um + preload;
        let mut k = [[0.0; DOF]; DOF];
        // For each degree of freedom: by each input, and the force out of balance.
        let mut rhs = [[0.0; INPUTS + 1]; DOF];
        let mut ring = self.geometry.ring.iter();
        for j in LOADS..DOF {
            for i in LOADS..=j {
                let value = ring.next().copied().unwrap_or(0.0);
                k[j][i] = value;
                rhs[i][INPUTS] -= value * position[j];
                if i != j {
                    rhs[j][INPUTS] -= value * position[i];
                }
            }
        }
        for i in 0..LOADS {
            // Holds a bearing that nothing holds: 0.1 N/um.
            k[i][i] = 1e-4;
            rhs[i][i] = 1.0;
            rhs[i][INPUTS] = loads[i];
        }
        let mut pace = [1.0; ROWS];
        for row in 0..ROWS {
            let (mut carried, mut along) = (UNLOADED, UNLOADED * self.geometry.contact_angle.0);
            // Of the row's own degrees of freedom, in places that do not depend on the row.
            let mut stiffness = [[0.0; CONTACT_DOF]; CONTACT_DOF];
            let (mut force, mut by_preload) = ([0.0; CONTACT_DOF], [0.0; CONTACT_DOF]);
            for node in &self.nodes {
                let touch = self.contact(position, preload, row, node);
                let (q, slope) = (touch.load * share, touch.slope * share);
                let per_preload = slope * touch.sin;
                carried += q;
                along += q * touch.cos;
                unroll!(j in 0..CONTACT_DOF {
                    let n = touch.normal[j];
                    let stiff = slope * n;
                    force[j] += q * n;
                    by_preload[j] += per_preload * n;
                    for i in 0..j + 1 {
                        stiffness[j][i] += stiff * touch.normal[i];
                    }
                });
            }
            for j in 0..CONTACT_DOF {
                let at = packed_index(row, j);
                rhs[at][INPUTS] -= force[j];
                rhs[at][LOADS] -= by_preload[j];
                for i in 0..=j {
                    k[at][packed_index(row, i)] += stiffness[j][i];
                }
            }
            let ratio = self.geometry.ball_over_pitch;
            pace[row] =
                (1.0 - ratio * along / carried) / (1.0 - ratio * self.geometry.contact_angle.0);
        }
        let residual = max_abs(&rhs);
        solve(&mut k, &mut rhs);
        let longest = max_abs(&rhs);
        let scale = if longest > LONGEST_STEP {
            LONGEST_STEP / longest
        } else {
            1.0
        };
        let mut next = *position;
        let mut slope = [[0.0; DOF]; INPUTS];
        for (i, row) in rhs.iter().enumerate() {
            next[i] += scale * row[INPUTS];
            for (column, value) in slope.iter_mut().zip(row) {
                column[i] = *value;
            }
        }
        Equilibrium {
            position: next,
            slope,
            residual,
            pace,
        }
    }

    /// Equilibrium with `loads` (kN) and `preload` (um) from the unloaded position: 41 steps at
    /// most.
    pub fn solve_equilibrium(&self, loads: &[f32; LOADS], preload: f32) -> Equilibrium {
        let mut state = self.newton(&[0.0; DOF], loads, preload);
        for _ in 0..40 {
            state = self.newton(&state.position, loads, preload);
            if state.residual < 1e-4 {
                break;
            }
        }
        state
    }

    /// Features of one gauge at an equilibrium, and their derivatives by loads and preload;
    /// `preload` (um).
    pub fn features(
        &self,
        at: &Equilibrium,
        preload: f32,
        gauge: usize,
        value: &mut [[f32; FEATURES]; ROWS],
        slope: &mut [[[f32; INPUTS]; FEATURES]; ROWS],
    ) {
        let preload = self.geometry.preload_um + preload;
        let (cos0, sin0) = self.geometry.contact_angle;
        let azimuths = &self.gauges[gauge % GAUGES];
        for row in 0..ROWS {
            let [here, before, after] = azimuths
                .each_ref()
                .map(|azimuth| self.contact(&at.position, preload, row, azimuth));
            let turned = here.sin * cos0 - here.cos * sin0;
            let turning = (here.cos * cos0 + here.sin * sin0) / here.distance;
            value[row] = [
                here.load,
                here.load * turned,
                0.5 * (after.load - before.load),
                0.5 * (after.load + before.load) - here.load,
            ];
            for (input, column) in at.slope.iter().enumerate() {
                let along = |touch: &Contact, direction: &[f32; CONTACT_DOF]| {
                    let mut sum = 0.0;
                    for i in 0..LOADS {
                        sum += direction[i] * column[i];
                    }
                    for i in 0..SHAPES {
                        sum += direction[LOADS + i] * column[packed_index(row, LOADS + i)];
                    }
                    // The preload also moves the contact itself.
                    (sum, if input == LOADS { touch.sin } else { 0.0 })
                };
                let loaded = |touch: &Contact| {
                    let (sum, own) = along(touch, &touch.normal);
                    touch.slope * (sum + own)
                };
                let (here_, before, after) = (loaded(&here), loaded(&before), loaded(&after));
                let (across, _) = along(&here, &here.across);
                let across = across + if input == LOADS { here.cos } else { 0.0 };
                slope[row][0][input] = here_;
                slope[row][1][input] = here_ * turned + here.load * turning * across;
                slope[row][2][input] = 0.5 * (after - before);
                slope[row][3][input] = 0.5 * (after + before) - here_;
            }
        }
    }
}

/// Place among the degrees of freedom of those that a contact of a row moves with: inner
/// ring, then shapes of the row. Bounded, so that no index can be out of range.
fn packed_index(row: usize, i: usize) -> usize {
    let before = if row > 0 && i >= LOADS { SHAPES } else { 0 };
    (i + before).min(DOF - 1)
}

/// Largest entry of the last column, without sign.
fn max_abs(rhs: &[[f32; INPUTS + 1]; DOF]) -> f32 {
    let mut max_abs = 0.0;
    for row in rhs {
        if row[INPUTS].abs() > max_abs {
            max_abs = row[INPUTS].abs();
        }
    }
    max_abs
}

/// Solves `k x = rhs` for each column of `rhs`; `k` symmetric positive, its lower triangle
/// given, replaced by `L`, `L L' = k`.
#[expect(
    clippy::needless_range_loop,
    reason = "rows of a matrix by their place"
)]
fn solve<const N: usize>(k: &mut [[f32; DOF]; DOF], rhs: &mut [[f32; N]; DOF]) {
    let mut inverse = [0.0; DOF];
    for j in 0..DOF {
        for i in j..DOF {
            let mut sum = k[i][j];
            for m in 0..j {
                sum -= k[i][m] * k[j][m];
            }
            k[i][j] = sum;
        }
        inverse[j] = inverse_sqrt(k[j][j].max(1e-9));
        for i in j..DOF {
            k[i][j] *= inverse[j];
        }
    }
    for i in 0..DOF {
        let mut x = rhs[i];
        for j in 0..i {
            subtract(&mut x, k[i][j], &rhs[j]);
        }
        rhs[i] = x.map(|x| x * inverse[i]);
    }
    for i in (0..DOF).rev() {
        let mut x = rhs[i];
        for j in i + 1..DOF {
            subtract(&mut x, k[j][i], &rhs[j]);
        }
        rhs[i] = x.map(|x| x * inverse[i]);
    }
}

/// `x -= factor y`.
fn subtract<const N: usize>(x: &mut [f32; N], factor: f32, y: &[f32; N]) {
    for (x, y) in x.iter_mut().zip(y) {
        *x -= factor * y;
    }
}
