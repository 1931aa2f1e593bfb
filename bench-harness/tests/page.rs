//! The page that is made of records: what it says, what it must not contain, and that its script runs in a browser.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::fake_report;
use esvo_bench::output::NamedPicture;
use esvo_bench::page::{MadePage, PageOptions, make_page};
use esvo_bench::paper_bench::matrix::Variant;
use esvo_bench::paper_bench::report::PaperReport;
use esvo_core::Picture;

fn options(inputs: &[&Path]) -> PageOptions {
    PageOptions {
        inputs: inputs.iter().map(|path| path.to_path_buf()).collect(),
        title: "A title & more".into(),
        picture_bytes: 1_000_000,
    }
}

/// A folder with a record of the paper's tables, its pictures, and one of a sweep.
fn records(report: &PaperReport) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    put("tables/report.json", &report.to_json());
    put("sweep/report.json", include_str!("data/sweep.json"));
    put("notes.json", "{}");
    for (index, name) in report.scenes.iter().flat_map(|scene| &scene.pictures).enumerate() {
        let picture = Picture::from_fn((64, 48), |x, y| [x as f32 / 64.0, y as f32 / 48.0, index as f32 / 4.0]);
        // A name that leaves the folder has no file of this test.
        if !name.contains('/') {
            NamedPicture { name: name.clone(), picture }.write(&folder.path().join("tables")).unwrap();
        }
    }
    folder
}

/// The record with two pictures for each scene.
fn with_pictures() -> PaperReport {
    let mut report = fake_report();
    for scene in &mut report.scenes {
        let name = scene.name.to_lowercase();
        scene.pictures = vec![format!("{name}-10-contours.png"), format!("{name}-triangles.png")];
    }
    report
}

fn page() -> MadePage {
    let folder = records(&with_pictures());
    make_page(&options(&[folder.path()])).unwrap()
}

/// The texts of a page, a line for each element, without its style and script.
fn texts(html: &str) -> String {
    let mut rest = html;
    let mut out = String::new();
    while let Some(start) = rest.find('<') {
        out += &rest[..start];
        let end = ["style", "script"].iter().find(|tag| rest[start + 1..].starts_with(**tag));
        let after = match end {
            Some(tag) => rest.find(&format!("</{tag}>")).unwrap() + tag.len() + 3,
            None => start + rest[start..].find('>').unwrap() + 1,
        };
        let inline = ["<code", "</code", "<td", "</td", "<th>", "<th ", "</th", "<small", "</small"];
        let tag = &rest[start..after];
        out += if inline.iter().any(|name| tag.starts_with(name)) { " " } else { "\n" };
        rest = &rest[after..];
    }
    let lines = out.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
    lines.filter(|line| !line.is_empty()).map(|line| line + "\n").collect()
}

#[test]
fn what_the_page_says() {
    let page = page();
    assert_eq!((page.records, page.pictures), (2, 4));
    assert_eq!(page.wrong, ["ash"]);
    insta::assert_snapshot!(texts(&page.html));
}

#[test]
fn a_wrong_engine_is_named_and_otherwise_none() {
    let said = |report: &PaperReport| {
        let folder = records(report);
        let html = make_page(&options(&[&folder.path().join("tables")])).unwrap().html;
        let start = html.find("Which engine is wrong?").unwrap();
        texts(&html[start..start + html[start..].find("</article>").unwrap()])
    };
    let mut report = fake_report();
    let text = said(&report);
    assert!(text.contains("ash is wrong.") && !text.contains("None."), "{text}");
    assert!(
        text.contains("SIBENIK, octree, with beam: 1234 of 196608 rays end elsewhere, and 1 are allowed"),
        "{text}"
    );
    assert!(text.contains("cpu and wgpu are right."), "{text}");
    for check in report.scenes.iter_mut().flat_map(|scene| &mut scene.checks) {
        check.agreement.different_voxel = 0;
    }
    let text = said(&report);
    assert!(text.contains("None.") && !text.contains("is wrong."), "{text}");
    // Too large a difference in the distance is wrong, too.
    report.scenes[0].checks[0].agreement.largest_t_difference = 1e-3;
    assert!(said(&report).contains("cpu is wrong."), "{}", said(&report));
}

/// Everything is in the file: it names no other, and runs no script but its own.
#[test]
fn the_page_stands_alone_and_texts_are_escaped() {
    let mut report = with_pictures();
    report.scenes[0].name = "<script>alert(1)</script>\"'&".into();
    report.scenes[0].credit = "<img src=x onerror=alert(2)>".into();
    let folder = records(&report);
    let html = make_page(&options(&[folder.path()])).unwrap().html;
    assert_eq!(html.matches("<script").count(), 1);
    assert!(!html.contains("<img src=x") && html.contains("&#60;script&#62;alert(1)"), "not escaped");
    assert!(html.contains("<title>A title &#38; more</title>"));
    for outside in ["http:", "https:", "<link", "@import", "url(", "fetch(", "XMLHttp"] {
        assert!(!html.contains(outside), "{outside}");
    }
    assert_eq!(html.matches("src=\"").count(), html.matches("src=\"data:image/png;base64,").count());
    assert!(html.contains("default-src 'none'"));
}

#[test]
fn pictures_are_those_that_may_be_published_and_fit() {
    let mut report = with_pictures();
    report.scenes[0].publish = false;
    report.scenes[1].pictures.push("../sweep/secret.png".into());
    report.scenes[1].pictures.push("absent.png".into());
    let folder = records(&report);
    std::fs::remove_file(folder.path().join("tables/absent.png")).unwrap();
    let page = make_page(&options(&[folder.path()])).unwrap();
    assert_eq!(page.pictures, 2);
    let left_out = page.left_out.join("\n");
    for part in
        ["pictures of SIBENIK: they may not be published", "secret.png of tables/report.json: is no name", "absent.png"]
    {
        assert!(left_out.contains(part), "{part}: {left_out}");
    }
    assert!(texts(&page.html).contains("they may not be published"));
    let none = make_page(&PageOptions { picture_bytes: 10, ..options(&[folder.path()]) }).unwrap();
    assert!(none.pictures == 0 && none.left_out.iter().any(|what| what.contains("more than is left for pictures")));
}

