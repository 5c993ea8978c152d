//! Stores messages on the disk, in order, until the broker has acknowledged them. Beyond a limit in
//! bytes the oldest are deleted and counted as dropped.
//!
//! Files `SEQUENCE.messages` of lines `sequence TAB topic TAB payload`, named by their first message;
//! `acknowledged` holds the sequence up to which the broker has all.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use loadtwin_files::atomic_file::AtomicFile;

/// Size from which a new file is begun (bytes).
const FILE_BYTES: u64 = 256 << 10;

/// A message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Its number.
    pub sequence: u64,
    /// Topic.
    pub topic: String,
    /// Payload.
    pub payload: String,
}

impl Message {
    fn parse(line: &str) -> Option<Self> {
        let mut fields = line.splitn(3, '\t');
        Some(Self {
            sequence: fields.next()?.parse().ok()?,
            topic: fields.next()?.to_owned(),
            payload: fields.next()?.to_owned(),
        })
    }
}

/// Messages of a file up to the first line that is damaged, and the length of these.
fn messages_of(path: &Path) -> io::Result<(Vec<Message>, u64)> {
    let bytes = fs::read(path)?;
    let (mut messages, mut length) = (Vec::new(), 0);
    for line in bytes.split_inclusive(|byte| *byte == b'\n') {
        let text = line
            .strip_suffix(b"\n")
            .and_then(|line| str::from_utf8(line).ok());
        let Some(message) = text.and_then(Message::parse) else {
            break;
        };
        messages.push(message);
        length += line.len() as u64;
    }
    Ok((messages, length))
}

/// The store.
#[derive(Debug)]
pub struct MessageStore {
    folder: PathBuf,
    most_bytes: u64,
    /// First sequence and length of each file.
    files: Vec<(u64, u64)>,
    last: Option<File>,
    next: u64,
    acknowledged: u64,
    /// Messages that were deleted to bound the disk.
    pub dropped: u64,
}

