//! The tables of a [`BuildReport`].

use super::peers::{Authors, Termination, TheirError};
use super::plan::Contours;
use super::record::{BuildReport, BuildRow, SceneBuilds};
use super::saved::{Measure, SavedLevels};
use crate::error::depth::{DepthError, Summary};
use crate::paper_bench::paper::Paper;
use crate::text::{Document, MIB, TextTable, short};

/// The levels of the paper's Table 1.
const TABLE1_LEVELS: [u32; 7] = [10, 11, 12, 13, 14, 15, 16];

/// Every table of a report, in the order of printing.
fn tables(report: &BuildReport) -> Vec<TextTable> {
    let (paper, authors) = (Paper::figures(), Authors::figures());
    let mut tables = vec![
        beside_authors(report, &authors),
        errors_beside_authors(report, &authors),
        builds(report),
        table1(report, &paper),
        saved(report),
        errors(report),
    ];
    tables.retain(|t| !t.rows.is_empty());
    tables
}

/// All tables as aligned text for a terminal.
pub fn to_text(report: &BuildReport) -> String {
    document(report).to_text()
}

/// All tables as Markdown.
pub fn to_markdown(report: &BuildReport) -> String {
    document(report).to_markdown()
}

fn document(report: &BuildReport) -> Document<'_> {
    Document {
        title: format!("esvo bench build, {}", report.machine.date),
        header: header(report),
        tables: tables(report),
        left_out: &report.left_out,
        credits: report.scenes.iter().map(|s| [&*s.name, &*s.credit, &*s.identity]).collect(),
    }
}

fn header(report: &BuildReport) -> Vec<String> {
    let m = &report.machine;
    let samples = report.scenes.iter().flat_map(|s| &s.rows).flat_map(|r| &r.samples);
    let load = samples.map(|s| s.load).fold(0.0, f64::max);
    let mut lines = vec![
        format!("{}, {} threads, {} MiB, {}", m.cpu, m.threads, m.memory_mb, m.os),
        format!(
            "commit {}, {}, {} build, matrix `{}`, {:.0} s",
            m.commit, m.rustc, m.profile, report.matrix.name, report.seconds
        ),
        format!(
            "limits: {} GB (10^9 bytes) of memory, {} GB of disk, {:.0} s for each build",
            report.matrix.memory_gb, report.matrix.disk_gb, report.matrix.build_limit_seconds
        ),
    ];
    if !report.complete {
        lines.push("not finished: these are the rows that were done so far".into());
    }
    if load > 1.5 {
        lines.push(format!("the machine was not idle: a load of up to {load:.1} before a build; seconds are too long"));
    }
    lines
}

fn rows(report: &BuildReport) -> impl Iterator<Item = (&SceneBuilds, &BuildRow)> {
    report.scenes.iter().flat_map(|s| s.rows.iter().map(move |r| (s, r)))
}

fn millions(count: u64) -> String {
    short(count as f64 / 1e6)
}

fn cell(value: Option<String>) -> String {
    value.unwrap_or_else(|| "-".into())
}

fn ratio(theirs: f64, ours: f64) -> String {
    format!("{} x", short(theirs / ours))
}

/// Every build.
fn builds(report: &BuildReport) -> TextTable {
    let head = [
        "scene",
        "octree",
        "levels",
        "triangles",
        "seconds",
        "builds",
        "import",
        "prepare",
        "voxelize",
        "write",
        "peak MiB",
        "of import",
        "descriptors",
        "leaves",
        "contours",
        "MiB",
        "B/voxel",
    ];
    let mut table = TextTable::new("Builds", 2, &head);
    table.notes = vec![
        "Seconds from the mesh in memory to the octree in its file, median ± half the distance of the quartiles, and how they \
         divide into preparing the mesh, voxelizing, and placing and writing blocks; import apart."
            .into(),
        "Triangles in millions, after displacement (SIBENIK-D, displaced in cells of two finest voxels): displacing counts as \
         import."
            .into(),
        "Peak MiB: most memory that the process ever held, and had held when the mesh was read. Descriptors, \
         leaf voxels and contours in millions."
            .into(),
        "MiB (2^20 bytes): the image, what a caster needs in memory; bytes per voxel, all voxels counted.".into(),
    ];
    for (scene, row) in rows(report) {
        let seconds = row.spread(|s| s.seconds.build);
        let phase = |of: fn(&crate::build_summary::BuildSeconds) -> f64| short(row.spread(|s| of(&s.seconds)).median);
        table.rows.push(vec![
            scene.name.clone(),
            format!("{}, {}", row.contours.title(), scene.mesh_title()),
            row.levels.to_string(),
            millions(row.build.triangles),
            format!("{} ±{:.0}%", short(seconds.median), seconds.percent()),
            row.samples.len().to_string(),
            phase(|s| s.import),
            phase(|s| s.prepare),
            phase(|s| s.voxelize),
            phase(|s| s.write),
            format!("{:.0}", row.peak_mib()),
            format!("{:.0}", row.build.import_peak_bytes as f64 / MIB),
            millions(row.build.descriptors),
            millions(row.build.leaves),
            millions(row.build.contours),
            short(row.mib()),
            format!("{:.2}", row.bytes_per_voxel()),
        ]);
    }
    table
}

