//! `esvo join`: octrees into one file with all their objects, or the parts of a build into its octree.

use std::path::PathBuf;

use clap::Args;
use esvo_builder::{BuildError, is_part, join_parts};
use esvo_format::{Octree, WriteOptions, join};

use crate::fail::{Failure, print};
use crate::files::{check_extension, check_not_input, check_output, name_file, open_verified};
use crate::memory::check_memory;
use crate::words::{count, size};

/// Join octrees into one file, all their objects at their places; or the parts of a build into its octree.
#[derive(Debug, Args)]
#[command(after_help = "\
Every file is checked against every rule first; if one is damaged, nothing is written. Objects keep
their transforms and all their data. Metadata stays behind.

Parts that esvo build --part made become the file of a whole build, byte for byte: all of them are
needed, in any order. Their metadata is that of the build. --compress and --parts say how it is stored.

To place octrees anywhere, and one many times, without another file: esvo render list.toml; see
scenes/README.md for the list.

Examples:
  esvo join house.esvo garden.esvo -o place.esvo
  esvo join *.esvopart -o city.esvo")]
pub(crate) struct JoinArguments {
    /// The octrees, at least two; or the parts of a build
    #[arg(required = true, num_args = 1..)]
    pub(crate) files: Vec<PathBuf>,
    /// The file to write: .esvo
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Compress the blocks with Zstandard at this level, 1 to 22 [without a number: 3]
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, default_missing_value = "3", value_parser = clap::value_parser!(i32).range(1..=22))]
    pub(crate) compress: Option<i32>,
    /// Store the blocks in parts by level, as streams of fields: the smallest files, and a coarse version is read by few
    /// ranges. --compress says how hard their streams are compressed
    #[arg(long)]
    pub(crate) parts: bool,
}

pub(crate) fn run_join(arguments: &JoinArguments) -> Result<(), Failure> {
    let output = &arguments.output;
    check_output(output)?;
    check_extension(output, "esvo", "octrees are joined in an .esvo")?;
    arguments.files.iter().try_for_each(|file| check_not_input(output, file))?;
    let options = WriteOptions { compress: arguments.compress, parts: arguments.parts };
    let parts = arguments.files.iter().filter(|file| is_part(file).unwrap_or(false)).count();
    if parts == arguments.files.len() {
        return run_join_parts(arguments, &options);
    }
    if let Some(part) = arguments.files.iter().find(|file| is_part(file).unwrap_or(false)) {
        let what = "is a part of a build, and other files are octrees; join the parts of a build first";
        return Err(format!("{}: {what}", part.display()).into());
    }
    if arguments.files.len() < 2 {
        return Err("one octree is nothing to join; give two or more, or all parts of a build".into());
    }
    let octrees: Vec<Octree> = arguments.files.iter().map(|file| open_verified(file)).collect::<Result<_, _>>()?;
    let bytes = octrees.iter().map(|octree| size_of_val(octree.slots())).sum();
    check_memory(bytes, &format!("{}: {} octrees", output.display(), octrees.len()))?;
    let joined = join(&octrees.iter().collect::<Vec<_>>()).map_err(|error| name_file(output, error))?;
    joined.write_with(output, &options).map_err(|error| name_file(output, error))?;
    let bytes = std::fs::metadata(output).map_or(0, |m| m.len());
    let mut text = format!("{}: {}, {} objects\n", output.display(), size(bytes), joined.objects().len());
    for (file, octree) in arguments.files.iter().zip(&octrees) {
        if !octree.meta().is_empty() || !octree.unknown_sections().is_empty() {
            text += &format!("left out: metadata of {}\n", file.display());
        }
    }
    print(&text)
}

fn run_join_parts(arguments: &JoinArguments, options: &WriteOptions) -> Result<(), Failure> {
    let output = &arguments.output;
    let object = join_parts(&arguments.files, output, options).map_err(|error| match error {
        BuildError::Format(error) => name_file(output, error),
        error => error.to_string(),
    })?;
    let bytes = std::fs::metadata(output).map_or(0, |m| m.len());
    let voxels = object.descriptors + object.leaf_voxels - 1;
    print(&format!(
        "{}: {}, {}, {}, of {}\n",
        output.display(),
        size(bytes),
        count(object.levels, "level"),
        count(voxels, "voxel"),
        count(arguments.files.len() as u64, "part"),
    ))
}
