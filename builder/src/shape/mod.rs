//! The shape of a voxel: which contour it gets, and whether that is close enough to the surface.
//!
//! `shaper.rs` decides in general: it measures how far the surface and the voxel extend along a few directions (`slab.rs`),
//! and where that is not enough, cuts the voxel's polyhedron (`polyhedron.rs`). `plane.rs` is the short way for voxels whose
//! surface is one plane.

pub(crate) mod plane;
pub(crate) mod polyhedron;
pub(crate) mod shaper;
pub(crate) mod slab;
pub(crate) mod voxel;
