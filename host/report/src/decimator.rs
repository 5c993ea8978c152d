//! Keeps signals over time for plots in bounded memory while they are computed (`MinMaxDecimator`):
//! the minimum and maximum of each column in buckets of equally many samples, merged in pairs when
//! all are full. Peaks and gaps are kept.

/// Least and greatest of a column within a bucket.
#[derive(Clone, Copy, Debug)]
struct Extremes {
    /// NaN as long as the bucket has no value.
    low: f32,
    high: f32,
    low_first: bool,
    gap: bool,
}

impl Extremes {
    const EMPTY: Self = Self {
        low: f32::NAN,
        high: f32::NAN,
        low_first: true,
        gap: false,
    };

    fn push(&mut self, value: f32) {
        if !value.is_finite() {
            self.gap = true;
        } else if self.low.is_nan() {
            (self.low, self.high) = (value, value);
        } else if value > self.high {
            self.high = value;
            self.low_first = true;
        } else if value < self.low {
            self.low = value;
            self.low_first = false;
        }
    }

    fn in_order(self) -> [f32; 2] {
        if self.low_first {
            [self.low, self.high]
        } else {
            [self.high, self.low]
        }
    }

    /// This bucket and the next one as one.
    fn merged(mut self, next: Self) -> Self {
        let gap = self.gap || next.gap;
        for value in next.in_order() {
            self.push(value);
        }
        // A bucket without values is a gap already; its NaN adds none to the other.
        self.gap = gap;
        self
    }
}

/// Columns of samples over one rising axis, kept as minimum and maximum per bucket.
///
/// Up to `capacity` samples are kept as they are. Then neighbouring buckets are merged, and again
/// each time all are full, so memory does not grow with the length and no peak is lost. A value
/// that is not finite breaks the line at its place, to within one bucket. Values are kept as
/// f32: a plot needs no more.
#[derive(Clone, Debug)]
pub struct MinMaxDecimator {
    columns: usize,
    capacity: usize,
    samples_per_bucket: u64,
    in_last: u64,
    samples: u64,
    /// First and last x of each bucket.
    spans: Vec<[f64; 2]>,
    /// One for each column of each bucket.
    extremes: Vec<Extremes>,
}

/// Rows ready to draw: x rises, each column has a value or NaN at each x.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    /// The common axis.
    pub x: Vec<f64>,
    /// The columns, each as long as `x`.
    pub columns: Vec<Vec<f32>>,
    /// Rows of each bucket, 1 to 3.
    pub buckets: Vec<u8>,
}

impl MinMaxDecimator {
    /// For rows of `columns` values, `capacity` buckets (at least 2, rounded to even).
    pub fn new(columns: usize, capacity: usize) -> Self {
        Self {
            columns,
            capacity: capacity.next_multiple_of(2).max(2),
            samples_per_bucket: 1,
            in_last: 0,
            samples: 0,
            spans: Vec::new(),
            extremes: Vec::new(),
        }
    }

    /// Takes one sample at `x`, not below the last: one value for each column in order. Columns
    /// that `values` lacks have a gap there; values beyond the last column are not taken.
    pub fn push(&mut self, x: f64, values: &[f64]) {
        self.samples += 1;
        if self.in_last == self.samples_per_bucket && self.spans.len() == self.capacity {
            self.merge_pairs();
        }
        if self.spans.is_empty() || self.in_last == self.samples_per_bucket {
            self.spans.push([x, x]);
            let all = self.spans.len() * self.columns;
            self.extremes.resize(all, Extremes::EMPTY);
            self.in_last = 0;
        }
        self.in_last += 1;
        if let Some(span) = self.spans.last_mut() {
            span[1] = x;
        }
        let last = self.extremes.len() - self.columns;
        let values = values.iter().copied().chain(std::iter::repeat(f64::NAN));
        for (extremes, value) in self.extremes[last..].iter_mut().zip(values) {
            extremes.push(value as f32);
        }
    }

