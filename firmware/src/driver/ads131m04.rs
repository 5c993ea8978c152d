//! Drives the ADS131M04, four simultaneously sampling 24-bit delta-sigma converters on SPI:
//! configures it, reads its conversions with CRC into a raw sample, reads registers, and puts it
//! into stand-by.
//!
//! Every transfer is one frame of six 24-bit words, most significant byte
//! first, SPI mode 1. Out: a command, its data, zeros. In: the status (or the
//! answer to the command before), four conversions, and a CRC over these five
//! words in the upper 16 bits of the sixth.
//!
//! Source: Texas Instruments, ADS131M04 data sheet (SBAS890), sections 8.5 and 8.6.

use crc::{CRC_16_IBM_3740, Crc, Table};
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use loadtwin_common::io::raw::RawSample;

pub use super::ads131m04_config::{Config, Gain, Oversampling};

/// Channels of one converter.
pub const CHANNELS: usize = 4;

/// Length of a word [bytes].
const WORD: usize = 3;

/// Length of a frame [bytes]: six words.
const FRAME: usize = 6 * WORD;

/// Offset of the CRC in a frame [bytes].
const CRC_AT: usize = 5 * WORD;

/// CRC-16/CCITT with start value 0xFFFF, what the converter calls "CCITT".
const CRC: Crc<u16, Table<1>> = Crc::<u16, Table<1>>::new(&CRC_16_IBM_3740);

mod command {
    pub const NULL: u16 = 0x0000;
    pub const RESET: u16 = 0x0011;
    pub const STANDBY: u16 = 0x0022;
    pub const WAKEUP: u16 = 0x0033;
    pub const READ: u16 = 0xA000;
    pub const WRITE: u16 = 0x6000;
    pub const WRITTEN: u16 = 0x4000;
    /// Answer to `RESET`: 0xFF, and 0x24 for a converter of four channels.
    pub const RESET_DONE: u16 = 0xFF24;
}

mod register {
    pub const MODE: u8 = 0x02;
    pub const CLOCK: u8 = 0x03;
    pub const GAIN: u8 = 0x04;
}

/// Bit of the status word: the converter was reset and lost its configuration.
const STATUS_RESET: u16 = 1 << 10;

/// Why there is no conversion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error<E> {
    /// The bus reported an error.
    Bus(E),
    /// The CRC of a frame did not match: what was computed, what came.
    Crc(u16, u16),
    /// The converter did not answer the reset with its code; what came instead.
    NoReset(u16),
    /// The register did not take its value; what it holds.
    NotWritten(u8, u16),
    /// The converter was reset since it was configured.
    Restarted,
}

/// The converter on its bus.
#[derive(Debug)]
pub struct Ads131m04<SPI> {
    spi: SPI,
}

impl<SPI: SpiDevice> Ads131m04<SPI> {
    /// Resets and configures the converter, and reads the registers back.
    ///
    /// # Errors
    /// `NoReset` when no such converter answers, `NotWritten` when a register
    /// does not hold what was written, `Crc` and `Bus` when the bus is at fault.
    pub fn try_new(
        spi: SPI,
        config: Config,
        delay: &mut impl DelayNs,
    ) -> Result<Self, Error<SPI::Error>> {
        let mut this = Self { spi };
        this.configure(config, delay)?;
        Ok(this)
    }

    /// As [`Self::try_new`], for a converter that was reset in operation.
    ///
    /// # Errors
    /// As [`Self::try_new`].
    pub fn configure(
        &mut self,
        config: Config,
        delay: &mut impl DelayNs,
    ) -> Result<(), Error<SPI::Error>> {
        // The frame before may have been cut off anywhere: its answer is not looked at.
        self.transfer(command::RESET, 0)?;
        // Registers can be reached 5 us after a reset.
        delay.delay_us(10);
        let answer = status(&self.checked(command::NULL, 0)?);
        if answer != command::RESET_DONE {
            return Err(Error::NoReset(answer));
        }
        self.write(register::MODE, Config::mode())?;
        self.write(register::CLOCK, config.clock())?;
        self.write(register::GAIN, config.gains())?;
        // Two conversions may wait inside the converter; both are older than
        // the configuration.
        self.checked(command::NULL, 0)?;
        self.checked(command::NULL, 0)?;
        Ok(())
    }

