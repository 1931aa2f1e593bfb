//! Which engine is wrong: every comparison of every record, by engine.

use esvo_core::DeviceKind;
use esvo_engines::EngineId;

use super::html::{Answered, Mark, PageCell, PageTable, Question};
use crate::paper_bench::check::Agreement;
use crate::paper_bench::matrix::Variant;
use crate::records::{Found, Record};

/// What the records say of one engine.
pub(super) struct Verdict {
    /// Name of the engine, without its instruction set.
    pub(super) engine: String,
    /// Rays that were compared.
    pub(super) rays: u64,
    /// Those that end elsewhere than the reference's.
    pub(super) different: u64,
    /// What is wrong.
    pub(super) wrong: Vec<String>,
    /// Records in which it is.
    pub(super) records: Vec<String>,
}

#[derive(Default)]
struct Verdicts(Vec<Verdict>);

impl Verdicts {
    fn of(&mut self, engine: &str, record: &str) -> &mut Verdict {
        let index = self.0.iter().position(|v| v.engine == engine).unwrap_or_else(|| {
            let engine = engine.to_owned();
            self.0.push(Verdict { engine, rays: 0, different: 0, wrong: Vec::new(), records: Vec::new() });
            self.0.len() - 1
        });
        let verdict = &mut self.0[index];
        if !verdict.records.iter().any(|known| known == record) {
            verdict.records.push(record.to_owned());
        }
        verdict
    }

    fn add(&mut self, engine: &str, record: &str, agreement: &Agreement, what: impl FnOnce() -> String) {
        let verdict = self.of(engine, record);
        verdict.rays += agreement.pixels;
        verdict.different += agreement.different_voxel;
        if !agreement.passed() {
            verdict.wrong.push(format!("{}: {} ({record})", what(), failure(agreement)));
        }
    }
}

/// What is wrong with a comparison that failed.
fn failure(agreement: &Agreement) -> String {
    let Agreement { pixels, different_voxel, largest_t_difference, other_size, allowed } = *agreement;
    if pixels == 0 {
        return "it gave no answer".into();
    }
    if other_size > 0 {
        return "its pictures have another size".into();
    }
    if agreement.share() > allowed.share {
        let most = (allowed.share * pixels as f64).floor();
        return format!("{different_voxel} of {pixels} rays end elsewhere, and {most:.0} are allowed");
    }
    format!("distances along rays differ by up to {largest_t_difference:.1e}, and {:.1e} is allowed", allowed.t)
}

/// The name of an engine's row: instruction sets are those of `cpu`.
fn engine_of(name: &str, kind: Option<DeviceKind>) -> String {
    let plain = name.split(',').next().unwrap_or(name).trim();
    let is_set = kind == Some(DeviceKind::Cpu) && plain != "reference";
    if is_set { "cpu".into() } else { plain.into() }
}

/// The verdicts on every engine that a record compares.
pub(super) fn verdicts(found: &[Found]) -> Vec<Verdict> {
    let mut all = Verdicts::default();
    for one in found {
        let record = one.name.as_str();
        match &one.record {
            Record::Paper(report) => {
                for (scene, check) in report.scenes.iter().flat_map(|s| s.checks.iter().map(move |c| (s, c))) {
                    all.add(check.backend.name(), record, &check.agreement, || {
                        let what = if check.variant == Variant::Triangles { "" } else { "octree, " };
                        let error = check.error.as_ref().map(|e| format!(": {e}")).unwrap_or_default();
                        format!("{}, {what}{}{error}", scene.name, check.variant.title())
                    });
                }
            }
            Record::Sweep(report) => {
                for (scene, cell) in report.scenes.iter().flat_map(|s| s.cells.iter().map(move |c| (s, c))) {
                    if let Some(agreement) = &cell.agreement {
                        all.add(cell.engine.name(), record, agreement, || {
                            format!("{}, {}", scene.name, scene.setting(cell))
                        });
                    }
                    if cell.error.strange > 0 {
                        let what =
                            format!("{}, {}: {} answers are none", scene.name, scene.setting(cell), cell.error.strange);
                        all.of(cell.engine.name(), record).wrong.push(format!("{what} ({record})"));
                    }
                }
            }
            Record::Rays(report) => {
                for row in &report.engines {
                    let Some(device) = &row.device else { continue };
                    let engine = engine_of(&row.name, Some(device.kind));
                    for (set, cell) in report.sets.iter().zip(&row.cells) {
                        all.add(&engine, record, &cell.agreement, || {
                            format!("{}, {}, {}", report.scene, set.name, row.name)
                        });
                    }
                    if let Some(error) = &row.error {
                        all.of(&engine, record).wrong.push(format!("{}: {error} ({record})", row.name));
                    }
                }
            }
            Record::Needs(report) => {
                for case in &report.cases {
                    for cell in &case.cells {
                        let Some(row) = report.engines.get(cell.engine) else { continue };
                        let engine = engine_of(&row.name, Some(row.device.kind));
                        all.add(&engine, record, &cell.agreement, || {
                            format!("{}, {} levels, {}, {}", case.scene, case.levels, cell.variant.name(), row.name)
                        });
                    }
                }
            }
            Record::Stability(report) => {
                let reference = all.of("reference", record);
                reference.rays += report.cells.iter().map(|cell| cell.cases).sum::<u64>();
                for cell in report.cells.iter().filter(|cell| cell.failures > 0) {
                    let first = cell.failure.as_deref().unwrap_or_default();
                    let what = format!(
                        "hard rays, {}, {}: {} of {} are wrong {first}",
                        cell.set, cell.kind, cell.failures, cell.cases
                    );
                    reference.wrong.push(format!("{what} ({record})"));
                }
                for (what, failures) in [
                    ("mirrored and turned octrees", report.symmetries.iter().map(|row| row.failures).sum()),
                    ("rays that leave a closed shell", report.leaks.misses),
                ] {
                    if failures > 0 {
                        reference.wrong.push(format!("{what}: {failures} are wrong ({record})"));
                    }
                }
                for row in &report.engines {
                    let Some(device) = &row.device else { continue };
                    let verdict = all.of(&engine_of(&row.name, Some(device.kind)), record);
                    verdict.rays += row.rays + row.pixels;
                    verdict.different += row.different;
                    if row.wrong > 0 {
                        let first = row.first.as_deref().unwrap_or("-");
                        verdict.wrong.push(format!(
                            "hard rays, {}: {} of {} are wrong, the first is {first} ({record})",
                            row.name,
                            row.wrong,
                            row.rays + row.pixels
                        ));
                    }
                    if let Some(error) = &row.error {
                        verdict.wrong.push(format!("{}: {error} ({record})", row.name));
                    }
                }
            }
            Record::Build(_) => {}
        }
    }
    // In the order of the list of engines.
    let rank =
        |verdict: &Verdict| EngineId::ALL.iter().position(|id| id.name() == verdict.engine).unwrap_or(usize::MAX);
    all.0.sort_by_key(rank);
    all.0
}

