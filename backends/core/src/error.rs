//! Why a frame could not be cast.

use esvo_format::Broken;

/// Why a frame could not be cast.
#[derive(Debug, thiserror::Error)]
pub enum CastError {
    /// A number of a camera, or of the options that go with it, is out of its range.
    #[error("camera: {0}")]
    Camera(String),
    /// A picture without pixels or with too many, or a number of a [`View`](crate::View) that is out of its range.
    #[error("view: {0}")]
    View(String),
    /// Rays would start at a slot that is the root of no object.
    #[error("root {root} is not the root of an object: the loaded octree has {}; take root_slot of one of its objects", list(.roots))]
    Root {
        /// The slot.
        root: u32,
        /// Root slots of the loaded octree, ascending.
        roots: Vec<u32>,
    },
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

/// The first few slots, and how many there are if that is not all.
fn list(slots: &[u32]) -> String {
    const MOST: usize = 4;
    let mut text = slots.iter().take(MOST).map(u32::to_string).collect::<Vec<_>>().join(", ");
    if slots.len() > MOST {
        text += &format!(", ... ({} in all)", slots.len());
    }
    text
}
