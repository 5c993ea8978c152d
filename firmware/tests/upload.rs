//! Upload of images to a board with a simulated flash, frame by frame: acceptance, each
//! refusal, repeated blocks, interruption, forged frames.

mod signer;

use loadtwin_common::io::isotp::{FrameData, Sender, Sending, single_message};
use loadtwin_common::io::signed_image::{CRC, HEADER_LEN, ImageError, SIGNED_LEN};
use loadtwin_common::io::uds;
use loadtwin_firmware::simulated_flash::SimulatedFlash;
use loadtwin_firmware::store::{Layout, Store};
use loadtwin_firmware::upload::{BLOCK_OVERHEAD, Event, Upload};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use signer::{board, pair, signed, signed_for};

const PAGE: usize = 256;
const LAYOUT: Layout = Layout {
    start: 0,
    slot_bytes: 4 * PAGE as u32,
};
/// Polls that any request takes at most.
const POLLS: usize = 3 + 3;
type Flash = SimulatedFlash<PAGE, { 8 * PAGE / 8 }>;

/// A board as the bus sees it.
struct Board {
    store: Store<Flash>,
    upload: Upload<{ PAGE + BLOCK_OVERHEAD }>,
    room: [u8; 3 * PAGE],
    now_us: u32,
    events: Vec<Event>,
}

impl Board {
    fn new(flash: Flash) -> Self {
        Self {
            store: Store::boot(flash, LAYOUT, Some(board()), |_, _, _| Ok(())).unwrap(),
            upload: Upload::new(),
            room: [0; 3 * PAGE],
            now_us: 0,
            events: Vec::new(),
        }
    }

    /// A board that runs issue 5.
    fn in_service() -> Self {
        let mut board = Self::new(Flash::new(11));
        assert_eq!(board.send_image(&image(5)), Ok(()));
        board.restart()
    }

    fn restart(self) -> Self {
        Self::new(self.store.release())
    }

    fn running(&self) -> Option<u32> {
        self.store.active().map(|a| a.header.issue)
    }

    /// A frame in, its answers out.
    fn frame(&mut self, data: &[u8]) -> Vec<FrameData> {
        self.now_us = self.now_us.wrapping_add(250);
        let mut answers: Vec<_> = self
            .upload
            .on_frame(data, self.now_us)
            .into_iter()
            .collect();
        // At most "still at work", the check, a poll for each page, and the answer.
        let longest = self.room.len();
        for _ in 0..POLLS {
            let progress = self
                .upload
                .poll(&mut self.store, &mut self.room, longest, |_| Ok(()));
            answers.extend(progress.answer);
            self.events.extend(progress.event);
        }
        answers
    }

    /// A request in, the final answer out; `None` when there is none.
    fn request(&mut self, message: &[u8]) -> Option<Vec<u8>> {
        let mut sender = Sender::new(message.to_vec()).unwrap();
        let mut answer = None;
        loop {
            match sender.poll(self.now_us) {
                Sending::Frame(frame) => {
                    for data in self.frame(&frame) {
                        sender.on_frame(&data, self.now_us);
                        match single_message(&data) {
                            None | Some([uds::NEGATIVE, _, uds::PENDING]) => {}
                            Some(message) => answer = Some(message.to_vec()),
                        }
                    }
                }
                Sending::Wait(us) => self.now_us += us,
                Sending::Done => return answer,
                Sending::Failed(_) => return None,
            }
        }
    }

    /// A whole upload; the code of the refusal when there is one.
    fn send_image(&mut self, image: &[u8]) -> Result<(), u8> {
        for message in requests(image) {
            let answer = self.request(&message).ok_or(0u8)?;
            match answer[..] {
                [uds::NEGATIVE, service, code] => {
                    assert_eq!(service, message[0]);
                    return Err(code);
                }
                [first, ..] => assert_eq!(first, message[0] + uds::POSITIVE),
                [] => unreachable!("a single frame is never empty"),
            }
        }
        Ok(())
    }
}

fn announcement(length: usize) -> Vec<u8> {
    [&uds::DOWNLOAD_FORMAT[..], &(length as u32).to_be_bytes()].concat()
}

