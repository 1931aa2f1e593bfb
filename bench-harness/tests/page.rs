//! The page that is made of records: what it says, what it must not contain, and that its script runs in a browser.

mod common;
#[path = "page/same_machine.rs"]
mod same_machine;

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
        let tag = &rest[start..after];
        if tag.starts_with("<a ") || tag == "</a>" {
            rest = &rest[after..];
            continue;
        }
        let inline = ["<span", "</span", "<code", "</code", "<td", "</td", "<th>", "<th ", "</th", "<small", "</small"];
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
        "are within the spread of their rounds",
        "the worst error of the distance is 0.962 of what rounding may do",
        "AVX2 (AMD EPYC), without clipping by contours, where there are none",
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
    for (part, fault) in [
        ("points[to].focus();", "an arrow key does not go to the next mark"),
        ("point.addEventListener(\"focus\", () => showTip(point));", "a mark with the focus has no tip"),
        ("if (hint && hint.className === \"more\") hint.hidden = !cut;", "a table that is cut does not say so"),
    ] {
        let broken = free.replacen(part, "", 1);
        let found = faults(&chromium, &broken).join("\n");
        assert!(broken != free && found.contains(fault), "{part}: {found}");
    }
    let blocked = html.replacen("\"use strict\";", "\"use strict\"; ", 1);
    assert!(blocked != html && !faults(&chromium, &blocked).is_empty());
}