    /// Reads the conversions that the last data-ready announced.
    ///
    /// # Errors
    /// `Crc` when the frame was damaged, `Restarted` when the converter has
    /// lost its configuration: none of the words may be used.
    pub fn read(&mut self) -> Result<[i32; CHANNELS], Error<SPI::Error>> {
        let frame = self.checked(command::NULL, 0)?;
        if status(&frame) & STATUS_RESET != 0 {
            return Err(Error::Restarted);
        }
        let mut words = [0; CHANNELS];
        for (word, bytes) in words.iter_mut().zip(frame[WORD..].chunks_exact(WORD)) {
            *word = i32::from_be_bytes([bytes[0], bytes[1], bytes[2], 0]) >> 8;
        }
        Ok(words)
    }

    /// Reads the conversions into the sample's channels from `first` on.
    ///
    /// Where the frame was damaged they stay marked as not delivered.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_into(
        &mut self,
        sample: &mut RawSample,
        first: usize,
    ) -> Result<(), Error<SPI::Error>> {
        let words = self.read()?;
        for (channel, word) in (first..).zip(words) {
            sample.set_word(channel, word);
        }
        Ok(())
    }

    /// Stops converting and draws little current, until [`Self::wake`].
    ///
    /// # Errors
    /// `Bus` when the bus is at fault.
    pub fn stand_by(&mut self) -> Result<(), Error<SPI::Error>> {
        self.transfer(command::STANDBY, 0).map(drop)
    }

    /// Converts again after [`Self::stand_by`].
    ///
    /// # Errors
    /// `Bus` when the bus is at fault.
    pub fn wake(&mut self) -> Result<(), Error<SPI::Error>> {
        self.transfer(command::WAKEUP, 0).map(drop)
    }

    /// Reads one register.
    ///
    /// # Errors
    /// `Crc` when the answer was damaged, `Bus` when the bus is at fault.
    pub fn register(&mut self, address: u8) -> Result<u16, Error<SPI::Error>> {
        self.checked(command::READ | u16::from(address) << 7, 0)?;
        Ok(status(&self.checked(command::NULL, 0)?))
    }

    fn write(&mut self, address: u8, value: u16) -> Result<(), Error<SPI::Error>> {
        let address_bits = u16::from(address) << 7;
        self.checked(command::WRITE | address_bits, value)?;
        // The answer to the write comes with the next frame, which asks for the value.
        let written = status(&self.checked(command::READ | address_bits, 0)?);
        let held = status(&self.checked(command::NULL, 0)?);
        if written != command::WRITTEN | address_bits || held != value {
            return Err(Error::NotWritten(address, held));
        }
        Ok(())
    }

    fn checked(&mut self, command: u16, data: u16) -> Result<[u8; FRAME], Error<SPI::Error>> {
        let frame = self.transfer(command, data)?;
        let computed = CRC.checksum(&frame[..CRC_AT]);
        let came = u16::from_be_bytes([frame[CRC_AT], frame[CRC_AT + 1]]);
        if computed == came {
            Ok(frame)
        } else {
            Err(Error::Crc(computed, came))
        }
    }

    fn transfer(&mut self, command: u16, data: u16) -> Result<[u8; FRAME], Error<SPI::Error>> {
        let mut frame = [0; FRAME];
        frame[..2].copy_from_slice(&command.to_be_bytes());
        frame[WORD..WORD + 2].copy_from_slice(&data.to_be_bytes());
        self.spi.transfer_in_place(&mut frame).map_err(Error::Bus)?;
        Ok(frame)
    }
}

