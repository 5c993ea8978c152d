//! Layout by which files of loads are read: written NaN is a missing sample, and gaps of up to a
//! million samples are allowed.

use loadtwin_recording::{CsvLayout, WrittenNan};

/// Samples in a row that a file may lack; they are counted as missing. A file
/// with a longer gap is to be split there.
const LARGEST_GAP: u32 = 1_000_000;

/// How the files are read.
pub(crate) fn layout() -> CsvLayout {
    CsvLayout {
        written_nan: WrittenNan::Missing,
        largest_gap: LARGEST_GAP,
        ..CsvLayout::default()
    }
}
