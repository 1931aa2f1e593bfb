//! A run of `esvo bench`: every scene of a matrix, from its mesh to its rows of the tables.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use esvo_core::exact::CameraRays;
use esvo_core::{CastError, DeviceKind, View};
use esvo_cpu::triangles::TriangleScene;
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::Octree;
use esvo_scenes::SceneEntry;
use serde::{Deserialize, Serialize};

use crate::calibration::Calibrator;
use crate::journal::Journal;
use crate::matrix_parts::{LeftOut, SceneLevels};
use crate::output::NamedPicture;
use crate::paper_bench::filter_row::FilterRow;
use crate::paper_bench::levels::{self, Both, Limits};
use crate::paper_bench::matrix::{Matrix, Variant};
use crate::paper_bench::measure;
use crate::paper_bench::measure::{ExactViews, TriangleTruth};
use crate::paper_bench::pair::{CHECK_SIZE, EnginePair, OctreePair};
use crate::paper_bench::report::{DeviceRecord, PaperOutcome, PaperReport, SCHEMA, SceneReport, Table1Row};
use crate::paper_bench::slowed::Slowed;
use crate::paper_bench::timed_row::{Subjects, TimedRow};
use crate::repeat::replace_views;
use crate::scene::{self, NamedView, Scene};
use crate::scene_triangles::SceneTriangles;
use crate::sweep_bench::mesh_sha256;
use crate::system::clock::Clock;
use crate::system::machine::Machine;
use crate::system::proc::resident_bytes;
use crate::units::GB;
use crate::{BenchError, Progress};

/// What [`run_paper_bench`] measures.
#[derive(Clone, Debug)]
pub struct PaperBenchOptions {
    /// Scenes, levels, engines and limits.
    pub matrix: Matrix,
    /// The folder that is searched first for real meshes.
    pub scenes_dir: Option<PathBuf>,
    /// The manifest of the scenes; `None`: the one of the paper's scenes.
    pub manifest: Option<PathBuf>,
    /// Threads of the CPU caster; `None`: one per core.
    pub threads: Option<usize>,
    /// Engines that are slowed on purpose: the negative control of [`compare`](crate::compare).
    pub slowed: Vec<Slowed>,
    /// Viewpoints of scenes, by the scenes' names in records, instead of the manifest's: those of a record whose run is repeated.
    pub views: Vec<(String, Vec<NamedView>)>,
}

impl PaperBenchOptions {
    /// A matrix, of the paper's scenes and on all cores.
    pub fn new(matrix: Matrix) -> Self {
        Self { matrix, scenes_dir: None, manifest: None, threads: None, slowed: Vec::new(), views: Vec::new() }
    }

    fn open_options(&self) -> OpenOptions {
        OpenOptions { threads: self.threads, ..OpenOptions::default() }
    }
}

/// Builds, checks and times everything in the matrix.
///
/// Engines without a device and levels beyond the memory or time limit are left out, and the report lists them. The report
/// also says whether the answers of all engines are right: see [`PaperReport::passed`].
///
/// # Errors
/// A scene that does not exist, or a mesh that cannot be used.
pub fn run_paper_bench(options: &PaperBenchOptions, progress: &Progress) -> Result<PaperOutcome, BenchError> {
    resume_paper_bench(options, &Journal::none(), progress)
}

