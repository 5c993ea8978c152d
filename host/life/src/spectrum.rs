//! Makes the spectrum of load cycles by range from the counts of a load, with each range of the
//! residue as half a cycle; merges spectra of several machines, and widens all ranges by one
//! amount. Also gives the turns of a shaft at each load.

use loadtwin_common::counting::{Cycle, LoadCounts, TURN_BINS};

use crate::LifeError;

/// Cycles of one range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadCycle {
    /// Range, from minimum to maximum (in the unit of the load), > 0.
    pub range: f64,
    /// How many; a half cycle is 0.5.
    pub count: f64,
}

/// Cycles by range: closed cycles, and each range of the residue as a half cycle.
///
/// Recordings of one machine are joined by [`LoadCounts::append`], which
/// counts the cycles that only close in a later one. Machines have cycles of
/// their own: [`Spectrum::merge`] adds them.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    width: f64,
    /// By how much each range is wider than counted (in the unit of the load).
    widening: f64,
    /// By range (levels).
    counts: Vec<f64>,
    scale: String,
}

impl Spectrum {
    /// The cycles of one machine, as if its time ended now.
    ///
    /// # Errors
    /// [`LifeError::Beyond`] when the scale does not cover the load.
    pub fn of(name: &str, counts: &LoadCounts) -> Result<Self, LifeError> {
        let [from, to] = counts.scale().ends();
        if let (1.., Some([lowest, highest])) = (counts.observation().beyond, counts.extremes()) {
            return Err(LifeError::Beyond {
                name: name.into(),
                lowest: lowest.load,
                highest: highest.load,
                from,
                to,
                samples: counts.observation().beyond,
            });
        }
        let (closed, residue) = counts.ended();
        let mut cycles: Vec<f64> = closed.ranges().iter().map(|count| count as f64).collect();
        for range in residue.ranges().map(Cycle::range) {
            cycles[usize::from(range)] += 0.5;
        }
        Ok(Self {
            width: f64::from(counts.scale().width()),
            widening: 0.0,
            counts: cycles,
            scale: format!("{from} to {to} with a gate of {} levels", counts.gate()),
        })
    }

    /// Adds the cycles of another machine.
    ///
    /// # Errors
    /// [`LifeError::Scale`] when it was counted on another scale or with another gate.
    pub fn merge(&mut self, name: &str, other: &Self) -> Result<(), LifeError> {
        if self.scale != other.scale {
            return Err(LifeError::Scale {
                name: name.into(),
                found: other.scale.clone(),
                expected: self.scale.clone(),
            });
        }
        for (count, more) in self.counts.iter_mut().zip(&other.counts) {
            *count += more;
        }
        Ok(())
    }

    /// Cycles by increasing range.
    pub fn cycles(&self) -> impl Iterator<Item = LoadCycle> {
        let cycles = self
            .counts
            .iter()
            .enumerate()
            .map(|(range, &count)| LoadCycle {
                range: range as f64 * self.width + self.widening,
                count,
            });
        cycles.filter(|cycle| cycle.count > 0.0 && cycle.range > 0.0)
    }

    /// The same cycles with each range wider by `by` (in the unit of the load); narrower for a
    /// negative one, and without those that vanish.
    #[must_use]
    pub fn widened(&self, by: f64) -> Self {
        Self {
            widening: self.widening + by,
            ..self.clone()
        }
    }
}

/// Turns of a shaft at load: load in the middle of each bin, turns; bins without turns are left out.
pub fn turns_at_load(counts: &LoadCounts, shaft: usize) -> Vec<(f64, f64)> {
    let [from, to] = counts.scale().ends().map(f64::from);
    let width = (to - from) / TURN_BINS as f64;
    let Some(turns) = counts.turns().get(shaft) else {
        return Vec::new();
    };
    (0..TURN_BINS)
        .map(|bin| (from + (bin as f64 + 0.5) * width, turns.turns(bin)))
        .filter(|(_, turns)| *turns > 0.0)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use loadtwin_common::counting::LevelScale;

    fn counts(from: f32, to: f32, loads: &[f32]) -> LoadCounts {
        let mut counts = LoadCounts::try_new(LevelScale::covering(from, to).unwrap(), 1).unwrap();
        for &load in loads {
            counts.push(Some(load), [0; 2]);
        }
        counts
    }

    /// ASTM E1049-85, figure 6: 0.5 cycles of 3, 1.5 of 4, 0.5 of 6, 1 of 8, 0.5 of 9.
    #[test]
    fn example_of_the_standard() {
        let loads = [-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0];
        let spectrum = Spectrum::of("a", &counts(-64.0, 64.0, &loads)).unwrap();
        let found: Vec<_> = spectrum.cycles().map(|c| (c.range, c.count)).collect();
        let expected = [(3.0, 0.5), (4.0, 1.5), (6.0, 0.5), (8.0, 1.0), (9.0, 0.5)];
        assert_eq!(found, expected);
    }

    #[test]
    fn machines_add_their_cycles_and_recordings_close_theirs() {
        let (up, down) = (
            counts(-64.0, 64.0, &[0.0, 10.0]),
            counts(-64.0, 64.0, &[0.0, 10.0]),
        );
        let mut machines = Spectrum::of("a", &up).unwrap();
        machines
            .merge("b", &Spectrum::of("b", &down).unwrap())
            .unwrap();
        let found: Vec<_> = machines.cycles().map(|c| (c.range, c.count)).collect();
        assert_eq!(found, [(10.0, 1.0)]);
        let mut joined = up;
        joined.append(&down).unwrap();
        let joined = Spectrum::of("a", &joined).unwrap();
        let found: Vec<_> = joined.cycles().map(|c| (c.range, c.count)).collect();
        assert_eq!(found, [(10.0, 1.5)]);
    }

    #[test]
    fn what_does_not_fit_is_one_line() {
        let mut wide = Spectrum::of("a", &counts(-64.0, 64.0, &[0.0, 1.0])).unwrap();
        let narrow = Spectrum::of("b", &counts(-8.0, 8.0, &[0.0, 1.0])).unwrap();
        let error = wide.merge("b", &narrow).unwrap_err().to_string();
        assert!(error.starts_with("scale of b is -8 to 8 with"), "{error}");
        let error = Spectrum::of("b", &counts(-8.0, 8.0, &[0.0, 12.0])).unwrap_err();
        let error = error.to_string();
        assert!(
            error.starts_with("b reaches from 0 to 12, beyond its range -8 to 8"),
            "{error}"
        );
        assert!(!error.contains('\n'));
    }
}
