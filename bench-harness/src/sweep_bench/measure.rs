//! Measuring a subject: every setting is compared with the reference caster and with the exact answer, then all are timed in turn.

use std::sync::Arc;

use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::compare::Comparison;
use esvo_core::{CastError, CastOptions, Caster, Hit, View};
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::Octree;
use rayon::prelude::*;

use super::exact::Errors;
use super::record::{Cell, CellError};
use super::subject::{Sample, Subject, Truth};
use crate::calibration::{Calibrator, GuardRound, GuardSamples};
use crate::matrix_parts::LeftOut;
use crate::paper_bench::check::Agreement;
use crate::timing::wake;
use crate::{BenchError, Progress};

/// What a Vulkan driver that runs on the processor casts: its times say nothing about GPUs.
pub(crate) const SOFTWARE_SUBSET: &str =
    "runs on the processor: only the deepest octrees, at 1 pixel, the cubical one without the beam";

/// An engine that was opened.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SweptEngine {
    pub(crate) id: EngineId,
    /// Whether it casts the [subset](SOFTWARE_SUBSET) alone.
    pub(crate) subset: bool,
}

/// How often, and by how many threads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rounds {
    pub(crate) timed: usize,
    pub(crate) warm_up: usize,
    pub(crate) threads: Option<usize>,
}

/// A caster that holds an octree.
struct Loaded {
    caster: Box<dyn Caster>,
}

/// A setting that is timed.
struct Running {
    cell: Cell,
    /// Index of its caster; `None` for triangles.
    loaded: Option<usize>,
    views: Vec<View>,
    /// Indices of the exact answers, which have the rays of triangles.
    exact: Vec<usize>,
}

/// Measures every setting of a subject on every engine. Cells are in the order engine by engine, octree by octree; triangles
/// are the last. An octree that an engine cannot load is left out.
///
/// # Errors
/// A caster that fails.
pub(crate) fn measure(
    subject: &mut Subject,
    engines: &[SweptEngine],
    rounds: &Rounds,
    calibrator: &Calibrator,
    progress: &Progress,
    left_out: &mut Vec<LeftOut>,
) -> Result<Vec<Cell>, BenchError> {
    let mut loaded = Vec::new();
    let mut running = Vec::new();
    for index in 0..subject.samples.len() {
        progress.fraction(
            &format!("{}: comparing", subject.name),
            index as f64 / subject.samples.len() as f64,
            &format!("{} levels", subject.samples[index].row.levels),
        );
        compare(subject, index, engines, rounds, left_out, &mut loaded, &mut running)?;
    }
    running.extend(compare_triangles(subject)?);
    time(subject, rounds, calibrator, progress, &mut loaded, &mut running)?;
    let mut cells: Vec<Cell> = running.into_iter().map(|running| running.cell).collect();
    cells.sort_by_key(|cell| (cell.octree.is_none(), cell.engine));
    Ok(cells)
}

/// Compares the settings of one octree on all engines.
fn compare(
    subject: &mut Subject,
    index: usize,
    engines: &[SweptEngine],
    rounds: &Rounds,
    left_out: &mut Vec<LeftOut>,
    loaded: &mut Vec<Loaded>,
    running: &mut Vec<Running>,
) -> Result<(), BenchError> {
    let octree = subject.samples[index].octree.clone();
    let casts = subject.samples[index].casts.clone();
    let views: Vec<Vec<View>> = casts.iter().map(|cast| subject.views_of(&octree, cast)).collect::<Result<_, _>>()?;
    let Some(first) = views.first() else { return Ok(()) };
    let exact = subject.find_exact(&octree, first)?;
    let expected: Vec<Vec<Vec<Hit>>> = (views.par_iter())
        .map(|views| {
            let mut reference = ReferenceCaster::default();
            reference.load(&octree)?;
            cast_all(&mut reference, views)
        })
        .collect::<Result<_, CastError>>()
        .map_err(|e| subject.failed(e))?;
    for engine in engines {
        let wanted: Vec<usize> = (0..casts.len())
            .filter(|&cast| !engine.subset || in_software_subset(&subject.samples, index, &casts[cast]))
            .collect();
        if wanted.is_empty() {
            continue;
        }
        let open = OpenOptions { threads: rounds.threads, ..OpenOptions::default() };
        let mut caster = engine.id.open(&open).map_err(BenchError::Open)?;
        if let Err(error) = caster.load(&octree) {
            let row = &subject.samples[index].row;
            let kind = if row.contours { "contours" } else { "cubical" };
            left_out.push(LeftOut {
                what: format!("{}, {}, {} levels, {kind}", subject.name, engine.id, row.levels),
                reason: error.to_string(),
            });
            continue;
        }
        let cast_one = |caster: &mut dyn Caster, cast: &usize| cast_all(caster, &views[*cast]);
        let hits: Vec<Vec<Vec<Hit>>> = (wanted.iter())
            .map(|cast| cast_one(&mut *caster, cast))
            .collect::<Result<_, CastError>>()
            .map_err(|source| BenchError::Cast { engine: engine.id, source })?;
        let errors: Vec<CellError> = (wanted.par_iter().zip(&hits))
            .map(|(cast, hits)| error(subject, &octree, &exact, &views[*cast], hits))
            .collect();
        let memory_bytes = caster.resident_bytes();
        loaded.push(Loaded { caster });
        for ((&cast, hits), error) in wanted.iter().zip(&hits).zip(errors) {
            let mut all = Comparison::default();
            for (expected, found) in expected[cast].iter().zip(hits) {
                all = all.and(Comparison::of(expected, found));
            }
            let CastOptions { contours, beam, max_voxel_pixels } = casts[cast];
            running.push(Running {
                cell: Cell {
                    engine: engine.id,
                    octree: Some(index),
                    contours,
                    beam,
                    max_voxel_pixels,
                    memory_bytes,
                    disk_bytes: subject.samples[index].row.file_bytes,
                    agreement: Some(Agreement::new(all, engine.id.allowed())),
                    error,
                    seconds: Vec::new(),
                    guard: GuardSamples::default(),
                },
                loaded: Some(loaded.len() - 1),
                views: views[cast].clone(),
                exact: exact.clone(),
            });
        }
    }
    Ok(())
}

