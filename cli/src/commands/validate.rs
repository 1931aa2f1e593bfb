//! `esvo validate`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;

use crate::fail::{Failure, print};
use crate::files::{name_file, wrong_kind};
use crate::remote::{Local, RemoteArguments, bare, shown};
use crate::words::count;

/// Check a file against every rule of the specification.
#[derive(Debug, Args)]
#[command(after_help = "\
Exit code 0 if the file keeps every rule; 1 if it breaks a rule. Each finding names the rule, the
offset and what was found.

The file may be on a web server or in an object store (http://, https://, s3://, gs://, az://), if the
program was built with --features remote: all of it is read, to a temporary file.

Example:
  esvo validate sibenik.esvo")]
pub(crate) struct ValidateArguments {
    /// The file, or its address
    pub(crate) file: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) remote: RemoteArguments,
}

pub(crate) fn run_validate(arguments: &ValidateArguments) -> Result<(), Failure> {
    let name = shown(&arguments.file);
    let local = Local::of(&arguments.file, &arguments.remote)?;
    let report = esvo_format::validate_file(local.path())
        .map_err(|error| local.rename(name_file(local.path(), error).into(), &arguments.file))?;
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
            .and_then(|error| wrong_kind(&bare(&arguments.file), &error))
            .unwrap_or_else(|| format!("{name}: breaks the specification in {}", count(report.errors, "place")))
            .into());
    }
    printed
}
