//! Parses two numbers with a colon between, as `1e6:250`: a point of an S-N curve, a range, a
//! rating.

/// The numbers of a text as 1e6:250; none where it is something else or a number is not finite.
pub fn number_pair(text: &str) -> Option<(f64, f64)> {
    let number = |text: &str| text.trim().parse().ok().filter(|x: &f64| x.is_finite());
    let (first, second) = text.split_once(':')?;
    Some((number(first)?, number(second)?))
}
