//! Drivers over `embedded-hal` 1.0, tested on the host with exact bus transactions.

pub mod ads131m04;
mod ads131m04_config;
