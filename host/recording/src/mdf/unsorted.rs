//! Presents an MDF4 file with unsorted data groups to the decoder as if no record were split
//! between data blocks (`WholeRecords`, a source of bytes): puts blocks of whole records behind the
//! end of the file, and changes the links to them.
//!
//! ASAM MDF 4.1 lets a record of an unsorted group begin in one data block and end
//! in the next. `falcon_mdf` 0.7 looks for records in each block on its own and
//! reads what follows such a record at wrong places. [`WholeRecords`] is the file
//! with other data blocks behind its end: they hold the same bytes and each ends
//! with a record.
use std::collections::HashMap;
use std::io::Read;
use std::sync::{Arc, Mutex, PoisonError};

use falcon_mdf::blocks::CompressionType;
use falcon_mdf::data_index::{DataBlockIndex, DataBlockInfo};
use falcon_mdf::io::reader::BufferedSource;
use falcon_mdf::io::{ByteSlice, ByteSource};
use falcon_mdf::{DataGroup, Mf4Error, Mf4File};
use flate2::bufread::ZlibDecoder;

use super::LARGEST_BLOCK;

/// Bytes of records in a block, about: what the usual writers put into one.
const BLOCK: u64 = 4 << 20;

/// Header of a block: name, reserved, length, number of links (ASAM MDF 4.1, 4.4).
const HEADER: u64 = 24;

/// Place of the link to the data in a data group block: the third of its links.
const DATA_LINK: u64 = HEADER + 2 * 8;

/// A file whose unsorted data groups have blocks of whole records.
pub(super) struct WholeRecords {
    file: Arc<BufferedSource>,
    streams: Vec<RecordStream>,
    /// What stands behind the end of the file, in this order.
    added: Vec<Added>,
    /// Links of the file that lead there, by their places.
    links: Vec<(u64, [u8; 8])>,
    len: u64,
}

struct Added {
    at: u64,
    len: u64,
    content: Content,
}

enum Content {
    Bytes(Vec<u8>),
    Records { stream: usize, from: u64 },
}

impl WholeRecords {
    /// `file` with blocks of whole records; none where no group needs them.
    pub(super) fn of(
        file: &Mf4File,
        source: &Arc<BufferedSource>,
    ) -> Result<Option<Self>, Mf4Error> {
        let mut whole = Self {
            file: Arc::clone(source),
            streams: Vec::new(),
            added: Vec::new(),
            links: Vec::new(),
            len: source.len(),
        };
        let groups = file.data_groups();
        // The last block of an unfinished file reaches to its end, which stays where it is.
        if file.unfinalized().is_some() && !groups.iter().all(DataGroup::is_unsorted) {
            return Ok(None);
        }
        for group in groups.iter().filter(|group| is_cut(group)) {
            let stream = RecordStream::of(group, source);
            let ends = stream.ends(group)?;
            whole.add(group.block_offset(), stream, &ends);
        }
        Ok((!whole.streams.is_empty()).then_some(whole))
    }

    /// Adds the records of a group as blocks that end at `ends`, and a list of them.
    fn add(&mut self, group: u64, stream: RecordStream, ends: &[u64]) {
        let mut blocks = Vec::new();
        let mut starts = Vec::new();
        let mut from = 0;
        for &end in ends {
            starts.push(from);
            blocks.push(self.put(header(*b"##DT", HEADER + end - from, 0)));
            let records = Content::Records {
                stream: self.streams.len(),
                from,
            };
            self.place(end - from, records);
            from = end;
        }
        let count = blocks.len() as u64;
        let mut list = header(
            *b"##DL",
            HEADER + 8 * (1 + count) + 8 + 8 * count,
            1 + count,
        );
        let links = std::iter::once(0).chain(blocks);
        list.extend(links.flat_map(u64::to_le_bytes));
        // Flags: 0, blocks of different lengths; their number; where each starts.
        list.extend((count << 32).to_le_bytes());
        list.extend(starts.into_iter().flat_map(u64::to_le_bytes));
        let list = self.put(list);
        self.links.push((group + DATA_LINK, list.to_le_bytes()));
        self.streams.push(stream);
    }

    /// Adds bytes where a block may begin, and returns the place.
    fn put(&mut self, bytes: Vec<u8>) -> u64 {
        let gap = self.len.wrapping_neg() % 8;
        self.place(gap, Content::Bytes(vec![0; gap as usize]));
        let at = self.len;
        self.place(bytes.len() as u64, Content::Bytes(bytes));
        at
    }