fn requests(image: &[u8]) -> Vec<Vec<u8>> {
    let blocks = (1u8..)
        .zip(image.chunks(PAGE))
        .map(|(n, block)| [&[uds::TRANSFER_DATA, n], block].concat());
    [announcement(image.len())]
        .into_iter()
        .chain(blocks)
        .chain([vec![uds::TRANSFER_EXIT]])
        .collect()
}

fn image(issue: u32) -> Vec<u8> {
    signed(&[issue as u8; 300], issue, 0, &pair(1))
}

/// The frames that a sender would send, without waiting for anyone.
fn frames(image: &[u8]) -> Vec<FrameData> {
    let permission = [0x30, 0, 0];
    let mut frames = Vec::new();
    for message in requests(image) {
        let mut sender = Sender::new(message).unwrap();
        while let Sending::Frame(frame) = sender.poll(0) {
            frames.push(frame);
            sender.on_frame(&permission, 0);
        }
    }
    frames
}

#[test]
fn an_upload_is_in_force_after_a_restart() {
    let mut board = Board::in_service();
    assert_eq!(board.running(), Some(5));
    assert_eq!(
        board.request(&announcement(image(6).len())),
        Some(vec![0x74, 0x20, 1, 2])
    );
    assert_eq!(board.send_image(&image(6)), Ok(()));
    assert_eq!(board.events, [Event::Accepted(6)]);
    assert_eq!(
        board.send_image(&image(7)),
        Err(ImageError::RestartPending.code())
    );
    assert_eq!(board.restart().running(), Some(6));
}

#[test]
fn each_refusal_is_answered_and_reported() {
    let unsigned = {
        let mut bytes = image(6);
        bytes[SIGNED_LEN..HEADER_LEN].fill(0);
        let (body, crc) = bytes.split_last_chunk_mut::<4>().unwrap();
        *crc = CRC.checksum(body).to_le_bytes();
        bytes
    };
    let changed = |at: usize| {
        let mut bytes = image(6);
        bytes[at] ^= 0x10;
        bytes
    };
    for (bytes, refusal) in [
        (changed(0), ImageError::BadMagic),
        (changed(5), ImageError::BadVersion),
        (changed(16), ImageError::BadLength),
        (image(6)[..427].to_vec(), ImageError::BadLength),
        (changed(8), ImageError::BadSignature),
        (signed(b"m", 6, 0, &pair(2)), ImageError::BadSignature),
        (unsigned, ImageError::Unsigned),
        (
            signed_for("another", b"m", 6, 0, &pair(1)),
            ImageError::WrongMachine,
        ),
        (image(5), ImageError::Downgrade),
        (image(4), ImageError::Downgrade),
        (changed(200), ImageError::BadCrc),
        (changed(427), ImageError::BadCrc),
        (signed(&[1; 700], 6, 0, &pair(1)), ImageError::TooLong),
    ] {
        let mut board = Board::in_service();
        assert_eq!(board.send_image(&bytes), Err(refusal.code()), "{refusal:?}");
        assert_eq!(board.events, [Event::Refused(refusal)]);
        assert_eq!(board.running(), Some(5));
        assert_eq!(board.restart().running(), Some(5));
    }
    let mut board = Board::new(Flash::new(1));
    board.store = Store::boot(Flash::new(1), LAYOUT, None, |_, _, _| Ok(())).unwrap();
    assert_eq!(board.send_image(&image(6)), Err(ImageError::NoKey.code()));
}

