//! Tables as aligned text and as Markdown.

use std::fmt::Write;

/// A table of short texts. The first `left` columns name the row and are left-aligned; the others hold figures and are
/// right-aligned.
#[derive(Clone, Debug, Default)]
pub struct TextTable {
    /// What the table shows.
    pub title: String,
    /// Lines below the title: units, devices, what is compared.
    pub notes: Vec<String>,
    /// Column headings.
    pub head: Vec<String>,
    /// Rows; each as long as `head`.
    pub rows: Vec<Vec<String>>,
    /// Number of left-aligned columns.
    pub left: usize,
}

impl TextTable {
    /// A table without rows.
    pub fn new(title: impl Into<String>, left: usize, head: &[&str]) -> Self {
        let head = head.iter().map(|s| s.to_string()).collect();
        Self { title: title.into(), notes: Vec::new(), head, rows: Vec::new(), left }
    }

    /// Aligned text with two spaces between the columns.
    pub fn to_text(&self) -> String {
        let width = |s: &String| s.chars().count();
        let columns = self.head.len();
        let widths: Vec<usize> = (0..columns)
            .map(|c| self.rows.iter().chain([&self.head]).map(|row| width(&row[c])).max().unwrap_or(0))
            .collect();
        let mut out = format!("{}\n", self.title);
        for note in &self.notes {
            let _ = writeln!(out, "  {note}");
        }
        let line = |row: &Vec<String>| {
            let cells = (0..columns).map(|c| {
                let pad = " ".repeat(widths[c] - width(&row[c]));
                if c < self.left { format!("{}{pad}", row[c]) } else { format!("{pad}{}", row[c]) }
            });
            cells.collect::<Vec<_>>().join("  ").trim_end().to_string()
        };
        let _ = writeln!(out, "\n  {}", line(&self.head));
        let _ = writeln!(out, "  {}", widths.iter().map(|w| "-".repeat(*w)).collect::<Vec<_>>().join("  "));
        for row in &self.rows {
            let _ = writeln!(out, "  {}", line(row));
        }
        out
    }

    /// A Markdown table under a heading of the second level.
    pub fn to_markdown(&self) -> String {
        let escape = |s: &String| s.replace('|', "\\|");
        let mut out = format!("## {}\n\n", self.title);
        for note in &self.notes {
            let _ = writeln!(out, "{note}  ");
        }
        if !self.notes.is_empty() {
            out.push('\n');
        }
        let line = |row: &Vec<String>| format!("| {} |", row.iter().map(escape).collect::<Vec<_>>().join(" | "));
        let _ = writeln!(out, "{}", line(&self.head));
        let rule = (0..self.head.len()).map(|c| if c < self.left { ":--" } else { "--:" });
        let _ = writeln!(out, "|{}|", rule.collect::<Vec<_>>().join("|"));
        for row in &self.rows {
            let _ = writeln!(out, "{}", line(row));
        }
        out
    }
}

/// A record for people to read: machine, tables, what was left out, credits.
pub(crate) struct Document<'a> {
    /// Title with the date.
    pub(crate) title: String,
    /// Lines about the machine, the commit and anything the reader must know.
    pub(crate) header: Vec<String>,
    /// The tables that have rows.
    pub(crate) tables: Vec<TextTable>,
    /// What was not measured, and why.
    pub(crate) left_out: Vec<[&'a str; 2]>,
    /// Scene, its credit, and the identity of its mesh.
    pub(crate) credits: Vec<[&'a str; 3]>,
}

impl Document<'_> {
    /// Aligned text for a terminal.
    pub(crate) fn to_text(&self) -> String {
        let mut parts = vec![self.header.join("\n") + "\n"];
        parts.extend(self.tables.iter().map(TextTable::to_text));
        if !self.left_out.is_empty() {
            let lines = self.left_out.iter().map(|[what, reason]| format!("  {what}: {reason}\n"));
            parts.push(format!("Left out\n{}", lines.collect::<String>()));
        }
        parts.join("\n")
    }

    /// Markdown.
    pub(crate) fn to_markdown(&self) -> String {
        let mut out = format!("# {}\n\n", self.title);
        for line in &self.header {
            out += &format!("- {line}\n");
        }
        for table in &self.tables {
            out += &format!("\n{}", table.to_markdown());
        }
        if !self.left_out.is_empty() {
            out += "\n## Left out\n\n";
            for [what, reason] in &self.left_out {
                out += &format!("- {what}: {reason}\n");
            }
        }
        out += "\n## Credits\n\n";
        for [scene, credit, identity] in &self.credits {
            out += &format!("- {scene}: {credit} ({identity})\n");
        }
        out
    }
}

/// A number with about three digits: `1234`, `123`, `12.3`, `1.23`, `0.12`; `-` for NaN and infinity.
pub fn short(x: f64) -> String {
    match x.abs() {
        a if !a.is_finite() => "-".into(),
        a if a >= 99.95 => format!("{x:.0}"),
        a if a >= 9.995 => format!("{x:.1}"),
        _ => format!("{x:.2}"),
    }
}

/// A cell of a table: the value, or `-` without one.
pub(crate) fn or_dash(value: Option<String>) -> String {
    value.unwrap_or_else(|| "-".into())
}

/// A text as a field of a CSV file: as RFC 4180 has it.
pub(crate) fn csv_field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alignment_counts_characters() {
        let mut table = TextTable::new("T", 1, &["scene", "µs"]);
        table.rows.push(vec!["a".into(), "1.5 ±".into()]);
        assert_eq!(table.to_text(), "T\n\n  scene     µs\n  -----  -----\n  a      1.5 ±\n");
        assert_eq!(table.to_markdown(), "## T\n\n| scene | µs |\n|:--|--:|\n| a | 1.5 ± |\n");
    }

    #[test]
    fn three_digits() {
        assert_eq!([1234.5, 99.97, 12.34, 9.996, 0.123].map(short), ["1234", "100", "12.3", "10.0", "0.12"]);
        assert_eq!(short(f64::NAN), "-");
    }
}
