//! `--memory-limit` is a bound of resident memory, whatever is built.

#![cfg(target_os = "linux")]

mod common;

use std::fmt::Write as _;
use std::io::{BufWriter, Write};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{ExitStatus, Stdio};

use common::Folder;

/// What the program itself takes: limits below it are refused, but cannot be kept.
const PROGRAM: u64 = 64_000_000;

/// How a build ended.
struct Ended {
    status: ExitStatus,
    /// Most bytes that were resident.
    peak: u64,
    error: String,
}

/// Runs `esvo build` with these arguments.
fn build(folder: &Folder, arguments: &[&str]) -> Ended {
    let mut command = folder.command(&["build", "-o", "x.esvo"]);
    if let Some(scenes) = std::env::var_os("ESVO_SCENES") {
        command.env("ESVO_SCENES", scenes);
    }
    let errors = folder.path("errors");
    command.args(arguments).stdout(Stdio::null()).stderr(std::fs::File::create(&errors).unwrap());
    #[expect(clippy::zombie_processes, reason = "it is waited for below, in a way that tells its memory")]
    let child = command.spawn().unwrap();
    let (mut status, mut usage) = (0, std::mem::MaybeUninit::<libc::rusage>::zeroed());
    // SAFETY: the child exists and nothing else waits for it; both pointers are valid, and all zeros are a valid `rusage`.
    let usage = unsafe {
        assert_eq!(libc::wait4(child.id() as i32, &raw mut status, 0, usage.as_mut_ptr()), child.id() as i32);
        usage.assume_init()
    };
    let error = std::fs::read_to_string(&errors).unwrap();
    std::fs::remove_file(errors).unwrap();
    Ended { status: ExitStatus::from_raw(status), peak: usage.ru_maxrss as u64 * 1024, error }
}

/// Builds with each limit in bytes. Each build must either keep to it or be refused with one line, without a file; some limit must be
/// refused, and the last one must suffice. Returns what happened, as rows of a table.
#[track_caller]
fn check(folder: &Folder, arguments: &[&str], limits: &[u64]) -> String {
    let mut table = String::new();
    let mut refused = 0;
    for &limit in limits {
        let option = format!("{}", limit as f64 / 1e9);
        let before = folder.files();
        let Ended { status, peak, error } = build(folder, &[arguments, &["--memory-limit", &option]].concat());
        let last = error.lines().last().unwrap_or_default();
        assert!(peak <= limit.max(PROGRAM), "{arguments:?} with {limit}: held {peak}; {error}");
        if status.success() {
            std::fs::remove_file(folder.path("x.esvo")).unwrap();
        } else {
            refused += 1;
            assert_eq!(status.code(), Some(1), "{arguments:?} with {limit}: {error}");
            let own = format!("error: --memory-limit {option}: ");
            let says = last.starts_with(&own) || last.contains(": a memory limit of ");
            assert!(last.starts_with("error: ") && says, "{arguments:?} with {limit}: {error}");
            assert_eq!(folder.files(), before, "{arguments:?} with {limit} left something behind");
        }
        let outcome = if status.success() { "built" } else { last };
        writeln!(table, "| {} | {option} | {:.3} | {outcome} |", arguments.join(" "), peak as f64 / 1e9).unwrap();
    }
    assert!(
        refused > 0 && refused < limits.len(),
        "{arguments:?}: {refused} of {} were refused\n{table}",
        limits.len()
    );
    table
}

/// A square of `n` times `n` vertices with waves, with texture coordinates if `textured`, as OBJ. 29 MB for n = 500.
fn waves_obj(path: &Path, n: usize, textured: bool) {
    let mut file = BufWriter::with_capacity(1 << 20, std::fs::File::create(path).unwrap());
    let at = |i: usize| i as f64 / n as f64;
    if textured {
        writeln!(file, "mtllib m.mtl\nusemtl m").unwrap();
    }
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let (x, y) = (at(i), at(j));
        writeln!(file, "v {x:.7} {y:.7} {:.7}", 0.1 * (x * 13.0).sin() * (y * 17.0).cos()).unwrap();
        if textured {
            writeln!(file, "vt {x:.7} {y:.7}").unwrap();
        } else {
            writeln!(file, "vn {:.6} {:.6} 0.98", -0.1 * (x * 13.0).cos(), 0.1 * (y * 17.0).sin()).unwrap();
        }
    }
    let corner = |v: usize| if textured { format!("{v}/{v}") } else { format!("{v}//{v}") };
    for (i, j) in (0..n - 1).flat_map(|i| (0..n - 1).map(move |j| (i, j))) {
        let a = i * n + j + 1;
        let [a, b, c, d] = [a, a + 1, a + n, a + n + 1].map(corner);
        writeln!(file, "f {a} {c} {b}\nf {b} {c} {d}").unwrap();
    }
}