#[test]
fn requests_out_of_order_are_refused_and_repeated_blocks_written_once() {
    let bytes = image(6);
    let all = requests(&bytes);
    let mut board = Board::in_service();
    let no = |service, code| Some(vec![uds::NEGATIVE, service, code]);
    assert_eq!(
        board.request(&all[1]),
        no(uds::TRANSFER_DATA, uds::SEQUENCE_ERROR)
    );
    assert_eq!(
        board.request(&[uds::TRANSFER_EXIT]),
        no(uds::TRANSFER_EXIT, uds::SEQUENCE_ERROR)
    );
    assert_eq!(
        board.request(&[0x22, 0xF1, 0x90]),
        no(0x22, uds::OUT_OF_RANGE)
    );
    assert_eq!(
        board.request(&[0x3E, 0]),
        no(0x3E, uds::SERVICE_NOT_SUPPORTED)
    );
    assert_eq!(
        board.request(&[uds::REQUEST_DOWNLOAD, 0]),
        no(uds::REQUEST_DOWNLOAD, uds::OUT_OF_RANGE)
    );
    assert_eq!(
        board.request(&all[0][..10]),
        no(uds::REQUEST_DOWNLOAD, uds::INCORRECT_LENGTH)
    );
    assert_eq!(board.request(&all[0]).unwrap()[0], 0x74);
    assert_eq!(
        board.request(&[uds::TRANSFER_DATA]),
        no(uds::TRANSFER_DATA, uds::INCORRECT_LENGTH)
    );
    assert_eq!(
        board.request(&all[2]),
        no(uds::TRANSFER_DATA, uds::WRONG_BLOCK_COUNTER)
    );
    assert_eq!(board.request(&all[1]), Some(vec![0x76, 1]));
    let operations = board.store.flash().operations();
    assert_eq!(board.request(&all[1]), Some(vec![0x76, 1]));
    assert_eq!(board.store.flash().operations(), operations);
    assert_eq!(
        board.request(&[uds::TRANSFER_EXIT]),
        no(uds::TRANSFER_EXIT, uds::SEQUENCE_ERROR)
    );
    assert_eq!(board.request(&all[2]), Some(vec![0x76, 2]));
    assert_eq!(board.request(&[uds::TRANSFER_EXIT]), Some(vec![0x77]));
    assert_eq!(board.restart().running(), Some(6));
}

/// Every bit of the image changed on its way, every truncation: none accepted.
#[test]
fn every_bit_flip_and_truncation_on_the_bus_is_refused() {
    let bytes = signed(&[0xA5; 180], 6, 0, &pair(1));
    let mut board = Board::in_service();
    for bit in 0..bytes.len() * 8 {
        let mut bent = bytes.clone();
        bent[bit / 8] ^= 1 << (bit % 8);
        assert!(board.send_image(&bent).is_err(), "bit {bit}");
    }
    for length in 1..bytes.len() {
        assert!(
            board.send_image(&bytes[..length]).is_err(),
            "length {length}"
        );
    }
    assert!(board.events.iter().all(|e| matches!(e, Event::Refused(_))));
    assert_eq!(board.send_image(&bytes), Ok(()));
}

/// An upload that stops anywhere leaves the old image; the next one gets through.
#[test]
fn an_interrupted_upload_leaves_the_old_image() {
    let frames = frames(&image(6));
    for stop in 0..frames.len() - 1 {
        let mut board = Board::in_service();
        for data in &frames[..stop] {
            board.frame(data);
        }
        assert_eq!(board.running(), Some(5));
        let mut board = board.restart();
        assert_eq!(board.running(), Some(5));
        assert_eq!(board.send_image(&image(6)), Ok(()));
        assert_eq!(board.restart().running(), Some(6));
    }
}