    /// Samples taken so far.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Samples in a bucket: 1 as long as nothing has been merged.
    pub fn samples_per_bucket(&self) -> u64 {
        self.samples_per_bucket
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// First and last x; `None` before the first sample.
    pub fn span(&self) -> Option<[f64; 2]> {
        Some([self.spans.first()?[0], self.spans.last()?[1]])
    }

    /// Halves the number of buckets, now and for what is still to come.
    pub(super) fn halve(&mut self) {
        self.merge_pairs();
        self.capacity = (self.capacity / 2).next_multiple_of(2).max(2);
    }

    fn merge_pairs(&mut self) {
        let odd = self.spans.len() % 2 == 1;
        self.spans = self
            .spans
            .chunks(2)
            .map(|pair| [pair[0][0], pair[pair.len() - 1][1]])
            .collect();
        self.extremes = self
            .extremes
            .chunks(2 * self.columns.max(1))
            .flat_map(|pair| {
                let (first, second) = pair.split_at(self.columns);
                first.iter().enumerate().map(|(column, extremes)| {
                    second
                        .get(column)
                        .map_or(*extremes, |next| extremes.merged(*next))
                })
            })
            .collect();
        if !odd {
            self.in_last += self.samples_per_bucket;
        }
        self.samples_per_bucket *= 2;
    }

    /// What has been gathered: one row for a bucket of one sample, else two, at the bucket's first
    /// and last x, with each column's extremes in their order. A third row holds the break of
    /// columns that have both values and a gap.
    pub fn rows(&self) -> Rows {
        let mut rows = Rows {
            x: Vec::new(),
            columns: vec![Vec::new(); self.columns],
            buckets: Vec::new(),
        };
        for (bucket, &[first, last]) in self.spans.iter().enumerate() {
            let extremes = &self.extremes[bucket * self.columns..(bucket + 1) * self.columns];
            let breaks = |e: &Extremes| e.gap && !e.low.is_nan();
            let one_value = |e: &Extremes| e.low == e.high || e.low.is_nan();
            let single = first == last && extremes.iter().all(one_value);
            let broken = extremes.iter().any(breaks);
            rows.buckets.push(1 + u8::from(!single) + u8::from(broken));
            rows.x.push(first);
            if !single {
                rows.x.push(last);
            }
            if broken {
                rows.x.push(last);
            }
            for (column, e) in rows.columns.iter_mut().zip(extremes) {
                let [before, after] = e.in_order();
                column.push(before);
                if !single {
                    column.push(after);
                }
                if broken {
                    column.push(if e.gap { f32::NAN } else { after });
                }
            }
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn short_signals_stay_as_they_are() {
        let mut decimator = MinMaxDecimator::new(2, 8);
        for i in 0..8 {
            let y = if i == 3 { f64::NAN } else { f64::from(i) };
            decimator.push(f64::from(i) * 0.5, &[y, -1.0]);
        }
        let rows = decimator.rows();
        assert_eq!(rows.x, [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5]);
        assert!(rows.columns[0][3].is_nan());
        assert_eq!(rows.columns[0][4..], [4.0, 5.0, 6.0, 7.0]);
        assert_eq!(rows.columns[1], [-1.0; 8]);
    }

    /// A million samples with one peak up, one down and one missing value.
    #[test]
    fn peaks_and_gaps_survive_in_bounded_memory() {
        let mut decimator = MinMaxDecimator::new(1, 1000);
        for i in 0..1_000_000 {
            let y = match i {
                123_456 => 5.0,
                123_457 => -7.0,
                700_000 => f64::NAN,
                _ => (f64::from(i) * 0.3).sin(),
            };
            decimator.push(f64::from(i), &[y]);
        }
        assert!(decimator.spans.len() <= 1000 && decimator.spans.len() > 400);
        let rows = decimator.rows();
        assert!(rows.x.len() <= 2001 && rows.x.is_sorted());
        assert_eq!(decimator.span(), Some([0.0, 999_999.0]));
        let at = |y: f32| rows.columns[0].iter().position(|&v| v == y).unwrap();
        // The peak up comes first and both stand within a bucket of where they were.
        assert_eq!(at(-7.0), at(5.0) + 1);
        assert!((rows.x[at(5.0)] - 123_456.0).abs() < 2048.0);
        let gap = rows.columns[0].iter().position(|v| v.is_nan()).unwrap();
        assert!((rows.x[gap] - 700_000.0).abs() < 2048.0);
        assert_eq!(rows.columns[0].iter().filter(|v| v.is_nan()).count(), 1);
    }

    proptest! {
        /// Whatever is pushed and however often it is halved: the range of each column is kept,
        /// x stays in order, a gap stays a gap, all columns are as long as x.
        #[test]
        fn range_order_and_gaps_are_kept(
            values in prop::collection::vec((any::<Option<i16>>(), any::<i16>()), 1..300),
            capacity in 1_usize..40,
            halvings in 0..4,
        ) {
            let mut decimator = MinMaxDecimator::new(2, capacity);
            for (i, &(a, b)) in values.iter().enumerate() {
                decimator.push(i as f64, &[a.map_or(f64::NAN, f64::from), f64::from(b)]);
            }
            for _ in 0..halvings {
                decimator.halve();
            }
            let rows = decimator.rows();
            prop_assert!(rows.x.is_sorted());
            prop_assert_eq!(decimator.samples(), values.len() as u64);
            let range = |values: &mut dyn Iterator<Item = f32>| {
                values.filter(|v| v.is_finite()).fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
            };
            let pushed: [Vec<f32>; 2] = [
                values.iter().map(|v| v.0.map_or(f32::NAN, f32::from)).collect(),
                values.iter().map(|v| f32::from(v.1)).collect(),
            ];
            for (column, pushed) in rows.columns.iter().zip(&pushed) {
                prop_assert_eq!(column.len(), rows.x.len());
                prop_assert_eq!(range(&mut column.iter().copied()), range(&mut pushed.iter().copied()));
                prop_assert_eq!(column.iter().any(|v| v.is_nan()), pushed.iter().any(|v| v.is_nan()));
            }
        }
    }
}
