//! Resamples rows at arbitrary times to a uniform clock (`Resampler`): low-pass filter (windowed
//! sinc) of dense rows, local line through sparse ones, linear interpolation of counts, an index
//! pulse by its value of largest magnitude. Ticks in gaps are marked; longer gaps than allowed are
//! errors.
//!
//! Tick `k` is at `t0 + k T`, `t0` the time of the first row. What a tick holds
//! depends on what the column is ([`Role`]):
//!
//! | column | rows denser than three quarters of `T` | else |
//! |---|---|---|
//! | gauges and all else | windowed sinc, half at `1 / (2 T)`, [`REACH`] periods | line through the rows within `T`, weights falling to 0 there |
//! | counts, angles | straight between the rows about the tick | the same |
//! | index pulse | the value of largest magnitude since the tick before | the same |
//!
//! A value is not interpolated between rows more than two periods apart.
use super::BLOCK_ROWS;
use super::error::{Problem, Row};
use super::recording_layout::Role;
use super::row_source::Rows;

/// Half width of the filter (periods): with a Hann window the stop band, -44 dB,
/// begins at 0.63 of the estimator's rate (Harris 1978, table I).
const REACH: f64 = 6.0;

/// Steps of rows below which they are filtered (periods).
const DENSE: f64 = 0.75;

/// Time that is no time (periods): rounding of time stamps; 0.2 µs in times since 1970.
const SAME: f64 = 1e-3;

/// Values at the ticks, as many as are known.
pub(super) struct Resampled {
    pub(super) t: Vec<f64>,
    pub(super) columns: Vec<Vec<f64>>,
    /// Ticks without rows about them.
    pub(super) bridged: Vec<usize>,
}

/// Rows of which the ticks about them are not all done.
pub(super) struct Resampler {
    period_s: f64,
    largest_gap: u32,
    roles: Vec<Role>,
    origin_s: f64,
    next: u64,
    /// Their times from the origin on.
    rows: Rows,
    /// Rows of the file before those held.
    before: u64,
}

impl Resampler {
    /// `roles`: what each column is, the time first.
    pub(super) fn new(mut first: Rows, roles: Vec<Role>, period_s: f64, largest_gap: u32) -> Self {
        let origin_s = first.t().first().copied().unwrap_or(0.0);
        first.count_from(origin_s);
        Self {
            period_s,
            largest_gap,
            roles,
            origin_s,
            next: 0,
            rows: first,
            before: 0,
        }
    }

    pub(super) fn push(&mut self, mut rows: Rows) {
        rows.count_from(self.origin_s);
        for (held, new) in self.rows.columns.iter_mut().zip(rows.columns) {
            held.extend(new);
        }
        self.rows.lines.extend(rows.lines);
    }

    /// The ticks that the rows held determine, a block at most; `ended`: no more
    /// rows come.
    ///
    /// # Errors
    /// [`Problem::Gap`] when more ticks in a row lack rows than allowed.
    pub(super) fn take(&mut self, ended: bool) -> Result<Resampled, Problem> {
        let mut out = Resampled {
            t: Vec::new(),
            columns: vec![Vec::new(); self.roles.len()],
            bridged: Vec::new(),
        };
        let end = self.rows.t().last().copied().unwrap_or(f64::NEG_INFINITY);
        let reach = if ended { -SAME } else { REACH } * self.period_s;
        let mut at = 0;
        while out.t.len() < BLOCK_ROWS {
            let tick = self.next as f64 * self.period_s;
            if tick + reach > end {
                break;
            }
            let t = self.rows.t();
            while t[at] < tick - SAME * self.period_s && at + 1 < t.len() {
                at += 1;
            }
            if self.is_absent(tick, at)? {
                out.bridged.push(out.t.len());
            }
            out.t.push(self.origin_s + tick);
            for (k, (column, role)) in out.columns.iter_mut().zip(&self.roles).enumerate() {
                let signal = Signal {
                    t,
                    values: &self.rows.columns[k],
                    tick,
                    period_s: self.period_s,
                    at,
                };
                column.push(match role {
                    Role::Continuous => signal.filtered(),
                    Role::Counts { modulus } => signal.between(*modulus),
                    Role::Pulse => signal.pulse(),
                });
            }
            self.next += 1;
        }
        self.forget();
        Ok(out)
    }

    /// Whether `tick` lies in a gap; `at`: the first row not before it.
    fn is_absent(&self, tick: f64, at: usize) -> Result<bool, Problem> {
        let t = self.rows.t();
        let is_on = (t[at] - tick).abs() <= SAME * self.period_s;
        let Some(before) = at.checked_sub(1).map(|i| t[i]).filter(|_| !is_on) else {
            return Ok(false);
        };
        let gap_s = t[at] - before;
        if gap_s <= (2.0 + SAME) * self.period_s {
            return Ok(false);
        }
        let missing = (gap_s / self.period_s).round() as u64 - 1;
        if missing > u64::from(self.largest_gap) {
            return Err(Problem::Gap {
                row: self.place(at),
                before: self.origin_s + before,
                gap_s,
                missing,
                allowed: self.largest_gap,
                period_s: self.period_s,
            });
        }
        Ok(true)
    }

    fn place(&self, i: usize) -> Row {
        self.rows.place(self.before, i)
    }

