//! What the page says of several records of one machine: where they differ, what one says otherwise than another, GPU against processor.

use esvo_bench::page::make_page;
use esvo_bench::paper_bench::report::PaperReport;

use crate::common::fake_report;
use crate::{options, records, texts};

/// Two records of one machine with the same scenes, and what their page says of them, without white space of the source.
fn of_two_records(change: impl FnOnce(&mut PaperReport)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let mut second = fake_report();
    second.machine.date = "2026-01-03T03:04:05Z".into();
    second.machine.commit = "ba9876543210".into();
    change(&mut second);
    for (name, report) in [("a", fake_report()), ("b", second)] {
        std::fs::create_dir_all(folder.path().join(name)).unwrap();
        std::fs::write(folder.path().join(name).join("report.json"), report.to_json()).unwrap();
    }
    texts(&make_page(&options(&[folder.path()])).unwrap().html)
}

#[test]
fn what_records_of_one_machine_differ_in_is_said() {
    let differ = of_two_records(|second| {
        for cell in second.scenes.iter_mut().flat_map(|scene| &mut scene.times) {
            cell.samples.seconds.truncate(1);
            let is_slow = cell.backend == esvo_engines::EngineId::Ash && cell.size == [512, 384];
            cell.samples.seconds[0][0] *= if is_slow { 5.0 } else { 1.0 };
        }
        second.scenes[0].builds[1].bytes *= 2;
        second.devices[0].detail = "AVX-512, 16 lanes, 2 threads".into();
    });
    for part in [
        "No: the same is up to 4.50 times as fast in one record as in another. Compare times within one record alone.",
        "esvo bench of 2026-01-03 and esvo bench of 2026-01-02: 5 of 42 rates of the same differ by more than 1.5 times, by up to 4.50:",
        "the commits are ba9876543210 and 0123456789ab; 1 octree has another size; esvo bench of 2026-01-03 has one round, and so no spread; esvo bench of \
         2026-01-02 was disturbed, as its times are 1.11 times their least in the middle.",
        "Records keep no clock of a GPU, which falls while the GPU waits.",
        "No: of 8 octrees that several records have, 1 differ in size, by up to 2.00 times.",
        "Most: SIBENIK, 9 levels, contours: 16.0 MB in esvo bench of 2026-01-03 (commit ba9876543210); 8.00 MB in esvo bench of 2026-01-02 \
         (commit 0123456789ab).",
        "2 threads in esvo bench of 2026-01-02; AVX-512 in esvo bench of 2026-01-03.",
        // Beside the tables that they are about.
        "esvo bench of 2026-01-02 timed some of the same, and the two differ by up to 4.50 times",
        "The processor was used by AVX-512 here, by 2 threads in esvo bench of 2026-01-02.",
        "1 of these octrees has another size in another record, by up to 2.00 times (SIBENIK, 9 levels, contours)",
        "Table 2: rays per second (2026-01-03)",
        "Between the records",
        "is not answered for this machine: it has no record of esvo bench sweep",
    ] {
        assert!(differ.contains(part), "{part}\n{differ}");
    }
    // Records that agree are said to, and nothing of the kind is said of them.
    let agree = of_two_records(|_| ());
    for part in [
        "Yes: the same is at most 1.00 times as fast in another record.",
        "Yes: the 8 octrees that several records have",
    ] {
        assert!(agree.contains(part), "{part}\n{agree}");
    }
    for part in
        ["Between the records", "the two differ by", "another size in another record", "The processor was used by"]
    {
        assert!(!agree.contains(part), "{part}");
    }
}

