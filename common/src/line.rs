//! The straight line: raw sample in, estimate out, for any machine.

use crate::Error;
use crate::estimate::Estimate;
use crate::gearbox::{Gearbox, GearboxModel, GearboxState};
use crate::image::{Image, Model};
use crate::raw::RawSample;

/// Numbers of states that filters are compiled for; a model with another one
/// is filled up with states that nothing depends on.
pub const STATES: [usize; 4] = [6, 8, 12, 16];

/// The estimator of one machine and its state.
///
/// Which machine and how many states it has is known only from the image;
/// the filters are compiled for each number of states, so that their loops
/// are of fixed length.
///
/// `step` is the same sequence of f32 operations on every target: same image
/// and same raw samples, same bits.
#[derive(Clone, Debug)]
pub struct Line<'a> {
    kind: Kind<'a>,
}

#[derive(Clone, Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "there is one line in a program, and no heap"
)]
enum Kind<'a> {
    Gearbox6(Gearbox<'a, 6>, GearboxState<6>),
    Gearbox8(Gearbox<'a, 8>, GearboxState<8>),
    Gearbox12(Gearbox<'a, 12>, GearboxState<12>),
    Gearbox16(Gearbox<'a, 16>, GearboxState<16>),
}

fn start<const NX: usize>(
    model: GearboxModel<'_>,
) -> Result<(Gearbox<'_, NX>, GearboxState<NX>), Error> {
    let gearbox = Gearbox::try_build(model)?;
    let state = gearbox.start();
    Ok((gearbox, state))
}

impl<'a> Line<'a> {
    /// The line of `image`, before its first sample.
    ///
    /// # Errors
    /// The name of the first number that is out of its range.
    pub fn try_build(image: Image<'a>) -> Result<Self, Error> {
        if !(image.rate_hz > 0.0 && image.rate_hz.is_finite()) {
            return Err(Error::NotPositive("rate_hz"));
        }
        let Model::Gearbox(model) = image.model;
        let kind = match model.scale.len() {
            6 => start(model).map(|(g, s)| Kind::Gearbox6(g, s)),
            8 => start(model).map(|(g, s)| Kind::Gearbox8(g, s)),
            12 => start(model).map(|(g, s)| Kind::Gearbox12(g, s)),
            16 => start(model).map(|(g, s)| Kind::Gearbox16(g, s)),
            _ => Err(Error::OutOfRange("number of states")),
        }?;
        Ok(Self { kind })
    }

    /// Takes one sample and gives the estimate.
    pub fn step(&mut self, raw: &RawSample) -> Estimate {
        match &mut self.kind {
            Kind::Gearbox6(g, s) => g.step(s, raw),
            Kind::Gearbox8(g, s) => g.step(s, raw),
            Kind::Gearbox12(g, s) => g.step(s, raw),
            Kind::Gearbox16(g, s) => g.step(s, raw),
        }
    }
}
