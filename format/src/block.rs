//! The places of the parts of a block.

/// The places of the parts of a block in the image, from its info section.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockParts {
    /// First slot of the block in the image.
    pub start: u32,
    /// Length of the descriptor array in slots.
    pub array_slots: u32,
    /// First word of the contour pool in the image, in 32-bit words.
    pub contour_words: usize,
    /// Number of contours.
    pub contour_count: u32,
    /// Type, first byte in the image, and size in bytes of every attachment.
    pub attachments: Vec<(u32, u64, u64)>,
}

impl BlockParts {
    /// The same, relative to the start of the block.
    pub(crate) fn within(&self) -> Self {
        let start = self.start as usize;
        Self {
            start: 0,
            contour_words: self.contour_words - start * 2,
            attachments: self.attachments.iter().map(|&(kind, at, size)| (kind, at - start as u64 * 8, size)).collect(),
            ..*self
        }
    }

    /// First word in the image of the attachment of this type.
    pub(crate) fn words(&self, kind: u32) -> Option<usize> {
        self.attachments.iter().find(|(k, ..)| *k == kind).map(|(_, at, _)| (*at / 4) as usize)
    }
}
