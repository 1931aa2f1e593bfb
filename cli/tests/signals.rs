//! Hang-ups and interrupts of long builds.

#![cfg(target_os = "linux")]

mod common;

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::Folder;

/// Starts a build of some seconds by a shell, and waits until it has begun to build.
fn start(folder: &Folder, before: &str) -> Child {
    let program = env!("CARGO_BIN_EXE_esvo");
    let script =
        format!("{before}exec {program} build --scene conference --stand-in -o a.esvo -l 9 --no-contours --resume");
    let child =
        Command::new("sh").args(["-c", &script]).current_dir(folder.path("")).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    while !folder.path("a.esvo.part").exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "the build has not begun after two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

fn hang_up(child: &Child) {
    assert!(Command::new("kill").args(["-HUP", &child.id().to_string()]).status().unwrap().success());
}

#[test]
fn a_hang_up_ends_a_build_unless_it_was_ignored() {
    let folder = Folder::new();
    let mut ended = start(&folder, "");
    hang_up(&ended);
    assert_eq!(ended.wait().unwrap().code(), Some(130));
    assert!(!folder.path("a.esvo").exists());

    let folder = Folder::new();
    let mut kept = start(&folder, "trap '' HUP; ");
    hang_up(&kept);
    assert!(kept.wait().unwrap().success());
    assert!(folder.path("a.esvo").exists());
}
