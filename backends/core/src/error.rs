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
    #[error(
        "slot {root} is not the root of an object of the loaded octree, whose roots are {}: take root_slot of one of its objects",
        list(.roots)
    )]
    Root {
        /// The slot.
        root: u32,
        /// Root slots of the loaded octree, ascending.
        roots: Vec<u32>,
    },
    /// The bytes of the octree's file are not those that were written.
    #[error("the octree is damaged: {0}; get the file again, `esvo validate` lists everything")]
    Damaged(Broken),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_root_is_told_with_the_right_ones() {
        let text = |roots: &[u32]| CastError::Root { root: 7, roots: roots.to_vec() }.to_string();
        assert_eq!(
            text(&[2, 514]),
            "slot 7 is not the root of an object of the loaded octree, whose roots are 2, 514: take root_slot of one of \
             its objects"
        );
        assert!(text(&[2, 4, 6, 8, 10]).contains("are 2, 4, 6, 8, ... (5 in all): take"));
    }
}