/// The hits of each view.
fn cast_all(caster: &mut dyn Caster, views: &[View]) -> Result<Vec<Vec<Hit>>, CastError> {
    let cast = |view: &View| {
        let mut hits = Vec::new();
        caster.cast(view, &mut hits).map(|()| hits)
    };
    views.iter().map(cast).collect()
}

/// The error of hits against the exact answers.
pub(crate) fn error(
    subject: &Subject,
    octree: &Arc<Octree>,
    exact: &[usize],
    views: &[View],
    hits: &[Vec<Hit>],
) -> CellError {
    let mut errors = Errors::default();
    for ((exact, view), hits) in exact.iter().zip(views).zip(hits) {
        errors.add(subject.exact(*exact), octree, view, hits);
    }
    errors.finish()
}

/// Whether an engine that runs on the processor casts this: see [`SOFTWARE_SUBSET`].
fn in_software_subset(samples: &[Sample], index: usize, cast: &CastOptions) -> bool {
    let row = &samples[index].row;
    let same_kind = |sample: &&Sample| sample.row.contours == row.contours;
    let deepest = samples.iter().filter(same_kind).all(|sample| sample.row.levels <= row.levels);
    deepest && cast.max_voxel_pixels == 1.0 && (cast.contours || !cast.beam)
}

/// The triangles, cast by the processor; `None` if they are not known.
fn compare_triangles(subject: &mut Subject) -> Result<Option<Running>, BenchError> {
    let Truth::Triangles { mesh, triangles, .. } = subject.truth else { return Ok(None) };
    let Some(octree) = subject.samples.first().map(|sample| sample.octree.clone()) else { return Ok(None) };
    let views = subject.views_of(&octree, &CastOptions::default())?;
    let exact = subject.find_exact(&octree, &views)?;
    let mut errors = Errors::default();
    let mut hits = Vec::new();
    for exact in &exact {
        let exact = subject.exact(*exact);
        triangles.cast(exact.rays(), &mut hits);
        errors.add_triangles(exact, mesh, &hits);
    }
    let numbers =
        [mesh.positions.len(), mesh.normals.len(), mesh.colors.len(), mesh.triangles.len()].iter().sum::<usize>() * 3
            + mesh.uvs.len() * 2
            + mesh.tangents.len() * 4;
    let cell = Cell {
        engine: EngineId::Cpu,
        octree: None,
        contours: false,
        beam: false,
        max_voxel_pixels: 0.0,
        memory_bytes: triangles.resident_bytes(),
        disk_bytes: numbers as u64 * 4,
        agreement: None,
        error: errors.finish(),
        seconds: Vec::new(),
        guard: GuardSamples::default(),
    };
    Ok(Some(Running { cell, loaded: None, views: Vec::new(), exact }))
}

