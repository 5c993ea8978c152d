//! Converts values of FMU variables (`Value`) to and from the C types of FMI 3.0 and 2.0
//! (`Native`): `f64`, `i32`, and truths as a byte (3.0) or an `int` (2.0).

use std::ffi::c_int;

use crate::instance::Value;
use crate::role::Type;

/// What C passes as an array and its length.
#[derive(Clone, Copy)]
pub(super) struct Array<P>(pub P, pub usize);

/// A value as one of the C types.
pub(super) trait Native: Copy {
    /// Type of the variables that have it.
    const OF: Type;
    /// From a value; none of another type.
    fn of(value: Value) -> Option<Self>;
    /// As a value.
    fn value(self) -> Value;
}

impl Native for f64 {
    const OF: Type = Type::Real;
    fn of(value: Value) -> Option<Self> {
        match value {
            Value::Real(value) => Some(value),
            _ => None,
        }
    }
    fn value(self) -> Value {
        Value::Real(self)
    }
}

/// A truth of FMI 3.0: a byte that is 0 or 1.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(super) struct Byte(pub u8);

impl Native for Byte {
    const OF: Type = Type::Boolean;
    fn of(value: Value) -> Option<Self> {
        match value {
            Value::Boolean(value) => Some(Self(u8::from(value))),
            _ => None,
        }
    }
    fn value(self) -> Value {
        Value::Boolean(self.0 != 0)
    }
}

/// A truth of FMI 2.0.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(super) struct Int(pub c_int);

impl Native for Int {
    const OF: Type = Type::Boolean;
    fn of(value: Value) -> Option<Self> {
        match value {
            Value::Boolean(value) => Some(Self(c_int::from(value))),
            _ => None,
        }
    }
    fn value(self) -> Value {
        Value::Boolean(self.0 != 0)
    }
}

impl Native for i32 {
    const OF: Type = Type::Integer;
    fn of(value: Value) -> Option<Self> {
        match value {
            Value::Integer(value) => Some(value),
            _ => None,
        }
    }
    fn value(self) -> Value {
        Value::Integer(self)
    }
}
