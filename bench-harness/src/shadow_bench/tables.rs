//! The tables of `esvo bench shadow`.

use super::{ErrorRow, PictureRow, RateRow, ShadowReport, answers};
use crate::text::{Document, TextTable, short};
use crate::timing::least;

/// Aligned text for a terminal.
pub fn to_text(report: &ShadowReport) -> String {
    document(report).to_text()
}

/// Markdown.
pub fn to_markdown(report: &ShadowReport) -> String {
    document(report).to_markdown()
}

fn document(report: &ShadowReport) -> Document<'_> {
    let machine = &report.machine;
    Document {
        title: format!("esvo bench shadow, {}", machine.date),
        header: vec![
            format!("{}, {} threads, {}", machine.cpu, machine.threads, machine.os),
            format!("commit {}, {}, {} build, {:.0} s", machine.commit, machine.rustc, machine.profile, report.seconds),
        ],
        tables: tables(report),
        left_out: report.left_out.iter().map(|left| [&left.what[..], &left.reason[..]]).collect(),
        credits: report.scenes.iter().map(|scene| [&scene.name[..], &scene.credit[..], &scene.identity[..]]).collect(),
    }
}

/// All tables of a record.
fn tables(report: &ShadowReport) -> Vec<TextTable> {
    let (errors, others) = parts(report);
    others.into_iter().chain(errors).filter(|table| !table.rows.is_empty()).collect()
}

/// The tables of errors, of which there is one for each scene and effect, and the others.
pub(crate) fn parts(report: &ShadowReport) -> (Vec<TextTable>, Vec<TextTable>) {
    let others = vec![
        answers::answers(report),
        world(report),
        moving(report),
        picture(report),
        leaks(report),
        volumes(report),
        rates(report),
    ];
    (errors(report), others)
}

/// Mebibytes.
fn mib(bytes: f64) -> String {
    short(bytes / f64::from(1 << 20))
}

fn voxels(voxels: [u32; 3]) -> String {
    let [x, y, z] = voxels;
    format!("{x} x {y} x {z}")
}

fn world(report: &ShadowReport) -> TextTable {
    let head =
        ["voxels", "mips", "bytes", "MiB", "in bricks, MiB", "voxels set", "fill s", "update s", "most memory, MiB"];
    let mut table = TextTable::new("A world of 5 cm voxels: hills and houses", 1, &head);
    table.notes = vec![
        "Bytes are those of the base level and the mips, all of which a GPU holds. In bricks: the same voxels in bricks of 16 voxels along the edge, \
         where there are any. Fill: to find the voxels. Update: to make all bytes and mips."
            .into(),
    ];
    let row = &report.world;
    table.rows.push(vec![
        voxels(row.voxels),
        row.mips.to_string(),
        row.bytes.to_string(),
        mib(row.bytes as f64),
        mib(row.brick_bytes as f64),
        row.set.to_string(),
        short(row.fill_seconds),
        short(row.update_seconds),
        mib(row.peak_bytes as f64),
    ]);
    table
}

fn moving(report: &ShadowReport) -> TextTable {
    let head = [
        "objects",
        "voxels along the edge",
        "find voxels, ms",
        "update, ms",
        "cells made anew",
        "regions",
        "KiB",
        "ms",
        "one by one: regions",
        "KiB",
        "ms",
        "as if from nothing",
    ];
    let mut table = TextTable::new("Objects that move in it, each picture", 2, &head);
    table.notes = vec![
        "All objects move and turn in each picture. Regions: what is sent to a GPU, with the bytes of mips, if near changes are sent together, and if \
         the box of each object before and after is sent one by one; ms: until the device has them. As if from nothing: at the end the volume is bit for bit the one that is \
         made voxel by voxel."
            .into(),
    ];
    for row in &report.moving {
        table.rows.push(vec![
            row.objects.to_string(),
            row.edge.to_string(),
            short(row.rasterize_ms),
            short(row.update_ms),
            short(row.cells),
            short(row.regions),
            short(row.region_bytes / 1024.0),
            row.send_ms.map_or_else(|| "-".into(), short),
            short(row.single_regions),
            short(row.single_bytes / 1024.0),
            row.single_send_ms.map_or_else(|| "-".into(), short),
            if row.as_if_from_nothing { "yes" } else { "NO" }.into(),
        ]);
    }
    table
}

