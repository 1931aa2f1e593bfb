//! `esvo bench --full`.

use clap::ValueEnum;
use esvo_bench::Progress;
use esvo_bench::full_bench::{FullOptions, run_full_bench};
use esvo_bench::needs_bench::NeedsBenchOptions;
use esvo_bench::paper_bench::PaperBenchOptions;
use esvo_bench::ray_bench::RayBenchOptions;
use esvo_bench::scene::manifest;
use esvo_bench::stability_bench::StabilityOptions;
use esvo_bench::sweep_bench::{Cache, SweepBenchOptions, SweepPlan};
use esvo_bench::voxel_bench::{MAX_LEVEL, VoxelBenchOptions};
use esvo_engines::{EngineId, OpenOptions};

use crate::commands::bench::tables::TablesArguments;
use crate::fail::{Failure, print};

/// A report of a full run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FullKind {
    /// Hard rays, octrees and meshes: 12 million rays for each instruction set, 1.2 million for each GPU engine
    Stability,
    /// The paper's tables
    Tables,
    /// Error against run time
    Sweep,
    /// What code costs that a scene does not need
    Needs,
    /// Lists of rays at three scenes
    Rays,
    /// Voxelization on a GPU by each method; left out where there is none
    Voxelize,
}

/// Scenes whose lists of rays are measured.
const RAY_SCENES: [&str; 3] = ["sibenik", "conference", "hairball"];

/// Makes the reports that are asked for. What the options say of scenes, levels, views, rounds, sizes, engines, threads and memory
/// applies to all that have such.
pub(crate) fn run_bench_full(tables: PaperBenchOptions, arguments: &TablesArguments) -> Result<(), Failure> {
    let selection = &arguments.selection;
    if selection.manifest.is_some() {
        return Err("--manifest: --full makes reports of the paper's scenes; expected no --full".to_string().into());
    }
    if selection.json {
        return Err("--json: --full writes a record of each report; expected no --json".to_string().into());
    }
    let wanted = |kind| arguments.reports.is_empty() || arguments.reports.contains(&kind);
    let (scenes_dir, threads) = (tables.scenes_dir.clone(), tables.threads);
    let engines =
        |all: &[EngineId]| if arguments.backends.is_empty() { all.to_vec() } else { arguments.backends.clone() };
    let sizes = &arguments.resolutions;

    // Only the tables displace meshes.
    let manifest = manifest(None)?;
    let displaced = |name: &String| manifest.scene(name).is_some_and(|scene| scene.displaced);
    let scenes: Vec<String> = selection.scenes.iter().filter(|name| !displaced(name)).cloned().collect();
    let only_displaced = scenes.is_empty() && !selection.scenes.is_empty();
    // Those that have no scenes of their own, or take any.
    let of_all = |kind| matches!(kind, FullKind::Stability | FullKind::Tables);
    let wanted = |kind| wanted(kind) && (!only_displaced || of_all(kind));

    let mut plan = SweepPlan::full_run();
    if !scenes.is_empty() {
        plan.select_scenes(&scenes);
    }
    if !selection.levels.is_empty() {
        plan.set_levels(&selection.levels);
    }
    plan.engines = engines(&plan.engines);
    plan.views = arguments.views.unwrap_or(plan.views);
    plan.rounds = arguments.rounds.unwrap_or(plan.rounds);
    plan.size = sizes.first().copied().unwrap_or(plan.size);
    plan.memory_gb = tables.matrix.memory_gb;
    plan.validate()?;

    let mut needs = NeedsBenchOptions {
        scenes: scenes.clone(),
        levels: if selection.levels.is_empty() { vec![7, 9] } else { selection.levels.clone() },
        views: arguments.views.unwrap_or(2),
        rounds: arguments.rounds.unwrap_or(3),
        engines: engines(&[EngineId::Cpu, EngineId::Wgpu, EngineId::Ash]),
        threads,
        scenes_dir: scenes_dir.clone(),
        ..NeedsBenchOptions::default()
    };
    // The reference has all code, whatever it is told; an engine without a device fails the report.
    let opens = |engine: &EngineId| engine.open(&OpenOptions::default()).is_ok();
    needs.engines.retain(|engine| *engine != EngineId::Reference && opens(engine));
    needs.size = sizes.first().copied().unwrap_or(needs.size);
    let mut stability = StabilityOptions { rays: 12_000_000, gpu_rays: 1_200_000, ..StabilityOptions::default() };
    stability.engines = engines(&stability.engines);
    let ray_options = |scene: &String| {
        let all = RayBenchOptions::default();
        RayBenchOptions {
            scene: scene.clone(),
            levels: selection.levels.last().copied().unwrap_or(all.levels),
            size: sizes.first().copied().unwrap_or(all.size),
            engines: engines(&all.engines),
            // With a number of rounds, no longer than it takes.
            seconds: if arguments.rounds.is_some() { 0.0 } else { all.seconds },
            threads,
            scenes_dir: scenes_dir.clone(),
            ..all
        }
    };
    let mut voxelize = VoxelBenchOptions {
        rounds: arguments.rounds.map_or(3, |rounds| u32::try_from(rounds).unwrap_or(u32::MAX)),
        time_limit_seconds: selection.time_limit(),
        scenes_dir: scenes_dir.clone(),
        ..VoxelBenchOptions::default()
    };
    if !scenes.is_empty() {
        voxelize.select_scenes(&scenes);
    }
    if !selection.levels.is_empty() {
        // A grid has as many voxels along its edge as an octree of this level.
        let levels: Vec<u32> = selection.levels.iter().copied().filter(|level| *level <= MAX_LEVEL).collect();
        if levels.is_empty() && arguments.reports.contains(&FullKind::Voxelize) {
            let what = format!("--levels: grids of voxelize have levels 1 to {MAX_LEVEL}; expected one of these");
            return Err(what.into());
        }
        voxelize.set_levels(&levels);
    }
    let voxelizes = wanted(FullKind::Voxelize) && voxelize.scenes.iter().any(|scene| !scene.levels.is_empty());
    let ray_scenes = if scenes.is_empty() { RAY_SCENES.map(String::from).to_vec() } else { scenes };

    let options = FullOptions {
        stability: wanted(FullKind::Stability).then_some(stability),
        sweep: wanted(FullKind::Sweep).then(|| SweepBenchOptions {
            plan,
            scenes_dir: scenes_dir.clone(),
            manifest: None,
            threads,
            all_on_software: false,
            cache: Cache::in_folder(&Cache::default_folder()),
            views: Vec::new(),
        }),
        needs: wanted(FullKind::Needs).then_some(needs),
        rays: if wanted(FullKind::Rays) { ray_scenes.iter().map(ray_options).collect() } else { Vec::new() },
        voxelize: voxelizes.then_some(voxelize),
        tables: wanted(FullKind::Tables).then_some(tables),
        results: arguments.out.clone(),
        machine: arguments.machine.clone(),
        resume: arguments.resume,
    };
    let progress = Progress::terminal();
    let report = run_full_bench(&options, &progress);
    progress.finish();
    let report = report?;
    let printed = print(&format!("{}\nWritten to {}\n", report.table().to_text(), report.folder.display()));
    if report.passed() {
        return printed;
    }
    let what = match report.failed.first().or(report.left_out.first().filter(|_| report.parts.is_empty())) {
        Some((command, why)) => format!("{command}: {why}"),
        None => "answers of an engine are wrong".into(),
    };
    Err(format!("{what}; see {}", report.folder.join("run.md").display()).into())
}
