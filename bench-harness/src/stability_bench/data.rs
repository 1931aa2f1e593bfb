//! Hard rays through hard octrees: the run.

use std::time::Instant;

use esvo_core::reference::cast_ray;
use esvo_core::testing::directed::{DataSet, Kind, Symmetry, Target, data_sets, leaks, ray, sphere};
use esvo_core::testing::oracle::Oracle;
use esvo_core::{Hit, Ray, Rays};
use glam::Vec3;
use rayon::prelude::*;

use super::engines::{self, Running};
use super::replay::Case;
use super::{Cell, Leaks, SCHEMA, SetRow, StabilityOptions, StabilityReport, SymmetryRow, controls, meshes, pictures};
use crate::system::machine::Machine;
use crate::{BenchError, Progress};

/// Voxels of an octree that rays are aimed at.
pub(super) const TARGETS: usize = 20_000;
/// Rays that are cast at once.
const BATCH: u64 = 1 << 14;

/// Casts all rays by all engines.
///
/// # Errors
/// An octree of the suite that cannot be made, or a mesh that cannot be built.
pub fn run_stability_bench(options: &StabilityOptions, progress: &Progress) -> Result<StabilityReport, BenchError> {
    let start = Instant::now();
    let sets = sets()?;
    let mut engines = engines::open(options);
    // Half of the sets are cast with contours, too.
    let passes: u64 = sets.iter().map(|set| 1 + u64::from(set.octree.needs().contours)).sum();
    let kinds = Kind::ALL.len() as u64;
    let per_cell = |rays: u64| (rays / (passes * (kinds + pictures::SHARE))).max(1);
    let counts =
        Counts { rays: per_cell(options.rays), gpu_rays: per_cell(options.gpu_rays).min(per_cell(options.rays)) };
    let mut report = StabilityReport {
        schema: SCHEMA,
        machine: Machine::detect(),
        options: Some(options.clone()),
        seed: options.seed,
        sets: Vec::new(),
        cells: Vec::new(),
        symmetries: Vec::new(),
        leaks: Leaks::default(),
        engines: Vec::new(),
        meshes: Vec::new(),
        controls: Vec::new(),
        seconds: 0.0,
    };
    let mut done = 0.0;
    for set in &sets {
        let oracle = Oracle::new(&set.octree, 0);
        report.sets.push(SetRow {
            name: set.name.into(),
            about: set.about.into(),
            levels: set.octree.needs().levels,
            voxels: esvo_format::stats(&set.octree).voxels,
            most_iterations: oracle.most_iterations(),
        });
        let target = Target::of(&set.octree, TARGETS);
        engines.iter_mut().for_each(|engine| engine.load(&set.octree));
        for contours in [false, true] {
            if contours && !set.octree.needs().contours {
                continue;
            }
            for kind in Kind::ALL {
                progress.fraction(&format!("{}: {}", set.name, kind.name()), done / (passes * (kinds + 1)) as f64, "");
                done += 1.0;
                let group = Group { set, kind, contours, oracle: &oracle, target: &target };
                report.cells.push(group.run(options.seed, counts, &mut engines));
            }
            done += 1.0;
            progress.fraction(&format!("{}: pictures", set.name), done / (passes * (kinds + 1)) as f64, "");
            report.cells.push(pictures::run(set, contours, &oracle, options.seed, counts, &mut engines));
        }
        if !set.turned.is_empty() {
            progress.say(format!("{}: mirrored and turned", set.name));
            report.symmetries.push(symmetries(set, &oracle, &target, options.seed, counts.rays));
        }
    }
    progress.say("from within a closed shell");
    report.leaks = closed(options.seed, options.rays / 20 + 1)?;
    report.meshes = meshes::run(options.mesh_rays, options.seed, progress)?;
    progress.say("mistakes on purpose");
    report.controls = controls::run(&sets)?;
    report.engines = engines.into_iter().map(|engine| engine.row).collect();
    report.seconds = start.elapsed().as_secs_f64();
    Ok(report)
}

/// The octrees of the suite.
pub(super) fn sets() -> Result<Vec<DataSet>, BenchError> {
    data_sets().map_err(|error| BenchError::scene("stability", error.to_string()))
}

/// Rays of each kind.
#[derive(Clone, Copy)]
pub(super) struct Counts {
    pub(super) rays: u64,
    pub(super) gpu_rays: u64,
}

/// Rays of one kind through one octree.
pub(super) struct Group<'a> {
    pub(super) set: &'a DataSet,
    pub(super) kind: Kind,
    pub(super) contours: bool,
    pub(super) oracle: &'a Oracle<'a>,
    pub(super) target: &'a Target,
}

