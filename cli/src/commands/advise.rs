//! `esvo advise`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::scene::NamedView;
use esvo_bench::sweep_bench::advice::{Advice, Wish, advise};
use esvo_bench::sweep_bench::errors::ErrorMeasure;
use esvo_bench::sweep_bench::record::SceneSweep;
use esvo_bench::sweep_bench::{
    FileSweepOptions, SweepBenchOptions, SweepPlan, SweepReport, image_key, read_sweep_record, run_file_sweep,
    run_sweep_bench,
};
use esvo_core::Object;
use esvo_core::camera::viewpoint;
use esvo_engines::EngineId;
use esvo_format::Octree;

use crate::commands::bench::cache::CacheArguments;
use crate::commands::bench::selection::check_scenes_dir;
use crate::fail::{Failure, print};
use crate::files::{extension, open};
use crate::values::{engine, parse_bytes, parse_pixels, parse_positive, parse_size};
use crate::view::DEFAULT_FOV;

/// Rounds of a sweep that is made here.
const ROUNDS: usize = 3;

/// Pick the settings that keep an error at the least time, and say why.
#[derive(Debug, Args)]
#[command(after_help = "\
For a scene: levels, contours, beam, and the size of voxels at which rays end. For an octree file:
contours, beam and size. They come from the record of `esvo bench sweep`, or from a small sweep
made here, on this machine. Errors are measured against the scene's triangles; of a file without
--scene, against its own leaves. Of the settings that keep every limit, the fastest is picked, and
of those within 3 % of it the one with the fewest bytes. Exit code 1 if no setting keeps the
limits; the nearest is named.

Errors in pixels are those of pictures of the size that was measured: smaller pictures have larger
pixels.

Examples:
  esvo advise sibenik --max-error 2px --sweep results/machine/2026-11-26-sweep/report.json
  esvo advise sibenik.esvo --scene sibenik --max-error 2px --max-ms 20
  esvo advise conference --max-error 0.1 --measure flip --max-bytes 20M --json")]
pub(crate) struct AdviseArguments {
    /// An octree (.esvo), or the name of a scene
    what: PathBuf,
    /// Largest error: pixels along the ray, or FLIP
    #[arg(long, value_name = "PIXELS", allow_negative_numbers = true, value_parser = parse_pixels)]
    max_error: f64,
    /// Which error: that of the median ray, of the 90th or 99th percentile, of the worst ray, or FLIP of the picture
    #[arg(long, value_enum, default_value_t = Measure::P90)]
    measure: Measure,
    /// Most milliseconds per frame
    #[arg(long, value_name = "MS", value_parser = parse_positive)]
    max_ms: Option<f64>,
    /// Most bytes in memory: a number with K, M or G for 10^3, 10^6 or 10^9
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes)]
    max_bytes: Option<u64>,
    /// Take the figures from this record of `esvo bench sweep`
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scene", "levels", "size", "views", "threads", "cache", "no_cache"])]
    sweep: Option<PathBuf>,
    /// The engine
    #[arg(long, value_parser = engine(), default_value_t = EngineId::Cpu)]
    engine: EngineId,
    /// The scene that an octree file was built from: its triangles and viewpoints are used
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    /// Levels to try for a scene
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=23))]
    levels: Vec<u32>,
    /// Size of the pictures [default: 512x384]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Viewpoints, at most [default: 2]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    views: Option<u16>,
    /// Threads of the CPU caster
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    threads: Option<u16>,
    /// Folder that is searched first for real meshes; then $ESVO_SCENES, then ../shared/scenes
    #[arg(long, value_name = "FOLDER")]
    scenes_dir: Option<PathBuf>,
    /// Read the scenes from this manifest of your own instead of the paper's: see scenes/README.md
    #[arg(long, value_name = "FILE", conflicts_with = "scenes_dir")]
    manifest: Option<PathBuf>,
    #[command(flatten)]
    cache: CacheArguments,
    /// Print the advice as JSON
    #[arg(long)]
    json: bool,
}

