//! Drives the peripherals of the emulated board (mps2-an386) through their registers: Arm's CMSDK
//! UART, timer and watchdog.
//!
//! Source: Arm, Cortex-M System Design Kit, Technical Reference Manual (DDI 0479).
#![allow(unsafe_code)]

use core::ptr;

/// Clock of the peripherals [Hz].
pub const CLOCK_HZ: u32 = 25_000_000;

/// Interrupt numbers.
pub mod irq {
    pub const UART0_RX: u16 = 0;
    pub const UART1_RX: u16 = 2;
    pub const TIMER0: u16 = 8;
}

/// A block of registers.
#[derive(Clone, Copy)]
struct Block(usize);

impl Block {
    fn read(self, offset: usize) -> u32 {
        // SAFETY: every block below names a peripheral that this board always
        // has, and offsets are those of its 32-bit registers.
        unsafe { ptr::read_volatile((self.0 + offset) as *const u32) }
    }

    fn write(self, offset: usize, value: u32) {
        // SAFETY: as in `read`; no register of these changes memory.
        unsafe { ptr::write_volatile((self.0 + offset) as *mut u32, value) }
    }
}

/// A serial line.
#[derive(Clone, Copy)]
pub struct Uart(Block);

pub const UART0: Uart = Uart(Block(0x4000_4000));
pub const UART1: Uart = Uart(Block(0x4000_5000));

impl Uart {
    const DATA: usize = 0x0;
    const STATE: usize = 0x4;
    const CTRL: usize = 0x8;
    const INT: usize = 0xC;
    const BAUDDIV: usize = 0x10;

    /// Both directions, with an interrupt for each byte received.
    pub fn enable(self) {
        self.0.write(Self::BAUDDIV, 16);
        self.0.write(Self::CTRL, 0b1011);
    }

    /// Takes the interrupt back; the handler reads, or is pended again later.
    pub fn acknowledge(self) {
        self.0.write(Self::INT, 0b10);
    }

    /// The byte received, where there is one.
    pub fn read(self) -> Option<u8> {
        (self.0.read(Self::STATE) & 0b10 != 0).then(|| self.0.read(Self::DATA) as u8)
    }

    /// Sends one byte; it is lost where the line is not [`Self::idle`].
    pub fn write(self, byte: u8) {
        self.0.write(Self::DATA, u32::from(byte));
    }

    /// Whether all was sent, and there is room for a byte.
    pub fn idle(self) -> bool {
        self.0.read(Self::STATE) & 0b01 == 0
    }
}

/// A timer that counts down and starts over.
pub struct Timer(Block);

pub const TIMER0: Timer = Timer(Block(0x4000_0000));

impl Timer {
    const CTRL: usize = 0x0;
    const VALUE: usize = 0x4;
    const RELOAD: usize = 0x8;
    const INT: usize = 0xC;

    /// An interrupt every `ticks` of the clock.
    pub fn start(&self, ticks: u32) {
        self.0.write(Self::RELOAD, ticks - 1);
        self.0.write(Self::VALUE, ticks - 1);
        self.0.write(Self::CTRL, 0b1001);
    }

    pub fn stop(&self) {
        self.0.write(Self::CTRL, 0);
    }

    pub fn clear(&self) {
        self.0.write(Self::INT, 1);
    }

    /// Whether it has expired since [`Self::clear`].
    pub fn expired(&self) -> bool {
        self.0.read(Self::INT) & 1 != 0
    }
}

/// The watchdog: its first expiry is an NMI, its second a reset.
pub struct Watchdog(Block);

pub const WATCHDOG: Watchdog = Watchdog(Block(0x4000_8000));

impl Watchdog {
    const LOAD: usize = 0x0;
    const CONTROL: usize = 0x8;
    const INTCLR: usize = 0xC;
    const LOCK: usize = 0xC00;

    pub fn start(&self, ticks: u32) {
        self.0.write(Self::LOCK, 0x1ACC_E551);
        self.0.write(Self::LOAD, ticks);
        self.0.write(Self::CONTROL, 0b11);
    }

    pub fn feed(&self) {
        self.0.write(Self::INTCLR, 1);
    }
}
