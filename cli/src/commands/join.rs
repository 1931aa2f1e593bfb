//! `esvo join`.

use std::path::PathBuf;

use clap::Args;
use esvo_format::{Octree, WriteOptions, join};

use crate::fail::{Failure, print};
use crate::files::{check_extension, check_not_input, check_output, name_file, open_verified};
use crate::memory::check_memory;
use crate::words::size;

/// Join octrees into one file: all their objects, at their places.
#[derive(Debug, Args)]
#[command(after_help = "\
Every file is checked against every rule first; if one is damaged, nothing is written. Objects keep
their transforms and all their data. Metadata stays behind.

To place octrees anywhere, and one many times, without another file: esvo render list.toml; see
scenes/README.md for the list.

Example:
  esvo join house.esvo garden.esvo -o place.esvo")]
pub(crate) struct JoinArguments {
    /// The octrees
    #[arg(required = true, num_args = 2..)]
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
    let octrees: Vec<Octree> = arguments.files.iter().map(|file| open_verified(file)).collect::<Result<_, _>>()?;
    let bytes = octrees.iter().map(|octree| size_of_val(octree.slots())).sum();
    check_memory(bytes, &format!("{}: {} octrees", output.display(), octrees.len()))?;
    let joined = join(&octrees.iter().collect::<Vec<_>>()).map_err(|error| name_file(output, error))?;
    let options = WriteOptions { compress: arguments.compress, parts: arguments.parts };
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
