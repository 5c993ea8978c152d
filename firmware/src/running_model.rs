//! Chooses the model image that a board runs from its flash slots at start, checks that it fits the
//! hardware, takes a new image by an upload over the bus, and counts the loads of the one that runs
//! (`Models`).

use embedded_storage::nor_flash::NorFlash;
use heapless::Vec;
use loadtwin_common::counting::kept::WORD;
use loadtwin_common::counting::{CountSample, LoadCounts};
use loadtwin_common::hardware::Hardware;
use loadtwin_common::image::Image;
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::isotp::{Sender, Sending};
use loadtwin_common::io::signed_image::{Header, Identity, ImageError};
use loadtwin_common::io::uds;

use crate::app::App;
use crate::counting::Counting;
use crate::counts::{CountsLayout, Owner};
use crate::raw_burst::Burst;
use crate::room::Room;
use crate::store::{Layout, Store};
use crate::upload::{Asked, Event, Upload};

/// The slots, the upload that fills the one that does not run, and the counts of the one that runs.
///
/// `N`: page of the flash plus [`BLOCK_OVERHEAD`](crate::upload::BLOCK_OVERHEAD); `R`: longest
/// image (bytes); `L`: most loads that are counted. Belongs below the estimator: it erases and
/// checks signatures.
#[derive(Debug)]
pub struct Models<F, const N: usize, const R: usize, const L: usize> {
    store: Store<F>,
    upload: Upload<N>,
    room: &'static mut Room<R, L>,
    hardware: Hardware,
    counting: Counting,
    answer: Option<Sender<Answer>>,
}

/// An answer about kept counts.
type Answer = Vec<u8, { uds::MOST_READ as usize + 1 }>;

/// What a turn of the work on uploads led to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Turn {
    /// Frame to send.
    pub reply: Option<Frame>,
    /// Code of the refusal for the status frame, where an image was checked; 0: accepted.
    pub refused: Option<u8>,
    /// Raw samples that were asked for.
    pub burst: Option<Burst>,
}

impl<F: NorFlash, const N: usize, const R: usize, const L: usize> Models<F, N, R, L> {
    /// Finds the image to run.
    ///
    /// `board`: key and machine; `room`: holds an image while it is checked and installed, and sets
    /// the longest image.
    ///
    /// # Errors
    /// As [`Store::boot`].
    pub fn boot(
        flash: F,
        (layout, counts): (Layout, CountsLayout),
        (board, hardware): (Option<Identity>, Hardware),
        room: &'static mut Room<R, L>,
    ) -> Result<Self, loadtwin_common::Error> {
        let store = Store::boot(flash, layout, board, |flash, at, len| {
            let image = read(flash, at, len, room.image()).ok_or(ImageError::Flash)?;
            accept(image, &hardware)
        })?;
        Ok(Self {
            store,
            upload: Upload::new(),
            room,
            hardware,
            counting: Counting::new(counts),
            answer: None,
        })
    }

    /// Gives an application without image the image to run, where there is one, and reads the
    /// counts that were kept of it.
    ///
    /// `running`: as long as the longest payload; the model is run from there, so that no erase of
    /// the flash stops the estimator.
    // Inlined, its temporaries would stay on the stack while images are checked.
    #[inline(never)]
    pub fn start(&mut self, app: &mut App<'static>, running: &'static mut [u8]) {
        if let Some(active) = self.store.active().copied() {
            let (at, len) = (active.payload, active.header.length);
            let hash = name(&active.header);
            let image = read(self.store.flash_mut(), at, len, running);
            // It was checked before it became the active one.
            if let Some(image) = image
                && app.load(image, hash).is_ok()
                && let Some(owner) = owner(image, hash)
            {
                self.counting
                    .start(owner, self.store.flash_mut(), self.room);
            }
        }
        app.set_refused(self.store.passed_over().map_or(0, ImageError::code));
    }

    /// Takes a frame from the bus; gives the one to send at once.
    #[inline(never)]
    pub fn on_frame(&mut self, frame: &Frame, now_us: u32) -> Option<Frame> {
        if frame.id != uds::REQUEST_ID {
            return None;
        }
        if let Some(answer) = &mut self.answer {
            answer.on_frame(&frame.data, now_us);
        }
        self.upload.on_frame(&frame.data, now_us).map(answer)
    }

    /// Takes a sample of the counted loads.
    #[inline(never)]
    pub fn count(&mut self, sample: &CountSample) {
        self.counting.count(sample, self.room);
    }

