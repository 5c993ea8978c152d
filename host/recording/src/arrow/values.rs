//! Converts one Arrow column to f64 (`Values`): numbers, booleans, decimals, dictionaries, text as
//! the layout states, times in seconds since the first time stamp or since 1970; null becomes NaN.
//! Also states which column types are numbers, times or text.
use arrow_array::cast::AsArray;
use arrow_array::types::{
    ArrowPrimitiveType, Decimal32Type, Decimal64Type, Decimal128Type, Float16Type, Float32Type,
    Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type, UInt16Type, UInt32Type,
    UInt64Type,
};
use arrow_array::{Array, ArrayRef};
use arrow_schema::{DataType, TimeUnit};

use crate::csv::Kind;
use crate::error::{Problem, Row};
use crate::shown;

/// Whether a column of this type becomes numbers.
pub(crate) fn is_number(data_type: &DataType) -> bool {
    match data_type {
        DataType::Boolean
        | DataType::Float16
        | DataType::Float32
        | DataType::Float64
        | DataType::Decimal32(..)
        | DataType::Decimal64(..)
        | DataType::Decimal128(..)
        | DataType::Timestamp(..)
        | DataType::Duration(_)
        | DataType::Time32(_)
        | DataType::Time64(_) => true,
        DataType::Dictionary(_, values) => is_number(values),
        other => other.is_integer(),
    }
}

/// The unit of a type that has one by itself.
pub(super) fn unit(data_type: &DataType) -> Option<&'static str> {
    match data_type {
        DataType::Boolean => Some("1"),
        DataType::Dictionary(_, values) => unit(values),
        _ => is_time(data_type).then_some("s"),
    }
}

/// Whether its values are times, read as seconds.
pub(super) fn is_time(data_type: &DataType) -> bool {
    matches!(
        data_type,
        DataType::Timestamp(..) | DataType::Duration(_) | DataType::Time32(_) | DataType::Time64(_)
    )
}

/// Whether it is a column of text.
pub(super) fn is_text(data_type: &DataType) -> bool {
    match data_type {
        DataType::Dictionary(_, values) => is_text(values),
        other => other.is_string(),
    }
}

/// Where the seconds of timestamps begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Since {
    /// At the first timestamp of the recording.
    First,
    /// At 1970-01-01 UTC, so that recordings follow one another.
    Epoch,
}

/// A column of Arrow, appended as f64.
pub(super) struct Values {
    /// First timestamp, in its own unit: seconds are counted from it.
    origin: Option<i64>,
    since: Since,
    /// How its text is read, where it is text.
    text: Option<Kind>,
    /// Its name.
    name: String,
}

impl Values {
    pub(super) fn new(name: String, text: Option<Kind>, since: Since) -> Self {
        Self {
            origin: None,
            since,
            text,
            name,
        }
    }

    /// Appends the values as f64, NaN where there is none.
    pub(super) fn append(&mut self, values: &ArrayRef, to: &mut Vec<f64>) -> Result<(), Problem> {
        match values.data_type() {
            DataType::Boolean => {
                to.extend(
                    values
                        .as_boolean()
                        .iter()
                        .map(|v| v.map_or(f64::NAN, f64::from)),
                );
            }
            DataType::Float64 => extend::<Float64Type>(values, to, |v| v),
            DataType::Float32 => extend::<Float32Type>(values, to, f64::from),
            DataType::Float16 => extend::<Float16Type>(values, to, f64::from),
            DataType::Int8 => extend::<Int8Type>(values, to, f64::from),
            DataType::Int16 => extend::<Int16Type>(values, to, f64::from),
            DataType::Int32 => extend::<Int32Type>(values, to, f64::from),
            DataType::Int64 => extend::<Int64Type>(values, to, |v| v as f64),
            DataType::UInt8 => extend::<UInt8Type>(values, to, f64::from),
            DataType::UInt16 => extend::<UInt16Type>(values, to, f64::from),
            DataType::UInt32 => extend::<UInt32Type>(values, to, f64::from),
            DataType::UInt64 => extend::<UInt64Type>(values, to, |v| v as f64),
            DataType::Decimal32(_, scale) => {
                let scale = *scale;
                extend::<Decimal32Type>(values, to, |v| decimal(f64::from(v), scale));
            }
            DataType::Decimal64(_, scale) => {
                let scale = *scale;
                extend::<Decimal64Type>(values, to, |v| decimal(v as f64, scale));
            }
            DataType::Decimal128(_, scale) => {
                let scale = *scale;
                extend::<Decimal128Type>(values, to, |v| decimal(v as f64, scale));
            }
            DataType::Dictionary(..) => self.append_dictionary(values, to)?,
            other if is_time(other) => self.append_time(values, to)?,
            DataType::Utf8 => self.append_text(values.as_string::<i32>(), to)?,
            DataType::LargeUtf8 => self.append_text(values.as_string::<i64>(), to)?,
            DataType::Utf8View => self.append_text(values.as_string_view(), to)?,
            other => return Err(unexpected(other)),
        }
        Ok(())
    }

