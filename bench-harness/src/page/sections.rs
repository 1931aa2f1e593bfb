//! The order of the page, and the sections that are made of tables that the benchmarks print anyway.

use super::between::{Between, DISTURBED};
use super::html::{Answers, Block, Contents, PageTable, Section};
use super::machines::{OnMachine, by_machine};
use super::{
    answers, glossary, gpu, in_words, paper_tables, pictures, plot, settings, shadow_plots, sources, verdicts,
    voxel_plots,
};
use crate::build_bench::BuildReport;
use crate::paper_bench::figures::{built_sizes, sizes, viewpoints};
use crate::paper_bench::paper::Paper;
use crate::paper_bench::report::PaperReport;
use crate::paper_bench::tables::{bytes_by_kind, checks, errors, fits};
use crate::records::{Found, Record};
use crate::sweep_bench::SweepReport;
use crate::text::{TextTable, short};

/// Everything on the page, and what is not on it.
pub(super) fn contents(found: &[Found], picture_bytes: u64) -> (Contents, Vec<String>) {
    let machines = by_machine(found);
    let (comparisons, left_out) = pictures::comparisons(found, picture_bytes);
    let count = comparisons.iter().map(|one| one.shots.len()).sum();

    let mut sections: Vec<Section> = machines.iter().flat_map(of_machine).collect();
    let global = |id: &str, title: &str, lead: Vec<String>, blocks| Section {
        id: id.into(),
        title: title.into(),
        machine: String::new(),
        when: String::new(),
        lead,
        findings: Vec::new(),
        blocks,
    };
    if !comparisons.is_empty() {
        let lead = vec!["The same view in the same light. Move the line to compare.".into()];
        sections.push(global("pictures", "Pictures", lead, comparisons.into_iter().map(Block::Compare).collect()));
    }
    let answers = machines.iter().map(answers_of).collect();
    let last = sources::section(&machines, &left_out);
    let lead = lead(found, &machines);
    let judged: Vec<_> = machines
        .into_iter()
        .map(|machine| {
            let verdicts = verdicts::verdicts(&machine.found);
            (machine, verdicts)
        })
        .collect();
    let table = verdicts::table(&judged);
    if !table.rows.is_empty() {
        sections.push(global("engines", "What was compared", Vec::new(), vec![Block::Table(table)]));
    }
    sections.push(last);
    name_apart(&mut sections);
    let mut wrong: Vec<String> = Vec::new();
    for verdict in judged.iter().flat_map(|(_, verdicts)| verdicts) {
        if !verdict.wrong.is_empty() && !wrong.contains(&verdict.engine) {
            wrong.push(verdict.engine.clone());
        }
    }
    let contents = Contents {
        lead,
        wrong_engine: verdicts::question(&judged),
        machines: answers,
        terms: glossary::TERMS,
        sections,
        wrong,
        pictures: count,
    };
    (contents, left_out)
}

/// What the newest sweep of a machine answers, and what its records say together.
fn answers_of(machine: &OnMachine) -> Answers {
    let sweep =
        machine.found.iter().find_map(|one| if let Record::Sweep(report) = &one.record { Some(report) } else { None });
    let mut questions = sweep.map(|report| answers::questions(report, machine)).unwrap_or_default();
    let lead = if sweep.is_none() {
        let what = "What settings give an error in the least time, whether contours pay, where triangles win and what the beam saves";
        vec![format!("{what} is not answered for this machine: it has no record of `esvo bench sweep`.")]
    } else {
        Vec::new()
    };
    let between = Between::of(machine);
    questions.extend(gpu::question(machine, between.has_slow_clocks()));
    questions.extend(between.question());
    Answers { machine: machine.name.clone(), id: machine.id.clone(), lead, questions }
}

/// The sections of one machine.
fn of_machine(machine: &OnMachine) -> Vec<Section> {
    let paper = Paper::figures();
    let found = &machine.found;
    let between = Between::of(machine);
    let mut sections = Vec::new();
    for one in found {
        if let Record::Sweep(report) = &one.record {
            let mut section = sweep(report, machine, &machine.when(one));
            section.lead.extend(between.beside_times(one));
            sections.push(section);
        }
    }
    // Whole tables first, then those that have a part of the columns.
    let whole = |report: &PaperReport| report.scenes.iter().any(|scene| !scene.builds.is_empty());
    for with_octrees in [true, false] {
        for one in found {
            if let Record::Paper(report) = &one.record
                && whole(report) == with_octrees
            {
                sections.extend(tables(report, &machine.when(one), &paper, &between, one));
            }
        }
    }
    for one in found {
        if let Record::Build(report) = &one.record {
            let section = builds(report, &machine.when(one), &paper);
            sections.extend(section.map(|mut section| {
                section.lead.extend(between.beside_sizes(one));
                section
            }));
        }
    }
    for one in found {
        sections.extend(others(one, &machine.when(one)).map(|mut section| {
            section.lead.extend(between.beside_times(one));
            section
        }));
    }
    sections.extend(between.section());
    for section in &mut sections {
        section.machine.clone_from(&machine.name);
    }
    sections
}

