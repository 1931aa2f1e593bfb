//! `esvo dump`.

use std::fmt::Display;
use std::path::PathBuf;

use clap::Args;
use esvo_format::file::NO_PARENT;
use esvo_format::{FormatError, Octree, dump};

use crate::fail::{Failure, print};
use crate::files::{damaged, name_file, not_opened};

/// Show the layout of a file: its tables, the slots of a block, or a voxel.
#[derive(Debug, Args)]
#[command(after_help = "\
The checksums of the blocks that are shown and of the blocks above them are compared; the tables
show parts of all blocks. Of a damaged file, as much is shown as can be read, and the exit code is
1.

Examples:
  esvo dump sibenik.esvo                     the object and block tables
  esvo dump sibenik.esvo --block 0           all slots of block 0 with their meaning
  esvo dump sibenik.esvo --path 0/3/7        the child at slots 0, 3, 7 from the root
  esvo dump sibenik.esvo --path / --json     the root, as JSON")]
pub(crate) struct DumpArguments {
    /// The file
    pub(crate) file: PathBuf,
    /// Show this block, given by its index in the block table
    #[arg(long, value_name = "N", conflicts_with = "path")]
    pub(crate) block: Option<usize>,
    /// Show a descriptor or a leaf voxel, given by its child slots from the root: 0/3/7
    #[arg(long, value_name = "SLOTS")]
    pub(crate) path: Option<String>,
    /// The object in which the path starts
    #[arg(long, value_name = "N", default_value_t = 0, requires = "path")]
    pub(crate) object: usize,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
    /// Check the file against every rule of the specification, whatever is shown
    #[arg(long)]
    pub(crate) verify: bool,
}

pub(crate) fn run_dump(arguments: &DumpArguments) -> Result<(), Failure> {
    let path = &arguments.file;
    let octree = Octree::open(path).map_err(|error| not_opened(path, error))?;
    // Shown before it is verified: a dump serves to find the damage in a file.
    let (shown, block) = match (arguments.block, &arguments.path) {
        (Some(block), _) => (dump::block(&octree, block).map(|found| show(&found, arguments.json)), Some(block)),
        (None, Some(slots)) => match dump::node(&octree, arguments.object, &dump::parse_path(slots)?) {
            Ok(node) => (Ok(show(&node, arguments.json)), Some(node.block as usize)),
            Err(error) => (Err(error), None),
        },
        (None, None) => (Ok(show(&dump::tables(&octree), arguments.json)), None),
    };
    let shown = match shown {
        Ok(shown) => shown,
        // Damage explains it best.
        Err(FormatError::Broken(broken)) => {
            return Err(damaged(path, &octree.intact().err().unwrap_or(broken)).into());
        }
        Err(other) => return Err(name_file(path, other).into()),
    };
    let verified = if arguments.verify {
        octree.verified().map_err(FormatError::from)
    } else {
        block.map_or_else(|| octree.intact().map_err(FormatError::from), |block| check_from_root(&octree, block))
    };
    verified.map_err(|error| not_opened(path, error))?;
    shown
}

/// Compares the checksums of a block and of the blocks above it, whose pointers lead to it.
fn check_from_root(octree: &Octree, block: usize) -> Result<(), FormatError> {
    octree.check_block(block)?;
    let parent = octree.blocks()[block].parent;
    // Parents have lower indices.
    if parent == NO_PARENT { Ok(()) } else { check_from_root(octree, parent as usize) }
}

fn show(dump: &(impl Display + serde::Serialize), json: bool) -> Result<(), Failure> {
    print(&if json { serde_json::to_string_pretty(dump)? + "\n" } else { dump.to_string() })
}
