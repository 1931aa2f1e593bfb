//! The measurement: all variants cast every view, are compared with the reference, and are timed round by round.

use std::sync::Arc;
use std::time::Instant;

use esvo_builder::BuildSettings;
use esvo_core::gpu::resident::Resident;
use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::compare::Comparison;
use esvo_core::{CastError, CastOptions, Caster, Object, View};
use esvo_engines::{EngineId, InstructionSet, OpenOptions};
use esvo_format::Octree;
use esvo_scenes::SceneEntry;
use serde::{Deserialize, Serialize};

use super::{Case, Cell, EngineRow, Needed, NeedsBenchOptions, NeedsReport, SCHEMA, Unread, Variant};
use crate::calibration::{Calibrator, GuardRound, GuardSamples};
use crate::content_hash::image_key;
use crate::journal::Journal;
use crate::matrix_parts::LeftOut;
use crate::paper_bench::check::Agreement;
use crate::scene::{self, Scene};
use crate::system::machine::Machine;
use crate::timing::wake;
use crate::{BenchError, Progress};

/// Most voxels of the deepest level, so that octrees of cubes fit in memory.
const MOST_VOXELS: f64 = 1e9;

/// Builds the octrees, casts, compares, measures.
///
/// # Errors
/// A scene or options that cannot be used, and a caster that fails.
pub fn run_needs_bench(options: &NeedsBenchOptions, progress: &Progress) -> Result<NeedsReport, BenchError> {
    resume_needs_bench(options, &Journal::none(), progress)
}

/// Like [`run_needs_bench`]. Scenes that are in the journal are not measured again; those that are measured are kept there.
///
/// # Errors
/// Those of [`run_needs_bench`], and the journal's.
pub fn resume_needs_bench(
    options: &NeedsBenchOptions,
    journal: &Journal,
    progress: &Progress,
) -> Result<NeedsReport, BenchError> {
    let start = Instant::now();
    let found_before = journal.found_seconds();
    let elapsed = || journal.found_seconds() - found_before + start.elapsed().as_secs_f64();
    let manifest = scene::manifest(None)?;
    let calibrator = Calibrator::new(options.threads)?;
    let mut report = NeedsReport {
        schema: SCHEMA,
        machine: Machine::detect(),
        options: Some(options.clone()),
        size: options.size,
        calibration: Some(calibrator.record()),
        credits: Vec::new(),
        engines: Vec::new(),
        cases: Vec::new(),
        left_out: Vec::new(),
        seconds: 0.0,
    };
    let mut scenes = options.scenes.clone();
    if scenes.is_empty() {
        let all = manifest.scenes.iter();
        scenes =
            all.filter(|s| !s.displaced && s.textures && s.unsupported.is_none()).map(|s| s.name.clone()).collect();
    }
    for (done, name) in scenes.iter().enumerate() {
        progress.parts(done, scenes.len(), elapsed());
        let entry = scene::entry(&manifest, name)?;
        if let Some(absent) = scene::left_out(entry, options.scenes_dir.as_deref(), scenes.len())? {
            report.left_out.push(absent);
            continue;
        }
        let part = journal.part(&format!("needs {name}"), || scene_part(options, entry, &calibrator, progress))?;
        if report.engines.is_empty() {
            report.engines = part.engines;
        }
        report.cases.extend(part.cases);
        report.left_out.extend(part.left_out);
        report.credits.push(part.credit);
    }
    report.seconds = elapsed();
    Ok(report)
}

/// What a journal keeps of a scene.
#[derive(Serialize, Deserialize)]
struct ScenePart {
    engines: Vec<EngineRow>,
    cases: Vec<Case>,
    left_out: Vec<LeftOut>,
    credit: [String; 3],
}

