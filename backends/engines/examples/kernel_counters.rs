//! Counts what GPU kernels do per ray, in runs of their own that measure no time.
//!
//! ```text
//! cargo run --release -p esvo-engines --features wgpu,ash --example kernel_counters -- \
//!     [--engines wgpu,ash] [--size 1024x768] sibenik=sibenik.esvo ...
//! ```
//!
//! `SCENE=FILE.esvo` is a scene of the built-in manifest and an octree of it. Every viewpoint of the manifest is cast with contours,
//! with contours and beam, and with cubes; rays end at voxels of one pixel. For each count there is a kernel of its own, which
//! stores the count where others store the iterations. Printed is a table of means per ray, without the coarse pass, and of lanes in
//! use: a subgroup goes on until the last of its rays has ended, so that its lanes are in use for the mean of their visits over the
//! greatest. Subgroups are taken to be 8, 32 and 64 invocations that follow each other in the kernel's order: blocks of 4x2, 8x4 and
//! 8x8 pixels. Lanes that wait at a branch count as in use. Exit code 1 if the counts do not go together: each visit is a hit, a PUSH
//! or an ADVANCE.

mod measuring;

use std::process::ExitCode;
use std::sync::Arc;

use esvo_core::Hit;
use esvo_core::gpu::kernel::{CAST_WGSL, GpuOptions};
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::Octree;

use self::measuring::{Error, MODES, views};

/// What is counted, and the text of the kernel in front of which it is.
const COUNTS: [(&str, &str); 7] = [
    ("visits", "        // 9\n"),
    ("pushes", "                // 19-25: PUSH\n"),
    ("advances", "        // 28-30: ADVANCE\n"),
    ("pops", "            // 32-37: POP\n"),
    ("contour tests", "                    let span = project_contour("),
    ("descriptors", "            descriptor = slot_at(parent);\n"),
    ("far pointers", "                        first = slot_at(parent + first).x;\n"),
];

/// The kernel that counts what stands before this text.
fn counting(before: &str) -> Result<String, Error> {
    let mut text = CAST_WGSL.to_owned();
    let changes = [
        (before.to_owned(), format!("counted += 1u;\n{before}")),
        (
            "    var scale = MAX_SCALE - 1u;\n".to_owned(),
            "    var scale = MAX_SCALE - 1u;\n    var counted = 0u;\n".to_owned(),
        ),
        ("(scale << 8u), iteration)".to_owned(), "(scale << 8u), counted)".to_owned()),
        ("return miss(iteration)".to_owned(), "return miss(counted)".to_owned()),
    ];
    for (from, to) in changes {
        if !text.contains(&from) {
            return Err(format!("the kernel has no {from:?}").into());
        }
        text = text.replace(&from, &to);
    }
    Ok(text)
}

/// Width and height in pixels of the subgroups whose lanes are counted.
const SUBGROUPS: [(usize, usize); 3] = [(4, 2), (8, 4), (8, 8)];

/// Visits of all lanes of the subgroups of a picture, and those of lanes that had all gone on until the last ended.
fn lanes(hits: &[Hit], size: (u32, u32), (width, height): (usize, usize)) -> (u64, u64) {
    let columns = size.0 as usize;
    let across = columns.div_ceil(width);
    let mut groups = vec![(0u64, 0u64); across * (size.1 as usize).div_ceil(height)];
    for (at, hit) in hits.iter().enumerate() {
        let (x, y) = (at % columns, at / columns);
        let (sum, most) = &mut groups[y / height * across + x / width];
        *sum += u64::from(hit.iterations);
        *most = u64::from(hit.iterations).max(*most);
    }
    let lanes = (width * height) as u64;
    groups.iter().fold((0, 0), |(used, all), (sum, most)| (used + sum, all + most * lanes))
}

fn main() -> Result<ExitCode, Error> {
    let mut engines = vec![EngineId::Wgpu, EngineId::Ash];
    let mut size = (1024, 768);
    let mut scenes = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| format!("{argument}: expected a value after it"));
        match argument.as_str() {
            "--engines" => engines = value()?.split(',').map(str::parse).collect::<Result<_, _>>()?,
            "--size" => {
                let text = value()?;
                let (width, height) = text.split_once('x').ok_or("--size: expected WIDTHxHEIGHT")?;
                size = (width.parse()?, height.parse()?);
            }
            _ => {
                let (scene, path) = argument.split_once('=').ok_or("expected SCENE=FILE.esvo")?;
                let octree = Octree::open(path.as_ref()).map_err(|e| format!("{path}: {e}"))?;
                scenes.push((scene.to_owned(), Arc::new(octree)));
            }
        }
    }
    if scenes.is_empty() {
        return Err("expected at least one SCENE=OCTREE, e.g. sibenik=sibenik.esvo".into());
    }
    let mut right = true;
    for engine in engines {
        let mut casters = Vec::new();
        for (_, before) in COUNTS {
            let gpu = GpuOptions { kernel: Some(counting(before)?), ..GpuOptions::default() };
            casters.push(engine.open(&OpenOptions { gpu, ..OpenOptions::default() })?);
        }
        println!("{engine} on {}, {} x {}\n", casters[0].device().name, size.0, size.1);
        let subgroups = SUBGROUPS.map(|(width, height)| format!("lanes of {} in use", width * height)).join(" | ");
        println!("| scene, mode, views | {} | bytes | {subgroups} |", COUNTS.map(|(name, _)| name).join(" | "));
        println!("|---|{}--:|", "--:|".repeat(COUNTS.len() + SUBGROUPS.len()));
        for (scene, octree) in &scenes {
            for caster in &mut casters {
                caster.load(octree)?;
            }
            for (mode, options) in MODES {
                let views = views(scene, octree, size, &options)?;
                let (mut counts, mut ended) = ([0u64; COUNTS.len()], 0);
                let mut in_use = [(0, 0); SUBGROUPS.len()];
                let mut hits = Vec::new();
                for view in &views {
                    for (number, (caster, count)) in casters.iter_mut().zip(&mut counts).enumerate() {
                        caster.cast(view, &mut hits)?;
                        *count += hits.iter().map(|hit| u64::from(hit.iterations)).sum::<u64>();
                        if number == 0 {
                            ended += hits.iter().filter(|hit| !hit.is_miss()).count() as u64;
                            for ((used, all), shape) in in_use.iter_mut().zip(SUBGROUPS) {
                                let more = lanes(&hits, size, shape);
                                (*used, *all) = (*used + more.0, *all + more.1);
                            }
                        }
                    }
                }
                let [visits, pushes, advances, _, contours, descriptors, far_pointers] = counts;
                right &= visits == ended + pushes + advances;
                let rays = views.len() as f64 * f64::from(size.0 * size.1);
                let bytes = 8 * (descriptors + contours + far_pointers);
                let cells = counts.iter().chain([&bytes]).map(|count| format!("{:.3}", *count as f64 / rays));
                let shares = in_use.iter().map(|(used, all)| format!("{:.0} %", 100.0 * *used as f64 / *all as f64));
                println!(
                    "| {scene}, {mode}, {} | {} |",
                    views.len(),
                    cells.chain(shares).collect::<Vec<_>>().join(" | ")
                );
            }
        }
        println!();
    }
    Ok(if right { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
