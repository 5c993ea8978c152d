//! Shows a progress bar on standard error (`Progress`) where that is a terminal, the work takes
//! more than a second and `--quiet` is not given.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Resolution of the bar.
const STEPS: u64 = 1000;

/// Whether `--quiet` was given.
static HIDDEN: AtomicBool = AtomicBool::new(false);

/// From now on no bar appears.
pub(super) fn hide() {
    HIDDEN.store(true, Ordering::Relaxed);
}

/// A bar that appears when work takes more than a second.
pub struct Progress {
    bar: ProgressBar,
    started: std::time::Instant,
}

impl Progress {
    /// A bar called `what`.
    pub fn new(what: &str) -> Self {
        // Hidden until a second has passed; indicatif itself draws nothing without a terminal.
        let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::hidden());
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} % {eta}") {
            bar.set_style(style);
        }
        bar.set_message(what.to_owned());
        Self {
            bar,
            started: std::time::Instant::now(),
        }
    }

    /// Shows that `part` of the work is done, 0 to 1.
    pub fn show(&self, part: f64) {
        let may_show = !HIDDEN.load(Ordering::Relaxed);
        if may_show && self.bar.is_hidden() && self.started.elapsed() > Duration::from_secs(1) {
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
        self.bar.set_position((part * STEPS as f64) as u64);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