fn status(frame: &[u8; FRAME]) -> u16 {
    u16::from_be_bytes([frame[0], frame[1]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal_mock::eh1::delay::NoopDelay;
    use embedded_hal_mock::eh1::spi::{Mock, Transaction};
    use std::vec::Vec;

    const CONFIG: Config = Config {
        oversampling: Oversampling::X2048,
        gain: [Gain::X32, Gain::X32, Gain::X32, Gain::X1],
    };

    /// CRC bit by bit, as the data sheet draws it; not the crate under test.
    fn crc(bytes: &[u8]) -> u16 {
        bytes.iter().fold(0xFFFF, |crc, byte| {
            (0..8).fold(crc ^ u16::from(*byte) << 8, |crc, _| {
                if crc & 0x8000 == 0 {
                    crc << 1
                } else {
                    crc << 1 ^ 0x1021
                }
            })
        })
    }

    fn request(command: u16, data: u16) -> Vec<u8> {
        let mut frame = vec![0; 18];
        frame[..2].copy_from_slice(&command.to_be_bytes());
        frame[3..5].copy_from_slice(&data.to_be_bytes());
        frame
    }

    fn answer(status: u16, words: [i32; 4]) -> Vec<u8> {
        let mut frame = Vec::from(status.to_be_bytes());
        frame.push(0);
        for word in words {
            frame.extend_from_slice(&word.to_be_bytes()[1..]);
        }
        let crc = crc(&frame);
        frame.extend_from_slice(&crc.to_be_bytes());
        frame.push(0);
        frame
    }

    fn exchange(out: Vec<u8>, back: Vec<u8>) -> [Transaction<u8>; 3] {
        [
            Transaction::transaction_start(),
            Transaction::transfer_in_place(out, back),
            Transaction::transaction_end(),
        ]
    }

    fn setup() -> Vec<Transaction<u8>> {
        let idle = [0; 4];
        let mut bus = Vec::new();
        let mut step = |command, data, status| {
            bus.extend(exchange(request(command, data), answer(status, idle)));
        };
        step(0x0011, 0, 0x0500);
        step(0x0000, 0, 0xFF24);
        // MODE = 0x0110 at address 2: 0x6000 | 2 << 7.
        step(0x6100, 0x0110, 0x0500);
        step(0xA100, 0, 0x4100);
        step(0x0000, 0, 0x0110);
        // CLOCK: four channels, ratio 2048, high resolution.
        step(0x6180, 0x0F12, 0x0100);
        step(0xA180, 0, 0x4180);
        step(0x0000, 0, 0x0F12);
        // GAIN: 1 on channel 3, 32 on the others.
        step(0x6200, 0x0555, 0x0100);
        step(0xA200, 0, 0x4200);
        step(0x0000, 0, 0x0555);
        step(0x0000, 0, 0x010F);
        step(0x0000, 0, 0x010F);
        bus
    }

    /// Runs `then` on a configured converter that answers `frames`.
    fn with<T>(frames: Vec<Vec<u8>>, then: impl FnOnce(&mut Ads131m04<Mock<u8>>) -> T) -> T {
        let mut bus = setup();
        for frame in frames {
            bus.extend(exchange(request(0, 0), frame));
        }
        let mut spi = Mock::new(&bus);
        let mut adc = Ads131m04::try_new(spi.clone(), CONFIG, &mut NoopDelay::new()).unwrap();
        let result = then(&mut adc);
        spi.done();
        result
    }

    #[test]
    fn a_conversion_is_four_sign_extended_words() {
        let words = [8_388_607, -8_388_608, -1, 0x12_3456];
        let read = with(vec![answer(0x010F, words)], Ads131m04::read);
        assert_eq!(read, Ok(words));
    }

    #[test]
    fn the_frame_is_the_one_of_the_data_sheet() {
        // Status and four words; the CRC by Python 3.11, `binascii.crc_hqx(bytes, 0xFFFF)`.
        let frame = [
            0x01, 0x0F, 0x00, 0x00, 0x00, 0x01, 0xFF, 0xFF, 0xFF, 0x7F, 0xFF, 0xFF, 0x80, 0x00,
            0x00, 0x03, 0xDD, 0x00,
        ];
        assert_eq!(answer(0x010F, [1, -1, 8_388_607, -8_388_608]), frame);
    }

    #[test]
    fn every_flipped_bit_of_a_frame_is_noticed_and_the_words_are_not_delivered() {
        let good = answer(0x010F, [5, 6, 7, 8]);
        for bit in 0..136 {
            let mut bad = good.clone();
            bad[bit / 8] ^= 0x80 >> (bit % 8);
            let mut sample = RawSample::default();
            let read = with(vec![bad], |adc| adc.read_into(&mut sample, 0));
            assert!(matches!(read, Err(Error::Crc(..))), "bit {bit}: {read:?}");
            assert_eq!(sample.valid, 0, "bit {bit}");
        }
    }

    #[test]
    fn conversions_go_to_the_channels_from_the_first_on() {
        let mut sample = RawSample::default();
        with(vec![answer(0x010F, [1, 2, 3, 4])], |adc| {
            adc.read_into(&mut sample, 4)
        })
        .unwrap();
        assert_eq!(
            (sample.words, sample.valid),
            ([0, 0, 0, 0, 1, 2, 3, 4], 0xF0)
        );
    }

    #[test]
    fn a_converter_that_restarted_is_not_read() {
        let read = with(vec![answer(0x050F, [1, 2, 3, 4])], Ads131m04::read);
        assert_eq!(read, Err(Error::Restarted));
    }

    #[test]
    fn another_converter_is_refused() {
        let mut bus = Vec::from(exchange(request(0x0011, 0), answer(0x0500, [0; 4])));
        bus.extend(exchange(request(0, 0), answer(0xFF28, [0; 4])));
        let mut spi = Mock::new(&bus);
        let refused = Ads131m04::try_new(spi.clone(), CONFIG, &mut NoopDelay::new());
        assert_eq!(refused.err(), Some(Error::NoReset(0xFF28)));
        spi.done();
    }

    #[test]
    fn a_register_that_does_not_hold_its_value_is_named() {
        let mut bus = setup();
        bus.truncate(7 * 3);
        bus.extend(exchange(request(0x0000, 0), answer(0x0F0E, [0; 4])));
        let mut spi = Mock::new(&bus);
        let refused = Ads131m04::try_new(spi.clone(), CONFIG, &mut NoopDelay::new());
        assert_eq!(refused.err(), Some(Error::NotWritten(3, 0x0F0E)));
        spi.done();
    }

    #[test]
    fn a_register_is_read_in_two_frames() {
        let mut bus = setup();
        bus.extend(exchange(request(0xA000, 0), answer(0x010F, [0; 4])));
        bus.extend(exchange(request(0x0000, 0), answer(0x2403, [0; 4])));
        let mut spi = Mock::new(&bus);
        let mut adc = Ads131m04::try_new(spi.clone(), CONFIG, &mut NoopDelay::new()).unwrap();
        assert_eq!(adc.register(0), Ok(0x2403));
        spi.done();
    }

    #[test]
    fn standby_and_wake_are_one_frame_each() {
        let mut bus = setup();
        bus.extend(exchange(request(0x0022, 0), answer(0x010F, [0; 4])));
        bus.extend(exchange(request(0x0033, 0), answer(0x0022, [0; 4])));
        let mut spi = Mock::new(&bus);
        let mut adc = Ads131m04::try_new(spi.clone(), CONFIG, &mut NoopDelay::new()).unwrap();
        adc.stand_by().unwrap();
        adc.wake().unwrap();
        spi.done();
    }
}
