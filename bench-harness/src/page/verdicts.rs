//! Which engine is wrong: every comparison of every record, by engine.

use std::collections::BTreeSet;

use esvo_core::testing::compare::Allowed;
use esvo_core::{Device, DeviceKind};
use esvo_engines::EngineId;

use super::html::{Answered, Mark, PageCell, PageTable, Question};
use super::machines::OnMachine;
use crate::paper_bench::check::Agreement;
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::report::DeviceRecord;
use crate::records::{Found, Record};
use crate::stability_bench::StabilityReport;

/// What the records of a machine say of one engine on one device.
pub(super) struct Verdict {
    /// Name of the engine, without its instruction set.
    pub(super) engine: String,
    /// What it ran on; `None`: the records do not say.
    pub(super) device: Option<(String, DeviceKind)>,
    /// How its hits were judged.
    rules: BTreeSet<Rule>,
    /// Rays that were compared.
    pub(super) rays: u64,
    /// Those that end elsewhere than the reference's.
    pub(super) different: u64,
    /// What is wrong.
    pub(super) wrong: Vec<String>,
    /// Records in which it is.
    pub(super) records: Vec<String>,
}

/// The engine that the others are compared with.
const REFERENCE: &str = "reference";

/// How hits are judged.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Rule {
    /// By the oracle in double precision.
    Oracle,
    /// They must be the reference's in every bit.
    Equal,
    /// Hits of triangles must be the exact answer in every bit.
    EqualTriangles,
    /// Differences from the reference are counted, and few are allowed: in words, how many.
    Counted(String),
    /// Where hard rays differ from the reference's, the oracle judges.
    OracleOfDifferences,
}

impl Rule {
    fn of(agreement: &Agreement, triangles: bool) -> Self {
        let allowed = agreement.allowed;
        match (triangles, allowed == Allowed::EXACT) {
            (true, _) => Self::EqualTriangles,
            (false, true) => Self::Equal,
            (false, false) if allowed.share == 0.0 => {
                Self::Counted(format!("none may end elsewhere, {}", distances(allowed.t)))
            }
            (false, false) => {
                let one_in = (1.0 / allowed.share).round();
                let t = if allowed.t == 0.0 { "distances in every bit".into() } else { distances(allowed.t) };
                Self::Counted(format!("at most 1 ray in {one_in} may end elsewhere, {t}"))
            }
        }
    }

    fn words(&self) -> String {
        match self {
            Self::Oracle => "the oracle, in double precision".into(),
            Self::Equal => "bit-equal to the reference".into(),
            Self::EqualTriangles => "triangles: bit-equal to the exact answer".into(),
            Self::Counted(how) => format!("counted differences from the reference: {how}"),
            Self::OracleOfDifferences => "hard rays that differ: the oracle".into(),
        }
    }
}

/// How far distances may be off, with its unit.
fn distances(t: f64) -> String {
    format!("distances within {:.3} % of the ray's length", 100.0 * t)
}

#[derive(Default)]
struct Verdicts(Vec<Verdict>);

impl Verdicts {
    fn of(&mut self, engine: &str, device: Option<(&str, DeviceKind)>, record: &str) -> &mut Verdict {
        // Records name the device of the reference in several ways, or not at all. It is the processor.
        let device = device.filter(|_| engine != REFERENCE).map(|(name, kind)| (name.to_owned(), kind));
        let index = self.0.iter().position(|v| v.engine == engine && v.device == device).unwrap_or_else(|| {
            let (engine, rules) = (engine.to_owned(), BTreeSet::new());
            let (wrong, records) = (Vec::new(), Vec::new());
            self.0.push(Verdict { engine, device, rules, rays: 0, different: 0, wrong, records });
            self.0.len() - 1
        });
        let verdict = &mut self.0[index];
        if !verdict.records.iter().any(|known| known == record) {
            verdict.records.push(record.to_owned());
        }
        verdict
    }
}