/// Times round by round: every setting casts every view once a round, so that drift hits all alike; every second round goes
/// backwards. The calibrator casts before and after each setting. Settings whose hits are wrong are not timed.
fn time(
    subject: &Subject,
    rounds: &Rounds,
    calibrator: &Calibrator,
    progress: &Progress,
    loaded: &mut [Loaded],
    running: &mut [Running],
) -> Result<(), BenchError> {
    let all = rounds.warm_up + rounds.timed;
    for round in 0..all {
        let what = format!("{}: timing", subject.name);
        progress.fraction(&what, round as f64 / all as f64, &format!("round {} of {all}", round + 1));
        let order: Box<dyn Iterator<Item = &mut Running>> =
            if round % 2 == 0 { Box::new(running.iter_mut()) } else { Box::new(running.iter_mut().rev()) };
        for running in order.filter(|running| running.cell.passed()) {
            let mut seconds = Vec::new();
            let mut guard = GuardRound::start(calibrator);
            match (running.loaded, &subject.truth) {
                (Some(index), _) => {
                    let caster = &mut loaded[index].caster;
                    for view in &running.views {
                        let engine = running.cell.engine;
                        let woken = wake(caster.device().kind, || caster.time(view).map(drop));
                        let time = woken.and_then(|()| guard.frame(|| caster.time(view)));
                        let time = time.map_err(|source| BenchError::Cast { engine, source })?;
                        seconds.push(time.total.as_secs_f64());
                    }
                }
                (None, Truth::Triangles { triangles, .. }) => {
                    for exact in &running.exact {
                        let rays = subject.exact(*exact).rays();
                        // On as many threads as the octrees' caster.
                        let time = guard.frame(|| calibrator.pool().install(|| triangles.time(rays)));
                        seconds.push(time.as_secs_f64());
                    }
                }
                (None, Truth::Leaves) => {}
            }
            if round >= rounds.warm_up {
                running.cell.seconds.push(seconds);
                guard.calibrate(calibrator);
                running.cell.guard.push(guard);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use esvo_builder::{BuildSettings, Mesh, build};
    use esvo_core::Camera;
    use esvo_cpu::triangles::TriangleScene;

    use super::super::cache::Cache;
    use super::super::subject::{Sample, row};
    use super::*;
    use crate::scene::NamedView;

    /// The negative control: what a broken caster gets wrong shows in the error and in the check, and it is not timed.
    #[test]
    fn broken_hits_have_larger_errors() {
        let corners = esvo_cpu::triangles::testing::sphere(3);
        let positions: Vec<[f64; 3]> = corners.iter().flatten().copied().collect();
        let indices = (0..corners.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = Mesh::from_triangles(positions, indices).unwrap();
        let triangles = TriangleScene::new(corners).unwrap();
        let octree =
            Arc::new(build(&mesh, &BuildSettings { levels: 6, ..Default::default() }, &|_| ()).unwrap().octree);
        let (_, high) = mesh.bounds().unwrap();
        let far = 6.0 * high[2];
        let camera = Camera {
            eye: [0.0, 0.0, 3.0 * high[2]],
            forward: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            fov_degrees: 50.0,
            near: 0.01 * far,
            far,
        };
        let views = [NamedView { name: "front".into(), camera }];
        let cast = CastOptions { max_voxel_pixels: 0.5, ..CastOptions::default() };
        let samples = vec![Sample { octree: octree.clone(), row: row(&octree, 6, true, None), casts: vec![cast] }];
        let truth = Truth::Triangles { mesh: &mesh, triangles: &triangles, key: "k" };
        let cache = Cache::none();
        let mut subject = Subject::new("ball", samples, &views, [80, 60], truth, &cache);
        let engines = [SweptEngine { id: EngineId::Cpu, subset: false }];
        let rounds = Rounds { timed: 2, warm_up: 0, threads: None };
        let calibrator = Calibrator::new(None).unwrap();
        let cells =
            measure(&mut subject, &engines, &rounds, &calibrator, &Progress::hidden(), &mut Vec::new()).unwrap();
        let good = cells[0].error;
        assert!(
            cells.len() == 2
                && cells.iter().all(|c| c.passed() && c.seconds.len() == 2 && c.guard.calibration_seconds.len() == 2)
        );

        let views = subject.views_of(&octree, &cast).unwrap();
        let exact = subject.find_exact(&octree, &views).unwrap();
        let mut caster = ReferenceCaster::default();
        caster.load(&octree).unwrap();
        let hits = cast_all(&mut caster, &views).unwrap();
        assert_eq!(error(&subject, &octree, &exact, &views, &hits), good);
        let broken = |change: &dyn Fn(&mut Hit)| {
            let mut hits = hits.clone();
            hits[0].iter_mut().filter(|hit| !hit.is_miss()).step_by(3).for_each(change);
            error(&subject, &octree, &exact, &views, &hits)
        };
        let deeper = broken(&|hit| hit.raw_t *= 1.1);
        assert!(deeper.pixels.p90 > 2.0 * good.pixels.p90 && deeper.scene.max > good.scene.max, "{deeper:?} {good:?}");
        let holes = broken(&|hit| *hit = Hit::miss(0));
        assert!(holes.holes > 100 && holes.disagreement > 0.05 && holes.flip > 1.5 * good.flip, "{holes:?} {good:?}");
        let strange = broken(&|hit| hit.raw_t = f32::NAN);
        assert!(strange.strange > 100);

        // A setting with wrong hits is not timed.
        let mut running =
            vec![Running { cell: Cell { error: strange, ..cells[0].clone() }, loaded: Some(0), views, exact }];
        running[0].cell.seconds.clear();
        time(&subject, &rounds, &calibrator, &Progress::hidden(), &mut [], &mut running).unwrap();
        assert!(running[0].cell.seconds.is_empty() && !running[0].cell.passed());
    }
}
