//! `esvo dump`.

use std::fmt::Display;
use std::path::PathBuf;

use clap::Args;
use esvo_format::{FormatError, Octree, dump};

use crate::fail::{Failure, print};
use crate::files::{name_file, wrong_kind};

/// Show the layout of a file: its tables, the slots of a block, or a voxel.
#[derive(Debug, Args)]
#[command(after_help = "\
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
}

pub(crate) fn run_dump(arguments: &DumpArguments) -> Result<(), Failure> {
    let named =
        |error: FormatError| wrong_kind(&arguments.file, &error).unwrap_or_else(|| name_file(&arguments.file, error));
    // Soundness is not checked: a dump serves to find the damage in a file.
    let octree = Octree::open(&arguments.file).map_err(named)?;
    if let Some(block) = arguments.block {
        return show(&dump::block(&octree, block).map_err(named)?, arguments.json);
    }
    if let Some(path) = &arguments.path {
        let path = dump::parse_path(path)?;
        return show(&dump::node(&octree, arguments.object, &path).map_err(named)?, arguments.json);
    }
    show(&dump::tables(&octree), arguments.json)
}

fn show(dump: &(impl Display + serde::Serialize), json: bool) -> Result<(), Failure> {
    print(&if json { serde_json::to_string_pretty(dump)? + "\n" } else { dump.to_string() })
}
