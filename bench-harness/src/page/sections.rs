//! The order of the page, and the sections that are made of tables that the benchmarks print anyway.

use super::html::{Block, Contents, PageTable, Section};
use super::{answers, paper_tables, pictures, plot, verdicts};
use crate::build_bench::BuildReport;
use crate::paper_bench::figures::{built_sizes, sizes, viewpoints};
use crate::paper_bench::paper::Paper;
use crate::paper_bench::report::PaperReport;
use crate::paper_bench::tables::{bytes_by_kind, checks, errors, fits};
use crate::records::{Found, Record};
use crate::sweep_bench::SweepReport;
use crate::system::machine::slug;
use crate::text::{TextTable, short};

/// Above this median of a setting's median time over its least, the page says that the machine was disturbed.
const DISTURBED: f64 = 1.1;

/// Terms that a reader needs.
const TERMS: &[[&str; 2]] = &[
    [
        "octree, levels",
        "A cube of space, divided into eight again and again where there is surface. With one level more, voxels are half as large.",
    ],
    [
        "cubes, contours",
        "A voxel is drawn as a cube, or as the part of the cube between two parallel planes that fit the surface: its contour.",
    ],
    ["beam", "A coarse picture is cast first, which tells where the rays of the full picture may start."],
    ["rays end at voxels of 1 pixel", "Deeper voxels are not visited if a voxel already looks as small as that."],
    [
        "depth error",
        "Distance along the ray between the octree's surface and the triangles, in sizes of a pixel there. The 90th percentile: of 90 % of the rays that hit, the error is at most this.",
    ],
    ["FLIP", "How different two pictures look, 0 to 1: here that of the octree and that of the triangles."],
    [
        "stand-in",
        "A generated mesh that replaces one that is not available. Its figures are not those of the original.",
    ],
    ["± %", "Half the distance between the quartiles over the rounds."],
];

/// Everything on the page, and what is not on it.
pub(super) fn contents(found: &[Found], picture_bytes: u64) -> (Contents, Vec<String>) {
    let paper = Paper::figures();
    let verdicts = verdicts::verdicts(found);
    let mut questions = vec![verdicts::question(found, &verdicts)];
    let sweeps: Vec<&SweepReport> = found
        .iter()
        .filter_map(|one| if let Record::Sweep(report) = &one.record { Some(&**report) } else { None })
        .collect();
    // The newest.
    questions.extend(sweeps.first().map(|report| answers::questions(report)).unwrap_or_default());
    let (comparisons, left_out) = pictures::comparisons(found, picture_bytes);

    let mut sections: Vec<Section> = Vec::new();
    let count = comparisons.iter().map(|one| one.shots.len()).sum();
    for one in found {
        if let Record::Sweep(report) = &one.record {
            sections.push(sweep(report, &one.name));
        }
    }
    // Whole tables first, then those that have a part of the columns.
    let whole = |report: &PaperReport| report.scenes.iter().any(|scene| !scene.builds.is_empty());
    for with_octrees in [true, false] {
        for one in found {
            if let Record::Paper(report) = &one.record
                && whole(report) == with_octrees
            {
                sections.extend(tables(report, &one.name, &paper));
            }
        }
    }
    for one in found {
        if let Record::Build(report) = &one.record {
            sections.extend(builds(report, &one.name, &paper));
        }
    }
    if !comparisons.is_empty() {
        sections.push(Section {
            id: "pictures".into(),
            title: "Pictures".into(),
            of: String::new(),
            lead: vec!["The same view in the same light. Move the line to compare.".into()],
            blocks: comparisons.into_iter().map(Block::Compare).collect(),
        });
    }
    sections.extend(found.iter().filter_map(others));
    let table = verdicts::table(&verdicts);
    if !table.rows.is_empty() {
        sections.push(Section {
            id: "engines".into(),
            title: "What was compared".into(),
            of: String::new(),
            lead: Vec::new(),
            blocks: vec![Block::Table(table)],
        });
    }
    sections.push(sources(found, &left_out));
    name_apart(&mut sections);
    let wrong = verdicts.iter().filter(|v| !v.wrong.is_empty()).map(|v| v.engine.clone()).collect();
    let contents = Contents { lead: lead(found), questions, terms: TERMS, sections, wrong, pictures: count };
    (contents, left_out)
}

