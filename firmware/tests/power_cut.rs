//! Power cuts at every flash operation of an upload, on a simulated flash, in pairs and in rows of
//! eight: afterwards the old or the new image runs. Also without a cut: a refused image writes
//! nothing, an older one runs only with permission, wrong layouts are refused.

mod signer;

use std::thread;

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use loadtwin_common::Error;
use loadtwin_common::io::signed_image::{HEADER_LEN, ImageError, OVERHEAD};
use loadtwin_firmware::simulated_flash::{FlashError, Moment, SimulatedFlash};
use loadtwin_firmware::store::{Layout, Slot, Store};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use signer::{board, pair, signed, signed_for};

const PAGE: usize = 256;
const LAYOUT: Layout = Layout {
    start: PAGE as u32,
    slot_bytes: 3 * PAGE as u32,
};
type Flash = SimulatedFlash<PAGE, { 8 * PAGE / 8 }>;

const MOMENTS: [Moment; 3] = [Moment::Before, Moment::Inside, Moment::After];

fn boot(flash: Flash) -> Store<Flash> {
    Store::boot(flash, LAYOUT, Some(board()), |_, _, _| Ok(())).unwrap()
}

fn upload(store: &mut Store<Flash>, image: &[u8]) -> Result<(), ImageError> {
    store.begin(image, |_| Ok(()))?;
    while !store.install_page(image)? {}
    store.finish().map(|_| ())
}

/// An image of a page and a bit.
fn image(issue: u32) -> Vec<u8> {
    signed(&[issue as u8; PAGE - OVERHEAD + 40], issue, 0, &pair(1))
}

fn running(store: &Store<Flash>) -> Option<u32> {
    store.active().map(|a| a.header.issue)
}

/// A flash with issues 1 and 2 in its slots; 2 runs.
fn in_service() -> Flash {
    let mut store = boot(Flash::new(7));
    assert_eq!(running(&store), None);
    upload(&mut store, &image(1)).unwrap();
    let mut store = boot(store.release());
    assert_eq!(running(&store), Some(1));
    upload(&mut store, &image(2)).unwrap();
    let store = boot(store.release());
    assert_eq!(
        (running(&store), store.active().unwrap().slot),
        (Some(2), Slot::B)
    );
    store.release()
}

/// Operations of an undisturbed upload.
fn operations(flash: &Flash) -> u32 {
    let before = flash.operations();
    let mut store = boot(flash.clone());
    upload(&mut store, &image(3)).unwrap();
    store.flash().operations() - before
}

/// Where neither slot can be read at a start, what is accepted then runs at the next one, also
/// where the older image can be read again.
#[test]
fn an_image_that_is_read_again_does_not_supersede_a_newer_one() {
    let word_of =
        |slot: usize, at: usize| (LAYOUT.start + slot as u32 * LAYOUT.slot_bytes) as usize / 8 + at;
    // In the header, so that no record is valid, and in the payload.
    for at in [1, HEADER_LEN / 8 + 4] {
        let mut flash = in_service();
        for slot in 0..2 {
            flash.flip(word_of(slot, at), 3);
        }
        let mut store = boot(flash);
        assert_eq!(running(&store), None);
        upload(&mut store, &image(3)).unwrap();
        let written = usize::from(store.active().unwrap().slot == Slot::B);
        let mut flash = store.release();
        flash.flip(word_of(1 - written, at), 3);
        assert_eq!(running(&boot(flash)), Some(3));
    }
}

/// A board in service and what may run on it.
struct Board {
    flash: Flash,
    /// Runs for sure until an upload of another one comes to its last step.
    allowed: Vec<u32>,
}

impl Board {
    /// Starts it: one of the allowed images runs.
    fn start(&mut self) -> Store<Flash> {
        let store = boot(self.flash.clone());
        let issue = running(&store);
        assert!(
            issue.is_some_and(|i| self.allowed.contains(&i)),
            "{issue:?} runs of {:?}",
            self.allowed
        );
        store
    }

    /// Starts it, loses the power on the way of an upload, and gets it back.
    fn cut_upload(&mut self, issue: u32, image: &[u8], operation: u32, moment: Moment) {
        self.flash.cut_at(operation, moment);
        let mut store = self.start();
        match upload(&mut store, image) {
            // An upload that was answered with yes is in force, whatever the
            // cut did to what came after.
            Ok(()) => self.allowed = vec![issue],
            Err(_) => self.allowed.push(issue),
        }
        self.flash = store.release();
        self.flash.power_on();
    }

