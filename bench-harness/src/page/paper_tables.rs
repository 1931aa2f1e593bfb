//! Table 1 and Table 2 with the paper's figures and the ratio in each cell, and the error beside each time.

use std::collections::BTreeMap;

use esvo_core::DeviceKind;

use super::html::{PageCell, PageTable};
use crate::paper_bench::figures::{Rate, SizeRow, levels, rates, variants};
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::paper::Paper;
use crate::paper_bench::report::{DeviceRecord, PaperReport};
use crate::paper_bench::tables::device_title;
use crate::text::short;

/// Table 1.
pub(super) fn table1(rows: &[SizeRow], paper: &Paper) -> PageTable {
    let levels = levels(rows);
    let mut head: Vec<String> = ["scene", "octree"].map(Into::into).into();
    head.extend(levels.iter().map(|l| format!("{l} levels")));
    head.push("bytes per voxel".into());
    let mut table = PageTable {
        caption: "Table 1: memory and time of building, by levels".into(),
        notes: vec![
            "In each cell: MiB (2^20 bytes) of the octree in memory, and the seconds of the build; in small type the paper's figures, and ours \
             divided by the paper's. Below 1: smaller, or faster. Columns are sorted by MiB."
                .into(),
            format!(
                "The paper's octrees have contours, and were built on {}. Its meshes are not ours, least of all where ours is a stand-in. Its MB are \
                 read as MiB. Bytes per voxel are those of the largest octree of the row.",
                paper.machine.cpu
            ),
        ],
        head,
        left: 2,
        cards: false,
        rows: Vec::new(),
    };
    for row in rows {
        let displaced = if row.displaced { ", displaced" } else { "" };
        let mesh = vec![row.mesh.title().to_owned(), format!("{} triangles{displaced}", row.triangles)];
        let mut cells = vec![PageCell { small: mesh, ..PageCell::new(row.scene.clone()) }, PageCell::new(row.kind())];
        for level in &levels {
            let paper = row.paper.get(level);
            let theirs = paper.map(|[mb, s]| format!("paper {} MiB, {} s", short(*mb), short(*s)));
            cells.push(match (row.cells.get(level), paper) {
                (Some(own), paper) => {
                    let ratio = paper.map(|[mb, s]| format!("× {}, × {}", short(own.mib / mb), short(own.seconds / s)));
                    let small = theirs.into_iter().chain(ratio).collect();
                    PageCell::number(format!("{} MiB, {} s", short(own.mib), short(own.seconds)), own.mib, small)
                }
                (None, _) => {
                    PageCell { text: "–".into(), small: theirs.into_iter().collect(), ..PageCell::default() }
                }
            });
        }
        cells.push(match row.largest() {
            Some((_, own)) => {
                let own = own.bytes_per_voxel();
                let small = row.paper_bytes.map_or_else(Vec::new, |(theirs, at)| {
                    vec![format!("paper {theirs:.2} at {at} levels"), format!("× {}", short(own / theirs))]
                });
                PageCell::number(format!("{own:.2}"), own, small)
            }
            None => PageCell::default(),
        });
        table.rows.push(cells);
    }
    table
}

