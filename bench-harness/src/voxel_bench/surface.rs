//! From a mesh to what a GPU voxelizes, and from its voxels to cells of an octree.

use esvo_builder::cells::{Cells, PreparedMesh};
use esvo_builder::{Mesh, Wrap as MeshWrap};
use esvo_raster::{
    Looks, Material, Method, Options, Pair, RasterError, Stats, Surface, Texture, TriangleLook, Voxelizer, Wanted, Wrap,
};
use glam::DVec3;
use rayon::prelude::*;

use crate::BenchError;

/// Cells with what it took to find them.
pub struct GpuVoxels {
    /// The cells, with the attributes that were wanted.
    pub cells: Cells,
    /// Times and counts.
    pub stats: Stats,
}

/// How the triangles of a mesh look. Normal maps and holes by alpha are left out.
pub(crate) fn looks(mesh: &Mesh, prepared: &PreparedMesh) -> Looks {
    let mut textures: Vec<Texture> = Vec::new();
    let mut known: Vec<*const esvo_builder::Texture> = Vec::new();
    let materials = (mesh.materials.iter())
        .map(|material| {
            let [red, green, blue, _] = material.base_color;
            let texture = material.texture.as_ref().filter(|_| !mesh.uvs.is_empty()).map(|texture| {
                let address = std::sync::Arc::as_ptr(texture);
                let index = known.iter().position(|known| *known == address).unwrap_or_else(|| {
                    known.push(address);
                    textures.push(texture_of(texture));
                    textures.len() - 1
                });
                index as u32
            });
            Material { color: [red, green, blue], texture }
        })
        .collect();
    let triangles = (0..prepared.corners().len())
        .into_par_iter()
        .map(|index| {
            let source = prepared.source(index) as usize;
            let vertices = mesh.triangles[source].map(|vertex| vertex as usize);
            let [a, b, c] = prepared.corners()[index];
            let flat = (b - a).cross(c - a).normalize_or(DVec3::Z).as_vec3().to_array();
            let of = |vertex: usize| mesh.normals.get(vertex).copied().unwrap_or(flat);
            TriangleLook {
                normals: vertices.map(of),
                uvs: vertices.map(|vertex| mesh.uvs.get(vertex).copied().unwrap_or_default()),
                colors: vertices
                    .map(|vertex| mesh.colors.get(vertex).map_or([1.0; 3], |color| [color[0], color[1], color[2]])),
                material: mesh.triangle_materials[source],
            }
        })
        .collect();
    Looks { triangles, materials, textures }
}

fn texture_of(texture: &esvo_builder::Texture) -> Texture {
    let wrap = |wrap: MeshWrap| match wrap {
        MeshWrap::Repeat => Wrap::Repeat,
        MeshWrap::Mirror => Wrap::Mirror,
        MeshWrap::Clamp => Wrap::Clamp,
    };
    Texture {
        width: texture.mips[0].width,
        height: texture.mips[0].height,
        mips: texture.mips.iter().map(|level| level.texels.clone()).collect(),
        wrap: texture.wrap.map(wrap),
    }
}

/// Voxelizes a mesh on a GPU. What single precision cannot decide is decided by the builder, so that [`Method::Compute`] finds the
/// builder's voxels.
///
/// # Errors
/// A mesh, level, method or device that cannot be used.
pub fn voxelize_mesh(
    voxelizer: &Voxelizer,
    mesh: &Mesh,
    prepared: &PreparedMesh,
    level: u32,
    method: Method,
    wanted: Wanted,
) -> Result<GpuVoxels, RasterError> {
    let looks = (wanted != Wanted::default()).then(|| looks(mesh, prepared));
    let surface = Surface { corners: prepared.corners(), looks: looks.as_ref() };
    let decide = |pairs: &[Pair]| decide(prepared, level, pairs);
    let options = Options { wanted, decide: Some(&decide), ..Options::new(level, method) };
    let found = voxelizer.voxelize(&surface, &options)?;
    let colors = if wanted.colors { found.attributes.iter().map(|a| a.color).collect() } else { Vec::new() };
    let normals = if wanted.normals { found.attributes.iter().map(|a| a.normal).collect() } else { Vec::new() };
    Ok(GpuVoxels { cells: Cells { levels: level, codes: found.codes, colors, normals }, stats: found.stats })
}

/// What the builder says of pairs of triangle and voxel.
pub(crate) fn decide(prepared: &PreparedMesh, level: u32, pairs: &[Pair]) -> Vec<bool> {
    pairs.par_iter().map(|pair| prepared.meets(pair.triangle as usize, pair.cell, level)).collect()
}

/// An error of the voxelizer, of a scene.
pub(crate) fn failed(scene: &str, error: impl ToString) -> BenchError {
    BenchError::scene(scene, error)
}
