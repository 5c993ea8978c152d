//! Reads, programs and erases flash bank 2 of the STM32G474, which holds the model slots, the
//! counts and the key page (`Checked`). A word in them that ECC cannot correct is an error of the
//! read (NMI); elsewhere it resets the board.
//!
//! Written through the registers, for the crate's own driver turns interrupts
//! off while it erases: the program runs from bank 1, and the estimator goes on.
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicBool, Ordering::SeqCst};
use core::{ptr, slice};

use cortex_m_rt::exception;
use embassy_stm32::Peri;
use embassy_stm32::pac;
use embassy_stm32::peripherals::FLASH;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read,
    check_write,
};
use loadtwin_common::io::signed_image::{Identity, KEY_PAGE_LEN};
use loadtwin_firmware::counts::CountsLayout;
use loadtwin_firmware::store::Layout;

/// Smallest part that is erased [bytes].
pub const PAGE: usize = 2048;
/// The smallest part that is written [bytes].
const DOUBLE_WORD: usize = 8;

/// Start of bank 2 in the address space (RM0440).
const BANK: *const u8 = 0x0804_0000 as *const u8;

/// Length of bank 2 [bytes].
const BANK_LEN: usize = 256 * 1024;
/// The last page holds the key.
const KEY_AT: u32 = (BANK_LEN - PAGE) as u32;

/// Four areas of counts of 18 KiB before the key's page.
pub const COUNTS: CountsLayout = CountsLayout {
    start: KEY_AT - 4 * 18 * 1024,
    area_bytes: 18 * 1024,
    areas: 4,
};

/// Two slots of 32 KiB at the start of the bank.
pub const LAYOUT: Layout = Layout {
    start: 0,
    slot_bytes: 32 * 1024,
};

/// A read of data is under way.
static READING: AtomicBool = AtomicBool::new(false);
/// It met an ECC error that cannot be corrected: a write was cut there.
static DAMAGED: AtomicBool = AtomicBool::new(false);

/// The bank; a word that its ECC cannot correct is an error, not a fault.
pub struct Checked(Peri<'static, FLASH>);

/// What the bank refused.
#[derive(Clone, Copy, Debug)]
pub enum Error {
    /// Outside the bank, or not in whole words.
    Place(NorFlashErrorKind),
    /// The flash reported an error of programming or erasing.
    Refused,
    /// A word that its ECC cannot correct.
    Damaged,
}

impl NorFlashError for Error {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Place(kind) => *kind,
            Self::Refused | Self::Damaged => NorFlashErrorKind::Other,
        }
    }
}

/// The key that models are checked with, and the machine that they are for.
pub fn identity(flash: &mut Checked) -> Option<Identity> {
    let mut page = [0; KEY_PAGE_LEN];
    flash.read(KEY_AT, &mut page).ok()?;
    Identity::from_page(&page)
}

impl Checked {
    pub fn new(flash: Peri<'static, FLASH>) -> Self {
        Self(flash)
    }

    /// Runs one operation with the registers unlocked.
    fn operate(operation: impl FnOnce()) -> Result<(), Error> {
        let flash = pac::FLASH;
        while flash.sr().read().bsy() {}
        if flash.cr().read().lock() {
            flash.keyr().write_value(0x4567_0123);
            flash.keyr().write_value(0xCDEF_89AB);
        }
        // Errors of an operation before are cleared by writing them back.
        flash.sr().modify(|_| {});
        operation();
        while flash.sr().read().bsy() {}
        let status = flash.sr().read();
        flash.cr().write(|control| control.set_lock(true));
        if status.progerr()
            || status.wrperr()
            || status.pgaerr()
            || status.sizerr()
            || status.pgserr()
        {
            return Err(Error::Refused);
        }
        Ok(())
    }
}

impl ErrorType for Checked {
    type Error = Error;
}

impl ReadNorFlash for Checked {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        check_read(self, offset, bytes.len()).map_err(Error::Place)?;
        DAMAGED.store(false, SeqCst);
        READING.store(true, SeqCst);
        // SAFETY: inside the bank, which nothing changes meanwhile: the only
        // writer is `self`.
        let there = unsafe { slice::from_raw_parts(BANK.add(offset as usize), bytes.len()) };
        bytes.copy_from_slice(there);
        cortex_m::asm::dsb();
        READING.store(false, SeqCst);
        if DAMAGED.load(SeqCst) {
            return Err(Error::Damaged);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        BANK_LEN
    }
}

impl NorFlash for Checked {
    const WRITE_SIZE: usize = DOUBLE_WORD;
    const ERASE_SIZE: usize = PAGE;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        check_write(self, offset, bytes.len()).map_err(Error::Place)?;
        for (at, bytes) in (offset..)
            .step_by(DOUBLE_WORD)
            .zip(bytes.chunks_exact(DOUBLE_WORD))
        {
            let word =
                |i: usize| u32::from_le_bytes([bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]]);
            let place = ptr::with_exposed_provenance_mut::<u32>(BANK as usize + at as usize);
            Self::operate(|| {
                pac::FLASH.cr().write(|control| control.set_pg(true));
                // SAFETY: a double word inside the bank, both halves one after
                // the other as the programming sequence wants them; no Rust
                // object lies there.
                unsafe {
                    ptr::write_volatile(place, word(0));
                    cortex_m::asm::isb();
                    ptr::write_volatile(place.add(1), word(4));
                }
            })?;
        }
        Ok(())
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        check_erase(self, from, to).map_err(Error::Place)?;
        for page in from / PAGE as u32..to / PAGE as u32 {
            Self::operate(|| {
                pac::FLASH.cr().write(|control| {
                    control.set_per(true);
                    control.set_bker(true);
                    control.set_pnb(page as u8);
                });
                pac::FLASH.cr().modify(|control| control.set_strt(true));
            })?;
        }
        // The data cache may hold what was erased.
        pac::FLASH.acr().modify(|access| access.set_dcen(false));
        pac::FLASH.acr().modify(|access| access.set_dcrst(true));
        pac::FLASH.acr().modify(|access| access.set_dcrst(false));
        pac::FLASH.acr().modify(|access| access.set_dcen(true));
        Ok(())
    }
}

/// Whether `offset` of bank 2 holds data, not program: the slots, the counts, or the key's page.
fn is_data(offset: u32) -> bool {
    !(LAYOUT.start + 2 * LAYOUT.slot_bytes..COUNTS.start).contains(&offset)
}

/// The flash met a word that it cannot correct.
///
/// In data that is being read it is an error of that read. In the program it ends here: an
/// instruction or a constant that reads wrong must not go on to an estimate. The board starts
/// over, and stays silent where it meets the word again.
#[exception]
unsafe fn NonMaskableInt() {
    let ecc = pac::FLASH.eccr().read();
    let in_bank_2 = ecc.bk_ecc() && !ecc.sysf_ecc();
    if ecc.eccd() && READING.load(SeqCst) && in_bank_2 && is_data(ecc.addr_ecc()) {
        DAMAGED.store(true, SeqCst);
        pac::FLASH.eccr().modify(|ecc| ecc.set_eccd(true));
    } else {
        cortex_m::peripheral::SCB::sys_reset();
    }
}
