//! The single measurements of a run: a build, the error of an octree, the check of an engine, a picture.

use std::sync::Arc;
use std::time::Instant;

use esvo_builder::{BuildError, BuildSettings, Mesh};
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
use crate::picture_bench::mesh_picture::shade_mesh;
use crate::scene::NamedView;
use crate::scene::Scene;
use crate::scene_triangles::SceneTriangles;
use crate::{BenchError, Progress};

/// Builds one octree of a scene.
pub(crate) fn build(
    scene: &Scene,
    triangles: &SceneTriangles,
    levels: u32,
    contours: bool,
    progress: &Progress,
) -> Result<(Octree, Table1Row), BenchError> {
    let kind = if contours { "with contours" } else { "cubical" };
    let what = format!("{}: building {levels} levels {kind}", scene.name);
    let settings = BuildSettings { levels, contours, ..scene.settings };
    let start = Instant::now();
    let report =
        |p: esvo_builder::Progress| progress.fraction(&what, p.done, &format!("{:.1} M voxels", p.voxels as f64 / 1e6));
    let built = triangles.build(&scene.mesh, &settings, &report).map_err(|e| BenchError::scene(&scene.name, e))?;
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
        displaced_triangles: scene.displaced.then_some(built.stats.triangles as u64),
    };
    Ok((built.octree, row))
}

/// The exact hits and pictures of the views of a scene. Rays of a view depend on the position of the root cube, which is the
/// same for all octrees of a mesh, so that each view is cast only once.
pub(crate) struct TriangleTruth<'a> {
    mesh: &'a Mesh,
    triangles: &'a SceneTriangles,
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
    pub(crate) fn new(mesh: &'a Mesh, triangles: &'a SceneTriangles, views: &'a mut ExactViews) -> Self {
        Self { mesh, triangles, views }
    }

    /// Casts the views that were not cast before, together: a mesh that is displaced part by part is so once for all of them.
    fn cast(&mut self, rays: &[CameraRays]) -> Result<(), BuildError> {
        let unknown = |rays: &&CameraRays| self.find(rays).is_none();
        let new: Vec<CameraRays> = rays.iter().filter(unknown).copied().collect();
        let seen = see(self.mesh, self.triangles, &new)?;
        let views = new.into_iter().zip(seen).map(|(rays, (hits, picture))| TrueView { rays, hits, picture });
        self.views.0.extend(views);
        Ok(())
    }

    fn find(&self, rays: &CameraRays) -> Option<&TrueView> {
        self.views.0.iter().find(|known| known.rays == *rays)
    }
}

/// The exact hits of each picture's rays, and the picture of the triangles. Holes of materials count as solid, as for the casters of
/// triangles that are timed; where the mesh is displaced part by part, nothing is timed, and rays pass through them.
fn see(
    mesh: &Mesh,
    triangles: &SceneTriangles,
    rays: &[CameraRays],
) -> Result<Vec<(Vec<TriangleHit>, Picture)>, BuildError> {
    let Some((mesh, triangles)) = triangles.whole(mesh) else {
        return Ok(triangles.see(mesh, rays)?.into_iter().map(|seen| (seen.hits, seen.picture)).collect());
    };
    let see = |rays: &CameraRays| {
        let hits = triangles.cast_exact(rays);
        let picture = shade_mesh(mesh, rays, &hits);
        (hits, picture)
    };
    Ok(rays.iter().map(see).collect())
}

/// The error of a variant against the triangles, view by view.
pub(crate) fn error(
    octree: &Arc<Octree>,
    views: &[View],
    variant: Variant,
    levels: u32,
    truth: &mut TriangleTruth,
) -> Result<ErrorRow, Box<dyn std::error::Error>> {
    // The rays of the views, as the casters use them: rounding in the camera is not an error of the octree.
    let rays_of = |view: &View| CameraRays::of_view(view, octree.octree_to_mesh(0));
    truth.cast(&views.iter().map(rays_of).collect::<Vec<_>>())?;
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
        let rays = rays_of(view);
        let Some(exact) = truth.find(&rays) else { continue };
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
    triangles: &SceneTriangles,
    camera: &Camera,
    octree: &Octree,
) -> Result<Option<Picture>, Box<dyn std::error::Error>> {
    let view = view(camera, octree, Variant::Contours, PICTURE_SIZE)?;
    let rays = CameraRays::of_view(&view, octree.octree_to_mesh(0));
    Ok(see(mesh, triangles, &[rays])?.pop().map(|(_, picture)| picture))
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
