//! Measures GPU kernels against each other: how many rays per second each casts at octrees of scenes, and whether each finds
//! what the processor finds.
//!
//! ```text
//! git show 357f175:backends/core/kernels/cast.wgsl > old.wgsl
//! cargo run --release -p esvo-engines --features wgpu,ash --example kernels -- \
//!     [--engines wgpu,ash] [--rounds N] [--size 1024x768] [--experiments | --only NAME,NAME] \
//!     old=old.wgsl sibenik=sibenik.esvo ...
//! ```
//!
//! Measured are the kernel that is built in, as the engines use it on this device, the [`EXPERIMENTS`] with `--experiments` or those of
//! them that `--only` names, and each `NAME=FILE.wgsl`: a kernel without its prelude, with the octree in buffers. `SCENE=FILE.esvo` is a scene of the built-in manifest and an octree of it. Every viewpoint of the manifest is cast with contours, with contours and
//! beam, and with cubes; rays end at voxels of one pixel. All kernels of all engines cast each view in turn in every round. Printed
//! is a table of million rays per second over all viewpoints, by the least time of each view in the rounds: by the device's own clock, or of
//! processor time where the device is a driver that runs on the processor, so that other work on the machine does not count. With the
//! beam, the share of the coarse pass is in brackets.

mod measuring;

use std::sync::Arc;

use esvo_core::gpu::kernel::{CAST_WGSL, GpuOptions};
use esvo_core::gpu::slots::SlotsIn;
use esvo_core::{Caster, DeviceKind, Hit, View};
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::Octree;

use self::measuring::{Error, MODES, processor_time, views};

/// A kernel to be measured.
struct Kernel {
    name: String,
    options: GpuOptions,
    wide_beam: bool,
}

/// An engine with a kernel.
struct Column {
    name: String,
    caster: Box<dyn Caster>,
    wide_beam: bool,
}

/// What was tried: name, where the octree is, workgroup, and text to be replaced in the kernel.
type Experiment = (&'static str, Option<SlotsIn>, Option<(u32, u32)>, &'static [(&'static str, &'static str)]);

/// Sizes of subgroups that are tried where the engine and the driver allow it.
const SUBGROUP_SIZES: [u32; 5] = [4, 8, 16, 32, 64];

