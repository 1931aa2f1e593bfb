//! A slice: the voxels of one level in one cube, in depth-first order.

use super::fault;
use crate::FormatError;

/// Words of a slice before its tables.
const HEADER_WORDS: usize = 15;
/// State of a slice: the voxels of the next level have been built.
pub(super) const COMPLETE: u32 = 2;
/// State of a slice: it has not been built.
pub(super) const UNBUILT: u32 = 1;

/// Child entries: the slices of the next level in the cube of a slice, depth-first.
pub(super) mod entry {
    /// The cube is divided; its eight octants follow.
    pub(in super::super) const SPLIT: i32 = -2;
    /// There is no slice, as all voxels of the cube are leaves.
    pub(in super::super) const NONE: i32 = -1;
}

/// The place of a slice.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Place {
    /// Lower corner of its cube in units of 2^-23 of the root.
    pub(super) position: [u32; 3],
    /// Scale of its cube.
    pub(super) cube_scale: u32,
    /// Scale of its voxels.
    pub(super) voxel_scale: u32,
}

impl Place {
    /// The place of the root slice.
    pub(super) const ROOT: Self = Self { position: [0; 3], cube_scale: 23, voxel_scale: 23 };

    /// Octant `slot` of the cube.
    pub(super) fn octant(self, slot: u32) -> Self {
        let half = 1 << (self.cube_scale - 1);
        let position = std::array::from_fn(|axis| self.position[axis] + (slot >> axis & 1) * half);
        Self { position, cube_scale: self.cube_scale - 1, ..self }
    }

    /// Whether a point is in the cube.
    pub(super) fn contains(self, point: [u32; 3]) -> bool {
        (0..3).all(|axis| point[axis] >> self.cube_scale == self.position[axis] >> self.cube_scale)
    }
}

/// A slice that has been read.
pub(super) struct Slice {
    words: Vec<u32>,
    id: u32,
    /// Number of voxels.
    voxels: u32,
    /// Number of voxels that are not leaves.
    nodes: u32,
    entries: (usize, usize),
    attachments: Vec<(u32, usize, usize)>,
    split: usize,
    masks: usize,
}

impl Slice {
    /// Checks the tables of slice `id`, which must be at `place` and have `voxels` voxels. `None` if it has not been
    /// built.
    pub(super) fn new(id: u32, words: Vec<u32>, place: Place, voxels: u32) -> Result<Option<Self>, FormatError> {
        let broken = |what: String| fault(format!("slice {id}"), what);
        let Some(header) = words.first_chunk::<HEADER_WORDS>() else {
            return Err(broken(format!("it has {} words, expected at least {HEADER_WORDS}", words.len())));
        };
        let found =
            Place { position: [header[2], header[3], header[4]], cube_scale: header[5], voxel_scale: header[6] };
        if header[0] != id || found != place {
            return Err(broken(format!("its header says slice {} at {found:?}, expected {place:?}", header[0])));
        }
        match header[1] {
            COMPLETE => {}
            UNBUILT => return Ok(None),
            state => return Err(broken(format!("its state is {state}, expected 1 or 2"))),
        }
        let (count, nodes) = (header[11], header[13]);
        if count != voxels {
            return Err(broken(format!("it has {count} voxels, expected the {voxels} in its cube")));
        }
        let range = |what: &str, start: u32, length: usize| {
            let start = start as usize;
            if start.checked_add(length).is_none_or(|end| end > words.len()) {
                let what = format!("{what}: {length} words from word {start} on leave its {} words", words.len());
                return Err(broken(what));
            }
            Ok(start)
        };
        let entries = range("child entries", header[8], header[7] as usize)?;
        let split = range("split bits", header[12], (count as usize).div_ceil(32))?;
        let masks = range("valid masks", header[14], (nodes as usize).div_ceil(4))?;
        let directory = range("attachment list", header[10], (header[9] as usize).saturating_mul(3))?;
        let attachments = (words[directory..].chunks_exact(3).take(header[9] as usize))
            .map(|entry| Ok((entry[0], range("attachment", entry[1], entry[2] as usize)?, entry[2] as usize)))
            .collect::<Result<_, FormatError>>()?;
        let entries = (entries, header[7] as usize);
        let slice = Self { id, voxels: count, nodes, entries, attachments, split, masks, words };
        let bits = (0..count).filter(|voxel| slice.is_split(*voxel)).count();
        if bits != nodes as usize {
            return Err(
                slice.broken(format!("it has {bits} split bits and {nodes} valid masks, expected as many of both"))
            );
        }
        Ok(Some(slice))
    }

