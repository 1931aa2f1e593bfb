//! `esvo man`.

use std::path::PathBuf;

use clap::{Args, Command, CommandFactory};
use clap_mangen::Man;
use esvo_bench::BenchError;
use esvo_bench::output::{check_writable, write_text};

use crate::args::Arguments;
use crate::fail::{Failure, complain};
use crate::words::count;

/// Write manual pages, one for each command.
#[derive(Debug, Args)]
#[command(after_help = "\
The folder is made if needed. Each page is written whole or not at all.

Example:
  esvo man ~/.local/share/man/man1      then: man esvo-render")]
pub(crate) struct ManArguments {
    /// Folder for the pages: esvo.1, esvo-build.1, esvo-bench-build.1, ...
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
}

/// Writes the pages.
pub(crate) fn run_man(arguments: &ManArguments) -> Result<(), Failure> {
    let pages = manual_pages()?;
    check_writable(&arguments.folder)?;
    std::fs::create_dir_all(&arguments.folder).map_err(|e| BenchError::io(&arguments.folder, e))?;
    for (name, text) in &pages {
        write_text(&arguments.folder.join(name), text)?;
    }
    complain("written", &format!("{} in {}", count(pages.len() as u64, "manual page"), arguments.folder.display()));
    Ok(())
}

/// File names and texts of all pages. None is written before all of them are made.
fn manual_pages() -> Result<Vec<(String, String)>, Failure> {
    // `esvo help` needs no page of its own.
    let mut command = Arguments::command().disable_help_subcommand(true);
    command.build();
    let mut pages = Vec::new();
    add_pages(&command, &mut pages)?;
    Ok(pages)
}

/// Adds the page of a command, and those of the commands below it.
fn add_pages(command: &Command, pages: &mut Vec<(String, String)>) -> Result<(), Failure> {
    let man = Man::new(command.clone());
    let mut text = Vec::new();
    man.render(&mut text)?;
    pages.push((man.get_filename(), String::from_utf8(text)?));
    command.get_subcommands().try_for_each(|below| add_pages(below, pages))
}
