//! The benchmark of what code that is not needed costs, on small octrees.

use esvo_bench::Progress;
use esvo_bench::needs_bench::{
    NeedsBenchOptions, NeedsReport, Unread, Variant, run_needs_bench, to_markdown, to_text, write_needs_record,
};

fn small() -> NeedsBenchOptions {
    NeedsBenchOptions {
        // The stand-in, wherever this runs.
        scenes: vec!["fairy".into()],
        levels: vec![4],
        size: [48, 32],
        views: 2,
        rounds: 3,
        ..NeedsBenchOptions::default()
    }
}

#[test]
fn what_is_not_needed_is_left_out_timed_written_and_read_back() {
    let mut report = run_needs_bench(&small(), &Progress::hidden()).unwrap();
    // Cubes and contours, each with and without an end at small voxels.
    assert_eq!(report.cases.len(), 4);
    assert!(report.passed());
    for case in &report.cases {
        assert!(!case.needs.far_pointers, "the octree is small");
        let variants: Vec<Variant> =
            case.cells.iter().filter(|cell| cell.engine == 0).map(|cell| cell.variant).collect();
        let mut expected = vec![Variant::Everything];
        expected.extend((!case.needs.contours).then_some(Variant::Contours));
        expected.push(Variant::FarPointers);
        expected.extend((!case.needs.sizes).then_some(Variant::Sizes));
        expected.push(Variant::All);
        assert_eq!(variants, expected, "{:?}", case.needs);
        // Packets have no code of their own but for octrees without contours.
        let packets = if case.needs.contours { 1 } else { 2 };
        let others = if report.engines.len() > 1 { packets } else { 0 };
        assert_eq!(case.cells.len(), expected.len() + others);
        assert!(case.cells.iter().all(|cell| cell.seconds.len() == 3 && cell.agreement.different_voxel == 0));
        // Attachments are not uploaded, and half of a descriptor is about contours.
        assert!(case.file_bytes > case.image_bytes && case.image_bytes > case.upload_bytes);
        let Unread { contour_halves, headers, gaps } = case.unread;
        assert!(headers > 0 && headers + gaps + contour_halves < case.upload_bytes);
        assert_eq!(contour_halves > 0, !case.needs.contours);
        assert!(case.upload_bytes > 0 && case.rays == 2 * 48 * 32);
    }
    let again: NeedsReport = serde_json::from_str(&report.to_json()).unwrap();
    assert_eq!(again, report);
    for text in [to_text(&report), to_markdown(&report)] {
        let parts = [
            "What octree and rays need",
            "Bytes",
            "not left out although nothing needs it",
            "Milliseconds per view, scalar",
            "only what is needed",
            "no contours",
        ];
        assert!(parts.iter().all(|part| text.contains(part)), "{text}");
    }
    let folder = tempfile::tempdir().unwrap();
    let written = write_needs_record(&report, folder.path(), Some("Some machine")).unwrap();
    assert!(written.ends_with(format!("some-machine/{}-needs", report.machine.day())));
    assert_eq!(std::fs::read_to_string(written.join("tables.md")).unwrap(), to_markdown(&report));

    // Other hits do not pass.
    report.cases[0].cells[1].agreement.different_voxel = 1;
    assert!(!report.passed());
}

/// GPU kernels leave out each thing by itself, and have a stack of as many frames as there are levels.
#[cfg(feature = "ash")]
#[test]
fn gpu_kernels_leave_out_what_is_not_needed() {
    let options = NeedsBenchOptions { engines: vec![esvo_engines::EngineId::Ash], rounds: 1, ..small() };
    let report = match run_needs_bench(&options, &Progress::hidden()) {
        Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_none() => return eprintln!("skipped: {error}"),
        result => result.unwrap(),
    };
    assert!(report.passed() && report.engines.len() == 1 && report.engines[0].name == "ash");
    for case in &report.cases {
        let variants: Vec<Variant> = case.cells.iter().map(|cell| cell.variant).collect();
        let mut expected = vec![Variant::Everything];
        expected.extend((!case.needs.contours).then_some(Variant::Contours));
        expected.push(Variant::FarPointers);
        expected.extend((!case.needs.sizes).then_some(Variant::Sizes));
        expected.extend([Variant::Frames, Variant::All]);
        assert_eq!(variants, expected, "{:?}", case.needs);
    }
}

#[test]
fn what_cannot_be_measured_is_an_error() {
    let fails = |options: NeedsBenchOptions, what: &str| {
        let error = run_needs_bench(&options, &Progress::hidden()).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    };
    fails(NeedsBenchOptions { scenes: vec!["teapot".into()], ..small() }, "the scenes are");
    fails(NeedsBenchOptions { rounds: 0, ..small() }, "at least one round");
    fails(NeedsBenchOptions { levels: vec![23], ..small() }, "less than a billion");
}