/// Builds that the authors' builder was given too.
fn beside_authors(report: &BuildReport, authors: &Authors) -> TextTable {
    let head = [
        "scene",
        "builder",
        "levels",
        "seconds",
        "peak MiB",
        "MiB",
        "B/voxel",
        "descriptors",
        "leaves",
        "contours",
        "bytes",
        "time",
    ];
    let mut table = TextTable::new("Beside the authors' builder", 2, &head);
    table.notes = vec![
        "Authors: ESVO 1.4 with the same mesh and settings on two threads of the same kind of machine, measured apart: not \
         in the same run, nor on the same day. In brackets: the same while other programs ran."
            .into(),
        "Bytes and time: theirs over ours; above 1 is better for us. Counts in millions.".into(),
    ];
    for (scene, row) in rows(report).filter(|(_, r)| r.contours == Contours::On) {
        let Some(theirs) = authors.build(&scene.name, row.levels) else { continue };
        let comparable = theirs.own_mesh == (scene.mesh == "real");
        if theirs.own_mesh && !comparable {
            continue;
        }
        let ours = row.seconds();
        let build = &row.build;
        table.rows.push(vec![
            scene.name.clone(),
            format!("ours, {}", scene.mesh_title()),
            row.levels.to_string(),
            short(ours),
            format!("{:.0}", row.peak_mib()),
            short(row.mib()),
            format!("{:.2}", row.bytes_per_voxel()),
            millions(build.descriptors),
            millions(build.leaves),
            millions(build.contours),
            if theirs.own_mesh { ratio(theirs.mib, row.mib()) } else { "-".into() },
            if theirs.own_mesh { ratio(theirs.seconds, ours) } else { "-".into() },
        ]);
        let busy = theirs.seconds_busy.map_or(String::new(), |s| format!(" ({s})"));
        table.rows.push(vec![
            String::new(),
            if theirs.own_mesh { "authors" } else { "authors, another stand-in" }.into(),
            row.levels.to_string(),
            format!("{}{busy}", short(theirs.seconds)),
            format!("{:.0}", theirs.peak_mib),
            short(theirs.mib),
            format!("{:.1}", theirs.bytes_per_voxel),
            short(theirs.descriptors),
            short(theirs.leaves),
            short(theirs.contours),
            String::new(),
            String::new(),
        ]);
    }
    table
}

/// Errors of those builds.
fn errors_beside_authors(report: &BuildReport, authors: &Authors) -> TextTable {
    let head = ["scene", "octree", "levels", "rays end at", "unit", "median", "90th", "99th", "hit/miss differ"];
    let mut table = TextTable::new("Error beside the authors' octrees", 2, &head);
    table.notes = vec![format!(
        "Distance along the ray to the triangles where both are hit. Ours: {} rays over all viewpoints together. Authors: two \
         of their cameras of 512x384, measured apart; least to most of the two. Theirs at leaves are in voxels, not said which: ours are given in edges of \
         the finest voxels and in edges of the voxel that each ray hit.",
        report.matrix.rays
    )];
    let range = |[a, b]: [f64; 2], decimals: usize| {
        if a == b { format!("{a:.decimals$}") } else { format!("{a:.decimals$} to {b:.decimals$}") }
    };
    for (scene, row) in rows(report).filter(|(s, r)| r.contours == Contours::On && s.mesh == "real") {
        for (termination, error, end, unit) in [
            (Termination::None, &row.error, "leaves", "voxels"),
            (Termination::Pixel, &row.error_at_pixel, "one pixel", "pixels"),
        ] {
            let (Some(error), Some(theirs)) = (error, authors.error(&scene.name, row.levels, termination)) else {
                continue;
            };
            let ours: &[(&str, &Summary)] = match termination {
                Termination::None => &[("finest voxels", &error.voxels), ("voxels hit", &error.hit_voxels)],
                Termination::Pixel => &[(unit, &error.pixels)],
            };
            for (unit, ours) in ours {
                table.rows.push(vec![
                    scene.name.clone(),
                    "ours".into(),
                    row.levels.to_string(),
                    end.into(),
                    unit.to_string(),
                    format!("{:.3}", ours.median),
                    format!("{:.3}", ours.p90),
                    format!("{:.3}", ours.p99),
                    format!("{:.4}%", 100.0 * error.disagreement),
                ]);
            }
            let TheirError { median, p90, p99, disagreement_percent, .. } = theirs;
            table.rows.push(vec![
                String::new(),
                "authors".into(),
                row.levels.to_string(),
                end.into(),
                unit.into(),
                range(*median, 2),
                range(*p90, 2),
                range(*p99, 2),
                format!("{}%", range(*disagreement_percent, 4)),
            ]);
        }
    }
    table
}

