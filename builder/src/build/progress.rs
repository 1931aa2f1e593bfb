//! The progress of a running build.

/// How far a build has come.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Finished share of the root cube, 0 to 1.
    pub done: f64,
    /// Number of voxels built so far.
    pub voxels: u64,
}
