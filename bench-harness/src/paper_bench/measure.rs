//! The single measurements of a run: a build, the error of an octree, the check of an engine, a picture.

use std::sync::Arc;
use std::time::Instant;

use esvo_builder::{BuildSettings, Mesh};
use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::gpu::triangles::TriangleCaster;
use esvo_core::shading::shade;
use esvo_core::{Camera, CastError, CastOptions, Caster, Picture, View};
use esvo_cpu::CpuCaster;
use esvo_cpu::triangles::TriangleScene;
use esvo_engines::EngineId;
use esvo_format::Octree;

use crate::build_summary::KindBytes;
use crate::content_hash::image_key;
use crate::error::depth::{DepthError, voxel_edges};
use crate::error::image::image_error;
use crate::paper_bench::check::{self, Agreement};
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::pair::{CHECK_SIZE, PICTURE_SIZE};
use crate::paper_bench::report::{CheckRow, ErrorRow, Table1Row};
use crate::picture_bench::mesh_picture;
use crate::scene::NamedView;
use crate::scene::Scene;
use crate::{BenchError, Progress};

/// Builds one octree of a scene.
pub(crate) fn build(
    scene: &Scene,
    mesh: &Mesh,
    levels: u32,
    contours: bool,
    progress: &Progress,
) -> Result<(Octree, Table1Row), BenchError> {
    let kind = if contours { "with contours" } else { "cubical" };
    let what = format!("{}: building {levels} levels {kind}", scene.name);
    let settings = BuildSettings { levels, contours, ..scene.settings };
    let start = Instant::now();
    let built = esvo_builder::build(mesh, &settings, &|p| {
        progress.fraction(&what, p.done, &format!("{:.1} M voxels", p.voxels as f64 / 1e6));
    })
    .map_err(|e| BenchError::scene(&scene.name, e))?;
    let seconds = start.elapsed().as_secs_f64();
    let stats = esvo_format::stats(&built.octree);
    let row = Table1Row {
        levels,
        contours,
        contour_error: settings.contour_error,
        color_error: settings.color_error,
        normal_error: settings.normal_error,
        seconds,
        image_sha256: image_key(&built.octree),
        bytes: stats.image_bytes,
        voxels: stats.voxels,
        leaves: stats.leaf_voxels,
        contour_count: stats.contours,
        far_pointers: stats.far_pointers,
        blocks: stats.blocks,
        kinds: (stats.bytes.named().iter())
            .map(|(kind, bytes)| KindBytes { kind: kind.to_string(), bytes: *bytes })
            .collect(),
        displaced_triangles: scene.displaced.then_some(mesh.triangle_count() as u64),
    };
    Ok((built.octree, row))
}

/// The exact hits and pictures of the views of a scene. Rays of a view depend on the position of the root cube, which is the
/// same for all octrees of a mesh, so that each view is cast only once.
pub(crate) struct TriangleTruth<'a> {
    mesh: &'a Mesh,
    triangles: &'a TriangleScene,
    views: &'a mut ExactViews,
}

/// The views that were cast against one mesh.
#[derive(Default)]
pub(crate) struct ExactViews(Vec<TrueView>);

struct TrueView {
    rays: CameraRays,
    hits: Vec<TriangleHit>,
    picture: Picture,
}

impl<'a> TriangleTruth<'a> {
    /// `views` are those that were cast against this mesh before.
    pub(crate) fn new(mesh: &'a Mesh, triangles: &'a TriangleScene, views: &'a mut ExactViews) -> Self {
        Self { mesh, triangles, views }
    }

    fn of(&mut self, rays: CameraRays) -> &TrueView {
        let views = &mut self.views.0;
        let known = views.iter().position(|known| known.rays == rays);
        let index = known.unwrap_or_else(|| {
            let hits = self.triangles.cast_exact(&rays);
            let picture = mesh_picture::shade_mesh(self.mesh, &rays, &hits);
            views.push(TrueView { rays, hits, picture });
            views.len() - 1
        });
        &views[index]
    }
}

