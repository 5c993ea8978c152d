//! Thins the series of a plot over its own axis when the page is too large (`thinned`): groups of
//! rows become their least and greatest values, in the order in which they occur. Signals over time
//! are thinned by `decimator.rs`.

/// Rows in groups of twice `reduction`, each group as two: its first and last x, and of each column
/// the least and the greatest value in the order in which they occur. NaN where a group has no
/// value; all rows where `reduction` is 1.
pub(crate) fn thinned(
    x: &[f64],
    columns: &[&[f64]],
    reduction: usize,
) -> (Vec<f64>, Vec<Vec<f32>>) {
    let group = if reduction > 1 { 2 * reduction } else { 1 };
    let ends = |rows: &[f64]| match rows {
        [first, .., last] => vec![*first, *last],
        one => one.to_vec(),
    };
    let column = |column: &&[f64]| {
        let groups = column.chunks(group);
        groups.flat_map(extremes).map(|v| v as f32).collect()
    };
    (
        x.chunks(group).flat_map(ends).collect(),
        columns.iter().map(column).collect(),
    )
}

/// Least and greatest of several values, as they occur; a single value as it is.
fn extremes(rows: &[f64]) -> Vec<f64> {
    if let [one] = rows {
        return vec![*one];
    }
    let known = || {
        rows.iter()
            .copied()
            .enumerate()
            .filter(|(_, v)| v.is_finite())
    };
    let least = known().min_by(|a, b| a.1.total_cmp(&b.1));
    let greatest = known().max_by(|a, b| a.1.total_cmp(&b.1));
    match least.zip(greatest) {
        Some((low, high)) if low.0 <= high.0 => vec![low.1, high.1],
        Some((low, high)) => vec![high.1, low.1],
        None => vec![f64::NAN; 2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_peak_stays_at_its_place() {
        let x: Vec<f64> = (0..1001).map(f64::from).collect();
        let mut y = vec![1.0; 1001];
        (y[503], y[504], y[0]) = (9.0, -7.0, f64::NAN);
        let (thin_x, thin) = thinned(&x, &[&y], 8);
        assert_eq!((thin_x.len(), thin[0].len()), (126, 126));
        assert!(thin_x.is_sorted());
        let at = |value: f32| thin[0].iter().position(|v| *v == value).unwrap();
        assert!(
            (thin_x[at(9.0)] - 503.0).abs() < 16.0 && at(9.0) == 62,
            "{}",
            at(9.0)
        );
        assert!(at(-7.0) > at(9.0));
        assert_eq!(thin[0][0], 1.0);
    }

    #[test]
    fn what_fits_stays_as_it_is_and_gaps_stay_gaps() {
        let (x, y) = (
            [0.0, 1.0, 2.0, 3.0, 4.0],
            [f64::NAN, f64::NAN, f64::NAN, f64::NAN, 2.0],
        );
        assert_eq!(thinned(&x, &[&y], 1).0, x);
        let (thin_x, thin) = thinned(&x, &[&y], 2);
        assert_eq!(thin_x, [0.0, 3.0, 4.0]);
        assert!(thin[0][0].is_nan() && thin[0][1].is_nan() && thin[0][2] == 2.0);
    }
}
