//! Changing bytes of a file and correcting its checksums afterwards.

/// A file in memory, with the layout of this library's writer: directory after the header, uncompressed blocks.
#[derive(Clone)]
pub(crate) struct File(pub(crate) Vec<u8>);

/// Offsets in the header and in entries of the directory.
pub(crate) const DIRECTORY: usize = 64;
pub(crate) const ENTRY: usize = 32;

impl File {
    pub(crate) fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.0[at..at + 4].try_into().unwrap())
    }

    pub(crate) fn u64(&self, at: usize) -> u64 {
        u64::from_le_bytes(self.0[at..at + 8].try_into().unwrap())
    }

    pub(crate) fn set_u32(&mut self, at: usize, value: u32) {
        self.0[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }

    pub(crate) fn set_u64(&mut self, at: usize, value: u64) {
        self.0[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }

    /// Number of directory entries.
    pub(crate) fn sections(&self) -> usize {
        self.u32(48) as usize
    }

    /// First byte of the directory entry with this tag.
    pub(crate) fn entry(&self, tag: &[u8; 4]) -> usize {
        (0..self.sections()).map(|i| DIRECTORY + ENTRY * i).find(|at| &self.0[*at..at + 4] == tag).expect("a section")
    }

    /// First byte and length of the section with this tag.
    pub(crate) fn section(&self, tag: &[u8; 4]) -> (usize, usize) {
        let entry = self.entry(tag);
        (self.u64(entry + 8) as usize, self.u64(entry + 16) as usize)
    }

    /// First byte of object table entry `index`.
    pub(crate) fn object(&self, index: usize) -> usize {
        self.section(b"OBJT").0 + 192 * index
    }

    /// First byte of block table entry `index`.
    pub(crate) fn block(&self, index: usize) -> usize {
        self.section(b"BLKT").0 + 72 * index
    }

    pub(crate) fn blocks(&self) -> usize {
        self.section(b"BLKT").1 / 72
    }

    /// First byte of slot `slot` of the image.
    pub(crate) fn slot(&self, slot: usize) -> usize {
        self.section(b"BLKS").0 + 8 * slot
    }

    /// First byte of the info section of block `index`.
    pub(crate) fn info(&self, index: usize) -> usize {
        let start = self.u64(self.block(index) + 40) as usize;
        start + 8 * self.u32(start) as usize
    }

    /// First byte of the contour pool of block `index`.
    pub(crate) fn pool(&self, index: usize) -> usize {
        self.info(index) + 4 * self.u32(self.info(index) + 12) as usize
    }

    /// First byte of entry `k` of the attachment directory of block `index`.
    pub(crate) fn attachment(&self, index: usize, k: usize) -> usize {
        self.info(index) + 32 + 16 * k
    }

    /// Corrects all checksums: blocks, sections, directory, header. The tables must be intact.
    pub(crate) fn seal(&mut self) {
        self.seal_blocks();
        self.seal_sections();
        self.seal_header();
    }

    pub(crate) fn seal_blocks(&mut self) {
        for index in 0..self.blocks() {
            self.seal_block(self.block(index));
        }
    }

    pub(crate) fn seal_sections(&mut self) {
        for i in 0..self.sections() {
            let at = DIRECTORY + ENTRY * i;
            let (start, length) = (self.u64(at + 8) as usize, self.u64(at + 16) as usize);
            let Some(bytes) = start.checked_add(length).and_then(|end| self.0.get(start..end)) else { continue };
            let crc = if self.u32(at + 4) & 2 != 0 { 0 } else { crc32fast::hash(bytes) };
            self.set_u32(at + 24, crc);
        }
    }

    pub(crate) fn seal_header(&mut self) {
        let start = self.u64(40) as usize;
        if let Some(bytes) = self.0.get(start..start.saturating_add(self.sections() * ENTRY)) {
            let crc = crc32fast::hash(bytes);
            self.set_u32(52, crc);
        }
        let crc = crc32fast::hash(&self.0[..60]);
        self.set_u32(60, crc);
    }

    /// Corrects all checksums that can be found, also in damaged files.
    pub(crate) fn seal_whatever_is_there(&mut self) {
        let length = self.0.len();
        if length < 64 {
            return;
        }
        self.set_u64(32, length as u64);
        let (directory, count) = (self.u64(40) as usize, self.sections().min(1024));
        let inside = |at: usize, size: usize| at.checked_add(size).is_some_and(|end| end <= length);
        if inside(directory, ENTRY * count) {
            let entries: Vec<usize> = (0..count).map(|i| directory + ENTRY * i).collect();
            let range = |file: &Self, tag: &[u8; 4]| {
                let at = entries.iter().copied().find(|at| &file.0[*at..*at + 4] == tag)?;
                let (start, bytes) = (file.u64(at + 8) as usize, file.u64(at + 16) as usize);
                inside(start, bytes).then_some((start, bytes))
            };
            if let Some((start, bytes)) = range(self, b"BLKT") {
                match range(self, b"PART").zip(range(self, b"BLKS")).filter(|_| self.0[16] & 2 != 0) {
                    Some((parts, data)) => self.seal_parts_that_are_there(parts, data.0, (start, bytes)),
                    None => (0..bytes / 72).take(64).for_each(|i| self.seal_block(start + 72 * i)),
                }
            }
            for at in entries {
                let (start, bytes) = (self.u64(at + 8) as usize, self.u64(at + 16) as usize);
                if inside(start, bytes) {
                    let own = self.u32(at + 4) & 2 != 0;
                    let crc = if own { 0 } else { crc32fast::hash(&self.0[start..start + bytes]) };
                    self.set_u32(at + 24, crc);
                }
            }
            let crc = crc32fast::hash(&self.0[directory..directory + ENTRY * count]);
            self.set_u32(52, crc);
        }
        let crc = crc32fast::hash(&self.0[..60]);
        self.set_u32(60, crc);
    }

    /// Corrects the checksums of parts and blocks. `table` and `blocks` are start and length of PART and BLKT, `at` is the start
    /// of BLKS.
    fn seal_parts_that_are_there(&mut self, table: (usize, usize), mut at: usize, blocks: (usize, usize)) {
        let mut own: Vec<(u32, u8, [u8; 4])> = Vec::new();
        for entry in (0..table.1 / 12).take(256).map(|i| table.0 + 12 * i) {
            let size = self.u32(entry + 4) as usize;
            if size < 5 || at + size > self.0.len() {
                break;
            }
            let crc = crc32fast::hash(&self.0[at + 4..at + size]);
            self.set_u32(at, crc);
            own.push((self.u32(entry), self.0[entry + 8], crc.to_le_bytes()));
            at = (at + size).next_multiple_of(8);
        }
        own.sort_unstable();
        for block in 0..(blocks.1 / 72).min(64) {
            let crcs: Vec<u8> = own.iter().filter(|part| part.0 as usize == block).flat_map(|part| part.2).collect();
            self.set_u32(blocks.0 + 72 * block + 60, crc32fast::hash(&crcs));
        }
    }

    /// Corrects the checksum of the block whose table entry is at `at`.
    fn seal_block(&mut self, at: usize) {
        let (start, length) = (self.u64(at + 40) as usize, self.u64(at + 48) as usize);
        if let Some(bytes) = start.checked_add(length).and_then(|end| self.0.get(start..end)) {
            let crc = crc32fast::hash(bytes);
            self.set_u32(at + 60, crc);
        }
    }
}
