//! `esvo bench voxelize` on SIBENIK, or its stand-in where the mesh is not there: every method that the device has against the exact voxels.
#![cfg(feature = "wgpu")]

use esvo_bench::Progress;
use esvo_bench::journal::Journal;
use esvo_bench::records::{Record, read_record};
use esvo_bench::voxel_bench::{
    MethodRow, SceneGrids, VoxelBenchOptions, VoxelReport, resume_voxel_bench, run_voxel_bench, write_voxel_record,
};

#[test]
fn methods_miss_and_add_what_they_are_known_for() {
    let options = VoxelBenchOptions {
        scenes: vec![SceneGrids { name: "sibenik".into(), levels: vec![8, 9] }],
        rounds: 1,
        pictures: false,
        ..VoxelBenchOptions::default()
    };
    let outcome = match run_voxel_bench(&options, &Progress::hidden()) {
        Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_none() => return println!("skipped: {error}"),
        outcome => outcome.unwrap(),
    };
    let report = &outcome.report;
    assert!(report.passed());
    for grid in &report.scenes[0].grids {
        let of = |letter: &str| grid.methods.iter().find(|row| row.letter == letter);
        let exact = |row: &MethodRow| row.voxels == grid.voxels && row.missing() + row.extra == 0;
        let [a, b, c, clipped, d, g] = ["a", "b", "c", "c'", "d", "g"].map(|letter| of(letter).unwrap());
        assert!(exact(g) && g.fragments == 0, "{g:?}");
        // Extra voxels of d are within the bound, and few.
        assert!(d.missing() == 0 && d.extra < grid.voxels / 1000 && d.beyond_bound == 0, "{d:?}");
        for row in [a, b, c, clipped, d] {
            assert_eq!(row.voxels, grid.voxels - row.missing() + row.extra, "{row:?}");
        }
        assert!(a.missing() > b.missing() && a.holes > 0 && a.cracks > 0 && a.extra == 0, "{a:?}");
        assert!(b.holes > 0 && b.extra == 0, "{b:?}");
        assert!(
            c.holes == 0 && clipped.holes == 0 && c.extra > clipped.extra && clipped.extra > 0,
            "{c:?} {clipped:?}"
        );
        assert!(c.fragments > b.fragments, "{c:?}");
        if let Some(e) = of("e4") {
            assert!(e.holes < b.holes && e.holes > 0, "{e:?}");
        }
        if let Some(tested) = of("f+") {
            assert!(tested.missing() == 0 && tested.beyond_bound == 0, "{tested:?}");
        }
    }
    // Holes become rarer with the size of triangles.
    let holes: Vec<u64> = report.curve.iter().filter(|point| point.letter == "b").map(|point| point.holes).collect();
    assert!(holes.len() == 9 && holes.is_sorted_by(|a, b| a > b), "{holes:?}");
    let folder = tempfile::tempdir().unwrap();
    let made = write_voxel_record(&outcome, folder.path(), Some("m")).unwrap();
    match read_record(&made.join("report.json")).unwrap() {
        Some(Record::Voxelize(read)) => assert_eq!(*read, *report),
        other => panic!("{other:?}"),
    }
}

/// What is in the journal is not measured again, a time limit leaves out grids by name, and a record says what a run that repeats it does.
#[test]
fn runs_go_on_and_keep_to_their_time() {
    let options = VoxelBenchOptions {
        scenes: vec![SceneGrids { name: "fairy".into(), levels: vec![3, 4, 5] }],
        // Without sheets, which are for methods that have holes.
        methods: vec!["g".into()],
        rounds: 1,
        pictures: false,
        time_limit_seconds: Some(1e-3),
        ..VoxelBenchOptions::default()
    };
    let folder = tempfile::tempdir().unwrap();
    let run = |resume: bool, options: &VoxelBenchOptions| {
        let journal = Journal::open(folder.path(), Some("m"), "-x", options, resume).unwrap();
        resume_voxel_bench(options, &journal, &Progress::hidden())
    };
    let first = match run(false, &options) {
        Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_none() => return println!("skipped: {error}"),
        outcome => outcome.unwrap().report,
    };
    let levels = |report: &VoxelReport| report.scenes[0].grids.iter().map(|grid| grid.level).collect::<Vec<_>>();
    assert_eq!(levels(&first), [3]);
    let what: Vec<&str> = first.left_out.iter().map(|left| &left.what[..]).collect();
    assert_eq!(what, ["FAIRY in a grid of 16^3", "FAIRY in a grid of 32^3"]);
    let again = run(true, &options).unwrap().report;
    // Times as well: nothing was measured.
    assert!(again.scenes == first.scenes && again.left_out == first.left_out);
    let fresh = run(false, &options).unwrap().report;
    assert!(fresh.scenes != first.scenes && levels(&fresh) == [3]);

    let repeated = VoxelBenchOptions::of_record(&first);
    assert_eq!((repeated.scenes[0].levels.clone(), repeated.time_limit_seconds), (vec![3], None));
    let twice = run(false, &repeated).unwrap().report;
    assert!(levels(&twice) == [3] && twice.left_out == first.left_out);
    assert_eq!(VoxelBenchOptions::of_record(&twice), repeated);
}
