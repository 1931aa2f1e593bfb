//! The 64-bit child descriptor (paper section 3.1; spec section 5).

use bytemuck::{Pod, Zeroable};

/// Largest distance, in slots, that the 15-bit child pointer can express.
pub const MAX_NEAR_POINTER: u32 = (1 << 15) - 1;
/// Largest distance, in 32-bit words, that the 24-bit contour pointer can express.
pub const MAX_CONTOUR_POINTER: u32 = (1 << 24) - 1;

/// The eight child slots of one non-leaf voxel. Takes one 8-byte slot of the descriptor array.
///
/// ```text
/// low word   31..17 child pointer | 16 far bit | 15..8 valid mask | 7..0 leaf mask
/// high word  31..8  contour pointer                               | 7..0 contour mask
/// ```
///
/// Bit `i` of a mask belongs to child slot `i` (x = 1, y = 2, z = 4). A child slot is empty if its valid bit is clear,
/// a leaf voxel if both bits are set, and a voxel with its own descriptor if only the valid bit is set. A leaf bit
/// without its valid bit and a descriptor with only empty slots break rule C001.
#[repr(transparent)]
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable, Default)]
pub struct ChildDescriptor(pub u64);

impl ChildDescriptor {
    /// Packs the fields. `child_ptr` and `contour_ptr` must fit their 15 and 24 bits.
    pub fn new(valid: u8, leaf: u8, child_ptr: u32, far: bool, contour_mask: u8, contour_ptr: u32) -> Self {
        debug_assert!(child_ptr <= MAX_NEAR_POINTER && contour_ptr <= MAX_CONTOUR_POINTER && leaf & !valid == 0);
        let low = child_ptr << 17 | (far as u32) << 16 | (valid as u32) << 8 | leaf as u32;
        let high = contour_ptr << 8 | contour_mask as u32;
        Self((high as u64) << 32 | low as u64)
    }

    /// The low word: topology.
    pub const fn low(self) -> u32 {
        self.0 as u32
    }

    /// The high word: contours.
    pub const fn high(self) -> u32 {
        (self.0 >> 32) as u32
    }

    /// Mask of the child slots that hold a voxel.
    pub const fn valid_mask(self) -> u8 {
        (self.0 >> 8) as u8
    }

    /// Mask of the leaf voxels; a subset of the valid mask.
    pub const fn leaf_mask(self) -> u8 {
        self.0 as u8
    }

    /// Mask of the voxels that have a descriptor.
    pub const fn nonleaf_mask(self) -> u8 {
        self.valid_mask() & !self.leaf_mask()
    }

    /// Distance in slots to the first child descriptor, or to the far pointer if [`far`](Self::far) is set; 0 if there
    /// are no non-leaf children (C002, C006).
    pub const fn child_ptr(self) -> u32 {
        self.low() >> 17
    }

    /// Whether the child pointer refers to a 32-bit far pointer.
    pub const fn far(self) -> bool {
        self.0 & 1 << 16 != 0
    }

    /// Mask of the child slots that have a contour.
    pub const fn contour_mask(self) -> u8 {
        self.high() as u8
    }

    /// Distance in 32-bit words from this descriptor to the first contour value.
    pub const fn contour_ptr(self) -> u32 {
        self.high() >> 8
    }

    /// Number of siblings with descriptors before child slot `child`.
    pub const fn child_rank(self, child: u8) -> u32 {
        (self.nonleaf_mask() & lower_bits(child)).count_ones()
    }

    /// Number of contour values before that of child slot `child`.
    pub const fn contour_rank(self, child: u8) -> u32 {
        (self.contour_mask() & lower_bits(child)).count_ones()
    }
}

/// The mask bits of the child slots before `child`.
const fn lower_bits(child: u8) -> u8 {
    (1 << child) - 1
}

impl std::fmt::Debug for ChildDescriptor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ChildDescriptor")
            .field("valid", &format_args!("{:08b}", self.valid_mask()))
            .field("leaf", &format_args!("{:08b}", self.leaf_mask()))
            .field("child_ptr", &self.child_ptr())
            .field("far", &self.far())
            .field("contours", &format_args!("{:08b}", self.contour_mask()))
            .field("contour_ptr", &self.contour_ptr())
            .finish()
    }
}