    /// Works on the upload and on the counts.
    pub fn poll(&mut self, now_us: u32) -> Turn {
        if let Some(reply) = self.go_on_answering(now_us) {
            return Turn {
                reply: Some(reply),
                ..Turn::default()
            };
        }
        let needs_room = self.upload.needs_room(now_us);
        let is_ready = (self.counting).poll(needs_room, self.store.flash_mut(), self.room);
        if needs_room && !is_ready {
            return Turn::default();
        }
        let hardware = self.hardware;
        let accept = |image: &[u8]| accept(image, &hardware);
        let room = if needs_room {
            self.room.image()
        } else {
            &mut []
        };
        let progress = (self.upload).poll(&mut self.store, room, R, accept);
        if let Some(asked) = progress.asked {
            self.begin_answer(asked);
        }
        let refused = progress.event.map(|event| match event {
            Event::Accepted(_) => 0,
            Event::Refused(refusal) => refusal.code(),
        });
        Turn {
            reply: progress.answer.map(answer),
            refused,
            burst: progress.burst,
        }
    }

    /// The counts of each load, where they are counted.
    pub fn counted(&mut self) -> &mut [LoadCounts] {
        let memory = self.room.counting();
        memory.map_or(&mut [], |memory| memory.counts.loads_mut())
    }

    /// The next frame of an answer about kept counts.
    #[inline(never)]
    fn go_on_answering(&mut self, now_us: u32) -> Option<Frame> {
        match self.answer.as_mut()?.poll(now_us) {
            Sending::Frame(data) => Some(answer(data)),
            Sending::Wait(_) => None,
            Sending::Done | Sending::Failed(_) => {
                self.answer = None;
                None
            }
        }
    }

    /// Begins the answer to a request about kept counts.
    #[inline(never)]
    fn begin_answer(&mut self, asked: Asked) {
        let layout = self.counting.layout();
        let mut message = Answer::new();
        // There is room for the longest one.
        match asked {
            Asked::Layout => {
                let [high, low] = ((layout.area_bytes / uds::LAYOUT_UNIT) as u16).to_be_bytes();
                let [service, id @ ..] = uds::COUNTS_LAYOUT;
                let begin = [service + uds::POSITIVE, id[0], id[1]];
                _ = message.extend_from_slice(&begin);
                _ = message.extend_from_slice(&[layout.areas as u8, high, low]);
            }
            Asked::Memory { address, size } => {
                _ = message.push(uds::READ_MEMORY + uds::POSITIVE);
                let length = layout.area_bytes * layout.areas as u32;
                for address in address..address.saturating_add(size.into()) {
                    let byte = if address < length {
                        read_byte(self.store.flash_mut(), layout.start + address)
                    } else {
                        None
                    };
                    // What cannot be read is restored by the parity of its piece.
                    _ = message.push(byte.unwrap_or(0));
                }
            }
        }
        self.answer = Sender::new(message);
    }
}

/// A byte of a flash that may read whole words only.
fn read_byte<F: NorFlash>(flash: &mut F, at: u32) -> Option<u8> {
    let mut word = [0; WORD];
    let place = at % WORD as u32;
    flash.read(at - place, &mut word).ok()?;
    word.get(place as usize).copied()
}

/// Whose counts are kept with an image; none where it counts nothing.
#[inline(never)]
fn owner(image: &[u8], image_hash: u32) -> Option<Owner> {
    let image = Image::from_bytes(image).ok()?;
    (!image.counted.is_empty()).then(|| Owner::of(&image, image_hash))
}

fn answer(data: [u8; 8]) -> Frame {
    Frame {
        id: uds::ANSWER_ID,
        data,
    }
}

/// What status frames call an image.
fn name(header: &Header) -> u32 {
    let [a, b, c, d, ..] = header.digest;
    u32::from_le_bytes([a, b, c, d])
}

fn read<'a, F: NorFlash>(flash: &mut F, at: u32, len: u32, room: &'a mut [u8]) -> Option<&'a [u8]> {
    // Reads are whole units of the flash; the slot goes on behind the payload.
    let whole = (len as usize).next_multiple_of(F::READ_SIZE);
    let bytes = room.get_mut(..whole)?;
    flash.read(at, bytes).ok()?;
    bytes.get(..len as usize)
}

/// Whether the hardware serves the image, and an application takes it. One after the other: neither
/// copy of the model is on the stack with the other.
fn accept(image: &[u8], hardware: &Hardware) -> Result<(), ImageError> {
    is_served(image, hardware)?;
    is_taken(image)
}

#[inline(never)]
fn is_served(image: &[u8], hardware: &Hardware) -> Result<(), ImageError> {
    let model = Image::from_bytes(image).map_err(|_| ImageError::BadModel)?;
    let served = hardware.serves(&model);
    served.map_err(|_| ImageError::WrongHardware)
}

#[inline(never)]
fn is_taken(image: &[u8]) -> Result<(), ImageError> {
    let taken = App::without_image().load(image, 0);
    taken.map_err(|_| ImageError::BadModel)
}
