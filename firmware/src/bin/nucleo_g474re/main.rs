//! The application on a NUCLEO-G474RE with an ADS131M04 and an encoder: board, clocks, interrupts,
//! CAN, tasks of upload and watchdog.
//!
//! | signal            | pin  | connector |
//! |-------------------|------|-----------|
//! | SPI clock         | PA5  | D13       |
//! | SPI to controller | PA6  | D12       |
//! | SPI to converter  | PA7  | D11       |
//! | SPI chip select   | PB6  | D10       |
//! | data ready        | PC7  | D9        |
//! | encoder A         | PB4  | D5        |
//! | encoder B         | PB5  | D4        |
//! | index pulse       | PB10 | D6        |
//! | CAN receive       | PA11 | CN10-14   |
//! | CAN transmit      | PA12 | CN10-12   |
//!
//! Interrupts, highest first: the index pulse, which latches the encoder's
//! count; data-ready, which runs the estimator; then CAN and the time base; then the
//! tasks that send, receive and feed the watchdog. The thread takes new models: neither the
//! check of a signature nor an erase delays a frame or the watchdog.
#![no_std]
#![no_main]

mod clocks;
mod flash;
mod panic;
#[path = "../boards/stack_guard.rs"]
mod stack_guard;

use core::sync::atomic::{AtomicU8, AtomicU32, Ordering::Relaxed};

use cortex_m::peripheral::NVIC;
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_stm32::can::enums::BusErrorMode;
use embassy_stm32::can::{self, CanConfigurator, CanRx, CanTx, Properties};
use embassy_stm32::exti::{ExtiInput, TriggerEdge};
use embassy_stm32::gpio::{Level, Output, Pull, Speed};
use embassy_stm32::interrupt::{InterruptExt as _, Priority};
use embassy_stm32::mode::Blocking;
use embassy_stm32::peripherals::{FDCAN1, IWDG, TIM3};
use embassy_stm32::spi::{self, Spi, mode::Master};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::qei::{self, Qei};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{bind_interrupts, interrupt, pac};
use embassy_time::{Delay, Instant, Timer};
use embedded_hal_bus::spi::{ExclusiveDevice, NoDelay};
use heapless::spsc::{Consumer, Producer, Queue};
use loadtwin_common::counting::CountSample;
use loadtwin_common::hardware::NUCLEO_G474RE;
use loadtwin_common::io::frame::{FdFrame, Frame};
use loadtwin_common::io::raw::RawSample;
use loadtwin_common::io::signed_image::OVERHEAD;
use loadtwin_firmware::app::App;
use loadtwin_firmware::board::Board;
use loadtwin_firmware::board_counters::{BusState, Counters};
use loadtwin_firmware::driver::ads131m04::{Ads131m04, Config, Error};
use loadtwin_firmware::interrupt_owned::Owned;
use loadtwin_firmware::progress_check::Progress;
use loadtwin_firmware::raw_burst::{Burst, RawFrame, RawLink, RawReader, RawWriter};
use loadtwin_firmware::room::Room;
use loadtwin_firmware::running_model::Models;
use loadtwin_firmware::upload::BLOCK_OVERHEAD;
use static_cell::{ConstStaticCell, StaticCell};

/// Clock input of the converter (Hz); its rates are those of [`NUCLEO_G474RE`].
const CONVERTER_CLOCK_HZ: f32 = 8.192e6;

/// Time without progress after which the watchdog restarts the board [us].
const WATCHDOG_US: u32 = 500_000;
/// Turn of the thread's slow work; a converter silent for that long is reported.
const TURN_MS: u64 = 20;
/// Longest payload of an image [bytes].
const IMAGE: usize = 24 * 1024;

/// Frames that may wait for the bus.
const OUTBOX: usize = 64;

/// Bytes of raw samples that may wait for the bus: with four words and a counter, 325 samples.
const RAW_BYTES: usize = 7 * 1024;

/// Samples of counted loads that may wait for the thread, one less: at 2 kHz as long as the
/// erase of a page takes, 24.5 ms (DS12288 table 54), and some.
const COUNTED: usize = 64;

/// Frames from the bus that may wait.
const INBOX: usize = 32;
/// Set in `LATCHED` above the 16 bits of the count.
const CAME: u32 = 1 << 31;

static COUNTERS: Counters = Counters::new();
static RAW_LINK: RawLink = RawLink::new();
static SAMPLER: Owned<Sampler> = Owned::new();
/// Count at the index pulse since the last sample, with `CAME`.
static LATCHED: AtomicU32 = AtomicU32::new(0);
/// Samples taken; the thread looks whether the converter is silent.
static SAMPLES: AtomicU32 = AtomicU32::new(0);
/// What the status says of the image offered last.
static REFUSED: AtomicU8 = AtomicU8::new(0);

