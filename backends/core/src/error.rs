//! Why a frame could not be cast.

use esvo_format::Broken;

/// Why a frame could not be cast.
#[derive(Debug, thiserror::Error)]
pub enum CastError {
    /// The camera or the picture makes no sense.
    #[error("camera: {0}")]
    Camera(String),
    /// The octree breaks a rule of the format.
    #[error("the octree is not sound: {0}")]
    Unsound(#[from] Broken),
    /// Nothing was loaded.
    #[error("no octree is loaded")]
    NotLoaded,
    /// No device, or one that cannot do it. The text says what to install or use instead.
    #[error("{0}")]
    Device(String),
}