/// How the page lies in a window of this width: what `script` says, which sees the page as `page`. The page is in a frame: no window of
/// Chromium is as narrow as that of a telephone.
fn laid_out(chromium: &Path, html: &str, width: u32, script: &str) -> Vec<String> {
    let escaped = html.replace('&', "&amp;").replace('"', "&quot;");
    let frame = format!("<iframe style=\"width:{width}px;height:900px;border:0\" srcdoc=\"{escaped}\"></iframe>");
    let harness = format!(
        "<!doctype html><html><body>{frame}<script>addEventListener('load', () => {{\
         const page = document.querySelector('iframe').contentDocument; const said = [];\
         const say = (text) => said.push(text); {script}\
         document.body.innerHTML = ''; const out = document.createElement('pre'); out.id = 'said';\
         out.textContent = said.join('\\n'); document.body.append(out); }});</script></body></html>"
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("harness.html");
    std::fs::write(&path, harness).unwrap();
    let (dom, console) = browse(chromium, &path, &["--dump-dom", "--window-size=1400,1000"], "");
    assert_eq!(console, [""; 0]);
    let start = dom.find("<pre id=\"said\">").expect("the harness ran") + "<pre id=\"said\">".len();
    let end = start + dom[start..].find("</pre>").unwrap();
    dom[start..end].lines().filter(|line| !line.is_empty()).map(str::to_owned).collect()
}

/// Whatever is wider than the page.
const OVERFLOW: &str = "const root = page.documentElement;\
    if (root.scrollWidth > root.clientWidth) say(`the page is ${root.scrollWidth} wide in ${root.clientWidth}`);\
    for (const table of page.querySelectorAll('table.cards')) {\
        const box = table.closest('.scroll'); if (!box.checkVisibility()) continue;\
        if (root.clientWidth < 600 && box.scrollWidth > box.clientWidth) say(`cards are ${box.scrollWidth} wide in ${box.clientWidth}`);\
        for (const cell of table.querySelectorAll('tbody > tr > *'))\
            if (cell.scrollWidth > cell.clientWidth + 1) say(`text leaves its cell: ${cell.textContent}`); }";

/// Names of scenes that take more than one line.
const BROKEN_NAMES: &str = "let names = 0; for (const cell of page.querySelectorAll('th.name')) {\
        if (!cell.checkVisibility()) continue; names += 1;\
        const range = page.createRange(); range.selectNode(cell.firstChild);\
        if (range.getClientRects().length > 1) say(`broken: ${cell.firstChild.textContent}`); }\
    if (names === 0) say('no name of a scene');";

/// Where columns of the settings' tables end, as far as they can be seen without scrolling.
fn seen(columns: &[&str]) -> String {
    format!(
        "let tables = 0; for (const table of page.querySelectorAll('#sweep > figure table')) {{ tables += 1;\
         const heads = [...table.tHead.rows[0].cells]; const box = table.closest('.scroll').getBoundingClientRect();\
         for (const name of {columns:?}) {{ const head = heads.find((head) => head.textContent.startsWith(name));\
             if (!head) say(`no column ${{name}}`);\
             else if (head.getBoundingClientRect().right > box.right) say(`${{name}} is beyond ${{box.right}}`); }} }}\
         if (tables === 0) say('no table of settings');"
    )
}

#[test]
fn narrow_and_wide_windows_show_what_counts_without_scrolling() {
    let Some(chromium) = chromium() else { return };
    let html = page().html;
    let stored = Path::new(env!("CARGO_MANIFEST_DIR")).join("../results");
    let stored = make_page(&PageOptions { picture_bytes: 10, ..options(&[&stored]) }).unwrap().html;
    let first = ["setting", "time, ms", "depth error 90 %", "hits"];
    for html in [&html, &stored] {
        assert_eq!(laid_out(&chromium, html, 400, &(OVERFLOW.to_owned() + &seen(&first))), [""; 0]);
        assert_eq!(laid_out(&chromium, html, 400, BROKEN_NAMES), [""; 0]);
        let wide = [&first[..], &["FLIP"]].concat();
        assert_eq!(laid_out(&chromium, html, 1300, &(OVERFLOW.to_owned() + &seen(&wide))), [""; 0]);
    }
    // What is wrong is seen: something too wide, and a column that stands last.
    let wide = html.replacen("<main>", "<main><div style=\"width:500px\">x</div>", 1);
    let found = laid_out(&chromium, &wide, 400, OVERFLOW);
    assert!(found.iter().any(|line| line.starts_with("the page is ")), "{found:?}");
    let broken = html.replacen(
        "th.name { white-space: nowrap;",
        "th.name { width: 1rem; min-width: 0; overflow-wrap: anywhere;",
        1,
    );
    let broken = broken.replacen("max-width: none; overflow-wrap: normal; }", "max-width: 2rem !important; }", 1);
    let found = laid_out(&chromium, &broken, 400, BROKEN_NAMES);
    assert!(broken != html && found.iter().any(|line| line.starts_with("broken: ")), "{found:?}");
    let found = laid_out(&chromium, &html, 400, &seen(&["on disk"]));
    assert!(found.iter().any(|line| line.starts_with("on disk is beyond")), "{found:?}");
    let broken =
        html.replacen(".cards thead { display: none; }", ".cards tbody th { white-space: nowrap; width: 3rem; }", 1);
    assert!(broken != html && !laid_out(&chromium, &broken, 400, OVERFLOW).is_empty());
}

/// What stands in the elements of this tag, which do not nest.
fn parts_of<'a>(html: &'a str, tag: &str) -> Vec<&'a str> {
    let inside = |part: &'a str| part.split(&format!("</{tag}>")).next().unwrap().split_once('>').unwrap().1;
    html.split(&format!("<{tag}")).skip(1).map(inside).collect()
}

/// Records of two machines with files of the same names, of which one has a GPU and is ten times as fast.
fn two_machines() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (machine, slower) in [("here", 1.0), ("there", 0.1)] {
        let put = |name: &str, text: String| {
            let path = folder.path().join(machine).join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        let mut report = fake_report();
        let mut sweep: serde_json::Value = serde_json::from_str(include_str!("data/sweep.json")).unwrap();
        let cells = sweep["scenes"].as_array_mut().unwrap().iter_mut().flat_map(|s| s["cells"].as_array_mut().unwrap());
        for seconds in cells.flat_map(|c| c["seconds"].as_array_mut().unwrap()).flat_map(|r| r.as_array_mut().unwrap())
        {
            *seconds = (seconds.as_f64().unwrap() * slower).into();
        }
        report
            .scenes
            .iter_mut()
            .flat_map(|scene| &mut scene.checks)
            .for_each(|check| check.agreement.different_voxel = 0);
        if machine == "there" {
            report.machine.cpu = "Fast Processor".into();
            report.machine.threads = 16;
            report.devices[2].name = "Big GPU".into();
            // The other machine's GPU is wrong, and its alone.
            report.scenes[0].checks.last_mut().unwrap().agreement.different_voxel = 5000;
            sweep["machine"]["cpu"] = "Fast Processor".into();
            sweep["machine"]["threads"] = 16.into();
        } else {
            report.devices.retain(|device| device.kind != esvo_core::DeviceKind::Gpu);
            sweep["machine"]["cpu"] = "Example Processor".into();
            sweep["machine"]["threads"] = 2.into();
        }
        put("tables/report.json", report.to_json());
        put("sweep/report.json", sweep.to_string());
    }
    folder
}

