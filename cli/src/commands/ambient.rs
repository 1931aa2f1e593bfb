//! `esvo ambient`.

use std::sync::Arc;
use std::time::Instant;

use esvo_bench::{Backend, Progress};
use esvo_core::ambient::{Ambient as Values, AmbientSettings};

use crate::args::Ambient;
use crate::fail::{Failure, check_extension, check_not_input, check_output, name_file, open, print};
use crate::words::count;

pub(crate) fn run(arguments: &Ambient) -> Result<(), Failure> {
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
    let octree = Arc::new(open(&arguments.input)?);
    let progress = Progress::terminal();
    let mut caster = Backend::from(arguments.backend).open(None)?;
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
    with.write(&arguments.output).map_err(|e| name_file(&arguments.output, e))?;
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
