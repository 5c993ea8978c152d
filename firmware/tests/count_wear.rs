//! Wear of the flash by the counts that a NUCLEO-G474RE keeps: erases of each page over many
//! intervals, and the years of running after which the most worn one has endured its last.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use loadtwin_common::counting::{CountSample, CountedLoad, LevelScale, MAX_COUNTED};
use loadtwin_firmware::counting_test::Load;
use loadtwin_firmware::counts::{CountKeeper, CountMemory, CountsLayout, INTERVAL_S, Owner};

/// As on the STM32G474.
const PAGE: usize = 2048;
/// As in `nucleo_g474re/flash.rs`.
const LAYOUT: CountsLayout = CountsLayout {
    start: 0,
    area_bytes: 18 * 1024,
    areas: 4,
};
const LEN: usize = 4 * 18 * 1024;

/// Erases that a page endures (STM32G474, DS12288 table 55).
const ENDURANCE: f64 = 10_000.0;
const YEAR_S: f64 = 365.25 * 86_400.0;

/// Flash that counts the erases of its pages.
struct Wearing {
    bytes: Vec<u8>,
    erases: Vec<u32>,
}

impl ErrorType for Wearing {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Wearing {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let at = offset as usize;
        bytes.copy_from_slice(&self.bytes[at..at + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        LEN
    }
}

impl NorFlash for Wearing {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.bytes[from as usize..to as usize].fill(0xFF);
        self.erases[from as usize / PAGE] += 1;
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let at = offset as usize;
        let there = &mut self.bytes[at..at + bytes.len()];
        if there.iter().any(|byte| *byte != 0xFF) {
            return Err(NorFlashErrorKind::Other);
        }
        there.copy_from_slice(bytes);
        Ok(())
    }
}

/// Intervals, sample rate (Hz), gate (levels).
type Kind = (u32, f32, u8);

/// Years of running by the erases of the most worn page in `intervals`, and the bytes of an
/// interval.
fn years((intervals, rate_hz, gate): Kind, mut load: impl FnMut() -> f32) -> (f64, f64) {
    let counted = CountedLoad {
        load: 0,
        scale: LevelScale::covering(-1250.0, 1250.0).unwrap(),
        gate,
        ratio: 10.0,
    };
    let owner = Owner {
        image_hash: 1,
        rate_hz,
        counted: [counted].into_iter().collect(),
    };
    let mut flash = Wearing {
        bytes: vec![0xFF; LEN],
        erases: vec![0; LEN / PAGE],
    };
    let mut memory = CountMemory::<1>::none();
    memory.begin(&owner.counted).unwrap();
    let mut keeper = CountKeeper::open(&mut flash, LAYOUT, owner);
    let mut tick = 0;
    for _ in 0..intervals {
        for _ in 0..(INTERVAL_S * rate_hz) as u32 {
            let sample = CountSample {
                tick,
                advance: 0x0010_0000,
                loads: [load(); MAX_COUNTED],
            };
            tick += 1;
            memory.counts.push(&sample, 0);
        }
        keeper.begin(&mut memory);
        while keeper.is_busy() {
            keeper.poll(&mut flash, &mut memory);
        }
    }
    let most = f64::from(*flash.erases.iter().max().unwrap());
    let least = f64::from(*flash.erases.iter().min().unwrap());
    // The areas take turns: the most worn page is one erase ahead of the least.
    assert!(
        most - least <= 1.0,
        "{most} erases of one page, {least} of another"
    );
    let mean: f64 = flash.erases.iter().copied().map(f64::from).sum::<f64>() / (LEN / PAGE) as f64;
    let seconds = f64::from(intervals) * f64::from(INTERVAL_S);
    let bytes = mean * LEN as f64 / f64::from(intervals);
    (ENDURANCE / mean * seconds / YEAR_S, bytes)
}

#[test]
fn the_flash_endures_years_of_counts() {
    let mut noisy = Load::new(1);
    let mut gated = Load::new(2);
    let mut slow = 0_u32;
    let kinds: [(&str, Kind, f64, &mut dyn FnMut() -> f32); 3] = [
        ("between two levels", (20_000, 4.0, 2), 20.0, &mut || {
            slow += 1;
            (slow / 97 % 2) as f32 * 15.0
        }),
        ("noise of half a level", (400, 500.0, 2), 1.0, &mut || {
            noisy.next_nm()
        }),
        (
            "noise of half a level, gate 8",
            (400, 500.0, 8),
            1.5,
            &mut || gated.next_nm(),
        ),
    ];
    for (name, kind, least, load) in kinds {
        let (years, bytes) = years(kind, load);
        println!("{name}: {bytes:.0} bytes in 50 s, {years:.1} years");
        assert!(years > least, "{name}: {years}");
    }
}
