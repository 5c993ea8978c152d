//! C functions for the states of FMU instances: save, restore, free, and conversion to and from
//! bytes.

use std::ffi::c_void;

use super::native::Array;
use super::{Status, call, memory};
use crate::instance::Instance;
use crate::refusal::Refusal;

/// Saves the state: in a new one where `*state` is null, else in that one.
///
/// # Safety
/// As [`call`]; `state` is null or points at null or a state of this function.
pub(super) unsafe fn save(
    instance: *mut c_void,
    name: &'static str,
    state: *mut *mut c_void,
) -> Status {
    let run = |instance: &mut Instance| {
        // SAFETY: null or a pointer, by the caller.
        let slot = unsafe { memory::one(state, "FMUState")? };
        let bytes = instance.save()?;
        // SAFETY: null or of this function, by the caller.
        match unsafe { slot.cast::<Vec<u8>>().as_mut() } {
            Some(state) => *state = bytes,
            None => *slot = Box::into_raw(Box::new(bytes)).cast(),
        }
        Ok(())
    };
    // SAFETY: by the caller.
    unsafe { call(instance, name, run) }
}

/// Bytes of a state.
///
/// # Safety
/// `state` is null or of [`save`] or [`deserialise`].
unsafe fn saved<'a>(state: *mut c_void) -> Result<&'a Vec<u8>, Refusal> {
    // SAFETY: null or a state, by the caller.
    unsafe { state.cast::<Vec<u8>>().as_ref() }.ok_or(Refusal::Pointer("FMUState"))
}

/// Goes on from a state.
///
/// # Safety
/// As [`call`] and [`saved`].
pub(super) unsafe fn restore(
    instance: *mut c_void,
    name: &'static str,
    state: *mut c_void,
) -> Status {
    // SAFETY: by the caller.
    let run = |instance: &mut Instance| instance.restore(unsafe { saved(state)? });
    // SAFETY: by the caller.
    unsafe { call(instance, name, run) }
}

/// Frees a state and makes its pointer null.
///
/// # Safety
/// As [`save`].
pub(super) unsafe fn free_state(
    instance: *mut c_void,
    name: &'static str,
    state: *mut *mut c_void,
) -> Status {
    let run = |_: &mut Instance| {
        // SAFETY: null or a pointer, by the caller.
        let Some(slot) = (unsafe { state.as_mut() }) else {
            return Ok(());
        };
        let state = std::mem::replace(slot, std::ptr::null_mut());
        if !state.is_null() {
            // SAFETY: of `save` or `deserialise`, and now unreachable, by the caller.
            drop(unsafe { Box::from_raw(state.cast::<Vec<u8>>()) });
        }
        Ok(())
    };
    // SAFETY: by the caller.
    unsafe { call(instance, name, run) }
}

/// Length of a state.
///
/// # Safety
/// As [`restore`]; `size` is null or points at a size.
pub(super) unsafe fn state_size(
    instance: *mut c_void,
    name: &'static str,
    state: *mut c_void,
    size: *mut usize,
) -> Status {
    // SAFETY: by the caller, both.
    let run = |_: &mut Instance| unsafe { memory::write(size, saved(state)?.len(), "size") };
    // SAFETY: by the caller.
    unsafe { call(instance, name, run) }
}

/// Writes a state to bytes.
///
/// # Safety
/// As [`restore`]; `bytes` is null or as long as it says.
pub(super) unsafe fn serialise(
    instance: *mut c_void,
    name: &'static str,
    state: *mut c_void,
    bytes: Array<*mut u8>,
) -> Status {
    let run = |_: &mut Instance| {
        // SAFETY: by the caller.
        let state = unsafe { saved(state)? };
        memory::same_length(state.len(), bytes.1)?;
        // SAFETY: as long as it says, by the caller.
        let bytes = unsafe { memory::output(bytes.0, bytes.1, "serializedState")? };
        for (slot, byte) in bytes.iter_mut().zip(state) {
            slot.write(*byte);
        }
        Ok(())
    };
    // SAFETY: by the caller.
    unsafe { call(instance, name, run) }
}

/// Reads a state from bytes, which are checked.
///
/// # Safety
/// As [`save`]; `bytes` is null or as long as it says.
pub(super) unsafe fn deserialise(
    instance: *mut c_void,
    name: &'static str,
    bytes: Array<*const u8>,
    state: *mut *mut c_void,
) -> Status {
    let run = |_: &mut Instance| {
        // SAFETY: as long as it says, by the caller.
        let bytes = unsafe { memory::input(bytes.0, bytes.1, "serializedState")? };
        // SAFETY: null or a pointer, by the caller.
        let slot = unsafe { memory::one(state, "FMUState")? };
        crate::saved_state::State::from_bytes(bytes)?;
        // SAFETY: null or a state, by the caller.
        match unsafe { slot.cast::<Vec<u8>>().as_mut() } {
            Some(state) => *state = bytes.to_vec(),
            None => *slot = Box::into_raw(Box::new(bytes.to_vec())).cast(),
        }
        Ok(())
    };
    // SAFETY: by the caller.
    unsafe { call(instance, name, run) }
}

/// The functions of states under the names of a version of FMI: save, restore, free, size, serialise and
/// deserialise.
macro_rules! state_functions {
    ($save:ident $restore:ident $free:ident $size:ident $serialise:ident $deserialise:ident) => {
        /// Saves the state.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $save(instance: *mut c_void, state: *mut *mut c_void) -> Status {
            // SAFETY: an instance and a state or null, by the standard.
            unsafe { state::save(instance, stringify!($save), state) }
        }

        /// Goes on from a state.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $restore(instance: *mut c_void, state: *mut c_void) -> Status {
            // SAFETY: an instance and a state, by the standard.
            unsafe { state::restore(instance, stringify!($restore), state) }
        }

        /// Frees a state.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $free(instance: *mut c_void, state: *mut *mut c_void) -> Status {
            // SAFETY: an instance and a state or null, by the standard.
            unsafe { state::free_state(instance, stringify!($free), state) }
        }

        /// Length of a state as bytes.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $size(
            instance: *mut c_void,
            state: *mut c_void,
            size: *mut usize,
        ) -> Status {
            // SAFETY: an instance, a state and a size, by the standard.
            unsafe { state::state_size(instance, stringify!($size), state, size) }
        }

        /// A state as bytes.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $serialise(
            instance: *mut c_void,
            state: *mut c_void,
            bytes: *mut u8,
            size: usize,
        ) -> Status {
            let bytes = Array(bytes, size);
            // SAFETY: an instance, a state and place of that length, by the standard.
            unsafe { state::serialise(instance, stringify!($serialise), state, bytes) }
        }

        /// A state from bytes.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $deserialise(
            instance: *mut c_void,
            bytes: *const u8,
            size: usize,
            state: *mut *mut c_void,
        ) -> Status {
            let bytes = Array(bytes, size);
            // SAFETY: an instance, bytes of that length and a state or null, by the standard.
            unsafe { state::deserialise(instance, stringify!($deserialise), bytes, state) }
        }
    };
}

pub(super) use state_functions;
