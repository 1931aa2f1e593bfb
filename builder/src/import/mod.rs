//! Reads triangle meshes from files: OBJ, glTF (text and binary), PLY and STL (text and binary); and voxel models: `.vox` of
//! MagicaVoxel.
//!
//! The result is either a mesh that [`Mesh::validate`] accepts or one error that names the file and the place in it.
//! Bad input causes no panics and no endless loops, and memory stays proportional to the file (within the limits below).

mod assembly;
mod error;
mod file;
mod foreign;
mod gltf;
mod gltf_alpha;
mod gltf_data;
mod gltf_json;
mod gltf_material;
mod gltf_pose;
mod gltf_properties;
mod gltf_scene;
mod gltf_texture;
mod image;
mod loss;
mod map_statement;
mod mtl;
mod mtl_material;
mod names;
mod need;
mod numbers;
mod obj;
mod obj_text;
mod ply;
mod ply_elements;
mod ply_file;
mod ply_mesh;
mod polygon;
mod stl;
mod vox;

use std::io::{self, Read};
use std::path::Path;

use crate::mesh::Mesh;
use crate::mesh::maps::{HeightMap, UvTransform};
use crate::voxels::VoxelModel;
use file::{Content, open, read_file};
use image::{Channel, TextureStore};

pub use crate::mesh::{MAX_ELEMENTS, MAX_TEXTURE_SIDE, TextureError};
pub use error::ImportError;
pub use file::Format;
pub use image::MAX_TEXTURE_TEXELS;

/// Reads a mesh, its materials and its textures.
///
/// The extension decides the format (`.obj`, `.gltf`, `.glb`, `.ply`, `.stl`, in any case), and the first bytes must agree
/// with it. Things that can be left out without losing triangles (a missing texture, a line primitive) are listed in
/// [`Mesh::warnings`].
///
/// # Errors
/// See [`ImportError`]. A mesh without triangles, with a vertex that is not finite, or with an index out of range is an
/// error. Files of other programs that cannot be read (point clouds, volumes) are named in the error.
pub fn load_mesh(path: &Path) -> Result<Mesh, ImportError> {
    load_mesh_within(path, format_of(path)?, u64::MAX, false)
}

/// Reads a mesh from a file of this format, whatever its extension, unless that needs more than `limit` bytes of memory.
///
/// The need is estimated before the file is read, and again before it is parsed: what the file's bytes and the mesh take at least.
/// Images, and the buffers that a glTF file names, come on top of it.
///
/// With `property_maps`, the textures of emission, roughness and metalness of a glTF file are read, too ([`Properties`](crate::Properties));
/// without, and by [`load_mesh`], they count as white.
///
/// # Errors
/// As [`load_mesh`], and [`ImportError::Memory`].
pub fn load_mesh_within(path: &Path, format: Format, limit: u64, property_maps: bool) -> Result<Mesh, ImportError> {
    let (file, length) = open(path)?;
    if format == Format::Stl {
        let mut head = Vec::new();
        let failed = |source| ImportError::Read { path: path.into(), source };
        (&file).take(stl::HEAD as u64).read_to_end(&mut head).map_err(failed)?;
        check_content(path, format, &head)?;
        need::check(path, need::of_stl(&head, length), limit)?;
        return checked(path, stl::load(path, &head, file, length)?);
    }
    need::check(path, length, limit)?;
    let bytes = read_file(path)?;
    check_content(path, format, &bytes)?;
    if limit < u64::MAX {
        need::check(path, need::of_bytes(format, &bytes), limit)?;
    }
    load_mesh_from(path, format, bytes, property_maps)
}

/// Reads a mesh from the bytes of its file. `path` is its name in messages. Files that it refers to are searched in the
/// folder of `path`: for a name without a folder, in the working directory. For `property_maps` see [`load_mesh_within`].
///
/// # Errors
/// As [`load_mesh`].
pub fn load_mesh_from(path: &Path, format: Format, bytes: Vec<u8>, property_maps: bool) -> Result<Mesh, ImportError> {
    check_content(path, format, &bytes)?;
    let mesh = match format {
        Format::Obj => obj::load(path, bytes)?,
        Format::Gltf | Format::Glb => gltf::load(path, bytes, property_maps)?,
        Format::Ply => ply::load(path, &bytes)?,
        Format::Stl => {
            let (head, rest) = bytes.split_at(bytes.len().min(stl::HEAD));
            stl::load(path, head, rest, bytes.len() as u64)?
        }
        Format::Vox => {
            return Err(ImportError::unsupported(
                path,
                "is a voxel model, not a mesh; esvo build makes an octree from it",
            ));
        }
    };
    checked(path, mesh)
}

fn checked(path: &Path, mesh: Mesh) -> Result<Mesh, ImportError> {
    mesh.validate().map_err(|source| ImportError::Mesh { path: path.into(), source })?;
    Ok(mesh)
}

/// Reads a voxel model of MagicaVoxel (`.vox`): all models as its scene places them, with the colours of its palette.
/// Voxels at the same place: that of the later model counts.
///
/// # Errors
/// See [`ImportError`].
pub fn load_voxels(path: &Path) -> Result<VoxelModel, ImportError> {
    load_voxels_from(path, &read_file(path)?)
}

/// Reads a voxel model from the bytes of its file. `path` is its name in messages.
///
/// # Errors
/// As [`load_voxels`].
pub fn load_voxels_from(path: &Path, bytes: &[u8]) -> Result<VoxelModel, ImportError> {
    check_content(path, Format::Vox, bytes)?;
    vox::load(path, bytes)
}

/// The format of a file by its extension.
///
/// # Errors
/// The extension is of no format that can be read; the error says what the file is, if its content shows that.
pub fn format_of(path: &Path) -> Result<Format, ImportError> {
    if let Some(format) = Format::of_extension(path) {
        return Ok(format);
    }
    // For a directory without an extension, `NotAFile` is the more helpful message.
    if path.is_dir() {
        return Err(ImportError::NotAFile { path: path.into() });
    }
    let head = foreign::head(path);
    Err(match foreign::of_content(&head).or_else(|| foreign::of_extension(path)) {
        Some(what) => ImportError::unsupported(path, what),
        None => ImportError::UnknownKind { path: path.into() },
    })
}

/// Checks that the first bytes of a file agree with its format.
fn check_content(path: &Path, format: Format, bytes: &[u8]) -> Result<(), ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::Empty { path: path.into() });
    }
    // The header of a binary STL file may contain any text.
    if format != Format::Stl
        && let Some(what) = foreign::of_content(bytes)
    {
        return Err(ImportError::unsupported(path, what));
    }
    let found = Content::of(bytes);
    if format.allows(found) {
        return Ok(());
    }
    let by_extension = Format::of_extension(path) == Some(format);
    Err(ImportError::WrongKind {
        path: path.into(),
        expected: format.description(),
        source_of_format: if by_extension { "its extension" } else { "the given format" },
        found: found.description(),
    })
}

/// Whether the extension of `path` is one that [`load_mesh`] can read.
#[must_use]
pub fn is_mesh_file(path: &Path) -> bool {
    Format::of_extension(path).is_some_and(|format| format != Format::Vox)
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
