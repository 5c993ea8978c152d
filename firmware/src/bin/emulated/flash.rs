//! Gives the model flash of the emulated board, in RAM that keeps its contents over a reset. At
//! power-on it is copied from the memory region `MODEL` (linker script; filled by the test before
//! start). Reads from it the public key that images are checked with, and the identity of the
//! machine.
#![allow(unsafe_code)]

use core::{ptr, slice};

use embedded_storage::nor_flash::ReadNorFlash as _;
use loadtwin_common::io::signed_image::{Identity, KEY_PAGE_LEN};
use loadtwin_firmware::ram_flash::{KEY_AT, LEN, RamFlash};

pub type Memory = RamFlash<&'static mut [u8]>;

/// `MODEL` in memory/emulated.x.
const MODEL: *const u8 = 0x0030_0000 as *const u8;
/// `PSRAM` in memory/emulated.x; the flash starts behind a word that says
/// whether it was filled since power-on.
const PSRAM: *mut u32 = 0x2100_0000 as *mut u32;

/// Value of that word once the flash was filled.
const FILLED: u32 = 0xF111_ED01;

/// Where the flash starts behind it [bytes].
const OFFSET: usize = 8;

/// The flash; to be taken once.
pub fn powered() -> Memory {
    // SAFETY: PSRAM and MODEL are memory that nothing else uses, longer than
    // LEN and OFFSET; this program calls it once, so that there is one owner.
    let memory = unsafe {
        let memory = slice::from_raw_parts_mut(PSRAM.cast::<u8>().add(OFFSET), LEN);
        if ptr::read_volatile(PSRAM) != FILLED {
            memory.copy_from_slice(slice::from_raw_parts(MODEL, LEN));
            ptr::write_volatile(PSRAM, FILLED);
        }
        memory
    };
    RamFlash(memory)
}

/// The key that models are checked with, and the machine that they are for.
pub fn identity(flash: &mut Memory) -> Option<Identity> {
    let mut page = [0; KEY_PAGE_LEN];
    flash.read(KEY_AT as u32, &mut page).ok()?;
    Identity::from_page(&page)
}
