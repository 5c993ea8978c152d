//! Streams of Arrow between Python libraries: the capsules of the C stream interface.
//!
//! Source: The Arrow PyCapsule Interface, arrow.apache.org/docs/format/CDataInterface.

use std::ffi::CStr;

use arrow_array::RecordBatchReader;
use arrow_array::ffi_stream::{FFI_ArrowArrayStream, RecordBatchStreamReader};
use loadtwin::recording::Batches;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

use crate::Error;

/// What the interface calls a capsule with a stream.
const NAME: &CStr = c"arrow_array_stream";

/// The method by which an object hands out its stream.
const METHOD: &str = "__arrow_c_stream__";

/// The record batches of a Python object.
pub(crate) fn import(object: &Bound<'_, PyAny>) -> PyResult<Batches> {
    if !object.hasattr(METHOD)? {
        let found = object.get_type().fully_qualified_name()?;
        return Err(PyTypeError::new_err(format!(
            "recording: found {found}, allowed: the path of a file, or a table or stream with \
             {METHOD} (pyarrow, polars, pandas, DuckDB)"
        )));
    }
    let capsule = object.call_method0(METHOD)?.cast_into::<PyCapsule>()?;
    let stream = capsule.pointer_checked(Some(NAME))?;
    let stream = stream.cast::<FFI_ArrowArrayStream>().as_ptr();
    // SAFETY: by its name the capsule holds a valid stream, which is moved out of it here: what
    // stays behind is marked as released.
    #[expect(unsafe_code, reason = "the interface hands over a pointer of C")]
    let reader = unsafe { RecordBatchStreamReader::from_raw(stream) };
    let reader = reader.map_err(|error| Error::new_err(format!("table: {error}")))?;
    Ok(Batches::new(reader.schema(), reader))
}

/// A capsule with the batches of `reader`.
pub(crate) fn export<'py>(
    py: Python<'py>,
    reader: Box<dyn RecordBatchReader + Send>,
) -> PyResult<Bound<'py, PyCapsule>> {
    PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(reader), NAME)
}
