//! What can go wrong.

use crate::volume::{MAX_MIPS, MAX_VOXELS};

/// Why a volume, a ray, a shape or a change was refused.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum ShadowError {
    /// The volume's size.
    #[error("a volume of {} x {} x {} voxels was asked for; each axis has 1 to {MAX_VOXELS}. Choose larger voxels, or bricks", .0[0], .0[1], .0[2])]
    Size([u32; 3]),
    /// Number of mips.
    #[error("{0} mips were asked for; a volume has at most {MAX_MIPS}")]
    Mips(u32),
    /// Not enough memory.
    #[error("a volume of {0} bytes does not fit the memory; choose larger voxels, or bricks")]
    Memory(u64),
    /// A ray that is not usable.
    #[error("{0}")]
    Ray(String),
    /// A shape that is not usable.
    #[error("{0}")]
    Shape(String),
    /// A pose that moves a shape where no voxels are.
    #[error("{0}")]
    Pose(String),
    /// An object that is not in the world.
    #[error("object {0} is not in the world: it was removed, or is of another world")]
    NoObject(u32),
    /// The device.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Device(#[from] esvo_device::DeviceError),
}
