//! The measurement: each method voxelizes each scene in each grid and is compared with the builder's voxels.

use std::time::{Duration, Instant};

use esvo_builder::cells::PreparedMesh;
use esvo_builder::{BuildSettings, Mesh};
use esvo_raster::{Method, Options, Pair, RasterError, Surface, Voxelizer, Voxels, bounds};
use serde::{Deserialize, Serialize};

use super::pictures::Pictures;
use super::rate::{beyond_bound, differences, methods};
use super::sheet::{mean_edge, sheet};
use super::surface::{decide, failed};
use super::{
    CurvePoint, Grid, MAX_LEVEL, MethodRow, PictureGroup, SCHEMA, SceneVoxels, VoxelBenchOptions, VoxelOutcome,
    VoxelReport, grid_name,
};
use crate::journal::Journal;
use crate::matrix_parts::LeftOut;
use crate::scene::{self, Scene};
use crate::system::machine::Machine;
use crate::text::short;
use crate::{BenchError, Progress};

/// The level of the grid that sheets are voxelized into.
const SHEET_LEVEL: u32 = 8;
/// Edges of the triangles of sheets, in voxels.
const SHEET_EDGES: [f64; 9] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];

/// Voxelizes, compares, measures, makes pictures.
///
/// # Errors
/// A scene, a method or a device that cannot be used.
pub fn run_voxel_bench(options: &VoxelBenchOptions, progress: &Progress) -> Result<VoxelOutcome, BenchError> {
    resume_voxel_bench(options, &Journal::none(), progress)
}

/// Like [`run_voxel_bench`]. Scenes that are in the journal are not measured again; those that are measured are kept there.
///
/// # Errors
/// Those of [`run_voxel_bench`], and the journal's.
pub fn resume_voxel_bench(
    options: &VoxelBenchOptions,
    journal: &Journal,
    progress: &Progress,
) -> Result<VoxelOutcome, BenchError> {
    let start = Instant::now();
    let found_before = journal.found_seconds();
    let elapsed = || journal.found_seconds() - found_before + start.elapsed().as_secs_f64();
    let wanted = methods(&options.methods)?;
    for grid in &options.scenes {
        if grid.levels.is_empty() || grid.levels.iter().any(|level| !(1..=MAX_LEVEL).contains(level)) {
            let what = format!("grids of levels {:?}; there are levels 1 to {MAX_LEVEL}", grid.levels);
            return Err(failed(&grid.name, what));
        }
    }
    let device = options.device.as_ref().map_or("voxelization".into(), |name| format!("--device {name}"));
    let voxelizer = Voxelizer::open(options.device.as_deref()).map_err(|e| BenchError::option(device, e))?;
    let (methods, lacking) = possible(&voxelizer, wanted)?;
    let manifest = scene::manifest(None)?;
    let mut pictures = Pictures::new(&voxelizer, &methods);
    let (mut scenes, mut late, mut absent) = (Vec::new(), options.left_out.clone(), Vec::new());
    for (done, grids) in options.scenes.iter().enumerate() {
        progress.parts(done, options.scenes.len(), elapsed());
        let entry = scene::entry(&manifest, &grids.name)?;
        if let Some(left_out) = scene::left_out(entry, options.scenes_dir.as_deref(), options.scenes.len())? {
            absent.push(left_out);
            continue;
        }
        let key = format!("voxelize {}", grids.name);
        if let Some(part) = journal.find::<ScenePart>(&key)? {
            for group in &part.groups {
                pictures.made.extend(journal.find_pictures(&group.files)?);
            }
            pictures.groups.extend(part.groups);
            late.extend(part.late);
            scenes.push(part.scene);
            continue;
        }
        let part_start = Instant::now();
        let (made, groups) = (pictures.made.len(), pictures.groups.len());
        progress.say(format!("{}: reading the mesh", grids.name));
        let scene = Scene::load(entry, options.scenes_dir.as_deref(), 1)?;
        let deepest = grids.levels.iter().copied().max().unwrap_or(1);
        let prepared = PreparedMesh::new(&scene.mesh, deepest).map_err(|e| failed(&scene.name, e))?;
        let mut run =
            Run { voxelizer: &voxelizer, options, methods: &methods, progress, prepared: &prepared, mesh: &scene.mesh };
        let limit = options.time_limit_seconds.map(|limit| limit - elapsed());
        let (grids, left_out) = run.grids(&scene.name, &grids.levels, limit)?;
        if options.pictures && scene.not_published.is_none() {
            progress.say(format!("{}: pictures", scene.name));
            pictures.scene(&scene, &prepared)?;
        }
        let of_scene = SceneVoxels {
            name: scene.name,
            identity: scene.identity,
            credit: scene.credit,
            triangles: prepared.corners().len() as u64,
            grids,
        };
        let part = ScenePart { scene: of_scene, late: left_out, groups: pictures.groups[groups..].to_vec() };
        journal.keep_pictures(&pictures.made[made..])?;
        journal.keep(&key, part_start, &part)?;
        late.extend(part.late);
        scenes.push(part.scene);
    }
    progress.say("sheets of triangles of one size");
    let deepest = options.scenes.iter().flat_map(|scene| &scene.levels).copied().max().unwrap_or(0);
    // Of a run in coarse grids, which is a trial, sheets of a million triangles would be most of the time.
    let least = if deepest < SHEET_LEVEL { 2.0 } else { 0.0 };
    let curve = curve(&voxelizer, &methods, least)?;
    if options.pictures {
        progress.say("pictures of test meshes");
        pictures.test_meshes()?;
    }
    let report = VoxelReport {
        schema: SCHEMA,
        machine: Machine::detect(),
        options: options.clone(),
        device: voxelizer.device(),
        left_out: [late, lacking, absent].concat(),
        scenes,
        curve,
        pictures: pictures.groups,
        seconds: elapsed(),
    };
    Ok(VoxelOutcome { report, pictures: pictures.made })
}

