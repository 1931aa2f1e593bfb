//! Measures GPU kernels that cast triangles against each other: how many rays per second each casts at the triangles of scenes, and
//! whether each finds what the exact caster finds.
//!
//! ```text
//! cargo run --release -p esvo-engines --features wgpu,ash --example triangle_kernels -- \
//!     [--engines wgpu,ash] [--rounds N] [--size 1024x768] [--experiments] [NAME=FILE.wgsl ...] sibenik conference ...
//! ```
//!
//! Measured are the kernel that is built in, as the engines use it on this device, the [`EXPERIMENTS`] with `--experiments`, and each
//! `NAME=FILE.wgsl`: a kernel without its prelude. A scene is one of the built-in manifest, and cast is its mesh as the benchmarks find
//! it, or its stand-in. All kernels cast each viewpoint of the manifest in turn in every round. Printed is a table of million rays per
//! second over all viewpoints, by the least time of each in the rounds: by the device's own clock, or of processor time where the device
//! is a driver that runs on the processor, so that other work on the machine does not count. Beside it, the rays of pictures that are not
//! the exact caster's, and those that single precision left to it.

mod measuring;

use esvo_builder::import::load_mesh;
use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::gpu::kernel::GpuOptions;
use esvo_core::gpu::slots::SlotsIn;
use esvo_core::gpu::triangles::{TRIANGLES_WGSL, TriangleCaster, TriangleRecord};
use esvo_core::{Camera, CastError, DeviceKind};
use esvo_cpu::triangles::TriangleScene;
use esvo_engines::{EngineId, OpenOptions};
use esvo_scenes::{CameraSpec, SceneManifest, SceneVariant, StandIn, locate_scene};
use glam::{DMat4, DVec4};

use self::measuring::{Error, processor_time};

/// A kernel to be measured.
struct Kernel {
    name: String,
    options: GpuOptions,
}

/// What was tried: name, where nodes and triangles are, workgroup, and text to be replaced in the kernel.
type Experiment = (&'static str, Option<SlotsIn>, Option<(u32, u32)>, &'static [(&'static str, &'static str)]);

