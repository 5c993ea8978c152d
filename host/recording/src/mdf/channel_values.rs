//! Converts the samples of one MDF4 channel to f64 (`Decoded`), including half-precision floats and
//! tables of labels, which the decoder does not convert: a label among numbers is a missing sample.
//! `unit` reads the unit of a channel.
use falcon_mdf::blocks::{ConversionOutput, DataType};
use falcon_mdf::io::reader::BufferedSource;
use falcon_mdf::model::Signal;
use falcon_mdf::{Channel, Conversion, Mf4Error, parser};
use half::f16;

/// A channel as it is decoded and what its numbers then become.
#[derive(Clone)]
pub(super) struct Decoded {
    /// Read by the decoder, with another data type or conversion where it
    /// cannot do that of the file.
    pub(super) channel: Channel,
    then: Then,
}

#[derive(Clone)]
enum Then {
    /// The numbers as they are.
    Same,
    /// Words of IEEE 754 halves, then the conversion.
    Half(Conversion),
    /// A table that gives labels to some raw values, numbers to the others.
    PartlyLabels(Conversion),
}

impl Decoded {
    pub(super) fn of(channel: &Channel) -> Self {
        let mut read = channel.clone();
        let then = if is_half(channel) {
            read.data_type = match channel.data_type {
                DataType::FloatBe => DataType::UIntBe,
                _ => DataType::UIntLe,
            };
            Then::Half(std::mem::take(&mut read.conversion))
        } else if channel.is_numeric() && channel.conversion.output() == ConversionOutput::Text {
            let table = std::mem::take(&mut read.conversion);
            if has_numbers(&table) {
                Then::PartlyLabels(table)
            } else {
                // Labels of every value: the raw numbers are what it holds.
                Then::Same
            }
        } else {
            Then::Same
        };
        Self {
            channel: read,
            then,
        }
    }

    /// Whether it holds one number a sample.
    pub(super) fn is_number(&self) -> bool {
        self.channel.is_numeric() && !self.channel.is_array()
    }

    /// The samples, and which of them are missing: invalid ones and labels.
    pub(super) fn values(&self, signal: &Signal) -> Result<Values, Mf4Error> {
        let mut numbers = signal.values_f64()?;
        let mut missing = vec![false; numbers.len()];
        match &self.then {
            Then::Same => {}
            Then::Half(conversion) => {
                for v in &mut numbers {
                    let value = f64::from(f16::from_bits(*v as u16));
                    *v = conversion.convert(value, true);
                }
            }
            Then::PartlyLabels(table) => {
                let is_float = self.channel.is_float();
                for (v, missing) in numbers.iter_mut().zip(&mut missing) {
                    let raw = *v;
                    *v = table.convert(raw, is_float);
                    *missing = v.is_nan() && !raw.is_nan();
                }
            }
        }
        if let Some(valid) = signal.validity() {
            for (missing, valid) in missing.iter_mut().zip(valid) {
                *missing |= !valid;
            }
        }
        Ok(Values { numbers, missing })
    }
}

/// Samples of a channel.
pub(super) struct Values {
    pub(super) numbers: Vec<f64>,
    /// Whether the file says that there is no number.
    pub(super) missing: Vec<bool>,
}

fn is_half(channel: &Channel) -> bool {
    channel.is_float() && channel.bit_count == 16
}

/// Whether a table of labels also has numbers: then the labels mark what is no measurement.
fn has_numbers(table: &Conversion) -> bool {
    match table {
        Conversion::ValueToText {
            entries, default, ..
        }
        | Conversion::RangeToText {
            entries, default, ..
        } => entries
            .iter()
            .chain(default)
            .any(falcon_mdf::TableEntry::is_nested),
        _ => false,
    }
}

/// The unit of a channel: its own, else that of its conversion (ASAM MDF 4.1,
/// `cn_md_unit`: where it is nil the unit of the conversion holds), else that
/// of a single bit, which is true or false.
pub(super) fn unit(channel: &Channel, file: &BufferedSource) -> Option<String> {
    let own = channel.unit.trim();
    if !own.is_empty() {
        return Some(own.into());
    }
    let of_conversion = parser::parse_cn_block(file, channel.block_offset())
        .ok()
        .filter(|block| block.cc_conversion != 0)
        .and_then(|block| parser::parse_cc_block(file, block.cc_conversion).ok())
        .and_then(|block| parser::read_text(file, block.md_unit).ok())
        .map(|unit| unit.trim().to_owned())
        .filter(|unit| !unit.is_empty());
    of_conversion.or_else(|| {
        let is_bit = channel.bit_count == 1 && channel.is_numeric() && !channel.is_float();
        is_bit.then(|| "1".into())
    })
}