/// The lines below the title.
fn lead(found: &[Found], machines: &[OnMachine]) -> Vec<String> {
    let days: Vec<&str> = found.iter().map(|one| one.record.machine().day()).collect();
    let when = match (days.iter().min(), days.iter().max()) {
        (Some(a), Some(b)) if a != b => format!("{a} to {b}"),
        (Some(a), _) => (*a).to_owned(),
        _ => String::new(),
    };
    if let [one] = machines {
        return vec![format!("Measured {when} on one machine: {}.", one.name)];
    }
    let mut lines = vec![format!(
        "Measured {when} on {} machines. Answers, tables and plots name theirs; times of different machines are nowhere compared.",
        machines.len()
    )];
    lines.extend(machines.iter().map(|machine| {
        let count = machine.found.len();
        format!("{}: {count} {}.", machine.name, if count == 1 { "record" } else { "records" })
    }));
    lines
}

/// A section of a sweep.
fn sweep(report: &SweepReport, machine: &OnMachine, when: &str) -> Section {
    let [width, height] = report.plan.size;
    let mut lead = vec![format!(
        "Every setting that was measured, as error against time: the nearer to the lower left corner, the better. The line joins the \
         Pareto front: the settings of octrees that no other beats in both; from each of them a line goes from the least time to the lower \
         quartile of the rounds. {width}x{height} pixels, up to {} views a scene, {} rounds. Point at a mark for its setting, touch it, or go to it by arrow keys.",
        report.plan.views, report.plan.rounds
    )];
    if let Some(ratio) = answers::disturbance(report).filter(|ratio| *ratio > DISTURBED) {
        lead.push(format!(
            "Other programs ran meanwhile: a frame took {} times its least time in the middle of the rounds. What is within the \
             spread of the rounds is no difference.",
            short(ratio)
        ));
    }
    let mut blocks = Vec::new();
    for scene in &report.scenes {
        blocks.push(Block::Plots(plot::plots(report, scene)));
        blocks.push(Block::Table(settings::settings(report, scene, false)));
        blocks.push(Block::Folded {
            title: format!("All settings of {}", scene.name),
            tables: vec![settings::settings(report, scene, true)],
        });
    }
    blocks.push(folded("The octrees", [crate::sweep_bench::tables::octrees(report)]));
    let answered = crate::sweep_bench::answers::answers(report);
    // The other questions are answered above, with the spread of their times. This one has none.
    let levels_saved = answered.into_iter().take(1).map(|answer| {
        let mut table = TextTable::new(answer.question, 4, &["scene", "engine", "error", "answer"]);
        table.notes.push(answer.rule.into());
        table.rows = answer.rows.into_iter().map(Vec::from).collect();
        PageTable::from(table)
    });
    let tables = levels_saved.chain([answers::termination(report, machine)]);
    blocks.push(Block::Folded {
        title: "Levels that contours save, and coarser termination".into(),
        tables: tables.filter(|table| !table.rows.is_empty()).collect(),
    });
    Section { lead, ..section("sweep", "Error against time", when, blocks) }
}

/// A section without words, of the record that was made then.
fn section(id: &str, title: &str, when: &str, blocks: Vec<Block>) -> Section {
    Section {
        id: id.into(),
        title: title.into(),
        machine: String::new(),
        when: when.into(),
        lead: Vec::new(),
        findings: Vec::new(),
        blocks,
    }
}

/// Gives sections of the same title the dates of their records, and every section an id of its own.
fn name_apart(sections: &mut [Section]) {
    let titles: Vec<[String; 2]> = sections.iter().map(|s| [s.title.clone(), s.machine.clone()]).collect();
    let mut known: Vec<String> = Vec::new();
    for section in sections {
        let own = [section.title.clone(), section.machine.clone()];
        if titles.iter().filter(|title| **title == own).count() > 1 && !section.when.is_empty() {
            section.title = format!("{} ({})", section.title, section.when);
        }
        let same = known.iter().filter(|id| **id == section.id).count();
        known.push(section.id.clone());
        if same > 0 {
            section.id = format!("{}-{}", section.id, same + 1);
        }
    }
}

fn folded(title: impl Into<String>, tables: impl IntoIterator<Item = TextTable>) -> Block {
    let tables = tables.into_iter().filter(|table| !table.rows.is_empty()).map(PageTable::from).collect();
    Block::Folded { title: title.into(), tables }
}

