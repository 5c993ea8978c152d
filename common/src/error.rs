//! Defines the error type of this crate (`Error`): why a parameter, a configuration or encoded
//! bytes are refused. Also checks values for being finite and for being positive.

use core::fmt;

/// Why a parameter, a configuration or encoded bytes are refused; carries the name of what is
/// wrong.
///
/// Steps of a filter built from a valid configuration do not return it for a
/// configuration reason; what a step meets is reported by its
/// [`Outcome`](crate::kalman::innovation::Outcome).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// The parameter must be greater than zero (for a matrix: positive definite).
    NotPositive(&'static str),
    /// The parameter, or a number computed from it, is NaN or infinite.
    NotFinite(&'static str),
    /// The parameter lies outside the range that its documentation gives.
    OutOfRange(&'static str),
    /// The matrix must be equal to its transpose.
    NotSymmetric(&'static str),
    /// The bytes are not what they should encode.
    Malformed(&'static str),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotPositive(name) => write!(f, "{name} must be positive"),
            Self::NotFinite(name) => write!(f, "{name} must be finite"),
            Self::OutOfRange(name) => write!(f, "{name} is out of range"),
            Self::NotSymmetric(name) => write!(f, "{name} must be symmetric"),
            Self::Malformed(name) => write!(f, "{name} is malformed"),
        }
    }
}

impl core::error::Error for Error {}

/// Checks that there are `len` values and that all are finite.
pub(crate) fn finite(values: &[f32], len: usize, name: &'static str) -> Result<(), Error> {
    if values.len() != len {
        Err(Error::OutOfRange(name))
    } else if values.iter().all(|value| value.is_finite()) {
        Ok(())
    } else {
        Err(Error::NotFinite(name))
    }
}

/// Checks that all values are finite and above zero.
pub(crate) fn positive(
    values: impl IntoIterator<Item = f32>,
    name: &'static str,
) -> Result<(), Error> {
    if values
        .into_iter()
        .all(|value| value > 0.0 && value.is_finite())
    {
        Ok(())
    } else {
        Err(Error::NotPositive(name))
    }
}