    /// Starts it; an upload without a cut is in force at the next start.
    fn recover(&mut self, issue: u32, image: &[u8]) {
        let mut store = self.start();
        upload(&mut store, image).unwrap();
        self.flash = store.release();
        self.allowed = vec![issue];
        self.start();
    }
}

/// Runs `part` on two threads and adds up.
fn on_two_threads(part: impl Fn(u32) -> u32 + Sync) -> u32 {
    thread::scope(|scope| {
        let other = scope.spawn(|| part(1));
        part(0) + other.join().unwrap()
    })
}

/// Every operation and moment, and a second cut at every operation and moment
/// of the attempt after it.
#[test]
fn two_cuts_anywhere_leave_the_old_or_the_new_image() {
    let service = in_service();
    let count = operations(&service);
    let images = [3, 4, 5].map(image);
    let cuts = on_two_threads(|half| {
        let mut cuts = 0;
        for first in (half..count).step_by(2) {
            for (moment, second) in MOMENTS
                .iter()
                .flat_map(|m| (0..count + 2).map(move |s| (*m, s)))
            {
                for second_moment in MOMENTS {
                    let mut flash = service.clone();
                    flash.reseed(
                        u64::from(first * 1009 + second * 31 + 5)
                            .wrapping_mul(0x9E37_79B9_7F4A_7C15),
                    );
                    let mut board = Board {
                        flash,
                        allowed: vec![2],
                    };
                    board.cut_upload(3, &images[0], first, moment);
                    board.cut_upload(4, &images[1], second, second_moment);
                    if second_moment == Moment::Inside {
                        board.recover(5, &images[2]);
                    } else {
                        board.start();
                    }
                    cuts += 2;
                }
            }
        }
        cuts
    });
    println!("{count} operations an upload, {cuts} cuts in pairs");
    assert!(cuts >= 30_000);
}

/// Up to eight cuts in a row, most where records are written or erased.
#[test]
fn cut_after_cut_leaves_an_image_that_runs() {
    let service = in_service();
    let count = operations(&service);
    let images: Vec<_> = (3..12).map(image).collect();
    let cuts = on_two_threads(|half| {
        let mut random = ChaCha8Rng::seed_from_u64(u64::from(half));
        let mut cuts = 0;
        while cuts < 36_000 {
            let mut flash = service.clone();
            flash.reseed(random.random());
            let mut board = Board {
                flash,
                allowed: vec![2],
            };
            for (issue, image) in (3..).zip(&images[..8]) {
                let operation = match random.random_range(0..4) {
                    0 => random.random_range(0..count),
                    1 => random.random_range(0..6),
                    _ => random.random_range(count - 3..count + 2),
                };
                let moment = MOMENTS[[1, 1, 1, 0, 2][random.random_range(0..5)]];
                board.cut_upload(issue, image, operation, moment);
                cuts += 1;
            }
            board.recover(11, &images[8]);
        }
        cuts
    });
    println!("{cuts} cuts in rows of eight");
    assert!(cuts >= 72_000);
}

/// The first image of a new board: nothing or the image.
#[test]
fn the_first_image_comes_whole_or_not_at_all() {
    let first = image(1);
    let count = operations(&Flash::new(3));
    for operation in 0..count {
        for moment in MOMENTS {
            let mut flash = Flash::new(u64::from(operation) + 99);
            flash.cut_at(operation, moment);
            let mut store = boot(flash);
            let reported = upload(&mut store, &first).is_ok();
            let mut flash = store.release();
            flash.power_on();
            let mut store = boot(flash);
            assert!(running(&store).is_some() || !reported);
            if running(&store).is_none() {
                upload(&mut store, &first).unwrap();
                store = boot(store.release());
            }
            assert_eq!(running(&store), Some(1));
        }
    }
}

#[test]
fn uploads_go_on_for_as_long_as_the_flash_lasts() {
    let mut flash = Flash::new(5);
    for issue in 1..200 {
        let mut store = boot(flash);
        upload(&mut store, &image(issue)).unwrap();
        flash = store.release();
        assert_eq!(running(&boot(flash.clone())), Some(issue));
    }
}

/// A flash that says that it erased a page of records, and did not.
struct Forgetful(Flash);

impl ErrorType for Forgetful {
    type Error = FlashError;
}

impl ReadNorFlash for Forgetful {
    const READ_SIZE: usize = Flash::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for Forgetful {
    const WRITE_SIZE: usize = Flash::WRITE_SIZE;
    const ERASE_SIZE: usize = Flash::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let page_of_slot = (from - LAYOUT.start) % LAYOUT.slot_bytes;
        if page_of_slot == LAYOUT.slot_bytes - PAGE as u32 {
            return Ok(());
        }
        self.0.erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        self.0.write(offset, bytes)
    }
}