/// Other ways to run the kernel than the built-in one.
const EXPERIMENTS: &[Experiment] = &[
    ("buffers", Some(SlotsIn::Buffers), None, &[]),
    ("texture", Some(SlotsIn::Texture), None, &[]),
    ("8x4", None, Some((8, 4)), &[]),
    ("16x8", None, Some((16, 8)), &[]),
    ("16x16", None, Some((16, 16)), &[]),
    (
        "rows",
        None,
        None,
        &[(
            "    return group.xy * vec2<u32>(WIDTH, HEIGHT) + vec2<u32>(x, y);",
            "    return group.xy * vec2<u32>(WIDTH, HEIGHT) + vec2<u32>(local % WIDTH, local / WIDTH);",
        )],
    ),
    (
        "persistent",
        None,
        None,
        &[(
            "fn timing_pass(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = place(group, local);
    let y = at.y + view.first_row;
    if at.x < view.width && y < view.height {
        depths[at.y * view.width + at.x] = cast_pixel(at.x, y).raw_t;
    }
}",
            // 128 of the groups do the work of all.
            "fn timing_pass(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    for (var tile = group.y * groups.x + group.x; tile < groups.x * groups.y; tile += 128u) {
        if group.y * groups.x + group.x >= 128u {
            return;
        }
        let at = place(vec3<u32>(tile % groups.x, tile / groups.x, 0u), local);
        let y = at.y + view.first_row;
        if at.x < view.width && y < view.height {
            depths[at.y * view.width + at.x] = cast_pixel(at.x, y).raw_t;
        }
    }
}",
        )],
    ),
    (
        "shared stack",
        None,
        None,
        &[
            (
                "fn cast_ray(ray: Ray) -> Hit {",
                "var<private> lane: u32;
var<workgroup> shared_parent: array<array<u32, 64>, LEVELS>;
var<workgroup> shared_t_max: array<array<f32, 64>, LEVELS>;
fn cast_ray(ray: Ray) -> Hit {",
            ),
            ("    var stack_parent: array<u32, LEVELS>;\n", ""),
            ("    var stack_t_max: array<f32, LEVELS>;\n", ""),
            ("stack_parent[scale - LOWEST_SCALE]", "shared_parent[scale - LOWEST_SCALE][lane]"),
            ("stack_t_max[scale - LOWEST_SCALE]", "shared_t_max[scale - LOWEST_SCALE][lane]"),
            ("    let at = place(group, local);\n", "    lane = local;\n    let at = place(group, local);\n"),
        ],
    ),
    (
        "read twice",
        None,
        None,
        &[
            ("    var descriptor = vec2<u32>(0u);", "    var descriptor = slot_at(parent);"),
            (
                "        if stale {\n            descriptor = slot_at(parent);\n            stale = false;\n        }\n",
                "",
            ),
            ("                stale = true;\n", "                descriptor = slot_at(parent);\n"),
            ("            stale = true;\n", "            descriptor = slot_at(parent);\n"),
        ],
    ),
    (
        // As the paper does it. Rounding can make a ray POP to a frame that was not written.
        "few pushes",
        None,
        None,
        &[
            (
                "                stack_parent[scale - LOWEST_SCALE] = parent;
                stack_t_max[scale - LOWEST_SCALE] = t_max;
",
                "                if tc_max < h {
                    stack_parent[scale - LOWEST_SCALE] = parent;
                    stack_t_max[scale - LOWEST_SCALE] = t_max;
                }
                h = tc_max;
",
            ),
            ("    var scale = MAX_SCALE - 1u;\n", "    var scale = MAX_SCALE - 1u;\n    var h = t_max;\n"),
            (
                "            idx = axes((path & vec3<u32>(1u)) != vec3<u32>(0u));\n",
                "            idx = axes((path & vec3<u32>(1u)) != vec3<u32>(0u));\n            h = 0.0;\n",
            ),
        ],
    ),
    (
        "one stack for cubes",
        None,
        None,
        &[
            (
                "                stack_t_max[scale - LOWEST_SCALE] = t_max;",
                "                if CONTOURS { stack_t_max[scale - LOWEST_SCALE] = t_max; }",
            ),
            (
                "            t_max = stack_t_max[scale - LOWEST_SCALE];",
                "            if CONTOURS { t_max = stack_t_max[scale - LOWEST_SCALE]; }",
            ),
            (
                "            idx = axes((path & vec3<u32>(1u)) != vec3<u32>(0u));",
                // Without contours, that of an ancestor is where the ray leaves it.
                "            idx = axes((path & vec3<u32>(1u)) != vec3<u32>(0u));
            if !CONTOURS {
                let corner = bitcast<vec3<f32>>(path >> vec3<u32>(1u) << vec3<u32>(scale + 1u));
                t_max = min(ray.t_max, least(mad3(corner, coef, -bias)));
            }",
            ),
        ],
    ),
    (
        // Before the corners of its 16 x 16 blocks, a workgroup casts those of blocks four times as wide, and starts there. Workgroups
        // overlap: a quarter more rays.
        "two-level beam",
        None,
        Some((16, 16)),
        &[
            (
                "@compute @workgroup_size(WIDTH * HEIGHT)
fn coarse_pass(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = place(group, local);
    if at.x >= coarse_columns() || at.y >= coarse_rows() {
        return;
    }
    let corner = (vec2<f32>(at) - vec2<f32>(1.0)) * f32(BEAM_BLOCK);
    var ray: Ray;
    ray.root = view.root;
    ray.origin = view.origin;
    ray.direction = direction_through(corner.x, corner.y);
    ray.t_min = view.t_near;
",
                "var<workgroup> wide: array<f32, 64>;
fn coarse_start(corner: vec2<f32>, block: f32, t_min: f32) -> f32 {
    var ray: Ray;
    ray.root = view.root;
    ray.origin = view.origin;
    ray.direction = direction_through(corner.x, corner.y);
    ray.t_min = t_min;
    ray.t_max = bitcast<f32>(0x7f7fffffu);
    ray.size_per_t = view.pixel_size * (block * COARSE_VOXEL_BLOCKS);
    let hit = cast_ray(ray);
    if hit.voxel == MISS_VOXEL {
        return 1.0;
    }
    let size = bitcast<f32>(((hit.voxel >> 8u) + 104u) << 23u);
    return max(mad(size * -SQRT_3, view.t_per_depth, hit.raw_t), view.t_near);
}

@compute @workgroup_size(WIDTH * HEIGHT)
fn coarse_pass(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = f32(BEAM_BLOCK);
    if local < 64u {
        let corner = 4.0 * vec2<f32>(group.xy) + vec2<f32>(vec2<u32>(local % 8u, local / 8u)) - 2.0;
        wide[local] = coarse_start(corner * (4.0 * block), 4.0 * block, view.t_near);
    }
    workgroupBarrier();
    let at = place(group, local);
    if at.x >= coarse_columns() || at.y >= coarse_rows() {
        return;
    }
    let within = (at - 16u * group.xy + 3u) / 4u;
    var t_min = 1.0;
    for (var k = 0u; k < 16u; k++) {
        t_min = min(t_min, wide[(within.y + k / 4u) * 8u + within.x + k % 4u]);
    }
    coarse_out[at.y * coarse_columns() + at.x] = coarse_start((vec2<f32>(at) - 1.0) * block, block, t_min);
}
",
            ),
            (
                "    ray.t_max = bitcast<f32>(0x7f7fffffu);
    ray.size_per_t = view.pixel_size * (f32(BEAM_BLOCK) * COARSE_VOXEL_BLOCKS);
    let hit = cast_ray(ray);
    var start = 1.0;
    if hit.voxel != MISS_VOXEL {
        let size = bitcast<f32>(((hit.voxel >> 8u) + 104u) << 23u);
        start = max(mad(size * -SQRT_3, view.t_per_depth, hit.raw_t), view.t_near);
    }
    coarse_out[at.y * coarse_columns() + at.x] = start;
}
",
                "",
            ),
        ],
    ),
];