/// All records that are stored make a page, also those of earlier versions.
#[test]
fn stored_records_make_a_page() {
    let results = Path::new(env!("CARGO_MANIFEST_DIR")).join("../results");
    let title = "esvo: error and speed of sparse voxel octrees".into();
    let page = make_page(&PageOptions { picture_bytes: 24_000_000, title, ..options(&[&results]) }).unwrap();
    // For people to look at.
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("stored.html"), &page.html).unwrap();
    assert!(page.records >= 8, "{}", page.records);
    assert!(page.wrong.is_empty(), "{:?}", page.wrong);
    let text = texts(&page.html);
    for part in [
        "10 levels, contours, beam off, rays end at voxels of 1 pixel",
        "Hard rays",
        "Incoherent rays",
        "paper 82.5, × 0.14",
    ] {
        assert!(text.contains(part), "{part}");
    }
}

/// Chromium, or nothing where it is not installed and may be missing.
fn chromium() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found =
        std::env::split_paths(&path).flat_map(|folder| names.map(|name| folder.join(name))).find(|file| file.is_file());
    if found.is_none() {
        assert!(
            std::env::var_os("ESVO_REQUIRE_CHROMIUM").is_none(),
            "no Chromium in PATH, and ESVO_REQUIRE_CHROMIUM is set"
        );
        eprintln!("skipped: no Chromium in PATH (Debian: chromium)");
    }
    found
}

/// Runs Chromium on a page and returns its standard output and what its console said.
fn browse(chromium: &Path, page: &Path, arguments: &[&str], hash: &str) -> (String, Vec<String>) {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(chromium)
        .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars"])
        .args(["--enable-logging=stderr", "--v=0", "--virtual-time-budget=20000"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .args(arguments)
        .arg(format!("file://{}{hash}", page.display()))
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    let said = errors.lines().filter(|line| line.contains(":CONSOLE")).map(str::to_owned).collect();
    (String::from_utf8_lossy(&output.stdout).into_owned(), said)
}

/// What is wrong with a page in the browser.
fn faults(chromium: &Path, html: &str) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("page.html");
    std::fs::write(&page, html).unwrap();
    let (dom, mut faults) = browse(chromium, &page, &["--dump-dom"], "#selftest");
    let root = dom.lines().find(|line| line.starts_with("<html")).unwrap_or_default().to_owned();
    if !root.contains("data-ready=\"yes\"") {
        faults.push(format!("the script did not run to its end: {root}"));
    }
    if !root.contains("data-selftest=\"passed: ") || root.contains("data-errors") {
        faults.push(format!("the self-test did not pass: {root}"));
    }
    // Without a slider, point or table there is nothing to pass.
    if root.contains(" 0 ") || root.contains("passed: 0") {
        faults.push(format!("the self-test had nothing to test: {root}"));
    }
    faults
}

#[test]
fn the_script_sorts_shows_and_compares_in_a_browser() {
    let Some(chromium) = chromium() else { return };
    let html = page().html;
    assert_eq!(faults(&chromium, &html), [""; 0]);

    // Pages that are broken on purpose are caught: by an error, by a script that another policy would run, by a table that does not sort.
    let start = html.find("<meta http-equiv").unwrap();
    let free = html[..start].to_owned() + &html[start + html[start..].find('>').unwrap() + 1..];
    assert_eq!(faults(&chromium, &free), [""; 0], "the control itself works");
    let broken = free.replacen("root.dataset.ready", "undefinedName.call(); root.dataset.ready", 1);
    assert!(broken != free && !faults(&chromium, &broken).is_empty());
    let unsorted = free.replacen("[...rows].sort(order)", "rows", 1);
    let found = faults(&chromium, &unsorted).join("\n");
    assert!(unsorted != free && found.contains("does not sort up"), "{found}");
    let blocked = html.replacen("\"use strict\";", "\"use strict\"; ", 1);
    assert!(blocked != html && !faults(&chromium, &blocked).is_empty());
}

/// Pictures of the page for people to look at, in the folder of the build.
#[test]
fn pictures_of_the_page_are_made() {
    let Some(chromium) = chromium() else { return };
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join("page.html");
    std::fs::write(&path, page().html).unwrap();
    for (name, size) in [("page-wide.png", [1280u32, 3000]), ("page-narrow.png", [500, 3000])] {
        let picture = folder.join(name);
        let _ = std::fs::remove_file(&picture);
        let (screenshot, window) =
            (format!("--screenshot={}", picture.display()), format!("--window-size={},{}", size[0], size[1]));
        browse(&chromium, &path, &[&screenshot, &window], "");
        let file = std::fs::read(&picture).unwrap();
        let number = |at: usize| u32::from_be_bytes(file[at..at + 4].try_into().unwrap());
        assert_eq!([number(16), number(20)], size, "{name}");
        // A page without anything on it is a file of a few kilobytes.
        assert!(file.len() > 50_000, "{name} has {} bytes", file.len());
    }
}

/// Whatever is asked of a page, an unknown variant of the tables is not silently dropped.
#[test]
fn every_variant_has_a_column() {
    let text = texts(&page().html);
    for variant in Variant::ALL {
        assert!(text.contains(variant.title()), "{}", variant.title());
    }
}
