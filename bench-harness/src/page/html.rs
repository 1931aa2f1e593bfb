//! What the template is given. The template escapes every text.

use askama::Template;

use super::glossary::{Piece, Term};
use super::pictures::Comparison;
use super::plot::Plot;
use crate::text::TextTable;

/// The page.
#[derive(Template)]
#[template(path = "page.html")]
pub(super) struct Page {
    pub(super) title: String,
    pub(super) style: &'static str,
    pub(super) script: &'static str,
    /// SHA-256 of the script in base 64: no other script runs in the page.
    pub(super) script_hash: String,
    pub(super) contents: Contents,
}

/// Everything that depends on the records.
pub(super) struct Contents {
    /// Lines below the title.
    pub(super) lead: Vec<String>,
    /// The question of all machines.
    pub(super) wrong_engine: Question,
    /// The questions of each machine.
    pub(super) machines: Vec<Answers>,
    /// Terms and what they mean.
    pub(super) terms: &'static [Term],
    pub(super) sections: Vec<Section>,
    /// Engines that are wrong.
    pub(super) wrong: Vec<String>,
    /// Number of pictures.
    pub(super) pictures: usize,
}

impl Contents {
    /// The sections of a machine; of all machines, if the name is empty.
    fn sections_of<'a>(&'a self, machine: &'a str) -> impl Iterator<Item = &'a Section> {
        self.sections.iter().filter(move |section| section.machine == machine)
    }
}

/// The answers for one machine.
pub(super) struct Answers {
    /// Its name.
    pub(super) machine: String,
    /// Part of the ids of its elements; empty on a page of one machine.
    pub(super) id: String,
    /// What is not answered, and why.
    pub(super) lead: Vec<String>,
    pub(super) questions: Vec<Question>,
}

/// A question of the summary.
pub(super) struct Question {
    pub(super) id: &'static str,
    pub(super) question: String,
    /// Name of the machine that it is about; empty: of all of the page.
    pub(super) machine: String,
    /// What is asked, in more words, or the rule of the answer.
    pub(super) rule: String,
    pub(super) answers: Vec<Answered>,
    /// A table below the answers.
    pub(super) table: Option<PageTable>,
}

/// An answer for one scene or machine.
#[derive(Default)]
pub(super) struct Answered {
    /// Scene or machine; empty: the answer is for all.
    pub(super) of: String,
    /// What the answer holds for: engine, picture, levels. Empty: for all that the question names.
    pub(super) scope: String,
    pub(super) mark: Mark,
    /// The answer in a few words.
    pub(super) answer: String,
    /// Figures.
    pub(super) details: Vec<String>,
    /// Things that the answer names, none of them better than another.
    pub(super) choices: Vec<String>,
}

/// How an answer looks.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(super) enum Mark {
    Good,
    Bad,
    Mixed,
    #[default]
    Plain,
}

impl Mark {
    /// The class of its element.
    pub(super) fn class(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Bad => "bad",
            Self::Mixed => "mixed",
            Self::Plain => "plain",
        }
    }
}

/// A section of the page.
pub(super) struct Section {
    pub(super) id: String,
    pub(super) title: String,
    /// Name of the machine; empty: of all of the page.
    pub(super) machine: String,
    /// When its record was made, which the title gets if there is another section of that title.
    pub(super) when: String,
    /// Paragraphs below the title.
    pub(super) lead: Vec<String>,
    /// Findings, each in a sentence, below the paragraphs.
    pub(super) findings: Vec<String>,
    pub(super) blocks: Vec<Block>,
}

/// A part of a section.
pub(super) enum Block {
    Table(PageTable),
    /// Tables that are shown on demand.
    Folded {
        title: String,
        tables: Vec<PageTable>,
    },
    Plots(Vec<Plot>),
    Compare(Comparison),
}

/// A table whose rows can be sorted.
pub(super) struct PageTable {
    pub(super) caption: String,
    pub(super) notes: Vec<String>,
    pub(super) head: Vec<String>,
    /// Number of left-aligned columns.
    pub(super) left: usize,
    /// On a narrow screen, each row is a list of its cells with their headings: for tables of texts.
    pub(super) cards: bool,
    pub(super) rows: Vec<Vec<PageCell>>,
}

impl PageTable {
    /// Whether the cell that names a row is the short name of a scene, which is not broken across lines.
    pub(super) fn is_name(&self, cell: &PageCell) -> bool {
        self.head.first().is_some_and(|head| head == "scene") && cell.text.len() <= 16
    }

    /// The same as a list of cards on a narrow screen.
    pub(super) fn in_cards(self) -> Self {
        Self { cards: true, ..self }
    }
}

/// A cell.
#[derive(Clone, Default)]
pub(super) struct PageCell {
    pub(super) text: String,
    /// What rows are sorted by: a number or a text; empty: below all others.
    pub(super) sort: String,
    /// Lines below the text, in small type.
    pub(super) small: Vec<String>,
    /// A class: `bad` for failures.
    pub(super) class: &'static str,
}

impl PageCell {
    /// A cell with a text alone, sorted by the number that the text begins with, or by the text.
    pub(super) fn new(text: impl Into<String>) -> Self {
        let text = text.into();
        let sort = sort_key(&text);
        let class =
            if text == "WRONG" || text.starts_with("FAILED") || text.ends_with("NOT ALLOWED") { "bad" } else { "" };
        Self { text, sort, small: Vec::new(), class }
    }

    /// A cell with a number and lines below it.
    pub(super) fn number(text: impl Into<String>, value: f64, small: Vec<String>) -> Self {
        Self { text: text.into(), sort: format!("{value}"), small, class: "" }
    }
}

/// The number that a text begins with, or the text; empty for what stands for nothing.
fn sort_key(text: &str) -> String {
    let text = text.trim();
    let is_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | '+' | 'e' | 'E');
    let number = text.split(|c| !is_number(c)).next().unwrap_or_default();
    match number.parse::<f64>() {
        Ok(value) => format!("{value}"),
        Err(_) if text == "-" => String::new(),
        Err(_) => text.to_lowercase(),
    }
}

impl From<TextTable> for PageTable {
    fn from(table: TextTable) -> Self {
        let cells = |row: Vec<String>| row.into_iter().map(PageCell::new).collect();
        Self {
            caption: table.title,
            notes: table.notes,
            head: table.head,
            left: table.left,
            cards: false,
            rows: table.rows.into_iter().map(cells).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_sorted_by_the_number_they_begin_with() {
        let keys = ["11.7 ±3%", "0.0000%", "-", "wgpu", "1.2e-3", "-5 px", "", "44.6 MiB 3.00 s"].map(sort_key);
        assert_eq!(keys, ["11.7", "0", "", "wgpu", "0.0012", "-5", "", "44.6"]);
    }
}
