//! Converts the effects that `loadtwin diagnose` wrote into a drive's description to terms of the
//! estimator (coefficient, factor, direction of friction) and to delays between its signals.
//! Refuses effects that the board lacks: warm-up, temperature.

use std::f64::consts::TAU;

use loadtwin_common::drive::term::{Direction, Factor, MAX_POWER};
use loadtwin_machine::{Balance, BalanceEffect, Regime, Violation};

/// Entries of a periodic table for each wave of its highest order: straight lines between them are
/// off by `1 - cos(pi / 16)`, 2 % of that order.
const ENTRIES_A_WAVE: usize = 16;

/// Largest table, as the estimator reads it.
const MOST_ENTRIES: usize = 4096;

/// A term before its tables have their place.
pub(super) struct Part {
    pub coefficient: f64,
    pub factor: PartFactor,
    pub direction: Option<Direction>,
}

/// How large a term is.
pub(super) enum PartFactor {
    /// As the estimator has it.
    Plain(Factor<'static>),
    /// A periodic function of the position.
    Periodic {
        /// One period [rad, m].
        period: f64,
        /// Values over one period from position 0.
        table: Vec<f32>,
    },
}

/// What the effects of a description come to in the estimator.
#[derive(Default)]
pub(super) struct Effects {
    pub parts: Vec<Part>,
    /// How late the drive is against the motion (s).
    pub late_to_motion_s: f64,
    /// How late it is against each load (s).
    pub late_to_loads_s: Vec<f64>,
}

impl Effects {
    /// The effects of `balance`.
    ///
    /// # Errors
    /// The effect that has no term in the estimator, or not the numbers that it needs.
    pub(super) fn new(balance: &Balance) -> Result<Self, Violation> {
        let mut effects = Self {
            late_to_loads_s: vec![0.0; balance.loads.len()],
            ..Self::default()
        };
        for (i, effect) in balance.effects.iter().enumerate() {
            let refused = |part: &str, found: String, allowed: &str| Violation {
                field: format!("balance.effect[{}].{part}", i + 1),
                found,
                allowed: allowed.into(),
            };
            let numbers = || {
                let [shape, terms] = [effect.shape.len(), effect.coefficients.len()];
                let found = format!("{shape} of shape and {terms} coefficients");
                refused("shape", found, "those that `loadtwin diagnose` writes")
            };
            match effect.name.as_str() {
                "delay" => effects.delay(balance, effect).ok_or_else(numbers)?,
                name @ ("warm-up" | "temperature-dependence") => {
                    let allowed = "on the board: effects of the motion and of loads";
                    return Err(refused("name", format!("{name:?}"), allowed));
                }
                _ => {
                    let parts = parts(balance, effect).ok_or_else(numbers)?;
                    effects.parts.extend(parts);
                }
            }
        }
        if balance.position.is_none() && effects.parts.iter().any(Part::is_placed) {
            return Err(Violation {
                field: "balance.position".into(),
                found: "nothing".into(),
                allowed: "a column, which an effect over the travel needs".into(),
            });
        }
        Ok(effects)
    }

