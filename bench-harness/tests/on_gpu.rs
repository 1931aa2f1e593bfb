//! The script for machines with a GPU, with a program that only pretends to be esvo.
#![cfg(unix)]

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

/// The engines can be opened.
const OPENS: &str = "case \"$*\" in *\"--levels 3 \"*) exit 0;; esac\n";

/// Runs the script with a program that is this text of a shell.
fn run(folder: &Path, program: &str, seconds: &str) -> (Output, String) {
    let esvo = folder.join("esvo");
    std::fs::write(&esvo, format!("#!/bin/sh\n[ \"$1\" = --version ] && echo 'esvo 1' && exit 0\n{program}\n"))
        .unwrap();
    std::fs::set_permissions(&esvo, std::fs::Permissions::from_mode(0o755)).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("on-gpu.sh");
    let results = folder.join("out");
    let output = Command::new("bash")
        .arg(script)
        .args([&esvo, &results])
        .env("SECONDS_IN_ALL", seconds)
        .current_dir(folder)
        .output()
        .unwrap();
    let summary = std::fs::read_to_string(results.join("on-gpu.txt")).unwrap_or_default();
    (output, summary)
}

#[test]
fn every_step_is_run_and_what_fails_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (output, summary) = run(folder.path(), "echo \"$@\"", "60");
    assert!(output.status.success(), "{summary}");
    for step in ["tables", "stability", "needs", "rays", "sweep", "voxelize", "shadow", "page"] {
        assert!(summary.contains(&format!("{step}: done in ")), "{summary}");
    }
    let said = std::fs::read_to_string(folder.path().join("out/stability.txt")).unwrap();
    assert!(said.starts_with("bench stability --backends wgpu,ash "), "{said}");
    assert!(summary.starts_with("esvo 1\n"));

    let program = format!("{OPENS}[ \"$2\" = needs ] && echo lost && exit 1\nexit 0");
    let (output, summary) = run(folder.path(), &program, "60");
    assert_eq!(output.status.code(), Some(1));
    assert!(summary.contains("needs: FAILED with exit code 1: lost") && summary.contains("rays: done"), "{summary}");
}

#[test]
fn without_an_engine_nothing_is_run() {
    let folder = tempfile::tempdir().unwrap();
    let (output, summary) = run(folder.path(), "echo no loader >&2; exit 1", "60");
    assert_eq!(output.status.code(), Some(1));
    assert!(summary.contains("wgpu: no loader") && summary.contains("ash: no loader"), "{summary}");
    assert!(summary.contains("libvulkan1") && !summary.contains("tables:"), "{summary}");

    let (output, summary) = run(folder.path(), "[ \"$4\" = ash ] && echo no loader >&2 && exit 1\nexit 0", "60");
    assert_eq!(output.status.code(), Some(1));
    assert!(summary.contains("ash: no loader") && summary.contains("tables: done"), "{summary}");
}

#[test]
fn time_that_is_over_is_said() {
    let folder = tempfile::tempdir().unwrap();
    // A step begins with at least five seconds left, and the shell counts whole ones.
    let (output, summary) = run(folder.path(), &format!("{OPENS}exec sleep 30"), "9");
    assert_eq!(output.status.code(), Some(1));
    assert!(summary.contains("tables: stopped after ") && summary.contains("rays: left out"), "{summary}");
}

#[test]
fn what_does_not_run_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("on-gpu.sh");
    let output = Command::new("bash").arg(&script).arg(folder.path().join("nothing")).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("does not run"));
    assert_eq!(Command::new("bash").arg(&script).output().unwrap().status.code(), Some(2));
}
