//! `esvo ambient`.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use esvo_bench::Progress;
use esvo_core::ambient::{Ambient as Values, AmbientSettings};
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::WriteOptions;

use crate::fail::{Failure, print};
use crate::files::{check_extension, check_not_input, check_output, name_file, open_verified};
use crate::values::engine;
use crate::words::count;

/// Compute ambient occlusion: how much light from all sides reaches each voxel.
#[derive(Debug, Args)]
#[command(after_help = "\
From each leaf voxel, rays are cast into the half space above its surface, more of them near the
normal (cosine-weighted). The share of rays that hit nothing is stored with the voxel; `esvo
render` darkens voxels by it. The octree must have normals. GPU engines get about a million rays
at a time. The octree is checked against every rule first; if it is damaged, nothing is written.

Examples:
  esvo ambient sibenik.esvo -o sibenik-ao.esvo
  esvo ambient conference.esvo -o conference-ao.esvo --radius 0.05 --flip-normals")]
pub(crate) struct AmbientArguments {
    /// The octree
    pub(crate) input: PathBuf,
    /// The file to write: the same octree with ambient occlusion
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Rays per leaf voxel
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub(crate) rays: u32,
    /// Longest distance at which something occludes, as a fraction of the scene's extent
    #[arg(long, value_name = "X", default_value_t = 0.05)]
    pub(crate) radius: f64,
    /// Cast rays from the back of surfaces: for meshes whose normals point inwards
    #[arg(long)]
    pub(crate) flip_normals: bool,
    /// Ignore contours: treat voxels as cubes
    #[arg(long)]
    pub(crate) no_contours: bool,
    /// The engine that casts the rays
    #[arg(short, long, value_parser = engine(), default_value_t = EngineId::Cpu)]
    pub(crate) backend: EngineId,
}

pub(crate) fn run_ambient(arguments: &AmbientArguments) -> Result<(), Failure> {
    let settings = AmbientSettings {
        rays: arguments.rays,
        radius: arguments.radius,
        flip_normals: arguments.flip_normals,
        contours: !arguments.no_contours,
    };
    settings.check()?;
    check_output(&arguments.output)?;
    check_extension(&arguments.output, "esvo", "octrees are written as .esvo")?;
    check_not_input(&arguments.output, &arguments.input)?;
    let octree = Arc::new(open_verified(&arguments.input)?);
    let progress = Progress::terminal();
    let mut caster = arguments.backend.open(&OpenOptions::default())?;
    let leaves: u64 = octree.objects().iter().map(|o| o.leaf_voxels).sum();
    let rays = leaves as f64 * f64::from(settings.rays);
    let start = Instant::now();
    let values = Values::compute(&octree, &mut *caster, &settings, &mut |done| {
        let rate = done * rays / start.elapsed().as_secs_f64().max(1e-3);
        let left = (1.0 - done) * rays / rate.max(1.0);
        let note = format!("{:.1} million rays a second, {left:.0} s left", rate / 1e6);
        progress.fraction("casting ambient occlusion", done, &note);
    })
    .map_err(|e| name_file(&arguments.input, e))?;
    let seconds = start.elapsed().as_secs_f64();
    progress.say(format!("writing {}", arguments.output.display()));
    let with = octree
        .with_ambient_occlusion(|slot, child| values.value(slot, child))
        .map_err(|e| name_file(&arguments.input, e))?;
    let options = WriteOptions { hash: octree.file_hash().is_some(), ..WriteOptions::default() };
    with.write_with(&arguments.output, &options).map_err(|e| name_file(&arguments.output, e))?;
    progress.finish();
    print(&format!(
        "{}: {}, {} each, {seconds:.1} s, {:.1} million rays a second, cast by {} on {}\n",
        arguments.output.display(),
        count(leaves, "leaf voxel"),
        count(settings.rays, "ray"),
        rays / seconds.max(1e-3) / 1e6,
        caster.name(),
        caster.device().name
    ))
}
