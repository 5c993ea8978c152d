//! Stops in a hard fault at a panic, logs its place, file and line, and waits for the watchdog,
//! which starts the board over.
//!
//! Nothing formats the message: `core::fmt` would take 11 kB of flash. The handler of panics only
//! keeps the place, so that the optimiser sees through it and drops what the messages are made of.
#![allow(unsafe_code)]

use core::panic::{Location, PanicInfo};
use core::ptr;
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};

use cortex_m_rt::{ExceptionFrame, exception};

/// Place of the panic, which is in the constants of the program.
static PLACE: AtomicPtr<Location<'static>> = AtomicPtr::new(ptr::null_mut());

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    if let Some(place) = info.location() {
        PLACE.store(ptr::from_ref(place).cast_mut().cast(), Relaxed);
    }
    cortex_m::asm::udf()
}

/// A panic of `defmt`, which has logged its message.
#[defmt::panic_handler]
fn logged_panic() -> ! {
    cortex_m::asm::udf()
}

#[exception]
unsafe fn HardFault(_: &ExceptionFrame) -> ! {
    cortex_m::interrupt::disable();
    // SAFETY: null, or what the compiler made for the call that panicked; it is in flash.
    if let Some(place) = unsafe { PLACE.load(Relaxed).as_ref() } {
        defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
    } else {
        defmt::error!("hard fault");
    }
    loop {
        cortex_m::asm::nop();
    }
}
