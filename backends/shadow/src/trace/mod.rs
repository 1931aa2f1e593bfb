//! Rays through a volume: every voxel that a ray touches, or samples in fixed steps.

pub mod batch;
mod ray;
mod steps;
mod walk;

pub use ray::{FRACTION_BITS, Ray};
pub use steps::Steps;
pub use walk::{first_hit, is_blocked};

/// The coarsest level that rays are traced at: larger cells would not keep the tracer's whole numbers within 32 bits.
pub const MAX_LEVEL: u32 = 6;

/// How finely a ray is traced.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Fidelity {
    /// The level that tracing begins at, and goes up to again where cells are empty; at most what the volume has and [`MAX_LEVEL`]. 0: mips are not used.
    pub coarsest: u32,
    /// How many voxels from its origin a ray is traced at full resolution, along the axis that it advances most on. From there on cells of
    /// two voxels are taken for full if they have a voxel, for twice as many voxels, then cells of four, and so on. 0: full resolution everywhere.
    pub fine_until: u32,
}

impl Fidelity {
    /// Full resolution everywhere, all mips.
    pub const EXACT: Self = Self { coarsest: MAX_LEVEL, fine_until: 0 };
    /// The same without mips.
    pub const WITHOUT_MIPS: Self = Self { coarsest: 0, fine_until: 0 };

    /// The level that is full resolution at so many voxels from the origin.
    pub(crate) fn finest(&self, voxels: u32, coarsest: u32) -> u32 {
        match self.fine_until {
            0 => 0,
            fine => (voxels / fine + 1).ilog2().min(coarsest),
        }
    }
}

/// What a ray met.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Hit {
    /// The cell: the voxel, if `level` is 0.
    pub cell: [i32; 3],
    /// Level of the cell.
    pub level: u32,
    /// Voxels from the ray's origin to the point where it enters the cell.
    pub distance: f32,
}

/// Result of a ray.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Traced {
    /// The first full cell on the ray.
    pub hit: Option<Hit>,
    /// How many cells the volume was asked for.
    pub steps: u32,
}
