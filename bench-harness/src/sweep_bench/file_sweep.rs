//! The settings at which the octree of a file can be cast.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use esvo_builder::Mesh;
use esvo_cpu::triangles::TriangleScene;
use esvo_format::Octree;
use esvo_scenes::SceneVariant;
use glam::DVec3;

use super::cache::{Cache, mesh_key};
use super::measure::{Rounds, measure};
use super::plan::SweepPlan;
use super::record::{ExactKind, SCHEMA, SceneSweep, SweepReport};
use super::run::{casts, open};
use super::subject::{Sample, Subject, Truth, row};
use crate::calibration::Calibrator;
use crate::matrix_parts::SceneLevels;
use crate::scene::{self, NamedView, Scene};
use crate::system::machine::Machine;
use crate::{BenchError, Progress};

/// What [`run_file_sweep`] measures.
#[derive(Clone, Debug)]
pub struct FileSweepOptions {
    /// The file's name, for messages and the record.
    pub name: String,
    /// Picture size, rounds, terminations, engines; its scenes are not read.
    pub plan: SweepPlan,
    /// The scene that the octree was built from, whose triangles and viewpoints are used. `None`: errors are measured against the
    /// octree's own leaves, with `views`.
    pub scene: Option<String>,
    /// The viewpoints without a scene.
    pub views: Vec<NamedView>,
    /// The folder that is searched first for real meshes.
    pub scenes_dir: Option<PathBuf>,
    /// The manifest of the scene; `None`: the one of the paper's scenes.
    pub manifest: Option<PathBuf>,
    /// Threads of the CPU casters; `None`: one per core.
    pub threads: Option<usize>,
    /// Where exact answers of former runs are.
    pub cache: Cache,
}

/// Measures the settings of the first object of an octree, as [`run_sweep_bench`](super::run_sweep_bench) does: with and, if it has any,
/// without contours. The record has one scene, which is named after the file.
///
/// # Errors
/// As `run_sweep_bench`; an engine that cannot be opened is one, too.
pub fn run_file_sweep(
    octree: &Arc<Octree>,
    options: &FileSweepOptions,
    progress: &Progress,
) -> Result<SweepReport, BenchError> {
    let (start, machine) = (Instant::now(), Machine::detect());
    let mut plan = options.plan.clone();
    let levels = octree.objects()[0].levels;
    plan.scenes = vec![SceneLevels { name: options.name.clone(), levels: vec![levels] }];
    plan.validate()?;
    let mut left_out = Vec::new();
    let (devices, engines) = open(&plan, options.threads, true, &mut left_out);
    if let Some(left) = left_out.first() {
        return Err(BenchError::scene(&options.name, format!("{}: {}", left.what, left.reason)));
    }
    let has_contours = octree.needs().contours;
    let mut settings = casts(has_contours, &plan.terminations);
    if has_contours {
        settings.extend(casts(false, &plan.terminations));
    }
    let row = row(octree, levels, has_contours, None);
    let samples = vec![Sample { octree: octree.clone(), row: row.clone(), casts: settings }];
    let calibrator = Calibrator::new(options.threads)?;
    let rounds = Rounds { timed: plan.rounds, warm_up: plan.warm_up, threads: options.threads };

    let scene = match &options.scene {
        Some(name) => {
            let manifest = scene::manifest(options.manifest.as_deref())?;
            Some(Scene::load(scene::entry(&manifest, name)?, options.scenes_dir.as_deref(), plan.views)?)
        }
        None => None,
    };
    if let Some(scene) = scene.as_ref().filter(|scene| !holds(octree, &scene.mesh)) {
        let what =
            format!("the triangles of {} are not inside of its cube: it is of another mesh, or moved", scene.name);
        return Err(BenchError::scene(&options.name, what));
    }
    let mut record = SceneSweep {
        name: options.name.clone(),
        mesh: scene.as_ref().map_or(SceneVariant::Other, |scene| scene.variant),
        identity: scene.as_ref().map_or("not known".into(), |scene| scene.identity.clone()),
        credit: scene.as_ref().map_or("unknown".into(), |scene| scene.credit.clone()),
        publish: scene.as_ref().is_some_and(|scene| scene.not_published.is_none()),
        mesh_sha256: scene.as_ref().map_or(String::new(), |scene| mesh_key(&scene.mesh)),
        triangles: scene.as_ref().map_or(0, |scene| scene.mesh.triangle_count() as u64),
        exact: if scene.is_some() { ExactKind::Triangles } else { ExactKind::Leaves },
        views: scene.as_ref().map_or(options.views.clone(), |scene| scene.views.clone()),
        octrees: vec![row],
        cells: Vec::new(),
    };
    let triangles = scene.as_ref().map(|scene| {
        let mesh = &scene.mesh;
        let corners = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect();
        TriangleScene::new(corners).map_err(|e| BenchError::scene(&scene.name, e))
    });
    let triangles = triangles.transpose()?;
    let truth = match (&scene, &triangles) {
        (Some(scene), Some(triangles)) => Truth::Triangles { mesh: &scene.mesh, triangles, key: &record.mesh_sha256 },
        _ => Truth::Leaves,
    };
    let mut subject = Subject::new(&record.name, samples, &record.views, plan.size, truth, &options.cache);
    let cells = measure(&mut subject, &engines, &rounds, &calibrator, progress, &mut left_out)?;
    record.cells = cells;
    Ok(SweepReport {
        schema: SCHEMA,
        machine,
        plan,
        all_on_software: true,
        devices,
        calibration: Some(calibrator.record()),
        scenes: vec![record],
        left_out,
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// Whether the bounds of a mesh lie in the root cube of the first object, but for rounding.
fn holds(octree: &Octree, mesh: &Mesh) -> bool {
    let Some((low, high)) = mesh.bounds() else { return false };
    let to_octree = octree.octree_to_mesh(0).inverse();
    let inside = |x: f64| (-1e-4..=1.0 + 1e-4).contains(&x);
    let corner = |k: usize| {
        DVec3::from_array(std::array::from_fn(|axis| if k >> axis & 1 == 0 { low[axis] } else { high[axis] }))
    };
    (0..8).all(|k| to_octree.transform_point3(corner(k)).to_array().into_iter().all(inside))
}
