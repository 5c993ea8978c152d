//! Defines the model image (`Image`), which holds everything that the estimator needs to know of a
//! machine: name, sample rate, CAN identifiers, and the model of its kind (gearbox, rotor, bearing
//! or drive). Decodes it from bytes; ranges are checked by the estimator.
//!
//! Made by `loadtwin build`, read by the firmware and by the host. It is
//! postcard; its tables are borrowed from the bytes, so that they stay in flash.

use serde::{Deserialize, Deserializer, Serialize};

use crate::Error;
use crate::bearing::BearingModel;
use crate::counting::CountedLoads;
use crate::drive::DriveModel;
use crate::drivetrain::GearboxModel;
use crate::io::raw::MAX_CHANNELS;
use crate::load_signal::LoadSignal;
use crate::rotor::RotorModel;

/// Version of the layout of [`Image`]; another one is refused.
pub const VERSION: u16 = 16;

/// A model image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Image<'a> {
    /// Version of this layout.
    pub version: u16,
    /// The machine's name.
    pub machine: &'a str,
    /// Sample rate (Hz), > 0.
    pub rate_hz: f32,
    /// First identifier of the frames on the bus.
    pub can_base: u16,
    /// Gain of the converter for each analogue channel, as its power of two (32: 5); none where the
    /// description states none.
    pub gains: [Option<u8>; MAX_CHANNELS],
    /// The loads that a board counts.
    pub counted: CountedLoads,
    /// The machine.
    pub model: Model<'a>,
}

/// What of an [`Image`] comes before its model, in the same order.
#[derive(Deserialize)]
struct Head<'a> {
    version: u16,
    #[serde(borrow)]
    machine: &'a str,
    rate_hz: f32,
    can_base: u16,
    gains: [Option<u8>; MAX_CHANNELS],
    counted: CountedLoads,
}

/// The kinds of machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(
    clippy::large_enum_variant,
    reason = "there is one model in a program, and no heap"
)]
pub enum Model<'a> {
    /// A torsional drivetrain with strain gauges.
    #[serde(borrow, deserialize_with = "apart")]
    Gearbox(GearboxModel<'a>),
    /// A flexible rotor with displacement sensors.
    #[serde(borrow, deserialize_with = "apart")]
    Rotor(RotorModel<'a>),
    /// A wheel bearing with strain gauges on its outer ring.
    #[serde(deserialize_with = "apart")]
    Bearing(BearingModel),
    /// An axis whose drive and motion are measured.
    #[serde(borrow, deserialize_with = "apart")]
    Drive(DriveModel<'a>),
}

/// Reads a machine in a call of its own: inlined, the stack would hold the temporaries of all kinds
/// at once.
#[inline(never)]
fn apart<'de, D, T>(deserializer: D) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    T::deserialize(deserializer)
}

impl<'a> Model<'a> {
    /// The gearbox, where it is one.
    pub fn gearbox(&self) -> Option<&GearboxModel<'a>> {
        match self {
            Self::Gearbox(model) => Some(model),
            Self::Rotor(_) | Self::Bearing(_) | Self::Drive(_) => None,
        }
    }
}

impl<'a> Image<'a> {
    /// Reads an image from the payload of its container.
    ///
    /// # Errors
    /// `Error::Malformed` when the bytes are not a whole image of this version.
    /// The ranges of its numbers are checked where the estimator is built.
    // Inlined, its temporaries would stay on the stack while the estimator is built.
    #[inline(never)]
    pub fn from_bytes(bytes: &'a [u8]) -> Result<Self, Error> {
        let (version, _) =
            postcard::take_from_bytes::<u16>(bytes).map_err(|_| Error::Malformed("image"))?;
        if version != VERSION {
            return Err(Error::Malformed("image version"));
        }
        let malformed = |_| Error::Malformed("image");
        // The head and the model one after the other: as one structure, the stack would hold the
        // model twice while it is read.
        let (head, model) = postcard::take_from_bytes::<Head>(bytes).map_err(malformed)?;
        let (model, []) = postcard::take_from_bytes(model).map_err(malformed)? else {
            return Err(Error::Malformed("image"));
        };
        Ok(Self {
            version: head.version,
            machine: head.machine,
            rate_hz: head.rate_hz,
            can_base: head.can_base,
            gains: head.gains,
            counted: head.counted,
            model,
        })
    }

    /// Unit of the load at `place` in the order of the estimates.
    pub fn load_unit(&self, place: usize) -> &str {
        match &self.model {
            Model::Drive(model) => &model.unit,
            Model::Rotor(_) => "N",
            // Fx, Fy, Fz, Mx, Mz.
            Model::Bearing(_) if place < 3 => "N",
            Model::Gearbox(_) | Model::Bearing(_) => "Nm",
        }
    }

    /// The loads in the order of the estimates.
    pub fn loads(&self) -> &[LoadSignal] {
        match &self.model {
            Model::Gearbox(model) => &model.loads,
            Model::Rotor(model) => &model.loads,
            Model::Bearing(model) => &model.loads,
            Model::Drive(model) => &model.loads,
        }
    }
}
