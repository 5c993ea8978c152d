//! Finds where a rotor as described is unstable, from the least damped eigenvalue at each speed:
//! range of speeds, fastest growth (1/s) and its frequency, and a note for the user.

use faer::c64;
use serde::Serialize;

/// Part of its frequency by which a motion must grow: less is rounding of an undamped one.
const GROWS: f64 = 1e-6;

/// A motion that grows by itself, as cross-coupled seals and films make it above a speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Instability {
    /// Speeds between which motions grow: where the growth passes zero between two speeds that
    /// were looked at, or the last of them [rad/s].
    pub from_to_rad_s: [f64; 2],
    /// Speed of the fastest growth [rad/s].
    pub speed_rad_s: f64,
    /// Frequency of what grows there [rad/s].
    pub frequency_rad_s: f64,
    /// `Re s` there [1/s].
    pub growth_per_s: f64,
}

impl Instability {
    /// Of the least damped eigenvalue `s` at each speed [rad/s], in any order; none where all decay.
    pub(crate) fn among(mut least: Vec<(f64, c64)>) -> Option<Self> {
        least.sort_by(|a, b| a.0.total_cmp(&b.0));
        let grows = |s: c64| s.re > GROWS * s.re.hypot(s.im);
        let first = least.iter().position(|(_, s)| grows(*s))?;
        let last = least.iter().rposition(|(_, s)| grows(*s))?;
        let (speed_rad_s, s) =
            (least[first..=last].iter().copied()).max_by(|a, b| a.1.re.total_cmp(&b.1.re))?;
        let edge = |inside: usize, outside: Option<&(f64, c64)>| {
            let (speed, s) = least[inside];
            outside.map_or(speed, |(next, decays)| {
                speed + (next - speed) * s.re / (s.re - decays.re)
            })
        };
        let before = first.checked_sub(1).and_then(|k| least.get(k));
        Some(Self {
            from_to_rad_s: [edge(first, before), edge(last, least.get(last + 1))],
            speed_rad_s,
            frequency_rad_s: s.im.abs(),
            growth_per_s: s.re,
        })
    }

    /// One line for a reader.
    pub fn note(&self) -> String {
        let [from, to] = self.from_to_rad_s;
        let speeds = if from < to {
            format!("from about {from:.1} to {to:.1} rad/s")
        } else {
            format!("at {from:.1} rad/s")
        };
        format!(
            "the machine as described is unstable {speeds}: at {:.1} rad/s a motion of {:.1} rad/s grows by {:.3} 1/s; \
             estimates there are not to be trusted",
            self.speed_rad_s, self.frequency_rad_s, self.growth_per_s
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_is_where_the_growth_passes_zero() {
        let at = |speed: f64, growth: f64| (speed, c64::new(growth, 150.0));
        let found = Instability::among(vec![at(100.0, -3.0), at(300.0, 5.0), at(200.0, 1.0)]);
        let found = found.unwrap();
        assert_eq!(found.from_to_rad_s, [175.0, 300.0]);
        assert_eq!((found.speed_rad_s, found.growth_per_s), (300.0, 5.0));
        assert!(found.note().contains("from about 175.0 to 300.0 rad/s"));
        assert_eq!(Instability::among(vec![at(100.0, -3.0)]), None);
        // An undamped rotor, rounded.
        assert_eq!(Instability::among(vec![at(100.0, 1e-9)]), None);
    }
}
