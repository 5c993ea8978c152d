//! Ends the emulator with an exit status: success only where the test asked for the end, failure
//! after a panic, a hard fault or an expiry of the watchdog, whose handlers are here.
#![allow(unsafe_code)]

use core::arch::naked_asm;
use core::panic::PanicInfo;

use cortex_m_rt::exception;
use cortex_m_semihosting::debug::{self, EXIT_FAILURE, EXIT_SUCCESS};

pub fn success() -> ! {
    exit(EXIT_SUCCESS)
}

pub fn failure() -> ! {
    exit(EXIT_FAILURE)
}

fn exit(status: debug::ExitStatus) -> ! {
    debug::exit(status);
    // Semihosting is off: nobody to tell.
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    defmt::error!("panic: {}", defmt::Display2Format(info));
    failure()
}

/// A hard fault may be a stack that overflowed: nothing can be pushed, and a
/// fault in here would lock the processor up. It starts over on a whole stack.
#[unsafe(naked)]
#[unsafe(no_mangle)]
extern "C" fn HardFault() -> ! {
    naked_asm!(
        "ldr r0, =_stack_start",
        "msr msp, r0",
        "b {handler}",
        handler = sym hard_fault,
    )
}

extern "C" fn hard_fault() -> ! {
    // SAFETY: nothing else runs any more, and these are reads.
    let scb = unsafe { &*cortex_m::peripheral::SCB::PTR };
    defmt::error!(
        "hard fault: status {=u32:#x}, bus {=u32:#x}, forbidden {=u32:#x}",
        scb.cfsr.read(),
        scb.bfar.read(),
        scb.mmfar.read()
    );
    failure()
}

/// The watchdog's first expiry. A reset would end the emulator with success.
#[exception]
unsafe fn NonMaskableInt() -> ! {
    defmt::error!("watchdog: the main loop or the sample clock stands still");
    failure()
}
