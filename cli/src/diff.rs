//! `esvo diff`.

use esvo_format::diff;
use std::fmt::Write;

use crate::args::Diff;
use crate::fail::{Failure, open, print};
use crate::words::count;

pub(crate) fn run(arguments: &Diff) -> Result<(), Failure> {
    let (first, second) = (open(&arguments.first)?, open(&arguments.second)?);
    let differences = diff::diff(&first, &second, arguments.limit)?;
    let text = if arguments.json {
        serde_json::to_string_pretty(&differences)? + "\n"
    } else if differences.is_empty() {
        "the same octree\n".into()
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
        let names = (arguments.first.display(), arguments.second.display());
        return Err(format!("{} and {} differ in {}", names.0, names.1, count(differences.total, "place")).into());
    }
    printed
}
