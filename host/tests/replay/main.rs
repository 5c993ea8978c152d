//! Replays of the real binary: what a person reads beside the figures.

mod consistency;
mod page;
mod recorded;
mod refused;
mod resume;