impl MessageStore {
    /// Opens the store in `folder`, with the messages of an earlier run.
    ///
    /// # Errors
    /// When it cannot be read or written.
    pub fn open(folder: &Path, most_bytes: u64) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let acknowledged = match fs::read_to_string(folder.join("acknowledged")) {
            Ok(text) => text.trim().parse().map_err(io::Error::other)?,
            Err(error) if error.kind() == io::ErrorKind::NotFound => 0,
            Err(error) => return Err(error),
        };
        let mut firsts: Vec<u64> = fs::read_dir(folder)?
            .filter_map(|entry| {
                let name = entry.ok()?.file_name();
                name.to_str()?.strip_suffix(".messages")?.parse().ok()
            })
            .collect();
        firsts.sort_unstable();
        let mut store = Self {
            folder: folder.to_owned(),
            most_bytes,
            files: Vec::new(),
            last: None,
            next: acknowledged + 1,
            acknowledged,
            dropped: 0,
        };
        for first in firsts {
            let path = store.path(first);
            let (messages, length) = messages_of(&path)?;
            // What a kill has left of a line.
            File::options().write(true).open(&path)?.set_len(length)?;
            store.files.push((first, length));
            if let Some(last) = messages.last() {
                store.next = store.next.max(last.sequence + 1);
            }
        }
        Ok(store)
    }

    fn path(&self, first: u64) -> PathBuf {
        self.folder.join(format!("{first:012}.messages"))
    }

    /// Number of the next message.
    pub fn next(&self) -> u64 {
        self.next
    }

    /// Messages that the broker does not have for certain.
    pub fn waiting(&self) -> u64 {
        self.next - 1 - self.acknowledged
    }

    /// Number up to which the broker has all.
    pub fn acknowledged(&self) -> u64 {
        self.acknowledged
    }

    /// Appends messages with the numbers from [`Self::next`] on, on the disk when this returns.
    ///
    /// # Errors
    /// When they cannot be written; none of them is stored then.
    pub fn append(&mut self, messages: &[(String, String)]) -> io::Result<()> {
        let mut text = String::new();
        for (sequence, (topic, payload)) in (self.next..).zip(messages) {
            text.push_str(&format!("{sequence}\t{topic}\t{payload}\n"));
        }
        if self.files.last().is_none_or(|file| file.1 >= FILE_BYTES) {
            self.files.push((self.next, 0));
            self.last = None;
        }
        let Some(&(first, length)) = self.files.last() else {
            return Ok(());
        };
        let path = self.path(first);
        let file = match self.last.take() {
            Some(file) => file,
            None => File::options().create(true).append(true).open(path)?,
        };
        let written = (&file)
            .write_all(text.as_bytes())
            .and_then(|()| file.sync_data());
        if let Err(error) = written {
            let _ = file.set_len(length);
            return Err(error);
        }
        self.last = Some(file);
        if let Some(file) = self.files.last_mut() {
            file.1 += text.len() as u64;
        }
        self.next += messages.len() as u64;
        self.bound()
    }

    /// Deletes the oldest files beyond the bound; the last one stays.
    fn bound(&mut self) -> io::Result<()> {
        while self.files.len() > 1
            && self.files.iter().map(|file| file.1).sum::<u64>() > self.most_bytes
        {
            let end = self.files.get(1).map_or(self.next, |file| file.0);
            self.dropped += end.saturating_sub(self.acknowledged + 1);
            self.acknowledge(end - 1)?;
        }
        Ok(())
    }

    /// At most `most` messages after `sequence`.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn after(&self, sequence: u64, most: usize) -> io::Result<Vec<Message>> {
        let from = self
            .files
            .partition_point(|file| file.0 <= sequence + 1)
            .saturating_sub(1);
        let mut found = Vec::new();
        for file in self.files.iter().skip(from) {
            if found.len() >= most || sequence + 1 >= self.next {
                break;
            }
            let (messages, _) = messages_of(&self.path(file.0))?;
            found.extend(
                messages
                    .into_iter()
                    .filter(|message| message.sequence > sequence),
            );
        }
        found.truncate(most);
        Ok(found)
    }

    /// Takes that the broker has all up to `sequence`; deletes the files that it has.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn acknowledge(&mut self, sequence: u64) -> io::Result<()> {
        if sequence <= self.acknowledged {
            return Ok(());
        }
        self.acknowledged = sequence;
        let mut file = AtomicFile::create(&self.folder.join("acknowledged"))?;
        writeln!(file, "{sequence}")?;
        file.finish()?;
        while let [(first, _), (second, _), ..] = self.files[..]
            && second <= sequence + 1
        {
            fs::remove_file(self.path(first))?;
            self.files.remove(0);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(k: u64) -> (String, String) {
        (
            format!("topic/{k}"),
            format!("{{\"k\":{k},\"fill\":\"{}\"}}", "x".repeat(1000)),
        )
    }

    #[test]
    fn messages_survive_a_restart_a_torn_line_and_the_bound() {
        let dir = tempfile::tempdir().unwrap();
        let open = || MessageStore::open(dir.path(), 1 << 20).unwrap();
        let mut store = open();
        for k in 1..=600 {
            store.append(&[message(k)]).unwrap();
        }
        store.acknowledge(300).unwrap();
        drop(store);
        let last = fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().path());
        let last = last.filter(|p| p.extension().is_some()).max().unwrap();
        File::options()
            .append(true)
            .open(&last)
            .unwrap()
            .write_all(b"601\ttopic")
            .unwrap();
        let mut store = open();
        assert_eq!((store.next(), store.waiting()), (601, 300));
        store.append(&[message(601)]).unwrap();
        let found = store.after(store.acknowledged(), 1000).unwrap();
        assert!(found.iter().map(|m| m.sequence).eq(301..=601));
        assert_eq!(
            (found[5].topic.as_str(), &found[5].payload),
            ("topic/306", &message(306).1)
        );
        for k in 602..3000 {
            store.append(&[message(k)]).unwrap();
        }
        assert!(store.dropped > 500, "{}", store.dropped);
        assert_eq!(store.dropped + store.waiting(), 2999 - 300);
        store.acknowledge(2999).unwrap();
        assert_eq!(open().next(), 3000);
    }
}
