//! The figures of the project's README are those of the stored records.

use std::path::Path;

use esvo_bench::PaperReport;
use esvo_bench::paper_bench::matrix::Variant;
use esvo_bench::paper_bench::report::SceneReport;
use esvo_bench::records::{Record, read_record};
use esvo_bench::stability_bench::StabilityReport;
use esvo_bench::voxel_bench::{Grid, MethodRow};
use esvo_engines::EngineId;

const FOLDER: &str = "results/amd-epyc-2-threads/2026-11-27";

fn read(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)).unwrap()
}

/// The cells of the rows of README that have as many as this.
fn rows(columns: usize) -> Vec<Vec<String>> {
    let cells = |line: &str| line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    let readme = read("README.md");
    let section = readme.split("## What it finds").nth(1).and_then(|text| text.split("\n## ").next()).unwrap();
    section.lines().filter(|line| line.starts_with("| ")).map(cells).filter(|row| row.len() == columns).collect()
}

/// The row of a scene as the README writes it.
fn row(scene: &SceneReport) -> Vec<String> {
    let last = |variant: Variant| scene.errors.iter().rev().find(|row| row.variant == variant).unwrap();
    let levels = last(Variant::Contours).levels;
    let rate = |variant| {
        let mrays = scene.time(EngineId::Cpu, variant, [1024, 768]).and_then(|cell| cell.mrays).unwrap();
        format!("{:.1}", mrays.median)
    };
    let error = |variant: Variant| {
        let p90 = last(variant).mean(|view| view.pixels.p90);
        if p90 < 1.0 { format!("{p90:.2}") } else { format!("{p90:.1}") }
    };
    let mib = |contours| {
        let mib = scene.build(contours, levels).unwrap().mib();
        if mib < 100.0 { format!("{mib:.1}") } else { format!("{mib:.0}") }
    };
    let name = if scene.name == "SIBENIK-D" { "SIBENIK-D, displaced" } else { &scene.name };
    let rates = [Variant::Triangles, Variant::Cubical, Variant::Contours].map(rate);
    let errors = [Variant::Cubical, Variant::Contours].map(error);
    [&[name.into(), levels.to_string()][..], &rates, &errors, &[mib(false), mib(true)]].concat()
}

#[test]
fn the_sentence_on_voxelization_is_the_records() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../{FOLDER}-voxelize/report.json"));
    let Some(Record::Voxelize(report)) = read_record(&path).unwrap() else {
        panic!("{} is another record", path.display())
    };
    let grids = || report.scenes.iter().flat_map(|scene| &scene.grids);
    let rows = |letter: &'static str| {
        grids().flat_map(move |grid| {
            grid.methods.iter().filter(move |row| row.letter == letter).map(move |row| (grid, row))
        })
    };
    let percent = |(grid, row): (&Grid, &MethodRow)| 100.0 * row.missing() as f64 / grid.voxels as f64;
    let (least, most) =
        rows("b").map(percent).fold((100.0, 0f64), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
    let extra = rows("d").map(|(grid, row)| 1e6 * row.extra as f64 / grid.voxels as f64).fold(0.0, f64::max);
    assert!(rows("d").all(|(_, row)| row.missing() == 0) && rows("g").all(|(_, row)| row.missing() + row.extra == 0));
    let words = read("README.md").split_whitespace().collect::<Vec<_>>().join(" ");
    for expected in [
        format!(
            "{} of ten on llvmpipe",
            ["no", "one", "two", "three", "four", "five", "six", "seven"][grids().next().unwrap().methods.len()]
        ),
        format!("misses {least:.0} to {most:.0} % of the voxels"),
        format!("miss none and add at most {extra:.0} in a million"),
        "the compute shader has no difference at all".into(),
    ] {
        assert!(words.contains(&expected), "{expected}");
    }
}

#[test]
fn the_table_of_scenes_is_the_records() {
    let report = PaperReport::from_json(&read(&format!("{FOLDER}/report.json"))).unwrap();
    let written = rows(9);
    assert_eq!(written.len(), 7, "the head and six scenes: {written:?}");
    for found in &written[1..] {
        let name = found[0].split(',').next().unwrap();
        let scene = report.scenes.iter().find(|scene| scene.name == name).unwrap();
        assert_eq!(*found, row(scene));
    }
    let checks = || report.scenes.iter().flat_map(|scene| &scene.checks);
    let (pixels, different) = checks().fold((0, 0), |(pixels, different), check| {
        (pixels + check.agreement.pixels, different + check.agreement.different_voxel)
    });
    assert_eq!((report.scenes.len(), checks().count(), different, (pixels as f64 / 1e6).round()), (9, 99, 0, 130.0));
    assert!(
        read("README.md").contains("nine scenes, all viewpoints, 99 checks of every engine over 130 million pixels")
    );
}

#[test]
fn the_table_of_hard_rays_is_the_records() {
    let report: StabilityReport = serde_json::from_str(&read(&format!("{FOLDER}-stability/report.json"))).unwrap();
    assert!(report.passed());
    let number = |cell: &str| cell.replace(',', "").parse::<u64>().unwrap();
    let written = rows(4);
    assert_eq!(written.len(), 4, "the head, the reference, the processor and GPUs: {written:?}");
    let worst = report.cells.iter().map(|cell| cell.worst).fold(0.0, f64::max);
    assert!(written[1][0].contains(&format!("{worst:.3} of its bound")), "{worst}");
    for (row, engine) in written[2..].iter().zip(["cpu, ", "wgpu"]) {
        for found in report.engines.iter().filter(|found| found.name.starts_with(engine)) {
            let counts = [found.rays + found.pixels, found.different, found.wrong];
            assert_eq!(counts, [&row[1], &row[2], &row[3]].map(|cell| number(cell)), "{}", found.name);
        }
    }
    assert_eq!(number(&written[1][1]), number(&written[2][1]));
}
