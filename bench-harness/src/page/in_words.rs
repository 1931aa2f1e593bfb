//! What records of `esvo bench needs` and `esvo bench stability` say, in sentences with figures that stand above their tables.

use esvo_core::DeviceKind;
use esvo_core::reference::MAX_SCALE;

use super::html::{PageCell, PageTable};
use super::verdicts::{in_words, listed};
use crate::needs_bench::tables::BYTES_PER_FRAME;
use crate::needs_bench::{Case, NeedsReport, Variant};
use crate::stability_bench::{Cell as HardCell, EngineRow, StabilityReport};
use crate::timing::Spread;

/// What leaving code out saves: a sentence for each engine, then of bytes.
pub(super) fn needs(report: &NeedsReport) -> Vec<String> {
    let engines = report.engines.iter().enumerate();
    let mut lines: Vec<String> = engines.filter_map(|(index, row)| time(report, index, &row.name)).collect();
    lines.extend(stack(report));
    lines.extend(upload(report));
    lines
}

/// Times of an engine with code left out over those with everything in, at each level: deep octrees need more of the code.
fn time(report: &NeedsReport, engine: usize, name: &str) -> Option<String> {
    let of = |case: &Case, variant| {
        let cell = case.cells.iter().find(|cell| cell.engine == engine && cell.variant == variant)?;
        Spread::of(&cell.seconds)
    };
    // Packets of the processor have code of their own without contours only.
    let measured = |variant: &Variant| report.cases.iter().any(|case| of(case, *variant).is_some());
    let variant = [Variant::All, Variant::Contours].into_iter().find(measured)?;
    let at_level = |levels: u32| {
        let cases = report.cases.iter().filter(|case| case.levels == levels);
        let pairs: Vec<[Spread; 2]> =
            cases.filter_map(|case| Some([of(case, variant)?, of(case, Variant::Everything)?])).collect();
        let mut ratios: Vec<f64> = pairs.iter().map(|[left, all]| left.median / all.median).collect();
        ratios.sort_by(f64::total_cmp);
        let (least, most, middle) = (*ratios.first()?, *ratios.last()?, Spread::of(&ratios)?.median);
        let faster = pairs.iter().filter(|[left, all]| left.upper_quartile < all.lower_quartile).count();
        let slower = pairs.iter().filter(|[left, all]| all.upper_quartile < left.lower_quartile).count();
        Some(format!(
            "at {levels} levels {} time in the middle of {} cases ({} to {}), beyond the quartiles {faster} are faster and {slower} slower",
            change(middle),
            pairs.len(),
            change(least),
            change(most)
        ))
    };
    let each: Vec<String> = levels(report).into_iter().filter_map(at_level).collect();
    let what = match variant {
        Variant::All => "with only what octree and rays need",
        _ => "without clipping by contours, where there are none (it leaves out nothing else)",
    };
    let device = &report.engines[engine].device;
    let software = if device.kind == DeviceKind::SoftwareGpu { ", software" } else { "" };
    let end = "Medians and quartiles are those of the rounds.";
    Some(format!("{name} ({}{software}), {what}: {}. {end}", device.name, each.join("; ")))
}

/// The levels of a record's octrees, ascending.
fn levels(report: &NeedsReport) -> Vec<u32> {
    let mut levels: Vec<u32> = report.cases.iter().map(|case| case.levels).collect();
    levels.sort_unstable();
    levels.dedup();
    levels
}

/// `19 % less`, for a ratio of 0.81.
fn change(ratio: f64) -> String {
    match 100.0 * (ratio - 1.0) {
        less if less <= -0.5 => format!("{:.0} % less", -less),
        more if more >= 0.5 => format!("{more:.0} % more"),
        _ => "0 % less".into(),
    }
}

/// What the stack of a ray takes in a GPU kernel.
fn stack(report: &NeedsReport) -> Option<String> {
    let each: Vec<String> =
        levels(report).iter().map(|levels| format!("{} bytes for {levels} levels", levels * BYTES_PER_FRAME)).collect();
    let each: Vec<&str> = each.iter().map(String::as_str).collect();
    (!each.is_empty()).then(|| {
        format!(
            "Kernel bytes on GPUs: without spare frames, the stack of a ray takes {}, not the {} bytes that octrees of any depth need. Sizes of \
             compiled kernels are not in the record.",
            listed(&each),
            MAX_SCALE * BYTES_PER_FRAME
        )
    })
}