impl Group<'_> {
    fn run(&self, seed: u64, counts: Counts, engines: &mut [Running]) -> Cell {
        let mut cell = Cell {
            set: self.set.name.into(),
            kind: self.kind.name().into(),
            contours: self.contours,
            ..Cell::default()
        };
        let case =
            |number: u64| Case { set: self.set.name, kind: self.kind, contours: self.contours, number }.to_string();
        let mut from = 0;
        while from < counts.rays {
            let count = BATCH.min(counts.rays - from);
            let first = seed + from;
            let rays: Vec<Ray> = (0..count).into_par_iter().map(|k| ray(self.kind, self.target, first + k)).collect();
            let cast = Rays { contours: self.contours, ..Rays::new(&self.set.octree, 0, &rays) };
            let hits: Vec<Hit> =
                rays.par_iter().map(|ray| cast_ray(&self.set.octree, cast.root, ray, self.contours)).collect();
            judge(&mut cell, self.oracle, &rays, &hits, |k| case(first + k as u64));
            for engine in &mut *engines {
                let wanted = if engine.is_gpu { counts.gpu_rays } else { counts.rays };
                let some = wanted.saturating_sub(from).min(count) as usize;
                if some > 0 {
                    let cast = Rays { rays: &rays[..some], ..cast };
                    engine.rays(self.oracle, cast, &hits[..some], |k| case(first + k as u64));
                }
            }
            from += count;
        }
        cell
    }
}

/// Adds the judgement of hits of the reference caster to a cell.
pub(super) fn judge(
    cell: &mut Cell,
    oracle: &Oracle<'_>,
    rays: &[Ray],
    hits: &[Hit],
    case: impl Fn(usize) -> String + Sync,
) {
    let contours = cell.contours;
    let judged: Vec<_> = rays.par_iter().zip(hits).map(|(ray, hit)| oracle.judge(ray, contours, hit)).collect();
    for (k, (judged, hit)) in judged.into_iter().zip(hits).enumerate() {
        cell.cases += 1;
        cell.hits += u64::from(!hit.is_miss());
        cell.iterations = cell.iterations.max(hit.iterations.into());
        match judged {
            Ok(right) => {
                if right.error > cell.worst {
                    cell.worst = right.error;
                    if cell.failures == 0 {
                        cell.worst_case = Some(case(k));
                    }
                }
            }
            Err(mistake) => {
                if cell.failures == 0 {
                    cell.worst_case = Some(case(k));
                    cell.failure = Some(mistake.to_string());
                }
                cell.failures += 1;
            }
        }
    }
}

/// Casts rays, and their images through the images of the octree.
fn symmetries(set: &DataSet, oracle: &Oracle<'_>, target: &Target, seed: u64, count: u64) -> SymmetryRow {
    let mut row = SymmetryRow { set: set.name.into(), ..SymmetryRow::default() };
    let root = set.octree.objects()[0].root_slot as u32;
    for (symmetry, turned) in Symmetry::SOME.iter().zip(&set.turned) {
        let image_oracle = Oracle::new(turned, 0);
        let image_root = turned.objects()[0].root_slot as u32;
        let found: Vec<_> = (0..count)
            .into_par_iter()
            .filter_map(|k| {
                let kind = Kind::ALL[(k % 10) as usize];
                let ray = ray(kind, target, seed + k / 10);
                let image = image(symmetry, &ray)?;
                let hit = cast_ray(&set.octree, root, &ray, false);
                let image_hit = cast_ray(turned, image_root, &image, false);
                let judged = (oracle.judge(&ray, false, &hit), image_oracle.judge(&image, false, &image_hit));
                let (Ok(right), Ok(image_right)) = judged else { return Some((false, true)) };
                let middle = |cube: ([f64; 3], f64)| (cube.0.map(|x| x + cube.1 * 0.5), cube.1);
                let expected = right.cube.map(middle).map(|(middle, edge)| (symmetry.turn_point(middle), edge));
                Some((expected != image_right.cube.map(middle), false))
            })
            .collect();
        row.cases += found.len() as u64;
        row.ties += found.iter().filter(|(other, _)| *other).count() as u64;
        row.failures += found.iter().filter(|(_, wrong)| *wrong).count() as u64;
    }
    row
}

/// The image of a ray, if single precision has its origin.
fn image(symmetry: &Symmetry, ray: &Ray) -> Option<Ray> {
    if !ray.is_finite() {
        return None;
    }
    let single = |vector: [f64; 3]| Vec3::from(vector.map(|x| x as f32));
    let origin = single(symmetry.turn_point(ray.origin.to_array().map(f64::from)));
    // The image of the image is the ray's only if nothing was rounded: mirroring is its own inverse along each axis.
    let exact = (0..3).all(|axis| {
        let from = f64::from(ray.origin[symmetry.axes[axis]]);
        let expected = if symmetry.mirrored >> axis & 1 != 0 { 3.0 - from } else { from };
        f64::from(origin[axis]) == expected
    });
    exact.then(|| Ray { origin, direction: single(symmetry.turn(ray.direction.to_array().map(f64::from))), ..*ray })
}

/// Rays from within a sphere of cubes.
fn closed(seed: u64, count: u64) -> Result<Leaks, BenchError> {
    let octree = sphere(7).map_err(|error| BenchError::scene("sphere", error.to_string()))?;
    let root = octree.objects()[0].root_slot as u32;
    let target = Target::of(&octree, 10 * TARGETS);
    let leak = |k: &u64| cast_ray(&octree, root, &leaks(&target, seed + k), false).is_miss();
    Ok(Leaks { cases: count, misses: (0..count).into_par_iter().filter(leak).count() as u64 })
}
