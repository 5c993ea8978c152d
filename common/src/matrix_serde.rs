//! Serialises `f32` vectors and matrices whose dimensions are type parameters as one tuple of
//! numbers, and reads them back, for `#[serde(with)]`.

use core::fmt;
use core::marker::PhantomData;

use nalgebra::SVector;
use serde::de::{Error, SeqAccess, Visitor};
use serde::ser::SerializeTuple;
use serde::{Deserializer, Serializer};

/// Vectors and matrices that lie in memory without gaps.
pub trait Flat: Sized {
    /// All numbers 0.
    fn zeroed() -> Self;
    /// The numbers in the order of memory.
    fn values(&self) -> &[f32];
    /// The same, to be written.
    fn values_mut(&mut self) -> &mut [f32];
}

impl<const N: usize> Flat for [f32; N] {
    fn zeroed() -> Self {
        [0.0; N]
    }

    fn values(&self) -> &[f32] {
        self
    }

    fn values_mut(&mut self) -> &mut [f32] {
        self
    }
}

impl<const N: usize, const M: usize> Flat for [[f32; N]; M] {
    fn zeroed() -> Self {
        [[0.0; N]; M]
    }

    fn values(&self) -> &[f32] {
        self.as_flattened()
    }

    fn values_mut(&mut self) -> &mut [f32] {
        self.as_flattened_mut()
    }
}

impl<const N: usize, const M: usize, const L: usize> Flat for [[[f32; N]; M]; L] {
    fn zeroed() -> Self {
        [[[0.0; N]; M]; L]
    }

    fn values(&self) -> &[f32] {
        self.as_flattened().as_flattened()
    }

    fn values_mut(&mut self) -> &mut [f32] {
        self.as_flattened_mut().as_flattened_mut()
    }
}

impl<const N: usize> Flat for SVector<f32, N> {
    fn zeroed() -> Self {
        Self::zeros()
    }

    fn values(&self) -> &[f32] {
        self.as_slice()
    }

    fn values_mut(&mut self) -> &mut [f32] {
        self.as_mut_slice()
    }
}

pub(crate) fn serialize<S: Serializer, F: Flat>(
    flat: &F,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let values = flat.values();
    let mut tuple = serializer.serialize_tuple(values.len())?;
    for value in values {
        tuple.serialize_element(value)?;
    }
    tuple.end()
}

struct Values<F>(PhantomData<F>);

impl<'de, F: Flat> Visitor<'de> for Values<F> {
    type Value = F;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} numbers", F::zeroed().values().len())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<F, A::Error> {
        let mut flat = F::zeroed();
        for (i, value) in flat.values_mut().iter_mut().enumerate() {
            *value = (seq.next_element()?).ok_or_else(|| A::Error::invalid_length(i, &self))?;
        }
        Ok(flat)
    }
}

pub(crate) fn deserialize<'de, D: Deserializer<'de>, F: Flat>(
    deserializer: D,
) -> Result<F, D::Error> {
    deserializer.deserialize_tuple(F::zeroed().values().len(), Values(PhantomData))
}
