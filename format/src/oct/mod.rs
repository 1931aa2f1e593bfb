//! Files of the paper's authors (`.oct`, ESVO 1.x), read and written.
//!
//! Their files hold the same octrees in another order: a container of numbered chunks (`clusters`), in it a list of
//! objects and the *slices* of each (`slice`), a slice being the voxels of one level in one cube. Contours, blocks of
//! colours, normals and ambient occlusion, values of voxels (palettes there, plain attributes here) and values at corners
//! have the same bits in both formats and are carried over as they are. What one side cannot hold is listed, a sentence
//! each, in [`Imported::lost`] and in what [`write()`] returns: of their files, meshes and the plans for slices that have
//! not been built; of ours, metadata, sections and attachments that are not theirs, and what they have in one way only.
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
mod merge;
mod slice;
mod values;

use std::fs::File;
use std::io::{Cursor, Write};
use std::path::Path;

use crate::{FormatError, Octree};

/// An octree from an `.oct` file.
pub struct Imported {
    /// The octree: one object for each of the file that has voxels.
    pub octree: Octree,
    /// What of the file is not in it, or changed on the way; empty if nothing.
    pub lost: Vec<String>,
}

/// Reads an `.oct` file.
///
/// Takes memory in proportion to the length of the file, whatever its bytes say.
///
/// # Errors
/// The system's; a file that is damaged ([`FormatError::Oct`]), is compressed with zlib, or has no voxels.
pub fn open(path: &Path) -> Result<Imported, FormatError> {
    // Asked before opening: to open a pipe would wait for a writer.
    let metadata = std::fs::metadata(path).map_err(|e| FormatError::io(path, e))?;
    if !metadata.is_file() {
        return Err(FormatError::io(path, std::io::Error::other("not a regular file")));
    }
    let file = File::open(path).map_err(|e| FormatError::io(path, e))?;
    import::import(clusters::Clusters::open(file, path)?)
}

/// Reads an `.oct` file that is in memory.
///
/// # Errors
/// As [`open`], but for the system's.
pub fn from_bytes(bytes: &[u8]) -> Result<Imported, FormatError> {
    import::import(clusters::Clusters::open(Cursor::new(bytes), Path::new("bytes in memory"))?)
}

/// Writes an octree as an `.oct` file, to a temporary beside `path` that is renamed: `path` is either untouched or
/// complete. Returns what the file cannot hold, a sentence each; the same octree always gives the same bytes.
///
/// The file is put together in memory before it is written.
///
/// # Errors
/// The system's; an octree that is not [sound](Octree::sound), or larger than the numbers of the file can say.
pub fn write(octree: &Octree, path: &Path) -> Result<Vec<String>, FormatError> {
    let exported = export::export(octree)?;
    crate::write_atomically(path, |out| exported.file.write_to(out)).map_err(|e| FormatError::io(path, e))?;
    Ok(exported.lost)
}

/// Like [`write()`], to anything that takes bytes.
///
/// # Errors
/// As [`write()`]; those of `out` come as [`FormatError::Io`] without a path.
pub fn write_to(octree: &Octree, out: &mut dyn Write) -> Result<Vec<String>, FormatError> {
    let exported = export::export(octree)?;
    exported.file.write_to(out).map_err(|e| FormatError::io(Path::new("output"), e))?;
    Ok(exported.lost)
}

/// Something wrong with the file.
fn fault(place: impl Into<String>, what: impl Into<String>) -> FormatError {
    FormatError::Oct { place: place.into(), what: what.into() }
}

/// Types of attachments in slices.
mod kind {
    /// Colours and normals in blocks.
    pub(super) const BLOCKS: u32 = 1;
    /// A colour and a normal for every voxel that differs from its parent.
    pub(super) const PALETTE: u32 = 3;
    /// Contours.
    pub(super) const CONTOURS: u32 = 6;
    /// A colour and a normal for every corner of a voxel.
    pub(super) const CORNERS: u32 = 7;
    /// Ambient occlusion.
    pub(super) const OCCLUSION: u32 = 10;
}