/// Where the loop over nodes starts.
const LOOP: &str = "    loop {
        if (group.y & 0xff000000u) == 0u {
            if waiting == 0u {";
/// The triangles of a node.
const THESE: (&str, &str) = ("        var these = entered", "        these = entered");
/// Where the loop over the triangles of a node starts.
const TRIANGLES: &str = "        let first = node.first_triangle;
        while these != 0u {";

/// Other ways to run the kernel than the built-in one.
const EXPERIMENTS: &[Experiment] = &[
    ("buffers", Some(SlotsIn::Buffers), None, &[]),
    ("texture", Some(SlotsIn::Texture), None, &[]),
    ("8x4", None, Some((8, 4)), &[]),
    ("4x2", None, Some((4, 2)), &[]),
    ("16x8", None, Some((16, 8)), &[]),
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
        "node or triangle",
        None,
        None,
        &[
            (
                LOOP,
                "    var these = 0u;
    var first = 0u;
    loop {
        if these == 0u {
        if (group.y & 0xff000000u) == 0u {
            if waiting == 0u {",
            ),
            THESE,
            (
                TRIANGLES,
                "        first = node.first_triangle;
        } else {",
            ),
        ],
    ),
    (
        "node and triangle",
        None,
        None,
        &[
            (
                LOOP,
                "    var these = 0u;
    var first = 0u;
    loop {
        if these == 0u {
        if (group.y & 0xff000000u) == 0u {
            if waiting == 0u {",
            ),
            THESE,
            (
                TRIANGLES,
                "        first = node.first_triangle;
        }
        if these != 0u {",
            ),
        ],
    ),
    (
        "nodes, then triangles",
        None,
        None,
        &[
            (
                LOOP,
                "    loop {
        var these = 0u;
        var first = 0u;
        loop {
        if (group.y & 0xff000000u) == 0u {
            if waiting == 0u {",
            ),
            THESE,
            (
                TRIANGLES,
                "        first = node.first_triangle;
        if these != 0u { break; }
        }
        if these == 0u { break; }
        while these != 0u {",
            ),
        ],
    ),
    (
        "shared stack",
        None,
        None,
        &[
            (
                "fn cast_ray(ray: Ray, direction_error",
                "var<private> lane: u32;
var<workgroup> shared_stack: array<array<vec2<u32>, WIDTH * HEIGHT>, STACK>;
fn cast_ray(ray: Ray, direction_error",
            ),
            ("    var stack: array<vec2<u32>, STACK>;\n", ""),
            ("stack[waiting]", "shared_stack[waiting][lane]"),
            ("    let id = place(group, local);\n", "    lane = local;\n    let id = place(group, local);\n"),
        ],
    ),
    (
        "cull",
        None,
        None,
        &[
            // Where a ray enters the first node of a group is kept with it.
            ("fn enter_four(", "var<private> first_entry: f32;\nfn enter_four("),
            (
                "    let bits = select(",
                "    let inner_four = ((vec4<u32>(inner) >> bytes) & vec4<u32>(1u)) == vec4<u32>(1u);
    let entries = select(vec4<f32>(FARTHEST), enter, (enter <= leave) & inner_four);
    first_entry = min(first_entry, min(min(entries.x, entries.y), min(entries.z, entries.w)));
    let bits = select(",
            ),
            (
                "    var stack: array<vec2<u32>, STACK>;\n",
                "    var stack: array<vec3<u32>, STACK>;\n    var entry = 0.0;\n",
            ),
            (
                "            group = stack[waiting];\n",
                "            group = stack[waiting].xy;
            entry = bitcast<f32>(stack[waiting].z);
            if entry > limit {
                group.y = 0u;
                continue;
            }
",
            ),
            ("stack[waiting] = group;", "stack[waiting] = vec3<u32>(group, bitcast<u32>(entry));"),
            ("        let entered = enter(", "        first_entry = FARTHEST;\n        let entered = enter("),
            ("        var these = entered", "        entry = first_entry;\n        var these = entered"),
        ],
    ),
    (
        "four children",
        None,
        None,
        &[(
            "    let kinds = node.kinds;
    return enter_four(kinds.x, vec3<u32>(near_x.x, near_y.x, near_z.x), vec3<u32>(far_x.x, far_y.x, far_z.x), start, slack, step, from_s, limit, ray.octant)
        | enter_four(kinds.y, vec3<u32>(near_x.y, near_y.y, near_z.y), vec3<u32>(far_x.y, far_y.y, far_z.y), start, slack, step, from_s, limit, ray.octant);
",
            "    var bits = 0u;
    for (var half = 0u; half < 2u; half++) {
        let near = vec3<u32>(near_x[half], near_y[half], near_z[half]);
        let far = vec3<u32>(far_x[half], far_y[half], far_z[half]);
        bits |= enter_four(node.kinds[half], near, far, start, slack, step, from_s, limit, ray.octant);
    }
    return bits;
",
        )],
    ),
    (
        "kinds one by one",
        None,
        None,
        &[
            ("    let inner = ((kinds & (kinds << 1u)) >> 4u) & 0x01010101u;\n", ""),
            (
                "    let places = kinds ^ (inner * octant);\n",
                "    let kind = (vec4<u32>(kinds) >> bytes) & low;
    let inner = (kind & vec4<u32>(24u)) == vec4<u32>(24u);
",
            ),
            (
                "    let place = (vec4<u32>(places) >> bytes) & vec4<u32>(31u);\n",
                "    let place = (kind & vec4<u32>(31u)) ^ select(vec4<u32>(0u), vec4<u32>(octant), inner);\n",
            ),
            (
                "    let ones = (vec4<u32>(kinds) >> (bytes + vec4<u32>(5u))) & vec4<u32>(7u);\n",
                "    let ones = kind >> vec4<u32>(5u);\n",
            ),
        ],
    ),
];

/// The built-in kernel and, with `experiments`, the others.
fn kernels(experiments: bool) -> Result<Vec<Kernel>, Error> {
    let mut kernels = vec![Kernel { name: "built-in".into(), options: GpuOptions::default() }];
    for (name, slots_in, workgroup, replaced) in EXPERIMENTS.iter().filter(|_| experiments) {
        let mut text = TRIANGLES_WGSL.to_owned();
        for (from, to) in *replaced {
            if !text.contains(from) {
                return Err(format!("{name}: the kernel has no {from:?}").into());
            }
            text = text.replace(from, to);
        }
        let triangles_kernel = (!replaced.is_empty()).then_some(text);
        let (slots_in, workgroup) = (*slots_in, *workgroup);
        let options = GpuOptions { triangles_kernel, slots_in, workgroup, ..GpuOptions::default() };
        kernels.push(Kernel { name: (*name).into(), options });
    }
    Ok(kernels)
}

struct Arguments {
    engines: Vec<EngineId>,
    rounds: usize,
    size: (u32, u32),
    kernels: Vec<Kernel>,
    scenes: Vec<String>,
}

impl Arguments {
    fn parse() -> Result<Self, Error> {
        let mut parsed = Self {
            engines: vec![EngineId::Wgpu, EngineId::Ash],
            rounds: 3,
            size: (1024, 768),
            kernels: kernels(std::env::args().any(|argument| argument == "--experiments"))?,
            scenes: Vec::new(),
        };
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().ok_or_else(|| format!("{argument}: expected a value after it"));
            match argument.as_str() {
                "--engines" => parsed.engines = value()?.split(',').map(str::parse).collect::<Result<_, _>>()?,
                "--experiments" => {}
                "--rounds" => parsed.rounds = value()?.parse::<usize>()?.max(1),
                "--size" => {
                    let text = value()?;
                    let (width, height) = text.split_once('x').ok_or("--size: expected WIDTHxHEIGHT")?;
                    parsed.size = (width.parse()?, height.parse()?);
                }
                option if option.starts_with('-') => return Err(format!("unknown option {option}").into()),
                _ => match argument.split_once('=') {
                    Some((name, path)) => {
                        let text = std::fs::read_to_string(path).map_err(|e| format!("{path}: {e}"))?;
                        let options = GpuOptions { triangles_kernel: Some(text), ..GpuOptions::default() };
                        parsed.kernels.push(Kernel { name: name.to_owned(), options });
                    }
                    None => parsed.scenes.push(argument),
                },
            }
        }
        if parsed.scenes.is_empty() {
            return Err("expected at least one scene, e.g. sibenik".into());
        }
        Ok(parsed)
    }
}

/// The triangles of a scene of the built-in manifest, and the rays of its viewpoints.
fn scene(name: &str, size: (u32, u32)) -> Result<(TriangleScene, Vec<CameraRays>), Error> {
    let manifest = SceneManifest::builtin()?;
    let entry = manifest.scene(name).ok_or_else(|| format!("{name}: the manifest has no such scene"))?;
    let (mesh, specs): (_, &[CameraSpec]) = match locate_scene(entry, None)? {
        Some(found) => {
            let mut mesh = load_mesh(&found.path)?;
            if let Some(rows) = found.mesh.transform {
                let row = |i: usize| DVec4::from_array(rows[i]);
                mesh.transform(&DMat4::from_cols(row(0), row(1), row(2), DVec4::W).transpose());
            }
            (mesh, &found.mesh.cameras)
        }
        None => {
            let mesh = entry.stand_in.as_ref().and_then(StandIn::generate);
            let mesh = mesh.ok_or_else(|| format!("{name}: its mesh was not found, and it has no stand-in"))?;
            (mesh, entry.cameras(SceneVariant::StandIn))
        }
    };
    let corners = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect();
    let rays = |spec: &CameraSpec| {
        let &CameraSpec { eye, forward, up, fov_degrees, near, far, .. } = spec;
        CameraRays::new(&Camera { eye, forward, up, fov_degrees, near, far }, size)
    };
    Ok((TriangleScene::new(corners)?, specs.iter().map(rays).collect::<Result<_, CastError>>()?))
}

/// Seconds that casting a picture takes.
fn seconds(caster: &mut dyn TriangleCaster, rays: &CameraRays) -> Result<f64, Error> {
    if caster.device().kind != DeviceKind::SoftwareGpu {
        return Ok(caster.time(rays)?.as_secs_f64());
    }
    let start = processor_time();
    caster.time(rays)?;
    Ok(processor_time() - start)
}

/// Rays for which a kernel finds something else than the exact caster, and those that it leaves to it.
fn differences(
    caster: &mut dyn TriangleCaster,
    scene: &TriangleScene,
    views: &[CameraRays],
    expected: &[Vec<TriangleHit>],
) -> Result<(usize, usize), Error> {
    let mut records: Vec<TriangleRecord> = Vec::new();
    let (mut different, mut undecided) = (0, 0);
    for (rays, expected) in views.iter().zip(expected) {
        caster.cast(rays, &mut records)?;
        let found = scene.decide(rays, &records);
        undecided += found.undecided;
        let same = |(a, b): (&TriangleHit, &TriangleHit)| a.triangle == b.triangle && a.t.to_bits() == b.t.to_bits();
        different += found.hits.iter().zip(expected).filter(|pair| !same(*pair)).count();
    }
    Ok((different, undecided))
}

fn main() -> Result<(), Error> {
    let Arguments { engines, rounds, size, kernels, scenes } = Arguments::parse()?;
    let scenes = scenes.iter().map(|name| Ok((name, scene(name, size)?))).collect::<Result<Vec<_>, Error>>()?;
    for engine in engines {
        let mut casters = Vec::new();
        for kernel in &kernels {
            let gpu = kernel.options.clone();
            let caster = engine.open_triangles(&OpenOptions { gpu, ..OpenOptions::default() })?;
            casters.push(caster.ok_or_else(|| format!("{engine} is no engine of a GPU"))?);
        }
        let about = casters[0].device();
        println!("{engine} on {} ({}), {} x {}\n", about.name, about.detail, size.0, size.1);
        let names: Vec<_> = kernels.iter().map(|kernel| kernel.name.as_str()).collect();
        println!("| scene, views | {} | differ | undecided |", names.join(" | "));
        println!("|---|{}--:|--:|", "--:|".repeat(names.len()));
        for (name, (scene, views)) in &scenes {
            let wide = scene.wide();
            let expected: Vec<_> = views.iter().map(|rays| scene.cast_exact(rays)).collect();
            let (mut different, mut undecided) = (Vec::new(), Vec::new());
            for caster in &mut casters {
                caster.load(&wide)?;
                let (others, left) = differences(&mut **caster, scene, views, &expected)?;
                different.push(others.to_string());
                undecided.push(left.to_string());
            }
            let mut best = vec![vec![f64::MAX; views.len()]; casters.len()];
            for _ in 0..rounds {
                for (k, rays) in views.iter().enumerate() {
                    for (caster, best) in casters.iter_mut().zip(&mut best) {
                        best[k] = seconds(&mut **caster, rays)?.min(best[k]);
                    }
                }
            }
            let rays = views.len() as f64 * f64::from(size.0) * f64::from(size.1);
            let rates = best.iter().map(|best| format!("{:.2}", rays / best.iter().sum::<f64>() / 1e6));
            let rates: Vec<_> = rates.collect();
            // One number if all kernels leave the same rays.
            undecided.dedup();
            let (rates, different, undecided) = (rates.join(" | "), different.join(" "), undecided.join(" "));
            println!("| {name}, {} | {rates} | {different} | {undecided} |", views.len());
        }
        println!();
    }
    Ok(())
}
