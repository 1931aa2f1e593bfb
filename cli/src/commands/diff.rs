//! `esvo diff`.

use esvo_format::diff;
use std::fmt::Write;

use crate::args::Diff;
use crate::fail::{Failure, open, print};
use crate::words::count;

pub(crate) fn run(arguments: &Diff) -> Result<(), Failure> {
    let (first, second) = (open(&arguments.first)?, open(&arguments.second)?);
    let names = format!("{} and {}", arguments.first.display(), arguments.second.display());
    let differences =
        diff::diff(&first, &second, arguments.limit).map_err(|e| format!("{names}: cannot be compared: {e}"))?;
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
        return Err(format!("{names} differ in {}", count(differences.total, "place")).into());
    }
    printed
}
