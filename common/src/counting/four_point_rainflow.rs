//! Closes rainflow cycles by the four-point method, turning point by turning point, and keeps the
//! residue: the turning points that are part of no closed cycle yet, 255 at most (`Residue`). Also
//! gives the ranges between them.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::LEVELS;

/// Most points of a residue, for any input.
///
/// A residue holds no three successive ranges of which the middle one is the
/// smallest or equal to it: its ranges grow strictly, then shrink strictly, and
/// the largest one may come twice. They are whole levels from 1 to
/// `LEVELS - 1`, each at most twice: `2 (LEVELS - 1)` ranges between
/// `2 LEVELS - 1` points.
pub const MAX_POINTS: usize = 2 * LEVELS - 1;

/// A closed cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cycle {
    /// Its lower level.
    pub low: u8,
    /// Its upper level, above `low`.
    pub high: u8,
}

impl Cycle {
    /// The cycle between two levels.
    fn between(a: u8, b: u8) -> Self {
        Self {
            low: a.min(b),
            high: a.max(b),
        }
    }

    /// Its range (levels), above 0.
    pub fn range(self) -> u8 {
        self.high - self.low
    }
}

/// The turning points that are part of no closed cycle yet.
///
/// Of four successive turning points a, b, c, d the cycle (b, c) closes where
/// `|b - c| <= |a - b|` and `|b - c| <= |c - d|`; b and c are then removed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Residue {
    points: Vec<u8, MAX_POINTS>,
}

impl Residue {
    /// No points yet.
    pub const fn new() -> Self {
        Self { points: Vec::new() }
    }

    /// The points in their order.
    pub fn points(&self) -> &[u8] {
        &self.points
    }

    /// Drops the points behind the first `kept`; false where there are fewer.
    pub(super) fn keep(&mut self, kept: usize) -> bool {
        let is = kept <= self.points.len();
        self.points.truncate(kept);
        is
    }

    /// Adds a point as it is; false where there is no place.
    pub(super) fn append_point(&mut self, point: u8) -> bool {
        self.points.push(point).is_ok()
    }

    /// Takes the next turning point and gives each cycle that it closes; maxima and minima have to
    /// alternate.
    pub fn push(&mut self, point: u8, mut closed: impl FnMut(Cycle)) {
        while let Some(cycle) = self.step(point) {
            closed(cycle);
        }
    }

    /// One step of taking a turning point: gives a cycle that it closes, or takes it and
    /// gives none.
    pub(super) fn step(&mut self, point: u8) -> Option<Cycle> {
        if let [.., a, b, c] = self.points[..] {
            let inner = b.abs_diff(c);
            if inner <= a.abs_diff(b) && inner <= c.abs_diff(point) {
                self.points.truncate(self.points.len() - 2);
                return Some(Cycle::between(b, c));
            }
        }
        // Not full: the points with the new one are a residue.
        let pushed = self.points.push(point);
        debug_assert!(pushed.is_ok());
        None
    }

    /// The ranges between successive points, as cycles.
    pub fn ranges(&self) -> impl Iterator<Item = Cycle> {
        self.points
            .windows(2)
            .map(|pair| Cycle::between(pair[0], pair[1]))
    }

    /// Whether the points are a residue, after they came from bytes.
    pub(super) fn is_valid(&self) -> bool {
        let p = &self.points[..];
        let turns = |a: u8, b: u8, c: u8| (a < b && c < b) || (a > b && c > b);
        let closes = |a: u8, b: u8, c: u8, d: u8| {
            b.abs_diff(c) <= a.abs_diff(b) && b.abs_diff(c) <= c.abs_diff(d)
        };
        p.iter().all(|&point| usize::from(point) < LEVELS)
            && p.windows(2).all(|w| w[0] != w[1])
            && p.windows(3).all(|w| turns(w[0], w[1], w[2]))
            && !p.windows(4).any(|w| closes(w[0], w[1], w[2], w[3]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(points: &[u8]) -> (Vec<[u8; 2], 256>, Residue) {
        let mut residue = Residue::new();
        let mut cycles = Vec::new();
        for &point in points {
            residue.push(point, |cycle| cycles.push([cycle.low, cycle.high]).unwrap());
        }
        (cycles, residue)
    }

    /// ASTM E1049-85, figure 6: A to I, with 10 added. Its table counts one cycle of 4 (E-F) and
    /// half cycles of 3, 4, 6, 8, 8, 9.
    #[test]
    fn example_of_the_standard() {
        let (cycles, residue) = count(&[8, 11, 7, 15, 9, 13, 6, 14, 8]);
        assert_eq!(cycles[..], [[9, 13]]);
        assert_eq!(residue.points(), [8, 11, 7, 15, 6, 14, 8]);
        let ranges: Vec<u8, 8> = residue.ranges().map(Cycle::range).collect();
        assert_eq!(ranges[..], [3, 4, 8, 9, 8, 6]);
    }

    /// The longest residue: ranges 1 to 127, then 127 to 1.
    #[test]
    fn the_longest_residue_fits_and_one_point_closes_it() {
        let mut points: Vec<u8, MAX_POINTS> = Vec::new();
        let mut point = 63_i32;
        points.push(63).unwrap();
        for (k, range) in (1..128).chain((1..128).rev()).enumerate() {
            point += if k % 2 == 0 { range } else { -range };
            points.push(u8::try_from(point).unwrap()).unwrap();
        }
        let (cycles, mut residue) = count(&points);
        assert_eq!((cycles.len(), residue.points().len()), (0, MAX_POINTS));
        assert!(residue.is_valid());
        let mut closed = 0;
        let last = points[MAX_POINTS - 1];
        let end = if points[MAX_POINTS - 2] > last {
            127
        } else {
            0
        };
        residue.push(end, |_| closed += 1);
        assert_eq!(residue.points().len(), MAX_POINTS + 1 - 2 * closed);
        assert!(closed > 50 && residue.is_valid(), "{closed}");
    }
}
