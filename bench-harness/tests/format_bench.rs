//! The benchmark of the format on small octrees.

use esvo_bench::format_bench::{
    FormatBenchOptions, FormatReport, run_format_bench, to_markdown, to_text, write_format_record,
};
use esvo_bench::{BenchError, Progress};

fn small() -> FormatBenchOptions {
    FormatBenchOptions { large_bytes: 4 << 20, levels: 5, block_slots: 256, seconds: 0.0, files: Vec::new() }
}

#[test]
fn everything_is_measured_written_and_read_back() {
    let report = run_format_bench(&small(), &Progress::hidden()).unwrap();
    assert_eq!(report.octrees.len(), 2);
    let stored: Vec<_> = report.storage.iter().map(|row| (row.zstd, row.parts)).collect();
    let (plain, parts) = ([None, Some(1), Some(3), Some(9)], [Some(3), Some(9)]);
    assert_eq!(stored, [&plain.map(|zstd| (zstd, false))[..], &parts.map(|zstd| (zstd, true))].concat());
    // Streams of fields are smaller than compressed blocks.
    assert!(report.storage[4].file_bytes < report.storage[2].file_bytes);
    assert!(report.storage.iter().all(|row| row.file_bytes <= report.storage[0].file_bytes));
    let names: Vec<_> = report.validation.iter().map(|row| row.name.as_str()).collect();
    let large = "large file, checksums alone";
    let checksums = [format!("{large}, 1 thread"), format!("{large}, 2 threads")];
    assert_eq!(names[..3], ["contours, colours, normals", "descriptors alone", "large file"]);
    assert_eq!(names[3..], checksums);
    assert!((3 << 20..5 << 20).contains(&report.large.file_bytes), "{}", report.large.file_bytes);
    assert!(report.validation.iter().all(|row| row.time.seconds.len() >= 5 && row.time.best() > 0.0));

    // Opening reads the tables only; reading a block adds one read.
    let [open, block, coarse, mapped] = &report.large.access[..] else { panic!("{:?}", report.large.access) };
    let table = report.large.blocks * 72;
    assert!((table..table + 100_000).contains(&open.bytes.unwrap()), "{open:?}");
    assert!(block.reads == open.reads.map(|n| n + 1) && block.bytes > open.bytes && block.pages > open.pages);
    assert!(coarse.bytes > open.bytes && coarse.bytes.unwrap() < report.large.file_bytes);
    assert!(mapped.bytes.is_none() && (cfg!(not(target_os = "linux")) || mapped.pages.unwrap() > 0));

    let again: FormatReport = serde_json::from_str(&report.to_json()).unwrap();
    assert_eq!(again, report);
    for text in [to_text(&report), to_markdown(&report)] {
        assert!(text.contains("zstd 3") && text.contains("large file") && text.contains("open by mapping"), "{text}");
    }
    let folder = tempfile::tempdir().unwrap();
    let written = write_format_record(&report, folder.path(), Some("Some machine")).unwrap();
    let second = write_format_record(&report, folder.path(), Some("Some machine")).unwrap();
    assert!(written.ends_with(format!("some-machine/{}-format", report.machine.day())));
    assert!(second.ends_with(format!("some-machine/{}-format.2", report.machine.day())));
    assert_eq!(std::fs::read_to_string(written.join("report.json")).unwrap(), report.to_json());
    assert_eq!(std::fs::read_to_string(written.join("tables.md")).unwrap(), to_markdown(&report));
}

#[test]
fn what_cannot_be_measured_is_an_error() {
    let fails = |settings: FormatBenchOptions, what: &str| {
        let error: BenchError = run_format_bench(&settings, &Progress::hidden()).unwrap_err();
        assert!(error.to_string().contains(what), "{error}");
    };
    fails(FormatBenchOptions { large_bytes: 1, ..small() }, "1 MiB to 32 GiB");
    fails(FormatBenchOptions { levels: 1, ..small() }, "2 to 14");
    fails(FormatBenchOptions { seconds: f64::NAN, ..small() }, "NaN seconds");
    fails(FormatBenchOptions { files: vec!["absent.esvo".into()], ..small() }, "absent.esvo");
}