/// Which error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Measure {
    /// Half of the rays are at most so far off
    Median,
    /// 90 % of the rays are at most so far off
    P90,
    /// 99 % of the rays are at most so far off
    P99,
    /// No ray is farther off
    Max,
    /// Mean FLIP of the picture, 0 to 1
    Flip,
}

impl Measure {
    fn measure(self) -> ErrorMeasure {
        match self {
            Self::Median => ErrorMeasure::Median,
            Self::P90 => ErrorMeasure::P90,
            Self::P99 => ErrorMeasure::P99,
            Self::Max => ErrorMeasure::Max,
            Self::Flip => ErrorMeasure::Flip,
        }
    }
}

pub(crate) fn run_advise(arguments: &AdviseArguments) -> Result<(), Failure> {
    check_scenes_dir(arguments.scenes_dir.as_deref())?;
    let wish = Wish {
        measure: arguments.measure.measure(),
        max_error: arguments.max_error,
        max_ms: arguments.max_ms,
        max_bytes: arguments.max_bytes,
    };
    let octree = if extension(&arguments.what) == "esvo" {
        if !arguments.levels.is_empty() {
            return Err("--levels: a file has the levels that it has; give the name of a scene".to_owned().into());
        }
        Some(Arc::new(open(&arguments.what, true)?))
    } else {
        if arguments.scene.is_some() {
            return Err("--scene: is for octree files".to_owned().into());
        }
        None
    };
    let (report, scene, index) = match (&arguments.sweep, &octree) {
        (Some(file), octree) => recorded(arguments, file, octree.as_deref())?,
        (None, Some(octree)) => (sweep_file(arguments, octree)?, 0, None),
        (None, None) => (sweep_scene(arguments)?, 0, None),
    };
    if !report.passed() {
        return Err(format!("the hits of {} settings are wrong", report.failures().count()).into());
    }
    let scene = &report.scenes[scene];
    let advice = advise(&report, scene, index, arguments.engine, &wish)
        .ok_or_else(|| format!("{}: no setting of {} was timed", scene.name, arguments.engine))?;
    let text = if arguments.json { esvo_bench::output::to_json(&advice) } else { words(&advice, octree.is_some()) };
    print(&text)?;
    if advice.reached { Ok(()) } else { Err(format!("{}: no setting keeps the limits", advice.scene).into()) }
}

/// The record, and in it the scene by its index and, for a file, the octree of the same content.
fn recorded(
    arguments: &AdviseArguments,
    file: &Path,
    octree: Option<&Octree>,
) -> Result<(SweepReport, usize, Option<usize>), Failure> {
    let report = read_sweep_record(file)?;
    let what = arguments.what.display();
    let Some(octree) = octree else {
        let named = |scene: &SceneSweep| scene.name.eq_ignore_ascii_case(&what.to_string());
        let Some(scene) = report.scenes.iter().position(named) else {
            let names: Vec<_> = report.scenes.iter().map(|scene| scene.name.to_ascii_lowercase()).collect();
            return Err(format!("{}: has no scene {what}; it has {}", file.display(), names.join(", ")).into());
        };
        return Ok((report, scene, None));
    };
    let key = image_key(octree);
    let same = |scene: &SceneSweep| scene.octrees.iter().position(|row| row.image_sha256 == key);
    let found = report.scenes.iter().enumerate().find_map(|(scene, sweep)| Some((scene, same(sweep)?)));
    let Some((scene, index)) = found else {
        let help = "leave out --sweep to measure it here";
        return Err(format!("{}: has no octree of the content of {what}; {help}", file.display()).into());
    };
    Ok((report, scene, Some(index)))
}