    fn place(&mut self, len: u64, content: Content) {
        if len > 0 {
            self.added.push(Added {
                at: self.len,
                len,
                content,
            });
            self.len += len;
        }
    }

    /// Reads of the file itself, with the links changed.
    fn read_file(&self, offset: u64, len: usize, out: &mut Vec<u8>) -> Result<(), Mf4Error> {
        let from = out.len();
        out.extend_from_slice(&self.file.read_bytes(offset, len)?);
        for (at, link) in &self.links {
            for (place, byte) in (*at..).zip(link) {
                let inside = place.checked_sub(offset);
                let inside = inside.and_then(|i| usize::try_from(i).ok());
                if let Some(target) = inside.and_then(|i| out.get_mut(from + i)) {
                    *target = *byte;
                }
            }
        }
        Ok(())
    }
}

impl ByteSource for WholeRecords {
    fn len(&self) -> u64 {
        self.len
    }

    fn read_bytes(&self, offset: u64, len: usize) -> Result<ByteSlice<'_>, Mf4Error> {
        let end = offset.saturating_add(len as u64);
        if end > self.len {
            let available = self.len.saturating_sub(offset) as usize;
            return Err(Mf4Error::truncated(offset, len, available));
        }
        let mut out = Vec::with_capacity(len);
        let of_file = end.min(self.file.len()).saturating_sub(offset);
        if of_file > 0 {
            self.read_file(offset, of_file as usize, &mut out)?;
        }
        let first = self.added.partition_point(|a| a.at + a.len <= offset);
        for added in &self.added[first..] {
            if added.at >= end {
                break;
            }
            let start = offset.max(added.at) - added.at;
            let stop = end.min(added.at + added.len) - added.at;
            match &added.content {
                Content::Bytes(bytes) => out.extend(&bytes[start as usize..stop as usize]),
                Content::Records { stream, from } => {
                    self.streams[*stream].read(from + start, from + stop, &mut out)?;
                }
            }
        }
        Ok(ByteSlice::owned(out))
    }
}

/// Whether a record of the group may reach from one block into the next, or a block is too
/// large to be held.
fn is_cut(group: &DataGroup) -> bool {
    let blocks = group.block_index();
    let is_plain = |block: &DataBlockInfo| block.invalidation_block.is_none();
    group.is_unsorted()
        && (blocks.block_count() > 1 || blocks.total_size() > BLOCK)
        && blocks.blocks().iter().all(is_plain)
}

fn header(name: [u8; 4], length: u64, links: u64) -> Vec<u8> {
    let mut bytes = name.to_vec();
    bytes.extend([0; 4]);
    bytes.extend(length.to_le_bytes());
    bytes.extend(links.to_le_bytes());
    bytes
}

/// The contents of a group's data blocks, one behind the other.
struct RecordStream {
    file: Arc<BufferedSource>,
    blocks: DataBlockIndex,
    /// The compressed block read last, and what it holds.
    expanded: Mutex<Option<(usize, Vec<u8>)>>,
}

impl RecordStream {
    fn of(group: &DataGroup, file: &Arc<BufferedSource>) -> Self {
        let mut blocks = DataBlockIndex::new();
        let all = group.block_index().blocks();
        for block in all.iter().filter(|block| block.original_size > 0) {
            blocks.push(block.clone());
        }
        Self {
            file: Arc::clone(file),
            blocks,
            expanded: Mutex::new(None),
        }
    }

    /// Appends the bytes `from..to`.
    fn read(&self, mut from: u64, to: u64, out: &mut Vec<u8>) -> Result<(), Mf4Error> {
        while from < to {
            let Some((number, block, start)) = self.blocks.block_for_offset(from) else {
                return Err(Mf4Error::truncated(from, (to - from) as usize, 0));
            };
            let length = (to - from).min(block.original_size - start);
            if block.compression.is_none() {
                let at = block.offset + HEADER + start;
                out.extend_from_slice(&self.file.read_bytes(at, length as usize)?);
            } else {
                let mut last = self.expanded.lock().unwrap_or_else(PoisonError::into_inner);
                let bytes = match last.take() {
                    Some((of, bytes)) if of == number => bytes,
                    _ => self.expand(block)?,
                };
                let range = start as usize..(start + length) as usize;
                let found = bytes.get(range).map(|bytes| out.extend_from_slice(bytes));
                found.ok_or_else(|| Mf4Error::truncated(start, length as usize, bytes.len()))?;
                *last = Some((number, bytes));
            }
            from += length;
        }
        Ok(())
    }

