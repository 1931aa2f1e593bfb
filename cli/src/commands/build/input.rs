//! What `esvo build` builds: a mesh or a voxel model, from a file or from standard input.

use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

use esvo_bench::Progress;
use esvo_builder::import::{
    Format, ImportError, format_of, load_mesh_from, load_mesh_within, load_voxels, load_voxels_from,
};
use esvo_builder::{DisplaceOptions, Mesh, VoxelModel};

use crate::fail::Failure;
use crate::files::extension;

/// The name of standard input in messages.
const STANDARD_INPUT: &str = "standard input";

/// What is built.
pub(crate) enum Input {
    Mesh(Mesh),
    /// A mesh that is displaced while it is built.
    Displaced(Mesh, DisplaceOptions),
    Voxels(VoxelModel),
}

impl Input {
    /// Triangles before those that are displaced while building are diced.
    pub(crate) fn triangles(&self) -> usize {
        match self {
            Self::Mesh(mesh) | Self::Displaced(mesh, _) => mesh.triangle_count(),
            Self::Voxels(_) => 0,
        }
    }

    pub(crate) fn warnings(&self) -> &[String] {
        match self {
            Self::Mesh(mesh) | Self::Displaced(mesh, _) => &mesh.warnings,
            Self::Voxels(model) => &model.warnings,
        }
    }

    /// The mesh, or for a voxel model one without triangles that has its warnings.
    pub(crate) fn summary_mesh(&self) -> Cow<'_, Mesh> {
        match self {
            Self::Mesh(mesh) | Self::Displaced(mesh, _) => Cow::Borrowed(mesh),
            Self::Voxels(model) => Cow::Owned(Mesh { warnings: model.warnings.clone(), ..Mesh::default() }),
        }
    }
}

/// Whether a path stands for standard input.
pub(crate) fn is_standard_input(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Reads a mesh or voxel model. Returns it with its name.
///
/// A mesh that needs more than `limit` bytes of memory is refused before it is read.
pub(crate) fn read_input(
    path: &Path,
    format: Option<Format>,
    limit: Option<u64>,
    property_maps: bool,
    progress: &Progress,
) -> Result<(Input, String), Failure> {
    if is_standard_input(path) {
        let format = format.ok_or("standard input has no extension; give its format, e.g. --format obj")?;
        progress.say(format!("reading {STANDARD_INPUT}"));
        let mut bytes = Vec::new();
        std::io::stdin()
            .lock()
            .read_to_end(&mut bytes)
            .map_err(|e| format!("{STANDARD_INPUT}: cannot be read: {e}"))?;
        return Ok((of_bytes(Path::new(STANDARD_INPUT), format, bytes, property_maps)?, STANDARD_INPUT.to_owned()));
    }
    progress.say(format!("reading {}", path.display()));
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let format = format.map_or_else(|| format_of(path), Ok).map_err(|e| explain(path, &e))?;
    let input = match format {
        Format::Vox => Input::Voxels(load_voxels(path).map_err(|e| e.to_string())?),
        _ => {
            let mesh = load_mesh_within(path, format, limit.unwrap_or(u64::MAX), property_maps);
            Input::Mesh(mesh.map_err(|e| explain(path, &e))?)
        }
    };
    Ok((input, name))
}

fn of_bytes(path: &Path, format: Format, bytes: Vec<u8>, property_maps: bool) -> Result<Input, Failure> {
    Ok(match format {
        Format::Vox => Input::Voxels(load_voxels_from(path, &bytes).map_err(|e| e.to_string())?),
        _ => Input::Mesh(load_mesh_from(path, format, bytes, property_maps).map_err(|e| e.to_string())?),
    })
}

/// The error of the importer; it also says what to do if the file is an octree already.
fn explain(path: &Path, error: &ImportError) -> String {
    match error {
        ImportError::UnknownKind { .. } if matches!(extension(path).as_str(), "esvo" | "oct") => {
            format!("{}: is an octree already; octrees are built from meshes", path.display())
        }
        _ => error.to_string(),
    }
}
