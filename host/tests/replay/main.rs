//! Test program of `loadtwin replay` on the real binary, one module for each subject.

mod consistency;
mod faulty_recordings;
mod refused;
mod report_page;
mod resume;
