//! Serialises a model with the machine's name, sample rate and CAN identifier to the payload bytes
//! of a model image (postcard).

use loadtwin_common::image::{Image, Model, VERSION};

use crate::error::BuildError;
use loadtwin_machine::Machine;

/// The image's payload for `machine` with its `model`.
pub(crate) fn packed(machine: &Machine, model: Model<'_>) -> Result<Vec<u8>, BuildError> {
    let counted = machine.counted_loads().map_err(BuildError::Model)?;
    let counted = (counted.as_slice().try_into()).map_err(|_| BuildError::TooLarge("[[count]]"))?;
    let image = Image {
        version: VERSION,
        machine: &machine.name,
        rate_hz: machine.rate_hz as f32,
        can_base: machine.can_base,
        counted,
        model,
    };
    postcard::to_stdvec(&image).map_err(|_| BuildError::TooLarge("the image"))
}
