//! Success rate of a benchmark: count, total and the 95 % interval of its probability.

use std::fmt;

/// So many of so many.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rate {
    pub right: usize,
    pub of: usize,
}

impl Rate {
    /// One more.
    pub fn count(&mut self, right: bool) {
        self.right += usize::from(right);
        self.of += 1;
    }

    /// 95 % interval of the probability.
    ///
    /// Source: Wilson 1927, "Probable inference, the law of succession, and
    /// statistical inference".
    pub fn interval(self) -> [f64; 2] {
        const Z: f64 = 1.96;
        let n = self.of as f64;
        let p = self.right as f64 / n;
        let middle = p + Z * Z / (2.0 * n);
        let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        [middle - half, middle + half].map(|v| (v / (1.0 + Z * Z / n)).clamp(0.0, 1.0))
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.of == 0 {
            return f.write_str("no recordings");
        }
        let [low, high] = self.interval().map(|v| 100.0 * v);
        let percent = 100.0 * self.right as f64 / self.of as f64;
        write!(
            f,
            "{:>4} of {:>4}  {percent:>3.0} % ({low:.0} to {high:.0})",
            self.right, self.of
        )
    }
}