    /// Drops the rows that no tick to come needs.
    fn forget(&mut self) {
        let from = (self.next as f64 - REACH - 2.0) * self.period_s;
        let t = self.rows.t();
        // The row before a gap stays.
        let done = t.partition_point(|t| *t < from).saturating_sub(1);
        self.before += done as u64;
        for column in &mut self.rows.columns {
            column.drain(..done);
        }
        self.rows.lines.drain(..done.min(self.rows.lines.len()));
    }
}

impl Rows {
    /// Takes `origin_s` off the times: differences from ticks keep their digits.
    fn count_from(&mut self, origin_s: f64) {
        for t in &mut self.columns[Self::TIME] {
            *t -= origin_s;
        }
    }
}

/// One column about one tick.
struct Signal<'a> {
    t: &'a [f64],
    values: &'a [f64],
    tick: f64,
    period_s: f64,
    /// First row not before the tick.
    at: usize,
}

impl Signal<'_> {
    /// Distance of row `i` from the tick (periods).
    fn u(&self, i: usize) -> f64 {
        (self.t[i] - self.tick) / self.period_s
    }

    /// Rows with a value, from the tick outwards to both sides, within `reach`.
    fn sides(&self, reach: f64) -> [impl Iterator<Item = (f64, f64)> + '_; 2] {
        let point = move |i: usize| (self.u(i), self.values[i]);
        let side = move |rows: Box<dyn Iterator<Item = usize>>| {
            rows.map(point)
                .take_while(move |(u, _)| u.abs() < reach)
                .filter(|(_, v)| v.is_finite())
        };
        [
            side(Box::new((0..self.at).rev())),
            side(Box::new(self.at..self.t.len())),
        ]
    }

    /// The part of the signal below half the ticks' rate.
    fn filtered(&self) -> f64 {
        let mut rows: Vec<(f64, f64)> = Vec::new();
        let [before, after] = self.sides(REACH);
        rows.extend(before);
        rows.reverse();
        rows.extend(after);
        let reaches = rows.first().is_some_and(|r| r.0 < DENSE - REACH)
            && rows.last().is_some_and(|r| r.0 > REACH - DENSE);
        if reaches && rows.windows(2).all(|r| r[1].0 - r[0].0 <= DENSE) {
            return windowed_sinc(&rows);
        }
        if let Some((_, value)) = rows.iter().find(|(u, _)| u.abs() <= SAME) {
            return *value;
        }
        let near = rows.iter().filter(|(u, _)| u.abs() < 1.0);
        let (mut below, mut above) = (false, false);
        let (mut s0, mut s1, mut s2, mut y0, mut y1) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for &(u, v) in near {
            below |= u < 0.0;
            above |= u > 0.0;
            let w = 1.0 - u.abs();
            (s0, s1, s2) = (s0 + w, s1 + w * u, s2 + w * u * u);
            (y0, y1) = (y0 + w * v, y1 + w * u * v);
        }
        if !(below && above) {
            return self.between(None);
        }
        // Rows on both sides, none on the tick: the determinant is positive.
        (s2 * y0 - s1 * y1) / (s0 * s2 - s1 * s1)
    }

    /// Straight between the two rows about the tick, of counts that begin anew
    /// after `modulus`.
    fn between(&self, modulus: Option<f64>) -> f64 {
        let [mut before, mut after] = self.sides(2.0 + SAME);
        let Some(next) = after.next() else {
            return f64::NAN;
        };
        if next.0 <= SAME {
            return next.1;
        }
        let Some(last) = before.next() else {
            return f64::NAN;
        };
        if next.0 - last.0 > 2.0 + SAME {
            return f64::NAN;
        }
        let mut step = next.1 - last.1;
        if let Some(modulus) = modulus {
            step -= (step / modulus).round() * modulus;
        }
        last.1 - step * last.0 / (next.0 - last.0)
    }

    /// The value of largest magnitude since the tick before; NaN where there is none.
    fn pulse(&self) -> f64 {
        let mut largest = f64::NAN;
        let on_tick = (self.at..self.t.len()).take_while(|&i| self.u(i) <= SAME);
        let since = (0..self.at).rev().take_while(|&i| self.u(i) > SAME - 1.0);
        for value in since.chain(on_tick).map(|i| self.values[i]) {
            if value.is_finite() && (largest.is_nan() || value.abs() > f64::abs(largest)) {
                largest = value;
            }
        }
        largest
    }
}

/// Low-pass of rows, each its distance from the tick (periods) and its value, in their order, each
/// with the weight of the time that it represents.
fn windowed_sinc(rows: &[(f64, f64)]) -> f64 {
    use std::f64::consts::PI;
    let (mut sum, mut weights) = (0.0, 0.0);
    for (i, &(u, v)) in rows.iter().enumerate() {
        let from = rows[i.saturating_sub(1)].0;
        let to = rows[(i + 1).min(rows.len() - 1)].0;
        let sinc = if u == 0.0 {
            1.0
        } else {
            (PI * u).sin() / (PI * u)
        };
        let window = (0.5 * PI * u / REACH).cos().powi(2);
        let weight = 0.5 * (to - from) * sinc * window;
        sum += weight * v;
        weights += weight;
    }
    sum / weights
}
