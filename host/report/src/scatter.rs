//! Chooses at most a given number of points of a scatter plot from rows that are pushed one by one
//! (`ScatterSample`): reservoir sampling, each row with the same chance, and the same choice in
//! each run.

/// At most `capacity` of the rows pushed, each with the same chance (reservoir sampling).
///
/// Every n-th row would not do: over a shaft's angle it may hit the same few angles again and
/// again. The choice is the same on each run.
#[derive(Clone, Debug)]
pub struct ScatterSample {
    capacity: usize,
    pushed: u64,
    state: u64,
    rows: Vec<Vec<f64>>,
}

impl ScatterSample {
    /// Keeps up to `capacity` rows.
    pub fn new(capacity: usize) -> Self {
        Self {
            capacity,
            pushed: 0,
            state: 0,
            rows: Vec::new(),
        }
    }

    /// Takes one row, x first. Rows with an x that is not finite are passed over.
    ///
    /// Source: Vitter 1985, algorithm R; random numbers by splitmix64.
    pub fn push(&mut self, row: &[f64]) {
        if !row.first().is_some_and(|x| x.is_finite()) {
            return;
        }
        self.pushed += 1;
        if self.rows.len() < self.capacity {
            self.rows.push(row.to_vec());
            return;
        }
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        // Upper half of the product: uniform over 0..pushed.
        let place = (u128::from(z) * u128::from(self.pushed)) >> 64;
        if let Some(slot) = self.rows.get_mut(place as usize) {
            slot.clear();
            slot.extend_from_slice(row);
        }
    }

    /// The chosen rows as columns, in order of x; a row that is too short has NaN there.
    pub fn columns(&self) -> Vec<Vec<f64>> {
        let mut rows: Vec<&[f64]> = self.rows.iter().map(Vec::as_slice).collect();
        rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let width = rows.iter().map(|row| row.len()).max().unwrap_or(0);
        (0..width)
            .map(|column| {
                rows.iter()
                    .map(|row| row.get(column).copied().unwrap_or(f64::NAN))
                    .collect()
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_of_the_stream_has_its_share() {
        let mut sample = ScatterSample::new(2000);
        sample.push(&[f64::NAN, 0.0]);
        for i in 0..200_000 {
            // An angle that comes round every 64 samples.
            sample.push(&[f64::from(i % 64), f64::from(i)]);
        }
        let columns = sample.columns();
        assert_eq!(columns.len(), 2);
        assert!(columns[0].is_sorted());
        for angle in 0..64 {
            let share = columns[0]
                .iter()
                .filter(|&&x| x == f64::from(angle))
                .count();
            // 2000/64 = 31, standard deviation 5.5.
            assert!((9..=54).contains(&share), "{angle}: {share}");
        }
        let mean = columns[1].iter().sum::<f64>() / 2000.0;
        assert!(
            (mean - 100_000.0).abs() < 5.0 * 57_735.0 / 2000f64.sqrt(),
            "{mean}"
        );
    }
}
