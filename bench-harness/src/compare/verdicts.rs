//! From two records to a verdict on each cell.

use serde::Serialize;

use crate::compare::measured::{MeasuredCell, MeasuredRun, RecordKind};
use crate::compare::ratio::{Ratio, Verdict, ratio};
use crate::output::to_json;

/// Version of the layout of [`CompareReport`]. Fields may be added without a new one.
pub const SCHEMA: u32 = 1;
/// Percent below which a difference is not reported.
pub const DEFAULT_THRESHOLD: f64 = 5.0;

/// What was found; `esvo bench compare --json` prints it.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct CompareReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The first record, which the second is compared with.
    pub before: RunSummary,
    /// The second record.
    pub after: RunSummary,
    /// Differences below this many percent are not reported.
    pub threshold_percent: f64,
    /// Whether times were divided by those of the calibration casts; of GPUs' they never are.
    pub calibrated: bool,
    /// What the reader must know: why times were not divided, engines slowed on purpose, another compiler.
    pub notes: Vec<String>,
    /// Checks of answers that failed in the second record.
    pub wrong: Vec<String>,
    /// Every cell of either record, in the order of the second, those of the first alone at the end.
    pub cells: Vec<ComparedCell>,
}

/// A record in short.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct RunSummary {
    /// The file as given.
    pub file: String,
    /// The benchmark.
    pub kind: RecordKind,
    /// Name of the matrix, plan or scenes.
    pub name: String,
    /// Processor and threads.
    pub machine: String,
    /// `debug` or `release`.
    pub profile: String,
    /// Commit of the source.
    pub commit: String,
    /// Start of the run, UTC.
    pub date: String,
}

/// A cell of either record.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct ComparedCell {
    /// The scene.
    pub scene: String,
    /// The engine.
    pub engine: String,
    /// What was cast, and how.
    pub what: String,
    /// The verdict.
    pub verdict: Verdict,
    /// Why it is incomparable; empty otherwise.
    pub reason: String,
    /// The times; `None` if they were not compared.
    #[serde(flatten)]
    pub ratio: Option<Ratio>,
}

impl CompareReport {
    /// Whether something was compared, nothing was slower, and no answer was wrong.
    pub fn passed(&self) -> bool {
        self.wrong.is_empty() && self.count(Verdict::Slower) == 0 && self.compared() > 0
    }

    /// Cells with this verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.cells.iter().filter(|cell| cell.verdict == verdict).count()
    }

    /// Cells whose times were compared.
    pub fn compared(&self) -> usize {
        self.cells.iter().filter(|cell| cell.ratio.is_some()).count()
    }

    /// As indented JSON.
    pub fn to_json(&self) -> String {
        to_json(self)
    }
}

/// Compares the second record with the first. `files` are their names, `threshold` is in percent.
pub fn compare(before: &MeasuredRun, after: &MeasuredRun, files: [&str; 2], threshold: f64) -> CompareReport {
    let mut notes = Vec::new();
    let calibrated = match calibrations(before, after) {
        None => true,
        Some(why) => {
            notes.push(format!("times are compared as they are, not divided by those of calibration casts: {why}"));
            false
        }
    };
    for (which, run) in [("first", before), ("second", after)] {
        notes.extend(run.slowed.iter().map(|slowed| format!("the {which} record was slowed on purpose: {slowed}")));
    }
    if before.machine.rustc != after.machine.rustc {
        notes.push(format!("other compilers: {} and {}", before.machine.rustc, after.machine.rustc));
    }
    let differs = other_run(before, after);
    let cells = (after.cells.iter().map(|cell| {
        let Some(earlier) = before.cells.iter().find(|earlier| earlier.name == cell.name) else {
            return compared(cell, Verdict::OnlyAfter);
        };
        if let Some(reason) = differs.clone().or_else(|| other_cell(earlier, cell)) {
            return ComparedCell { reason, ..compared(cell, Verdict::Incomparable) };
        }
        let Some(found) = ratio(earlier, cell, calibrated) else {
            return ComparedCell { reason: "no times".into(), ..compared(cell, Verdict::Incomparable) };
        };
        ComparedCell { ratio: Some(found), ..compared(cell, found.verdict(threshold)) }
    }))
    .collect::<Vec<_>>();
    let is_gone = |cell: &&MeasuredCell| after.cells.iter().all(|later| later.name != cell.name);
    let gone = before.cells.iter().filter(is_gone).map(|cell| compared(cell, Verdict::OnlyBefore));
    CompareReport {
        schema: SCHEMA,
        before: summary(before, files[0]),
        after: summary(after, files[1]),
        threshold_percent: threshold,
        calibrated,
        notes,
        wrong: after.wrong.clone(),
        cells: cells.into_iter().chain(gone).collect(),
    }
}