/// Like [`run_paper_bench`]. Scenes that are in the journal are not measured again; those that are measured are kept there.
///
/// # Errors
/// Those of [`run_paper_bench`], and the journal's.
pub fn resume_paper_bench(
    options: &PaperBenchOptions,
    journal: &Journal,
    progress: &Progress,
) -> Result<PaperOutcome, BenchError> {
    options.matrix.validate().map_err(|what| BenchError::Matrix { file: options.matrix.name.clone(), what })?;
    let manifest = scene::manifest(options.manifest.as_deref())?;
    let wanted = (options.matrix.scenes.iter())
        .map(|wanted| Ok((wanted, scene::buildable(&manifest, &wanted.name)?)))
        .collect::<Result<Vec<_>, BenchError>>()?;

    let found_before = journal.found_seconds();
    let names: Vec<_> = wanted.iter().map(|(_, entry)| part_name(entry)).collect();
    let mut parts = names.iter().map(|name| journal.find::<ScenePart>(name)).collect::<Result<Vec<_>, _>>()?;
    let before = journal.found_seconds() - found_before;
    let clock = Clock::start(options.matrix.time_limit_seconds.map(|limit| (limit - before).max(0.0)));
    let mut runner = PaperRun {
        options,
        progress,
        backends: Vec::new(),
        left_out: options.matrix.left_out.clone(),
        pictures: Vec::new(),
    };
    let machine = Machine::detect();
    let devices = runner.find_devices();
    let calibrator = Calibrator::new(options.threads)?;
    let mut scenes = Vec::new();
    for (index, (wanted, entry)) in wanted.iter().enumerate() {
        if let Some(part) = parts[index].take() {
            runner.pictures.extend(journal.find_pictures(&part.report.pictures)?);
            runner.left_out.extend(part.left_out);
            scenes.push(part.report);
            continue;
        }
        if let Some(absent) = scene::left_out(entry, options.scenes_dir.as_deref(), names.len())? {
            runner.left_out.push(absent);
            continue;
        }
        let start = Instant::now();
        progress.parts(index, names.len(), before + clock.elapsed());
        // The parts that were found, and come later, take no time.
        let clock = clock.share(parts[index..].iter().filter(|part| part.is_none()).count());
        progress.say(format!("{}: reading the mesh", entry.name));
        let mut scene = Scene::load(entry, options.scenes_dir.as_deref(), options.matrix.views)?;
        replace_views(&options.views, &scene.name, &mut scene.views);
        let (left_out, pictures) = (runner.left_out.len(), runner.pictures.len());
        let report = runner.scene(wanted, &scene, &calibrator, &clock)?;
        journal.keep_pictures(&runner.pictures[pictures..])?;
        let part = ScenePart { report, left_out: runner.left_out[left_out..].to_vec() };
        journal.keep(&names[index], start, &part)?;
        scenes.push(part.report);
    }
    let PaperRun { left_out, pictures, .. } = runner;
    let report = PaperReport {
        schema: SCHEMA,
        machine,
        matrix: options.matrix.clone(),
        devices,
        calibration: Some(calibrator.record()),
        slowed: options.slowed.clone(),
        scenes,
        left_out,
        seconds: before + clock.elapsed(),
    };
    Ok(PaperOutcome { report, pictures })
}

/// What a journal keeps of a scene, beside its pictures.
#[derive(Serialize, Deserialize)]
struct ScenePart {
    report: SceneReport,
    left_out: Vec<LeftOut>,
}

/// A scene's name in the journal.
fn part_name(entry: &SceneEntry) -> String {
    format!("tables {}", entry.name)
}

/// The views of a scene for one of its octrees.
fn views(scene: &Scene, octree: &Octree, variant: Variant, size: [u32; 2]) -> Result<Vec<View>, BenchError> {
    let views = scene.views.iter().map(|v| measure::view(&v.camera, octree, variant, size));
    views.collect::<Result<_, CastError>>().map_err(|e| BenchError::scene(&scene.name, e))
}

/// The triangles that an octree of these levels is built of, and compared with.
fn triangles_of(scene: &Scene, levels: u32) -> Result<SceneTriangles, BenchError> {
    let displacement = scene.displaced.then(|| scene::displacement(&scene.mesh, levels));
    SceneTriangles::new(&scene.name, &scene.mesh, displacement)
}

/// The rays of a scene's views.
fn pictures(scene: &Scene, size: [u32; 2]) -> Result<Vec<CameraRays>, BenchError> {
    let rays = scene.views.iter().map(|v| CameraRays::new(&v.camera, size.into()));
    rays.collect::<Result<_, CastError>>().map_err(|e| BenchError::scene(&scene.name, e))
}

struct PaperRun<'a> {
    options: &'a PaperBenchOptions,
    progress: &'a Progress,
    /// The engines that have a device.
    backends: Vec<EngineId>,
    left_out: Vec<LeftOut>,
    pictures: Vec<NamedPicture>,
}