/// What a journal keeps of a scene.
#[derive(Serialize, Deserialize)]
struct ScenePart {
    scene: SceneVoxels,
    /// Grids that the time limit left out.
    late: Vec<LeftOut>,
    groups: Vec<PictureGroup>,
}

/// Why nothing can be voxelized here; `None` if there is a device.
pub fn unavailable(options: &VoxelBenchOptions) -> Option<String> {
    Voxelizer::open(options.device.as_deref()).err().map(|error| error.to_string())
}

/// The methods that the device has what it takes for, and those that it has not.
fn possible(voxelizer: &Voxelizer, wanted: Vec<Method>) -> Result<(Vec<Method>, Vec<LeftOut>), BenchError> {
    let (mut methods, mut lacking) = (Vec::new(), Vec::new());
    for method in wanted {
        match voxelizer.check(method) {
            Ok(()) => methods.push(method),
            Err(error @ RasterError::Lacks { .. }) => {
                lacking.push(LeftOut { what: format!("method {}", method.letter()), reason: error.to_string() });
            }
            Err(error) => return Err(BenchError::option("voxelization", error)),
        }
    }
    match lacking.first() {
        Some(LeftOut { reason, .. }) if methods.is_empty() => Err(BenchError::option("--methods", reason)),
        _ => Ok((methods, lacking)),
    }
}

struct Run<'a> {
    voxelizer: &'a Voxelizer,
    options: &'a VoxelBenchOptions,
    methods: &'a [Method],
    progress: &'a Progress,
    prepared: &'a PreparedMesh,
    mesh: &'a Mesh,
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// The surface of a scene, and with it the work, grows by this factor from one level to the next.
const GROWTH: f64 = 4.0;

