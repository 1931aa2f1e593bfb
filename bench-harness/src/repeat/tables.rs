//! What `esvo bench --repeat` prints.

use crate::compare;
use crate::repeat::{Difference, RepeatReport};
use crate::text::TextTable;

/// Differences that are listed, at most.
const MOST: usize = 40;

/// Aligned text for a terminal.
pub fn to_text(report: &RepeatReport) -> String {
    let mut out = format!("{} of {}, repeated\n", report.command, report.first.display());
    out += &table("Machine and software that differ", &report.software);
    out += &table("Results that differ", &report.differences);
    if let Some(times) = &report.times {
        out += &format!("\n{}", compare::to_text(times, false));
    }
    out + &format!("\n{}\n", conclusion(report))
}

fn table(title: &str, differences: &[Difference]) -> String {
    if differences.is_empty() {
        return String::new();
    }
    let mut table = TextTable::new(title, 1, &["where", "before", "after"]);
    if differences.len() > MOST {
        table.notes.push(format!("The first {MOST} of {}.", differences.len()));
    }
    for Difference { place, before, after } in differences.iter().take(MOST) {
        table.rows.push(vec![place.clone(), before.clone(), after.clone()]);
    }
    format!("\n{}", table.to_text())
}

fn conclusion(report: &RepeatReport) -> String {
    let results = match report.differences.len() {
        0 => "octrees, hits and errors are the first record's in every digit".into(),
        1 => "one result differs".to_string(),
        count => format!("{count} results differ"),
    };
    if report.right { results } else { format!("{results}; answers of an engine are WRONG") }
}
