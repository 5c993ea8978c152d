//! Keeps the reference to the data of one interrupt handler (`Owned`). The handler takes it while
//! it runs; interrupts are disabled while it takes and returns it, not while it works on the data.

use core::cell::Cell;

use critical_section::Mutex;

/// A place from which a handler takes its data while it runs.
pub struct Owned<T: 'static>(Mutex<Cell<Option<&'static mut T>>>);

impl<T: Send> Owned<T> {
    /// Empty; for a `static`.
    pub const fn new() -> Self {
        Self(Mutex::new(Cell::new(None)))
    }

    /// Puts the data there.
    pub fn give(&self, data: &'static mut T) {
        critical_section::with(|cs| self.0.borrow(cs).set(Some(data)));
    }

    /// Runs `handler` on the data; not at all where there is none, or where it
    /// is in use.
    pub fn with(&self, handler: impl FnOnce(&mut T)) {
        if let Some(data) = critical_section::with(|cs| self.0.borrow(cs).take()) {
            handler(data);
            self.give(data);
        }
    }
}

impl<T: Send> Default for Owned<T> {
    fn default() -> Self {
        Self::new()
    }
}