/// Runs the tasks of the bus and the watchdog above the thread.
static ABOVE_THREAD: InterruptExecutor = InterruptExecutor::new();

bind_interrupts!(struct Irqs {
    FDCAN1_IT0 => can::IT0InterruptHandler<FDCAN1>;
    FDCAN1_IT1 => can::IT1InterruptHandler<FDCAN1>;
});

type Bus = ExclusiveDevice<Spi<'static, Blocking, Master>, Output<'static>, NoDelay>;
type BoardModels = Models<
    flash::Checked,
    { flash::PAGE + BLOCK_OVERHEAD },
    { IMAGE + OVERHEAD },
    { NUCLEO_G474RE.counted_loads },
>;

/// What the interrupt of data-ready owns.
struct Sampler {
    app: &'static mut App<'static>,
    board: Nucleo,
}

struct Nucleo {
    converter: Ads131m04<Bus>,
    config: Config,
    ready: ExtiInput<'static, Blocking>,
    outbox: Producer<'static, Frame>,
    raw: RawWriter<'static>,
    counted: Producer<'static, CountSample>,
    tick: u32,
}

/// The encoder's counter; a read, allowed at every priority.
fn encoder() -> u16 {
    pac::TIM3.cnt().read().cnt()
}

impl Board for Nucleo {
    fn acquire(&mut self) -> Option<RawSample> {
        let mut sample = RawSample {
            tick: self.tick,
            ..RawSample::default()
        };
        sample.set_encoder(0, u32::from(encoder()));
        let latched = LATCHED.swap(0, Relaxed);
        sample.index = (latched & CAME != 0).then_some(latched & 0xFFFF);
        self.tick = self.tick.wrapping_add(1);
        // A damaged frame leaves its channels marked as not delivered.
        if let Err(Error::Restarted) = self.converter.read_into(&mut sample, 0) {
            defmt::warn!("the converter restarted");
            if self.converter.configure(self.config, &mut Delay).is_err() {
                defmt::error!("the converter does not take its configuration");
            }
        }
        Some(sample)
    }

    fn queue(&mut self, frame: Frame) -> Result<(), Frame> {
        self.outbox.enqueue(frame)
    }

    fn count(&mut self, sample: CountSample) {
        // One that is dropped is a gap in the counts.
        _ = self.counted.enqueue(sample);
    }

    fn overrun(&mut self) -> bool {
        self.ready.is_pending()
    }

    fn raw_writer(&mut self) -> Option<&mut RawWriter<'static>> {
        Some(&mut self.raw)
    }

    fn counters(&self) -> &Counters {
        &COUNTERS
    }
}

#[interrupt]
fn EXTI15_10() {
    LATCHED.store(CAME | u32::from(encoder()), Relaxed);
    // Write 1 to clear: the line of PB10.
    pac::EXTI.pr(0).write(|lines| lines.set_line(10, true));
}

#[interrupt]
fn EXTI9_5() {
    SAMPLER.with(|Sampler { app, board }| {
        app.set_refused(REFUSED.load(Relaxed));
        if board.ready.is_pending() {
            board.ready.clear_pending();
            app.on_data_ready(board);
            SAMPLES.fetch_add(1, Relaxed);
        } else {
            // The thread asked: the converter is silent.
            app.announce(board);
        }
    });
}

