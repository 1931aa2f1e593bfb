//! What `esvo bench compare` prints.

use crate::compare::ratio::Verdict;
use crate::compare::verdicts::{CompareReport, ComparedCell, RunSummary};
use crate::text::{TextTable, or_dash, short};

/// Aligned text for a terminal. Cells that did not move are listed only if `all` is set.
pub fn to_text(report: &CompareReport, all: bool) -> String {
    let mut out = header(report).join("\n") + "\n";
    if let Some(table) = table(report, all) {
        out += &format!("\n{}", table.to_text());
    }
    out + &format!("\n{}\n", conclusion(report))
}

/// Markdown.
pub fn to_markdown(report: &CompareReport, all: bool) -> String {
    let mut out = String::new();
    for line in header(report) {
        out += &format!("- {line}\n");
    }
    if let Some(table) = table(report, all) {
        out += &format!("\n{}", table.to_markdown());
    }
    out + &format!("\n{}\n", conclusion(report))
}

fn header(report: &CompareReport) -> Vec<String> {
    let run = |which: &str, run: &RunSummary| {
        let RunSummary { file, kind: _, name, machine, profile, commit, date } = run;
        format!("{which} {file}: `{name}`, {date}, commit {commit}, {profile} build, {machine}")
    };
    let mut lines = vec![run("before:", &report.before), run("after: ", &report.after)];
    lines.extend(report.notes.iter().map(|note| format!("note:   {note}")));
    lines.extend(report.wrong.iter().map(|wrong| format!("WRONG:  answers of {wrong}")));
    lines
}

/// The cells that moved, or all.
fn table(report: &CompareReport, all: bool) -> Option<TextTable> {
    let head = ["scene", "engine", "what", "", "before ms", "after ms", "machine", "ratio", "interval", "times"];
    let mut table = TextTable::new(if all { "Cells" } else { "Cells that moved" }, 4, &head);
    table.notes = vec![
        "ms: least time of each view over the rounds, mean over the views.".into(),
        "machine: how much longer the calibration casts next to the cell took.".into(),
        format!(
            "ratio: after / before{}, and 95 % of what resampled rounds give; differences below {} % are not reported.",
            if report.calibrated { ", of processor times at equal speed of the machine" } else { "" },
            short(report.threshold_percent)
        ),
        "times: the same of the times themselves, which count what other programs took.".into(),
    ];
    let order = |cell: &&ComparedCell| {
        let rank = [Verdict::Slower, Verdict::Faster, Verdict::Same, Verdict::Incomparable, Verdict::OnlyBefore];
        rank.iter().position(|verdict| *verdict == cell.verdict).unwrap_or(rank.len())
    };
    let mut cells: Vec<_> = report.cells.iter().filter(|cell| all || cell.verdict != Verdict::Same).collect();
    cells.sort_by_key(order);
    let factor = |x: f64| format!("{x:.3}");
    for cell in cells {
        let ratio = cell.ratio;
        let verdict = match cell.reason.as_str() {
            "" => cell.verdict.title().to_string(),
            reason => format!("{}: {reason}", cell.verdict.title()),
        };
        table.rows.push(vec![
            cell.scene.clone(),
            cell.engine.clone(),
            cell.what.clone(),
            verdict,
            or_dash(ratio.map(|r| short(r.before_ms))),
            or_dash(ratio.map(|r| short(r.after_ms))),
            or_dash(ratio.and_then(|r| r.machine).map(factor)),
            or_dash(ratio.map(|r| factor(r.ratio))),
            or_dash(ratio.map(|r| format!("{:.3} to {:.3}", r.low, r.high))),
            or_dash(ratio.and_then(|r| r.time_ratio).map(factor)),
        ]);
    }
    (!table.rows.is_empty()).then_some(table)
}

/// The last line.
fn conclusion(report: &CompareReport) -> String {
    let count = |verdict| report.count(verdict);
    let mut parts = vec![
        format!("{} slower", count(Verdict::Slower)),
        format!("{} faster", count(Verdict::Faster)),
        format!("{} the same", count(Verdict::Same)),
    ];
    for (verdict, words) in [
        (Verdict::Incomparable, "incomparable"),
        (Verdict::OnlyBefore, "only before"),
        (Verdict::OnlyAfter, "only after"),
    ] {
        if count(verdict) > 0 {
            parts.push(format!("{} {words}", count(verdict)));
        }
    }
    format!("{} cells: {}", report.cells.len(), parts.join(", "))
}
