//! Detects whether samples were processed since the last call (`Progress`), so that a board feeds
//! its watchdog only then.

/// Detects whether a wrapping count has gone on.
///
/// A board's thread feeds the watchdog only then, so that a converter, a sample
/// clock or an estimator that stands still starts the board over, as a thread that
/// hangs does.
#[derive(Clone, Copy, Debug, Default)]
pub struct Progress {
    seen: u32,
}

impl Progress {
    /// Whether `processed` differs from the last call's, or from 0 in the first.
    pub fn goes_on(&mut self, processed: u32) -> bool {
        let goes_on = processed != self.seen;
        self.seen = processed;
        goes_on
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_sample_since_the_last_time_is_progress() {
        let mut progress = Progress::default();
        let seen = [0, 1, 1, 5, 5, u32::MAX, 0, 0].map(|count| progress.goes_on(count));
        assert_eq!(seen, [false, true, false, true, false, true, true, false]);
    }
}
