//! `esvo bench page`: one HTML file made of stored records alone, to be read without any other file and without a network.
//!
//! - `machines.rs`: records by machine. `verdicts.rs`: which engine is wrong, by all records. `between/`: what records of one machine say of
//!   the same thing. `gpu.rs`: GPU against processor. `answers/`: the questions that a sweep answers, in words. `span.rs`: times with their spread, and ties. `settings.rs`: the settings of a sweep. `plot.rs`: plots, and error against time. `voxel_plots.rs`: plots of voxelization.
//!   `shadow_plots.rs`: error against time of effects.
//! - `paper_tables.rs`: Table 1 and Table 2 with the paper's figures. `in_words.rs`: sentences above tables of figures. `pictures.rs`:
//!   pictures to compare. `sources.rs`: the records. `sections.rs`: the order.
//! - `glossary.rs`: the terms. `html.rs`: what the template is given. `templates/`: the template, its style and its script.

mod answers;
mod between;
mod glossary;
mod gpu;
mod html;
mod in_words;
mod machines;
mod paper_tables;
mod pictures;
mod plot;
mod sections;
mod settings;
mod shadow_plots;
mod sources;
mod span;
mod verdicts;
mod voxel_plots;

use std::path::{Path, PathBuf};

use askama::Template;
use base64::Engine;
use sha2::{Digest, Sha256};

use crate::BenchError;
use crate::output::write_text;
pub use crate::records::{Found, Record, find_records};
use html::Page;

/// The script of the page.
const SCRIPT: &str = include_str!("../../templates/page.js");
/// Its style.
const STYLE: &str = include_str!("../../templates/page.css");

/// The title of a page that is not given another.
pub const DEFAULT_TITLE: &str = "esvo: error and speed of sparse voxel octrees";

/// What [`make_page`] makes a page of.
#[derive(Clone, Debug)]
pub struct PageOptions {
    /// Records, or folders in which records are looked for.
    pub inputs: Vec<PathBuf>,
    /// Title of the page.
    pub title: String,
    /// Most bytes of the pictures' files in the page. Those that do not fit are named and left out.
    pub picture_bytes: u64,
}

impl Default for PageOptions {
    /// No records, and 24 MB of pictures.
    fn default() -> Self {
        Self { inputs: Vec::new(), title: DEFAULT_TITLE.into(), picture_bytes: 24_000_000 }
    }
}

/// A page.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct MadePage {
    /// The HTML file.
    pub html: String,
    /// Number of records that it shows.
    pub records: usize,
    /// Pictures in it.
    pub pictures: usize,
    /// Engines whose hits are wrong by one of the records.
    pub wrong: Vec<String>,
    /// What is not in the page, and why.
    pub left_out: Vec<String>,
}

/// Makes a page of the records in `options.inputs`.
///
/// # Errors
/// An input that cannot be read, a file that is no record, folders without a record.
pub fn make_page(options: &PageOptions) -> Result<MadePage, BenchError> {
    let mut found = find_records(&options.inputs)?;
    machines::name_apart(&mut found);
    let hash = base64::engine::general_purpose::STANDARD.encode(Sha256::digest(SCRIPT));
    let (contents, left_out) = sections::contents(&found, options.picture_bytes);
    let wrong = contents.wrong.clone();
    let pictures = contents.pictures;
    let page = Page { title: options.title.clone(), style: STYLE, script: SCRIPT, script_hash: hash, contents };
    let html = page.render().map_err(|e| BenchError::io(Path::new("page"), std::io::Error::other(e)))?;
    Ok(MadePage { html, records: found.len(), pictures, wrong, left_out })
}

/// Writes the page, whole or not at all.
///
/// # Errors
/// The system's.
pub fn write_page(page: &MadePage, path: &Path) -> Result<(), BenchError> {
    write_text(path, &page.html)
}
