//! The result does not depend on how the bytes are read: as ranges, by short reads, or all at once.

use std::io::{Cursor, Read, Seek, SeekFrom};

use esvo_format::{FormatError, Octree, OpenOptions, SeekSource, StreamReader};

use super::right_checksums;

/// A reader that returns a few bytes at a time, in numbers given by a pattern.
struct Stutter<'a> {
    bytes: Cursor<&'a [u8]>,
    pattern: &'a [u8],
    reads: usize,
}

impl Read for Stutter<'_> {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        let step = self.pattern.get(self.reads % self.pattern.len().max(1)).map_or(1, |b| usize::from(*b) * 16 + 1);
        self.reads += 1;
        let length = buf.len().min(step);
        self.bytes.read(&mut buf[..length])
    }
}

impl Seek for Stutter<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.bytes.seek(to)
    }
}

const OPTIONS: OpenOptions = OpenOptions { memory_limit: 16 << 20, verify: true };

/// All blocks that a reader reads, or its error.
fn all_blocks<S: esvo_format::RangeRead>(source: S) -> Result<Vec<u64>, String> {
    let name = |e: FormatError| match e {
        FormatError::Broken(broken) => broken.to_string(),
        FormatError::Source { source, .. } => source.kind().to_string(),
        other => other.to_string(),
    };
    let reader = StreamReader::open_with(source, &OPTIONS).map_err(name)?;
    let mut image = Vec::new();
    for index in 0..reader.blocks().len() as u32 {
        image.extend_from_slice(reader.read_block(index).map_err(name)?.slots());
        if image.len() > 1 << 21 {
            return Err("large".into());
        }
    }
    Ok(image)
}

/// Runs the target on one input.
pub fn run(data: &[u8]) {
    let bytes = right_checksums(data);
    let whole = all_blocks(&bytes[..]);
    let pattern = &data[data.len().saturating_sub(16)..];
    let stutter = Stutter { bytes: Cursor::new(&bytes), pattern, reads: 0 };
    assert_eq!(all_blocks(SeekSource::new(stutter)), whole);
    if let (Ok(image), Ok(octree)) = (whole, Octree::from_bytes_with(&bytes, &OPTIONS)) {
        assert!(image == octree.slots());
    }
}
