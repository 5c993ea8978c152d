//! Exchange of Arrow record batches with Python libraries (pyarrow, polars, pandas): import and
//! export by the `PyCapsule` stream interface.
//!
//! Source: The Arrow `PyCapsule` Interface, arrow.apache.org/docs/format/CDataInterface.

use std::ffi::CStr;
use std::panic::{AssertUnwindSafe, catch_unwind};

use arrow_array::ffi_stream::{FFI_ArrowArrayStream, RecordBatchStreamReader};
use arrow_array::{RecordBatch, RecordBatchReader};
use arrow_schema::ArrowError;
use loadtwin::recording::Batches;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

use crate::Error;
use crate::replay_threads::Stop;

/// What the interface calls a capsule with a stream.
const NAME: &CStr = c"arrow_array_stream";

/// The method by which an object hands out its stream.
const METHOD: &str = "__arrow_c_stream__";

/// A stream that ends with an error once it is stopped, and where a batch does not fit its schema.
struct Checked {
    reader: RecordBatchStreamReader,
    stop: Stop,
}

impl Iterator for Checked {
    type Item = Result<RecordBatch, ArrowError>;

    fn next(&mut self) -> Option<Self::Item> {
        let failed = |why: &str| Some(Err(ArrowError::CDataInterface(why.to_owned())));
        if self.stop.is_set() {
            return failed("stopped");
        }
        // The crate panics on a batch with other columns than the schema.
        catch_unwind(AssertUnwindSafe(|| self.reader.next()))
            .unwrap_or_else(|_| failed("a batch does not fit the schema of the stream"))
    }
}

/// The record batches of a Python object, until `stop`.
pub(crate) fn import(object: &Bound<'_, PyAny>, stop: &Stop) -> PyResult<Batches> {
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
    let schema = reader.schema();
    let stop = stop.clone();
    Ok(Batches::new(schema, Checked { reader, stop }))
}

/// A capsule with the batches of `reader`.
pub(crate) fn export(
    py: Python<'_>,
    reader: Box<dyn RecordBatchReader + Send>,
) -> PyResult<Bound<'_, PyCapsule>> {
    PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(reader), NAME)
}
