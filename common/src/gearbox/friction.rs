//! Dry friction: a torque on an inertia that is known once its speed is.

use serde::{Deserialize, Serialize};

use crate::error::{Error, finite, positive};
use crate::image::StateVec;

/// Most inertias with dry friction.
pub const MAX_FRICTIONS: usize = 3;

/// Dry friction of one inertia in the image:
///
/// `u = (c + l |tau| + s exp(-(|w| / w_s)^1.5)) z`, `x+ = F x + b u`,
///
/// with the direction `z = w / sqrt(w^2 + w_0^2)`, or where friction builds up over an angle
/// `z+ = sign(w) + (z - sign(w)) exp(-|w| dt / angle)`.
///
/// Source: Armstrong-Helouvry et al. 1994 (Stribeck); Dahl 1968 (pre-sliding).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Friction {
    /// State that is the speed `w` of the inertia.
    pub speed_state: u8,
    /// `b`: what a unit of friction does to each state in one sample.
    pub column: StateVec<f32>,
    /// State that is the torque `tau` which the inertia takes over, in parts of nominal.
    pub twist_state: u8,
    /// `c`, what brakes at every speed, >= 0.
    pub sliding: f32,
    /// `l`, the part of that torque that is lost, >= 0.
    pub losing: f32,
    /// `s`, what sticking adds near standstill, >= 0.
    pub sticking: f32,
    /// `1 / w_s`, >= 0.
    pub fading: f32,
    /// `w_0`, > 0.
    pub creeping: f32,
    /// `dt / angle`, 0 where friction is there at once, >= 0.
    pub building: f32,
}

// Not generic over the number of states: compiled once, not for each of them.
impl Friction {
    /// `u` at the speed `w` under the torque `tau`; `z` is the direction so far.
    #[inline(never)]
    pub(super) fn torque(&self, w: f32, tau: f32, z: &mut f32) -> f32 {
        *z = if self.building > 0.0 {
            let end = libm::copysignf(1.0, w);
            end + (*z - end) * libm::expf(-libm::fabsf(w) * self.building)
        } else {
            w / libm::sqrtf(w * w + self.creeping * self.creeping)
        };
        let mut size = self.sliding;
        if self.losing > 0.0 {
            size += self.losing * libm::fabsf(tau);
        }
        if self.sticking > 0.0 {
            let part = libm::fabsf(w) * self.fading;
            size += self.sticking * libm::expf(-part * libm::sqrtf(part));
        }
        size * *z
    }

    /// Checks lengths and ranges for `states` states, the last `loads` of them loads.
    pub(super) fn check(&self, states: usize, loads: usize) -> Result<(), Error> {
        let mechanical = |state: u8| (1..states - loads).contains(&usize::from(state));
        if !mechanical(self.speed_state) {
            return Err(Error::OutOfRange("friction speed"));
        }
        if !mechanical(self.twist_state) {
            return Err(Error::OutOfRange("friction twist"));
        }
        finite(&self.column, states, "friction column")?;
        positive([self.creeping], "friction speed")?;
        let sizes = [
            self.sliding,
            self.losing,
            self.sticking,
            self.fading,
            self.building,
        ];
        if sizes.iter().all(|size| *size >= 0.0 && size.is_finite()) {
            Ok(())
        } else {
            Err(Error::OutOfRange("friction"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn friction() -> Friction {
        Friction {
            speed_state: 3,
            column: StateVec::new(),
            twist_state: 1,
            sliding: 2.0,
            losing: 0.0,
            sticking: 4.0,
            fading: 0.5,
            creeping: 0.01,
            building: 0.0,
        }
    }

    #[test]
    fn it_fades_from_sticking_to_sliding_and_turns_with_the_speed() {
        let (friction, mut z) = (friction(), 0.0);
        assert_eq!(friction.torque(0.0, 1.0, &mut z), 0.0);
        for sign in [1.0_f32, -1.0] {
            // By hand: 2 + 4 exp(-1) at the speed over which it fades; 2 far above.
            let faded = friction.torque(sign * 2.0, 1.0, &mut z);
            assert!((sign * faded - 3.471_5).abs() < 1e-3, "{faded}");
            assert!((sign * friction.torque(sign * 200.0, 1.0, &mut z) - 2.0).abs() < 1e-3);
        }
    }

    #[test]
    fn it_builds_up_over_an_angle_and_stays_at_standstill() {
        let friction = Friction {
            sticking: 0.0,
            building: 0.1,
            ..friction()
        };
        let mut z = 0.0;
        // Ten samples at speed 1 are the angle: 1 - exp(-1) of it is there.
        let mut torque = 0.0;
        for _ in 0..10 {
            torque = friction.torque(1.0, 1.0, &mut z);
        }
        assert!((torque - 2.0 * 0.632_12).abs() < 1e-3, "{torque}");
        assert_eq!(friction.torque(0.0, 1.0, &mut z), torque);
    }

    /// By hand: 2 + 0.1 * 30 either way, whatever the torque's sign.
    #[test]
    fn a_part_of_the_torque_is_lost() {
        let friction = Friction {
            losing: 0.1,
            sticking: 0.0,
            ..friction()
        };
        for (w, tau, lost) in [(200.0, -30.0, 5.0), (-200.0, 30.0, -5.0), (200.0, 0.0, 2.0)] {
            let torque = friction.torque(w, tau, &mut 0.0);
            assert!((torque - lost).abs() < 1e-3, "{torque}");
        }
    }
}
