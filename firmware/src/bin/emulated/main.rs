//! The application on an emulated Cortex-M4F (`qemu-system-arm -M mps2-an386`): board, interrupts
//! and main loop, with samples and frames over two serial lines.
//!
//! UART0 carries the samples of the sensors ([`stimulus`](loadtwin_firmware::stimulus)), or says
//! that they are [`stored`] in memory, UART1 is the CAN bus as slcan text, a timer is the sample clock, the log
//! goes to standard output through semihosting. Models come from the two slots of
//! [`flash`], and from the bus.
#![no_std]
#![no_main]

mod cmsdk;
mod exit;
mod flash;
#[path = "../boards/stack_guard.rs"]
mod stack_guard;
mod stored;

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering::Relaxed};

use cmsdk::{TIMER0, UART0, UART1, WATCHDOG, irq};
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use cortex_m_rt::{entry, exception};
use defmt_semihosting as _;
use heapless::spsc::{Consumer, Producer, Queue};
use loadtwin_common::counting::saved_counts::MAX_BYTES;
use loadtwin_common::counting::{CountSample, MAX_COUNTED};
use loadtwin_common::hardware::EMULATED;
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::raw::RawSample;
use loadtwin_common::io::signed_image::{CRC, OVERHEAD};
use loadtwin_firmware::app::{App, MAX_FRAMES};
use loadtwin_firmware::board::Board;
use loadtwin_firmware::board_counters::Counters;
use loadtwin_firmware::interrupt_owned::Owned;
use loadtwin_firmware::progress_check::Progress;
use loadtwin_firmware::ram_flash::{COUNTS, LAYOUT, PAGE};
use loadtwin_firmware::raw_burst::{RawFrame, RawLink, RawReader, RawWriter};
use loadtwin_firmware::room::Room;
use loadtwin_firmware::running_model::Models;
use loadtwin_firmware::slcan;
use loadtwin_firmware::stimulus::{self, Stimulus};
use loadtwin_firmware::upload::BLOCK_OVERHEAD;
use postcard::accumulator::{CobsAccumulator, FeedResult};
use static_cell::{ConstStaticCell, StaticCell};

/// Room for frames on their way to the bus.
const OUTBOX: usize = 64;
/// Conversions that may wait for their tick of the sample clock.
const ARRIVED: usize = 16;
/// Bytes of raw samples that may wait for the bus.
const RAW_BYTES: usize = 64 * 1024;
/// Samples of counted loads that may wait for the main loop.
const SAMPLES: usize = 1024;
/// Room for frames from the bus.
const INBOX: usize = 32;
/// Longest payload of an image [bytes].
const IMAGE: usize = 64 * 1024;

static COUNTERS: Counters = Counters::new();
static RAW_LINK: RawLink = RawLink::new();
static CONVERTER: Owned<Converter> = Owned::new();
static SENSORS: Owned<Sensors> = Owned::new();
static BUS: Owned<Bus> = Owned::new();
/// Whether the test wants the raw samples on the bus.
static SENDS_RAW: AtomicBool = AtomicBool::new(false);
/// Whether the test has asked for the end.
static ENDED: AtomicBool = AtomicBool::new(false);
/// Whether the test has asked for a new start.
static RESTARTS: AtomicBool = AtomicBool::new(false);
/// Ticks of the sample clock since start that were processed.
static TICKS: AtomicU32 = AtomicU32::new(0);
/// What the status says of the image offered last.
static REFUSED: AtomicU8 = AtomicU8::new(0);

type BoardModels =
    Models<flash::Memory, { PAGE + BLOCK_OVERHEAD }, { IMAGE + OVERHEAD }, MAX_COUNTED>;

/// What the sample clock's interrupt owns.
struct Converter {
    app: &'static mut App<'static>,
    board: Emulated,
}

struct Emulated {
    arrived: Consumer<'static, Stimulus>,
    outbox: Producer<'static, Frame>,
    raw: RawWriter<'static>,
    counted: Producer<'static, CountSample>,
    waits: bool,
}

impl Board for Emulated {
    fn acquire(&mut self) -> Option<RawSample> {
        let is_full = self.outbox.capacity() - self.outbox.len() < MAX_FRAMES;
        if self.waits && (is_full || !self.counted.ready()) {
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
            Stimulus::Restart => RESTARTS.store(true, Relaxed),
            Stimulus::Stop => TIMER0.stop(),
            // Taken where it is received.
            Stimulus::Stored => {}
        }
        None
    }

