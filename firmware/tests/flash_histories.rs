//! Random histories of a board on a simulated flash, each of twelve uploads with power cuts,
//! flipped bits and worn cells: after every start the newest image that is whole runs.
//!
//! `LOADTWIN_HISTORIES` sets how many of each kind; 100 000 in all were run for the figures in
//! docs/reference/boards.md.

mod signer;

use loadtwin_common::io::signed_image::{ImageError, OVERHEAD};
use loadtwin_firmware::simulated_flash::{Moment, SimulatedFlash};
use loadtwin_firmware::store::{Layout, Slot, Store};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use signer::{board, pair, signed, signed_for};

const PAGE: usize = 256;
const SLOT_WORDS: usize = 4 * PAGE / 8;
const LAYOUT: Layout = Layout {
    start: 0,
    slot_bytes: 4 * PAGE as u32,
};
/// Uploads in the life of a board.
const UPLOADS: u32 = 12;
type Flash = SimulatedFlash<PAGE, { 8 * PAGE / 8 }>;

fn boot(flash: Flash) -> Store<Flash> {
    Store::boot(flash, LAYOUT, Some(board()), |_, _, _| Ok(())).unwrap()
}

fn upload(store: &mut Store<Flash>, image: &[u8]) -> Result<(), ImageError> {
    store.begin(image, |_| Ok(()))?;
    while !store.install_page(image)? {}
    store.finish().map(|_| ())
}

fn running(store: &Store<Flash>) -> Option<u32> {
    store.active().map(|a| a.header.issue)
}

/// What happens to the flash beside cuts.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Nothing,
    /// The image that runs rots while the power is off.
    Rot,
    /// The image that runs rots while it runs.
    RotWhileRunning,
    /// A cell anywhere wears out.
    Wear,
}

/// The slots of the flash and what stands in them as a test knows it.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    /// Issue that was accepted last in each slot.
    issue: [Option<u32>; 2],
    /// Whether the flash has spoiled it since.
    spoiled: [bool; 2],
    /// An upload whose answer did not come; it may be in force.
    open: Option<(usize, u32)>,
}

#[derive(Default)]
struct Counts {
    uploads: u32,
    cuts: u32,
    damages: u32,
    refused: u32,
    fell_back: u32,
    none: u32,
}

struct Life {
    kind: Kind,
    random: ChaCha8Rng,
    known: Known,
    counts: Counts,
}

fn index(slot: Slot) -> usize {
    usize::from(slot == Slot::B)
}

impl Life {
    /// Starts the board: the newest image that is whole runs, or, where its answer was lost, the
    /// upload that was under way.
    fn start(&mut self, flash: Flash) -> Store<Flash> {
        let store = boot(flash);
        let now = running(&store);
        let known = &mut self.known;
        if let (Some((slot, issue)), Some(runs)) = (known.open, now)
            && issue == runs
        {
            known.issue[slot] = Some(issue);
            known.spoiled[slot] = false;
        }
        known.open = None;
        let whole = (0..2)
            .filter(|s| !known.spoiled[*s])
            .filter_map(|s| known.issue[s]);
        let best = whole.max();
        let newest = known.issue.iter().flatten().copied().max();
        assert!(
            now >= best,
            "{:?}: {now:?} runs of {:?}, spoiled {:?}",
            self.kind,
            known.issue,
            known.spoiled
        );
        if let Some(now) = now {
            assert!(known.issue.contains(&Some(now)), "{now} was never accepted");
            self.counts.fell_back += u32::from(Some(now) != newest);
        } else {
            self.counts.none += u32::from(newest.is_some());
        }
        store
    }

    fn damage(&mut self, flash: &mut Flash, slot: usize, words: usize) {
        let word = slot * SLOT_WORDS + self.random.random_range(0..words);
        if self.random.random() {
            flash.flip(word, self.random.random());
        } else {
            flash.weaken(word);
        }
        self.known.spoiled[slot] = true;
        self.counts.damages += 1;
    }

    fn live(&mut self, images: &[Vec<u8>], foreign: &[u8]) {
        let mut flash = Flash::new(self.random.random());
        for image in &images[..UPLOADS as usize] {
            let mut store = self.start(flash);
            let active = store.active().copied();
            assert_eq!(upload(&mut store, foreign), Err(ImageError::WrongMachine));
            if let (Kind::RotWhileRunning, Some(active), true) =
                (self.kind, active, self.random.random())
            {
                self.damage(store.flash_mut(), index(active.slot), SLOT_WORDS);
            }
            self.upload(&mut store, image);
            flash = store.release();
            flash.power_on();
            match (self.kind, active) {
                (Kind::Rot, Some(active)) if self.random.random_range(0..3) == 0 => {
                    let words = (active.header.length as usize + OVERHEAD) / 8;
                    self.damage(&mut flash, index(active.slot), words);
                }
                (Kind::Wear, _) if self.random.random_range(0..6) == 0 => {
                    let word = self.random.random_range(0..2 * SLOT_WORDS);
                    flash.stick(word, self.random.random(), self.random.random());
                    self.known.spoiled[word / SLOT_WORDS] = true;
                    self.counts.damages += 1;
                }
                _ => {}
            }
        }
        self.start(flash);
    }

    fn upload(&mut self, store: &mut Store<Flash>, image: &[u8]) {
        let issue = u32::from_le_bytes(image[8..12].try_into().unwrap());
        let cut = self.random.random_range(0..5) < 3;
        if cut {
            let moment =
                [Moment::Before, Moment::Inside, Moment::After][self.random.random_range(0..3)];
            let at = self.random.random_range(0..90);
            store.flash_mut().cut_at(at, moment);
            self.counts.cuts += 1;
        }
        let before = store.flash().operations();
        let kept = store.active().map(|a| index(a.slot));
        let outcome = upload(store, image);
        let known = &mut self.known;
        // The slot that was written is the one that was not kept.
        let slot = store.installed().map_or(kept.map_or(0, |k| 1 - k), index);
        self.counts.uploads += 1;
        if outcome.is_ok() {
            known.issue[slot] = Some(issue);
            known.spoiled[slot] = false;
            return;
        }
        self.counts.refused += u32::from(!cut);
        if store.flash().operations() != before {
            known.open = Some((slot, issue));
            // What stood there before is gone, or may be.
            known.spoiled[slot] = true;
        }
    }
}

#[test]
fn the_newest_whole_image_runs_whatever_the_flash_does() {
    let each = std::env::var("LOADTWIN_HISTORIES").map_or(400, |n| n.parse().unwrap());
    let images: Vec<_> = (1..=UPLOADS)
        .map(|i| signed(&vec![i as u8; 40 + (i as usize * 97) % 560], i, 0, &pair(1)))
        .collect();
    let foreign = signed_for("another", &[7; 99], 99, 0, &pair(1));
    for kind in [Kind::Nothing, Kind::Rot, Kind::RotWhileRunning, Kind::Wear] {
        let mut counts = Counts::default();
        for seed in 0..each {
            let mut life = Life {
                kind,
                random: ChaCha8Rng::seed_from_u64(seed),
                known: Known::default(),
                counts,
            };
            life.live(&images, &foreign);
            counts = life.counts;
        }
        let c = &counts;
        println!(
            "{kind:?}: {each} lives, {} uploads, {} cuts, {} damages; fell back {}, none whole {}, \
             refused without a cut {}",
            c.uploads, c.cuts, c.damages, c.fell_back, c.none, c.refused
        );
        assert!(kind == Kind::Nothing || c.damages > c.uploads / 20);
        assert!(kind != Kind::Nothing || c.fell_back + c.none + c.refused == 0);
    }
}
