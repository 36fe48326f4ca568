//! Reads a log, record by record, and stops at the first byte that is not as it was written.

use super::{
    BLOCK_RECORDS, CRC, CycleRecord, LogError, MAGIC, METADATA_SIZE_MAX, Metadata, RECORD_SIZE, VERSION, take,
};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

/// A log being read: an iterator over its records. After an error it ends.
#[derive(Debug)]
pub struct LogReader {
    path: PathBuf,
    file: BufReader<File>,
    metadata: Metadata,
    /// The block at hand: index, count and records.
    block: Vec<u8>,
    /// How much of it has been handed out (bytes).
    consumed: usize,
    /// Where the next block begins (bytes).
    offset: u64,
    /// The number that the next block must have.
    index: u32,
    records: u64,
    ended: bool,
}

impl LogReader {
    /// Opens a log and reads its header.
    ///
    /// # Errors
    /// [`LogError::Io`], [`LogError::NotALog`], [`LogError::Version`], [`LogError::Header`].
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let failed = |source| LogError::Io { action: "read", file: path.to_owned(), source };
        let mut file = BufReader::new(File::open(path).map_err(failed)?);
        let mut header = Vec::new();
        read_up_to(&mut file, MAGIC.len(), &mut header).map_err(failed)?;
        if header != MAGIC {
            return Err(LogError::NotALog { file: path.to_owned(), found: header });
        }
        let damaged = |what: &str| LogError::Header { file: path.to_owned(), what: what.to_owned() };
        let cut = || damaged("the file ends within it");
        read_up_to(&mut file, 8, &mut header).map_err(failed)?;
        let mut sizes = header.get(MAGIC.len()..).unwrap_or_default();
        let version = u16::from_le_bytes(take(&mut sizes).ok_or_else(cut)?);
        let record_size = usize::from(u16::from_le_bytes(take(&mut sizes).ok_or_else(cut)?));
        let metadata_size = u32::from_le_bytes(take(&mut sizes).ok_or_else(cut)?) as usize;
        if version != VERSION {
            return Err(LogError::Version { file: path.to_owned(), found: version });
        }
        if record_size != RECORD_SIZE || metadata_size > METADATA_SIZE_MAX {
            return Err(damaged(&format!("records of {record_size} bytes, metadata of {metadata_size} bytes")));
        }
        let json = header.len();
        read_up_to(&mut file, metadata_size, &mut header).map_err(failed)?;
        let mut checksum = Vec::new();
        read_up_to(&mut file, 4, &mut checksum).map_err(failed)?;
        let expected = u32::from_le_bytes(take(&mut checksum.as_slice()).ok_or_else(cut)?);
        if CRC.checksum(&header) != expected {
            return Err(damaged("its checksum does not match"));
        }
        let metadata = serde_json::from_slice(header.get(json..).unwrap_or_default())
            .map_err(|error| damaged(&format!("its metadata cannot be read: {error}")))?;
        let (offset, block) = (header.len() as u64 + 4, Vec::new());
        let path = path.to_owned();
        Ok(Self { path, file, metadata, block, consumed: 0, offset, index: 0, records: 0, ended: false })
    }

    /// What the log is about.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Reads the next block; `false` at the end mark.
    fn next_block(&mut self) -> Result<bool, LogError> {
        let (start, count) = (self.offset, self.read_header()?);
        let mut rest = Vec::new();
        let size = count * RECORD_SIZE + 4;
        self.read(size, &mut rest)?;
        if rest.len() < size {
            return Err(self.torn(start));
        }
        let checksum = rest.split_off(count * RECORD_SIZE);
        self.block.append(&mut rest);
        if Some(CRC.checksum(&self.block)) != take(&mut checksum.as_slice()).map(u32::from_le_bytes) {
            return Err(self.corrupt(start, "its checksum does not match".to_owned()));
        }
        let mut fields = self.block.as_slice();
        let index = take(&mut fields).map(u32::from_le_bytes);
        if index != Some(self.index) {
            let found = index.unwrap_or_default();
            return Err(self.corrupt(start, format!("it is block {found} where block {} is due", self.index)));
        }
        self.index = self.index.wrapping_add(1);
        self.consumed = 8;
        self.offset = start + 8 + size as u64;
        if count == 0 {
            let mut beyond = Vec::new();
            self.read(1, &mut beyond)?;
            if !beyond.is_empty() {
                return Err(self.corrupt(self.offset, "it stands behind the end mark".to_owned()));
            }
        }
        Ok(count > 0)
    }

    /// Reads a block's number and count of records into `block`; gives the count.
    fn read_header(&mut self) -> Result<usize, LogError> {
        let mut header = std::mem::take(&mut self.block);
        header.clear();
        let read = self.read(8, &mut header);
        self.block = header;
        read?;
        let count = self.block.get(4..).and_then(|mut bytes| take(&mut bytes)).map(u32::from_le_bytes);
        match count.map(|count| count as usize) {
            None => Err(self.torn(self.offset)),
            Some(count) if count > BLOCK_RECORDS => Err(self.corrupt(self.offset, format!("{count} records"))),
            Some(count) => Ok(count),
        }
    }

    fn read(&mut self, size: usize, out: &mut Vec<u8>) -> Result<(), LogError> {
        let read = read_up_to(&mut self.file, size, out);
        read.map_err(|source| LogError::Io { action: "read", file: self.path.clone(), source })
    }

    fn torn(&self, offset: u64) -> LogError {
        LogError::Torn { file: self.path.clone(), offset, records: self.records }
    }

    fn corrupt(&self, offset: u64, what: String) -> LogError {
        LogError::Corrupt { file: self.path.clone(), offset, what, records: self.records }
    }
}

impl Iterator for LogReader {
    type Item = Result<CycleRecord, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.ended {
            let mut left = self.block.get(self.consumed..).unwrap_or_default();
            if let Some(record) = CycleRecord::decode(&mut left) {
                self.consumed += RECORD_SIZE;
                self.records += 1;
                return Some(Ok(record));
            }
            match self.next_block() {
                Ok(true) => {}
                Ok(false) => self.ended = true,
                Err(error) => {
                    self.ended = true;
                    return Some(Err(error));
                }
            }
        }
        None
    }
}

/// Appends `size` bytes, or fewer where the file ends.
fn read_up_to(file: &mut impl Read, size: usize, out: &mut Vec<u8>) -> io::Result<()> {
    file.take(size as u64).read_to_end(out).map(|_| ())
}
