//! Pictures of voxels.

use std::sync::Arc;

use esvo_builder::BuildSettings;
use esvo_builder::cells::{Cells, build_cells};
use esvo_core::{Camera, CastOptions, Caster, Picture, View};
use esvo_cpu::CpuCaster;
use esvo_raster::morton;
use glam::{DMat4, Vec3};

use super::{SIZE, SKY, smooth};
use crate::BenchError;
use crate::voxel_bench::surface::failed;

/// Voxels, ascending, of a grid of this level, as cubes with dark edges.
///
/// # Errors
/// A camera that is not possible; what the builder and the caster say.
pub(super) fn cubes(
    (level, codes): (u32, &[u64]),
    octree_to_mesh: DMat4,
    camera: &Camera,
    color: impl Fn(u64) -> [f32; 3] + Sync,
) -> Result<Picture, BenchError> {
    let error = |e: &dyn ToString| failed("picture", e.to_string());
    if codes.is_empty() {
        return Ok(Picture::from_fn(SIZE, |_, _| SKY));
    }
    let cells = Cells { levels: level, codes: codes.to_vec(), ..Cells::default() };
    let built = build_cells(&cells, octree_to_mesh, &BuildSettings::default()).map_err(|e| error(&e))?;
    let octree = Arc::new(built.octree);
    let root = octree.objects()[0].root_slot as u32;
    let (width, height) = (SIZE.0 * 2, SIZE.1 * 2);
    let options = CastOptions { contours: false, beam: false, max_voxel_pixels: 0.0 };
    let view = View::new(camera, octree.octree_to_mesh(0), root, (width, height), &options).map_err(|e| error(&e))?;
    let mut caster = CpuCaster::new(None).map_err(|e| error(&e))?;
    caster.load(&octree).map_err(|e| error(&e))?;
    let mut hits = Vec::new();
    caster.cast(&view, &mut hits).map_err(|e| error(&e))?;
    Ok(smooth(|x, y| {
        let Some(t) = hits[(y * width + x) as usize].t() else { return SKY };
        let ray = view.ray(x, y);
        let scale = (1u32 << level) as f32;
        let at = (ray.origin + ray.direction * t - 1.0) * scale;
        let inside = at + ray.direction.normalize() * 1e-2;
        let cell = inside.floor().clamp(Vec3::ZERO, Vec3::splat(scale - 1.0));
        // The face that the point lies on, and how near it is to an edge of the cube.
        let from_border = (0.5 - (at - cell - 0.5).abs()).to_array();
        let face = (0..3).min_by(|a, b| from_border[*a].total_cmp(&from_border[*b])).unwrap_or(0);
        let to_edge = (0..3).filter(|axis| *axis != face).map(|axis| from_border[axis]).fold(1.0, f32::min);
        let light = [0.80, 0.66, 1.0][face] * if to_edge < 0.05 { 0.72 } else { 1.0 };
        color(morton(cell.to_array().map(|x| x as u32))).map(|c| c * light)
    }))
}
