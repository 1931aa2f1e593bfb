//! What casting an octree takes, known before the first ray.

/// The set of features that a scene uses; picks kernel variants, sizes the stack, decides what is uploaded.
#[derive(Clone, Copy, PartialEq, Eq, Debug, serde::Serialize)]
pub struct Needs {
    /// Some voxel has a contour.
    pub contours: bool,
    /// Some child pointer is far.
    pub far_pointers: bool,
    /// Level of the deepest voxel, 1..=23: frames of the traversal stack.
    pub levels: u32,
    /// Some block has colours.
    pub colors: bool,
    /// Some block has normals.
    pub normals: bool,
    /// Some block has ambient occlusion.
    pub ambient: bool,
}
