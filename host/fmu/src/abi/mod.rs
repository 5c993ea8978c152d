//! C interfaces of FMI 3.0 and 2.0 over [`Instance`], the only part of the crate with `unsafe`.
//! Here is what both versions share: make and free an instance behind a C pointer, get and set
//! values by value reference, and turn a refusal into a log message and the status `ERROR`.
//!
//! No panic leaves a function. Null and misaligned pointers are refused; that others point at what
//! the standard says, and that an instance is used by one thread at a time, is up to the caller.
#![allow(unsafe_code, reason = "a C interface; each block says why it is sound")]

mod fmi2;
mod fmi3;
mod memory;
mod native;
mod state;
mod unsupported;

use std::ffi::{c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

use self::native::{Array, Native};
use crate::instance::{Instance, Value};
use crate::refusal::Refusal;

/// Says which library this is, for the command that packs it.
#[used]
#[unsafe(no_mangle)]
static LOADTWIN_FMU: [u8; crate::library::MARK.len()] = {
    let mut bytes = [0; crate::library::MARK.len()];
    bytes.copy_from_slice(crate::library::MARK.as_bytes());
    bytes
};

/// `fmi3Status`, `fmi2Status`.
type Status = c_int;

/// The call did what it was asked for.
const OK: Status = 0;

/// The call is refused or has failed, and a message says why.
const ERROR: Status = 3;

/// A message to the environment.
type Log = Box<dyn Fn(&str)>;

/// What `fmi3Instance` and `fmi2Component` point at.
struct Handle {
    instance: Instance,
    log: Log,
}

/// Makes an instance; null where it is refused, with a message.
fn instantiate(log: Log, make: impl FnOnce() -> Result<Instance, Refusal>) -> *mut c_void {
    let made = catch_unwind(AssertUnwindSafe(make));
    match made.unwrap_or(Err(Refusal::Panic("instantiate"))) {
        Ok(instance) => Box::into_raw(Box::new(Handle { instance, log })).cast(),
        Err(refusal) => {
            log(&refusal.to_string());
            std::ptr::null_mut()
        }
    }
}

/// Frees an instance that [`instantiate`] made; null is none.
///
/// # Safety
/// The instance is not used afterwards.
unsafe fn free(instance: *mut c_void) {
    if !instance.is_null() {
        // SAFETY: of `instantiate`, and the last use, by the caller.
        let handle = unsafe { Box::from_raw(instance.cast::<Handle>()) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(handle)));
    }
}

/// Runs a call on an instance; a refusal becomes a message and `ERROR`.
///
/// # Safety
/// `instance` is null or of [`instantiate`], and no other call uses it.
unsafe fn call(
    instance: *mut c_void,
    name: &'static str,
    run: impl FnOnce(&mut Instance) -> Result<(), Refusal>,
) -> Status {
    // SAFETY: of `instantiate`, and used by this call alone, by the caller.
    let Some(handle) = (unsafe { instance.cast::<Handle>().as_mut() }) else {
        return ERROR;
    };
    let done = catch_unwind(AssertUnwindSafe(|| run(&mut handle.instance)));
    let refusal = match done {
        Ok(Ok(())) => return OK,
        Ok(Err(refusal)) => refusal,
        Err(_) => {
            handle.instance.abandon();
            Refusal::Panic(name)
        }
    };
    let message = format!("{name}: {refusal}");
    let _ = catch_unwind(AssertUnwindSafe(|| (handle.log)(&message)));
    ERROR
}

/// Gets values.
///
/// # Safety
/// As [`call`]; the arrays are null or as long as they say.
unsafe fn get<T: Native>(
    instance: *mut c_void,
    name: &'static str,
    references: Array<*const u32>,
    values: Array<*mut T>,
) -> Status {
    let run = |instance: &mut Instance| {
        memory::same_length(references.1, values.1)?;
        // SAFETY: as long as they say, by the caller.
        let references = unsafe { memory::input(references.0, references.1, "valueReferences")? };
        // SAFETY: the same.
        let values = unsafe { memory::output(values.0, values.1, "values")? };
        for (reference, slot) in references.iter().zip(values) {
            if let Some(value) = T::of(instance.get(*reference, T::OF)?) {
                slot.write(value);
            }
        }
        Ok(())
    };
    // SAFETY: by the caller.
    unsafe { call(instance, name, run) }
}

/// Sets values.
///
/// # Safety
/// As [`get`].
unsafe fn set<T: Native>(
    instance: *mut c_void,
    name: &'static str,
    references: Array<*const u32>,
    values: Array<*const T>,
) -> Status {
    let run = |instance: &mut Instance| {
        memory::same_length(references.1, values.1)?;
        // SAFETY: as long as they say, by the caller.
        let references = unsafe { memory::input(references.0, references.1, "valueReferences")? };
        // SAFETY: the same.
        let values = unsafe { memory::input(values.0, values.1, "values")? };
        let values = values.iter().map(|value| value.value());
        let pairs: Vec<(u32, Value)> = references.iter().copied().zip(values).collect();
        instance.set(&pairs)
    };
    // SAFETY: by the caller.
    unsafe { call(instance, name, run) }
}
