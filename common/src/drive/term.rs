//! Evaluates the known terms of a drive's balance of forces beside inertia, drag and loads, such as
//! friction, cogging and gravity, at a given motion: a coefficient times a factor and a direction
//! (`Term`). Also follows the friction directions over the motion, and checks the ranges.

use serde::{Deserialize, Serialize};

use crate::error::{Error, finite};
use crate::signal::periodic_lookup::PeriodicLookup;
use crate::signal::phase::{Phase, PhaseStep};

/// Most terms of one drive.
pub const MAX_TERMS: usize = 24;

/// Most directions of one drive.
pub const MAX_DIRECTIONS: usize = 8;

/// Highest power of the travel.
pub const MAX_POWER: u8 = 8;

/// `coefficient factor direction` [the drive's unit], a known term of the balance of forces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Term<'a> {
    /// Drive per unit of the product.
    pub coefficient: f32,
    /// How large it is.
    #[serde(borrow)]
    pub factor: Factor<'a>,
    /// Number of the direction in which it acts; none where it does not depend on the motion's.
    pub direction: Option<u8>,
}

/// How large a term is at a motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Factor<'a> {
    /// 1.
    One,
    /// `|L|` of a known load, by its number.
    Load(u8),
    /// `L |L|`.
    LoadSquare(u8),
    /// `|a|`.
    Acceleration,
    /// `|v|`.
    Speed,
    /// `exp(-(|v| / v_s)^d)`.
    ///
    /// Source: Armstrong-Helouvry, Dupont, Canudas de Wit 1994, eq. (2).
    Stribeck {
        /// `1 / v_s` [s/rad, s/m], > 0.
        per_speed: f32,
        /// `d`, > 0.
        exponent: f32,
    },
    /// `(|v| / v_0)^n`.
    Power {
        /// `1 / v_0` [s/rad, s/m], > 0.
        per_speed: f32,
        /// `n`, > 0.
        exponent: f32,
    },
    /// `((x - x_0) / h)^n`.
    Travel {
        /// `x_0` [rad, m].
        centre: f32,
        /// `1 / h` [1/rad, 1/m].
        per_half: f32,
        /// `n`, 1 to [`MAX_POWER`].
        power: u8,
    },
    /// A periodic function of the position.
    Periodic {
        /// Part of a period in 2^-16 counts.
        step: PhaseStep,
        /// Where in a period count 0 is.
        origin: Phase,
        /// One period.
        #[serde(borrow)]
        table: PeriodicLookup<'a>,
    },
}

/// In which direction a term acts, -1 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Direction {
    /// `sgn(v)`.
    Sign,
    /// `dz = (sgn(dx) - z) |dx| / s`, exact over each step; kept at standstill.
    ///
    /// Source: Dahl 1968, A solid friction model.
    Sliding {
        /// `s` [rad, m], >= 0; 0 is the sign of the last motion.
        distance: f32,
    },
    /// `v / sqrt(v^2 + v_r^2)`.
    Fading {
        /// `v_r` [rad/s, m/s], > 0.
        speed: f32,
    },
    /// `|v| / sqrt(v^2 + v_r^2)`.
    Moving {
        /// `v_r` [rad/s, m/s], > 0.
        speed: f32,
    },
    /// Of a part that is driven through a gap: changes its sign once the motion has come back by
    /// the gap.
    Gap {
        /// Half the gap [rad, m], >= 0.
        half: f32,
    },
}

/// A motion as terms are evaluated at it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion<'s> {
    /// Position in 2^-16 counts; none where it is not homed.
    pub(crate) place: Option<i64>,
    /// Position [rad, m].
    pub(crate) position: f32,
    pub(crate) speed: f32,
    pub(crate) acceleration: f32,
    /// Known loads [the drive's unit].
    pub(crate) loads: &'s [f32],
}

