//! Serialises a model with the machine's name, sample rate and CAN identifier to the payload bytes
//! of a model image (postcard).

use loadtwin_common::image::{Image, Model, VERSION};
use loadtwin_common::io::raw::MAX_CHANNELS;

use crate::error::BuildError;
use loadtwin_machine::{Channel, Machine};

/// The image's payload for `machine` with its `model`, which reads `channels`.
pub(crate) fn packed<'a>(
    machine: &Machine,
    channels: impl IntoIterator<Item = &'a Channel>,
    model: Model<'_>,
) -> Result<Vec<u8>, BuildError> {
    let mut gains = [None; MAX_CHANNELS];
    for (slot, channel) in gains.iter_mut().zip(channels) {
        let gain = channel.adc.and_then(|adc| adc.gain);
        *slot = gain.map(|gain| gain.trailing_zeros() as u8);
    }
    let counted = machine.counted_loads().map_err(BuildError::Model)?;
    let counted = (counted.as_slice().try_into()).map_err(|_| BuildError::TooLarge("[[count]]"))?;
    let image = Image {
        version: VERSION,
        machine: &machine.name,
        rate_hz: machine.rate_hz as f32,
        can_base: machine.can_base,
        gains,
        counted,
        model,
    };
    postcard::to_stdvec(&image).map_err(|_| BuildError::TooLarge("the image"))
}
