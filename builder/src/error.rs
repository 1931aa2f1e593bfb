//! What can go wrong in a build.

/// Why no octree was built.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// A setting out of its range.
    #[error("{name} is {value}: it must be {range}")]
    Setting {
        /// The setting.
        name: &'static str,
        /// What it was.
        value: String,
        /// What it may be.
        range: &'static str,
    },
    /// The mesh has nothing to build from, or numbers that are not finite, or indices that lead nowhere.
    #[error("mesh: {0}")]
    Mesh(String),
    /// The format cannot hold the result.
    #[error(transparent)]
    Format(#[from] esvo_format::FormatError),
}
