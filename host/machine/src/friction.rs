//! Defines the description of an inertia's dry friction (Coulomb, load-dependent, Stribeck,
//! pre-sliding), and checks its fields. Computes the torque over a given motion, refers it to
//! another shaft, and adds two frictions.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::field_checks::{Checked, at_least, positive, range, refuse};

/// Dry friction between an inertia and the housing, at the inertia's own speed `w`:
///
/// `(c + l |tau| + s exp(-(|w| / w_s)^1.5)) z`,
///
/// with the torque `tau` of the shaft before the inertia (behind the first one), the direction `z = w / sqrt(w^2 + w_0^2)`, `w_0` [`CREEP`] of nominal speed, or, where it
/// builds up over an angle, `dz = (d(angle) - |d(angle)| z) / presliding_rad`.
///
/// Source: Armstrong-Helouvry et al. 1994 (Stribeck); Dahl 1968 (pre-sliding).
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// `c`: torque at every speed [N m], >= 0.
    #[serde(default)]
    pub coulomb_nm: f64,
    /// `l`: part of the torque carried that is lost, as in a mesh, 0 to 0.5.
    #[serde(default)]
    pub load_part: f64,
    /// `s`: what sticking adds near standstill [N m], >= 0.
    #[serde(default)]
    pub stribeck_nm: f64,
    /// `w_s`: speed over which that fades [rad/s], > 0; needed with `stribeck_nm`.
    pub stribeck_rad_s: Option<f64>,
    /// Angle over which friction builds up (rad), >= 0; at once where 0 or absent.
    #[serde(default)]
    pub presliding_rad: f64,
}

/// `w_0` as part of nominal speed: over it the direction of friction reverses (regularisation).
pub const CREEP: f64 = 0.003;

impl Friction {
    /// Torque at each speed [rad/s] under each torque carried, `dt_s` (s) apart; from the start
    /// it has the direction of the first. `creeping`: `w_0` [rad/s].
    pub fn course(
        &self,
        motion: impl IntoIterator<Item = (f64, f64)>,
        dt_s: f64,
        creeping: f64,
    ) -> Vec<f64> {
        let direction = |w: f64| w / (w * w + creeping * creeping).sqrt();
        let mut built = None;
        motion
            .into_iter()
            .map(|(w, carried)| {
                let mut z = direction(w);
                if self.presliding_rad > 0.0 {
                    // Exact for a step of one sign: it tends to the sign of the motion.
                    let left = (-w.abs() * dt_s / self.presliding_rad).exp();
                    z = w.signum() + (built.unwrap_or(z) - w.signum()) * left;
                    built = Some(z);
                }
                let part = self.stribeck_rad_s.map_or(0.0, |fading| w.abs() / fading);
                let sticking = self.stribeck_nm * (-part.powf(1.5)).exp();
                (self.coulomb_nm + self.load_part * carried.abs() + sticking) * z
            })
            .collect()
    }

    /// Part of a torque carried that is lost at each of `speeds`, signed: the remainder is
    /// [`Friction::course`] under no torque.
    pub fn losses(
        &self,
        speeds: impl IntoIterator<Item = f64>,
        dt_s: f64,
        creeping: f64,
    ) -> Vec<f64> {
        let losing = Self {
            coulomb_nm: 0.0,
            stribeck_nm: 0.0,
            ..*self
        };
        losing.course(speeds.into_iter().map(|w| (w, 1.0)), dt_s, creeping)
    }

    /// Of `size` times the torque, at a shaft that turns `ratio` times as fast.
    #[must_use]
    pub fn scaled(&self, size: f64, ratio: f64) -> Self {
        Self {
            coulomb_nm: size * self.coulomb_nm,
            load_part: self.load_part,
            stribeck_nm: size * self.stribeck_nm,
            stribeck_rad_s: self.stribeck_rad_s.map(|speed| ratio * speed),
            presliding_rad: ratio * self.presliding_rad,
        }
    }

    /// Both together; none where that is no friction of this kind.
    pub fn joined(&self, other: &Self) -> Option<Self> {
        let alike = |a: f64, b: f64| a == b || a == 0.0 || b == 0.0;
        let builds_up = [self, other].map(|f| f.coulomb_nm + f.load_part + f.stribeck_nm > 0.0);
        let as_slowly = self.presliding_rad == other.presliding_rad;
        let fading = [self, other].map(|f| f.stribeck_rad_s.unwrap_or(0.0));
        let possible = (as_slowly || builds_up != [true; 2]) && alike(fading[0], fading[1]);
        possible.then(|| Self {
            coulomb_nm: self.coulomb_nm + other.coulomb_nm,
            load_part: self.load_part + other.load_part,
            stribeck_nm: self.stribeck_nm + other.stribeck_nm,
            stribeck_rad_s: self.stribeck_rad_s.or(other.stribeck_rad_s),
            presliding_rad: self.presliding_rad.max(other.presliding_rad),
        })
    }

    pub(super) fn check(&self, table: &str) -> Checked {
        let field = |name: &str| format!("{table}.{name}");
        at_least(&field("coulomb_nm"), self.coulomb_nm, 0.0)?;
        range(&field("load_part"), self.load_part, 0.0, 0.5)?;
        at_least(&field("stribeck_nm"), self.stribeck_nm, 0.0)?;
        at_least(&field("presliding_rad"), self.presliding_rad, 0.0)?;
        match self.stribeck_rad_s {
            Some(speed) => positive(&field("stribeck_rad_s"), speed),
            None if self.stribeck_nm > 0.0 => refuse(
                &field("stribeck_rad_s"),
                "nothing",
                "the speed over which stribeck_nm fades, > 0",
            ),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frictions_of_one_form_add_up_and_others_do_not() {
        let coulomb = Friction {
            coulomb_nm: 2.0,
            ..Friction::default()
        };
        let stribeck = Friction {
            stribeck_nm: 1.0,
            stribeck_rad_s: Some(0.5),
            ..Friction::default()
        };
        let dahl = Friction {
            presliding_rad: 0.1,
            ..coulomb
        };
        let both = coulomb.joined(&stribeck).unwrap();
        // By hand: 2 + exp(-1).
        let torque = both.course([(0.5, 9.0)], 1.0, 1e-9)[0];
        assert!((torque - 2.367_879).abs() < 1e-6, "{torque}");
        let mesh = Friction {
            load_part: 0.1,
            ..Friction::default()
        };
        let three = both.joined(&mesh).unwrap();
        let torque = three.course([(-0.5, 9.0)], 1.0, 1e-9)[0];
        assert!((torque + 3.267_879).abs() < 1e-6, "{torque}");
        assert!((three.losses([0.5], 1.0, 1e-9)[0] - 0.1).abs() < 1e-6);
        assert_eq!(coulomb.joined(&dahl), None);
        assert_eq!(Friction::default().joined(&dahl), Some(dahl));
        let faster = Friction {
            stribeck_rad_s: Some(0.6),
            ..stribeck
        };
        assert_eq!(stribeck.joined(&faster), None);
    }
}