#[test]
fn gpu_clocks_of_older_records_are_said() {
    let guarded = |date: &str| {
        of_two_records(|second| {
            second.machine.date = date.into();
            for cell in second.scenes.iter_mut().flat_map(|scene| &mut scene.times) {
                cell.samples.guard.calibration_seconds = vec![vec![0.001]; 3];
            }
        })
    };
    let said = "Times of the GPU are too long: this record was made before 2026-11-27 05:38 UTC";
    let (before, since) = (guarded("2026-11-27T04:55:01Z"), guarded("2026-11-27T06:00:00Z"));
    assert!(before.contains(said) && before.contains("esvo bench of 2026-11-27 was made before"), "{before}");
    assert!(!since.contains(said) && !since.contains("lowered its clock"), "{since}");
}

#[test]
fn a_gpu_is_held_against_the_processor_of_its_machine() {
    let text = of_two_records(|_| ());
    assert!(text.contains("Not everywhere: 1.00 to 1.00 times as many rays per second."), "{text}");
    assert!(text.contains("ash on Example GPU against cpu (2 threads), 512x384: 1.00 times the rays per second in the middle of 5 settings"), "{text}");
    let software = of_two_records(|second| second.devices.retain(|device| device.kind != esvo_core::DeviceKind::Gpu));
    assert!(software.contains("ash on Example GPU against cpu"), "of the other record: {software}");
    let folder = tempfile::tempdir().unwrap();
    let mut report = fake_report();
    report.devices.retain(|device| device.kind != esvo_core::DeviceKind::Gpu);
    std::fs::write(folder.path().join("report.json"), report.to_json()).unwrap();
    let none = texts(&make_page(&options(&[folder.path()])).unwrap().html);
    assert!(none.contains("Not known: no record of this machine timed a GPU.\nllvmpipe is software"), "{none}");
}

/// Table 2 is held against the sweep's answers where it is about the same scene.
#[test]
fn table_2_is_heard_where_it_says_otherwise() {
    let said = |change: &dyn Fn(&mut PaperReport)| {
        let mut report = fake_report();
        let sweep: serde_json::Value = serde_json::from_str(include_str!("../data/sweep.json")).unwrap();
        let scene = &mut report.scenes[0];
        scene.name = sweep["scenes"][0]["name"].as_str().unwrap().into();
        scene.identity = sweep["scenes"][0]["identity"].as_str().unwrap().into();
        change(&mut report);
        // Errors are compared at the sweep's size of pictures.
        for scene in &mut report.scenes {
            scene.errors.iter_mut().for_each(|row| row.size = [64, 48]);
            scene.times.iter_mut().filter(|cell| cell.size == [512, 384]).for_each(|cell| cell.size = [64, 48]);
        }
        let folder = records(&report);
        texts(&make_page(&options(&[folder.path()])).unwrap().html)
    };
    let exact = said(&|report| {
        report.scenes[0].errors.iter_mut().flat_map(|row| &mut row.views).for_each(|view| view.pixels.p90 = 0.25);
    });
    for part in [
        "FAIRY (stand-in) cpu (",
        "64x48, octrees of 4 to 6 levels",
        "None of the sweep&#39;s octrees, of at most 6 levels. Table 2 has one of 10 levels.",
        "Table 2 at 10 levels (esvo bench of 2026-01-02, 3 rounds) says otherwise: contours with the beam have an error of 0.25 px, in 1.60 times the time of the triangles there.",
        "Table 2 at 10 levels (esvo bench of 2026-01-02, 3 rounds) says otherwise: at equal levels contours take 0.75 times the time of cubes",
        "says otherwise at some sizes: with the beam, contours take 0.80 times the time at 64x48 and 0.80 at 1024x768.",
        "no octree is as fast as the triangles",
    ] {
        assert!(exact.contains(part), "{part}\n{exact}");
    }
    // With the error that it has, it has none either; of another mesh, it says nothing.
    let coarse = said(&|_| ());
    assert!(
        !coarse.contains("Table 2 has one of") && coarse.contains("none either; cubes get to 1.50 px."),
        "{coarse}"
    );
    let other = said(&|report| report.scenes[0].identity = "another".into());
    assert!(!other.contains("Table 2 at 10 levels"), "{other}");
}