/// Table 2 of one device.
pub(super) fn table2(report: &PaperReport, paper: &Paper, device: &DeviceRecord) -> PageTable {
    let variants = variants(report, device);
    let mut head: Vec<String> = ["scene", "picture"].map(Into::into).into();
    head.extend(variants.iter().map(|v| v.title().to_string()));
    let rows = rates(report, paper, device);
    let filtered = rows.iter().any(|row| row.filter.is_some());
    head.extend(filtered.then(|| "filter, ms".into()));
    let compared = match device.kind {
        DeviceKind::Gpu => format!("The paper's device: {}, CUDA {}.", paper.machine.gpu, paper.machine.cuda),
        DeviceKind::Cpu => format!(
            "The paper's device is a GPU, {}, CUDA {}; this one is a processor: compare how the columns relate, not the devices.",
            paper.machine.gpu, paper.machine.cuda
        ),
        DeviceKind::SoftwareGpu => {
            "This driver runs on the processor: its times say nothing about a GPU, so that the paper's are not \
                                    shown."
                .into()
        }
    };
    let mut table = PageTable {
        caption: format!("Table 2, {}: primary rays, millions per second, median of the rounds", device.backend.name()),
        notes: vec![
            format!("{}. {compared}", device_title(device)),
            "In each cell: the median over the rounds ± half the distance between the quartiles; in small type the paper's figure and ours \
             divided by it (above 1: faster), and the depth error against the triangles at 512x384 in pixels: median / 99th percentile."
                .into(),
        ],
        head,
        left: 2,
        cards: false,
        rows: Vec::new(),
    };
    if filtered {
        table
            .notes
            .push("Filter: the paper's post-process filter of a picture, in milliseconds, without copies.".into());
    }
    for row in rows {
        let [width, height] = row.size;
        let levels = row.levels.map(|levels| format!("{levels} levels"));
        let mesh = std::iter::once(row.mesh.title().to_owned()).chain(levels).collect();
        let mut cells = vec![
            PageCell { small: mesh, ..PageCell::new(row.scene.clone()) },
            PageCell::new(format!("{width}x{height}")),
        ];
        for cell in &row.cells {
            let theirs = cell.paper.map(|paper| match cell.ratio() {
                Some(ratio) => format!("paper {}, × {}", short(paper), short(ratio)),
                None => format!("paper {}", short(paper)),
            });
            let error = cell.error.map(|[median, p99]| match cell.variant {
                Variant::Triangles => "exact".to_string(),
                _ => format!("error {} / {} px", short(median), short(p99)),
            });
            cells.push(match cell.rate {
                Rate::Measured(spread) => {
                    let text = spread.to_text();
                    let level = cell.hit_level.map(|level| format!("hits at level {level:.1}"));
                    PageCell::number(text, spread.median, theirs.into_iter().chain(error).chain(level).collect())
                }
                Rate::Wrong => PageCell::new("WRONG"),
                Rate::Absent => {
                    PageCell { text: "–".into(), small: theirs.into_iter().collect(), ..PageCell::default() }
                }
            });
        }
        cells.extend(filtered.then(|| match row.filter {
            Some(spread) => PageCell::number(spread.to_text(), spread.median, Vec::new()),
            None => PageCell::default(),
        }));
        table.rows.push(cells);
    }
    table
}

/// What Table 2 of the paper shows and ours can be held against: how much faster each column is than that of cubes, at the largest size.
pub(super) fn columns(report: &PaperReport, paper: &Paper) -> Option<PageTable> {
    let mut rows = Vec::new();
    for device in &report.devices {
        let mut last: BTreeMap<String, _> = BTreeMap::new();
        for row in rates(report, paper, device) {
            last.insert(row.scene.clone(), row);
        }
        for row in last.into_values() {
            let of = |v: Variant| row.cells.iter().find(|cell| cell.variant == v);
            let known = crate::scene::compared_as(&row.scene, row.mesh);
            let Some(base) = of(Variant::Cubical).and_then(|cell| cell.median()) else { continue };
            let mut cells = vec![
                PageCell::new(row.scene.clone()),
                PageCell::new(device.backend.name()),
                PageCell::new(format!("{}x{}", row.size[0], row.size[1])),
            ];
            for variant in [Variant::Triangles, Variant::Contours, Variant::Beam] {
                let own = of(variant).and_then(|cell| cell.median()).map(|rate| rate / base);
                let paper = |v: Variant| paper.mrays(known, row.size, v);
                let theirs =
                    paper(variant).zip(paper(Variant::Cubical)).map(|(a, b)| format!("paper {}", short(a / b)));
                cells.push(match own {
                    Some(own) => PageCell::number(short(own), own, theirs.into_iter().collect()),
                    None => PageCell { text: "–".into(), small: theirs.into_iter().collect(), ..PageCell::default() },
                });
            }
            rows.push(cells);
        }
    }
    let head = ["scene", "engine", "picture", "triangles", "contours", "with beam"].map(Into::into).into();
    (!rows.is_empty()).then(|| PageTable {
        caption: "How the columns relate: rays per second (median) over those of cubes".into(),
        notes: vec![
            "At the largest picture. This is what can be compared between devices of different age and kind: above 1, faster than cubes of \
             as many levels."
                .into(),
        ],
        head,
        left: 3,
        cards: false,
        rows,
    })
}