#[embassy_executor::main]
async fn main(thread: Spawner) {
    static OUTBOX_QUEUE: StaticCell<Queue<Frame, OUTBOX>> = StaticCell::new();
    static RAW_QUEUE: ConstStaticCell<Queue<u8, RAW_BYTES>> = ConstStaticCell::new(Queue::new());
    static INBOX_QUEUE: StaticCell<Queue<Frame, INBOX>> = StaticCell::new();
    static REPLIES_QUEUE: StaticCell<Queue<Frame, INBOX>> = StaticCell::new();
    static RUNNING: ConstStaticCell<[u8; IMAGE]> = ConstStaticCell::new([0; IMAGE]);
    static COUNTED_QUEUE: StaticCell<Queue<CountSample, COUNTED>> = StaticCell::new();
    static ROOM: ConstStaticCell<Room<{ IMAGE + OVERHEAD }, { NUCLEO_G474RE.counted_loads }>> =
        ConstStaticCell::new(Room::new());
    static SAMPLER_CELL: StaticCell<Sampler> = StaticCell::new();
    static MODELS: StaticCell<BoardModels> = StaticCell::new();

    stack_guard::forbid_below_stack();
    let p = embassy_stm32::init(clocks::clocks());
    let mut watchdog = IndependentWatchdog::new(p.IWDG, WATCHDOG_US);
    watchdog.unleash();

    let mut flash = flash::Checked::new(p.FLASH);
    let identity = flash::identity(&mut flash);
    if identity.is_none() {
        defmt::error!("no key in its page: no model runs");
    }
    let models = MODELS.init_with(|| {
        let places = (flash::LAYOUT, flash::COUNTS);
        let booted = BoardModels::boot(flash, places, (identity, NUCLEO_G474RE), ROOM.take());
        let Ok(models) = booted else {
            defmt::panic!("the layout is constant and fits the flash")
        };
        models
    });
    watchdog.pet();
    let app = application();
    models.start(app, RUNNING.take());
    REFUSED.store(app.refused(), Relaxed);
    watchdog.pet();
    let sampling = app.sampling();

    let mut spi_config = spi::Config::default();
    spi_config.mode = spi::MODE_1;
    spi_config.frequency = Hertz(20_000_000);
    let spi = Spi::new_blocking(p.SPI1, p.PA5, p.PA7, p.PA6, spi_config);
    let select = Output::new(p.PB6, Level::High, Speed::VeryHigh);
    let Ok(bus) = ExclusiveDevice::new_no_delay(spi, select);
    let config = Config::for_sampling(&sampling, CONVERTER_CLOCK_HZ);
    let Ok(converter) = Ads131m04::try_new(bus, config, &mut Delay) else {
        // There is nothing to do but to start over, which the watchdog does.
        defmt::panic!("the converter does not answer")
    };

    // Held for ever: dropping the encoder's timer or the pins would stop them.
    let encoder =
        Qei::<TIM3>::new::<qei::Ch1, qei::Ch2>(p.TIM3, p.PB4, p.PB5, qei::Config::default());
    core::mem::forget(encoder);
    // The counter wraps where the image expects it: it takes images of up to 16 bits only.
    if let Some(bits) = sampling.counter_bits {
        let top = u16::MAX.checked_shr(16_u32.saturating_sub(bits.into()));
        pac::TIM3
            .arr()
            .write(|w| w.set_arr(top.unwrap_or(u16::MAX)));
    }
    let index = ExtiInput::new_blocking(p.PB10, p.EXTI10, Pull::Down, TriggerEdge::Rising);
    core::mem::forget(index);
    let ready = ExtiInput::new_blocking(p.PC7, p.EXTI7, Pull::Up, TriggerEdge::Falling);

    let mut can = CanConfigurator::new(p.FDCAN1, p.PA11, p.PA12, Irqs);
    can.set_config(clocks::bit_timing(can.config()));
    let (tx, rx, properties) = can.into_normal_mode().split();

    let (outbox_in, outbox) = OUTBOX_QUEUE.init(Queue::new()).split();
    let (inbox_in, inbox) = INBOX_QUEUE.init(Queue::new()).split();
    let (replies_in, replies) = REPLIES_QUEUE.init(Queue::new()).split();
    let (counted_in, counted) = COUNTED_QUEUE.init(Queue::new()).split();
    let (raw_in, raw_out) = RAW_QUEUE.take().split();
    let board = Nucleo {
        converter,
        config,
        ready,
        outbox: outbox_in,
        raw: RawWriter::new(&RAW_LINK, raw_in),
        counted: counted_in,
        tick: 0,
    };
    let raw = RawReader::new(&RAW_LINK, raw_out, app.base());
    watchdog.pet();
    SAMPLER.give(SAMPLER_CELL.init(Sampler { app, board }));
    start_interrupts();
    // An interrupt of a peripheral that this board does not use.
    interrupt::UART5.set_priority(Priority::P9);
    let above = ABOVE_THREAD.start(interrupt::UART5);
    let tasks = (
        send(tx, outbox, replies, raw),
        receive(rx, inbox_in),
        watch(watchdog, properties),
        take_models(models, inbox, counted, replies_in),
    );
    let (Ok(send), Ok(receive), Ok(watch), Ok(take_models)) = tasks else {
        defmt::panic!("each task is spawned once")
    };
    above.spawn(send);
    above.spawn(receive);
    above.spawn(watch);
    thread.spawn(take_models);
}

/// The application without an image. Built at start: as the initial value of its memory it would
/// take 10.5 kB of flash.
#[inline(never)]
fn application() -> &'static mut App<'static> {
    static APP: StaticCell<App> = StaticCell::new();
    APP.init_with(App::without_image)
}

#[interrupt]
#[allow(unsafe_code)]
unsafe fn UART5() {
    // SAFETY: this interrupt is the one that the executor was started with.
    unsafe { ABOVE_THREAD.on_interrupt() }
}

