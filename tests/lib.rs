//! Tests that need more than one crate or a rig; see `tests/run`.