#[test]
fn a_record_page_that_was_not_erased_takes_no_image() {
    let flash = Forgetful(in_service());
    let mut store = Store::boot(flash, LAYOUT, Some(board()), |_, _, _| Ok(())).unwrap();
    let image = image(3);
    store.begin(&image, |_| Ok(())).unwrap();
    assert_eq!(store.install_page(&image), Err(ImageError::Flash));
    assert_eq!(running(&boot(store.release().0)), Some(2));
}

#[test]
fn nothing_is_written_for_an_image_that_is_refused() {
    let good = image(3);
    let forged = signed(b"model", 3, 0, &pair(2));
    let foreign = signed_for("another", b"model", 3, 0, &pair(1));
    let old = signed(b"model", 1, 0, &pair(1));
    let same = signed(b"model", 2, 0, &pair(1));
    let long = signed(&[0; 2 * PAGE], 3, 0, &pair(1));
    let mut store = boot(in_service());
    let before = store.flash().operations();
    let check = |image: &[u8], length: usize| {
        (store.check_header(image, length as u32)).map(|header| header.issue)
    };
    assert_eq!(check(&good, good.len()), Ok(3));
    assert_eq!(check(&forged, forged.len()), Err(ImageError::BadSignature));
    assert_eq!(
        check(&foreign, foreign.len()),
        Err(ImageError::WrongMachine)
    );
    assert_eq!(check(&old, old.len()), Err(ImageError::Downgrade));
    assert_eq!(check(&same, same.len()), Err(ImageError::Downgrade));
    assert_eq!(check(&long, long.len()), Err(ImageError::TooLong));
    assert_eq!(check(&good, good.len() + 1), Err(ImageError::BadLength));
    assert_eq!(
        check(&good[..HEADER_LEN - 1], good.len()),
        Err(ImageError::BadLength)
    );
    // Nothing is erased for an image before all of it was checked.
    let mut damaged = good.clone();
    damaged[PAGE + 3] ^= 1;
    assert_eq!(store.begin(&damaged, |_| Ok(())), Err(ImageError::BadCrc));
    assert_eq!(
        store.begin(&good, |_| Err(ImageError::BadModel)),
        Err(ImageError::BadModel)
    );
    assert_eq!(store.begin(&good, |_| Ok(())), Ok(()));
    assert_eq!(store.flash().operations(), before);
    assert_eq!(running(&boot(store.release())), Some(2));
}

#[test]
fn the_signer_lets_an_older_image_run_once() {
    let back = signed(b"older", 1, 2, &pair(1));
    let mut store = boot(in_service());
    upload(&mut store, &back).unwrap();
    assert_eq!(
        upload(&mut store, &image(3)),
        Err(ImageError::RestartPending)
    );
    let mut store = boot(store.release());
    assert_eq!(running(&store), Some(1));
    assert_eq!(
        upload(&mut store, &back),
        Err(ImageError::Downgrade),
        "replayed"
    );
    upload(&mut store, &image(3)).unwrap();
    assert_eq!(running(&boot(store.release())), Some(3));
}

#[test]
fn a_model_that_the_firmware_refuses_is_passed_over_for_the_older_one() {
    let flash = in_service();
    let mut tried = Vec::new();
    let store = Store::boot(flash.clone(), LAYOUT, Some(board()), |flash, at, length| {
        let mut payload = vec![0; length as usize];
        flash.read(at, &mut payload).unwrap();
        tried.push(payload[0]);
        if payload[0] == 2 {
            return Err(ImageError::BadModel);
        }
        Ok(())
    });
    assert_eq!(running(&store.unwrap()), Some(1));
    assert_eq!(tried, [2, 1]);
    let keyless = Store::boot(flash, LAYOUT, None, |_, _, _| Ok(())).unwrap();
    assert_eq!(running(&keyless), None);
}

#[test]
fn a_layout_that_does_not_fit_is_refused() {
    for (start, slot_bytes, name) in [
        (1, 3 * PAGE as u32, "start"),
        (0, PAGE as u32, "slot_bytes"),
        (0, 2 * PAGE as u32 + 8, "slot_bytes"),
        (0, 5 * PAGE as u32, "slot_bytes"),
        (0, u32::MAX - 255, "slot_bytes"),
    ] {
        let layout = Layout { start, slot_bytes };
        let store = Store::boot(Flash::new(1), layout, None, |_, _, _| Ok(()));
        assert_eq!(store.err(), Some(Error::OutOfRange(name)), "{layout:?}");
    }
}
