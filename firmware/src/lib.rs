//! The loadtwin estimator on a microcontroller.
#![no_std]
#![forbid(unsafe_code)]
