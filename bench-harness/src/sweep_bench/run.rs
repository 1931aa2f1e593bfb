//! A sweep from start to end.

use std::path::PathBuf;
use std::time::Instant;

use esvo_core::CastOptions;
use esvo_cpu::triangles::TriangleScene;
use esvo_engines::OpenOptions;
use esvo_scenes::SceneEntry;
use serde::{Deserialize, Serialize};

use super::cache::{Cache, mesh_key};
use super::measure::{Rounds, SOFTWARE_SUBSET, SweptEngine, measure};
use super::plan::SweepPlan;
use super::record::{ExactKind, SCHEMA, SceneSweep, SweepReport};
use super::subject::{Sample, Subject, Truth, build_all};
use crate::calibration::Calibrator;
use crate::journal::Journal;
use crate::matrix_parts::{LeftOut, SceneLevels};
use crate::paper_bench::report::DeviceRecord;
use crate::repeat::replace_views;
use crate::scene::{self, NamedView, Scene};
use crate::system::machine::Machine;
use crate::{BenchError, Progress};

/// What [`run_sweep_bench`] measures, and with what.
#[derive(Clone, Debug)]
pub struct SweepBenchOptions {
    /// Scenes, levels, settings, engines.
    pub plan: SweepPlan,
    /// The folder that is searched first for real meshes.
    pub scenes_dir: Option<PathBuf>,
    /// The manifest of the scenes; `None`: the one of the paper's scenes.
    pub manifest: Option<PathBuf>,
    /// Threads of the CPU casters; `None`: one per core.
    pub threads: Option<usize>,
    /// Whether Vulkan drivers that run on the processor cast all settings, and not a few only.
    pub all_on_software: bool,
    /// Where octrees and exact answers of former runs are.
    pub cache: Cache,
    /// Viewpoints of scenes, by the scenes' names in records, instead of the manifest's: those of a record whose run is repeated.
    pub views: Vec<(String, Vec<NamedView>)>,
}

/// Builds or finds the octrees, compares every setting with the reference caster and with the exact answer, and times them.
///
/// Engines without a device and octrees beyond the memory limit are left out, and the report lists them. Whether all hits were
/// right: [`SweepReport::passed`].
///
/// # Errors
/// A plan or a scene that cannot be used, a cache that cannot be written, an engine that fails.
pub fn run_sweep_bench(options: &SweepBenchOptions, progress: &Progress) -> Result<SweepReport, BenchError> {
    resume_sweep_bench(options, &Journal::none(), progress)
}

/// Like [`run_sweep_bench`]. Scenes that are in the journal are not measured again; those that are measured are kept there.
///
/// # Errors
/// Those of [`run_sweep_bench`], and the journal's.
pub fn resume_sweep_bench(
    options: &SweepBenchOptions,
    journal: &Journal,
    progress: &Progress,
) -> Result<SweepReport, BenchError> {
    let (start, machine) = (Instant::now(), Machine::detect());
    let found_before = journal.found_seconds();
    let elapsed = || journal.found_seconds() - found_before + start.elapsed().as_secs_f64();
    options.plan.validate()?;
    let manifest = scene::manifest(options.manifest.as_deref())?;
    let wanted = (options.plan.scenes.iter())
        .map(|wanted| Ok((wanted, scene::entry(&manifest, &wanted.name)?)))
        .collect::<Result<Vec<_>, BenchError>>()?;
    let mut left_out = Vec::new();
    let (devices, engines) = open(&options.plan, options.threads, options.all_on_software, &mut left_out);
    let calibrator = Calibrator::new(options.threads)?;
    let mut scenes = Vec::new();
    let all = wanted.len();
    for (done, (wanted, entry)) in wanted.into_iter().enumerate() {
        progress.parts(done, all, elapsed());
        if let Some(absent) = scene::left_out(entry, options.scenes_dir.as_deref(), all)? {
            left_out.push(absent);
            continue;
        }
        let part: ScenePart = journal.part(&format!("sweep {}", entry.name), || {
            let mut left_out = Vec::new();
            let scene = sweep(options, wanted, entry, &engines, &calibrator, progress, &mut left_out)?;
            Ok(ScenePart { scene, left_out })
        })?;
        left_out.extend(part.left_out);
        scenes.push(part.scene);
    }
    Ok(SweepReport {
        schema: SCHEMA,
        machine,
        plan: options.plan.clone(),
        all_on_software: options.all_on_software,
        devices,
        calibration: Some(calibrator.record()),
        scenes,
        left_out,
        seconds: elapsed(),
    })
}

