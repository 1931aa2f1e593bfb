//! The progress of a running build.

/// How far a build has come.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Finished share of the root cube, 0 to 1.
    pub done: f64,
    /// Number of voxels built so far.
    pub voxels: u64,
    /// Number of voxels that are taken over from an earlier, interrupted build. Not 0 only in the first report of a build that
    /// goes on from one.
    pub resumed: u64,
}