    /// An error about this slice.
    pub(super) fn broken(&self, what: impl Into<String>) -> FormatError {
        fault(format!("slice {}", self.id), what)
    }

    /// Number of voxels that are not leaves.
    pub(super) fn nodes(&self) -> u32 {
        self.nodes
    }

    /// Number of voxels.
    pub(super) fn voxels(&self) -> u32 {
        self.voxels
    }

    /// Whether a voxel is not a leaf.
    pub(super) fn is_split(&self, voxel: u32) -> bool {
        self.words[self.split + voxel as usize / 32] >> (voxel % 32) & 1 != 0
    }

    /// Valid mask of a node, which is never zero.
    pub(super) fn mask(&self, node: u32) -> Result<u8, FormatError> {
        let mask = (self.words[self.masks + node as usize / 4] >> (node % 4 * 8)) as u8;
        if mask == 0 { Err(self.broken(format!("node {node} has no child"))) } else { Ok(mask) }
    }

    /// The child entries.
    pub(super) fn entries(&self) -> impl Iterator<Item = i32> + '_ {
        self.words[self.entries.0..][..self.entries.1].iter().map(|word| *word as i32)
    }

    /// The attachment of this type, which must have at least `least` words.
    pub(super) fn attachment(&self, kind: u32, least: usize) -> Result<&[u32], FormatError> {
        let Some(&(_, start, length)) = self.attachments.iter().find(|attachment| attachment.0 == kind) else {
            return Err(self.broken(format!("it has no attachment of type {kind}, which its object has")));
        };
        if length < least {
            return Err(
                self.broken(format!("the attachment of type {kind} has {length} words, expected at least {least}"))
            );
        }
        Ok(&self.words[start..start + length])
    }
}

/// A slice to be written.
pub(super) struct NewSlice<'a> {
    pub(super) id: u32,
    pub(super) place: Place,
    pub(super) entries: &'a [i32],
    pub(super) split: &'a [bool],
    pub(super) masks: &'a [u8],
    /// Type and words of each.
    pub(super) attachments: &'a [(u32, Vec<u32>)],
}

impl NewSlice<'_> {
    /// The words of the chunk: the parts in the order of the header, without gaps.
    pub(super) fn words(&self) -> Vec<u32> {
        let list = HEADER_WORDS + self.entries.len();
        let split = list + self.attachments.len() * 3;
        let masks = split + self.split.len().div_ceil(32);
        let mut end = masks + self.masks.len().div_ceil(4);
        let [x, y, z] = self.place.position;
        let mut words = vec![self.id, COMPLETE, x, y, z, self.place.cube_scale, self.place.voxel_scale];
        for (count, offset) in [
            (self.entries.len(), HEADER_WORDS),
            (self.attachments.len(), list),
            (self.split.len(), split),
            (self.masks.len(), masks),
        ] {
            words.extend([count as u32, offset as u32]);
        }
        words.extend(self.entries.iter().map(|entry| *entry as u32));
        for (kind, content) in self.attachments {
            words.extend([*kind, end as u32, content.len() as u32]);
            end += content.len();
        }
        words.extend(
            self.split
                .chunks(32)
                .map(|bits| bits.iter().enumerate().fold(0, |word, (bit, split)| word | u32::from(*split) << bit)),
        );
        words.extend(
            self.masks.chunks(4).map(|bytes| {
                bytes.iter().enumerate().fold(0, |word, (byte, mask)| word | u32::from(*mask) << (8 * byte))
            }),
        );
        for (_, content) in self.attachments {
            words.extend_from_slice(content);
        }
        words
    }
}
