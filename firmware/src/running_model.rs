//! Chooses the model image that a board runs from its flash slots at start, checks that it fits the
//! hardware, and takes a new image by an upload over the bus (`Models`).

use embedded_storage::nor_flash::NorFlash;
use loadtwin_common::hardware::Hardware;
use loadtwin_common::image::Image;
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::signed_image::{Header, Identity, ImageError};
use loadtwin_common::io::uds;

use crate::app::App;
use crate::raw_burst::Burst;
use crate::store::{Layout, Store};
use crate::upload::{Event, Upload};

/// The slots, and the upload that fills the one that does not run.
///
/// `N`: page of the flash plus [`BLOCK_OVERHEAD`](crate::upload::BLOCK_OVERHEAD).
/// Belongs below the estimator: it erases and checks signatures.
#[derive(Debug)]
pub struct Models<F, const N: usize> {
    store: Store<F>,
    upload: Upload<N>,
    room: &'static mut [u8],
    hardware: Hardware,
}

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

impl<F: NorFlash, const N: usize> Models<F, N> {
    /// Finds the image to run.
    ///
    /// `board`: key and machine; `room`: holds an image while it is checked and installed, and sets
    /// the longest image.
    ///
    /// # Errors
    /// As [`Store::boot`].
    pub fn boot(
        flash: F,
        layout: Layout,
        (board, hardware): (Option<Identity>, Hardware),
        room: &'static mut [u8],
    ) -> Result<Self, loadtwin_common::Error> {
        let store = Store::boot(flash, layout, board, |flash, at, len| {
            let image = read(flash, at, len, room).ok_or(ImageError::Flash)?;
            accept(image, &hardware)
        })?;
        Ok(Self {
            store,
            upload: Upload::new(),
            room,
            hardware,
        })
    }

    /// Gives an application without image the image to run, where there is one.
    ///
    /// `room`: as long as the longest payload; the model is run from there, so that no erase of
    /// the flash stops the estimator.
    pub fn start(&mut self, app: &mut App<'static>, room: &'static mut [u8]) {
        if let Some(active) = self.store.active().copied() {
            let (at, len) = (active.payload, active.header.length);
            let image = read(self.store.flash_mut(), at, len, room);
            // It was checked before it became the active one.
            let _ = image.map(|image| app.load(image, name(&active.header)));
        }
        app.set_refused(self.store.passed_over().map_or(0, ImageError::code));
    }

    /// Takes a frame from the bus; gives the one to send at once.
    pub fn on_frame(&mut self, frame: &Frame, now_us: u32) -> Option<Frame> {
        if frame.id != uds::REQUEST_ID {
            return None;
        }
        self.upload.on_frame(&frame.data, now_us).map(answer)
    }

    /// Works on the upload.
    pub fn poll(&mut self) -> Turn {
        let hardware = self.hardware;
        let accept = |image: &[u8]| accept(image, &hardware);
        let progress = self.upload.poll(&mut self.store, self.room, accept);
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