/// The paper's Table 1: levels against MiB, seconds, voxels and bytes per voxel.
fn table1(report: &BuildReport, paper: &Paper) -> TextTable {
    let mut head = vec!["scene".to_string(), "octree".into(), "figure".into()];
    head.extend(TABLE1_LEVELS.map(|l| l.to_string()));
    let title = "Table 1: limit on octree levels against memory and time";
    let mut table = TextTable { head, left: 3, ..TextTable::new(title, 3, &[]) };
    table.notes = vec![
        "MiB (2^20 bytes), seconds, millions of voxels (leaves and others), bytes per voxel.".into(),
        "> 8 GB, > 20 min and the like: not built, as the growth of the last two levels says that the file, or the build, would \
         exceed that limit; the list of what was left out has what was expected. -: not asked for."
            .into(),
        format!(
            "Paper: built on {}, with contours; its meshes are not quite ours. Its MB are taken for MiB.",
            paper.machine.cpu
        ),
    ];
    type Figure = (&'static str, fn(&BuildRow) -> String);
    let figures: [Figure; 4] = [
        ("MiB", |r| short(r.mib())),
        ("seconds", |r| short(r.seconds())),
        ("voxels", |r| millions(r.build.voxels)),
        ("B/voxel", |r| format!("{:.2}", r.bytes_per_voxel())),
    ];
    for scene in &report.scenes {
        for contours in [Contours::On, Contours::Off] {
            if !TABLE1_LEVELS.iter().any(|&l| scene.row(contours, l).is_some()) {
                continue;
            }
            for (name, figure) in figures {
                let octree = format!("{}, {}", contours.title(), scene.mesh_title());
                let mut row = vec![scene.name.clone(), octree, name.into()];
                let stopped = |l| scene.stopped(contours, l).map(|s| s.limit.cell(&report.matrix));
                row.extend(TABLE1_LEVELS.map(|l| cell(scene.row(contours, l).map(figure).or_else(|| stopped(l)))));
                table.rows.push(row);
            }
        }
        if TABLE1_LEVELS.iter().any(|&l| paper.build(&scene.name, l).is_some()) {
            for (index, name) in ["MiB", "seconds"].into_iter().enumerate() {
                let mut row = vec![scene.name.clone(), "contours, paper".into(), name.into()];
                let figure = |l| paper.build(&scene.name, l).map(|both| short(<[f64; 2]>::from(both)[index]));
                row.extend(TABLE1_LEVELS.map(|l| cell(figure(l))));
                table.rows.push(row);
            }
        }
    }
    table
}

/// How many levels contours save.
fn saved(report: &BuildReport) -> TextTable {
    let head = [
        "scene",
        "mesh",
        "levels",
        "median error",
        "MiB",
        "cubical levels",
        "cubical MiB",
        "bytes",
        "levels saved",
        "by the 90th",
        "by the 99th",
    ];
    let mut table = TextTable::new("What contours save", 2, &head);
    table.notes = vec![
        "The cubical octree that is as near to the triangles as the one with contours: its level by the errors that were \
         measured, interpolated in the logarithm of the error between two levels, and its bytes likewise. (>) beyond the \
         deepest cubical octree, (<) above the coarsest: their trend goes on."
            .into(),
        "Median error in finest voxels of the octree with contours, rays ending at leaves; bytes: cubical over contours. \
         Levels saved at an equal median error, and at an equal 90th and 99th percentile of it."
            .into(),
    ];
    for scene in &report.scenes {
        for median in scene.saved.iter().filter(|s| s.measure == Measure::Median) {
            let levels = median.levels;
            let of = |measure| scene.saved.iter().find(|s| s.measure == measure && s.levels == levels);
            let voxels = scene.row(Contours::On, levels).and_then(|r| r.error).map(|e| e.voxels.median);
            let mib = |bytes: f64| short(bytes / MIB);
            let spared = |s: &SavedLevels| format!("{:.1}{}", s.cubical_levels - f64::from(levels), beyond(scene, s));
            table.rows.push(vec![
                scene.name.clone(),
                scene.mesh_title().into(),
                levels.to_string(),
                cell(voxels.map(|v| format!("{v:.3}"))),
                mib(median.bytes),
                format!("{:.1}{}", median.cubical_levels, beyond(scene, median)),
                mib(median.cubical_bytes),
                ratio(median.cubical_bytes, median.bytes),
                spared(median),
                cell(of(Measure::P90).map(spared)),
                cell(of(Measure::P99).map(spared)),
            ]);
        }
    }
    table
}

/// Marks what lies outside the levels of the cubical octrees.
fn beyond(scene: &SceneBuilds, saved: &SavedLevels) -> &'static str {
    let coarser = |r: &BuildRow| r.contours == Contours::Off && f64::from(r.levels) <= saved.cubical_levels;
    match saved.extrapolated {
        false => "",
        true if scene.rows.iter().any(coarser) => " (>)",
        true => " (<)",
    }
}