impl Factor<'_> {
    /// Whether it depends on where the position is zero.
    pub(crate) fn needs_homing(&self) -> bool {
        matches!(self, Self::Travel { .. } | Self::Periodic { .. })
    }

    /// Its value; none of a position that is not known.
    pub(crate) fn at(&self, motion: &Motion<'_>) -> Option<f32> {
        let load = |i: &u8| motion.loads.get(usize::from(*i)).copied().unwrap_or(0.0);
        Some(match self {
            Self::One => 1.0,
            Self::Load(i) => libm::fabsf(load(i)),
            Self::LoadSquare(i) => load(i) * libm::fabsf(load(i)),
            Self::Acceleration => libm::fabsf(motion.acceleration),
            Self::Speed => libm::fabsf(motion.speed),
            Self::Stribeck {
                per_speed,
                exponent,
            } => libm::expf(-power(libm::fabsf(motion.speed) * per_speed, *exponent)),
            Self::Power {
                per_speed,
                exponent,
            } => power(libm::fabsf(motion.speed) * per_speed, *exponent),
            Self::Travel {
                centre,
                per_half,
                power,
            } => {
                motion.place?;
                let u = (motion.position - centre) * per_half;
                let mut product = u;
                for _ in 1..*power {
                    product *= u;
                }
                product
            }
            Self::Periodic {
                step,
                origin,
                table,
            } => {
                let turned = Phase(step.0.wrapping_mul(motion.place? as u64));
                table.at(origin.wrapping_add(turned)).0
            }
        })
    }

    fn check(&self, loads: usize, has_position: bool) -> Result<(), Error> {
        let fits = match self {
            Self::One | Self::Acceleration | Self::Speed => true,
            Self::Load(i) | Self::LoadSquare(i) => usize::from(*i) < loads,
            Self::Stribeck {
                per_speed,
                exponent,
            }
            | Self::Power {
                per_speed,
                exponent,
            } => [per_speed, exponent]
                .into_iter()
                .all(|x| *x > 0.0 && x.is_finite()),
            Self::Travel {
                centre,
                per_half,
                power,
            } => (1..=MAX_POWER).contains(power) && centre.is_finite() && per_half.is_finite(),
            Self::Periodic { table, .. } => return table.validate("periodic term"),
        };
        if fits && (has_position || !self.needs_homing()) {
            Ok(())
        } else {
            Err(Error::OutOfRange("factor"))
        }
    }
}

/// `x^n` for `x >= 0`; the usual exponents without a logarithm.
fn power(x: f32, n: f32) -> f32 {
    match n {
        1.0 => x,
        2.0 => x * x,
        _ => libm::powf(x, n),
    }
}

impl Term<'_> {
    /// Checks ranges and references.
    pub(crate) fn check(
        &self,
        loads: usize,
        directions: usize,
        has_position: bool,
    ) -> Result<(), Error> {
        finite(&[self.coefficient], 1, "coefficient")?;
        if self.direction.is_some_and(|d| usize::from(d) >= directions) {
            return Err(Error::OutOfRange("direction"));
        }
        self.factor.check(loads, has_position)
    }
}

/// State of a direction.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct DirectionState {
    /// The direction.
    pub(crate) z: f32,
    /// Of a gap, the place of the far side, from that of the motion [rad, m].
    far: f32,
}

impl Direction {
    /// Follows a motion at `speed` that came by `moved` [rad, m].
    pub(crate) fn follow(self, state: &mut DirectionState, moved: f32, speed: f32) {
        state.z = match self {
            Self::Sign if speed == 0.0 => 0.0,
            Self::Sign => libm::copysignf(1.0, speed),
            Self::Sliding { .. } if moved == 0.0 => state.z,
            Self::Sliding { distance } => {
                let towards = libm::copysignf(1.0, moved);
                towards - (towards - state.z) * libm::expf(-libm::fabsf(moved) / distance)
            }
            Self::Fading { speed: v_r } => speed / libm::sqrtf(speed * speed + v_r * v_r),
            Self::Moving { speed: v_r } => {
                libm::fabsf(speed) / libm::sqrtf(speed * speed + v_r * v_r)
            }
            Self::Gap { half } => {
                let far = state.far - moved;
                state.far = libm::fmaxf(libm::fminf(far, half), -half);
                if far < -half {
                    1.0
                } else if far > half {
                    -1.0
                } else {
                    state.z
                }
            }
        };
    }

