//! Clocks of the STM32G474: processor at 170 MHz from the crystal, and bit timing of the CAN controller.

use core::num::{NonZeroU8, NonZeroU16};

use embassy_stm32::can::config::{
    DataBitTiming, FdCanConfig, FrameTransmissionConfig, NominalBitTiming, TxBufferMode,
};
use embassy_stm32::rcc;
use embassy_stm32::time::Hertz;

/// Time quanta of a bit: 170 MHz at the controller / 20 / 17 = 500 kbit/s, and / 5 / 17 = 2 Mbit/s
/// in the data phase of FD frames.
const QUANTA: u8 = 17;

/// Processor and controller at 170 MHz.
pub fn clocks() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hse = Some(rcc::Hse {
        freq: Hertz(24_000_000),
        mode: rcc::HseMode::Oscillator,
    });
    // 24 MHz / 6 * 85 = 340 MHz; / 2 = 170 MHz.
    config.rcc.pll = Some(rcc::Pll {
        source: rcc::PllSource::HSE,
        prediv: rcc::PllPreDiv::DIV6,
        mul: rcc::PllMul::MUL85,
        divp: None,
        divq: Some(rcc::PllQDiv::DIV2),
        divr: Some(rcc::PllRDiv::DIV2),
    });
    config.rcc.sys = rcc::Sysclk::PLL1_R;
    config.rcc.boost = true;
    config.rcc.mux.fdcansel = rcc::mux::Fdcansel::PLL1_Q;
    config
}

/// 500 kbit/s, sampled at 88 % of a bit, and 2 Mbit/s, at 76 %; frames leave in the
/// order in which they were queued. A queue by priority would let the head of a raw sample overtake
/// the end of the one before, and returns a frame that it takes back.
pub fn bit_timing(config: FdCanConfig) -> FdCanConfig {
    const fn quanta(quanta: u8) -> NonZeroU8 {
        NonZeroU8::new(quanta).expect("not 0")
    }
    const fn prescaler(prescaler: u16) -> NonZeroU16 {
        NonZeroU16::new(prescaler).expect("not 0")
    }
    let nominal = const {
        NominalBitTiming {
            prescaler: prescaler(20),
            seg1: quanta(QUANTA - 3),
            seg2: quanta(2),
            sync_jump_width: quanta(1),
        }
    };
    let data = const {
        DataBitTiming {
            // The driver does not set it up on this family; 2 Mbit/s do without.
            transceiver_delay_compensation: false,
            prescaler: prescaler(5),
            seg1: quanta(QUANTA - 5),
            seg2: quanta(4),
            sync_jump_width: quanta(4),
        }
    };
    config
        .set_nominal_bit_timing(nominal)
        .set_data_bit_timing(data)
        .set_frame_transmit(FrameTransmissionConfig::AllowFdCanAndBRS)
        .set_tx_buffer_mode(TxBufferMode::Fifo)
}
