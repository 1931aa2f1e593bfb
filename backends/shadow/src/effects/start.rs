//! How far from a surface a ray may look at the volume without finding the surface's own voxels.
//!
//! A voxel of a plane is a box that meets the plane. With edge 1 and the plane's unit normal `n`, all of the box lies within
//! `h = |n.x| + |n.y| + |n.z|` of the plane: that is how far a box of edge 1 extends along `n`. So a ray in a direction `d`, which leaves the plane by
//! `n . d` a voxel, is above all voxels of the plane after `h / (n . d)` voxels; and so it is if it starts `h` above the plane, in any direction that
//! does not lead back. `h` lies between 1, for a plane along the grid, and the square root of 3.
//!
//! Grazing rays would have a long way to go, on which they would miss what is there. After [`Offset::longest`] voxels the rest of `h` is
//! made up along the normal. If surfaces fill only voxels whose middle they enclose ([`Rule::Middle`](crate::Rule::Middle), for solids), half of `h` is enough.
//!
//! What is derived holds of planes. Where a surface is hollow, the voxels of one side stand before the other, and a corner is darker than
//! it should be: by what, [`Through`](super::Through) is compared with exact obstacles for.

use glam::Vec3;

/// Rays are rounded to 1/256 of a voxel, and surfaces to as much; voxels that are touched count.
const MARGIN: f32 = 0.03;

/// How far rays go from a surface before they look at the volume.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Offset {
    /// Share of what is safe: 1 is just enough if surfaces fill all voxels that they meet. Less makes surfaces shade themselves; 0 is no offset.
    pub share: f32,
    /// Most voxels along the ray.
    pub longest: f32,
}

impl Offset {
    /// Safe for surfaces that fill all voxels that they meet.
    pub const SAFE: Self = Self { share: 1.0, longest: 4.0 };
    /// None: the ray begins at the surface.
    pub const NONE: Self = Self { share: 0.0, longest: 4.0 };

    /// How many voxels along `direction`, then how many along `normal`, lie between a surface and the first place that is looked at. Both vectors have
    /// length 1. Without a normal (zero) it is none.
    pub fn of(&self, normal: Vec3, direction: Vec3) -> (f32, f32) {
        if normal == Vec3::ZERO || self.share == 0.0 {
            return (0.0, 0.0);
        }
        let above = normal.abs().element_sum() * self.share + MARGIN;
        let slope = normal.dot(direction);
        if slope * self.longest >= above {
            return (above / slope, 0.0);
        }
        let along = if slope > 0.0 { self.longest } else { 0.0 };
        (along, above - slope.max(0.0) * along)
    }
}