    fn expand(&self, block: &DataBlockInfo) -> Result<Vec<u8>, Mf4Error> {
        let Some(compression) = &block.compression else {
            return Ok(Vec::new());
        };
        let transposed = match compression.algorithm {
            CompressionType::Deflate => false,
            CompressionType::TransposedDeflate => true,
            other => {
                return Err(Mf4Error::unsupported(
                    "data block of an unsorted group",
                    format!("compressed by {other:?}; read are deflate and transposed deflate"),
                ));
            }
        };
        let size = block.original_size;
        if size > LARGEST_BLOCK {
            return Err(Mf4Error::Decompression(format!(
                "a block expands to {size} bytes; allowed: up to {LARGEST_BLOCK}"
            )));
        }
        let at = compression.data_offset;
        let bytes = self.file.read_bytes(at, block.compressed_size as usize)?;
        let mut expanded = Vec::with_capacity(size as usize);
        ZlibDecoder::new(&bytes[..])
            .take(size)
            .read_to_end(&mut expanded)
            .map_err(|e| Mf4Error::Decompression(e.to_string()))?;
        if transposed {
            return Mf4File::un_transpose(&expanded, compression.parameter as usize);
        }
        Ok(expanded)
    }

    /// Ends of blocks of whole records; the last is the end of the stream.
    ///
    /// Behind a record that no channel group of the file has, nothing is known: all that follows is
    /// one block.
    fn ends(&self, group: &DataGroup) -> Result<Vec<u64>, Mf4Error> {
        let records = RecordSizes::of(group);
        let total = self.blocks.total_size();
        let mut ends = Vec::new();
        let mut buffer = Vec::new();
        // Of the stream: what was read, and where the buffer begins.
        let (mut read, mut begin) = (0, 0);
        while read < total {
            let next = total.min(read + BLOCK);
            self.read(read, next, &mut buffer)?;
            read = next;
            let mut end = 0;
            let complete = loop {
                match records.length(&buffer[end..]) {
                    Length::Bytes(length) if end + length <= buffer.len() => end += length,
                    Length::Bytes(length) if length as u64 > LARGEST_BLOCK => break false,
                    Length::Bytes(_) | Length::Cut => break true,
                    Length::Unknown => break false,
                }
            };
            if end > 0 {
                buffer.drain(..end);
                begin += end as u64;
                ends.push(begin);
            }
            if !complete {
                break;
            }
        }
        if ends.last() != Some(&total) {
            ends.push(total);
        }
        Ok(ends)
    }
}

/// Length of the record at the start of some bytes.
enum Length {
    Bytes(usize),
    /// Its length is not among the bytes.
    Cut,
    /// It is of no channel group.
    Unknown,
}

/// Lengths of records by their ids.
struct RecordSizes {
    /// Bytes of an id.
    id: usize,
    /// Bytes of a record with its id; none where the record says it itself.
    sizes: HashMap<u64, Option<usize>>,
}

impl RecordSizes {
    fn of(group: &DataGroup) -> Self {
        let id = group.rec_id_size();
        let size = |g: &falcon_mdf::ChannelGroup| (!g.is_vlsd()).then(|| g.record_size(id));
        Self {
            id: usize::from(id),
            sizes: (group
                .channel_groups
                .iter()
                .map(|g| (g.record_id(), size(g))))
            .collect(),
        }
    }

    fn length(&self, bytes: &[u8]) -> Length {
        let mut id = [0; 8];
        let (Some(place), Some(found)) = (id.get_mut(..self.id), bytes.get(..self.id)) else {
            return Length::Cut;
        };
        place.copy_from_slice(found);
        match self.sizes.get(&u64::from_le_bytes(id)) {
            None | Some(Some(0)) => Length::Unknown,
            Some(Some(size)) => Length::Bytes(*size),
            // Values of variable length: the id, their length as u32, the values.
            Some(None) => match bytes.get(self.id..).and_then(<[u8]>::first_chunk) {
                Some(length) => Length::Bytes(self.id + 4 + u32::from_le_bytes(*length) as usize),
                None => Length::Cut,
            },
        }
    }
}
