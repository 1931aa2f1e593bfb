//! The benchmark of the paper's tables, on small octrees.

use std::path::Path;

use esvo_bench::paper_bench::matrix::Variant;
use esvo_bench::paper_bench::report::PaperReport;
use esvo_bench::paper_bench::{PaperBenchOptions, run_paper_bench, tables, write_paper_record};
use esvo_bench::{Matrix, Progress};
use esvo_core::Picture;
use esvo_core::picture::write_png;
use esvo_engines::EngineId;

/// A matrix of one scene at two levels.
fn matrix(scene: &str) -> Matrix {
    let mut matrix = Matrix::default_run();
    matrix.select_scenes(&[scene.into()]);
    matrix.scenes[0].levels = vec![4, 5];
    matrix.views = 1;
    matrix.rounds = 2;
    matrix.time_limit_seconds = None;
    matrix.resolutions = vec![[48, 36]];
    matrix.backends = vec![EngineId::Reference, EngineId::Cpu];
    matrix
}

/// A floor with a height map, in a manifest of its own.
fn bumpy_floor(folder: &Path) {
    let put = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    put(
        "floor.obj",
        "mtllib floor.mtl\nv 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl a\nf 1/1 4/4 3/3 2/2\n",
    );
    put("floor.mtl", "newmtl a\nKd 0.8 0.8 0.8\nmap_bump -bm 60 height.png\n");
    let height = Picture::from_fn((64, 64), |x, y| [if (x / 16 + y / 16) % 2 == 0 { 1.0 } else { 0.0 }; 3]);
    write_png(&folder.join("height.png"), &height).unwrap();
    put(
        "scenes.toml",
        "version = 1\n[[scene]]\nname = \"FLOOR\"\ndisplaced = true\n[[scene.mesh]]\nfile = \"floor.obj\"\ncameras = [{ name = \"above\", \
         eye = [0.5, 1.2, 1.4], target = [0.5, 0, 0.5], up = [0, 1, 0], fov = 50, near = 0.05, far = 5 }]\n",
    );
}

#[test]
fn a_displaced_mesh_is_compared_with_its_own_triangles_at_every_level() {
    let folder = tempfile::tempdir().unwrap();
    bumpy_floor(folder.path());
    let options = PaperBenchOptions {
        matrix: matrix("floor"),
        scenes_dir: None,
        manifest: Some(folder.path().join("scenes.toml")),
        threads: None,
        slowed: Vec::new(),
        views: Vec::new(),
    };
    let outcome = run_paper_bench(&options, &Progress::hidden()).unwrap();
    let report = &outcome.report;
    assert!(report.passed(), "{:?}", report.failures().collect::<Vec<_>>());
    let scene = &report.scenes[0];
    assert_eq!((scene.triangles, scene.builds.len()), (2, 4));
    let triangles = |levels: u32| scene.build(true, levels).unwrap().displaced_triangles.unwrap();
    assert!(triangles(4) > 2 && triangles(5) > 2 * triangles(4), "{} and {}", triangles(4), triangles(5));
    // Were they compared with the flat floor, contours would not be nearer with each level.
    let error = |levels: u32| {
        let row = scene.errors.iter().find(|e| e.variant == Variant::Contours && e.levels == levels).unwrap();
        assert!(row.mean(|v| v.both_hit as f64) > 1000.0);
        row.mean(|v| v.voxels.p90)
    };
    assert!(error(4) < 2.0 && error(5) < 2.0, "in edges of the finest voxel: {} and {}", error(4), error(5));
    // The triangle column is there.
    let engine = EngineId::Cpu;
    assert!(scene.time(engine, Variant::Triangles, [48, 36]).and_then(|cell| cell.mrays).is_some());
    assert!(tables::to_text(report).contains("2 + disp."));
}

