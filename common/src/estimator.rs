//! Runs the estimator of any machine, built from a model image (`Estimator::try_build`): takes one
//! raw sample and gives one estimate in each step. Also saves and restores its state, and gives the
//! lag of the estimates and the state and covariance of a rotor.

use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use crate::Error;
use crate::bearing::{BearingEstimator, BearingModel, BearingState};
use crate::drive::{DriveEstimator, DriveModel, DriveState};
use crate::drivetrain::{DrivetrainEstimator, DrivetrainState, GearboxModel};
use crate::image::{Image, Model};
use crate::io::estimate::Estimate;
use crate::io::raw::RawSample;
use crate::rotor::{RotorEstimator, RotorModel, RotorState};
use crate::saved_bytes::Seal;

/// Numbers of states that filters are compiled for; a model with another one
/// is filled up with states that nothing depends on.
pub const STATES: [usize; 4] = [6, 8, 12, 16];

/// Modal displacements and states of the filters of rotors, without and with biases of
/// sensors; a model with fewer is filled up with states that nothing depends on.
pub const ROTOR_SIZES: [(usize, usize); 2] = [(8, 20), (8, 24)];

/// Version of the layout of saved states; another one is refused.
pub const STATE_VERSION: u16 = 4;

/// Most bytes of a saved state: a number of 16 bits takes 3 bytes in postcard at most, one of 64
/// bits 10.
pub const MAX_STATE_BYTES: usize = 3 * size_of::<Kind<'static>>() / 2 + 64;

/// Version and error names of a saved state.
const STATE: Seal = Seal {
    version: STATE_VERSION,
    name: "saved state",
    version_name: "version of the saved state",
};

/// The estimator of one machine and its state.
///
/// Which machine and how many states it has is known only from the image;
/// the filters are compiled for each number of states, so that their loops
/// are of fixed length.
///
/// `step` is the same sequence of f32 operations on every target: same image
/// and same raw samples, same bits.
#[derive(Clone, Debug)]
pub struct Estimator<'a> {
    kind: Kind<'a>,
}