#[test]
fn machines_are_kept_apart() {
    let folder = two_machines();
    let page = make_page(&options(&[folder.path()])).unwrap();
    assert_eq!(page.wrong, ["ash"]);
    let html = &page.html;
    let [here, there] = ["Example Processor, 2 threads", "Big GPU with Fast Processor, 16 threads"];
    let names = |part: &str| [here, there].into_iter().filter(|name| part.contains(name)).collect::<Vec<_>>();
    // Every question is asked of each machine, and nothing below it names the other.
    let questions: Vec<&str> =
        parts_of(html, "article").into_iter().filter(|part| !part.contains("Which engine is wrong?")).collect();
    // Four of the sweep, and whether the GPU is faster. No two records say the same thing.
    assert_eq!(questions.len(), 10);
    for question in &questions {
        assert_eq!(names(question).len(), 1, "{}", texts(question));
    }
    // The answers are of its own times.
    let half = |name: &str| {
        let of = questions.iter().find(|part| part.contains("half a pixel in") && part.contains(name)).unwrap();
        texts(of)
    };
    assert!(half(here) != half(there));
    assert_eq!(
        half(here),
        {
            let alone = make_page(&options(&[&folder.path().join("here")])).unwrap().html;
            let article =
                parts_of(&alone, "article").into_iter().find(|part| part.contains("half a pixel in")).unwrap();
            texts(article)
        },
        "another machine changes no answer"
    );
    // Every table and plot of a section of a machine names it, and no other.
    let figures: Vec<&str> = parts_of(html, "figcaption").into_iter().filter(|part| part.contains("<h3>")).collect();
    assert!(figures.len() > 20);
    let of_all = ["Engines", "Comparisons of each engine", "Records", "Not measured", "Credits"];
    for figure in figures {
        let caption = texts(figure);
        let title = caption.lines().next().unwrap_or_default();
        assert_eq!(names(figure).len(), usize::from(!of_all.contains(&title)), "{caption}");
    }
    // The wrong engine is that of the other machine.
    let wrong = texts(parts_of(html, "article")[0]);
    assert!(wrong.contains(&format!("{here}\nNone.")) && wrong.contains(&format!("{there}\nash is wrong.")), "{wrong}");
    // Records of the same name get their folders', and ids are unique.
    assert!(texts(html).contains("here/sweep/report.json") && texts(html).contains("there/tables/report.json"));
    let mut ids: Vec<&str> = html.split(" id=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    let count = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), count);
    let Some(chromium) = chromium() else { return };
    assert_eq!(laid_out(&chromium, html, 400, OVERFLOW), [""; 0]);
}

#[test]
fn engines_terms_and_ties_are_said() {
    let html = page().html;
    let engines = texts(parts_of(&html, "article")[0]);
    for row in [
        "wgpu right llvmpipe: software on the processor, no GPU yes",
        "ash WRONG Example GPU, a GPU no",
        "cpu right Example Processor, the processor no",
    ] {
        assert!(engines.contains(row), "{row}: {engines}");
    }
    assert!(
        engines.contains("counted differences from the reference: at most 1 ray in 100000 may end elsewhere"),
        "{engines}"
    );
    // Every link to a term has an end.
    for id in html.split("href=\"#").skip(1).map(|rest| rest.split('"').next().unwrap()) {
        assert!(html.contains(&format!("id=\"{id}\"")), "{id}");
    }
    for id in [
        "oracle",
        "exact",
        "front",
        "reference",
        "cpu",
        "wgpu",
        "ash",
        "triangles",
        "root-cube",
        "llvmpipe",
        "contours",
        "beam",
        "ends",
        "flip",
        "depth-error",
        "levels",
    ] {
        assert!(html.contains(&format!("id=\"term-{id}\"")), "{id}");
    }
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
