//! The single measurements that a run is made of: a build, an error, a check, a picture, a row of times.

use std::sync::Arc;
use std::time::Instant;

use esvo_builder::{BuildSettings, Mesh};
use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::shading::shade;
use esvo_core::{Camera, CastError, CastOptions, Caster, Picture, View};
use esvo_cpu::CpuCaster;
use esvo_cpu::triangles::TriangleScene;
use esvo_format::Octree;

use crate::error::depth::{DepthError, voxel_edges};
use crate::error::image::image_error;
use crate::paper_bench::check::{self, Agreement};
use crate::paper_bench::matrix::{Matrix, Variant};
use crate::paper_bench::report::{BuildRow, CheckRow, ErrorRow, KindBytes, NamedView, TimeCell};
use crate::paper_bench::run::{CHECK_SIZE, Engine, PICTURE_SIZE};
use crate::picture_bench::mesh_picture;
use crate::scene::Scene;
use crate::system::clock::Clock;
use crate::timing::{Samples, Spread};
use crate::{Backend, BenchError, Progress};

/// Builds one octree of a scene.
pub(crate) fn build(
    scene: &Scene,
    levels: u32,
    contours: bool,
    progress: &Progress,
) -> Result<(Octree, BuildRow), BenchError> {
    let kind = if contours { "with contours" } else { "cubical" };
    let what = format!("{}: building {levels} levels {kind}", scene.name);
    let settings = BuildSettings { levels, contours, ..scene.settings };
    let start = Instant::now();
    let built = esvo_builder::build(&scene.mesh, &settings, &|p| {
        progress.fraction(&what, p.done, &format!("{:.1} M voxels", p.voxels as f64 / 1e6));
    })
    .map_err(|e| BenchError::scene(&scene.name, e))?;
    let seconds = start.elapsed().as_secs_f64();
    let stats = esvo_format::stats(&built.octree);
    let row = BuildRow {
        levels,
        contours,
        contour_error: settings.contour_error,
        color_error: settings.color_error,
        normal_error: settings.normal_error,
        seconds,
        bytes: stats.image_bytes,
        voxels: stats.voxels,
        leaves: stats.leaf_voxels,
        contour_count: stats.contours,
        far_pointers: stats.far_pointers,
        blocks: stats.blocks,
        kinds: (stats.bytes.named().iter())
            .map(|(kind, bytes)| KindBytes { kind: kind.to_string(), bytes: *bytes })
            .collect(),
    };
    Ok((built.octree, row))
}

/// What the triangles say about the views of a scene. The rays of a view depend on where the root cube lies, which is the
/// same for all octrees of a mesh: then nothing is cast twice.
pub(crate) struct Truth<'a> {
    mesh: &'a Mesh,
    triangles: &'a TriangleScene,
    views: Vec<TrueView>,
}

struct TrueView {
    rays: CameraRays,
    hits: Vec<TriangleHit>,
    picture: Picture,
}

impl<'a> Truth<'a> {
    pub(crate) fn new(mesh: &'a Mesh, triangles: &'a TriangleScene) -> Self {
        Self { mesh, triangles, views: Vec::new() }
    }

    fn of(&mut self, rays: CameraRays) -> &TrueView {
        let known = self.views.iter().position(|known| known.rays == rays);
        let index = known.unwrap_or_else(|| {
            let hits = self.triangles.cast_exact(&rays);
            let picture = mesh_picture::shade_mesh(self.mesh, &rays, &hits);
            self.views.push(TrueView { rays, hits, picture });
            self.views.len() - 1
        });
        &self.views[index]
    }
}

/// How far the hits of a variant are from the triangles, view by view.
pub(crate) fn error(
    octree: &Arc<Octree>,
    views: &[View],
    variant: Variant,
    levels: u32,
    truth: &mut Truth,
) -> Result<ErrorRow, CastError> {
    let mut caster = CpuCaster::new(None)?;
    caster.load(octree)?;
    let mut hits = Vec::new();
    let mut errors = Vec::new();
    let mut pictures = Vec::new();
    for view in views {
        caster.cast(view, &mut hits)?;
        // The rays as the kernels take them: the rounding of the camera is not the octree's error.
        let rays = CameraRays::of_view(view, octree.octree_to_mesh(0));
        let exact = truth.of(rays);
        errors.push(DepthError::between(&rays, &exact.hits, &hits, voxel_edges(octree, 0)));
        pictures.extend(image_error(&exact.picture, &shade(octree, view, &hits)));
    }
    Ok(ErrorRow { variant, levels, size: CHECK_SIZE, views: errors, pictures })
}

