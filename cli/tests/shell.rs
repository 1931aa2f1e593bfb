//! Completions, manual pages and the version.

mod common;

use std::collections::BTreeSet;

use common::Folder;

/// All commands, by the names of their pages.
const PAGES: [&str; 34] = [
    "esvo",
    "esvo-advise",
    "esvo-ambient",
    "esvo-bench",
    "esvo-bench-bless",
    "esvo-bench-build",
    "esvo-bench-compare",
    "esvo-bench-format",
    "esvo-bench-import",
    "esvo-bench-needs",
    "esvo-bench-page",
    "esvo-bench-pictures",
    "esvo-bench-rays",
    "esvo-bench-serve",
    "esvo-bench-shadow",
    "esvo-bench-stability",
    "esvo-bench-sweep",
    "esvo-bench-voxelize",
    "esvo-build",
    "esvo-completions",
    "esvo-convert",
    "esvo-diff",
    "esvo-dump",
    "esvo-export",
    "esvo-hits",
    "esvo-info",
    "esvo-join",
    "esvo-kernel",
    "esvo-man",
    "esvo-plan",
    "esvo-rays",
    "esvo-render",
    "esvo-validate",
    "esvo-view",
];

/// Names of the commands that the help of a command lists.
fn listed(help: &str) -> Vec<String> {
    let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let names = lines.take_while(|line| line.starts_with("  ")).filter(|line| !line.starts_with("   "));
    names.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help").map(Into::into).collect()
}

#[test]
fn every_command_has_a_page() {
    let folder = Folder::new();
    folder.ok(&["man", "pages"]);
    let pages = std::fs::read_dir(folder.path("pages")).unwrap();
    let names: BTreeSet<_> = pages.map(|page| page.unwrap().file_name().into_string().unwrap()).collect();
    assert_eq!(names, PAGES.iter().map(|name| format!("{name}.1")).collect());
    // The list above is complete.
    let mut commands = BTreeSet::from(["esvo".to_string()]);
    commands.extend(listed(&folder.ok(&["--help"])).iter().map(|name| format!("esvo-{name}")));
    commands.extend(listed(&folder.ok(&["bench", "--help"])).iter().map(|name| format!("esvo-bench-{name}")));
    assert_eq!(commands, PAGES.iter().map(ToString::to_string).collect());

    let page = |name: &str| std::fs::read_to_string(folder.path("pages").join(name)).unwrap();
    for name in PAGES {
        let text = page(&format!("{name}.1"));
        assert!(text.contains(".SH NAME") && text.contains(".SH SYNOPSIS"), "{name}: {text}");
    }
    assert!(page("esvo-render.1").contains("max\\-voxel\\-pixels"));
    assert!(page("esvo-bench-build.1").contains("the authors"));
    // Examples are not joined to a paragraph.
    let build = page("esvo-build.1");
    let (_, examples) = build.split_once(".SH EXAMPLES\n.nf\n").unwrap();
    assert!(examples.lines().next().unwrap().starts_with("esvo build conference.obj"), "{build}");
    assert!(examples.trim_end().ends_with(".fi"), "{build}");
}

#[test]
fn pages_are_written_whole_or_not_at_all() {
    let folder = Folder::new();
    folder.put("file", "not a folder");
    folder.fails(&["man", "file"], 1, "file");
    folder.fails(&["man", "file/pages"], 1, "file");
    // A second run replaces the pages and leaves no temporary files.
    folder.ok(&["man", "pages"]);
    folder.put("pages/esvo.1", "old");
    folder.ok(&["man", "pages"]);
    assert_eq!(std::fs::read_dir(folder.path("pages")).unwrap().count(), PAGES.len());
    assert!(std::fs::read_to_string(folder.path("pages/esvo.1")).unwrap().contains(".SH NAME"));
}

#[test]
fn every_shell_has_completions() {
    let folder = Folder::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = folder.ok(&["completions", shell]);
        for word in ["esvo", "validate", "max-voxel-pixels", "pictures"] {
            assert!(script.contains(word), "{shell}: no {word}");
        }
        folder.ok(&["completions", shell, "-o", "script"]);
        assert_eq!(std::fs::read_to_string(folder.path("script")).unwrap(), script, "{shell}");
        assert_eq!(folder.files(), ["script"]);
    }
    folder.fails(&["completions", "tcsh"], 2, "bash, elvish, fish, powershell, zsh");
    folder.fails(&["completions", "bash", "-o", "absent/script"], 1, "does not exist");
}

#[test]
fn the_long_version_names_commit_and_engines() {
    let folder = Folder::new();
    let short = folder.ok(&["-V"]);
    assert_eq!(short, format!("esvo {}\n", env!("CARGO_PKG_VERSION")));
    let long = folder.ok(&["--version"]);
    let lines: Vec<_> = long.lines().collect();
    let [version, commit, engines] = lines[..] else { panic!("{long}") };
    assert_eq!(version, short.trim_end());
    let commit = commit.strip_prefix("commit:  ").unwrap();
    assert!(commit == "unknown" || commit.len() == 12 && commit.bytes().all(|b| b.is_ascii_hexdigit()), "{commit}");
    assert!(engines.starts_with("engines: reference, cpu"), "{engines}");
    assert_eq!(engines.contains("wgpu"), cfg!(feature = "wgpu"));
    assert_eq!(engines.contains("ash"), cfg!(feature = "ash"));
}
