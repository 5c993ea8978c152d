//! Signals that are late: by a fixed time, or as a first-order lag.

use std::borrow::Cow;

/// What `values` were `samples` before, or will be where that is negative, by straight lines; beyond
/// the ends, as there.
pub fn earlier(values: &[f64], samples: f64) -> Cow<'_, [f64]> {
    if samples == 0.0 {
        return Cow::Borrowed(values);
    }
    let (whole, part) = (samples.floor() as isize, samples - samples.floor());
    let last = values.len() as isize - 1;
    let at = |i: isize| values[i.clamp(0, last) as usize];
    let mixed = |i: isize| match part {
        0.0 => at(i - whole),
        _ => at(i - whole) * (1.0 - part) + at(i - whole - 1) * part,
    };
    (0..=last).map(mixed).collect()
}

/// `dz/dt = (u - z) / time_s` from 0, for each of `u`, `dt_s` (s) apart.
pub fn lag(u: impl IntoIterator<Item = f64>, dt_s: f64, time_s: f64) -> Vec<f64> {
    let rate = 1.0 - (-dt_s / time_s).exp();
    let mut z = 0.0;
    let follow = |u: f64| {
        z += rate * (u - z);
        z
    };
    u.into_iter().map(follow).collect()
}

/// What follows `u` by `dz/dt = (u - z) / time`, from where `u` begins; `u` itself without `time`.
pub fn followed(u: impl IntoIterator<Item = f64>, dt_s: f64, time_s: f64) -> Vec<f64> {
    let mut u = u.into_iter().peekable();
    let first = u.peek().copied().unwrap_or(0.0);
    if time_s > 0.0 {
        let above = lag(u.map(|u| u - first), dt_s, time_s);
        above.into_iter().map(|z| first + z).collect()
    } else {
        u.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_earlier_lies_between_samples() {
        let values = [1.0, 2.0, 4.0, 8.0];
        assert_eq!(*earlier(&values, 0.0), values);
        assert_eq!(*earlier(&values, 1.5), [1.0, 1.0, 1.5, 3.0]);
        assert_eq!(*earlier(&values, -0.5), [1.5, 3.0, 6.0, 8.0]);
    }
}