/// Whether some cell of both can be compared.
pub(crate) fn is_comparable(before: &MeasuredRun, after: &MeasuredRun) -> bool {
    let same = |cell: &MeasuredCell| {
        let earlier = before.cells.iter().find(|earlier| earlier.name == cell.name);
        earlier.is_some_and(|earlier| other_cell(earlier, cell).is_none())
    };
    other_run(before, after).is_none() && after.cells.iter().any(same)
}

fn compared(cell: &MeasuredCell, verdict: Verdict) -> ComparedCell {
    let [scene, engine, what] = cell.name.clone();
    ComparedCell { scene, engine, what, verdict, reason: String::new(), ratio: None }
}

fn summary(run: &MeasuredRun, file: &str) -> RunSummary {
    let machine = &run.machine;
    RunSummary {
        file: file.into(),
        kind: run.kind,
        name: run.name.clone(),
        machine: format!("{}, {} threads", machine.cpu, machine.threads),
        profile: machine.profile.clone(),
        commit: machine.commit.clone(),
        date: machine.date.clone(),
    }
}

/// Why no cell of the two can be compared; `None` if they can.
fn other_run(before: &MeasuredRun, after: &MeasuredRun) -> Option<String> {
    let (a, b) = (&before.machine, &after.machine);
    if before.kind != after.kind {
        return Some(format!("another benchmark: {} and {}", before.kind.name(), after.kind.name()));
    }
    if a.slug() != b.slug() {
        return Some(format!("another machine: {}, {} threads and {}, {} threads", a.cpu, a.threads, b.cpu, b.threads));
    }
    (a.profile != b.profile).then(|| format!("another build: {} and {}", a.profile, b.profile))
}

/// Why two cells cannot be compared; `None` if they can.
fn other_cell(before: &MeasuredCell, after: &MeasuredCell) -> Option<String> {
    // Hashes and cameras say nothing in a table.
    let short = |value: &str| value.chars().count() <= 40;
    let differs = |(name, value): &(&'static str, String)| {
        let (_, earlier) = before.same.iter().find(|(other, _)| other == name)?;
        let values = || format!(": {earlier} and {value}");
        (earlier != value)
            .then(|| format!("other {name}{}", if short(earlier) && short(value) { values() } else { String::new() }))
    };
    let all: Vec<String> = after.same.iter().filter_map(differs).collect();
    if !all.is_empty() {
        return Some(all.join("; "));
    }
    let views = |cell: &MeasuredCell| cell.seconds.first().map_or(0, Vec::len);
    let (a, b) = (views(before), views(after));
    (a != b && a > 0 && b > 0).then(|| format!("{a} and {b} views"))
}

/// Why times cannot be divided by those of calibration casts; `None` if they can.
fn calibrations(before: &MeasuredRun, after: &MeasuredRun) -> Option<String> {
    let (Some(a), Some(b)) = (&before.calibration, &after.calibration) else {
        let which = if before.calibration.is_none() { "first" } else { "second" };
        return Some(format!("the {which} record has none"));
    };
    if a.version != b.version {
        return Some(format!("they are of versions {} and {}", a.version, b.version));
    }
    if a.threads != b.threads {
        return Some(format!("they ran on {} and {} threads", a.threads, b.threads));
    }
    (a != b).then(|| "their answers differ: the kernel was changed without a new version".into())
}
