//! Checks of the stored bytes of a file: the checksums of its blocks, and the bytes outside its sections and blocks.

use rayon::prelude::*;

use crate::octree::{Gaps, Image, Stored};
use crate::{Broken, FormatError, Octree, ids};

/// The bytes outside `ranges`, which must be in order, that are not zero: the first of each gap.
pub(crate) fn gaps(bytes: &[u8], ranges: &[(u64, u64)]) -> impl Iterator<Item = Broken> {
    let ends = ranges.iter().map(|range| range.1);
    let starts = ranges.iter().skip(1).map(|range| range.0).chain([bytes.len() as u64]);
    ends.zip(starts).filter_map(|(from, to)| {
        let at = bytes[from as usize..to as usize].iter().position(|b| *b != 0)?;
        Some(Broken::new(ids::FILE_GAPS, from + at as u64, "a byte outside all sections and blocks is not zero"))
    })
}

/// Compares the checksums of all blocks, in parallel. Returns the damaged blocks in the order of the table.
pub(crate) fn wrong_checksums(octree: &Octree) -> Vec<Broken> {
    (0..octree.blocks().len()).into_par_iter().filter_map(|index| octree.block_checksum(index).err()).collect()
}

impl Octree {
    /// Whether the stored bytes of the file are those that were written: the checksum of every block, and zeros outside
    /// sections and blocks. Reads the whole file at the first call, in parallel; the result is kept. Every caster calls
    /// this when it loads an octree.
    ///
    /// True without any check for an octree that this program made, and if
    /// [`OpenOptions::verify`](crate::OpenOptions::verify) was off. Blocks of compressed files are compared on opening.
    /// A section of unknown type whose checksum is its own affair (directory flag bit 1) is not covered.
    ///
    /// A mapped file that changes after this call is not noticed.
    ///
    /// # Errors
    /// The first rule found broken: B006 with the number of the block, or D009.
    pub fn intact(&self) -> Result<(), Broken> {
        match &self.stored {
            Stored::File { verify: true, .. } => self.compared(),
            _ => Ok(()),
        }
    }

    /// Like [`intact`](Self::intact), for block `index` alone. Ignores [`OpenOptions::verify`](crate::OpenOptions::verify).
    ///
    /// # Errors
    /// The block is damaged (rule B006); there is no such block.
    pub fn check_block(&self, index: usize) -> Result<(), FormatError> {
        if index < self.blocks().len() {
            return Ok(self.block_checksum(index)?);
        }
        let count = self.blocks().len();
        Err(FormatError::Limit(format!("there is no block {index}: the octree has {count}, counted from 0")))
    }

    /// Compares all checksums once, whatever the options say.
    pub(crate) fn compared(&self) -> Result<(), Broken> {
        // The work is done outside `get_or_init`: a thread that waits for others in there may be given other work, and
        // that work may ask for the same octree.
        if self.compared.get().is_none() {
            let _ = self.compared.set(compare(self));
        }
        self.compared.get().cloned().unwrap_or(Ok(()))
    }

    /// Compares the checksum of an existing block with its stored bytes. Octrees made in memory have none, and those of
    /// compressed files were compared on reading.
    fn block_checksum(&self, index: usize) -> Result<(), Broken> {
        if self.origin.is_none_or(|origin| origin.compressed) {
            return Ok(());
        }
        let block = &self.blocks()[index];
        let image: &[u8] = bytemuck::cast_slice(self.slots());
        let bytes = &image[block.image_offset as usize..(block.image_offset + block.image_size) as usize];
        crate::file::compression::check_crc(index, block, bytes)
    }
}

fn compare(octree: &Octree) -> Result<(), Broken> {
    if let Stored::File { gaps: found, .. } = &octree.stored {
        match (found, &octree.image) {
            (Gaps::Read(Some(broken)), _) => return Err(broken.clone()),
            (Gaps::Unread(ranges), Image::Mapped { map, .. }) => gaps(map, ranges).next().map_or(Ok(()), Err)?,
            _ => {}
        }
    }
    wrong_checksums(octree).into_iter().next().map_or(Ok(()), Err)
}
