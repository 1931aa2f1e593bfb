//! The shape of a voxel: which contour it gets, and whether that is close enough to the surface.

pub(crate) mod plane;
pub(crate) mod polyhedron;
pub(crate) mod shaper;
pub(crate) mod slab;
pub(crate) mod voxel;