    /// Checks its range.
    pub(crate) fn check(self) -> Result<(), Error> {
        let fits = match self {
            Self::Sign => true,
            Self::Sliding { distance: x } | Self::Gap { half: x } => x >= 0.0 && x.is_finite(),
            Self::Fading { speed } | Self::Moving { speed } => {
                speed >= LEAST_SPEED && speed.is_finite()
            }
        };
        if fits {
            Ok(())
        } else {
            Err(Error::OutOfRange("direction"))
        }
    }
}

/// Least `v_r` [rad/s, m/s], whose square f32 still holds.
const LEAST_SPEED: f32 = 1e-15;

#[cfg(test)]
mod tests {
    use super::*;

    fn followed(direction: Direction, moves: &[f32]) -> f32 {
        let mut state = DirectionState::default();
        for moved in moves {
            direction.follow(&mut state, *moved, *moved);
        }
        state.z
    }

    /// `z = 1 - exp(-1)` after one distance, however it is divided.
    #[test]
    fn sliding_builds_up_over_its_distance_and_is_kept_at_rest() {
        let sliding = Direction::Sliding { distance: 0.5 };
        let one = followed(sliding, &[0.5]);
        assert!((one - (1.0 - libm::expf(-1.0))).abs() < 1e-6);
        let many = followed(sliding, &[0.05; 10]);
        assert!((one - many).abs() < 1e-6);
        assert_eq!(followed(sliding, &[0.5, 0.0, 0.0]), one);
        let at_once = Direction::Sliding { distance: 0.0 };
        assert_eq!(followed(at_once, &[0.1, 0.0, -0.1, 0.0]), -1.0);
    }

    #[test]
    fn behind_a_gap_the_direction_turns_once_the_gap_is_crossed() {
        let gap = Direction::Gap { half: 0.5 };
        assert_eq!(followed(gap, &[0.25]), 0.0);
        assert_eq!(followed(gap, &[1.0]), 1.0);
        assert_eq!(followed(gap, &[1.0, -0.9]), 1.0);
        assert_eq!(followed(gap, &[1.0, -0.9, -0.2]), -1.0);
    }

    #[test]
    fn a_table_is_read_at_the_position_and_waits_for_it() {
        let mut bytes = [0; 16];
        for (slot, value) in bytes.chunks_exact_mut(4).zip([0.0_f32, 1.0, 0.0, -1.0]) {
            slot.copy_from_slice(&value.to_le_bytes());
        }
        let factor = Factor::Periodic {
            step: PhaseStep(1 << 61),
            origin: Phase(0),
            table: PeriodicLookup::try_new(&bytes, "table").unwrap(),
        };
        let mut motion = Motion {
            place: Some(-1),
            position: 0.0,
            speed: 0.0,
            acceleration: 0.0,
            loads: &[],
        };
        // An eighth of a turn back: half way between the entries -1 and 0.
        assert_eq!(factor.at(&motion), Some(-0.5));
        motion.place = None;
        assert_eq!(factor.at(&motion), None);
    }

    #[test]
    fn factors_by_hand() {
        let motion = Motion {
            place: Some(0),
            position: 3.0,
            speed: -2.0,
            acceleration: -4.0,
            loads: &[-5.0],
        };
        let stribeck = Factor::Stribeck {
            per_speed: 0.5,
            exponent: 2.0,
        };
        let drag = Factor::Power {
            per_speed: 2.0,
            exponent: 0.5,
        };
        let travel = Factor::Travel {
            centre: 1.0,
            per_half: 0.5,
            power: 3,
        };
        for (factor, value) in [
            (Factor::One, 1.0),
            (Factor::Load(0), 5.0),
            (Factor::LoadSquare(0), -25.0),
            (Factor::Acceleration, 4.0),
            (Factor::Speed, 2.0),
            (stribeck, libm::expf(-1.0)),
            (drag, 2.0),
            (travel, 1.0),
        ] {
            assert_eq!(factor.at(&motion), Some(value), "{factor:?}");
        }
    }
}