    fn append_dictionary(&mut self, values: &ArrayRef, to: &mut Vec<f64>) -> Result<(), Problem> {
        let Some(dictionary) = values.as_any_dictionary_opt() else {
            return Err(unexpected(values.data_type()));
        };
        let mut words = Vec::new();
        self.append(dictionary.values(), &mut words)?;
        let keys = dictionary.normalized_keys();
        to.extend(keys.iter().enumerate().map(|(i, &key)| {
            let word = words.get(key).copied().filter(|_| values.is_valid(i));
            word.unwrap_or(f64::NAN)
        }));
        Ok(())
    }

    fn append_text<'a>(
        &self,
        texts: impl IntoIterator<Item = Option<&'a str>>,
        to: &mut Vec<f64>,
    ) -> Result<(), Problem> {
        let Some(kind) = &self.text else {
            return Err(unexpected(&DataType::Utf8));
        };
        for text in texts {
            let cell = text.map_or("", str::trim);
            let value = kind.value(cell.as_bytes(), false);
            if value.is_none() && !cell.is_empty() {
                return Err(Problem::Cell {
                    row: Row {
                        row: to.len() as u64 + 1,
                        line: None,
                    },
                    column: self.name.clone(),
                    found: shown(cell),
                    allowed: kind.allowed(),
                });
            }
            to.push(value.unwrap_or(f64::NAN));
        }
        Ok(())
    }

    /// Times in seconds: a duration as it is, a timestamp since the first one. Their difference is
    /// taken in integers, and one division makes it the nearest number to the decimal. Since 1970,
    /// whole seconds and nanoseconds are converted apart: together they have more digits than f64.
    fn append_time(&mut self, values: &ArrayRef, to: &mut Vec<f64>) -> Result<(), Problem> {
        let (whole, per_second) = whole_times(values)?;
        let whole = whole.as_primitive::<Int64Type>();
        let is_stamp = matches!(values.data_type(), DataType::Timestamp(..));
        if is_stamp && self.since == Since::Epoch {
            let per_second = per_second as i64;
            let ns = 1_000_000_000 / per_second;
            to.extend(whole.iter().map(|v| {
                v.map_or(f64::NAN, |v| {
                    let after = v.rem_euclid(per_second) * ns;
                    v.div_euclid(per_second) as f64 + after as f64 * 1e-9
                })
            }));
            return Ok(());
        }
        if is_stamp && self.origin.is_none() {
            self.origin = whole.iter().flatten().next();
        }
        let origin = self.origin.filter(|_| is_stamp).unwrap_or(0);
        to.extend(whole.iter().map(|v| {
            let since = v.and_then(|v| v.checked_sub(origin));
            since.map_or(f64::NAN, |since| since as f64 / per_second)
        }));
        Ok(())
    }
}

/// The integers that times are stored as, and how many of them are a second.
fn whole_times(values: &ArrayRef) -> Result<(ArrayRef, f64), Problem> {
    let unit = match values.data_type() {
        DataType::Timestamp(unit, _)
        | DataType::Duration(unit)
        | DataType::Time32(unit)
        | DataType::Time64(unit) => *unit,
        other => return Err(unexpected(other)),
    };
    let per_second = match unit {
        TimeUnit::Second => 1.0,
        TimeUnit::Millisecond => 1e3,
        TimeUnit::Microsecond => 1e6,
        TimeUnit::Nanosecond => 1e9,
    };
    let narrow = matches!(values.data_type(), DataType::Time32(_));
    let stored = if narrow {
        DataType::Int32
    } else {
        DataType::Int64
    };
    let data = values.to_data().into_builder().data_type(stored);
    let whole = arrow_array::make_array(data.build().map_err(|_| unexpected(values.data_type()))?);
    if !narrow {
        return Ok((whole, per_second));
    }
    let wide: arrow_array::Int64Array = whole
        .as_primitive::<Int32Type>()
        .iter()
        .map(|v| v.map(i64::from))
        .collect();
    Ok((std::sync::Arc::new(wide), per_second))
}

fn unexpected(data_type: &DataType) -> Problem {
    Problem::Damaged {
        format: "Arrow",
        found: format!("a column of numbers became {data_type}"),
    }
}

/// `digits / 10^scale`: both are exact below 2^53 and 10^22, and one division rounds once.
fn decimal(digits: f64, scale: i8) -> f64 {
    let power = 10_f64.powi(i32::from(scale.unsigned_abs()));
    if scale < 0 {
        digits * power
    } else {
        digits / power
    }
}

fn extend<T: ArrowPrimitiveType>(
    values: &ArrayRef,
    to: &mut Vec<f64>,
    as_f64: impl Fn(T::Native) -> f64,
) {
    let values = values.as_primitive::<T>();
    if values.null_count() == 0 {
        to.extend(values.values().iter().map(|&v| as_f64(v)));
    } else {
        to.extend(values.iter().map(|v| v.map_or(f64::NAN, &as_f64)));
    }
}