fn picture(report: &ShadowReport) -> TextTable {
    let Some(picture) = &report.picture else { return TextTable::new("", 1, &[]) };
    let head: Vec<&str> = ["pass"].into_iter().chain(picture.rows.iter().map(|row| row.tracer.as_str())).collect();
    let title = format!(
        "A picture of it, {} x {} pixels with {} lamps: ms a pass",
        picture.size.0, picture.size.1, picture.lamps
    );
    let mut table = TextTable::new(title, 1, &head);
    table.notes = vec![format!(
        "Rays for each pixel: {} of ambient occlusion, {} to each lamp whose light comes there, {} mirrored, and {} places in fog, from each of which one goes to each \
         lamp whose light comes there. Every voxel is looked at. Pixels that differ: from the processor's light, by more than a \
         hundredth of white. Surfaces, from which all begins, are not in the times.",
        picture.occlusion_rays, picture.lamp_rays, picture.reflection_rays, picture.fog_places
    )];
    let Some(first) = picture.rows.first() else { return table };
    let row = |name: &str, value: &dyn Fn(&PictureRow) -> String| {
        [name.to_owned()].into_iter().chain(picture.rows.iter().map(value)).collect::<Vec<_>>()
    };
    for (i, pass) in first.passes.iter().enumerate() {
        table
            .rows
            .push(row(&pass.pass, &|row| row.passes.get(i).map_or_else(|| "-".into(), |pass| short(least(&pass.ms)))));
    }
    table.rows.push(row("all passes", &|row| short(row.passes.iter().map(|pass| least(&pass.ms)).sum())));
    table.rows.push(row("pixels that differ, ppm", &|row| short(row.different * 1e6)));
    table
}

fn leaks(report: &ShadowReport) -> TextTable {
    let head = ["wall", "tracing", "rays", "leave the room", "of a million"];
    let mut table = TextTable::new("Rays that leave closed rooms", 2, &head);
    table.notes = vec![
        "Rooms are boxes turned in 11 ways and a ball, with walls of one voxel: the neighbours of the inside across faces alone, faces and edges, or \
         faces, edges and corners. Half of the rays go along diagonals, through corners and edges of voxels."
            .into(),
    ];
    for row in &report.leaks {
        let tracing = row.step.map_or_else(|| "every voxel".to_owned(), |step| format!("steps of {step}"));
        let share = row.leaks as f64 * 1e6 / row.rays.max(1) as f64;
        table.rows.push(vec![row.wall.clone(), tracing, row.rays.to_string(), row.leaks.to_string(), short(share)]);
    }
    table
}

fn volumes(report: &ShadowReport) -> TextTable {
    let mut table = TextTable::new(
        "Volumes of scenes, with two mips",
        2,
        &["scene", "voxel, cm", "voxels", "MiB", "in bricks, MiB", "fill s"],
    );
    for scene in &report.scenes {
        for row in &scene.volumes {
            table.rows.push(vec![
                scene.name.clone(),
                short(row.voxel_cm),
                voxels(row.voxels),
                mib(row.bytes as f64),
                mib(row.brick_bytes as f64),
                short(row.fill_seconds),
            ]);
        }
    }
    table
}

/// Millions of rays a second, at best.
pub(super) fn rate(row: &RateRow) -> f64 {
    row.rays as f64 * 1e-6 / least(&row.seconds)
}