/// The first question of the page.
pub(super) fn question(found: &[Found], verdicts: &[Verdict]) -> Question {
    let wrong: Vec<_> = verdicts.iter().filter(|v| !v.wrong.is_empty()).collect();
    let rays: u64 = verdicts.iter().map(|v| v.rays).sum();
    let mut answers = Vec::new();
    if verdicts.is_empty() {
        let (mark, answer) = (Mark::Plain, "Not known: no record on this page compares engines.".to_string());
        answers.push(Answered { of: String::new(), mark, answer, details: Vec::new() });
    } else if wrong.is_empty() {
        let names: Vec<_> = verdicts.iter().map(|v| v.engine.as_str()).collect();
        let mut details =
            vec![format!("{} gave the right answers in every comparison: {} rays.", listed(&names), in_words(rays))];
        details.extend(controls(found));
        answers.push(Answered { of: String::new(), mark: Mark::Good, answer: "None.".into(), details });
    }
    for verdict in &wrong {
        let shown = verdict.wrong.iter().take(6).cloned();
        let more = verdict.wrong.len().saturating_sub(6);
        let rest = (more > 0).then(|| format!("and {more} more"));
        let details = shown.chain(rest).collect();
        let answer = format!("{} is wrong.", verdict.engine);
        answers.push(Answered { of: String::new(), mark: Mark::Bad, answer, details });
    }
    if !wrong.is_empty() && wrong.len() < verdicts.len() {
        let right: Vec<_> = verdicts.iter().filter(|v| v.wrong.is_empty()).map(|v| v.engine.as_str()).collect();
        let answer = format!("{} {} right.", listed(&right), if right.len() == 1 { "is" } else { "are" });
        answers.push(Answered { of: String::new(), mark: Mark::Plain, answer, details: controls(found) });
    }
    Question {
        id: "wrong",
        question: "Which engine is wrong?".into(),
        rule: "An engine is wrong if its hits are not those of the reference caster: the same voxel and every bit of the distance on \
               the processor, all but one ray in 100,000 on GPUs, which may round otherwise. The reference caster itself is judged by \
               an oracle in double precision. Hits are compared before anything is timed."
            .into(),
        answers,
    }
}

/// Whether the comparisons see mistakes.
fn controls(found: &[Found]) -> Vec<String> {
    let report =
        found.iter().find_map(|one| if let Record::Stability(report) = &one.record { Some(report) } else { None });
    let Some(report) = report.filter(|report| !report.controls.is_empty()) else { return Vec::new() };
    let caught = report.controls.iter().filter(|control| control.caught > 0).count();
    vec![format!(
        "The comparisons see mistakes: of {} kinds that were made on purpose, {caught} were caught.",
        report.controls.len()
    )]
}

/// `a`, `a and b`, `a, b and c`.
pub(super) fn listed(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [one] => (*one).into(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// `393216`, `12.3 million`.
pub(super) fn in_words(count: u64) -> String {
    if count < 1_000_000 { count.to_string() } else { format!("{} million", crate::text::short(count as f64 / 1e6)) }
}

/// A row for every engine.
pub(super) fn table(verdicts: &[Verdict]) -> PageTable {
    let rows = verdicts.iter().map(|v| {
        let (text, class) = if v.wrong.is_empty() { ("right", "good") } else { ("WRONG", "bad") };
        vec![
            PageCell::new(v.engine.clone()),
            PageCell { class, ..PageCell::new(text) },
            PageCell::number(in_words(v.rays), v.rays as f64, Vec::new()),
            PageCell::new(v.different.to_string()),
            PageCell::new(v.wrong.len().to_string()),
            PageCell::new(v.records.join(", ")),
        ]
    });
    PageTable {
        caption: "Engines".into(),
        notes: vec![
            "Other hits: rays that end at another voxel than the reference's, over all records. On GPUs a few are allowed; where the \
             shading language rounds otherwise, hard rays are judged by the oracle."
                .into(),
        ],
        head: ["engine", "verdict", "rays compared", "other hits", "comparisons that failed", "records"].map(Into::into).into(),
        left: 2,
        rows: rows.collect(),
    }
}
