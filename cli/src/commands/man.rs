//! `esvo man`.

use std::path::PathBuf;

use clap::{Args, Command};
use clap_mangen::Man;
use clap_mangen::roff::{Roff, roman};
use esvo_bench::BenchError;
use esvo_bench::output::{check_writable, write_text};

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

/// Writes the pages. `esvo` is the definition of the command line.
pub(crate) fn run_man(arguments: &ManArguments, esvo: Command) -> Result<(), Failure> {
    let pages = manual_pages(esvo)?;
    check_writable(&arguments.folder)?;
    std::fs::create_dir_all(&arguments.folder).map_err(|e| BenchError::io(&arguments.folder, e))?;
    for (name, text) in &pages {
        write_text(&arguments.folder.join(name), text)?;
    }
    complain("written", &format!("{} in {}", count(pages.len() as u64, "manual page"), arguments.folder.display()));
    Ok(())
}

/// File names and texts of all pages. None is written before all of them are made.
fn manual_pages(esvo: Command) -> Result<Vec<(String, String)>, Failure> {
    // `esvo help` needs no page of its own.
    let mut command = esvo.disable_help_subcommand(true);
    command.build();
    let mut pages = Vec::new();
    add_pages(&command, &mut pages)?;
    Ok(pages)
}

/// Adds the page of a command, and those of the commands below it.
fn add_pages(command: &Command, pages: &mut Vec<(String, String)>) -> Result<(), Failure> {
    let man = Man::new(command.clone()).manual("esvo");
    let mut text = Vec::new();
    man.render_title(&mut text)?;
    man.render_name_section(&mut text)?;
    man.render_synopsis_section(&mut text)?;
    man.render_description_section(&mut text)?;
    man.render_options_section(&mut text)?;
    if command.has_subcommands() {
        man.render_subcommands_section(&mut text)?;
    }
    let notes = command.get_after_help().map_or(String::new(), ToString::to_string);
    add_notes(&notes).to_writer(&mut text)?;
    pages.push((man.get_filename(), String::from_utf8(text)?));
    command.get_subcommands().try_for_each(|below| add_pages(below, pages))
}

/// The text after the options of a command's help: notes as a paragraph, examples line by line.
fn add_notes(text: &str) -> Roff {
    let mut page = Roff::new();
    let (notes, examples) = match text.find("Example") {
        Some(start) => text.split_at(start),
        None => (text, ""),
    };
    if !notes.trim().is_empty() {
        page.control("SH", ["NOTES"]);
        for line in notes.trim().lines() {
            page.text([roman(line)]);
        }
    }
    if !examples.is_empty() {
        page.control("SH", ["EXAMPLES"]);
        // Without this, lines would be joined to a paragraph.
        page.control("nf", []);
        for line in examples.lines().skip(1) {
            page.text([roman(line.trim_start())]);
        }
        page.control("fi", []);
    }
    page
}