impl Run<'_> {
    /// The grids of a scene, and those that would not end within `limit` seconds from now.
    fn grids(
        &mut self,
        name: &str,
        levels: &[u32],
        limit: Option<f64>,
    ) -> Result<(Vec<Grid>, Vec<LeftOut>), BenchError> {
        let start = Instant::now();
        let (mut grids, mut late) = (Vec::new(), Vec::new());
        let mut last: Option<(u32, f64)> = None;
        for &level in levels {
            let began = start.elapsed().as_secs_f64();
            let expected =
                last.map_or(0.0, |(before, seconds)| seconds * GROWTH.powf(f64::from(level) - f64::from(before)));
            if let Some(limit) = limit.filter(|limit| last.is_some() && began + expected > *limit) {
                let reason = format!(
                    "would take about {} s, and {} s are left; expected a longer time limit",
                    short(expected),
                    short((limit - began).max(0.0))
                );
                late.push(LeftOut { what: grid_name(name, level), reason });
                continue;
            }
            grids.push(self.grid(name, level)?);
            last = Some((level, start.elapsed().as_secs_f64() - began));
        }
        Ok((grids, late))
    }

    /// One grid, with rounds that go through all methods in turn.
    fn grid(&mut self, name: &str, level: u32) -> Result<Grid, BenchError> {
        let error = |e: &dyn ToString| failed(name, e.to_string());
        let what = format!("{name}: {} voxels along the edge", 1u32 << level);
        self.progress.say(format!("{what}: the builder"));
        let start = Instant::now();
        let settings =
            BuildSettings { levels: level, contours: false, colors: false, normals: false, ..BuildSettings::default() };
        let built = esvo_builder::build(self.mesh, &settings, &|_| ()).map_err(|e| error(&e))?;
        let build_ms = ms(start.elapsed());
        drop(built);
        let mut exact = Vec::new();
        let mut exact_ms = Vec::new();
        let mut rows: Vec<MethodRow> = Vec::new();
        for round in 0..self.options.rounds.max(1) {
            let start = Instant::now();
            exact = self.prepared.cells(level).map_err(|e| error(&e))?;
            exact_ms.push(ms(start.elapsed()));
            for (index, &method) in self.methods.iter().enumerate() {
                self.progress.say(format!("{what}: {method}, round {}", round + 1));
                let found = self.voxelize(level, method).map_err(|e| error(&e))?;
                if round == 0 {
                    rows.push(self.row(level, method, &exact, &found)?);
                }
                let (row, stats) = (&mut rows[index], &found.stats);
                row.voxelize_ms.push(ms(stats.voxelize));
                row.compact_ms.push(ms(stats.compact));
                row.host_ms.push(ms(stats.preparation + stats.decisions));
            }
        }
        let mean_edge = mean_edge(self.prepared.corners()) * f64::from(1u32 << level);
        Ok(Grid { level, voxels: exact.len() as u64, exact_ms, build_ms, mean_edge, methods: rows })
    }

    fn surface(&self) -> Surface<'_> {
        Surface { corners: self.prepared.corners(), looks: None }
    }

    fn voxelize(&self, level: u32, method: Method) -> Result<Voxels, RasterError> {
        let decide = |pairs: &[Pair]| decide(self.prepared, level, pairs);
        self.voxelizer.voxelize(&self.surface(), &Options { decide: Some(&decide), ..Options::new(level, method) })
    }

    /// What a method finds, compared with the exact voxels.
    fn row(&self, level: u32, method: Method, exact: &[u64], found: &Voxels) -> Result<MethodRow, BenchError> {
        let (surface, options) = (self.surface(), Options::new(level, method));
        let (missing, extra) = differences(exact, &found.codes);
        let error = |e: RasterError| failed(method.name(), e);
        let cracks = self.voxelizer.cracks(&surface, &options, &missing).map_err(error)?.len() as u64;
        let fragments = self.voxelizer.pixels(&surface, &options).map_err(error)?.shaded;
        let mut beyond = 0;
        if method.is_tested() {
            beyond = beyond_bound(self.prepared, level, &missing)? + beyond_bound(self.prepared, level, &extra)?;
        }
        Ok(MethodRow {
            letter: method.letter().into(),
            name: method.name().into(),
            tested: method.is_tested(),
            voxels: found.codes.len() as u64,
            cracks,
            holes: missing.len() as u64 - cracks,
            extra: extra.len() as u64,
            beyond_bound: beyond,
            undecided: found.stats.undecided,
            fragments,
            voxelize_ms: Vec::new(),
            compact_ms: Vec::new(),
            host_ms: Vec::new(),
            bytes: found.stats.bytes,
            tiles: found.stats.tiles,
            tiles_of_grid: found.stats.tiles_of_grid,
        })
    }
}

/// Missing voxels by the size of triangles.
fn curve(voxelizer: &Voxelizer, methods: &[Method], least: f64) -> Result<Vec<CurvePoint>, BenchError> {
    let voxels = f64::from(1u32 << SHEET_LEVEL);
    let mut points = Vec::new();
    if methods.iter().all(|method| method.is_tested()) {
        return Ok(points);
    }
    for edge in SHEET_EDGES.into_iter().filter(|edge| *edge >= least) {
        let corners = sheet(edge / voxels);
        let exact = bounds::voxels(&corners, SHEET_LEVEL);
        for &method in methods.iter().filter(|method| !method.is_tested()) {
            let (surface, options) = (Surface { corners: &corners, looks: None }, Options::new(SHEET_LEVEL, method));
            let found = voxelizer.voxelize(&surface, &options).map_err(|e| failed("sheet", e))?;
            let missing = differences(&exact, &found.codes).0;
            let cracks = voxelizer.cracks(&surface, &options, &missing).map_err(|e| failed("sheet", e))?;
            points.push(CurvePoint {
                edge: mean_edge(&corners) * voxels,
                letter: method.letter().into(),
                voxels: exact.len() as u64,
                missing: missing.len() as u64,
                holes: (missing.len() - cracks.len()) as u64,
            });
        }
    }
    Ok(points)
}