/// Everything of one scene.
fn scene_part(
    options: &NeedsBenchOptions,
    entry: &SceneEntry,
    calibrator: &Calibrator,
    progress: &Progress,
) -> Result<ScenePart, BenchError> {
    let name = &entry.name;
    let failed = |what: String| BenchError::scene(name, what);
    if options.rounds == 0 || options.views == 0 {
        return Err(failed("expected at least one round and one view".into()));
    }
    let subjects = subjects(&options.engines);
    progress.say(format!("{name}: reading the mesh"));
    let scene = Scene::load(entry, options.scenes_dir.as_deref(), options.views)?;
    let (mut engines, mut cases, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
    for &levels in &options.levels {
        let voxels = esvo_builder::expected_leaves(&scene.mesh, levels);
        if voxels > MOST_VOXELS {
            let billions = voxels / 1e9;
            let reason = format!(
                "{levels} levels of cubes may have {billions:.1} billion voxels; expected levels with less than a billion"
            );
            if !options.scenes.is_empty() {
                return Err(failed(reason));
            }
            left_out.push(LeftOut { what: format!("{} at {levels} levels", scene.name), reason });
            continue;
        }
        for contours in [false, true] {
            progress.say(format!("{name}: building {levels} levels"));
            let settings = BuildSettings { levels, contours, ..scene.settings };
            let built = esvo_builder::build(&scene.mesh, &settings, &|_| ()).map_err(|e| failed(e.to_string()))?;
            let octree = Arc::new(built.octree);
            for sizes in [false, true] {
                progress.say(format!("{name}: casting {levels} levels"));
                let cast = CastOptions { contours: true, beam: false, max_voxel_pixels: if sizes { 1.0 } else { 0.0 } };
                let case = views(&scene, &octree, options, &cast)
                    .and_then(|views| measure(&octree, &views, &subjects, options, sizes, calibrator, &mut engines))
                    .map_err(|e| failed(e.to_string()))?;
                cases.push(Case { scene: scene.name.clone(), levels, ..case });
            }
        }
    }
    Ok(ScenePart { engines, cases, left_out, credit: [scene.name, scene.credit, scene.identity] })
}

/// What is measured of these engines: of the CPU's instruction sets, one ray at a time and the fastest.
fn subjects(engines: &[EngineId]) -> Vec<(EngineId, Option<InstructionSet>)> {
    let mut subjects = Vec::new();
    for engine in engines {
        if *engine == EngineId::Cpu {
            subjects.push((*engine, Some(InstructionSet::Scalar)));
            subjects.push((*engine, Some(InstructionSet::best())));
        } else {
            subjects.push((*engine, None));
        }
    }
    subjects.dedup();
    subjects
}

fn views(
    scene: &Scene,
    octree: &Octree,
    options: &NeedsBenchOptions,
    cast: &CastOptions,
) -> Result<Vec<View>, CastError> {
    let object = Object::of(octree, 0);
    let [width, height] = options.size;
    let view = |camera| View::new(camera, *object.octree_to_mesh(), object.root(), (width, height), cast);
    scene.views.iter().map(|named| view(&named.camera)).collect()
}

/// Measures a case; its scene and levels are left to the caller. Fills in the engines if they are not known yet.
fn measure(
    octree: &Arc<Octree>,
    views: &[View],
    subjects: &[(EngineId, Option<InstructionSet>)],
    options: &NeedsBenchOptions,
    sizes: bool,
    calibrator: &Calibrator,
    engines: &mut Vec<EngineRow>,
) -> Result<Case, CastError> {
    let needs = octree.needs();
    let needed = Needed { contours: needs.contours, far_pointers: needs.far_pointers, sizes };
    let expected = expected(octree, views)?;
    let mut running = Vec::new();
    for (engine, &(id, set)) in subjects.iter().enumerate() {
        let other = |v: &Variant| v.is_left_out_by(set) && (*v == Variant::Everything || v.differs(needed));
        for variant in Variant::ALL.into_iter().filter(other) {
            let mut caster = id
                .open(&OpenOptions {
                    threads: options.threads,
                    instructions: set,
                    leave_out: variant.leave_out(),
                    ..OpenOptions::default()
                })
                .map_err(|e| CastError::Device(e.to_string()))?;
            caster.load(octree)?;
            if engines.len() == engine {
                engines.push(EngineRow {
                    name: set.map_or(id.name(), InstructionSet::name).into(),
                    device: caster.device().clone(),
                });
            }
            let agreement = Agreement::new(Comparison::of(&cast(&mut *caster, views)?, &expected), id.allowed());
            running.push((
                caster,
                Cell { engine, variant, agreement, seconds: Vec::new(), guard: GuardSamples::default() },
            ));
        }
    }
    for _ in 0..options.rounds {
        for (caster, cell) in &mut running {
            let mut guard = GuardRound::start(calibrator);
            let mut seconds = 0.0;
            if let Some(view) = views.first() {
                wake(caster.device().kind, || caster.time(view).map(drop))?;
            }
            guard.frame(|| {
                for view in views {
                    seconds += caster.time(view)?.total.as_secs_f64();
                }
                Ok::<(), CastError>(())
            })?;
            cell.seconds.push(seconds);
            guard.calibrate(calibrator);
            cell.guard.push(guard);
        }
    }
    let mut file = Vec::new();
    octree.write_to(&mut file).map_err(|e| CastError::Device(format!("the octree cannot be written: {e}")))?;
    let (upload_bytes, unread) = upload(octree);
    Ok(Case {
        scene: String::new(),
        levels: 0,
        file_bytes: file.len() as u64,
        image_bytes: size_of_val(octree.slots()) as u64,
        image_sha256: image_key(octree),
        upload_bytes,
        unread,
        needs: needed,
        rays: views.iter().map(|view| view.pixels() as u64).sum(),
        cells: running.into_iter().map(|(_, cell)| cell).collect(),
    })
}

/// Bytes of the image without attachments, and those of them that are not read.
fn upload(octree: &Octree) -> (u64, Unread) {
    let stats = esvo_format::stats(octree);
    let contours = octree.needs().contours;
    let unread = Unread {
        contour_halves: if contours { 0 } else { 4 * stats.descriptors },
        // Info sections are between descriptors and contours.
        headers: stats.bytes.page_headers + if contours { stats.bytes.info_sections } else { 0 },
        gaps: stats.bytes.gaps,
    };
    (size_of_val(Resident::new(octree).slots()) as u64, unread)
}

fn expected(octree: &Arc<Octree>, views: &[View]) -> Result<Vec<esvo_core::Hit>, CastError> {
    let mut reference = ReferenceCaster::default();
    reference.load(octree)?;
    cast(&mut reference, views)
}

/// The hits of all views.
fn cast(caster: &mut dyn Caster, views: &[View]) -> Result<Vec<esvo_core::Hit>, CastError> {
    let (mut all, mut hits) = (Vec::new(), Vec::new());
    for view in views {
        caster.cast(view, &mut hits)?;
        all.append(&mut hits);
    }
    Ok(all)
}