#[test]
fn a_scene_whose_mesh_is_not_there_is_left_out_unless_it_is_the_only_one() {
    let folder = tempfile::tempdir().unwrap();
    bumpy_floor(folder.path());
    let scenes = std::fs::read_to_string(folder.path().join("scenes.toml")).unwrap();
    let absent = "[[scene]]\nname = \"GONE\"\n[[scene.mesh]]\nfile = \"gone.obj\"\ncameras = [{ name = \"a\", eye = [0, 1, 1], \
                  target = [0, 0, 0], up = [0, 1, 0], fov = 50, near = 0.05, far = 5 }]\n";
    std::fs::write(folder.path().join("scenes.toml"), scenes + absent).unwrap();
    let run = |names: &[&str]| {
        let mut matrix = matrix("floor");
        matrix.select_scenes(&names.iter().map(ToString::to_string).collect::<Vec<_>>());
        matrix.variants = vec![Variant::Contours];
        let manifest = Some(folder.path().join("scenes.toml"));
        run_paper_bench(&PaperBenchOptions { manifest, ..PaperBenchOptions::new(matrix) }, &Progress::hidden())
    };
    let report = run(&["gone", "floor"]).unwrap().report;
    assert_eq!(report.scenes.iter().map(|scene| &scene.name[..]).collect::<Vec<_>>(), ["FLOOR"]);
    assert!(report.left_out.iter().any(|left| left.what == "GONE" && left.reason.contains("gone.obj")), "{report:?}");
    let error = run(&["gone"]).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("GONE") && error.contains("gone.obj"), "{error}");
}

#[test]
fn levels_that_are_hit_the_filter_and_the_pictures_are_recorded() {
    // The stand-in, wherever this runs.
    let options = PaperBenchOptions {
        matrix: matrix("fairy"),
        scenes_dir: None,
        manifest: None,
        threads: None,
        slowed: Vec::new(),
        views: Vec::new(),
    };
    let outcome = run_paper_bench(&options, &Progress::hidden()).unwrap();
    let report = &outcome.report;
    let scene = &report.scenes[0];
    assert_eq!(scene.errors.len(), 6);
    for row in &scene.errors {
        let hits: u64 = row.hit_levels.iter().flatten().sum();
        let both: u64 = row.views.iter().map(|view| view.both_hit + view.only_octree).sum();
        assert_eq!(hits, both);
        let mean = row.mean_hit_level().unwrap();
        assert!(mean > 1.0 && mean <= f64::from(row.levels), "{mean}");
    }
    let mean = |levels: u32| {
        scene
            .errors
            .iter()
            .find(|e| e.levels == levels && e.variant == Variant::Cubical)
            .unwrap()
            .mean_hit_level()
            .unwrap()
    };
    assert!(mean(4) < mean(5));
    for engine in [EngineId::Reference, EngineId::Cpu] {
        let filter = scene.filter(engine, [48, 36]).unwrap();
        assert!(
            filter.seconds.len() == 2 && filter.blurred > 0.5 && filter.milliseconds().unwrap().median > 0.0,
            "{filter:?}"
        );
    }
    let kinds = ["cubical", "contours", "triangles"];
    assert_eq!(scene.pictures.len(), 3);
    assert!(
        scene.pictures.iter().zip(kinds).all(|(name, kind)| name.ends_with(&format!("{kind}.png"))),
        "{:?}",
        scene.pictures
    );
    assert!(outcome.pictures[1].picture != outcome.pictures[2].picture);

    let text = tables::to_text(report);
    for part in ["The largest octree that fits 4 GB", "predicted", "filter ms", "mean level hit"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(tables::to_csv(report).contains(",filter time,ms,"));
    assert!(tables::to_latex(report).contains("filter, ms"));
    let folder = tempfile::tempdir().unwrap();
    let written = write_paper_record(&outcome, folder.path(), Some("m")).unwrap();
    for name in ["report.json", "tables.md", "tables.csv", "tables.tex"] {
        assert!(written.join(name).is_file(), "{name}");
    }
    let again = PaperReport::from_json(&std::fs::read_to_string(written.join("report.json")).unwrap()).unwrap();
    assert!(again == *report);
}