/// The paper's tables.
fn tables(report: &PaperReport, when: &str, paper: &Paper, between: &Between, one: &Found) -> Vec<Section> {
    let mut sections = Vec::new();
    let rows = sizes(report, paper);
    if !rows.is_empty() {
        let blocks = vec![
            Block::Table(paper_tables::table1(&rows, paper)),
            Block::Table(fits(&rows).into()),
            folded("Bytes per voxel by kind", [bytes_by_kind(report)]),
        ];
        sections.push(Section {
            lead: between.beside_sizes(one),
            ..section("table-1", "Table 1: size and time of building", when, blocks)
        });
    }
    let mut blocks: Vec<Block> = Vec::new();
    for device in &report.devices {
        let table = paper_tables::table2(report, paper, device);
        if !table.rows.is_empty() {
            blocks.push(Block::Table(table));
        }
    }
    blocks.extend(paper_tables::columns(report, paper).map(Block::Table));
    blocks.push(folded("Error against the triangles", [errors(report)]));
    blocks.push(folded("Answers of every engine, compared before timing", [checks(report)]));
    let mut lead = vec![format!(
        "Rays end at voxels of one pixel, as in the paper. A cell that says WRONG was not timed: its answers are wrong. {}",
        viewpoints(report)
    )];
    lead.extend(between.beside_times(one));
    sections.push(Section { lead, ..section("table-2", "Table 2: rays per second", when, blocks) });
    sections
}

/// Table 1 of `esvo bench build`.
fn builds(report: &BuildReport, when: &str, paper: &Paper) -> Option<Section> {
    let rows = built_sizes(report, paper);
    (!rows.is_empty()).then(|| Section {
        lead: vec!["Each octree was built in a process of its own; seconds end with the complete file.".into()],
        ..section(
            "built",
            "Table 1 by esvo bench build",
            when,
            vec![Block::Table(paper_tables::table1(&rows, paper)), Block::Table(fits(&rows).into())],
        )
    })
}

/// Sections of sentences and of the tables that a benchmark prints.
fn others(one: &Found, when: &str) -> Option<Section> {
    let shown = |tables: Vec<TextTable>| tables.into_iter().filter(|table| !table.rows.is_empty()).collect::<Vec<_>>();
    let whole =
        |tables: Vec<TextTable>| shown(tables).into_iter().map(|table| Block::Table(table.into())).collect::<Vec<_>>();
    Some(match &one.record {
        Record::Rays(report) => Section {
            lead: vec![
                "Rays as a program casts them that lights a picture, and rays that have nothing in common, in millions per second (median of \
                 the rounds)."
                    .into(),
            ],
            ..section("rays", "Incoherent rays", when, whole(crate::ray_bench::tables::tables(report)))
        },
        Record::Stability(report) => Section {
            lead: vec![
                "Rays and octrees that are made to break casters: along faces and through corners, with denormal and huge numbers. No times."
                    .into(),
            ],
            findings: in_words::stability(report),
            ..section(
                "stability",
                "Hard rays",
                when,
                vec![
                    Block::Table(in_words::hard_engines(report)),
                    folded("By octree and by kind of rays, meshes, symmetries, mistakes on purpose", shown(crate::stability_bench::tables::tables(report))),
                ],
            )
        },
        Record::Needs(report) => Section {
            lead: vec![
                "Casters can leave out code for contours, far pointers, the test of sizes and spare frames of the stack. If octree and rays need \
                 none of a thing, hits stay the same, and this is what leaving it out saves, against code with everything in."
                    .into(),
            ],
            findings: in_words::needs(report),
            ..section(
                "needs",
                "What code costs that a scene does not need",
                when,
                vec![folded("Every octree and engine", shown(crate::needs_bench::tables::tables(report)))],
            )
        },
        Record::Voxelize(report) => Section {
            lead: vec![
                "Ways to find the voxels of a mesh on a GPU, next to the exact voxels: what each misses, what it adds, and its time."
                    .into(),
                "Dark marks: methods that shade the pixels whose middle, or one of a few samples, is in a triangle. Blue: those that shade \
                 all pixels that it touches. Filled: those that also test each voxel. The line joins methods that no other beats in both."
                    .into(),
            ],
            ..section("voxelize", "Voxelization on a GPU", when, {
                let plots = voxel_plots::plots(report);
                let plots = (!plots.is_empty()).then_some(Block::Plots(plots));
                plots.into_iter().chain(whole(crate::voxel_bench::tables::tables(report))).collect()
            })
        },
        Record::Shadow(report) => Section {
            lead: vec![
                "A world of one bit a voxel with mips, which objects move in and rays are traced through. What is fixed and what moves has its bytes \
                 and its time; then what each shortcut of an effect costs in error. Rays that leave closed rooms must be none where every voxel is looked at."
                    .into(),
                "A mark's shape is the voxel's size. Blue: every voxel is looked at, and rays begin in the picture where an effect can. Filled: the \
                 same, smoothed. Dark: other shortcuts, and the octree. The line joins settings that no other beats in both."
                    .into(),
            ],
            ..section("shadow", "Shadows, occlusion, reflections and fog through a bit volume", when, {
                let plots = shadow_plots::plots(report);
                let plots = (!plots.is_empty()).then_some(Block::Plots(plots));
                let (errors, others) = crate::shadow_bench::tables::parts(report);
                let rows = folded("Error and time of each effect with each shortcut", errors);
                plots.into_iter().chain(whole(others)).chain((!report.scenes.is_empty()).then_some(rows)).collect()
            })
        },
        _ => return None,
    })
}
