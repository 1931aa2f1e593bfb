//! The features of an octree that matter to casters.

/// The features that an octree uses. Casters select kernel variants, stack size and uploads by it.
#[derive(Clone, Copy, PartialEq, Eq, Debug, serde::Serialize)]
pub struct Needs {
    /// Some voxel has a contour.
    pub contours: bool,
    /// Some child pointer is far.
    pub far_pointers: bool,
    /// Level of the deepest voxel, 1..=23. The traversal stack needs this many frames.
    pub levels: u32,
    /// Some block has colours.
    pub colors: bool,
    /// Some block has normals.
    pub normals: bool,
    /// Some block has ambient occlusion.
    pub ambient: bool,
}
