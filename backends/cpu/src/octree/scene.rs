//! What of an octree the casters read.

use esvo_format::Octree;

/// The image of a sound octree, and the root at which rays start.
pub(super) struct Scene<'a> {
    slots: &'a [u64],
    words: &'a [u32],
    root: u32,
    far_pointers: bool,
}

impl<'a> Scene<'a> {
    /// The octree must be [sound](Octree::sound), and `root` the root slot of one of its objects: both are known of what
    /// [`Roots::open`](esvo_core::Roots::open) returns.
    pub(super) fn new(octree: &'a Octree, root: u32) -> Self {
        let far_pointers = octree.needs().far_pointers;
        Self { slots: octree.slots(), words: octree.words(), root, far_pointers }
    }

    /// The image in slots of 8 bytes.
    #[inline(always)]
    pub(super) fn slots(&self) -> &'a [u64] {
        self.slots
    }

    /// The image in 32-bit words.
    #[inline(always)]
    pub(super) fn words(&self) -> &'a [u32] {
        self.words
    }

    /// Whether some child pointer is far.
    #[inline(always)]
    pub(super) fn has_far_pointers(&self) -> bool {
        self.far_pointers
    }

    /// Slot of the root's descriptor.
    #[inline(always)]
    pub(super) fn root(&self) -> u32 {
        self.root
    }
}