/// What a journal keeps of a scene.
#[derive(Serialize, Deserialize)]
struct ScenePart {
    scene: SceneSweep,
    left_out: Vec<LeftOut>,
}

/// Opens every engine once to find its device.
pub(crate) fn open(
    plan: &SweepPlan,
    threads: Option<usize>,
    all_on_software: bool,
    left_out: &mut Vec<LeftOut>,
) -> (Vec<DeviceRecord>, Vec<SweptEngine>) {
    let (mut devices, mut engines) = (Vec::new(), Vec::new());
    let mut leave_out = |what: String, reason: String| left_out.push(LeftOut { what, reason });
    for &id in &plan.engines {
        match id.open(&OpenOptions { threads, ..OpenOptions::default() }) {
            Ok(caster) => {
                let device = DeviceRecord::new(id, caster.device());
                let subset = device.is_software() && !all_on_software;
                if subset {
                    leave_out(format!("most settings on {id}"), SOFTWARE_SUBSET.into());
                }
                engines.push(SweptEngine { id, subset });
                devices.push(device);
            }
            Err(error) => leave_out(format!("casters on {id}"), error.reason.to_string()),
        }
    }
    (devices, engines)
}

/// With and without the beam, at each termination.
pub(crate) fn casts(contours: bool, terminations: &[f32]) -> Vec<CastOptions> {
    let all = |beam| terminations.iter().map(move |&pixels| CastOptions { contours, beam, max_voxel_pixels: pixels });
    [false, true].into_iter().flat_map(all).collect()
}

fn sweep(
    options: &SweepBenchOptions,
    wanted: &SceneLevels,
    entry: &SceneEntry,
    engines: &[SweptEngine],
    calibrator: &Calibrator,
    progress: &Progress,
    left_out: &mut Vec<LeftOut>,
) -> Result<SceneSweep, BenchError> {
    let plan = &options.plan;
    progress.say(format!("{}: reading the mesh", entry.name));
    let mut scene = Scene::load(entry, options.scenes_dir.as_deref(), plan.views)?;
    replace_views(&options.views, &scene.name, &mut scene.views);
    let mesh = &scene.mesh;
    let key = mesh_key(mesh);
    let corners = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect();
    let triangles = TriangleScene::new(corners).map_err(|e| BenchError::scene(&scene.name, e))?;
    let octrees = build_all(&scene, &key, &wanted.levels, plan.memory_gb, &options.cache, progress, left_out)?;
    let sample = |(octree, row): (_, super::record::OctreeRow)| {
        let casts = casts(row.contours, &plan.terminations);
        Sample { octree, row, casts }
    };
    let samples = octrees.into_iter().map(sample).collect();
    let truth = Truth::Triangles { mesh, triangles: &triangles, key: &key };
    let mut subject = Subject::new(&scene.name, samples, &scene.views, plan.size, truth, &options.cache);
    let rounds = Rounds { timed: plan.rounds, warm_up: plan.warm_up, threads: options.threads };
    let cells = measure(&mut subject, engines, &rounds, calibrator, progress, left_out)?;
    let octrees = subject.samples.iter().map(|sample| sample.row.clone()).collect();
    Ok(SceneSweep {
        name: scene.name.clone(),
        mesh: scene.variant,
        identity: scene.identity.clone(),
        credit: scene.credit.clone(),
        publish: scene.not_published.is_none(),
        mesh_sha256: key,
        triangles: mesh.triangle_count() as u64,
        exact: ExactKind::Triangles,
        views: scene.views.clone(),
        octrees,
        cells,
    })
}
