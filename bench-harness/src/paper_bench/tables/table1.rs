//! Table 1: memory and time of building. Also the table of bytes by kind.

use esvo_scenes::SceneVariant;

use crate::paper_bench::figures::{PAPER_MIB, SizeRow};
use crate::paper_bench::paper::Paper;
use crate::paper_bench::report::{PaperReport, Table1Row};
use crate::scene::compared_as;
use crate::text::{TextTable, or_dash, short};

/// Table 1: MiB, seconds and bytes per voxel.
pub(super) fn table1(report: &PaperReport, paper: &Paper) -> TextTable {
    let mut levels: Vec<u32> = report.scenes.iter().flat_map(|s| &s.builds).map(|b| b.levels).collect();
    levels.sort_unstable();
    levels.dedup();
    let mut head = vec!["scene".to_string(), "octree".into(), "triangles".into()];
    head.extend(levels.iter().map(|l| format!("{l} levels")));
    head.push("B/voxel".into());
    let mut table =
        TextTable { head, left: 2, ..TextTable::new("Table 1: memory and time of building, by levels", 2, &[]) };
    table.notes = vec![
        "MiB (2^20 bytes) and seconds; bytes per voxel of the largest octree of the row, counting all voxels.".into(),
        format!(
            "Paper: built on {}; its meshes and the levels of its largest octrees differ from ours. Its MB are read as MiB.",
            paper.machine.cpu
        ),
        "Authors: our copy of the mesh, built with contours by ESVO 1.4, the paper authors' own builder.".into(),
    ];
    for scene in report.scenes.iter().filter(|s| !s.builds.is_empty()) {
        for contours in [true, false] {
            let rows: Vec<_> = scene.builds.iter().filter(|b| b.contours == contours).collect();
            let Some(largest) = rows.last() else { continue };
            let kind = if contours { "contours" } else { "cubical" };
            let mut row = {
                let displaced = if largest.displaced_triangles.is_some() { " + disp." } else { "" };
                let triangles = format!("{}{displaced}", scene.triangles);
                vec![scene.name.clone(), format!("{kind}, {}", scene.mesh.title()), triangles]
            };
            row.extend(levels.iter().map(|&l| {
                or_dash(scene.build(contours, l).map(|b| format!("{} MiB {} s", short(b.mib()), short(b.seconds))))
            }));
            row.push(format!("{:.2}", largest.bytes_per_voxel()));
            table.rows.push(row);
        }
        let known = compared_as(&scene.name, scene.mesh);
        if let Some((bytes, largest)) = paper.bytes_per_voxel(known) {
            let triangles = or_dash(paper.triangles(known).map(|t| t.to_string()));
            let mut row = vec![String::new(), "contours, paper".to_string(), triangles];
            row.extend(
                levels.iter().map(|&l| {
                    or_dash(paper.build(known, l).map(|(mb, s)| format!("{} MiB {} s", short(mb), short(s))))
                }),
            );
            row.push(format!("{bytes:.2} at {largest}"));
            table.rows.push(row);
        }
        if let Some((bytes, at)) = paper.authors_builder(&scene.name).filter(|_| scene.mesh == SceneVariant::Real) {
            let mut row = vec![String::new(), "contours, authors".to_string(), scene.triangles.to_string()];
            row.extend(levels.iter().map(|_| "-".to_string()));
            row.push(format!("{bytes:.1} at {at}"));
            table.rows.push(row);
        }
    }
    table
}

/// The deepest octrees that fit the memory of the paper's GPU.
pub(crate) fn fits(rows: &[SizeRow]) -> TextTable {
    let head = ["scene", "octree", "size is", "levels", "MiB", "paper's levels", "paper's MiB"];
    let mut table = TextTable::new("The largest octree that fits 4 GB", 3, &head);
    table.notes = vec![format!(
        "The deepest octree of at most {PAPER_MIB:.0} MiB, the memory of the paper's GPU, and no deeper than the paper's deepest. Predicted: it \
         was not built; its size follows from the growth of the last two levels, 1.5 to 5 times a level."
    )];
    for row in rows {
        let Some(fit) = row.fit() else { continue };
        let paper = row.paper_fit();
        table.rows.push(vec![
            row.scene.clone(),
            format!("{}, {}", row.kind(), row.mesh.title()),
            if fit.predicted { "predicted" } else { "measured" }.into(),
            fit.levels.to_string(),
            short(fit.mib),
            or_dash(paper.map(|(levels, _)| levels.to_string())),
            or_dash(paper.map(|(_, mb)| short(mb))),
        ]);
    }
    table
}

/// Bytes per voxel by kind, for every octree.
pub(crate) fn bytes_by_kind(report: &PaperReport) -> TextTable {
    let builds = || report.scenes.iter().flat_map(|s| s.builds.iter().map(move |b| (s, b)));
    // Kinds that would show 0.00 in every row are added up in one column.
    let per_voxel = |build: &Table1Row, bytes: u64| bytes as f64 / build.voxels.max(1) as f64;
    let mut kinds: Vec<&str> = Vec::new();
    for (build, kind) in builds().flat_map(|(_, b)| b.kinds.iter().map(move |k| (b, k))) {
        if per_voxel(build, kind.bytes) >= 0.005 && !kinds.contains(&kind.kind.as_str()) {
            kinds.push(&kind.kind);
        }
    }
    let mut head = vec!["scene".to_string(), "octree".into(), "levels".into(), "voxels".into()];
    head.extend(kinds.iter().map(|k| k.to_string()));
    head.extend(["rest".into(), "all".into()]);
    let mut table = TextTable { head, ..TextTable::new("Bytes per voxel by kind", 2, &[]) };
    table.notes = vec!["Bytes of each kind divided by the number of all voxels of the octree.".into()];
    for (scene, build) in builds() {
        let kind = if build.contours { "contours" } else { "cubical" };
        let mut row = vec![
            scene.name.clone(),
            format!("{kind}, {}", scene.mesh.title()),
            build.levels.to_string(),
            millions(build.voxels),
        ];
        let bytes_of = |kind: &str| build.kinds.iter().filter(|b| b.kind == kind).map(|b| b.bytes).sum::<u64>();
        let named: Vec<u64> = kinds.iter().map(|kind| bytes_of(kind)).collect();
        let rest = build.bytes.saturating_sub(named.iter().sum());
        row.extend(named.into_iter().chain([rest, build.bytes]).map(|b| format!("{:.2}", per_voxel(build, b))));
        table.rows.push(row);
    }
    table
}

fn millions(count: u64) -> String {
    format!("{} M", short(count as f64 / 1e6))
}
