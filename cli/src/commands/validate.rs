//! `esvo validate`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;

use crate::fail::{Failure, print};
use crate::files::{name_file, wrong_kind};
use crate::words::count;

/// Check a file against every rule of the specification.
#[derive(Debug, Args)]
#[command(after_help = "\
Exit code 0 if the file keeps every rule; 1 if it breaks a rule. Each finding names the rule, the
offset and what was found.

Example:
  esvo validate sibenik.esvo")]
pub(crate) struct ValidateArguments {
    /// The file
    pub(crate) file: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
}

pub(crate) fn run_validate(arguments: &ValidateArguments) -> Result<(), Failure> {
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
