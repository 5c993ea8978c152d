//! Keys, signatures and uploads of model images.

pub mod key;
pub mod seal;
pub mod upload_protocol;
