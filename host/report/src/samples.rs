//! Stores every sample of the signals over time, compressed in chunks, so that a reader can zoom in
//! to each (`Samples`): in the page where they fit, else on request in a file `.samples.js` beside
//! the page.
//!
//! Rows are kept in chunks. Of a chunk, the times and each stored column are compressed on their
//! own, so that a page decodes only what is in view: the differences of neighbouring bit patterns
//! (of the times the differences of these), their bytes sorted by significance, deflate.

use std::hash::{DefaultHasher, Hasher as _};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use base64::{Engine as _, engine::general_purpose::STANDARD};
use flate2::{Compression, write::DeflateEncoder};
use loadtwin_files::atomic_file::{AtomicFile, Complete};
use loadtwin_files::file_kind::FileKind;
use serde_json::{Value, json};

/// Rows of a chunk: 4 s at 2 kHz, decoded in some milliseconds.
const CHUNK: usize = 8192;

/// Chunks kept in memory for the page have at most this size (bytes): above it no page could hold
/// them.
const LARGEST_IN_PAGE: usize = 7_500_000;

/// First line of a file of samples.
const START: &str =
    "// Samples of a report page of loadtwin, loaded by the page beside this file.\n";

/// What is written beside a page.
pub const SAMPLES: FileKind = FileKind {
    noun: "file of samples",
    suffixes: &["js"],
    is_same: |file| Ok(file.start().starts_with(START.as_bytes())),
};

/// The file of samples that belongs to a page.
pub fn samples_beside(page: &Path) -> PathBuf {
    page.with_extension("samples.js")
}

/// A column over time as a sum of stored columns, each with its factor.
pub type Combination = Vec<(usize, f32)>;

/// Every sample so far.
#[derive(Default)]
pub struct Samples {
    /// Columns of [`super::Report::time`].
    columns: Vec<Combination>,
    x: Vec<f64>,
    /// Rows of the chunk that is open, one stored column after the other.
    stored: Vec<Vec<f32>>,
    /// First and last x, and rows of each chunk.
    spans: Vec<(f64, f64, usize)>,
    place: Place,
    /// Of all that was compressed.
    hash: DefaultHasher,
}

/// Where chunks go.
enum Place {
    /// JSON of each chunk, and their size.
    Page(Vec<Value>, usize),
    /// Nowhere: they were too large for a page.
    Nowhere,
    /// A file of this name.
    File(String, Box<io::Result<AtomicFile>>),
}

impl Default for Place {
    fn default() -> Self {
        Self::Page(Vec::new(), 0)
    }
}

impl Samples {
    /// Samples of `stored` columns for the page, as long as they fit; `columns` are those of
    /// [`super::Report::time`].
    pub fn new(stored: usize, columns: Vec<Combination>) -> Self {
        Self {
            columns,
            stored: vec![Vec::with_capacity(CHUNK); stored],
            ..Self::default()
        }
    }

    /// From the first sample on, writes to the file beside `page`.
    pub fn write_beside(&mut self, page: &Path) {
        let path = samples_beside(page);
        let name = path.file_name().unwrap_or_default();
        let file = AtomicFile::create(&path).and_then(|mut file| {
            file.write_all(START.as_bytes())?;
            Ok(file)
        });
        self.place = Place::File(name.to_string_lossy().into_owned(), Box::new(file));
    }

    /// Takes one sample at `x`, not below the last, with one value for each stored column.
    pub fn push(&mut self, x: f64, values: impl IntoIterator<Item = f64>) {
        if matches!(self.place, Place::Nowhere) {
            return;
        }
        self.x.push(x);
        let mut values = values.into_iter();
        for column in &mut self.stored {
            let value = values.next().unwrap_or(f64::NAN) as f32;
            column.push(if value.is_finite() { value } else { f32::NAN });
        }
        if self.x.len() == CHUNK {
            self.close_chunk();
        }
    }

    fn close_chunk(&mut self) {
        let (Some(first), Some(last)) = (self.x.first(), self.x.last()) else {
            return;
        };
        self.spans.push((*first, *last, self.x.len()));
        let columns = self.stored.iter().map(|column| encoded_f32(column));
        let chunk: Vec<String> = std::iter::once(encoded_f64(&self.x))
            .chain(columns)
            .collect();
        self.x.clear();
        self.stored.iter_mut().for_each(Vec::clear);
        for part in &chunk {
            self.hash.write(part.as_bytes());
        }
        match &mut self.place {
            Place::Page(chunks, size) => {
                *size += chunk.iter().map(|part| part.len() + 3).sum::<usize>();
                chunks.push(json!(chunk));
                if *size > LARGEST_IN_PAGE {
                    self.place = Place::Nowhere;
                }
            }
            Place::File(_, file) => {
                if let Ok(open) = file.as_mut()
                    && let Err(error) = writeln!(open, "loadtwinSamples({});", json!(chunk))
                {
                    **file = Err(error);
                }
            }
            Place::Nowhere => {}
        }
    }

    /// No sample follows.
    pub(super) fn end(&mut self) {
        self.close_chunk();
    }

