//! Reads triangle meshes from files: OBJ, glTF (text and binary), PLY and STL (text and binary).
//!
//! The result is either a mesh that [`Mesh::validate`] accepts or one error that names the file and the place in it.
//! Bad input causes no panics and no endless loops, and memory stays proportional to the file (within the limits below).

mod assembly;
mod error;
mod file;
mod gltf;
mod gltf_data;
mod gltf_material;
mod image;
mod loss;
mod map_statement;
mod mtl;
mod mtl_material;
mod names;
mod numbers;
mod obj;
mod obj_text;
mod ply;
mod ply_file;
mod polygon;
mod stl;

use std::io;
use std::path::Path;

use crate::mesh::Mesh;
use crate::mesh::maps::{HeightMap, UvTransform};
use file::{Content, Kind, read_file};
use image::{Channel, TextureStore};

pub use crate::mesh::{MAX_ELEMENTS, MAX_TEXTURE_SIDE, TextureError};
pub use error::ImportError;
pub use image::MAX_TEXTURE_TEXELS;

/// Reads a mesh, its materials and its textures.
///
/// The extension decides the format (`.obj`, `.gltf`, `.glb`, `.ply`, `.stl`, in any case), and the first bytes must agree
/// with it. Things that can be left out without losing triangles (a missing texture, a line primitive) are listed in
/// [`Mesh::warnings`].
///
/// # Errors
/// See [`ImportError`]. A mesh without triangles, with a vertex that is not finite, or with an index out of range is an
/// error.
pub fn load_mesh(path: &Path) -> Result<Mesh, ImportError> {
    let kind = Kind::of_extension(path).ok_or_else(|| {
        // For a directory without an extension, `NotAFile` is the more helpful message.
        if path.is_dir() {
            ImportError::NotAFile { path: path.into() }
        } else {
            ImportError::UnknownKind { path: path.into() }
        }
    })?;
    let bytes = read_file(path)?;
    if bytes.is_empty() {
        return Err(ImportError::Empty { path: path.into() });
    }
    let found = Content::of(&bytes);
    if !kind.allows(found) {
        return Err(ImportError::WrongKind {
            path: path.into(),
            expected: kind.description(),
            found: found.description(),
        });
    }
    let mesh = match kind {
        Kind::Obj => obj::load(path, &bytes)?,
        Kind::Gltf | Kind::Glb => gltf::load(path, bytes)?,
        Kind::Ply => ply::load(path, &bytes)?,
        Kind::Stl => stl::load(path, &bytes)?,
    };
    mesh.validate().map_err(|source| ImportError::Mesh { path: path.into(), source })?;
    Ok(mesh)
}

/// Whether the extension of `path` is one that [`load_mesh`] can read.
#[must_use]
pub fn is_mesh_file(path: &Path) -> bool {
    Kind::of_extension(path).is_some()
}

/// Reads an image as a height map with amplitude 1 and bias 0. The height is the luminance: black is 0, white is 1.
///
/// # Errors
/// See [`ImportError`].
pub fn load_height_map(image: &Path) -> Result<HeightMap, ImportError> {
    let texture = TextureStore::default().load_heights(image, image, Channel::Luminance)?;
    match texture {
        Some(texture) => Ok(HeightMap { texture, amplitude: 1.0, bias: 0.0, uv_transform: UvTransform::IDENTITY }),
        None => Err(ImportError::Read { path: image.into(), source: io::ErrorKind::NotFound.into() }),
    }
}
