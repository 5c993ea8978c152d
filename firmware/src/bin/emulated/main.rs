//! The application on an emulated Cortex-M4F: `qemu-system-arm -M mps2-an386`.
//!
//! UART0 carries what the sensors see ([`stimulus`](loadtwin_firmware::stimulus)),
//! UART1 is the CAN bus as slcan text, a timer is the sample clock, the log
//! goes to standard output through semihosting. The model image stands in the
//! flash at `MODEL`, a 32-bit length before it.
#![no_std]
#![no_main]

mod cmsdk;
mod exit;

use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use cmsdk::{TIMER0, UART0, UART1, WATCHDOG, irq};
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use cortex_m_rt::{entry, exception};
use defmt_semihosting as _;
use heapless::spsc::{Consumer, Producer, Queue};
use loadtwin_common::frame::Frame;
use loadtwin_common::raw::RawSample;
use loadtwin_firmware::app::{App, MAX_FRAMES};
use loadtwin_firmware::board::Board;
use loadtwin_firmware::counters::Counters;
use loadtwin_firmware::owned::Owned;
use loadtwin_firmware::slcan;
use loadtwin_firmware::stimulus::{self, Stimulus};
use postcard::accumulator::{CobsAccumulator, FeedResult};
use static_cell::StaticCell;

/// Room for frames on their way to the bus.
const OUTBOX: usize = 64;
/// Conversions that may wait for their tick of the sample clock.
const ARRIVED: usize = 16;

static COUNTERS: Counters = Counters::new();
static CONVERTER: Owned<Converter> = Owned::new();
static SENSORS: Owned<Sensors> = Owned::new();
static BUS: Owned<Bus> = Owned::new();
/// Whether the test wants the raw samples on the bus.
static SENDS_RAW: AtomicBool = AtomicBool::new(false);
/// Whether the test has asked for the end.
static ENDED: AtomicBool = AtomicBool::new(false);

/// What the sample clock's interrupt owns.
struct Converter {
    app: &'static mut App<'static>,
    board: Emulated,
}

struct Emulated {
    arrived: Consumer<'static, Stimulus>,
    outbox: Producer<'static, Frame>,
    waits: bool,
}

impl Board for Emulated {
    fn acquire(&mut self) -> Option<RawSample> {
        if self.waits && self.outbox.capacity() - self.outbox.len() < MAX_FRAMES {
            return None;
        }
        let stimulus = self.arrived.dequeue();
        // A full queue had stopped the line: there is room again.
        NVIC::pend(Irq(irq::UART0_RX));
        match stimulus? {
            Stimulus::Sample(raw) => return Some(raw),
            Stimulus::Wait(waits) => self.waits = waits,
            Stimulus::SendRaw(sends) => SENDS_RAW.store(sends, Relaxed),
            Stimulus::End => ENDED.store(true, Relaxed),
        }
        None
    }

    fn queue(&mut self, frame: Frame) -> Result<(), Frame> {
        self.outbox.enqueue(frame)
    }

    fn overrun(&mut self) -> bool {
        TIMER0.expired()
    }

    fn counters(&self) -> &Counters {
        &COUNTERS
    }
}

/// What the interrupt of the sensors' line owns.
struct Sensors {
    frames: CobsAccumulator<{ stimulus::LONGEST }>,
    arrived: Producer<'static, Stimulus>,
}

impl Sensors {
    /// Takes bytes while there is room for what they may say; the line waits.
    fn receive(&mut self) {
        while self.arrived.ready() {
            let Some(byte) = UART0.read() else { return };
            match self.frames.feed(&[byte]) {
                FeedResult::Consumed => {}
                FeedResult::Success { data, .. } => {
                    // There is room: `ready` was asked before this byte.
                    let _ = self.arrived.enqueue(data);
                }
                FeedResult::OverFull(_) | FeedResult::DeserError(_) => {
                    defmt::warn!("the sensors' line said nothing known");
                }
            }
        }
    }
}

/// What the interrupt of the bus owns.
#[derive(Default)]
struct Bus {
    lines: slcan::Decoder,
}

impl Bus {
    fn receive(&mut self) {
        while let Some(byte) = UART1.read() {
            if self.lines.push(byte) == Some(slcan::Line::Malformed) {
                defmt::warn!("the bus said nothing known");
            }
        }
    }
}