/// The lines below the title.
fn lead(found: &[Found]) -> Vec<String> {
    let mut machines: Vec<String> = Vec::new();
    for one in found {
        let m = one.record.machine();
        let line = format!("{}, {} threads, {}", m.cpu, m.threads, m.os);
        if !machines.contains(&line) {
            machines.push(line);
        }
    }
    let days: Vec<String> = found.iter().map(|one| one.record.machine().day().to_string()).collect();
    let (first, last) = (days.iter().min(), days.iter().max());
    let when = match (first, last) {
        (Some(a), Some(b)) if a != b => format!("{a} to {b}"),
        (Some(a), _) => a.clone(),
        _ => String::new(),
    };
    vec![format!("Measured {when} on {}.", machines.join("; "))]
}

/// A section of a sweep.
fn sweep(report: &SweepReport, name: &str) -> Section {
    let [width, height] = report.plan.size;
    let mut lead = vec![format!(
        "Every setting that was measured, as error against time: the nearer to the lower left corner, the better. The line joins the \
         settings of octrees that no other beats in both. {width}x{height} pixels, up to {} views a scene, {} rounds. Point at a mark for \
         its setting.",
        report.plan.views, report.plan.rounds
    )];
    if let Some(ratio) = answers::disturbance(report).filter(|ratio| *ratio > DISTURBED) {
        lead.push(format!(
            "Other programs ran meanwhile: a frame took {} times its least time in the middle of the rounds. Times are the least of all \
             rounds; differences of a few percent between settings mean nothing.",
            short(ratio)
        ));
    }
    let mut blocks = Vec::new();
    for scene in &report.scenes {
        blocks.push(Block::Plots(plot::plots(report, scene)));
        blocks.push(Block::Table(crate::sweep_bench::tables::settings(report, scene, false).into()));
        blocks.push(folded(
            format!("All settings of {}", scene.name),
            [crate::sweep_bench::tables::settings(report, scene, true)],
        ));
    }
    blocks.push(folded("The octrees", [crate::sweep_bench::tables::octrees(report)]));
    let answered = crate::sweep_bench::answers::answers(report);
    let tables = answered.into_iter().map(|answer| {
        let mut table = TextTable::new(answer.question, 4, &["scene", "engine", "error", "answer"]);
        table.notes.push(answer.rule.into());
        table.rows = answer.rows.into_iter().map(Vec::from).collect();
        table
    });
    blocks.push(folded("Every question that the sweep answers, at every error", tables));
    Section { id: "sweep".into(), title: "Error against time".into(), of: of(name), lead, blocks }
}

/// The name of a record's folder.
fn of(name: &str) -> String {
    name.split_once('/').map_or_else(String::new, |(folder, _)| folder.to_owned())
}

