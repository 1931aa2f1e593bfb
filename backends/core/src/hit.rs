//! What a ray finds.

use bytemuck::{Pod, Zeroable};

/// A hit voxel, named by its parent's descriptor and its child slot: 16 bytes, as the kernels write them. A test compares
/// it with the kernel's struct of the same name.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct Hit {
    /// As kernels write it: what [`t`](Self::t) returns for a hit; [`Hit::MISS_T`] for a miss, a number that a hit can have
    /// too.
    pub raw_t: f32,
    /// Slot of the parent's child descriptor.
    pub slot: u32,
    /// Child slot in bits 0..3, scale of the voxel in bits 8..13: its edge is `2^(scale - 23)` of the root.
    pub voxel: u32,
    /// Iterations of the main loop that the ray took. An engine whose rays share a loop gives those of the loop until the
    /// ray ended.
    pub iterations: u32,
}

impl Hit {
    /// `raw_t` of a ray that hits nothing.
    pub const MISS_T: f32 = 2.0;

    /// `voxel` of a ray that hits nothing.
    pub const MISS_VOXEL: u32 = u32::MAX;

    /// A ray that hit nothing.
    pub fn miss(iterations: u32) -> Self {
        Self { raw_t: Self::MISS_T, slot: 0, voxel: Self::MISS_VOXEL, iterations }
    }

    /// A hit.
    pub fn new(t: f32, slot: u32, child: u32, scale: u32, iterations: u32) -> Self {
        Self { raw_t: t, slot, voxel: child | scale << 8, iterations }
    }

    /// Whether nothing was hit.
    pub fn is_miss(&self) -> bool {
        self.voxel == Self::MISS_VOXEL
    }

    /// Where the ray enters the voxel or its contour, in lengths of the ray's direction; `None` for a miss. In a picture,
    /// depth divided by the depth of the far plane.
    pub fn t(&self) -> Option<f32> {
        (!self.is_miss()).then_some(self.raw_t)
    }

    /// Child slot of the voxel.
    pub fn child(&self) -> u8 {
        (self.voxel & 7) as u8
    }

    /// Scale of the voxel.
    pub fn scale(&self) -> u32 {
        self.voxel >> 8
    }

    /// Edge of the voxel; the edge of the root cube is 1.
    pub fn size(&self) -> f32 {
        exp2(self.scale() as i32 - 23)
    }

    /// Level of the voxel, the root cube being level 0; not for a miss.
    pub fn level(&self) -> u32 {
        23u32.saturating_sub(self.scale())
    }

    /// Whether both name the same voxel, or both are misses.
    pub fn same_voxel(&self, other: &Self) -> bool {
        self.voxel == other.voxel && self.slot == other.slot
    }
}

/// `2^n`, for `n` from -126 to 127.
#[inline(always)]
pub fn exp2(n: i32) -> f32 {
    f32::from_bits(((n + 127) as u32) << 23)
}
