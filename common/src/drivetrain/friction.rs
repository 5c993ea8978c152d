//! Computes the dry friction of one inertia in a sample (`Friction`): size from speed and carried
//! torque (Coulomb, load-dependent, Stribeck), direction from the speed at the end of the sample by
//! an implicit step (presliding). Also defines its parameters in the image and checks them.

use serde::{Deserialize, Serialize};

use crate::error::{Error, finite};
use crate::load_signal::StateVec;

/// Most inertias with dry friction.
pub const MAX_FRICTIONS: usize = 3;

/// Least `w_0` [nominal speed], of which `f32` still holds the square beside those of speeds.
const LEAST_CREEP: f32 = 1e-6;

/// Newton steps to the speed at the end of a sample, at most: of a body whose friction stops it in
/// a millionth of a sample, that many leave `z` 2 % short where it just begins to slide.
const STEPS: usize = 12;

/// Dry friction of one inertia in the image:
///
/// `u = (c + l |tau| + s exp(-(|w| / w_s)^1.5)) z(w+)`, `x+ = F x + b u`,
///
/// with the direction `z = w+ / sqrt(w+^2 + w_0^2)`, or where friction builds up over an angle
/// `z+ = sign(w+) + (z - sign(w+)) exp(-|w+| dt / angle)`.
///
/// The speed `w+` is that at the end of the sample, so that friction may stop the inertia but never
/// turns it back, however light it is and however long the sample.
///
/// Sources: Armstrong-Helouvry et al. 1994 (Stribeck); Dahl 1968 (pre-sliding); Acary and Brogliato
/// 2008, Numerical methods for nonsmooth dynamical systems, chapter 10 (implicit Euler).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Friction {
    /// State that is the speed `w` of the inertia.
    pub speed_state: u8,
    /// `b`: change of each state in one sample by a unit of friction.
    pub column: StateVec<f32>,
    /// State that is the torque `tau` which the inertia takes over, in parts of nominal.
    pub twist_state: u8,
    /// `c`, Coulomb torque, at every speed (parts of nominal), >= 0.
    pub sliding: f32,
    /// `l`, lost part of the torque `tau`, >= 0.
    pub losing: f32,
    /// `s`, Stribeck torque, added near standstill (parts of nominal), >= 0.
    pub sticking: f32,
    /// `1 / w_s` (1 / nominal speed), >= 0.
    pub fading: f32,
    /// `w_0` (nominal speed), at least 1e-6.
    pub creeping: f32,
    /// `dt / angle`, 0 where friction is there at once, >= 0.
    pub building: f32,
}

// Not generic over the number of states: compiled once, not for each of them.
impl Friction {
    /// `u / z` at the speed `w` under the torque `tau`.
    #[inline(never)]
    pub(crate) fn size(&self, w: f32, tau: f32) -> f32 {
        let mut size = self.sliding;
        if self.losing > 0.0 {
            size += self.losing * libm::fabsf(tau);
        }
        if self.sticking > 0.0 {
            let part = libm::fabsf(w) * self.fading;
            size += self.sticking * libm::expf(-part * libm::sqrtf(part));
        }
        size
    }

    /// The direction `z` over a sample: the root of `w+ = free - taken z(w+)`, where `free` is the
    /// speed at its end without this friction, `taken` the speed that one of `size` takes;
    /// `before`, the direction up to now.
    #[inline(never)]
    pub(crate) fn direction(&self, size: f32, free: f32, before: f32) -> f32 {
        let taken = -self.of_unit() * size;
        let from = if self.building > 0.0 { before } else { 0.0 };
        // It moves to the side to which the friction that is there does not hold it.
        let side = libm::copysignf(1.0, free - taken * from);
        let (free, from) = (side * free, side * from);
        // Concave on that side: Newton steps from below rise to the root and do not pass it.
        let mut speed = libm::fmaxf(free - taken, 0.0);
        for _ in 0..STEPS {
            let (z, slope) = self.towards(speed, from);
            let next = speed + (free - speed - taken * z) / (1.0 + taken * slope);
            // Not at the rounding of the root, nor where a number is none.
            if next > speed {
                speed = next;
            } else {
                break;
            }
        }
        side * self.towards(speed, from).0
    }

    /// Direction at `speed` >= 0 at the end of a sample, `from` that at its start, and its slope.
    fn towards(&self, speed: f32, from: f32) -> (f32, f32) {
        if self.building > 0.0 {
            let open = (1.0 - from) * libm::expf(-speed * self.building);
            (1.0 - open, open * self.building)
        } else {
            let creeping = self.creeping * self.creeping;
            let square = speed * speed + creeping;
            let root = libm::sqrtf(square);
            (speed / root, creeping / (square * root))
        }
    }

    /// Change of the inertia's speed in a sample by a unit of friction, <= 0.
    fn of_unit(&self) -> f32 {
        (self.column.get(usize::from(self.speed_state))).map_or(0.0, |b| *b)
    }

