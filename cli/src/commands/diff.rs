//! `esvo diff`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use esvo_format::diff;

use crate::fail::{Failure, print};
use crate::files::open_verified;
use crate::words::count;

/// Compare the octrees of two files, whatever their layout.
#[derive(Debug, Args)]
#[command(after_help = "\
Compares objects, transforms, topology, contours, colours and normals. Ignores blocks, pointers,
compression, metadata and unknown sections. Both files are checked against every rule first. Exit
code 0 if the octrees are the same; 1 if they differ, with a list of the first differences, or if
a file is damaged.

Examples:
  esvo diff before.esvo after.esvo
  esvo diff --topology exact.esvo voxelized.esvo")]
pub(crate) struct DiffArguments {
    /// The first file
    pub(crate) first: PathBuf,
    /// The second file
    pub(crate) second: PathBuf,
    /// Compare objects, transforms and which voxels there are, but not their contours, colours and normals
    #[arg(long)]
    pub(crate) topology: bool,
    /// List at most this many differences
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub(crate) limit: usize,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
}

pub(crate) fn run_diff(arguments: &DiffArguments) -> Result<(), Failure> {
    let (first, second) = (open_verified(&arguments.first)?, open_verified(&arguments.second)?);
    let names = format!("{} and {}", arguments.first.display(), arguments.second.display());
    let compare = if arguments.topology { diff::diff_topology } else { diff::diff };
    let differences =
        compare(&first, &second, arguments.limit).map_err(|e| format!("{names}: cannot be compared: {e}"))?;
    let text = if arguments.json {
        serde_json::to_string_pretty(&differences)? + "\n"
    } else if differences.is_empty() {
        if arguments.topology { "the same voxels\n".into() } else { "the same octree\n".into() }
    } else {
        let mut text = String::new();
        for difference in &differences.list {
            let _ = writeln!(text, "{difference}");
        }
        let more = differences.total - differences.list.len() as u64;
        if more > 0 {
            let _ = writeln!(text, "and {more} more");
        }
        text
    };
    let printed = print(&text);
    if !differences.is_empty() {
        return Err(format!("{names} differ in {}", count(differences.total, "place")).into());
    }
    printed
}
