//! `esvo dump`.

use std::fmt::Display;

use esvo_format::{FormatError, Octree, dump};

use crate::args::Dump;
use crate::fail::{Failure, name_file, print, wrong_kind};

pub(crate) fn run(arguments: &Dump) -> Result<(), Failure> {
    let named =
        |error: FormatError| wrong_kind(&arguments.file, &error).unwrap_or_else(|| name_file(&arguments.file, error));
    // Not asked to be sound: a damaged file is looked at to find the damage.
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
