//! Registry of the threads that replay. `end_all` stops and joins them, `forget_all` drops them
//! without waiting; the Python package calls these at exit of the interpreter and in a forked
//! process. `Stop` ends one replay.

use std::mem;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// Ends a replay before it reads its next batch.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    pub(crate) fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    pub(crate) fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

static RUNNING: Mutex<Vec<(Stop, JoinHandle<()>)>> = Mutex::new(Vec::new());

fn all() -> std::sync::MutexGuard<'static, Vec<(Stop, JoinHandle<()>)>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Adds a replay; those that have ended are forgotten.
pub(crate) fn add(stop: Stop, thread: JoinHandle<()>) {
    let mut all = all();
    all.retain(|(_, thread)| !thread.is_finished());
    all.push((stop, thread));
}

/// Stops all replays, and waits until their threads have ended.
pub(crate) fn end_all() {
    let all = mem::take(&mut *all());
    for (stop, _) in &all {
        stop.set();
    }
    for (_, thread) in all {
        // A replay that panicked has ended as well.
        let _ = thread.join();
    }
}

/// Forgets all replays without waiting for their threads.
pub(crate) fn forget_all() {
    mem::forget(mem::take(&mut *all()));
}