/// The index above data-ready above everything else.
fn start_interrupts() {
    interrupt::EXTI15_10.set_priority(Priority::P1);
    interrupt::EXTI9_5.set_priority(Priority::P2);
    for other in [
        interrupt::FDCAN1_IT0,
        interrupt::FDCAN1_IT1,
        interrupt::TIM2,
    ] {
        other.set_priority(Priority::P8);
    }
    #[allow(unsafe_code)]
    // SAFETY: their data was given to them; both handlers may run from here on.
    unsafe {
        interrupt::EXTI15_10.enable();
        interrupt::EXTI9_5.enable();
    }
}

/// Frames to the bus: replies to an upload first, the sender of an image waits; raw samples where
/// nothing else is to be sent.
#[embassy_executor::task]
async fn send(
    mut tx: CanTx<'static>,
    mut outbox: Consumer<'static, Frame>,
    mut replies: Consumer<'static, Frame>,
    mut raw: RawReader<'static>,
) {
    loop {
        let frame = replies.dequeue().or_else(|| outbox.dequeue());
        let now_us = Instant::now().as_micros() as u32;
        match frame.map(RawFrame::Classic).or_else(|| raw.next(now_us)) {
            Some(RawFrame::Classic(frame)) => {
                let frame = can::frame::Frame::new_standard(frame.id, &frame.data);
                if let Ok(frame) = frame {
                    tx.write(&frame).await;
                }
            }
            Some(RawFrame::Fd(FdFrame { id, data })) => {
                let Some(id) = embedded_can::StandardId::new(id) else {
                    continue;
                };
                let header = can::frame::Header::new_fd(id.into(), data.len() as u8, false, true);
                if let Ok(frame) = can::frame::FdFrame::new(header, &data) {
                    tx.write_fd(&frame).await;
                }
            }
            None => Timer::after_micros(100).await,
        }
    }
}

/// Frames of 8 bytes with a standard identifier from the bus.
#[embassy_executor::task]
async fn receive(mut rx: CanRx<'static>, mut inbox: Producer<'static, Frame>) {
    loop {
        match rx.read().await {
            Ok(envelope) => {
                let embedded_can::Id::Standard(id) = *envelope.frame.id() else {
                    continue;
                };
                let Ok(data) = envelope.frame.data().try_into() else {
                    continue;
                };
                let id = id.as_raw();
                // A full inbox drops a frame of an upload, which then fails by its own checks.
                let _ = inbox.enqueue(Frame { id, data });
            }
            // Reported by the counters in `watch`; a pause keeps a dead bus from taking the thread.
            Err(_) => Timer::after_millis(1).await,
        }
    }
}

/// New models from the bus, and the counts.
#[embassy_executor::task]
async fn take_models(
    models: &'static mut BoardModels,
    mut inbox: Consumer<'static, Frame>,
    mut counted: Consumer<'static, CountSample>,
    mut replies: Producer<'static, Frame>,
) -> ! {
    loop {
        while let Some(frame) = inbox.dequeue() {
            let now_us = Instant::now().as_micros() as u32;
            if let Some(reply) = models.on_frame(&frame, now_us) {
                let _ = replies.enqueue(reply);
            }
        }
        while let Some(sample) = counted.dequeue() {
            models.count(&sample);
        }
        let turn = models.poll(Instant::now().as_micros() as u32);
        if let Some(reply) = turn.reply {
            let _ = replies.enqueue(reply);
        }
        if let Some(refused) = turn.refused {
            REFUSED.store(refused, Relaxed);
        }
        if let Some(burst) = turn.burst {
            begin(burst);
        }
        Timer::after_millis(1).await;
    }
}

/// Begins a burst, and the estimator anew. Data-ready waits: its handler would find the estimator
/// in use, leave the line pending, and come again at once for ever.
// Inlined, the image that is read would stay on the stack while another one is checked.
#[inline(never)]
fn begin(burst: Burst) {
    NVIC::mask(pac::Interrupt::EXTI9_5);
    SAMPLER.with(|Sampler { app, board }| app.begin_burst(burst, board));
    #[allow(unsafe_code)]
    // SAFETY: it was enabled before, and no critical section is open.
    unsafe {
        interrupt::EXTI9_5.enable();
    }
}

/// Feeds the watchdog while samples are processed, counts bus-off, has a silent
/// converter reported until the watchdog starts the board over, which sets it up anew.
#[embassy_executor::task]
async fn watch(mut watchdog: IndependentWatchdog<'static, IWDG>, can: Properties) -> ! {
    let mut progress = Progress::default();
    let mut bus = BusState::default();
    loop {
        if progress.goes_on(SAMPLES.load(Relaxed)) {
            watchdog.pet();
        } else {
            NVIC::pend(pac::Interrupt::EXTI9_5);
        }
        let off = matches!(can.bus_error_mode(), BusErrorMode::BusOff);
        bus.follow(off, &COUNTERS);
        Timer::after_millis(TURN_MS).await;
    }
}