/// The built-in kernel and, with `--experiments`, the others; with `--only`, those of its names.
fn kernels(experiments: bool, only: Option<&str>) -> Result<Vec<Kernel>, Error> {
    let of = |name: &str, options| Kernel { name: name.to_owned(), options, wide_beam: false };
    let mut kernels = vec![of("built-in", GpuOptions::default())];
    if !experiments {
        return Ok(kernels);
    }
    if let Some(only) = only {
        let known = |name: &str| EXPERIMENTS.iter().any(|experiment| experiment.0 == name);
        if let Some(unknown) = only.split(',').find(|name| !known(name)) {
            return Err(format!("--only: no experiment is called {unknown:?}").into());
        }
    }
    let wanted = |name: &str| only.is_none_or(|only| only.split(',').any(|one| one == name));
    for (name, slots_in, workgroup, replaced) in EXPERIMENTS.iter().filter(|experiment| wanted(experiment.0)) {
        let mut text = CAST_WGSL.to_owned();
        for (from, to) in *replaced {
            if !text.contains(from) {
                return Err(format!("{name}: the kernel has no {from:?}").into());
            }
            text = text.replace(from, to);
        }
        let kernel = (!replaced.is_empty()).then_some(text);
        let (slots_in, workgroup) = (*slots_in, *workgroup);
        kernels.push(of(name, GpuOptions { kernel, slots_in, workgroup, ..GpuOptions::default() }));
    }
    if only.is_some() {
        return Ok(kernels);
    }
    for size in SUBGROUP_SIZES {
        let options = GpuOptions { subgroup_size: Some(size), ..GpuOptions::default() };
        kernels.push(of(&format!("subgroups of {size}"), options));
    }
    kernels.push(Kernel { wide_beam: true, ..of("beam 8x8", GpuOptions::default()) });
    Ok(kernels)
}

struct Arguments {
    engines: Vec<EngineId>,
    rounds: usize,
    size: (u32, u32),
    kernels: Vec<Kernel>,
    scenes: Vec<(String, Arc<Octree>)>,
}

impl Arguments {
    fn parse() -> Result<Self, Error> {
        let mut parsed = Self {
            engines: vec![EngineId::Wgpu, EngineId::Ash],
            rounds: 3,
            size: (1024, 768),
            kernels: Vec::new(),
            scenes: Vec::new(),
        };
        let (mut experiments, mut only) = (false, None);
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().ok_or_else(|| format!("{argument}: expected a value after it"));
            match argument.as_str() {
                "--engines" => parsed.engines = value()?.split(',').map(str::parse).collect::<Result<_, _>>()?,
                "--experiments" => experiments = true,
                "--only" => (experiments, only) = (true, Some(value()?)),
                "--rounds" => parsed.rounds = value()?.parse::<usize>()?.max(1),
                "--size" => {
                    let text = value()?;
                    let (width, height) = text.split_once('x').ok_or("--size: expected WIDTHxHEIGHT")?;
                    parsed.size = (width.parse()?, height.parse()?);
                }
                _ => match argument.split_once('=') {
                    Some((name, path)) if path.ends_with(".wgsl") => {
                        let text = std::fs::read_to_string(path).map_err(|e| format!("{path}: {e}"))?;
                        // Now a part of the prelude.
                        let kernel = Some(text.replace("const BEAM_BLOCK: u32 = 4u;\n", ""));
                        let slots_in = Some(SlotsIn::Buffers);
                        let options = GpuOptions { kernel, slots_in, ..GpuOptions::default() };
                        parsed.kernels.push(Kernel { name: name.to_owned(), options, wide_beam: false });
                    }
                    Some((scene, path)) => {
                        let octree = Octree::open(path.as_ref()).map_err(|e| format!("{path}: {e}"))?;
                        parsed.scenes.push((scene.to_owned(), Arc::new(octree)));
                    }
                    None => return Err(format!("{argument}: expected NAME=FILE.wgsl or SCENE=FILE.esvo").into()),
                },
            }
        }
        parsed.kernels.splice(0..0, kernels(experiments, only.as_deref())?);
        if parsed.scenes.is_empty() {
            return Err("expected at least one SCENE=OCTREE, e.g. sibenik=sibenik.esvo".into());
        }
        Ok(parsed)
    }
}

