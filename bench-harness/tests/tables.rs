//! The layout of the tables, on a report with made-up figures.

mod common;

use std::path::Path;

use esvo_bench::build_bench::BuildReport;
use esvo_bench::format_bench::FormatReport;
use esvo_bench::paper_bench::matrix::Variant;
use esvo_bench::paper_bench::report::PaperReport;
use esvo_bench::paper_bench::tables;
use esvo_core::DeviceKind;
use esvo_engines::EngineId;
use esvo_scenes::SceneVariant;

use common::fake_report;

#[test]
fn text() {
    insta::assert_snapshot!(tables::to_text(&fake_report()));
}

#[test]
fn markdown() {
    insta::assert_snapshot!(tables::to_markdown(&fake_report()));
}

/// Whatever a scene is called, no figure of the paper or its authors stands next to a mesh that they were not measured on.
#[test]
fn another_mesh_is_named_and_has_no_figures_of_the_paper_next_to_it() {
    let mut report = fake_report();
    let figures = ["contours, paper", "contours, authors"];
    let rows = |report: &PaperReport| {
        let tables = tables::tables(report);
        let rows = tables.iter().flat_map(|t| t.rows.iter().map(|row| row.join(" | ")));
        rows.collect::<Vec<_>>()
    };
    let paper_of = |rows: &[String]| rows.iter().filter(|row| figures.iter().any(|f| row.contains(f))).count();
    assert!(paper_of(&rows(&report)) >= 2);
    report.scenes.truncate(1);
    report.scenes[0].mesh = SceneVariant::Other;
    for name in ["SIBENIK", "SIBENIK: another mesh, sibenik.obj, sha256 0123456789ab"] {
        report.scenes[0].name = name.into();
        let rows = rows(&report);
        assert_eq!(paper_of(&rows), 0, "{rows:?}");
        // Columns of Table 2 with the paper's times are empty.
        let tables = tables::tables(&report);
        let with_paper: Vec<_> =
            tables.iter().filter(|t| t.head.last().is_some_and(|h| h.starts_with("paper"))).collect();
        assert!(!with_paper.is_empty());
        for table in with_paper {
            let first = table.head.iter().position(|h| h.starts_with("paper")).unwrap();
            assert!(table.rows.iter().all(|row| row[first..].iter().all(|cell| cell == "-" || cell.is_empty())));
        }
        assert!(!rows.iter().any(|row| row.contains("real mesh")));
    }
    let json = report.to_json();
    assert!(json.contains("\"mesh\": \"other\""), "{json}");
    assert!(PaperReport::from_json(&json).unwrap() == report);
}

#[test]
fn the_record_survives_json() {
    let report = fake_report();
    let again = PaperReport::from_json(&report.to_json()).unwrap();
    assert!(again == report, "not all of it comes back");
    assert!(PaperReport::from_json(&report.to_json().replacen("\"schema\": 1", "\"schema\": 2", 1)).is_err());
    assert!(PaperReport::from_json("{}").is_err());
}

#[test]
fn wrong_answers_are_failures() {
    let mut report = fake_report();
    assert!(!report.passed());
    let failures: Vec<_> = report.failures().map(|(scene, c)| (scene.to_string(), c.backend, c.variant)).collect();
    assert_eq!(failures, [("SIBENIK".to_string(), EngineId::Ash, Variant::Beam)]);
    report.scenes.remove(0);
    assert!(report.passed());
    // A caster that failed has compared no pixels.
    report.scenes[0].checks[0].agreement.pixels = 0;
    assert!(!report.passed());
}