fn rates(report: &ShadowReport) -> TextTable {
    let head = ["scene", "rays", "tracing", "coarsest cells", "Mrays/s", "cells a ray", "other answers", "ppm"];
    let title = format!("Rays a second, voxels of {} cm, all cores", report.options.base());
    let mut table = TextTable::new(title, 4, &head);
    table.notes = vec![
        "Whether something is in the way; where it says so, what is in the way first. Coarsest cells: in voxels; 1 is without mips, 8 are the two mips \
         of the document. Other answers: rays for which samples in steps say otherwise than every voxel. An octree's caster finds hits of \
         finer voxels and stands beside for its speed."
            .into(),
    ];
    for scene in &report.scenes {
        for row in &scene.rates {
            // An octree's caster has no cells, and its name says that it finds first hits.
            let octree = row.coarsest == 0;
            let dash = |text: String| if octree { "-".into() } else { text };
            let first = if row.first && !octree { ", first hit" } else { "" };
            table.rows.push(vec![
                scene.name.clone(),
                row.kind.clone(),
                format!("{}{first}", row.tracer),
                dash(row.coarsest.to_string()),
                short(rate(row)),
                if row.steps > 0.0 { short(row.steps) } else { "-".into() },
                dash(row.different.to_string()),
                dash(short(row.different as f64 * 1e6 / row.rays.max(1) as f64)),
            ]);
        }
    }
    table
}

/// Whether no other row of the same effect is at least as good in time and error, and better in one.
pub(crate) fn on_front(row: &ErrorRow, rows: &[&ErrorRow]) -> bool {
    let at = |row: &ErrorRow| (least(&row.ms), row.rmse);
    let (ms, error) = at(row);
    !rows.iter().map(|other| at(other)).any(|(m, e)| m <= ms && e <= error && (m < ms || e < error))
}

/// Rows of one effect of a scene, effect by effect, in the order of the record.
pub(crate) fn by_effect(rows: &[ErrorRow]) -> Vec<(&str, Vec<&ErrorRow>)> {
    let mut effects: Vec<(&str, Vec<&ErrorRow>)> = Vec::new();
    for row in rows {
        match effects.iter_mut().find(|(effect, _)| *effect == row.effect) {
            Some((_, rows)) => rows.push(row),
            None => effects.push((&row.effect, vec![row])),
        }
    }
    effects
}

fn errors(report: &ShadowReport) -> Vec<TextTable> {
    let mut tables = Vec::new();
    for scene in &report.scenes {
        for (effect, rows) in by_effect(&scene.errors) {
            let head = [
                "voxel, cm",
                "tracing",
                "rays",
                "begins in",
                "smoothed",
                "ms",
                "error",
                "to triangles",
                "FLIP",
                "front",
            ];
            let mut table = TextTable::new(format!("{}: {effect}, error and time", scene.name), 2, &head);
            table.notes = vec![format!(
                "{} x {} pixels, {}, all cores. Error: root of the mean square, in percent of full light, to {} rays a pixel through the exact octree of \
                 {} levels; then to as many among the triangles. Front: no other row is both faster and nearer to the octree.",
                report.options.size.0,
                report.options.size.1,
                scene.view,
                report.options.converged,
                report.options.levels
            )];
            for row in &rows {
                let exact = row.voxel_cm == 0.0;
                let tracing = row.step.map_or_else(|| "every voxel".to_owned(), |step| format!("steps of {step}"));
                table.rows.push(vec![
                    if exact { "octree".into() } else { short(row.voxel_cm) },
                    if exact { "octree".into() } else { tracing },
                    row.rays.to_string(),
                    if row.screen { "picture" } else { "volume" }.into(),
                    if row.smoothed { "yes" } else { "no" }.into(),
                    short(least(&row.ms)),
                    short(100.0 * row.rmse),
                    short(100.0 * row.rmse_triangles),
                    short(row.flip),
                    if on_front(row, &rows) { "*" } else { "" }.into(),
                ]);
            }
            tables.push(table);
        }
    }
    tables
}
