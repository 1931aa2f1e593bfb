//! Reading and writing files of the paper's authors (`.oct`, ESVO 1.x).
//!
//! These files contain the same octrees in another order: a container of numbered chunks (`clusters`) with a list of
//! objects and the *slices* of each object (`slice`). A slice is the voxels of one level in one cube. Contours, blocks
//! of colours, normals and ambient occlusion, values of voxels (palettes there, plain attachments here) and values at
//! corners have the same bits in both formats and are copied unchanged. [`Imported::lost`] and the result of
//! [`write()`] list, in one sentence each, everything that the other format cannot represent. In `.oct` files these are
//! meshes and slices that have not been built; in esvo files metadata, unknown sections, attachments without a
//! counterpart, and combinations of attachments that `.oct` files do not support.
//!
//! ```no_run
//! use std::path::Path;
//!
//! let imported = esvo_format::oct::open(Path::new("sibenik.oct"))?;
//! for loss in &imported.lost {
//!     eprintln!("lost: {loss}");
//! }
//! imported.octree.write(Path::new("sibenik.esvo"))?;
//! esvo_format::oct::write(&imported.octree, Path::new("again.oct"))?;
//! # Ok::<(), esvo_format::FormatError>(())
//! ```

mod clusters;
mod export;
mod export_values;
mod import;
mod layers;
mod slice;
mod values;

use std::fs::File;
use std::io::{Cursor, Write};
use std::path::Path;

use crate::{FormatError, Octree};

/// An octree from an `.oct` file.
pub struct Imported {
    /// The octree, with one object for each object of the file that has voxels.
    pub octree: Octree,
    /// What was lost or changed, one sentence each. Empty if nothing was.
    pub lost: Vec<String>,
}

/// Reads an `.oct` file. Memory is proportional to the length of the file, also for damaged files.
///
/// # Errors
/// The system's; a file that is damaged ([`FormatError::Oct`]), compressed with zlib, or without voxels.
pub fn open(path: &Path) -> Result<Imported, FormatError> {
    // Check before opening, as opening a pipe waits for a writer.
    let metadata = std::fs::metadata(path).map_err(|e| FormatError::io(path, e))?;
    if !metadata.is_file() {
        return Err(FormatError::io(path, std::io::Error::other("not a regular file")));
    }
    let file = File::open(path).map_err(|e| FormatError::io(path, e))?;
    import::import(clusters::Clusters::open(file, path)?)
}

/// Reads an `.oct` file in memory.
///
/// # Errors
/// Those of [`open`], except the system's.
pub fn from_bytes(bytes: &[u8]) -> Result<Imported, FormatError> {
    import::import(clusters::Clusters::open(Cursor::new(bytes), Path::new("bytes in memory"))?)
}

/// Writes an octree as an `.oct` file, to a temporary file in the folder of `path` that is renamed: `path` is either
/// untouched or complete. Returns what was lost or changed, one sentence each. The same octree always gives the same
/// bytes.
///
/// The file is assembled in memory before it is written.
///
/// # Errors
/// The system's; an octree of a file that is not [verified](Octree::verified), one that is not [sound](Octree::sound), or
/// one too large for the format.
pub fn write(octree: &Octree, path: &Path) -> Result<Vec<String>, FormatError> {
    let exported = export::export(octree)?;
    crate::write_atomically(path, |out| exported.file.write_to(out)).map_err(|e| FormatError::io(path, e))?;
    Ok(exported.lost)
}

/// Like [`write()`], to any output.
///
/// # Errors
/// Those of [`write()`]; those of `out` as [`FormatError::Io`] with the path `output`.
pub fn write_to(octree: &Octree, out: &mut dyn Write) -> Result<Vec<String>, FormatError> {
    let exported = export::export(octree)?;
    exported.file.write_to(out).map_err(|e| FormatError::io(Path::new("output"), e))?;
    Ok(exported.lost)
}

/// An error about the part `place` of the file.
fn fault(place: impl Into<String>, what: impl Into<String>) -> FormatError {
    FormatError::Oct { place: place.into(), what: what.into() }
}

/// Types of attachments in slices.
mod kind {
    /// Colours and normals in blocks.
    pub(super) const BLOCKS: u32 = 1;
    /// A colour and a normal for every voxel whose values differ from its parent's.
    pub(super) const PALETTE: u32 = 3;
    /// Contours.
    pub(super) const CONTOURS: u32 = 6;
    /// A colour and a normal for every corner of a voxel.
    pub(super) const CORNERS: u32 = 7;
    /// Ambient occlusion.
    pub(super) const OCCLUSION: u32 = 10;
}