#[entry]
fn main() -> ! {
    static ARRIVED_QUEUE: StaticCell<Queue<Stimulus, ARRIVED>> = StaticCell::new();
    static OUTBOX_QUEUE: StaticCell<Queue<Frame, OUTBOX>> = StaticCell::new();
    static APP: StaticCell<App> = StaticCell::new();
    static CONVERTER_CELL: StaticCell<Converter> = StaticCell::new();
    static SENSORS_CELL: StaticCell<Sensors> = StaticCell::new();
    static BUS_CELL: StaticCell<Bus> = StaticCell::new();

    let app = APP.init_with(application);
    let ticks = (cmsdk::CLOCK_HZ as f32 / app.rate_hz()) as u32;
    defmt::info!("a sample every {} ticks", ticks);

    let (arrived_in, arrived_out) = ARRIVED_QUEUE.init(Queue::new()).split();
    let (outbox_in, mut outbox) = OUTBOX_QUEUE.init(Queue::new()).split();
    SENSORS.give(SENSORS_CELL.init(Sensors {
        frames: CobsAccumulator::new(),
        arrived: arrived_in,
    }));
    BUS.give(BUS_CELL.init(Bus::default()));
    let mut board = Emulated {
        arrived: arrived_out,
        outbox: outbox_in,
        waits: true,
    };
    app.announce(&mut board);
    CONVERTER.give(CONVERTER_CELL.init(Converter { app, board }));

    UART0.enable();
    UART1.enable();
    start_interrupts();
    TIMER0.start(ticks);
    // Half a second without a turn of the loop below is a hang.
    WATCHDOG.start(cmsdk::CLOCK_HZ / 2);

    loop {
        while let Some(frame) = outbox.dequeue() {
            for byte in slcan::encode(&frame) {
                // A bus that stands still is no hang of this program.
                while !UART1.idle() {
                    WATCHDOG.feed();
                }
                UART1.write(byte);
            }
        }
        if ENDED.load(Relaxed) && outbox.is_empty() {
            while !UART1.idle() {}
            defmt::info!("ended: {}", defmt::Debug2Format(&COUNTERS));
            exit::success()
        }
        WATCHDOG.feed();
        cortex_m::asm::wfi();
    }
}

/// The application, made where it stays: a copy on the stack would be the
/// deepest that the stack ever gets.
#[inline(never)]
fn application() -> App<'static> {
    match App::try_new(model(), 0) {
        Ok(app) => app,
        Err(error) => {
            defmt::error!("no usable model: {}", defmt::Display2Format(&error));
            App::without_image()
        }
    }
}

/// The image in its place in the flash; an empty one where there is none.
fn model() -> &'static [u8] {
    #![allow(unsafe_code)]
    const MODEL: *const u8 = 0x0030_0000 as *const u8;
    const ROOM: usize = 0x0010_0000;
    // SAFETY: `MODEL` in memory/emulated.x: a megabyte of the flash that
    // nothing else uses and nothing writes.
    let place = unsafe { core::slice::from_raw_parts(MODEL, ROOM) };
    let (length, rest) = place.split_at(4);
    let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]);
    rest.get(..length as usize).unwrap_or_default()
}

#[derive(Clone, Copy)]
struct Irq(u16);

// SAFETY: the number is that of an interrupt of this board, and constant.
#[allow(unsafe_code)]
unsafe impl InterruptNumber for Irq {
    fn number(self) -> u16 {
        self.0
    }
}

/// The sample clock above the sensors' line above the bus above the main loop.
fn start_interrupts() {
    #![allow(unsafe_code)]
    // SAFETY: called once, before any of them can come.
    unsafe {
        let mut nvic = cortex_m::Peripherals::steal().NVIC;
        for (irq, priority) in [
            (irq::TIMER0, 0x20),
            (irq::UART0_RX, 0x40),
            (irq::UART1_RX, 0x80),
        ] {
            nvic.set_priority(Irq(irq), priority);
            NVIC::unmask(Irq(irq));
        }
    }
}

#[exception]
#[allow(unsafe_code)]
unsafe fn DefaultHandler(irqn: i16) {
    match u16::try_from(irqn) {
        Ok(irq::TIMER0) => {
            TIMER0.clear();
            CONVERTER.with(|Converter { app, board }| {
                app.sends_raw = SENDS_RAW.load(Relaxed);
                app.on_data_ready(board);
            });
        }
        Ok(irq::UART0_RX) => {
            UART0.acknowledge();
            SENSORS.with(Sensors::receive);
        }
        Ok(irq::UART1_RX) => {
            UART1.acknowledge();
            BUS.with(Bus::receive);
        }
        _ => {
            defmt::error!("unexpected exception {}", irqn);
            exit::failure()
        }
    }
}
