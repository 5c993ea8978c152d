//! Random histories of the counts that a board keeps, on a simulated flash: power cuts before, in and
//! after every operation, a damaged word, changes of the image. After every start the counts are
//! those that were kept last, or the ones that were being kept, to the bit.
//!
//! `LOADTWIN_CUTS` sets how many power cuts; 100 000 were run for the figures in
//! docs/reference/boards.md.

use loadtwin_common::counting::{
    CountSample, CountedLoad, CountedLoads, LevelScale, MachineCounts,
};
use loadtwin_firmware::counts::{CountKeeper, CountMemory, CountsLayout, Owner};
use loadtwin_firmware::simulated_flash::{Moment, SimulatedFlash};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const PAGE: usize = 512;
const AREA: usize = 4 * PAGE;
const LAYOUT: CountsLayout = CountsLayout {
    start: PAGE as u32,
    area_bytes: AREA as u32,
    areas: 4,
};
const WORDS: usize = (PAGE + 4 * AREA) / 8;
type Flash = SimulatedFlash<PAGE, WORDS>;
type Memory = CountMemory<2>;
type Counts = MachineCounts<2>;

/// Power cuts where `LOADTWIN_CUTS` sets none.
const CUTS: u32 = 400;
/// Starts of a board.
const STARTS: u32 = 12;
/// Most work that one interval leads to: an area is erased, a state is written.
const MOST_WORK: u32 = 60;

fn counted() -> CountedLoads {
    let counted = |load, gate| CountedLoad {
        load,
        scale: LevelScale::try_new(-0.5, 1.0).unwrap(),
        gate,
        ratio: 10.0,
    };
    [counted(0, 1), counted(1, 4)].into_iter().collect()
}

fn owner(image: usize) -> Owner {
    Owner {
        image_hash: 0xC0DE_0000 + image as u32,
        rate_hz: 100.0,
        counted: counted(),
    }
}

#[derive(Default)]
struct Figures {
    cuts: u32,
    starts: u32,
    kept: u32,
    most_work: u32,
}

struct Board {
    flash: Flash,
    /// What may be found at the next start with each image: what was kept last, and what is on
    /// its way; nothing before the first time.
    allowed: [Vec<Counts>; 2],
    /// Whether a state was kept for sure.
    is_kept: [bool; 2],
    /// What may be found once the work after a start has ended.
    certain: Vec<Counts>,
    random: ChaCha8Rng,
    tick: u32,
}

impl Board {
    fn new(seed: u64) -> Self {
        Self {
            flash: Flash::new(seed),
            allowed: [Vec::new(), Vec::new()],
            is_kept: [false; 2],
            certain: Vec::new(),
            random: ChaCha8Rng::seed_from_u64(seed),
            tick: 0,
        }
    }

    /// Starts with an image and checks what was kept.
    fn start(&mut self, image: usize) -> (CountKeeper, Memory) {
        let mut keeper = CountKeeper::open(&mut self.flash, LAYOUT, owner(image));
        let mut memory = Memory::none();
        memory.begin(&counted()).unwrap();
        let found = keeper.load(&mut self.flash, &mut memory);
        if found {
            memory.counts.restart();
        }
        let allowed = &mut self.allowed[image];
        // A first state that a cut touched may be lost, else something is found.
        assert!(found || !self.is_kept[image], "nothing was found");
        let found = allowed.iter().position(|counts| {
            let mut counts = (*counts).clone();
            counts.restart();
            found && counts == memory.counts
        });
        assert!(
            found.is_some() || memory.counts == Counts::try_new(&counted()).unwrap(),
            "other counts than those that were kept"
        );
        // What a cut left half written after it may be read another time: it was counted.
        let later = found.map_or(Vec::new(), |found| allowed[found..].to_vec());
        allowed.extend(found.map(|_| memory.counts.clone()));
        self.certain = later;
        self.certain.extend(found.map(|_| memory.counts.clone()));
        (keeper, memory)
    }

    /// Counts for an interval: around a few levels, in steps.
    fn count(&mut self, memory: &mut Memory) {
        let middle = self.random.random_range(5_u32..40);
        for _ in 0..self.random.random_range(1..60) {
            let missing = if self.random.random_range(0..50) == 0 {
                7
            } else {
                0
            };
            self.tick += 1 + missing;
            let mut load = || (middle + self.random.random_range(0..6)) as f32;
            let loads = [load(), load()];
            let sample = CountSample {
                tick: self.tick,
                advance: self.random.random(),
                loads,
            };
            memory.counts.push(&sample, missing);
        }
    }

    /// Runs until the power fails.
    fn run(&mut self, image: usize, figures: &mut Figures) {
        let (mut keeper, mut memory) = self.start(image);
        figures.starts += 1;
        let moments = [Moment::Before, Moment::Inside, Moment::After];
        let moment = moments[self.random.random_range(0..3)];
        self.flash.cut_at(self.random.random_range(0..300), moment);
        let mut is_anchored = false;
        loop {
            let mut work = 0;
            while keeper.is_busy() && self.flash.is_powered() {
                keeper.poll(&mut self.flash, &mut memory);
                work += 1;
                assert!(work < MOST_WORK, "the keeper does not come to an end");
            }
            figures.most_work = figures.most_work.max(work);
            if !self.flash.is_powered() {
                figures.cuts += 1;
                break;
            }
            let allowed = &mut self.allowed[image];
            if is_anchored {
                figures.kept += 1;
                allowed.drain(..allowed.len() - 1);
            } else {
                allowed.clone_from(&self.certain);
            }
            self.is_kept[image] |= !allowed.is_empty();
            is_anchored = true;
            self.count(&mut memory);
            settle(&mut memory.counts);
            self.allowed[image].push(memory.counts.clone());
            keeper.begin(&mut memory);
        }
        self.flash.power_on();
    }
}

fn settle(counts: &mut Counts) {
    for counts in counts.loads_mut() {
        counts.settle();
    }
}

fn histories(rots: bool) -> Figures {
    let cuts = std::env::var("LOADTWIN_CUTS").map_or(CUTS, |n| n.parse().expect("a number"));
    let mut figures = Figures::default();
    let mut seed = 0;
    while figures.cuts < cuts {
        seed += 1;
        let mut board = Board::new(seed);
        let rot = board.random.random_range(0..STARTS);
        let mut image = 0;
        for start in 0..STARTS {
            if board.random.random_range(0..6) == 0 {
                image = 1 - image;
            }
            if rots && start == rot {
                let word = board.random.random_range(0..WORDS);
                if board.random.random_range(0..2) == 0 {
                    for _ in 0..board.random.random_range(1..4) {
                        let bit = board.random.random_range(0..64);
                        board.flash.flip(word, bit);
                    }
                } else {
                    board.flash.weaken(word);
                }
            }
            board.run(image, &mut figures);
        }
    }
    eprintln!(
        "{} cuts, {} starts, kept {} times, at most {} pieces of work each",
        figures.cuts, figures.starts, figures.kept, figures.most_work
    );
    figures
}

#[test]
fn power_cuts_lose_at_most_what_was_being_kept() {
    let figures = histories(false);
    assert!(figures.kept > 2 * figures.cuts);
}

#[test]
fn a_damaged_word_loses_nothing() {
    histories(true);
}
