//! The fields of the descriptors of a block, level by level.

use crate::file::attachment;

/// How a descriptor refers to its children.
pub(crate) mod link {
    /// It has no child with a descriptor.
    pub(crate) const NONE: u8 = 0;
    /// By its child pointer.
    pub(crate) const NEAR: u8 = 1;
    /// By a far pointer, to slots of the same block.
    pub(crate) const FAR: u8 = 2;
    /// By a far pointer, to another block.
    pub(crate) const BLOCK: u8 = 3;
}

/// The values of an attachment. Pairs and values are in the order of the descriptors that they belong to.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum Values {
    /// The eight bytes of a constant colour.
    Constant(u64),
    /// Blocks of this many slots, one for each pair of siblings.
    Pairs(usize, Vec<u64>),
    /// Value masks of the descriptors, and values.
    Plain(Vec<u8>, Vec<u32>),
    /// Corner masks of the descriptors, and values of a slot each.
    Corners(Vec<u32>, Vec<u64>),
}

impl Values {
    /// No values yet. `None` if parts do not know this type.
    pub(crate) fn of_kind(kind: u32) -> Option<Self> {
        Some(match kind {
            attachment::COLOR_CONSTANT => Self::Constant(0),
            attachment::COLOR_BLOCKS | attachment::AMBIENT_BLOCKS => Self::Pairs(1, Vec::new()),
            attachment::NORMAL_BLOCKS => Self::Pairs(2, Vec::new()),
            attachment::COLORS_PLAIN | attachment::NORMALS_PLAIN => Self::Plain(Vec::new(), Vec::new()),
            attachment::CORNERS => Self::Corners(Vec::new(), Vec::new()),
            _ => return None,
        })
    }

    /// Removes all values and keeps their memory.
    fn clear(&mut self) {
        match self {
            Self::Constant(value) => *value = 0,
            Self::Pairs(_, slots) => slots.clear(),
            Self::Plain(masks, words) => {
                masks.clear();
                words.clear();
            }
            Self::Corners(masks, slots) => {
                masks.clear();
                slots.clear();
            }
        }
    }

    /// How many bytes of memory the values take.
    fn capacity(&self) -> usize {
        match self {
            Self::Constant(_) => 0,
            Self::Pairs(_, slots) => slots.capacity() * 8,
            Self::Plain(masks, words) => masks.capacity() + words.capacity() * 4,
            Self::Corners(masks, slots) => masks.capacity() * 4 + slots.capacity() * 8,
        }
    }

    /// Size in bytes of the attachment with a descriptor array of this many slots.
    pub(crate) fn bytes(&self, array_slots: u64) -> u64 {
        match self {
            Self::Constant(_) => 8,
            Self::Pairs(unit, _) => array_slots.div_ceil(2) * *unit as u64 * 8,
            Self::Plain(_, values) => (array_slots + values.len() as u64) * 4,
            Self::Corners(_, values) => (array_slots + values.len() as u64) * 8,
        }
    }
}

/// Most attachments of a block whose types parts know: one with colours, one with normals, one with ambient occlusion.
pub(crate) const MAX_KINDS: usize = 3;

/// Where a level begins in the columns of [`Fields`].
#[derive(Clone, Copy, Default, Debug, PartialEq, Eq)]
pub(crate) struct Start {
    pub(crate) node: usize,
    pub(crate) contour: usize,
    pub(crate) child: usize,
    /// Pair or value of each attachment.
    pub(crate) values: [usize; MAX_KINDS],
}

/// The fields of the descriptors of a block, or of its upper levels. Columns have all descriptors of the first level, in the
/// order of their slots, then all of the next.
#[derive(Default, Debug, PartialEq)]
pub(crate) struct Fields {
    /// Length of the descriptor array of the whole block.
    pub(crate) array_slots: u32,
    /// Where each level begins, and where the last one ends.
    pub(crate) starts: Vec<Start>,
    pub(crate) valid: Vec<u8>,
    pub(crate) nonleaf: Vec<u8>,
    /// See [`link`].
    pub(crate) links: Vec<u8>,
    /// Indices of the blocks that links of kind [`link::BLOCK`] lead to.
    pub(crate) children: Vec<u32>,
    pub(crate) contour_masks: Vec<u8>,
    pub(crate) contours: Vec<u32>,
    /// Type and values of the attachments, in the order of the attachment directory.
    pub(crate) attachments: Vec<(u32, Values)>,
}

impl Fields {
    /// Removes everything and keeps the memory. Returns empty attachments with theirs.
    pub(crate) fn clear(&mut self) -> Vec<(u32, Values)> {
        self.array_slots = 0;
        self.starts.clear();
        self.valid.clear();
        self.nonleaf.clear();
        self.links.clear();
        self.children.clear();
        self.contour_masks.clear();
        self.contours.clear();
        let mut values = std::mem::take(&mut self.attachments);
        values.iter_mut().for_each(|(_, values)| values.clear());
        values
    }

    /// About how many bytes of memory the columns take.
    pub(crate) fn capacity(&self) -> usize {
        let values: usize = self.attachments.iter().map(|(_, values)| values.capacity()).sum();
        self.valid.capacity() * 4 + self.contours.capacity() * 4 + values
    }

    /// Number of levels.
    pub(crate) fn levels(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Number of descriptors of a level.
    pub(crate) fn count(&self, level: usize) -> usize {
        self.starts[level + 1].node - self.starts[level].node
    }

    /// Makes leaves of the children in levels that are not there.
    pub(crate) fn cut(&mut self) {
        let last = self.starts[self.levels() - 1].node..;
        for (mask, kind) in self.nonleaf[last.clone()].iter_mut().zip(&mut self.links[last]) {
            if matches!(*kind, link::NEAR | link::FAR) {
                (*mask, *kind) = (0, link::NONE);
            }
        }
    }

    /// The ends of the columns: where the next level begins.
    pub(crate) fn end(&self) -> Start {
        let mut values = [0; MAX_KINDS];
        for (value, (_, found)) in values.iter_mut().zip(&self.attachments) {
            *value = match found {
                Values::Constant(_) => 0,
                Values::Pairs(unit, data) => data.len() / unit,
                Values::Plain(_, data) => data.len(),
                Values::Corners(_, data) => data.len(),
            };
        }
        Start { node: self.valid.len(), contour: self.contours.len(), child: self.children.len(), values }
    }
}
