//! Checks the pointers of a C caller (not null, aligned, possible length) and gives the input
//! arrays, output arrays, single values and UTF-8 texts at them as Rust references.

use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;

use crate::refusal::Refusal;

/// Refuses two lengths that differ.
pub(super) fn same_length(allowed: usize, found: usize) -> Result<(), Refusal> {
    if allowed == found {
        return Ok(());
    }
    Err(Refusal::Count {
        what: "number of values",
        found,
        allowed,
    })
}

fn check<T>(pointer: *const T, n: usize, what: &'static str) -> Result<(), Refusal> {
    let longest = isize::MAX as usize / size_of::<T>().max(1);
    if pointer.is_null() || !pointer.is_aligned() || n > longest {
        return Err(Refusal::Pointer(what));
    }
    Ok(())
}

/// `n` values to read.
///
/// # Safety
/// `pointer` is null, or points at `n` values that nothing changes during the call.
pub(super) unsafe fn input<'a, T>(
    pointer: *const T,
    n: usize,
    what: &'static str,
) -> Result<&'a [T], Refusal> {
    if n == 0 {
        return Ok(&[]);
    }
    check(pointer, n, what)?;
    // SAFETY: not null, aligned, of a possible length; `n` values by the caller.
    Ok(unsafe { std::slice::from_raw_parts(pointer, n) })
}

/// Place for `n` values.
///
/// # Safety
/// `pointer` is null, or points at place for `n` values that nothing else uses during the call.
pub(super) unsafe fn output<'a, T>(
    pointer: *mut T,
    n: usize,
    what: &'static str,
) -> Result<&'a mut [MaybeUninit<T>], Refusal> {
    if n == 0 {
        return Ok(&mut []);
    }
    check(pointer, n, what)?;
    // SAFETY: not null, aligned, of a possible length; place by the caller; it may hold nothing yet.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer.cast(), n) })
}

/// One value to read and write.
///
/// # Safety
/// `pointer` is null, or points at a value that nothing else uses during the call.
pub(super) unsafe fn one<'a, T>(pointer: *mut T, what: &'static str) -> Result<&'a mut T, Refusal> {
    check(pointer, 1, what)?;
    // SAFETY: not null, aligned; a value by the caller.
    Ok(unsafe { &mut *pointer })
}

/// Writes one value.
///
/// # Safety
/// `pointer` is null, or points at place for a value that nothing else uses during the call.
pub(super) unsafe fn write<T>(
    pointer: *mut T,
    value: T,
    what: &'static str,
) -> Result<(), Refusal> {
    check(pointer, 1, what)?;
    // SAFETY: not null, aligned; place by the caller.
    unsafe { pointer.write(value) };
    Ok(())
}

/// A text.
///
/// # Safety
/// `pointer` is null, or points at characters up to a 0 that nothing changes during the call.
pub(super) unsafe fn text<'a>(
    pointer: *const c_char,
    what: &'static str,
) -> Result<&'a str, Refusal> {
    if pointer.is_null() {
        return Err(Refusal::Pointer(what));
    }
    // SAFETY: not null; characters up to a 0 by the caller.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| Refusal::Text(what))
}