/// All errors.
fn errors(report: &BuildReport) -> TextTable {
    let head = [
        "scene",
        "octree",
        "levels",
        "rays end at",
        "voxels: median",
        "90th",
        "99th",
        "pixels: median",
        "90th",
        "99th",
        "holes",
        "hit/miss differ",
    ];
    let mut table = TextTable::new("Error against the triangles", 2, &head);
    table.notes = vec![
        format!(
            "Distance along the ray between octree and triangles where both are hit, in finest voxels and in footprints of a \
             pixel; about {} rays a scene, all its viewpoints together.",
            report.matrix.rays
        ),
        "Holes: rays that meet a triangle but no voxel; hit/miss: those and the opposite. Cut-outs of the mesh are holes in \
         it."
        .into(),
    ];
    for (scene, row) in rows(report) {
        for (end, error) in [("leaves", &row.error), ("one pixel", &row.error_at_pixel)] {
            let Some(e) = error else { continue };
            let share = |count: u64, e: &DepthError| format!("{:.4}%", 100.0 * count as f64 / e.rays.max(1) as f64);
            table.rows.push(vec![
                scene.name.clone(),
                format!("{}, {}", row.contours.title(), scene.mesh_title()),
                row.levels.to_string(),
                end.into(),
                format!("{:.3}", e.voxels.median),
                format!("{:.3}", e.voxels.p90),
                format!("{:.3}", e.voxels.p99),
                format!("{:.3}", e.pixels.median),
                format!("{:.3}", e.pixels.p90),
                format!("{:.3}", e.pixels.p99),
                share(e.only_exact, e),
                share(e.only_exact + e.only_octree + e.strange, e),
            ]);
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build_bench::record::tests::row;
    use crate::build_bench::{BuildMatrix, Limit, SCHEMA, Stopped};
    use crate::system::machine::Machine;

    fn report() -> BuildReport {
        let stopped = |contours, levels, limit| Stopped { contours, levels, limit, why: "would".into() };
        let scene = SceneBuilds {
            name: "SIBENIK-D".into(),
            mesh: "real".into(),
            triangles: 73_564,
            identity: "verified".into(),
            credit: "somebody".into(),
            views: Vec::new(),
            size: [4, 3],
            rows: vec![
                row(10, Contours::On, [2.0, 0.1, 0.2]),
                row(10, Contours::Off, [1.5, 0.2, 0.2]),
                row(11, Contours::On, [700.0, 0.2, 0.2]),
            ],
            saved: Vec::new(),
            stopped: vec![stopped(Contours::Off, 11, Limit::Disk), stopped(Contours::On, 12, Limit::Build)],
        };
        BuildReport {
            schema: SCHEMA,
            machine: Machine::detect(),
            matrix: BuildMatrix::full_run(),
            scenes: vec![scene],
            left_out: Vec::new(),
            seconds: 1.0,
            complete: false,
        }
    }

    #[test]
    fn cells_say_why_they_have_no_figure() {
        let report = report();
        let table = table1(&report, &Paper::figures());
        let cells = |row: usize| table.rows[row][2..].join(" | ");
        let rest = ["> 20 min"; 5].join(" | ");
        assert_eq!(cells(1), format!("seconds | 2.00 | 700 | {rest}"));
        assert_eq!(cells(4), format!("MiB | 191 | {}", ["> 8 GB"; 6].join(" | ")));
    }

    #[test]
    fn a_report_that_is_not_finished_says_so_and_is_read_again() {
        let report = report();
        assert!(to_text(&report).contains("not finished"));
        let again: BuildReport = serde_json::from_str(&report.to_json()).unwrap();
        assert_eq!(again, report);
        assert!(!to_text(&BuildReport { complete: true, ..again }).contains("not finished"));
    }
}