    /// Checks lengths and ranges for `states` states, the last `loads` of them loads.
    pub(crate) fn check(&self, states: usize, loads: usize) -> Result<(), Error> {
        let mechanical = |state: u8| (1..states - loads).contains(&usize::from(state));
        if !mechanical(self.speed_state) {
            return Err(Error::OutOfRange("friction speed"));
        }
        if !mechanical(self.twist_state) {
            return Err(Error::OutOfRange("friction twist"));
        }
        finite(&self.column, states, "friction column")?;
        if !(self.of_unit() <= 0.0 && self.creeping >= LEAST_CREEP) {
            return Err(Error::OutOfRange("friction speed"));
        }
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

    /// Friction that takes `per_unit` of the speed in a sample.
    fn friction(per_unit: f32) -> Friction {
        Friction {
            speed_state: 3,
            column: StateVec::from_slice(&[0.0, 0.0, 0.0, -per_unit]).unwrap(),
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
        let friction = friction(1e-6);
        assert_eq!(friction.direction(friction.size(0.0, 1.0), 0.0, 0.0), 0.0);
        for sign in [1.0_f32, -1.0] {
            // By hand: 2 + 4 exp(-1) at the speed over which it fades; 2 far above.
            for (speed, torque) in [(2.0, 3.471_5), (200.0, 2.0)] {
                let size = friction.size(sign * speed, 1.0);
                let found = size * friction.direction(size, sign * speed, 0.0);
                assert!((sign * found - torque).abs() < 1e-3, "{found}");
            }
        }
    }

    #[test]
    fn it_builds_up_over_an_angle_and_stays_at_standstill() {
        let friction = Friction {
            sticking: 0.0,
            building: 0.1,
            ..friction(1e-6)
        };
        // Ten samples at speed 1 are the angle: 1 - exp(-1) of it is there.
        let z = (0..10).fold(0.0, |z, _| friction.direction(2.0, 1.0, z));
        assert!((z - 0.632_12).abs() < 1e-3, "{z}");
        let held = friction.direction(2.0, 0.0, z);
        assert!((held - z).abs() < 1e-5, "{held} {z}");
    }

    /// By hand: 2 + 0.1 * 30 either way, whatever the torque's sign.
    #[test]
    fn a_part_of_the_torque_is_lost() {
        let friction = Friction {
            losing: 0.1,
            sticking: 0.0,
            ..friction(1e-6)
        };
        for (w, tau, lost) in [(200.0, -30.0, 5.0), (-200.0, 30.0, -5.0), (200.0, 0.0, 2.0)] {
            let size = friction.size(w, tau);
            let torque = size * friction.direction(size, w, 0.0);
            assert!((torque - lost).abs() < 1e-3, "{torque}");
        }
    }

    /// Against the root by bisection in f64, for inertias that friction takes from a millionth to a
    /// million times `w_0` in a sample, from sticking to sliding.
    #[test]
    fn direction_is_the_root_for_any_inertia() {
        for exponent in -6..=6 {
            let taken = 0.01 * 10.0_f32.powi(exponent);
            let friction = Friction {
                sticking: 0.0,
                ..friction(0.5 * taken)
            };
            for part in [
                -3.0, -1.1, -1.0, -0.9, -0.3, 0.0, 1e-3, 0.5, 0.99, 1.01, 50.0_f32,
            ] {
                let free = part * taken;
                let found = friction.direction(2.0, free, 0.0);
                let (mut low, mut high) = (0.0_f64, f64::from(free.abs()));
                for _ in 0..200 {
                    let middle = 0.5 * (low + high);
                    let z = middle / middle.hypot(0.01);
                    if middle + f64::from(taken) * z < f64::from(free.abs()) {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                let exact = f64::from(free.signum()) * low / low.hypot(0.01);
                let error = (f64::from(found) - exact).abs();
                assert!(error < 0.02, "{taken} {part}: {found} {exact}");
            }
        }
    }

    /// A light body pushed by half the friction rests; one and a half times it slides against all
    /// of it; let go, it stops within a sample and does not turn back. The same where friction
    /// builds up over an angle that it passes in a hundredth of a sample.
    #[test]
    fn a_light_body_sticks_slides_and_stops() {
        for building in [0.0, 100.0] {
            let friction = Friction {
                sticking: 0.0,
                building,
                ..friction(1e3)
            };
            let (mut speed, mut z) = (0.0, 0.0);
            let mut pushed = |push: f32| {
                let free = speed + 1e3 * push;
                z = friction.direction(2.0, free, z);
                speed = free - 1e3 * 2.0 * z;
                (speed, z)
            };
            for _ in 0..100 {
                let (speed, z) = pushed(1.0);
                assert!(speed.abs() < 0.05 && (z - 0.5).abs() < 1e-2, "{speed} {z}");
            }
            for i in 1..=10 {
                let (speed, z) = pushed(3.0);
                assert!((speed - 1e3 * i as f32).abs() < 1.0 && z > 0.999, "{speed}");
            }
            for _ in 0..20 {
                let (speed, _) = pushed(0.0);
                assert!(speed > -0.05, "{speed}");
            }
            let (speed, _) = pushed(0.0);
            assert!(speed.abs() < 0.05, "{speed}");
        }
    }
}
