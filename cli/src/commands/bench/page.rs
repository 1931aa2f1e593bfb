//! `esvo bench page`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::output::check_writable;
use esvo_bench::page::{DEFAULT_TITLE, PageOptions, make_page, write_page};

use crate::fail::{Failure, complain, print};
use crate::values::parse_positive;

/// Make one HTML page of stored records: answers, tables, plots, pictures.
#[derive(Debug, Args)]
#[command(after_help = "\
Reads records of esvo bench, build, sweep, stability, rays and needs: files that are named, and
those in the folders that are named, at most four folders deep. Writes one file that needs no
other file and no network: answers in words on top, the paper's two tables with the paper's figures
and the ratio in each cell, plots of error against time, pictures to compare, tables that can be
sorted. Pictures are those that records of esvo bench name, if they may be published. Exit code 1
if an engine is wrong by one of the records; the page is written all the same, and says so.

Examples:
  esvo bench page results -o page.html
  esvo bench page results/machine/2026-11-26-sweep results/machine/2026-11-26 -o page.html")]
pub(crate) struct BenchPageArguments {
    /// Records, and folders with records
    #[arg(required = true, value_name = "RECORD")]
    records: Vec<PathBuf>,
    /// The file to write
    #[arg(short, long, value_name = "FILE", default_value = "page.html")]
    output: PathBuf,
    /// Title of the page
    #[arg(long, value_name = "TEXT", default_value = DEFAULT_TITLE)]
    title: String,
    /// Most megabytes (10^6 bytes) of pictures in the page
    #[arg(long, value_name = "MB", default_value_t = 24.0, value_parser = parse_positive)]
    picture_mb: f64,
}

pub(crate) fn run_bench_page(arguments: &BenchPageArguments) -> Result<(), Failure> {
    let BenchPageArguments { records, output, title, picture_mb } = arguments;
    if let Some(folder) = output.parent() {
        check_writable(folder)?;
    }
    let options =
        PageOptions { inputs: records.clone(), title: title.clone(), picture_bytes: (picture_mb * 1e6) as u64 };
    let page = make_page(&options)?;
    write_page(&page, output)?;
    for what in &page.left_out {
        complain("not on the page", what);
    }
    let size = page.html.len() as f64 / 1e6;
    let text = format!(
        "{} records, {} pictures, {size:.1} MB. Written to {}\n",
        page.records,
        page.pictures,
        output.display()
    );
    let printed = print(&text);
    if !page.wrong.is_empty() {
        return Err(format!("wrong by these records: {}; see {}", page.wrong.join(", "), output.display()).into());
    }
    printed
}