/// Records are kept for years: those of earlier versions must be read, and written again with the same kinds.
#[test]
fn the_records_under_results_are_read() {
    let results = Path::new(env!("CARGO_MANIFEST_DIR")).join("../results/amd-epyc-2-threads");
    let text = std::fs::read_to_string(results.join("2026-11-23/report.json")).unwrap();
    let report = PaperReport::from_json(&text).unwrap();
    assert!(report.passed());
    let meshes: Vec<_> = report.scenes.iter().map(|scene| (scene.name.as_str(), scene.mesh)).collect();
    assert!(meshes.contains(&("SIBENIK", SceneVariant::Real)) && meshes.contains(&("HAIRBALL", SceneVariant::StandIn)));
    let kinds: Vec<_> = report.devices.iter().map(|device| (device.backend, device.kind)).collect();
    assert!(
        kinds.contains(&(EngineId::Cpu, DeviceKind::Cpu)) && kinds.contains(&(EngineId::Ash, DeviceKind::SoftwareGpu))
    );
    // Both are stored as the words that they have always been.
    let parse = |text: &str| -> serde_json::Value { serde_json::from_str(text).unwrap() };
    let (old, new) = (parse(&text), parse(&report.to_json()));
    for index in 0..3 {
        assert_eq!(new["devices"][index]["kind"], old["devices"][index]["kind"]);
        assert_eq!(new["scenes"][index]["mesh"], old["scenes"][index]["mesh"]);
    }
    assert_eq!((&old["devices"][2]["kind"], &old["scenes"][2]["mesh"]), (&"software-gpu".into(), &"stand-in".into()));

    for name in ["build", "build-table1", "build-city16"] {
        let text = std::fs::read_to_string(results.join(format!("2026-11-23-build/{name}.json"))).unwrap();
        let report: BuildReport = serde_json::from_str(&text).unwrap();
        let (old, new) = (parse(&text), parse(&report.to_json()));
        assert!(!report.scenes.is_empty(), "{name}");
        for index in 0..report.scenes.len() {
            assert_eq!(new["scenes"][index]["mesh"], old["scenes"][index]["mesh"], "{name}");
            assert_eq!(new["scenes"][index]["stopped"], old["scenes"][index]["stopped"], "{name}");
        }
    }
    let text = std::fs::read_to_string(results.join("2026-11-23-format/report.json")).unwrap();
    let report: FormatReport = serde_json::from_str(&text).unwrap();
    assert!(!report.octrees.is_empty() && !report.large.access.is_empty());
}

/// The authors' viewpoints are told from ours, and from theirs on a mesh that is not theirs.
#[test]
fn viewpoints_are_told_apart() {
    let mut report = fake_report();
    for scene in &mut report.scenes {
        scene.views[0].name = "paper-1".into();
    }
    let said = tables::to_text(&report);
    assert!(
        said.contains(
            "Viewpoints: SIBENIK 1 of the paper's authors; HAIRBALL 1 of the paper's authors, on our stand-in."
        ),
        "{said}"
    );
    assert!(tables::to_text(&fake_report()).contains("Viewpoints: SIBENIK 1 of our own; HAIRBALL 1 of our own."));
}

#[test]
fn csv() {
    let csv = tables::to_csv(&fake_report());
    let columns: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
    assert!(columns.iter().all(|count| *count == columns[0]), "{columns:?}");
    insta::assert_snapshot!(csv);
}

/// Nothing here runs LaTeX: rows have as many columns as the table, and environments and braces end.
#[test]
fn latex() {
    let mut report = fake_report();
    report.scenes[1].name = "A_B & 100% {of} #1".into();
    let text = tables::to_latex(&report);
    let mut environments = Vec::new();
    let mut columns = 0;
    for line in text.lines().filter(|line| !line.starts_with('%')) {
        let open = line.matches('{').count() - line.matches("\\{").count();
        assert_eq!(open, line.matches('}').count() - line.matches("\\}").count(), "{line}");
        if let Some(rest) = line.strip_prefix("\\begin{") {
            let (name, rest) = rest.split_once('}').unwrap();
            environments.push(name.to_owned());
            columns = rest.matches(['l', 'r']).count();
        } else if let Some(rest) = line.strip_prefix("\\end{") {
            assert_eq!(environments.pop().as_deref(), rest.strip_suffix('}'));
        } else if let Some(row) = line.strip_suffix(" \\\\") {
            let spans = row.matches("\\multicolumn{3}").count() * 2;
            let cells = row.matches(" & ").count() + 1;
            assert_eq!(cells + spans, columns, "{row}");
        }
    }
    assert!(environments.is_empty());
    assert_eq!(text.matches("\\begin{tabular}").count(), 4);
    insta::assert_snapshot!(text);
}
