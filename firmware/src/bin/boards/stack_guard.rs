//! Sets up an MPU region without access below the stack, so that a stack overflow faults instead of
//! overwriting what lies there. Called first by the program of every board.
//!
//! The stack is the lowest part of the memory, but what is below is not empty on
//! every board: on the STM32G4 it is option bytes, on the emulator a device that
//! takes every write.
#![allow(unsafe_code)]

use core::ptr;

use cortex_m::asm::{dsb, isb};
use cortex_m::peripheral::MPU;

unsafe extern "C" {
    /// Lowest address of the stack, from memory.x.
    static _stack_end: u8;
}

/// Length of the forbidden region, 2^15 bytes: longer than any frame.
const LOG2_LEN: u32 = 15;

/// Blocks access to the region below the stack from here on, but for `HardFault` and NMI, during
/// which the MPU is off.
pub fn forbid_below_stack() {
    let end = ptr::addr_of!(_stack_end) as u32;
    // SAFETY: nothing of this program is in the region, and everywhere else the
    // default map stays in force.
    unsafe {
        let mpu = &*MPU::PTR;
        mpu.rnr.write(0);
        mpu.rbar.write(end - (1 << LOG2_LEN));
        // Execute never, no access, length, enable.
        mpu.rasr.write(1 << 28 | (LOG2_LEN - 1) << 1 | 1);
        // The default map for everything else; enable.
        mpu.ctrl.write(0b101);
    }
    dsb();
    isb();
}