/// The plan of a sweep made here.
fn plan(arguments: &AdviseArguments) -> Result<SweepPlan, Failure> {
    let mut plan = SweepPlan::default_run();
    plan.name = "advise".into();
    plan.engines = vec![arguments.engine];
    plan.rounds = ROUNDS;
    plan.size = arguments.size.unwrap_or(plan.size);
    plan.views = arguments.views.map_or(plan.views, Into::into);
    plan.validate()?;
    Ok(plan)
}

fn sweep_scene(arguments: &AdviseArguments) -> Result<SweepReport, Failure> {
    let mut plan = plan(arguments)?;
    plan.select_scenes(&[arguments.what.display().to_string()]);
    if !arguments.levels.is_empty() {
        plan.set_levels(&arguments.levels);
    }
    let options = SweepBenchOptions {
        views: Vec::new(),
        plan,
        scenes_dir: arguments.scenes_dir.clone(),
        manifest: arguments.manifest.clone(),
        threads: arguments.threads.map(Into::into),
        all_on_software: true,
        cache: arguments.cache.open(),
    };
    let progress = Progress::terminal();
    let report = run_sweep_bench(&options, &progress);
    progress.finish();
    Ok(report?)
}

fn sweep_file(arguments: &AdviseArguments, octree: &Arc<Octree>) -> Result<SweepReport, Failure> {
    let plan = plan(arguments)?;
    let [width, height] = plan.size.map(f64::from);
    let camera = viewpoint::overview_of(&Object::all(octree)[..1], [0.0, 1.0, 0.0], DEFAULT_FOV, width / height);
    let options = FileSweepOptions {
        name: arguments.what.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        plan,
        scene: arguments.scene.clone(),
        views: vec![NamedView { name: "overview".into(), camera }],
        scenes_dir: arguments.scenes_dir.clone(),
        manifest: arguments.manifest.clone(),
        threads: arguments.threads.map(Into::into),
        cache: arguments.cache.open(),
    };
    let progress = Progress::terminal();
    let report = run_file_sweep(octree, &options, &progress);
    progress.finish();
    Ok(report?)
}

/// The advice for people; `is_file`: the levels are given.
fn words(advice: &Advice, is_file: bool) -> String {
    let setting = &advice.setting;
    let [width, height] = advice.size;
    let wish = &advice.wish;
    let mut limits = vec![format!("{} at most {}", wish.measure.title(), wish.measure.show(wish.max_error))];
    limits.extend(wish.max_ms.map(|ms| format!("at most {ms} ms")));
    limits.extend(wish.max_bytes.map(|bytes| format!("at most {:.1} MB", bytes as f64 / 1e6)));
    let kind = if setting.contours { "with contours" } else { "without contours" };
    let beam = if setting.beam { "--beam " } else { "" };
    let cubes = if setting.contours { "" } else { "--no-contours " };
    let head = if advice.reached { "Use" } else { "Nearest" };
    let mut out = format!("{} on {}, {width}x{height}: {}\n", advice.scene, advice.engine, limits.join(", "));
    out += &format!(
        "{head}: {} levels {kind}, {} the beam, rays end at voxels of {} px\n",
        setting.levels,
        if setting.beam { "with" } else { "without" },
        setting.max_voxel_pixels
    );
    out += &format!(
        "  error {}, {:.2} ms per frame, {:.1} MB in memory, {:.1} MB on disk\n",
        wish.measure.show(setting.error),
        setting.ms,
        setting.memory_bytes as f64 / 1e6,
        setting.disk_bytes as f64 / 1e6
    );
    if !is_file {
        let off = if setting.contours { "" } else { " --no-contours" };
        let scene = advice.scene.split(':').next().unwrap_or_default().to_ascii_lowercase();
        out += &format!("  esvo build --scene {scene} --levels {}{off} -o FILE.esvo\n", setting.levels);
    }
    out += &format!("  esvo render FILE.esvo {beam}{cubes}--max-voxel-pixels {} ...\n", setting.max_voxel_pixels);
    out += "Why:\n";
    for line in &advice.why {
        out += &format!("- {line}\n");
    }
    out
}