/// The same waves as binary STL: 2 (n - 1)² triangles of 50 bytes.
fn waves_stl(path: &Path, n: usize) {
    let mut file = BufWriter::with_capacity(1 << 20, std::fs::File::create(path).unwrap());
    file.write_all(&[0; 80]).unwrap();
    file.write_all(&(2 * (n as u32 - 1) * (n as u32 - 1)).to_le_bytes()).unwrap();
    let place = |i: usize, j: usize| {
        let (x, y) = (i as f32 / n as f32, j as f32 / n as f32);
        [x, y, 0.1 * (x * 13.0).sin() * (y * 17.0).cos()]
    };
    for (i, j) in (0..n - 1).flat_map(|i| (0..n - 1).map(move |j| (i, j))) {
        let [a, b, c, d] = [place(i, j), place(i, j + 1), place(i + 1, j), place(i + 1, j + 1)];
        for triangle in [[a, c, b], [b, c, d]] {
            file.write_all(&[0; 12]).unwrap();
            triangle.as_flattened().iter().for_each(|x| file.write_all(&x.to_le_bytes()).unwrap());
            file.write_all(&[0; 2]).unwrap();
        }
    }
}

const M: u64 = 1_000_000;

#[test]
fn reading_keeps_to_the_limit() {
    let folder = Folder::new();
    waves_obj(&folder.path("waves.obj"), 350, false);
    waves_stl(&folder.path("waves.stl"), 500);
    for mesh in ["waves.obj", "waves.stl"] {
        // The measure finds what a build without a limit holds.
        let peak = build(&folder, &[mesh, "-l", "7"]).peak;
        assert!(peak > PROGRAM + 20 * M, "{mesh}: {peak}");
        std::fs::remove_file(folder.path("x.esvo")).unwrap();
        check(&folder, &[mesh, "-l", "7"], &[M, 30 * M, 64 * M, 80 * M, 110 * M, 200 * M, 300 * M, 600 * M]);
    }
}

#[test]
fn images_displacement_and_compression_keep_to_the_limit() {
    let folder = Folder::new();
    waves_obj(&folder.path("waves.obj"), 20, true);
    folder.put("m.mtl", "newmtl m\nmap_Kd image.png\nmap_bump image.png\n");
    let wave = |x: u32, y: u32| ((x * 7 + y * 3) as f32 * 0.01).sin().mul_add(90.0, 120.0) as u8;
    let pixels: Vec<u8> =
        (0..1024 * 1024 * 3).map(|i| wave(i / 3 % 1024, i / 3 / 1024).wrapping_add((i % 3 * 40) as u8)).collect();
    let picture = esvo_core::Picture { width: 1024, height: 1024, rgb8: pixels };
    esvo_core::picture::write_png(&folder.path("image.png"), &picture).unwrap();
    let limits = [M, 64 * M, 90 * M, 130 * M, 250 * M, 900 * M];
    check(&folder, &["waves.obj", "-l", "10"], &limits);
    check(&folder, &["waves.obj", "-l", "10", "--compress"], &limits);
    // More than a million triangles: displaced while it is built.
    check(&folder, &["waves.obj", "-l", "9", "--displace", "0.01"], &[M, 100 * M, 300 * M]);
}

#[test]
#[ignore = "minutes, 3 GB of disk, and the scenes of the paper where they are"]
fn large_files_and_all_scenes_keep_to_the_limit() {
    let folder = Folder::new();
    waves_obj(&folder.path("waves.obj"), 2250, false);
    let g = |limits: &[f64]| limits.iter().map(|x| (x * 1e9) as u64).collect::<Vec<_>>();
    println!("| build | limit, GB | held, GB | outcome |\n|---|---|---|---|");
    print!("{}", check(&folder, &["waves.obj", "-l", "8"], &g(&[0.5, 1.8, 2.6, 6.0])));
    std::fs::remove_file(folder.path("waves.obj")).unwrap();
    waves_stl(&folder.path("waves.stl"), 4633);
    print!("{}", check(&folder, &["waves.stl", "-l", "8"], &g(&[0.5, 2.2, 5.0, 12.0])));
    std::fs::remove_file(folder.path("waves.stl")).unwrap();
    for scene in ["city", "sibenik", "sibenik-d", "hairball", "fairy", "conference"] {
        let levels = if scene == "hairball" { "9" } else { "10" };
        print!("{}", check(&folder, &["--scene", scene, "-l", levels], &g(&[0.05, 0.2, 0.5, 3.0])));
    }
}
