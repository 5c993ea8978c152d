//! Counts a pseudo-random load with gaps and restarts, and gives the CRC-32 of all saved counts
//! (`digest`): tests on the host and a program on the emulated board compare it.

use loadtwin_common::Error;
use loadtwin_common::counting::{LevelScale, LoadCounts, SHAFTS};
use loadtwin_common::io::signed_image::CRC;

/// Half of the range of the loads [N m].
const NOMINAL_NM: f32 = 1000.0;

/// Samples from one restart to the next.
const RESTART: u32 = 4096;

/// Random numbers of a fixed sequence.
///
/// Source: Numerical Recipes, third edition, 7.1.7, 32-bit linear congruential generator.
#[derive(Clone, Debug)]
pub struct Random(u32);

impl Random {
    /// The sequence of a seed.
    pub const fn new(seed: u32) -> Self {
        Self(seed)
    }

    /// The next number; its upper half is random.
    fn word(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        self.0
    }

    /// The next number, -1 to 1.
    pub fn number(&mut self) -> f32 {
        (self.word() >> 8) as f32 / 8_388_608.0 - 1.0
    }
}

/// A load as of a shaft at 500 Hz: two low-passes of 1.6 Hz over white noise, and noise of half
/// a level.
#[derive(Clone, Debug)]
pub struct Load {
    random: Random,
    slow_nm: [f32; 2],
}

impl Load {
    /// The load of a seed.
    pub const fn new(seed: u32) -> Self {
        Self {
            random: Random::new(seed),
            slow_nm: [0.0; 2],
        }
    }

    /// The next sample [N m].
    pub fn next_nm(&mut self) -> f32 {
        let mut input_nm = 10.0 * NOMINAL_NM * self.random.number();
        for output_nm in &mut self.slow_nm {
            *output_nm += 0.02 * (input_nm - *output_nm);
            input_nm = *output_nm;
        }
        input_nm + 0.02 * NOMINAL_NM * self.random.number()
    }

    /// Whether the next sample is valid, and by how much the shafts turn [2^-32 turn].
    fn beside(&mut self) -> (bool, [u32; SHAFTS]) {
        let word = self.random.word();
        (word >> 25 != 0, [word >> 4, word >> 7])
    }
}

/// Counts for the loads of this module, with a gate of `gate` levels.
///
/// # Errors
/// As [`LoadCounts::try_new`].
pub fn empty(gate: u8) -> Result<LoadCounts, Error> {
    let scale = LevelScale::covering(-1.25 * NOMINAL_NM, 1.25 * NOMINAL_NM)?;
    LoadCounts::try_new(scale, gate)
}

/// Counts `samples` samples of a load with gaps, samples that are not valid and restarts, at
/// each of which the counts are saved to `bytes` and continued; gives the CRC-32 of all that
/// was saved.
///
/// # Errors
/// As [`LoadCounts::save`] and [`LoadCounts::continued`].
pub fn digest(seed: u32, samples: u32, bytes: &mut [u8]) -> Result<u32, Error> {
    let mut load = Load::new(seed);
    let mut counts = empty(2)?;
    let mut digest = CRC.digest();
    for k in 1..=samples {
        let load_nm = load.next_nm();
        let (is_valid, advance) = load.beside();
        counts.push(is_valid.then_some(load_nm), advance);
        if k % RESTART == RESTART / 3 {
            counts.gap(u64::from(k));
        }
        if k % RESTART == 0 || k == samples {
            let len = counts.save(bytes)?;
            let saved = &bytes[..len];
            digest.update(saved);
            counts = LoadCounts::continued(saved)?;
            counts.restart();
        }
    }
    Ok(digest.finalize())
}