impl Verdict {
    fn add(&mut self, record: &str, agreement: &Agreement, triangles: bool, what: impl FnOnce() -> String) {
        self.rays += agreement.pixels;
        self.different += agreement.different_voxel;
        if self.engine != REFERENCE {
            self.rules.insert(Rule::of(agreement, triangles));
        }
        if !agreement.passed() {
            self.wrong.push(format!("{}: {} ({record})", what(), failure(agreement)));
        }
    }

    fn is_software(&self) -> bool {
        matches!(self.device, Some((_, DeviceKind::SoftwareGpu)))
    }

    /// What it ran on, for people; `machine` is the processor of those whose records do not say.
    fn device(&self, processor: &str) -> String {
        match &self.device {
            Some((name, DeviceKind::Cpu)) => format!("{name}, the processor"),
            Some((name, DeviceKind::Gpu)) => format!("{name}, a GPU"),
            Some((name, DeviceKind::SoftwareGpu)) => format!("{name}: software on the processor, no GPU"),
            None if self.engine == REFERENCE => format!("{processor}, the processor"),
            None => "not known".into(),
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
    format!(
        "distances along rays differ by up to {largest_t_difference:.1e} of the ray's length, and {:.1e} of it is allowed",
        allowed.t
    )
}

/// The name of an engine's row: instruction sets are those of `cpu`.
fn engine_of(name: &str, kind: Option<DeviceKind>) -> String {
    let plain = name.split(',').next().unwrap_or(name).trim();
    let is_set = kind == Some(DeviceKind::Cpu) && plain != REFERENCE;
    if is_set { "cpu".into() } else { plain.into() }
}

/// The device of an engine in a record's list.
fn among(devices: &[DeviceRecord], engine: EngineId) -> Option<(&str, DeviceKind)> {
    devices.iter().find(|d| d.backend == engine).map(|d| (d.name.as_str(), d.kind))
}

fn on(device: &Device) -> Option<(&str, DeviceKind)> {
    Some((&device.name, device.kind))
}

/// The verdicts on every engine that these records compare.
pub(super) fn verdicts(found: &[&Found]) -> Vec<Verdict> {
    let mut all = Verdicts::default();
    for one in found {
        let record = one.name.as_str();
        match &one.record {
            Record::Paper(report) => {
                for (scene, check) in report.scenes.iter().flat_map(|s| s.checks.iter().map(move |c| (s, c))) {
                    let triangles = check.variant == Variant::Triangles;
                    let device = among(&report.devices, check.backend);
                    all.of(check.backend.name(), device, record).add(record, &check.agreement, triangles, || {
                        let what = if triangles { "" } else { "octree, " };
                        let error = check.error.as_ref().map(|e| format!(": {e}")).unwrap_or_default();
                        format!("{}, {what}{}{error}", scene.name, check.variant.title())
                    });
                }
            }
            Record::Sweep(report) => {
                for (scene, cell) in report.scenes.iter().flat_map(|s| s.cells.iter().map(move |c| (s, c))) {
                    let device = among(&report.devices, cell.engine);
                    if let Some(agreement) = &cell.agreement {
                        all.of(cell.engine.name(), device, record)
                            .add(record, agreement, false, || format!("{}, {}", scene.name, scene.setting(cell)));
                    }
                    if cell.error.strange > 0 {
                        let what =
                            format!("{}, {}: {} answers are none", scene.name, scene.setting(cell), cell.error.strange);
                        all.of(cell.engine.name(), device, record).wrong.push(format!("{what} ({record})"));
                    }
                }
            }
            Record::Rays(report) => {
                for row in &report.engines {
                    let Some(device) = &row.device else { continue };
                    let verdict = all.of(&engine_of(&row.name, Some(device.kind)), on(device), record);
                    for (set, cell) in report.sets.iter().zip(&row.cells) {
                        verdict.add(record, &cell.agreement, false, || {
                            format!("{}, {}, {}", report.scene, set.name, row.name)
                        });
                    }
                    if let Some(error) = &row.error {
                        verdict.wrong.push(format!("{}: {error} ({record})", row.name));
                    }
                }
            }
            Record::Needs(report) => {
                for case in &report.cases {
                    for cell in &case.cells {
                        let Some(row) = report.engines.get(cell.engine) else { continue };
                        let engine = engine_of(&row.name, Some(row.device.kind));
                        all.of(&engine, on(&row.device), record).add(record, &cell.agreement, false, || {
                            format!("{}, {} levels, {}, {}", case.scene, case.levels, cell.variant.name(), row.name)
                        });
                    }
                }
            }
            Record::Stability(report) => hard_rays(&mut all, report, record),
            // A voxelizer is no engine, and neither is a bit volume: their own tables say what they miss.
            Record::Build(_) | Record::Voxelize(_) | Record::Shadow(_) => {}
        }
    }
    // In the order of the list of engines.
    let rank =
        |verdict: &Verdict| EngineId::ALL.iter().position(|id| id.name() == verdict.engine).unwrap_or(usize::MAX);
    all.0.sort_by_key(rank);
    all.0
}

fn hard_rays(all: &mut Verdicts, report: &StabilityReport, record: &str) {
    let reference = all.of(REFERENCE, None, record);
    reference.rules.insert(Rule::Oracle);
    reference.rays += report.cells.iter().map(|cell| cell.cases).sum::<u64>();
    for cell in report.cells.iter().filter(|cell| cell.failures > 0) {
        let first = cell.failure.as_deref().unwrap_or_default();
        let what =
            format!("hard rays, {}, {}: {} of {} are wrong {first}", cell.set, cell.kind, cell.failures, cell.cases);
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
        let engine = engine_of(&row.name, Some(device.kind));
        let verdict = all.of(&engine, on(device), record);
        verdict.rays += row.rays + row.pixels;
        verdict.different += row.different;
        // As the benchmark has it: what the engine is held to, whatever it runs on.
        let exact = engine.parse::<EngineId>().is_ok_and(|id| id.allowed() == Allowed::EXACT);
        verdict.rules.insert(if exact { Rule::Equal } else { Rule::OracleOfDifferences });
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

/// The first question of the page: of every machine, which engines are wrong, and a row for each engine.
pub(super) fn question(machines: &[(OnMachine<'_>, Vec<Verdict>)]) -> Question {
    let several = machines.len() > 1;
    let mut answers = Vec::new();
    for (machine, verdicts) in machines {
        let first = answers.len();
        answers.extend(answers_of(&machine.found, verdicts));
        if several {
            answers[first..].iter_mut().for_each(|answer| answer.of.clone_from(&machine.name));
        }
    }
    let table = engines(machines);
    Question {
        id: "wrong",
        question: "Which engine is wrong?".into(),
        machine: if several { String::new() } else { machines.first().map(|(m, _)| m.name.clone()).unwrap_or_default() },
        rule: "An engine is wrong if its hits are not those of the reference caster: the same voxel and every bit of the distance on \
               the processor, all but one ray in 100,000 on GPUs, which may round otherwise. The reference caster itself is judged by \
               an oracle in double precision. Hits are compared before anything is timed."
            .into(),
        answers,
        table: (!table.rows.is_empty()).then_some(table),
    }
}

fn answers_of(found: &[&Found], verdicts: &[Verdict]) -> Vec<Answered> {
    let wrong: Vec<_> = verdicts.iter().filter(|v| !v.wrong.is_empty()).collect();
    let rays: u64 = verdicts.iter().map(|v| v.rays).sum();
    let mut answers = Vec::new();
    let mut say = |mark, answer: String, details| {
        answers.push(Answered { mark, answer, details, ..Answered::default() });
    };
    let names = |wrong: bool| {
        let mut names: Vec<&str> = Vec::new();
        for v in verdicts.iter().filter(|v| v.wrong.is_empty() != wrong) {
            if !names.contains(&v.engine.as_str()) {
                names.push(&v.engine);
            }
        }
        names
    };
    if verdicts.is_empty() {
        say(Mark::Plain, "Not known: no record on this page compares engines.".into(), Vec::new());
    } else if wrong.is_empty() {
        let mut details = vec![format!(
            "{} gave the right answers in every comparison: {} rays.",
            listed(&names(false)),
            in_words(rays)
        )];
        details.extend(controls(found));
        say(Mark::Good, "None.".into(), details);
    }
    for verdict in &wrong {
        let shown = verdict.wrong.iter().take(6).cloned();
        let more = verdict.wrong.len().saturating_sub(6);
        let rest = (more > 0).then(|| format!("and {more} more"));
        say(Mark::Bad, format!("{} is wrong.", verdict.engine), shown.chain(rest).collect());
    }
    if !wrong.is_empty() && wrong.len() < verdicts.len() {
        let right = names(false);
        let answer = format!("{} {} right.", listed(&right), if right.len() == 1 { "is" } else { "are" });
        say(Mark::Plain, answer, controls(found));
    }
    answers
}

/// Whether the comparisons see mistakes.
fn controls(found: &[&Found]) -> Vec<String> {
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

/// A row for every engine: what it runs on, how it is judged, and the verdict.
fn engines(machines: &[(OnMachine<'_>, Vec<Verdict>)]) -> PageTable {
    let several = machines.len() > 1;
    let mut head: Vec<String> =
        ["engine", "verdict", "device", "software", "judged by", "rays compared", "other hits"].map(Into::into).into();
    if several {
        head.insert(2, "machine".into());
    }
    let mut rows = Vec::new();
    for (machine, verdicts) in machines {
        let processor = machine.found.first().map_or("unknown", |one| one.record.machine().cpu.as_str());
        for v in verdicts {
            let rules: Vec<String> = v.rules.iter().map(Rule::words).collect();
            let mut row = vec![
                PageCell::new(v.engine.clone()),
                verdict(v),
                PageCell::new(v.device(processor)),
                PageCell::new(if v.is_software() { "yes" } else { "no" }),
                PageCell::new(if rules.is_empty() {
                    "it is what others are compared with".into()
                } else {
                    rules.join("; ")
                }),
                PageCell::number(in_words(v.rays), v.rays as f64, Vec::new()),
                PageCell::new(v.different.to_string()),
            ];
            if several {
                row.insert(2, PageCell::new(machine.name.clone()));
            }
            rows.push(row);
        }
    }
    PageTable {
        caption: "Engines".into(),
        notes: vec![
            "Other hits: rays that end at another voxel, or at another distance, than the reference's. Where the rule counts differences, \
             a few are allowed. A ray of a picture is as long as it is to the far plane."
                .into(),
        ],
        left: head.len() - 2,
        head,
        cards: true,
        rows,
    }
}

fn verdict(v: &Verdict) -> PageCell {
    let (text, class) = if v.wrong.is_empty() { ("right", "good") } else { ("WRONG", "bad") };
    PageCell { class, ..PageCell::new(text) }
}

/// The records that each engine was compared in.
pub(super) fn table(machines: &[(OnMachine<'_>, Vec<Verdict>)]) -> PageTable {
    let rows = machines.iter().flat_map(|(machine, verdicts)| verdicts.iter().map(move |v| (machine, v))).map(
        |(machine, v)| {
            vec![
                PageCell::new(v.engine.clone()),
                verdict(v),
                PageCell::new(machine.name.clone()),
                PageCell::new(v.records.join(", ")),
                PageCell::new(v.wrong.len().to_string()),
            ]
        },
    );
    PageTable {
        caption: "Comparisons of each engine".into(),
        notes: Vec::new(),
        head: ["engine", "verdict", "machine", "records", "comparisons that failed"].map(Into::into).into(),
        left: 4,
        cards: true,
        rows: rows.collect(),
    }
}