    /// `-T J da/dt - T_j dL_j/dt` is what a delay comes to at first order.
    fn delay(&mut self, balance: &Balance, effect: &BalanceEffect) -> Option<()> {
        let (motion, loads) = effect.coefficients.split_first()?;
        if loads.len() != balance.loads.len() {
            return None;
        }
        if balance.inertia != 0.0 {
            self.late_to_motion_s -= motion / balance.inertia;
        }
        for (late, load) in self.late_to_loads_s.iter_mut().zip(loads) {
            *late -= load;
        }
        Some(())
    }
}

impl Part {
    /// Whether it depends on where the position is zero.
    fn is_placed(&self) -> bool {
        matches!(
            self.factor,
            PartFactor::Periodic { .. } | PartFactor::Plain(Factor::Travel { .. })
        )
    }
}

/// The terms of an effect; none where it has not the numbers that it needs.
fn parts(balance: &Balance, effect: &BalanceEffect) -> Option<Vec<Part>> {
    let shape = |i: usize| effect.shape.get(i).copied();
    match effect.name.as_str() {
        "load-dependent-friction" if !balance.loads.is_empty() => {
            let direction = sliding(balance, shape(0)?);
            each_load(balance, effect, Factor::Load, Some(direction))
        }
        "load-nonlinearity" => each_load(balance, effect, Factor::LoadSquare, None),
        "position-dependent-torque" => powers(effect, [shape(0)?, shape(1)?, shape(2)?], None),
        "position-dependent-friction" => {
            let direction = sliding(balance, shape(0)?);
            powers(effect, [shape(1)?, shape(2)?, shape(3)?], Some(direction))
        }
        "gravity" => waves(TAU, &effect.coefficients),
        "torque-ripple" => waves(shape(1)?, &effect.coefficients),
        "position-ripple" => waves(shape(0)?, &effect.coefficients),
        _ => {
            let (factor, direction) = single(balance, effect)?;
            let [coefficient] = effect.coefficients[..] else {
                return None;
            };
            Some(vec![Part {
                coefficient,
                factor: PartFactor::Plain(factor),
                direction,
            }])
        }
    }
}

/// Factor and direction of an effect of one coefficient.
fn single(
    balance: &Balance,
    effect: &BalanceEffect,
) -> Option<(Factor<'static>, Option<Direction>)> {
    let shape = |i: usize| effect.shape.get(i).copied();
    let friction = |s: usize, v_r: usize| -> Option<Direction> {
        Some(match shape(v_r)? {
            speed if speed > 0.0 => Direction::Fading {
                speed: speed as f32,
            },
            _ => sliding(balance, shape(s)?),
        })
    };
    Some(match effect.name.as_str() {
        "coulomb-friction" => (Factor::One, Some(friction(0, 1)?)),
        "stribeck-friction" => {
            let factor = Factor::Stribeck {
                per_speed: (1.0 / shape(0)?) as f32,
                exponent: shape(1)? as f32,
            };
            (factor, Some(friction(2, 3)?))
        }
        "presliding-hysteresis" => (Factor::One, Some(sliding(balance, shape(0)?))),
        "directional-friction" => (Factor::Speed, None),
        "nonlinear-drag" => {
            let factor = Factor::Power {
                per_speed: (1.0 / shape(1)?) as f32,
                exponent: shape(0)? as f32,
            };
            (factor, Some(Direction::Sign))
        }
        "held-at-rest" => {
            let speed = shape(0)? as f32;
            (Factor::One, Some(Direction::Moving { speed }))
        }
        "backlash" => {
            let half = (0.5 * shape(0)?) as f32;
            (Factor::One, Some(Direction::Gap { half }))
        }
        // Without a measured load.
        "load-dependent-friction" => (Factor::Acceleration, Some(sliding(balance, shape(0)?))),
        _ => return None,
    })
}

/// Friction over a distance; at constant speed that of the speed.
fn sliding(balance: &Balance, distance: f64) -> Direction {
    if balance.regime == Regime::Steady {
        Direction::Sign
    } else {
        Direction::Sliding {
            distance: distance as f32,
        }
    }
}

fn each_load(
    balance: &Balance,
    effect: &BalanceEffect,
    factor: impl Fn(u8) -> Factor<'static>,
    direction: Option<Direction>,
) -> Option<Vec<Part>> {
    let part = |(i, coefficient): (u8, &f64)| Part {
        coefficient: *coefficient,
        factor: PartFactor::Plain(factor(i)),
        direction,
    };
    let fits = effect.coefficients.len() == balance.loads.len();
    fits.then(|| (0..).zip(&effect.coefficients).map(part).collect())
}

/// `sum_n c_n u^n`, `u = (x - x_0) / h`, of `[degree, x_0, h]`.
fn powers(
    effect: &BalanceEffect,
    [degree, centre, half]: [f64; 3],
    direction: Option<Direction>,
) -> Option<Vec<Part>> {
    let most = usize::from(MAX_POWER).min(degree as usize);
    let part = |(power, coefficient): (u8, &f64)| Part {
        coefficient: *coefficient,
        factor: PartFactor::Plain(Factor::Travel {
            centre: centre as f32,
            per_half: (1.0 / half) as f32,
            power,
        }),
        direction,
    };
    let fits = effect.coefficients.len() == most;
    fits.then(|| (1..).zip(&effect.coefficients).map(part).collect())
}

/// `sum_n a_n cos(n theta) + b_n sin(n theta)`, `theta = 2 pi x / period`, as one table.
fn waves(period: f64, coefficients: &[f64]) -> Option<Vec<Part>> {
    let (orders, []) = coefficients.as_chunks::<2>() else {
        return None;
    };
    let entries = (ENTRIES_A_WAVE * orders.len()).next_power_of_two();
    let entries = entries.clamp(64, MOST_ENTRIES);
    let at = |i: usize| {
        let theta = TAU * i as f64 / entries as f64;
        let wave = |(n, [a, b]): (f64, &[f64; 2])| {
            let (sine, cosine) = (n * theta).sin_cos();
            a * cosine + b * sine
        };
        let numbers = (1..).map(f64::from);
        numbers.zip(orders).map(wave).sum::<f64>() as f32
    };
    Some(vec![Part {
        coefficient: 1.0,
        factor: PartFactor::Periodic {
            period,
            table: (0..entries).map(at).collect(),
        },
        direction: None,
    }])
}