/// The error of a variant against the triangles, view by view.
pub(crate) fn error(
    octree: &Arc<Octree>,
    views: &[View],
    variant: Variant,
    levels: u32,
    truth: &mut TriangleTruth,
) -> Result<ErrorRow, CastError> {
    let mut caster = CpuCaster::new(None)?;
    caster.load(octree)?;
    let mut hits = Vec::new();
    let mut errors = Vec::new();
    let mut pictures = Vec::new();
    let mut hit_levels = Vec::new();
    for view in views {
        caster.cast(view, &mut hits)?;
        let mut by_level = vec![0; levels as usize + 1];
        for hit in hits.iter().filter(|hit| !hit.is_miss()) {
            // A caster whose hits are wrong may name a level that the octree does not have: checks find that.
            by_level[hit.level().min(levels) as usize] += 1;
        }
        hit_levels.push(by_level);
        // The rays of the view, as the casters use them: rounding in the camera is not an error of the octree.
        let rays = CameraRays::of_view(view, octree.octree_to_mesh(0));
        let exact = truth.of(rays);
        errors.push(DepthError::between(&rays, &exact.hits, &hits, voxel_edges(octree, 0)));
        pictures.extend(image_error(&exact.picture, &shade(octree, view, &hits)));
    }
    Ok(ErrorRow { variant, levels, size: CHECK_SIZE, views: errors, pictures, hit_levels })
}

/// The view that shows the largest number of different voxels, so that pictures do not show a wall.
pub(crate) fn richest_view<'a>(views: &'a [NamedView], octree: &Arc<Octree>) -> Result<&'a NamedView, CastError> {
    let mut caster = CpuCaster::new(None)?;
    caster.load(octree)?;
    let mut hits = Vec::new();
    let mut best = (0, &views[0]);
    for named in views {
        caster.cast(&view(&named.camera, octree, Variant::Contours, CHECK_SIZE)?, &mut hits)?;
        let mut seen: Vec<(u32, u32)> = hits.iter().map(|h| (h.slot, h.voxel)).collect();
        seen.sort_unstable();
        seen.dedup();
        if seen.len() > best.0 {
            best = (seen.len(), named);
        }
    }
    Ok(best.1)
}

/// The shaded picture of the triangles themselves with the rays of a view, cast in double precision.
pub(crate) fn mesh_picture(
    mesh: &Mesh,
    triangles: &TriangleScene,
    camera: &Camera,
    octree: &Octree,
) -> Result<Picture, CastError> {
    let view = view(camera, octree, Variant::Contours, PICTURE_SIZE)?;
    let rays = CameraRays::of_view(&view, octree.octree_to_mesh(0));
    Ok(mesh_picture::shade_mesh(mesh, &rays, &triangles.cast_exact(&rays)))
}

/// A shaded picture, cast on the CPU.
pub(crate) fn picture(camera: &Camera, octree: &Arc<Octree>, variant: Variant) -> Result<Picture, CastError> {
    let view = view(camera, octree, variant, PICTURE_SIZE)?;
    let mut caster = CpuCaster::new(None)?;
    caster.load(octree)?;
    let mut hits = Vec::new();
    caster.cast(&view, &mut hits)?;
    Ok(shade(octree, &view, &hits))
}

/// The view of a variant.
pub(crate) fn view(camera: &Camera, octree: &Octree, variant: Variant, [w, h]: [u32; 2]) -> Result<View, CastError> {
    let options =
        CastOptions { contours: variant != Variant::Cubical, beam: variant == Variant::Beam, max_voxel_pixels: 1.0 };
    View::new(camera, octree.octree_to_mesh(0), octree.objects()[0].root_slot as u32, (w, h), &options)
}

/// Checks the answers of one engine on one variant. If the caster fails, no pixels are compared and the check fails.
pub(crate) fn check(
    caster: &mut dyn Caster,
    backend: EngineId,
    octree: &Arc<Octree>,
    views: &[View],
    variant: Variant,
    levels: u32,
) -> CheckRow {
    let allowed = backend.allowed();
    let (agreement, error) = match check::check(caster, octree, views, allowed) {
        Ok(agreement) => (agreement, None),
        Err(e) => (Agreement { allowed, ..Agreement::default() }, Some(e.to_string())),
    };
    CheckRow { backend, variant, levels, size: CHECK_SIZE, agreement, undecided: None, error }
}

/// Checks a GPU's answers on the triangles. If the caster fails, no pixels are compared and the check fails.
pub(crate) fn check_triangles(
    caster: &mut dyn TriangleCaster,
    backend: EngineId,
    triangles: &TriangleScene,
    pictures: &[CameraRays],
) -> CheckRow {
    let (agreement, undecided, error) = match check::check_triangles(caster, triangles, pictures) {
        Ok((agreement, undecided)) => (agreement, Some(undecided), None),
        Err(e) => (Agreement::default(), None, Some(e.to_string())),
    };
    CheckRow { backend, variant: Variant::Triangles, levels: 0, size: CHECK_SIZE, agreement, undecided, error }
}