/// What is uploaded although nothing reads it.
fn upload(report: &NeedsReport) -> Option<String> {
    // Where rays end changes no byte.
    let cases = || report.cases.iter().filter(|case| !case.needs.sizes && case.upload_bytes > 0);
    let shares = |contours: bool| {
        let mut shares: Vec<f64> = cases()
            .filter(|case| case.needs.contours == contours)
            .map(|case| {
                let unread = case.unread.contour_halves + case.unread.headers + case.unread.gaps;
                100.0 * unread as f64 / case.upload_bytes as f64
            })
            .collect();
        shares.sort_by(f64::total_cmp);
        Some(format!("{:.0} to {:.0} %", shares.first()?, shares.last()?))
    };
    if report.cases.is_empty() {
        return None;
    }
    let parts: Vec<String> = [(false, "cubes"), (true, "contours")]
        .into_iter()
        .filter_map(|(contours, name)| Some(format!("{} of the upload of octrees of {name}", shares(contours)?)))
        .collect();
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    Some(if parts.is_empty() {
        "Bytes in memory: leaving out code changes none. This record is older than the count of bytes that no caster reads.".into()
    } else {
        format!(
            "Bytes in memory: leaving out code changes none. Kept although no caster reads them: {}.",
            listed(&parts)
        )
    })
}

/// Rays, failures and worst errors of the hard rays: of the reference, then of each engine, and of meshes and mistakes made on purpose.
pub(super) fn stability(report: &StabilityReport) -> Vec<String> {
    let rays: u64 = report.cells.iter().map(|cell| cell.cases).sum();
    let failures: u64 = report.cells.iter().map(|cell| cell.failures).sum();
    let mut lines = Vec::new();
    if let Some(worst) = worst(report) {
        let case = worst.worst_case.as_ref().map_or_else(String::new, |case| format!(" (`{case}`)"));
        lines.push(format!(
            "reference against the oracle: {} rays through {} octrees, {failures} failures; the worst error of the distance is {:.3} of what \
             rounding may do{case}.",
            in_words(rays),
            report.sets.len(),
            worst.worst
        ));
    }
    lines.extend(by_engine(report));
    if !report.meshes.is_empty() {
        let sum = |of: fn(&crate::stability_bench::MeshRow) -> u64| report.meshes.iter().map(of).sum::<u64>();
        let farthest = report.meshes.iter().map(|row| row.worst).fold(0.0, f64::max);
        lines.push(format!(
            "Octrees of {} hard meshes: {} rays, {} holes, {} hits beside the triangles; the farthest hit is {farthest:.2} of a voxel's diagonal away.",
            report.meshes.len(),
            in_words(sum(|row| row.rays)),
            sum(|row| row.holes),
            sum(|row| row.beside)
        ));
    }
    if !report.controls.is_empty() {
        let caught = report.controls.iter().filter(|control| control.caught > 0).count();
        lines.push(format!("Mistakes made on purpose: {caught} of {} kinds were caught.", report.controls.len()));
    }
    lines
}

