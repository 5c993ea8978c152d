//! Replays of the real binary: what a person reads beside the figures.

mod consistency;
mod faulty_recordings;
mod refused;
mod report_page;
mod resume;