    /// The file beside the page, where there is one, without a name before it is published.
    ///
    /// # Errors
    /// Of writing the file.
    pub fn complete(&mut self) -> io::Result<Option<Complete>> {
        let id = self.id();
        match &mut self.place {
            Place::File(_, file) => {
                let taken = std::mem::replace(&mut **file, Err(io::ErrorKind::NotFound.into()));
                let mut file = taken?;
                writeln!(file, "loadtwinSamples({id:?});")?;
                file.complete().map(Some)
            }
            Place::Page(..) | Place::Nowhere => Ok(None),
        }
    }

    /// Hash of all chunks, by which the page recognises the file beside it.
    fn id(&self) -> String {
        format!("{:016x}", self.hash.finish())
    }

    /// Name of the file beside the page.
    pub(super) fn file(&self) -> Option<&str> {
        match &self.place {
            Place::File(name, _) => Some(name),
            _ => None,
        }
    }

    /// What the page says about the samples, and their chunks where it holds them.
    pub(super) fn json(&self) -> (Value, Option<String>) {
        let (chunks, is_kept) = match &self.place {
            Place::Page(chunks, _) => (Some(json!(chunks).to_string()), true),
            Place::File(..) => (None, true),
            Place::Nowhere => (None, false),
        };
        let about = json!({
            "id": self.id(), "file": self.file(), "spans": self.spans, "columns": self.columns,
        });
        (if is_kept { about } else { Value::Null }, chunks)
    }
}

fn encoded_f32(values: &[f32]) -> String {
    let mut last = 0_u32;
    let differences = values.iter().map(|value| {
        let bits = value.to_bits();
        bits.wrapping_sub(std::mem::replace(&mut last, bits))
            .to_le_bytes()
    });
    compressed(&differences.collect::<Vec<_>>())
}

fn encoded_f64(values: &[f64]) -> String {
    let (mut last, mut step) = (0_u64, 0_u64);
    let differences = values.iter().map(|value| {
        let bits = value.to_bits();
        let now = bits.wrapping_sub(std::mem::replace(&mut last, bits));
        now.wrapping_sub(std::mem::replace(&mut step, now))
            .to_le_bytes()
    });
    compressed(&differences.collect::<Vec<_>>())
}

/// All lowest bytes, then the next: those that are alike stand together.
fn compressed<const N: usize>(words: &[[u8; N]]) -> String {
    let mut sorted = Vec::with_capacity(N * words.len());
    for byte in 0..N {
        sorted.extend(words.iter().map(|word| word[byte]));
    }
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
    // Writing to memory does not fail; what it left out would not decode, and the page says so.
    let _ = encoder.write_all(&sorted);
    STANDARD.encode(encoder.finish().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(samples: &mut Samples, count: u32) {
        for i in 0..count {
            let t = f64::from(i) * 5e-4;
            samples.push(t, [t.sin(), f64::INFINITY]);
        }
        samples.end();
    }

    fn two_columns() -> Samples {
        Samples::new(2, vec![vec![(0, 1.0)], vec![(0, 1.0), (1, -1.0)]])
    }

    #[test]
    fn chunks_cover_every_sample_and_only_the_last_is_shorter() {
        let mut samples = two_columns();
        sine(&mut samples, 20_000);
        let (about, chunks) = samples.json();
        let spans = about["spans"].as_array().unwrap();
        let rows: Vec<u64> = spans.iter().map(|s| s[2].as_u64().unwrap()).collect();
        assert_eq!(rows, [8192, 8192, 20_000 - 2 * 8192]);
        assert_eq!(spans[1][0], 8192.0 * 5e-4);
        let chunks: Vec<Vec<String>> = serde_json::from_str(&chunks.unwrap()).unwrap();
        assert!(chunks.iter().all(|chunk| chunk.len() == 3));
    }

    #[test]
    fn what_no_page_could_hold_is_left_out() {
        let mut samples = Samples::new(40, vec![vec![(0, 1.0)]; 40]);
        let mut state = 1_u64;
        for i in 0..100_000_u32 {
            let mut noise = || {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                (state >> 32) as f64
            };
            samples.push(f64::from(i), std::array::from_fn::<_, 40, _>(|_| noise()));
        }
        samples.end();
        assert_eq!(samples.json(), (Value::Null, None));
    }

    #[test]
    fn the_file_beside_the_page_ends_with_the_mark_that_the_page_has() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("a.html");
        let mut samples = two_columns();
        samples.write_beside(&page);
        sine(&mut samples, 10_000);
        let file = samples.complete().unwrap().unwrap();
        loadtwin_files::atomic_file::publish([file]).unwrap();
        let (about, chunks) = samples.json();
        assert_eq!((chunks, &about["file"]), (None, &json!("a.samples.js")));
        let text = std::fs::read_to_string(samples_beside(&page)).unwrap();
        assert_eq!(text.matches("loadtwinSamples([").count(), 2);
        let end = format!("loadtwinSamples({});\n", about["id"]);
        assert!(text.ends_with(&end), "{end}");
    }
}