/// Gives sections of the same title the names of their records, and every section an id of its own.
fn name_apart(sections: &mut [Section]) {
    let titles: Vec<String> = sections.iter().map(|section| section.title.clone()).collect();
    let mut known: Vec<String> = Vec::new();
    for section in sections {
        if titles.iter().filter(|title| **title == section.title).count() > 1 && !section.of.is_empty() {
            section.title = format!("{} ({})", section.title, section.of);
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
fn tables(report: &PaperReport, name: &str, paper: &Paper) -> Vec<Section> {
    let mut sections = Vec::new();
    let rows = sizes(report, paper);
    if !rows.is_empty() {
        sections.push(Section {
            id: "table-1".into(),
            title: "Table 1: size and time of building".into(),
            of: of(name),
            lead: Vec::new(),
            blocks: vec![
                Block::Table(paper_tables::table1(&rows, paper)),
                Block::Table(fits(&rows).into()),
                folded("Bytes per voxel by kind", [bytes_by_kind(report)]),
            ],
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
    sections.push(Section {
        id: "table-2".into(),
        title: "Table 2: rays per second".into(),
        of: of(name),
        lead: vec![format!(
            "Rays end at voxels of one pixel, as in the paper. A cell that says WRONG was not timed: its answers are wrong. {}",
            viewpoints(report)
        )],
        blocks,
    });
    sections
}

/// Table 1 of `esvo bench build`.
fn builds(report: &BuildReport, name: &str, paper: &Paper) -> Option<Section> {
    let rows = built_sizes(report, paper);
    let record = name.split('/').next_back().unwrap_or(name).trim_end_matches(".json");
    (!rows.is_empty()).then(|| Section {
        id: format!("built-{}", slug(record)),
        title: "Table 1 by esvo bench build".into(),
        of: record.to_owned(),
        lead: vec!["Each octree was built in a process of its own; seconds end with the complete file.".into()],
        blocks: vec![Block::Table(paper_tables::table1(&rows, paper)), Block::Table(fits(&rows).into())],
    })
}

/// Sections that are the tables of a benchmark as they are.
fn others(one: &Found) -> Option<Section> {
    let (id, title, lead, tables) = match &one.record {
        Record::Rays(report) => (
            "rays",
            "Incoherent rays",
            "Rays as a program casts them that lights a picture, and rays that have nothing in common, in millions per second.",
            crate::ray_bench::tables::tables(report),
        ),
        Record::Stability(report) => (
            "stability",
            "Hard rays",
            "Rays and octrees that are made to break casters: along faces and through corners, with denormal and huge numbers. No times.",
            crate::stability_bench::tables::tables(report),
        ),
        Record::Needs(report) => {
            ("needs", "What code costs that a scene does not need", "", crate::needs_bench::tables::tables(report))
        }
        _ => return None,
    };
    let tables: Vec<_> = tables.into_iter().filter(|table| !table.rows.is_empty()).collect();
    let blocks = match &one.record {
        Record::Needs(_) => vec![folded("Tables", tables)],
        _ => tables.into_iter().map(|table| Block::Table(table.into())).collect(),
    };
    let lead = if lead.is_empty() { Vec::new() } else { vec![lead.to_string()] };
    Some(Section { id: id.into(), title: title.into(), of: of(&one.name), lead, blocks })
}

/// The records, what was not measured, and whom to thank.
fn sources(found: &[Found], not_shown: &[String]) -> Section {
    let mut records = TextTable::new("Records", 6, &["record", "made by", "date", "machine", "commit", "build"]);
    records.notes.push("Everything on this page is computed from these files alone.".into());
    let mut left = TextTable::new("Not measured", 3, &["what", "why", "record"]);
    let mut credits = TextTable::new("Credits", 3, &["scene", "credit", "mesh"]);
    for one in found {
        let m = one.record.machine();
        let row = [&one.name, one.record.command(), &m.date, &m.cpu, &m.commit, &m.profile].map(str::to_owned);
        records.rows.push(row.into());
        let list = match &one.record {
            Record::Paper(report) => &report.left_out[..],
            Record::Build(report) => &report.left_out[..],
            Record::Sweep(report) => &report.left_out[..],
            _ => &[],
        };
        left.rows.extend(list.iter().map(|l| vec![l.what.clone(), l.reason.clone(), one.name.clone()]));
        let mut add = |scene: &str, credit: &str, identity: &str| {
            let row = [scene, credit, identity].map(str::to_owned).to_vec();
            if !credits.rows.contains(&row) {
                credits.rows.push(row);
            }
        };
        match &one.record {
            Record::Paper(r) => r.scenes.iter().for_each(|s| add(&s.name, &s.credit, &s.identity)),
            Record::Build(r) => r.scenes.iter().for_each(|s| add(&s.name, &s.credit, &s.identity)),
            Record::Sweep(r) => r.scenes.iter().for_each(|s| add(&s.name, &s.credit, &s.identity)),
            Record::Rays(r) => add(&r.scene, &r.credit, &r.identity),
            Record::Needs(r) => r.credits.iter().for_each(|[scene, credit, identity]| add(scene, credit, identity)),
            Record::Stability(_) => {}
        }
    }
    left.rows.extend(not_shown.iter().map(|what| vec![what.clone(), "not on this page".into(), "-".into()]));
    let tables = [records, left, credits].into_iter().filter(|table| !table.rows.is_empty());
    Section {
        id: "sources".into(),
        title: "Records, what is missing, and credits".into(),
        of: String::new(),
        lead: vec!["The paper: Samuli Laine and Tero Karras, “Efficient Sparse Voxel Octrees”, I3D 2010.".into()],
        blocks: tables.map(|table| Block::Table(table.into())).collect(),
    }
}
