//! `esvo validate`.

use std::fmt::Write;

use crate::args::Validate;
use crate::fail::{Failure, name_file, print, wrong_kind};
use crate::words::count;

pub(crate) fn run(arguments: &Validate) -> Result<(), Failure> {
    let name = arguments.file.display();
    let report = esvo_format::validate_file(&arguments.file).map_err(|e| name_file(&arguments.file, e))?;
    let text = if arguments.json {
        serde_json::to_string_pretty(&report)? + "\n"
    } else {
        let mut text = String::new();
        for finding in &report.findings {
            let kind = if finding.warning { "warning" } else { "broken" };
            let _ = writeln!(text, "{name}: {kind}: {}", finding.broken);
        }
        if report.left_out > 0 {
            let _ = writeln!(text, "{name}: and {} more", report.left_out);
        }
        if report.is_ok() {
            let _ = writeln!(text, "{name}: keeps every rule of the specification");
        }
        text
    };
    let printed = print(&text);
    if !report.is_ok() {
        let first = report.findings.first().map(|finding| finding.broken.clone().into());
        return Err(first
            .and_then(|error| wrong_kind(&arguments.file, &error))
            .unwrap_or_else(|| format!("{name}: breaks the specification in {}", count(report.errors, "place")))
            .into());
    }
    printed
}
