//! Behaves as NOR flash in ordinary memory (`RamFlash`): erases pages to ones and programs each
//! word of 8 bytes once. For the emulated board, which has no flash to write, with the layout of
//! its slots, areas of counts and key page.
//!
//! So does the flash of the STM32G4. Loss of power is simulated by
//! [`simulated_flash`](crate::simulated_flash).

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};

use crate::counts::CountsLayout;
use crate::store::Layout;

/// Smallest part that is erased (bytes).
pub const PAGE: usize = 2048;
/// Smallest part that is written (bytes).
const WORD: usize = 8;
/// Length of the emulated board's flash for models, counts and the key (bytes).
pub const LEN: usize = 320 * 1024;
/// Offset of the page with the key that images are checked with.
pub const KEY_AT: usize = LEN - PAGE;
/// Two slots of 96 KiB at the start.
pub const LAYOUT: Layout = Layout {
    start: 0,
    slot_bytes: 96 * 1024,
};

/// Four areas of counts of 24 KiB behind them.
pub const COUNTS: CountsLayout = CountsLayout {
    start: 2 * LAYOUT.slot_bytes,
    area_bytes: 24 * 1024,
    areas: 4,
};

/// A flash of as many bytes as `M` has.
#[derive(Debug)]
pub struct RamFlash<M>(pub M);

impl<M> ErrorType for RamFlash<M> {
    type Error = NorFlashErrorKind;
}

impl<M: AsRef<[u8]> + AsMut<[u8]>> RamFlash<M> {
    fn part(&mut self, from: u32, len: usize) -> Result<&mut [u8], NorFlashErrorKind> {
        let from = from as usize;
        let to = from
            .checked_add(len)
            .ok_or(NorFlashErrorKind::OutOfBounds)?;
        self.0
            .as_mut()
            .get_mut(from..to)
            .ok_or(NorFlashErrorKind::OutOfBounds)
    }
}

impl<M: AsRef<[u8]> + AsMut<[u8]>> ReadNorFlash for RamFlash<M> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        check_read(self, offset, bytes.len())?;
        let there = self.part(offset, bytes.len())?;
        for (byte, there) in bytes.iter_mut().zip(there) {
            *byte = *there;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.as_ref().len()
    }
}

impl<M: AsRef<[u8]> + AsMut<[u8]>> NorFlash for RamFlash<M> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        check_write(self, offset, bytes.len())?;
        let there = self.part(offset, bytes.len())?;
        if there.iter().any(|byte| *byte != 0xFF) {
            return Err(NorFlashErrorKind::Other);
        }
        for (there, byte) in there.iter_mut().zip(bytes) {
            *there = *byte;
        }
        Ok(())
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        check_erase(self, from, to)?;
        self.part(from, (to - from) as usize)?.fill(0xFF);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_takes_a_word_once_after_an_erase() {
        let mut flash = RamFlash(std::vec![0; 2 * PAGE]);
        assert_eq!(flash.write(0, &[1; WORD]), Err(NorFlashErrorKind::Other));
        flash.erase(0, PAGE as u32).unwrap();
        assert_eq!(flash.write(0, &[1; WORD]), Ok(()));
        assert_eq!(flash.write(0, &[1; WORD]), Err(NorFlashErrorKind::Other));
        let mut word = [0; WORD];
        flash.read(0, &mut word).unwrap();
        assert_eq!(word, [1; WORD]);
        assert!(flash.write(1, &[1; WORD]).is_err());
        assert!(flash.read(2 * PAGE as u32, &mut word).is_err());
    }
}
