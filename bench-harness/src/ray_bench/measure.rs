//! The measurement: every engine casts every set, is compared with the reference, and is timed round by round.

use std::sync::Arc;
use std::time::Instant;

use esvo_builder::BuildSettings;
use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::compare::Comparison;
use esvo_core::{CastError, CastOptions, Caster, Object, View};
use esvo_engines::{EngineId, InstructionSet, OpenOptions};
use esvo_format::Octree;

use super::sets::{self, Set};
use super::{Cell, EngineRow, RayBenchOptions, RayReport, SCHEMA};
use crate::calibration::{Calibrator, GuardRound, GuardSamples};
use crate::content_hash::image_key;
use crate::paper_bench::check::Agreement;
use crate::scene::{self, Scene};
use crate::system::machine::Machine;
use crate::{BenchError, Progress};

/// Fewest rounds.
const ROUNDS: usize = 3;

/// An engine at work.
struct Running {
    id: EngineId,
    row: EngineRow,
    caster: Option<Box<dyn Caster>>,
}

/// Builds the scene, casts, compares, measures. An engine that cannot be opened or that fails is a row with the reason.
///
/// # Errors
/// A scene or options that cannot be used.
pub fn run_ray_bench(options: &RayBenchOptions, progress: &Progress) -> Result<RayReport, BenchError> {
    let start = Instant::now();
    let failed = |what: String| BenchError::scene(&options.scene, what);
    if options.rays == 0 || !(options.seconds >= 0.0 && options.seconds <= 3600.0) {
        let (rays, seconds) = (options.rays, options.seconds);
        return Err(failed(format!(
            "{rays} rays in {seconds} seconds; expected at least 1 ray, and 0 to 3600 seconds"
        )));
    }
    let manifest = scene::manifest(None)?;
    progress.say(format!("{}: reading the mesh", options.scene));
    let scene = Scene::load(scene::entry(&manifest, &options.scene)?, options.scenes_dir.as_deref(), 1)?;
    let bounds = scene.mesh.bounds().ok_or_else(|| failed("its mesh is empty".into()))?;
    progress.say(format!("{}: building {} levels", options.scene, options.levels));
    let settings = BuildSettings { levels: options.levels, contours: true, ..scene.settings };
    let built = esvo_builder::build(&scene.mesh, &settings, &|_| ()).map_err(|e| failed(e.to_string()))?;
    let octree = Arc::new(built.octree);

    let [width, height] = options.size;
    let object = Object::of(&octree, 0);
    // One ray per pixel, each on its own, as in a list of rays.
    let cast = CastOptions { contours: true, beam: false, max_voxel_pixels: 1.0 };
    let view = View::new(&scene.views[0].camera, *object.octree_to_mesh(), object.root(), (width, height), &cast);
    progress.say("casting by the reference caster");
    let sets = view.and_then(|view| {
        let mut reference = ReferenceCaster::default();
        reference.load(&octree)?;
        sets::all(&object, &view, [bounds.0, bounds.1], options.rays, &mut reference)
    });
    let sets = sets.map_err(|e| failed(e.to_string()))?;

    let calibrator = Calibrator::new(options.threads)?;
    let mut engines = open(options);
    for engine in &mut engines {
        progress.say(format!("comparing {}", engine.row.name));
        engine.compare(&octree, &sets, &object);
    }
    time(options, &mut engines, &sets, &object, &calibrator, progress);
    Ok(RayReport {
        schema: SCHEMA,
        machine: Machine::detect(),
        options: Some(options.clone()),
        scene: scene.name,
        identity: scene.identity,
        credit: scene.credit,
        levels: options.levels,
        voxels: esvo_format::stats(&octree).voxels,
        view: scene.views[0].name.clone(),
        size: options.size,
        image_sha256: image_key(&octree),
        calibration: Some(calibrator.record()),
        sets: sets.into_iter().map(|set| set.row).collect(),
        engines: engines.into_iter().map(|engine| engine.row).collect(),
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// Opens the engines. The CPU engine is there twice if it has faster instructions than the plain ones.
fn open(options: &RayBenchOptions) -> Vec<Running> {
    let mut engines = Vec::new();
    let plain = OpenOptions { threads: options.threads, ..OpenOptions::default() };
    for &id in &options.engines {
        let mut add = |name: &str, options: &OpenOptions| {
            let (caster, error) = match id.open(options) {
                Ok(caster) => (Some(caster), None),
                Err(error) => (None, Some(error.to_string())),
            };
            let device = caster.as_ref().map(|caster| caster.device().clone());
            engines.push(Running {
                id,
                row: EngineRow { name: name.into(), device, error, cells: Vec::new() },
                caster,
            });
        };
        if id == EngineId::Cpu && InstructionSet::best() != InstructionSet::Scalar {
            add("scalar", &OpenOptions { instructions: Some(InstructionSet::Scalar), ..plain.clone() });
        }
        add(id.name(), &plain);
    }
    engines
}

impl Running {
    /// Loads the octree, and compares every set with the reference.
    fn compare(&mut self, octree: &Arc<Octree>, sets: &[Set], object: &Object) {
        let allowed = self.id.allowed();
        let cell = |found: Comparison| Cell {
            agreement: Agreement::new(found, allowed),
            seconds: Vec::new(),
            guard: GuardSamples::default(),
        };
        self.try_with(|caster, cells| {
            caster.load(octree)?;
            for set in sets {
                let mut hits = Vec::new();
                set.cast(caster, object, &mut hits)?;
                cells.push(cell(Comparison::of(&hits, &set.expected)));
            }
            Ok(())
        });
    }

    /// Lets the engine work. After an error it is closed, and its row has the reason and nothing else.
    fn try_with(&mut self, work: impl FnOnce(&mut dyn Caster, &mut Vec<Cell>) -> Result<(), CastError>) {
        let Some(caster) = &mut self.caster else { return };
        if let Err(error) = work(&mut **caster, &mut self.row.cells) {
            self.caster = None;
            self.row.error = Some(error.to_string());
            self.row.cells.clear();
        }
    }
}

/// Times round by round, so that drift hits all engines alike. The calibrator casts before and after each set.
fn time(
    options: &RayBenchOptions,
    engines: &mut [Running],
    sets: &[Set],
    object: &Object,
    calibrator: &Calibrator,
    progress: &Progress,
) {
    let start = Instant::now();
    let mut hits = Vec::new();
    for round in 0.. {
        if round >= ROUNDS && start.elapsed().as_secs_f64() >= options.seconds {
            break;
        }
        progress.say(format!("round {}", round + 1));
        for engine in &mut *engines {
            engine.try_with(|caster, cells| {
                for (set, cell) in sets.iter().zip(cells) {
                    let mut guard = GuardRound::start(calibrator);
                    let start = Instant::now();
                    guard.frame(|| set.cast(caster, object, &mut hits))?;
                    cell.seconds.push(start.elapsed().as_secs_f64());
                    guard.calibrate(calibrator);
                    cell.guard.push(guard);
                }
                Ok(())
            });
        }
    }
}
