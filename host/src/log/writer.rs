//! Writes a log, a block at a time.

use super::{BLOCK_RECORDS, CRC, CycleRecord, LogError, MAGIC, Metadata, RECORD_SIZE, VERSION};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A log being written. Call [`LogWriter::finish`]: a log without its end mark counts as torn.
#[derive(Debug)]
pub struct LogWriter {
    path: PathBuf,
    file: File,
    /// The records of the block being filled, encoded.
    records: Vec<u8>,
    /// The whole block, while it is written.
    block: Vec<u8>,
    index: u32,
}

impl LogWriter {
    /// Creates the file, or empties it, and writes the header.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn create(path: &Path, metadata: &Metadata) -> Result<Self, LogError> {
        let failed = |source| LogError::Io { action: "create", file: path.to_owned(), source };
        let json = serde_json::to_vec(metadata).map_err(|error| failed(error.into()))?;
        let size = u32::try_from(json.len()).map_err(|_| failed(io::ErrorKind::FileTooLarge.into()))?;
        let mut header = MAGIC.to_vec();
        header.extend(VERSION.to_le_bytes());
        header.extend((RECORD_SIZE as u16).to_le_bytes());
        header.extend(size.to_le_bytes());
        header.extend(json);
        let checksum = CRC.checksum(&header);
        header.extend(checksum.to_le_bytes());
        let mut file = File::create(path).map_err(failed)?;
        file.write_all(&header).map_err(failed)?;
        let (records, block) = (Vec::with_capacity(BLOCK_RECORDS * RECORD_SIZE), Vec::new());
        Ok(Self { path: path.to_owned(), file, records, block, index: 0 })
    }

    /// Adds a record; every 64th call writes a block.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn push(&mut self, record: &CycleRecord) -> Result<(), LogError> {
        record.encode(&mut self.records);
        if self.records.len() >= BLOCK_RECORDS * RECORD_SIZE { self.write_block() } else { Ok(()) }
    }

    /// Writes what is left and the end mark, and waits until the file is on the disk.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn finish(mut self) -> Result<(), LogError> {
        if !self.records.is_empty() {
            self.write_block()?;
        }
        // The end mark is a block without records.
        self.write_block()?;
        self.file.sync_all().map_err(|source| LogError::Io { action: "write", file: self.path, source })
    }

    fn write_block(&mut self) -> Result<(), LogError> {
        let count = (self.records.len() / RECORD_SIZE) as u32;
        self.block.clear();
        self.block.extend(self.index.to_le_bytes());
        self.block.extend(count.to_le_bytes());
        self.block.append(&mut self.records);
        let checksum = CRC.checksum(&self.block);
        self.block.extend(checksum.to_le_bytes());
        self.index = self.index.wrapping_add(1);
        let written = self.file.write_all(&self.block);
        written.map_err(|source| LogError::Io { action: "write", file: self.path.clone(), source })
    }
}