/// The view that shows the most different voxels: not the one into a wall.
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

/// The answers of one engine on one variant. A caster that fails has compared nothing, and so does not pass.
pub(crate) fn check(
    caster: &mut dyn Caster,
    backend: Backend,
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
    CheckRow { backend, variant, levels, size: CHECK_SIZE, agreement, error }
}

/// One row of Table 2: a picture size, and everything that is cast at it.
pub(crate) struct Row {
    size: [u32; 2],
    jobs: Vec<Job>,
}

struct Job {
    /// Index of the engine; `None`: triangles.
    engine: Option<usize>,
    variant: Variant,
    levels: u32,
    rays: Vec<CameraRays>,
    views: Vec<View>,
    samples: Samples,
}

impl Row {
    pub(crate) fn new(size: [u32; 2]) -> Self {
        Self { size, jobs: Vec::new() }
    }

    /// Adds the triangle caster.
    pub(crate) fn add_triangles(&mut self, rays: Vec<CameraRays>) {
        let variant = Variant::Triangles;
        self.jobs.push(Job { engine: None, variant, levels: 0, rays, views: Vec::new(), samples: Samples::default() });
    }

    /// Adds an engine, by its index, on a variant that it has loaded.
    pub(crate) fn add(&mut self, engine: usize, variant: Variant, levels: u32, views: Vec<View>) {
        let samples = Samples::default();
        self.jobs.push(Job { engine: Some(engine), variant, levels, rays: Vec::new(), views, samples });
    }

    /// Times the row round by round: every job casts every view once a round, so that drift hits all alike; every second
    /// round goes backwards. When the clock runs out, the round that has begun is the last.
    pub(crate) fn time(
        mut self,
        engines: &mut [Engine],
        triangles: &TriangleScene,
        matrix: &Matrix,
        clock: &Clock,
        progress: &Progress,
        what: &str,
    ) -> Result<Vec<TimeCell>, BenchError> {
        let rounds = matrix.warm_up + matrix.rounds;
        for round in 0..rounds {
            let late = clock.left() <= 0.0;
            if late && self.jobs.iter().all(|job| !job.samples.seconds.is_empty()) {
                break;
            }
            if late && round < matrix.warm_up {
                continue;
            }
            progress.fraction(what, round as f64 / rounds as f64, "");
            let order: Box<dyn Iterator<Item = &mut Job>> =
                if round % 2 == 0 { Box::new(self.jobs.iter_mut()) } else { Box::new(self.jobs.iter_mut().rev()) };
            for job in order {
                job.round(engines, triangles, round >= matrix.warm_up)?;
            }
        }
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        let size = self.size;
        let cell = |job: Job| TimeCell {
            backend: job.engine.map_or(Backend::Cpu, |e| engines[e].backend),
            variant: job.variant,
            levels: job.levels,
            size,
            resident_bytes: match job.engine {
                Some(e) => engines[e].caster(job.variant).resident_bytes(),
                None => triangles.resident_bytes(),
            },
            mrays: Spread::of(&job.samples.mrays(pixels)),
            samples: job.samples,
        };
        Ok(self.jobs.into_iter().map(cell).collect())
    }
}

impl Job {
    fn round(&mut self, engines: &mut [Engine], triangles: &TriangleScene, keep: bool) -> Result<(), BenchError> {
        let (mut total, mut coarse) = (Vec::new(), Vec::new());
        match self.engine {
            None => total.extend(self.rays.iter().map(|r| triangles.time(r).as_secs_f64())),
            Some(engine) => {
                let backend = engines[engine].backend.name();
                let caster = engines[engine].caster(self.variant);
                for view in &self.views {
                    let time = caster.time(view).map_err(|source| BenchError::Cast { backend, source })?;
                    total.push(time.total.as_secs_f64());
                    coarse.push(time.coarse.as_secs_f64());
                }
            }
        }
        if keep {
            self.samples.seconds.push(total);
            if self.variant == Variant::Beam {
                self.samples.coarse_seconds.push(coarse);
            }
        }
        Ok(())
    }
}
