//! `esvo hits`.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::ray_files::{Comparison, HitFile, HitRecord, HitWriter, RayFile, RayFileError, cast_file, compare};
use esvo_core::CastError;
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::write_atomically;

use crate::fail::{Failure, print};
use crate::files::{check_not_input, check_output, name_file, open};
use crate::values::engine;
use crate::words::count;

/// Cast the rays of a file, and write or compare the hits.
#[derive(Debug, Args)]
#[command(after_help = "\
Rays come from esvo rays or from another program. The extension tells the form: .bin or .json. A
.bin has a header of 192 bytes and 48 bytes for each hit, all little-endian; the page of
esvo_bench::ray_files has every field. With numpy:

  hits = numpy.fromfile('hits.bin', offset=192, dtype=[
    ('t', '<f4'), ('size', '<f4'), ('slot', '<u4'), ('child', 'u1'), ('scale', 'u1'),
    ('hit', '<u2'), ('position', '<f8', 3), ('iterations', '<u4'), ('zero', '<u4')])

t is in lengths of the ray's direction, position in mesh units. With --compare, the exit code is 1
if a ray hits in one file only or at another t. A caster without voxels writes 0 for size, slot,
child and scale.

Examples:
  esvo hits sibenik.esvo --rays rays.bin -o hits.bin
  esvo hits sibenik.esvo --rays rays.bin --backend wgpu -o hits.bin
  esvo hits sibenik.esvo --rays rays.bin --compare other.bin --tolerance 1e-6")]
pub(crate) struct HitsArguments {
    /// The octree
    pub(crate) file: PathBuf,
    /// The rays: .bin or .json
    #[arg(long, value_name = "FILE")]
    pub(crate) rays: PathBuf,
    /// The engine that casts the rays
    #[arg(short, long, value_parser = engine(), default_value_t = EngineId::Reference)]
    pub(crate) backend: EngineId,
    /// Write the hits to this file: .bin or .json
    #[arg(short, long, value_name = "FILE", required_unless_present = "compare")]
    pub(crate) output: Option<PathBuf>,
    /// Compare with the hits of another caster for the same rays
    #[arg(long, value_name = "FILE")]
    pub(crate) compare: Option<PathBuf>,
    /// Largest difference of t that counts as equal
    #[arg(long, value_name = "T", requires = "compare", default_value_t = 1e-5)]
    pub(crate) tolerance: f64,
}

pub(crate) fn run_hits(arguments: &HitsArguments) -> Result<(), Failure> {
    if arguments.tolerance.is_nan() || arguments.tolerance < 0.0 {
        return Err(format!("--tolerance {}: expected 0 or a positive number", arguments.tolerance).into());
    }
    if let Some(output) = &arguments.output {
        check_output(output)?;
        for input in [Some(&arguments.file), Some(&arguments.rays), arguments.compare.as_ref()].into_iter().flatten() {
            check_not_input(output, input)?;
        }
    }
    let octree = Arc::new(open(&arguments.file, true)?);
    let mut caster = arguments.backend.open(&OpenOptions::default())?;
    caster.load(&octree).map_err(|e| name_file(&arguments.file, e))?;
    let mut rays = RayFile::open(&arguments.rays)?;
    let mut other = arguments.compare.as_deref().map(HitFile::open).transpose()?;
    if let (Some(file), Some(hits)) = (&arguments.compare, &other)
        && hits.count() != rays.count()
    {
        let (hits, rays) = (count(hits.count(), "hit"), count(rays.count(), "ray"));
        return Err(format!("{}: has {hits} for {rays}", file.display()).into());
    }
    let progress = Progress::terminal();
    progress.say("casting");
    let (header, number) = (*rays.header(), rays.count());
    let mut sum = Comparison::default();
    let (mut hit, mut theirs) = (0, Vec::new());
    let mut look = |hits: &[HitRecord]| -> std::io::Result<()> {
        hit += hits.iter().filter(|h| h.hit).count();
        if let Some(other) = &mut other {
            other.next(hits.len(), &mut theirs).map_err(std::io::Error::other)?;
            compare(hits, &theirs, arguments.tolerance, &mut sum);
        }
        Ok(())
    };
    match &arguments.output {
        Some(output) => write_atomically(output, |out| {
            let mut writer = HitWriter::new(out, output, &header, number)?;
            cast_file(&mut rays, &octree, &mut *caster, &mut |hits| {
                look(hits)?;
                writer.put(hits)
            })?;
            writer.end()
        })
        .map_err(|e| if is_of_writing(&e) { name_file(output, e) } else { e.to_string() })?,
        None => cast_file(&mut rays, &octree, &mut *caster, &mut look)?,
    }
    progress.finish();
    let mut text =
        format!("{}: {hit} hit, cast by {} on {}\n", count(number, "ray"), arguments.backend, caster.device().name);
    let Some(file) = &arguments.compare else { return print(&text) };
    let Comparison { both, only_first, only_second, other_voxel, other_t, largest_t, .. } = sum;
    let name = file.display();
    text += &format!(
        "compared with {name}: {both} hit in both, {only_first} only here, {only_second} only there; {other_t} of both at another \
         t (largest difference {largest_t:e}); {other_voxel} of both in another voxel\n"
    );
    print(&text)?;
    if sum.agrees() {
        return Ok(());
    }
    let wrong = only_first + only_second + other_t;
    Err(format!("{name}: {} of {} differ", wrong, count(number, "ray")).into())
}

/// Whether an error of [`write_atomically`] concerns the output: not a file that was read, nor the engine.
fn is_of_writing(error: &std::io::Error) -> bool {
    !error.get_ref().is_some_and(|inner| inner.is::<RayFileError>() || inner.is::<CastError>())
}