impl PaperRun<'_> {
    fn leave_out(&mut self, what: impl Into<String>, reason: impl Into<String>) {
        self.left_out.push(LeftOut { what: what.into(), reason: reason.into() });
    }

    /// Opens every engine once to find its device.
    fn find_devices(&mut self) -> Vec<DeviceRecord> {
        let mut devices = Vec::new();
        let mut missing: Vec<(&str, String)> = Vec::new();
        for &backend in &self.options.matrix.backends {
            self.progress.say(format!("opening {}", backend.name()));
            match backend.open(&self.options.open_options()) {
                Ok(caster) => {
                    devices.push(DeviceRecord::new(backend, caster.device()));
                    self.backends.push(backend);
                }
                Err(error) => missing.push((backend.name(), error.reason.to_string())),
            }
        }
        // One line with the first reason: the GPU engines usually fail for the same reason, each with its own message.
        if let Some((_, why)) = missing.first().cloned() {
            let names: Vec<_> = missing.iter().map(|(name, _)| *name).collect();
            self.leave_out(format!("casters on {}", names.join(" and ")), why);
        }
        devices
    }

    fn scene(
        &mut self,
        wanted: &SceneLevels,
        scene: &Scene,
        calibrator: &Calibrator,
        clock: &Clock,
    ) -> Result<SceneReport, BenchError> {
        let mut report = SceneReport {
            name: scene.name.clone(),
            mesh: scene.variant,
            triangles: scene.mesh.triangle_count() as u64,
            identity: scene.identity.clone(),
            mesh_sha256: mesh_sha256(&scene.mesh),
            credit: scene.credit.clone(),
            publish: scene.not_published.is_none(),
            views: scene.views.clone(),
            warnings: scene.mesh.warnings.clone(),
            mesh_seconds: scene.seconds,
            builds: Vec::new(),
            errors: Vec::new(),
            checks: Vec::new(),
            times: Vec::new(),
            filters: Vec::new(),
            pictures: Vec::new(),
        };
        let first = wanted.levels.first().copied().unwrap_or(1);
        self.progress.say(format!("{}: sorting triangles", scene.name));
        let mut triangles = triangles_of(scene, first)?;
        let mut mesh_levels = first;
        // The exact hits of a mesh that is the same at every level are cast once.
        let mut exact = ExactViews::default();

        let limit = self.options.matrix.memory_gb;
        let held = resident_bytes() as f64;
        if held > limit * GB {
            let held = held / GB;
            let why =
                format!("with its mesh, the program takes {held:.2} GB of memory; the limit is {limit}, see --memory");
            self.refuse(&scene.name, &wanted.levels, &[Some(why.clone()), Some(why)]);
            return Ok(report);
        }
        let variants = &self.options.matrix.variants;
        let wanted_kinds = [false, true]
            .map(|contours| variants.iter().any(|v| *v != Variant::Triangles && (*v != Variant::Cubical) == contours));
        let mut kinds = wanted_kinds;
        // The deepest level with every kind is cast. Deeper octrees of one kind are built, measured and dropped.
        let mut last: Option<OctreePair> = None;
        let levels = if wanted_kinds == [false, false] { &[] } else { &wanted.levels[..] };
        for (index, &levels) in levels.iter().enumerate() {
            let given_back = if kinds == wanted_kinds { last.as_ref().map_or(0, OctreePair::bytes) } else { 0 };
            let limits = Limits {
                clock,
                memory: self.options.matrix.memory_gb * GB,
                held: resident_bytes() as f64,
                given_back: given_back as f64,
            };
            let refused = levels::refusals(&report.builds, kinds, &limits);
            self.refuse(&scene.name, &wanted.levels[index..], &refused);
            kinds = [0, 1].map(|k| kinds[k] && refused[k].is_none());
            if kinds == [false, false] {
                break;
            }
            if kinds == wanted_kinds {
                drop(last.take());
            }
            if scene.displaced && levels != mesh_levels {
                self.progress.say(format!("{}: displacing for {levels} levels", scene.name));
                triangles = triangles_of(scene, levels)?;
                mesh_levels = levels;
                exact = ExactViews::default();
            }
            let pair = self.build(scene, &triangles, levels, kinds, &mut report.builds)?;
            let mut truth = TriangleTruth::new(&scene.mesh, &triangles, &mut exact);
            for variant in [Variant::Cubical, Variant::Contours, Variant::Beam] {
                if let Some(octree) = pair.of(variant).filter(|_| self.options.matrix.variants.contains(&variant)) {
                    self.progress.say(format!("{}: error at {levels} levels, {}", scene.name, variant.title()));
                    let views = views(scene, octree, variant, CHECK_SIZE)?;
                    let row = measure::error(octree, &views, variant, levels, &mut truth);
                    report.errors.push(row.map_err(|e| BenchError::scene(&scene.name, e))?);
                }
            }
            if kinds == wanted_kinds {
                last = Some(pair);
            }
        }
        drop(exact);
        if wanted_kinds == [false, false] {
            // Triangles alone.
            last = Some(OctreePair { levels: 0, cubical: None, contours: None });
        }
        let Some(pair) = last else { return Ok(report) };
        if scene.displaced && pair.levels != mesh_levels && pair.levels > 0 {
            // A deeper octree of one kind was built and dropped.
            triangles = triangles_of(scene, pair.levels)?;
        }
        self.pictures(scene, &pair, &triangles, &mut report)?;
        self.cast(scene, &pair, &triangles, calibrator, clock, &mut report)?;
        Ok(report)
    }

    /// Records which levels are not built, and why.
    fn refuse(&mut self, scene: &str, levels: &[u32], refused: &Both<Option<String>>) {
        let levels: Vec<_> = levels.iter().map(u32::to_string).collect();
        let levels = levels.join(", ");
        match refused {
            [Some(a), Some(b)] if a == b => self.leave_out(format!("{scene} at {levels} levels"), a),
            _ => {
                for (kind, why) in ["cubical", "contours"].into_iter().zip(refused) {
                    if let Some(why) = why {
                        self.leave_out(format!("{scene}, {kind}, at {levels} levels"), why);
                    }
                }
            }
        }
    }

    /// The octrees of a level.
    fn build(
        &self,
        scene: &Scene,
        triangles: &SceneTriangles,
        levels: u32,
        kinds: Both<bool>,
        rows: &mut Vec<Table1Row>,
    ) -> Result<OctreePair, BenchError> {
        let mut pair = OctreePair { levels, cubical: None, contours: None };
        for contours in [false, true].into_iter().filter(|&c| kinds[usize::from(c)]) {
            let (octree, row) = measure::build(scene, triangles, levels, contours, self.progress)?;
            rows.push(row);
            *(if contours { &mut pair.contours } else { &mut pair.cubical }) = Some(Arc::new(octree));
        }
        Ok(pair)
    }

    fn pictures(
        &mut self,
        scene: &Scene,
        pair: &OctreePair,
        triangles: &SceneTriangles,
        report: &mut SceneReport,
    ) -> Result<(), BenchError> {
        if let Some(why) = scene.not_published {
            self.leave_out(format!("pictures of {}", scene.name), why);
            return Ok(());
        }
        let Some(any) = pair.contours.as_ref().or(pair.cubical.as_ref()) else { return Ok(()) };
        let failed = |e| BenchError::scene(&scene.name, e);
        let view = measure::richest_view(&scene.views, any).map_err(failed)?;
        for variant in [Variant::Cubical, Variant::Contours] {
            let Some(octree) = pair.of(variant) else { continue };
            self.progress.say(format!("{}: picture, {}", scene.name, variant.title()));
            let picture = measure::picture(&view.camera, octree, variant).map_err(failed)?;
            let name = format!("{}-{}-{}.png", crate::system::machine::slug(&scene.name), pair.levels, variant.title());
            report.pictures.push(name.clone());
            self.pictures.push(NamedPicture { name, picture });
        }
        self.progress.say(format!("{}: picture of the triangles", scene.name));
        let picture = measure::mesh_picture(&scene.mesh, triangles, &view.camera, any)
            .map_err(|e| BenchError::scene(&scene.name, e))?;
        if let Some(picture) = picture {
            let name = format!("{}-triangles.png", crate::system::machine::slug(&scene.name));
            report.pictures.push(name.clone());
            self.pictures.push(NamedPicture { name, picture });
        }
        Ok(())
    }

    /// Loads the triangles on every GPU and checks its answers.
    fn check_triangles(
        &mut self,
        scene: &Scene,
        engines: &mut [EnginePair],
        triangles: &TriangleScene,
        report: &mut SceneReport,
    ) -> Result<(), BenchError> {
        let mut wide = None;
        for engine in engines {
            let backend = engine.backend;
            let opened = backend.open_triangles(&self.options.open_options()).map_err(BenchError::Open)?;
            let Some(mut caster) = opened else { continue };
            self.progress.say(format!("{}: checking triangles on {}", scene.name, backend.name()));
            let wide = wide.get_or_insert_with(|| triangles.wide());
            if let Err(error) = caster.load(wide) {
                self.leave_out(format!("{}, {}, triangles", scene.name, backend.name()), error.to_string());
                continue;
            }
            let pictures = pictures(scene, CHECK_SIZE)?;
            report.checks.push(measure::check_triangles(&mut *caster, backend, triangles, &pictures));
            engine.triangles = Some(caster);
        }
        Ok(())
    }

    /// Checks the answers, then times the rows.
    fn cast(
        &mut self,
        scene: &Scene,
        pair: &OctreePair,
        triangles: &SceneTriangles,
        calibrator: &Calibrator,
        clock: &Clock,
        report: &mut SceneReport,
    ) -> Result<(), BenchError> {
        let variants = self.options.matrix.variants.clone();
        // Engines are opened for each scene, so that no memory of this scene is held while the next one is built.
        let mut engines = Vec::new();
        for &backend in &self.backends {
            let open = || backend.open(&self.options.open_options()).map_err(BenchError::Open);
            engines.push(EnginePair { backend, cubical: open()?, contours: open()?, triangles: None });
        }
        let triangles = triangles
            .whole(&scene.mesh)
            .map(|(_, triangles)| triangles)
            .filter(|_| variants.contains(&Variant::Triangles));
        if let Some(triangles) = triangles {
            self.check_triangles(scene, &mut engines, triangles, report)?;
            // Not in the time of the first cast.
            triangles.prepare();
        } else if variants.contains(&Variant::Triangles) {
            let why =
                "displaced for so many levels, the mesh is too large to be in memory as a whole; choose fewer levels";
            self.leave_out(format!("{}, triangles, at {} levels", scene.name, pair.levels), why);
        }
        // Check the answers first.
        let mut unloaded = Vec::new();
        for engine in &mut engines {
            self.progress.say(format!("{}: checking {}", scene.name, engine.backend.name()));
            for kind in [Variant::Cubical, Variant::Contours] {
                let Some(octree) = pair.of(kind) else { continue };
                // A GPU has memory of its own, and the processor's engines share the octree.
                let copies = engine.caster(kind).device().kind == DeviceKind::SoftwareGpu;
                let needed = resident_bytes() + if copies { octree.slots().len() as u64 * 8 } else { 0 };
                let limit = self.options.matrix.memory_gb;
                let failed = if copies && needed as f64 > limit * GB {
                    let needed = needed as f64 / GB;
                    Some(format!("would take about {needed:.2} GB of memory, and the limit is {limit}; see --memory"))
                } else {
                    engine.caster(kind).load(octree).err().map(|e| e.to_string())
                };
                if let Some(reason) = failed {
                    let what = format!("{}, {}, {}", scene.name, engine.backend.name(), kind.title());
                    self.left_out.push(LeftOut { what, reason });
                    unloaded.push((engine.backend, kind));
                }
            }
            for &variant in variants.iter().filter(|v| **v != Variant::Triangles) {
                let kind = if variant == Variant::Cubical { variant } else { Variant::Contours };
                let Some(octree) = pair.of(variant).filter(|_| !unloaded.contains(&(engine.backend, kind))) else {
                    continue;
                };
                let views = views(scene, octree, variant, CHECK_SIZE)?;
                let backend = engine.backend;
                report.checks.push(measure::check(
                    engine.caster(variant),
                    backend,
                    octree,
                    &views,
                    variant,
                    pair.levels,
                ));
            }
        }
        // Then take times, one picture size after the other.
        for (index, &size) in self.options.matrix.resolutions.iter().enumerate() {
            let clock = clock.share(self.options.matrix.resolutions.len() - index);
            let mut row = TimedRow::new(size);
            if triangles.is_some() {
                row.add_triangles(None, pictures(scene, size)?);
            }
            for (index, engine) in engines.iter().enumerate() {
                let backend = engine.backend;
                if report.check(backend, Variant::Triangles).is_some_and(|check| check.agreement.passed()) {
                    row.add_triangles(Some(index), pictures(scene, size)?);
                }
                let sound: Vec<_> = (report.checks.iter())
                    .filter(|c| c.backend == backend && c.agreement.passed())
                    .map(|c| c.variant)
                    .collect();
                for variant in sound {
                    let Some(octree) = pair.of(variant) else { continue };
                    row.add(index, variant, pair.levels, views(scene, octree, variant, size)?);
                }
            }
            let matrix = &self.options.matrix;
            let what = format!("{}: timing {}x{}", scene.name, size[0], size[1]);
            let mut subjects = Subjects { engines: &mut engines, triangles, calibrator, slowed: &self.options.slowed };
            report.times.extend(row.time(&mut subjects, matrix, &clock, self.progress, &what)?);
            let sound: Vec<usize> = (0..engines.len())
                .filter(|&e| report.check(engines[e].backend, Variant::Beam).is_some_and(|c| c.agreement.passed()))
                .collect();
            if let Some(octree) = pair.of(Variant::Beam).filter(|_| !sound.is_empty()) {
                let views = views(scene, octree, Variant::Beam, size)?;
                let what = format!("{}: timing the filter at {}x{}", scene.name, size[0], size[1]);
                let all =
                    FilterRow { pair, sound: &sound, views: &views, matrix, clock: &clock, progress: self.progress };
                report.filters.extend(all.time(&mut engines, &what)?);
            }
        }
        Ok(())
    }
}