    fn queue(&mut self, frame: Frame) -> Result<(), Frame> {
        self.outbox.enqueue(frame)
    }

    fn count(&mut self, sample: CountSample) {
        // One that is dropped is a gap in the counts.
        _ = self.counted.enqueue(sample);
    }

    fn overrun(&mut self) -> bool {
        TIMER0.expired()
    }

    fn raw_writer(&mut self) -> Option<&mut RawWriter<'static>> {
        Some(&mut self.raw)
    }

    fn counters(&self) -> &Counters {
        &COUNTERS
    }
}

/// What the interrupt of the sensors' line owns.
struct Sensors {
    frames: CobsAccumulator<{ stimulus::LONGEST }>,
    /// Stored messages that come before the next byte of the line.
    stored: &'static [u8],
    arrived: Producer<'static, Stimulus>,
}

impl Sensors {
    /// Takes bytes while there is room for what they may say; the line waits.
    fn receive(&mut self) {
        while self.arrived.ready() {
            let said = if self.stored.is_empty() {
                let Some(byte) = UART0.read() else { return };
                message(self.frames.feed(&[byte])).0
            } else {
                let (said, rest) = message(self.frames.feed(self.stored));
                self.stored = rest;
                said
            };
            match said {
                Some(Stimulus::Stored) => self.stored = stored::messages(),
                // There is room: `ready` was asked before.
                Some(said) => drop(self.arrived.enqueue(said)),
                None => {}
            }
        }
    }
}

/// The message that bytes ended, and the bytes behind it.
fn message(fed: FeedResult<'_, Stimulus>) -> (Option<Stimulus>, &[u8]) {
    match fed {
        FeedResult::Consumed => (None, &[]),
        FeedResult::Success { data, remaining } => (Some(data), remaining),
        FeedResult::OverFull(rest) | FeedResult::DeserError(rest) => {
            defmt::warn!("the sensors' line said nothing known");
            (None, rest)
        }
    }
}

/// What the interrupt of the bus owns.
struct Bus {
    lines: slcan::Decoder,
    inbox: Producer<'static, Frame>,
}

impl Bus {
    fn receive(&mut self) {
        while let Some(byte) = UART1.read() {
            match self.lines.push(byte) {
                // A full inbox drops a frame of an upload, which then fails by its own checks.
                Some(slcan::Line::Frame(frame)) => drop(self.inbox.enqueue(frame)),
                Some(slcan::Line::Malformed) => defmt::warn!("the bus said nothing known"),
                Some(slcan::Line::Other) | None => {}
            }
        }
    }
}

