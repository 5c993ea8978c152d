//! Signs model images and uploads them to boards: key pairs ([`key`]), the container with signature
//! and CRC ([`seal`]), and the state machine of an upload, without a bus ([`upload_protocol`]).

pub mod key;
pub mod seal;
pub mod upload_protocol;