/// A million frames by someone without the key, who has recorded every upload
/// so far: none changes what runs.
#[test]
fn a_million_forged_or_replayed_frames_are_refused() {
    let mut board = Board::in_service();
    let current = frames(&image(5));
    let older = frames(&image(4));
    let wrong_key = frames(&signed(&[9; 300], 9, 0, &pair(2)));
    // The header of an image that was signed but never finished, before a forged payload.
    let mut grafted = image(6);
    grafted[HEADER_LEN..].fill(9);
    let (body, crc) = grafted.split_last_chunk_mut::<4>().unwrap();
    *crc = CRC.checksum(body).to_le_bytes();
    let grafted = frames(&grafted);
    let mut random = ChaCha8Rng::seed_from_u64(20);
    let mut sent = 0;
    let mut answered = 0;
    let active_at = board.store.active().unwrap().payload - HEADER_LEN as u32;
    let slot_before = slot(&board, active_at);
    let operations = board.store.flash().operations();
    while sent < 1_000_000 {
        let mut burst = match random.random_range(0..6) {
            0 => current.clone(),
            1 => older.clone(),
            2 => wrong_key.clone(),
            3 => grafted.clone(),
            4 => (0..50).map(|_| random.random()).collect(),
            _ => (0..50)
                .map(|_| {
                    let mut data: FrameData = random.random();
                    data[0] = [0x02, 0x10, 0x21, 0x30][random.random_range(0..4)]
                        + data[0] % 16 * u8::from(data[1] > 127);
                    data
                })
                .collect(),
        };
        // Most recordings are spoiled somewhere: bits, order, doubles, losses.
        for _ in 0..random.random_range(0..4) {
            let [at, other] = [0; 2].map(|_| random.random_range(0..burst.len()));
            match random.random_range(0..4) {
                0 => burst[at][random.random_range(0..8)] ^= 1 << random.random_range(0..8),
                1 => burst.swap(at, other),
                2 => burst.insert(at, burst[at]),
                _ => drop(burst.remove(at)),
            }
        }
        sent += burst.len();
        for data in burst {
            answered += board.frame(&data).len();
        }
        // Long enough for the next burst to be heard.
        board.now_us = board.now_us.wrapping_add(6_000_000);
    }
    assert_eq!(
        board.store.flash().operations(),
        operations,
        "flash operations"
    );
    assert!(answered > 10_000, "the board listened: {answered}");
    assert!(
        board.events.len() > 1000,
        "uploads were checked: {}",
        board.events.len()
    );
    assert!(board.events.iter().all(|e| matches!(e, Event::Refused(_))));
    for refusal in [
        ImageError::Downgrade,
        ImageError::BadSignature,
        ImageError::BadDigest,
    ] {
        assert!(
            board.events.contains(&Event::Refused(refusal)),
            "none was {refusal:?}"
        );
    }
    assert_eq!(slot(&board, active_at), slot_before);
    assert_eq!(board.running(), Some(5));
    println!(
        "{sent} frames, {answered} answers, {} images refused",
        board.events.len()
    );
    let mut board = board.restart();
    assert_eq!(board.running(), Some(5));
    assert_eq!(board.send_image(&image(6)), Ok(()));
}

fn slot(board: &Board, at: u32) -> Vec<u8> {
    use embedded_storage::nor_flash::ReadNorFlash;
    let mut bytes = vec![0; LAYOUT.slot_bytes as usize];
    board.store.flash().clone().read(at, &mut bytes).unwrap();
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 700_000, failure_persistence: None, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]

    /// Frames of any length and content in any order between those of an upload.
    #[test]
    fn no_frames_make_the_upload_panic_or_accept(
        frames in prop::collection::vec((0..12u8, prop::collection::vec(any::<u8>(), 0..10)), 1..12),
    ) {
        let mut upload = Upload::<{ PAGE + BLOCK_OVERHEAD }>::new();
        STORE.with_borrow_mut(|store| {
            for (kind, data) in &frames {
                let start: &[u8] = match kind {
                    0 => &[0x10, 0x0B, 0x34, 0x00, 0x44, 0, 0, 0],
                    1 => &[0x21, 0, 0, 0, 1, 164],
                    2 => &[0x11, 0x02, 0x36, 1, b'L', b'T', b'M', b'I'],
                    3 => &[0x03, 0x36, 1],
                    4 => &[0x02, 0x36, 1],
                    5 => &[0x01, 0x37],
                    6 => &[0x22],
                    _ => &[],
                };
                let frame = [start, data].concat();
                upload.on_frame(&frame, u32::from(*kind) * 150_000);
                for _ in 0..POLLS {
                    let progress = upload.poll(store, &mut [0; 3 * PAGE], 3 * PAGE, |_| Ok(()));
                    prop_assert!(!matches!(progress.event, Some(Event::Accepted(_))));
                }
            }
            prop_assert_eq!(store.active().map(|a| a.header.issue), Some(5));
            Ok(())
        })?;
    }
}

thread_local! {
    static STORE: std::cell::RefCell<Store<Flash>> = std::cell::RefCell::new(Board::in_service().store);
}