#[derive(Clone, Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "there is one line in a program, and no heap; whether it is large hangs on the target"
)]
enum Kind<'a> {
    Gearbox6(DrivetrainEstimator<'a, 6>, DrivetrainState<6>),
    Gearbox8(DrivetrainEstimator<'a, 8>, DrivetrainState<8>),
    Gearbox12(DrivetrainEstimator<'a, 12>, DrivetrainState<12>),
    Gearbox16(DrivetrainEstimator<'a, 16>, DrivetrainState<16>),
    Rotor20(RotorEstimator<'a, 8, 20>, RotorState<8, 20>),
    Rotor24(RotorEstimator<'a, 8, 24>, RotorState<8, 24>),
    Bearing(BearingEstimator, BearingState),
    Drive(DriveEstimator<'a>, DriveState),
}

// Inlined, the stack would hold the temporaries of all instances at once.
#[inline(never)]
fn start<'a, const NX: usize>(
    model: GearboxModel<'a>,
    kind: impl FnOnce(DrivetrainEstimator<'a, NX>, DrivetrainState<NX>) -> Kind<'a>,
    slot: &mut Option<Estimator<'a>>,
) -> Result<(), Error> {
    let gearbox = DrivetrainEstimator::try_build(model)?;
    let state = gearbox.start();
    *slot = Some(Estimator {
        kind: kind(gearbox, state),
    });
    Ok(())
}

#[inline(never)]
fn start_rotor<'a, const NZ: usize, const NX: usize>(
    model: RotorModel<'a>,
    kind: impl FnOnce(RotorEstimator<'a, NZ, NX>, RotorState<NZ, NX>) -> Kind<'a>,
    slot: &mut Option<Estimator<'a>>,
) -> Result<(), Error> {
    let rotor = RotorEstimator::try_build(model)?;
    let state = rotor.start();
    *slot = Some(Estimator {
        kind: kind(rotor, state),
    });
    Ok(())
}

#[inline(never)]
fn start_bearing(
    model: BearingModel,
    rate_hz: f32,
    slot: &mut Option<Estimator<'_>>,
) -> Result<(), Error> {
    let bearing = BearingEstimator::try_build(model, rate_hz)?;
    let state = bearing.start();
    *slot = Some(Estimator {
        kind: Kind::Bearing(bearing, state),
    });
    Ok(())
}

#[inline(never)]
fn start_drive<'a>(model: DriveModel<'a>, slot: &mut Option<Estimator<'a>>) -> Result<(), Error> {
    let drive = DriveEstimator::try_build(model)?;
    let state = drive.start();
    *slot = Some(Estimator {
        kind: Kind::Drive(drive, state),
    });
    Ok(())
}

fn save<S: Serialize>(state: &S, image: &[u8], bytes: &mut [u8]) -> Result<usize, Error> {
    let digest: [u8; 32] = Sha256::digest(image).into();
    STATE.write(&(digest, state), bytes)
}

fn restore<S: DeserializeOwned>(state: &mut S, image: &[u8], bytes: &[u8]) -> Result<(), Error> {
    let digest: [u8; 32] = Sha256::digest(image).into();
    if STATE.read_first::<[u8; 32]>(bytes)? != digest {
        return Err(Error::Malformed("image of the saved state"));
    }
    let (_, saved) = STATE.read::<([u8; 32], S)>(bytes)?;
    *state = saved;
    Ok(())
}

impl<'a> Estimator<'a> {
    /// The estimator of `image`, before its first sample.
    ///
    /// # Errors
    /// The name of the first number that is out of its range.
    pub fn try_build(image: Image<'a>) -> Result<Self, Error> {
        let mut slot = None;
        Self::build_into(&mut slot, image)?;
        slot.ok_or(Error::OutOfRange("number of states"))
    }

    /// As [`Self::try_build`], in its slot: an estimator is large, and where the stack is short a
    /// copy on it does not fit.
    ///
    /// # Errors
    /// As [`Self::try_build`]; the slot is as it was then.
    #[inline(never)]
    pub fn build_into(slot: &mut Option<Self>, image: Image<'a>) -> Result<(), Error> {
        if !(image.rate_hz > 0.0 && image.rate_hz.is_finite()) {
            return Err(Error::NotPositive("rate_hz"));
        }
        match image.model {
            Model::Gearbox(model) => match model.scale.len() {
                6 => start(model, Kind::Gearbox6, slot),
                8 => start(model, Kind::Gearbox8, slot),
                12 => start(model, Kind::Gearbox12, slot),
                16 => start(model, Kind::Gearbox16, slot),
                _ => Err(Error::OutOfRange("number of states")),
            },
            Model::Rotor(model) => match (model.modes, model.scale.len()) {
                (8, 20) => start_rotor(model, Kind::Rotor20, slot),
                (8, 24) => start_rotor(model, Kind::Rotor24, slot),
                _ => Err(Error::OutOfRange("number of states")),
            },
            Model::Bearing(model) => start_bearing(model, image.rate_hz, slot),
            Model::Drive(model) => start_drive(model, slot),
        }
    }

    /// Takes one sample and gives the estimate.
    pub fn step(&mut self, raw: &RawSample) -> Estimate {
        let mut estimate = Estimate::default();
        self.step_into(raw, &mut estimate);
        estimate
    }

    /// As [`Self::step`], in its place, whatever that holds: to copy an estimate takes as many
    /// instructions as a filter's update.
    pub fn step_into(&mut self, raw: &RawSample, estimate: &mut Estimate) {
        match &mut self.kind {
            Kind::Gearbox6(g, s) => g.step_into(s, raw, estimate),
            Kind::Gearbox8(g, s) => g.step_into(s, raw, estimate),
            Kind::Gearbox12(g, s) => g.step_into(s, raw, estimate),
            Kind::Gearbox16(g, s) => g.step_into(s, raw, estimate),
            Kind::Rotor20(r, s) => r.step_into(s, raw, estimate),
            Kind::Rotor24(r, s) => r.step_into(s, raw, estimate),
            Kind::Bearing(b, s) => b.step_into(s, raw, estimate),
            Kind::Drive(d, s) => d.step_into(s, raw, estimate),
        }
        estimate.contain();
    }

    /// Writes the state to `bytes` and gives how many it took: version, SHA-256 of `image`, of
    /// which the estimator was built, state (postcard), CRC-32 (ISO-HDLC, little endian) of all
    /// before it.
    ///
    /// ```
    /// # use loadtwin_common::estimator::{Estimator, MAX_STATE_BYTES};
    /// # use loadtwin_common::{Error, image::Image, io::raw::RawSample};
    /// # fn cut(image: &[u8], before: &[RawSample], after: &[RawSample]) -> Result<(), Error> {
    /// let mut first = Estimator::try_build(Image::from_bytes(image)?)?;
    /// for raw in before {
    ///     first.step(raw);
    /// }
    /// let mut bytes = [0; MAX_STATE_BYTES];
    /// let len = first.save(image, &mut bytes)?;
    /// let mut second = Estimator::try_build(Image::from_bytes(image)?)?;
    /// second.restore(image, &bytes[..len])?;
    /// for raw in after {
    ///     assert_eq!(second.step(raw), first.step(raw));
    /// }
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// `Error::OutOfRange` when `bytes` is too short; [`MAX_STATE_BYTES`] are enough.
    pub fn save(&self, image: &[u8], bytes: &mut [u8]) -> Result<usize, Error> {
        match &self.kind {
            Kind::Gearbox6(_, s) => save(s, image, bytes),
            Kind::Gearbox8(_, s) => save(s, image, bytes),
            Kind::Gearbox12(_, s) => save(s, image, bytes),
            Kind::Gearbox16(_, s) => save(s, image, bytes),
            Kind::Rotor20(_, s) => save(s, image, bytes),
            Kind::Rotor24(_, s) => save(s, image, bytes),
            Kind::Bearing(_, s) => save(s, image, bytes),
            Kind::Drive(_, s) => save(s, image, bytes),
        }
    }

    /// Continues a saved state to the bit.
    ///
    /// # Errors
    /// `Error::Malformed` when the bytes are not a whole saved state of this version, or were saved
    /// with another image; the state is as it was then.
    pub fn restore(&mut self, image: &[u8], bytes: &[u8]) -> Result<(), Error> {
        match &mut self.kind {
            Kind::Gearbox6(_, s) => restore(s, image, bytes),
            Kind::Gearbox8(_, s) => restore(s, image, bytes),
            Kind::Gearbox12(_, s) => restore(s, image, bytes),
            Kind::Gearbox16(_, s) => restore(s, image, bytes),
            Kind::Rotor20(_, s) => restore(s, image, bytes),
            Kind::Rotor24(_, s) => restore(s, image, bytes),
            Kind::Bearing(_, s) => restore(s, image, bytes),
            Kind::Drive(_, s) => restore(s, image, bytes),
        }
    }

    /// Samples by which the estimates lag: that of tick `k` is of `k` minus them.
    pub fn lag_samples(&self) -> usize {
        match &self.kind {
            Kind::Rotor20(r, _) => r.lag(),
            Kind::Rotor24(r, _) => r.lag(),
            _ => 0,
        }
    }

    /// How fast load `j` of a drivetrain moves beside its random walk; 0 where no error band was
    /// measured, and for other machines.
    pub fn load_movement(&self, j: usize) -> f32 {
        match &self.kind {
            Kind::Gearbox6(g, s) => g.load_movement(s, j),
            Kind::Gearbox8(g, s) => g.load_movement(s, j),
            Kind::Gearbox12(g, s) => g.load_movement(s, j),
            Kind::Gearbox16(g, s) => g.load_movement(s, j),
            _ => 0.0,
        }
    }

    /// The tracked speed of a rotor that the estimate is of [rad/s]; 0 for other machines.
    pub fn rotor_speed(&self) -> f32 {
        match &self.kind {
            Kind::Rotor20(r, s) => r.speed(s),
            Kind::Rotor24(r, s) => r.speed(s),
            _ => 0.0,
        }
    }

    /// Index of the noise level by which the next sample of a rotor is estimated: 0 is that of the
    /// description, and of other machines.
    pub fn rotor_level(&self) -> u8 {
        match &self.kind {
            Kind::Rotor20(r, s) => r.level(s),
            Kind::Rotor24(r, s) => r.level(s),
            _ => 0,
        }
    }

    /// Model error of a rotor that is allowed for, in the usual tolerances; 0 for other machines.
    pub fn rotor_tolerance(&self) -> f32 {
        match &self.kind {
            Kind::Rotor20(r, s) => r.tolerance(s),
            Kind::Rotor24(r, s) => r.tolerance(s),
            _ => 0.0,
        }
    }

    /// Covariance of a rotor's state by rows, in the image's scale, where it is not the steady one
    /// of the speed; of the last sample, also where estimates lag.
    pub fn rotor_covariance(&self) -> Option<&[f32]> {
        match &self.kind {
            Kind::Rotor20(r, s) => r.covariance(s),
            Kind::Rotor24(r, s) => r.covariance(s),
            _ => None,
        }
    }

    /// The modal displacements and the other states of a rotor that the estimate is of, in the
    /// image's scale, for displacements at nodes without sensor; empty for other machines.
    pub fn rotor_state(&self) -> &[f32] {
        match &self.kind {
            Kind::Rotor20(r, s) => r.state(s),
            Kind::Rotor24(r, s) => r.state(s),
            _ => &[],
        }
    }
}
