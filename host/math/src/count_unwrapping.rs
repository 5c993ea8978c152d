//! Unwraps the counts of a counter that wraps, such as an encoder's: gives the motion since the
//! first known count.

/// Motion since the first known of `counts` of a counter that wraps at `modulus`, `f64::INFINITY`
/// for one that does not; a missing count (NaN) repeats the last.
///
/// A step of more than half of the modulus is one the other way round.
pub fn unwrapped(counts: &[f64], modulus: f64) -> Vec<f64> {
    let mut last = counts
        .iter()
        .copied()
        .find(|c| c.is_finite())
        .unwrap_or(0.0);
    let mut total = 0.0;
    counts
        .iter()
        .map(|count| {
            if count.is_finite() {
                let mut moved = count - last;
                if modulus.is_finite() {
                    moved -= (moved / modulus).round() * modulus;
                }
                total += moved;
                last = *count;
            }
            total
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::unwrapped;

    #[test]
    fn a_wrap_is_a_step_and_a_missing_count_repeats_the_last() {
        let counts = [250.0, 254.0, f64::NAN, 2.0, 255.0];
        assert_eq!(unwrapped(&counts, 256.0), [0.0, 4.0, 4.0, 8.0, 5.0]);
        assert_eq!(
            unwrapped(&counts, f64::INFINITY),
            [0.0, 4.0, 4.0, -248.0, 5.0]
        );
    }
}
