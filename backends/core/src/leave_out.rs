//! What a caster leaves out because a scene does not need it.

/// What casters leave out of their code if neither the octree nor the rays need it. To see what each costs when it is there, keep
/// it: hits do not change.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct LeaveOut {
    /// Clipping by contours, for octrees without any. If the rays are to meet cubes, it is left out always.
    pub contours: bool,
    /// Following far pointers, for octrees without any. Packets of the CPU caster leave nothing of it out.
    pub far_pointers: bool,
    /// The test whether a voxel is small, for rays that end at leaves only. Packets of the CPU caster leave nothing of it out.
    pub sizes: bool,
    /// Frames of the stack for levels that the octree does not have. The CPU caster has all: its stack lies in memory.
    pub frames: bool,
}

impl Default for LeaveOut {
    fn default() -> Self {
        Self::ALL
    }
}

impl LeaveOut {
    /// All that is not needed.
    pub const ALL: Self = Self { contours: true, far_pointers: true, sizes: true, frames: true };
    /// Nothing, needed or not.
    pub const NOTHING: Self = Self { contours: false, far_pointers: false, sizes: false, frames: false };
}