/// A sentence for the engines of each device that gave the same figures.
fn by_engine(report: &StabilityReport) -> Vec<String> {
    let mut groups: Vec<(String, Vec<&str>)> = Vec::new();
    for row in report.engines.iter().filter(|row| row.device.is_some()) {
        let device = row.device.as_ref().map_or("", |device| &device.name);
        let other = match (row.different, row.wrong, worst(report)) {
            (0, _, Some(worst)) => {
                format!("all as the reference's in every bit, so that the worst error is the same {:.3}", worst.worst)
            }
            (0, _, None) => "all as the reference's in every bit".into(),
            (different, wrong, _) => format!("{different} other than the reference's, {wrong} of them wrong"),
        };
        let error = row.error.as_ref().map_or_else(String::new, |error| format!(" It stopped: {error}."));
        let cases = in_words(row.rays + row.pixels);
        let figures = format!("on {device}: {cases} rays each, {} failures; {other}.{error}", row.wrong);
        match groups.iter_mut().find(|(known, _)| *known == figures) {
            Some((_, names)) => names.push(&row.name),
            None => groups.push((figures, vec![&row.name])),
        }
    }
    let sentence = |(figures, names): (String, Vec<&str>)| {
        let names: Vec<String> = names.iter().map(|name| name.replace(", ", " with ")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        format!("{} {figures}", listed(&names))
    };
    groups.into_iter().map(sentence).collect()
}

/// The cell with a failure, or with the largest error.
fn worst(report: &StabilityReport) -> Option<&HardCell> {
    report.cells.iter().max_by(|a, b| (a.failures > 0).cmp(&(b.failures > 0)).then(a.worst.total_cmp(&b.worst)))
}

/// A row for the reference and each engine, time and again the same columns: verdict, failures, worst error.
pub(super) fn hard_engines(report: &StabilityReport) -> PageTable {
    let verdict = |wrong: bool| if wrong { ("WRONG", "bad") } else { ("right", "good") };
    let row = |name: &str, judge: &str, [cases, different, failed]: [u64; 3], worst: String| {
        let (text, class) = verdict(failed > 0);
        vec![
            PageCell::new(name),
            PageCell { class, ..PageCell::new(text) },
            PageCell::new(failed.to_string()),
            PageCell::new(worst),
            PageCell::number(in_words(cases), cases as f64, Vec::new()),
            PageCell::new(different.to_string()),
            PageCell::new(judge),
        ]
    };
    let sum = |of: fn(&HardCell) -> u64| report.cells.iter().map(of).sum::<u64>();
    let own = worst(report).map_or_else(|| "–".into(), |cell| format!("{:.3}", cell.worst));
    let mut rows = vec![row("reference", "the oracle", [sum(|c| c.cases), 0, sum(|c| c.failures)], own.clone())];
    for engine in report.engines.iter().filter(|row| row.device.is_some()) {
        let EngineRow { rays, pixels, different, wrong, .. } = *engine;
        // The same hits have the same error; of others the record has none.
        let worst = if different == 0 { own.clone() } else { "–".into() };
        let failed = wrong + u64::from(engine.error.is_some());
        rows.push(row(&engine.name, "the reference", [rays + pixels, different, failed], worst));
    }
    let head = ["engine", "verdict", "failures", "worst error / bound", "cases", "other hits", "judged by"];
    PageTable {
        caption: "Hard rays by engine".into(),
        notes: vec![
            "Bound: how far rounding may move a hit, as the oracle derives it. Engines whose hits are the reference's in every bit have its \
             worst error."
                .into(),
        ],
        head: head.map(Into::into).into(),
        left: 2,
        cards: false,
        rows,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::needs_bench::{Cell, EngineRow, Needed, SCHEMA, Unread};
    use crate::paper_bench::check::Agreement;
    use crate::sweep_bench::sample::report;
    use esvo_core::Device;

    fn record(unread: Unread, upload_bytes: u64) -> NeedsReport {
        let cell = |variant, seconds: &[f64]| Cell {
            engine: 0,
            variant,
            agreement: Agreement::default(),
            seconds: seconds.to_vec(),
            guard: Default::default(),
        };
        let case = |levels, cells| Case {
            scene: "SIBENIK".into(),
            levels,
            file_bytes: 1,
            image_bytes: 1,
            image_sha256: String::new(),
            upload_bytes,
            unread,
            needs: Needed { contours: false, far_pointers: false, sizes: false },
            rays: 1,
            cells,
        };
        let device = Device { name: "Example".into(), kind: DeviceKind::Cpu, detail: String::new() };
        NeedsReport {
            schema: SCHEMA,
            machine: report(Vec::new()).machine,
            options: None,
            size: [1, 1],
            credits: Vec::new(),
            calibration: None,
            engines: vec![EngineRow { name: "scalar".into(), device }],
            cases: vec![
                case(7, vec![cell(Variant::Everything, &[1.0, 1.1]), cell(Variant::All, &[0.5, 0.6])]),
                case(10, vec![cell(Variant::Everything, &[1.0]), cell(Variant::All, &[1.0])]),
            ],
            left_out: Vec::new(),
            seconds: 1.0,
        }
    }

    #[test]
    fn what_leaving_out_saves_is_said() {
        let lines = needs(&record(Unread { contour_halves: 20, headers: 1, gaps: 4 }, 100));
        assert_eq!(
            lines[0],
            "scalar (Example), with only what octree and rays need: at 7 levels 48 % less time in the middle of 1 cases (48 % less to 48 % \
             less), beyond the quartiles 1 are faster and 0 slower; at 10 levels 0 % less time in the middle of 1 cases (0 % less to 0 % \
             less), beyond the quartiles 0 are faster and 0 slower. Medians and quartiles are those of the rounds."
        );
        assert!(
            lines[1].contains("takes 56 bytes for 7 levels and 80 bytes for 10 levels, not the 184 bytes"),
            "{}",
            lines[1]
        );
        assert!(
            lines[2].ends_with("Kept although no caster reads them: 25 to 25 % of the upload of octrees of cubes."),
            "{}",
            lines[2]
        );
        assert!(needs(&record(Unread::default(), 0))[2].contains("older"));
    }
}
