//! Where a benchmark writes its record, and what it prints.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::fail::{Failure, complain, print};

#[derive(Debug, Args)]
pub(crate) struct RecordArguments {
    /// Folder in which the record's folder is made: MACHINE/DATE-BENCHMARK/
    #[arg(long, value_name = "FOLDER", default_value = "results")]
    pub(crate) out: PathBuf,
    /// Name of the machine's folder [default: made from the processor's]
    #[arg(long, value_name = "NAME")]
    pub(crate) machine: Option<String>,
    /// Print the record as JSON instead of the tables
    #[arg(long)]
    json: bool,
}

impl RecordArguments {
    /// Prints the record, which was written to `folder`, as JSON or as tables.
    pub(crate) fn print(
        &self,
        folder: &Path,
        json: impl FnOnce() -> String,
        text: impl FnOnce() -> String,
    ) -> Result<(), Failure> {
        if self.json {
            complain("written", &folder.display().to_string());
            return print(&json());
        }
        print(&format!("{}\nWritten to {}\n", text(), folder.display()))
    }
}