#[entry]
fn main() -> ! {
    static ARRIVED_QUEUE: StaticCell<Queue<Stimulus, ARRIVED>> = StaticCell::new();
    static OUTBOX_QUEUE: StaticCell<Queue<Frame, OUTBOX>> = StaticCell::new();
    static RAW_QUEUE: ConstStaticCell<Queue<u8, RAW_BYTES>> = ConstStaticCell::new(Queue::new());
    static INBOX_QUEUE: StaticCell<Queue<Frame, INBOX>> = StaticCell::new();
    static RUNNING: ConstStaticCell<[u8; IMAGE]> = ConstStaticCell::new([0; IMAGE]);
    static COUNTED_QUEUE: StaticCell<Queue<CountSample, SAMPLES>> = StaticCell::new();
    static ROOM: ConstStaticCell<Room<{ IMAGE + OVERHEAD }, MAX_COUNTED>> =
        ConstStaticCell::new(Room::new());
    static MODELS: StaticCell<BoardModels> = StaticCell::new();
    static APP: ConstStaticCell<App> = ConstStaticCell::new(App::without_image());
    static CONVERTER_CELL: StaticCell<Converter> = StaticCell::new();
    static SENSORS_CELL: StaticCell<Sensors> = StaticCell::new();
    static BUS_CELL: StaticCell<Bus> = StaticCell::new();

    stack_guard::forbid_below_stack();
    let mut flash = flash::powered();
    let identity = flash::identity(&mut flash);
    let models = MODELS.init_with(|| {
        BoardModels::boot(flash, (LAYOUT, COUNTS), (identity, EMULATED), ROOM.take())
            .expect("the layout is constant and fits the flash")
    });
    let app = APP.take();
    models.start(app, RUNNING.take());
    if app.refused() != 0 {
        defmt::error!("the newest model is refused: {=u8:#x}", app.refused());
    }
    REFUSED.store(app.refused(), Relaxed);
    let ticks = (cmsdk::CLOCK_HZ as f32 / app.rate_hz()) as u32;
    defmt::info!("a sample every {} ticks", ticks);

    let (arrived_in, arrived_out) = ARRIVED_QUEUE.init(Queue::new()).split();
    let (outbox_in, mut outbox) = OUTBOX_QUEUE.init(Queue::new()).split();
    let (inbox_in, mut inbox) = INBOX_QUEUE.init(Queue::new()).split();
    SENSORS.give(SENSORS_CELL.init(Sensors {
        frames: CobsAccumulator::new(),
        stored: &[],
        arrived: arrived_in,
    }));
    BUS.give(BUS_CELL.init(Bus {
        lines: slcan::Decoder::default(),
        inbox: inbox_in,
    }));
    let (counted_in, mut counted) = COUNTED_QUEUE.init(Queue::new()).split();
    let (raw_in, raw_out) = RAW_QUEUE.take().split();
    let mut raw = RawReader::new(&RAW_LINK, raw_out, app.base());
    let mut board = Emulated {
        arrived: arrived_out,
        outbox: outbox_in,
        raw: RawWriter::new(&RAW_LINK, raw_in),
        counted: counted_in,
        waits: true,
    };
    app.announce(&mut board);
    CONVERTER.give(CONVERTER_CELL.init(Converter { app, board }));

    UART0.enable();
    UART1.enable();
    start_interrupts();
    TIMER0.start(ticks);
    // Half a second without a tick processed and a turn of the loop below is a hang.
    WATCHDOG.start(cmsdk::CLOCK_HZ / 2);
    let mut progress = Progress::default();

    loop {
        while let Some(frame) = outbox.dequeue() {
            send(&frame, &mut progress);
        }
        let now_us = (TICKS.load(Relaxed)).wrapping_mul(ticks / (cmsdk::CLOCK_HZ / 1_000_000));
        // This bus carries classic frames only.
        while let Some(RawFrame::Classic(frame)) = raw.next(now_us) {
            send(&frame, &mut progress);
        }
        while let Some(frame) = inbox.dequeue() {
            if let Some(reply) = models.on_frame(&frame, now_us) {
                send(&reply, &mut progress);
            }
        }
        while let Some(sample) = counted.dequeue() {
            models.count(&sample);
        }
        let turn = models.poll(now_us);
        if let Some(reply) = turn.reply {
            send(&reply, &mut progress);
        }
        if let Some(refused) = turn.refused {
            REFUSED.store(refused, Relaxed);
        }
        if let Some(burst) = turn.burst {
            // The sample clock lets its ticks pass meanwhile; conversions wait for it.
            CONVERTER.with(|Converter { app, board }| app.begin_burst(burst, board));
        }
        if outbox.is_empty() && raw.is_empty() && !counted.ready() {
            if ENDED.load(Relaxed) {
                while !UART1.idle() {}
                print_counts(models);
                defmt::info!("ended: {}", defmt::Debug2Format(&COUNTERS));
                exit::success()
            }
            if RESTARTS.load(Relaxed) {
                while !UART1.idle() {}
                cortex_m::peripheral::SCB::sys_reset()
            }
        }
        feed(&mut progress);
        cortex_m::asm::wfi();
    }
}

/// Prints the CRC of the counts of each load; called once, at the end.
fn print_counts(models: &mut BoardModels) {
    static BYTES: ConstStaticCell<[u8; MAX_BYTES]> = ConstStaticCell::new([0; MAX_BYTES]);
    let bytes = BYTES.take();
    for (load, counts) in models.counted().iter_mut().enumerate() {
        let saved = counts.save(bytes).ok().and_then(|len| bytes.get(..len));
        let crc = saved.map_or(0, |saved| CRC.checksum(saved));
        defmt::println!("counts of load {}: {:08x}", load, crc);
    }
}

/// Puts a frame on the bus.
fn send(frame: &Frame, progress: &mut Progress) {
    for byte in slcan::encode(frame) {
        // A bus that stands still is no hang of this program.
        while !UART1.idle() {
            feed(progress);
        }
        UART1.write(byte);
    }
}

/// Feeds the watchdog where a tick was processed since the last time.
fn feed(progress: &mut Progress) {
    if progress.goes_on(TICKS.load(Relaxed)) {
        WATCHDOG.feed();
    }
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
                app.set_refused(REFUSED.load(Relaxed));
                app.on_data_ready(board);
            });
            TICKS.fetch_add(1, Relaxed);
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