/// Seconds that casting a view takes, and those of them in the coarse pass.
fn seconds(caster: &mut dyn Caster, view: &View) -> Result<(f64, f64), Error> {
    let start = processor_time();
    let time = caster.time(view)?;
    let (total, coarse) = (time.total.as_secs_f64(), time.coarse.as_secs_f64());
    if caster.device().kind != DeviceKind::SoftwareGpu {
        return Ok((total, coarse));
    }
    let seconds = processor_time() - start;
    Ok((seconds, seconds * coarse / total))
}

/// Pixels in which a kernel finds something else than the processor.
fn differences(caster: &mut dyn Caster, views: &[View], expected: &[Vec<Hit>]) -> Result<usize, Error> {
    let mut hits = Vec::new();
    let mut different = 0;
    for (view, expected) in views.iter().zip(expected) {
        caster.cast(view, &mut hits)?;
        let same = |(a, b): (&Hit, &Hit)| a.raw_t.to_bits() == b.raw_t.to_bits() && a.same_voxel(b);
        different += hits.iter().zip(expected).filter(|pair| !same(*pair)).count();
    }
    Ok(different)
}

fn main() -> Result<(), Error> {
    let Arguments { engines, rounds, size, kernels, scenes } = Arguments::parse()?;
    let mut columns = Vec::new();
    for engine in engines {
        for (number, kernel) in kernels.iter().enumerate() {
            let gpu = kernel.options.clone();
            let opened = engine.open(&OpenOptions { gpu, ..OpenOptions::default() });
            if kernel.options.subgroup_size.is_some() && opened.is_err() {
                continue;
            }
            let caster = opened?;
            if number == 0 {
                println!("{engine} on {} ({})", caster.device().name, caster.device().detail);
            }
            columns.push(Column { name: format!("{engine}, {}", kernel.name), caster, wide_beam: kernel.wide_beam });
        }
    }
    let names: Vec<_> = columns.iter().map(|column| column.name.as_str()).collect();
    println!("\n| {} x {}: scene, mode, views | {} | differ |", size.0, size.1, names.join(" | "));
    println!("|---|{}--:|", "--:|".repeat(names.len()));
    for (scene, octree) in &scenes {
        let mut processor = EngineId::Cpu.open(&OpenOptions::default())?;
        processor.load(octree)?;
        for column in &mut columns {
            column.caster.load(octree)?;
        }
        for (mode, options) in MODES {
            let views = views(scene, octree, size, &options)?;
            let mut expected = vec![Vec::new(); views.len()];
            for (view, hits) in views.iter().zip(&mut expected) {
                processor.cast(view, hits)?;
            }
            let mut different = Vec::new();
            for column in &mut columns {
                let views: Vec<_> = views.iter().map(|view| view.with_wide_beam(column.wide_beam)).collect();
                different.push(differences(&mut *column.caster, &views, &expected)?.to_string());
            }
            let mut best = vec![vec![(f64::MAX, 0.0); views.len()]; columns.len()];
            for _ in 0..rounds {
                for (k, view) in views.iter().enumerate() {
                    for (column, best) in columns.iter_mut().zip(&mut best) {
                        let view = view.with_wide_beam(column.wide_beam);
                        let now = seconds(&mut *column.caster, &view)?;
                        if now.0 < best[k].0 {
                            best[k] = now;
                        }
                    }
                }
            }
            let rays = views.len() as f64 * f64::from(size.0 * size.1);
            let cell = |best: &Vec<(f64, f64)>| {
                let total: f64 = best.iter().map(|best| best.0).sum();
                let coarse: f64 = best.iter().map(|best| best.1).sum();
                let rate = rays / total / 1e6;
                if coarse > 0.0 { format!("{rate:.2} ({:.0} %)", 100.0 * coarse / total) } else { format!("{rate:.2}") }
            };
            let rates: Vec<_> = best.iter().map(cell).collect();
            println!("| {scene}, {mode}, {} | {} | {} |", views.len(), rates.join(" | "), different.join(" "));
        }
    }
    Ok(())
}
