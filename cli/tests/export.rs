//! `esvo export`: what other programs read of it.

mod common;

use std::collections::BTreeMap;
use std::process::Command;

use common::{BOX, Folder};

/// A point of a `.ply`: place in edges of voxels from the least point on, and colour.
type Points = BTreeMap<[i64; 3], [u8; 3]>;

/// Reads what `esvo export` writes: positions, perhaps normals, colours, sizes.
fn points(folder: &Folder, name: &str) -> (Points, Vec<f32>) {
    let bytes = std::fs::read(folder.path(name)).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let count: usize = header.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap().parse().unwrap();
    let normals = if header.contains("property float nx") { 12 } else { 0 };
    let row = 12 + normals + 3 + 4;
    assert_eq!(bytes.len(), end + count * row, "{header}");
    let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let rows: Vec<usize> = (0..count).map(|k| end + k * row).collect();
    let place = |at: usize| [0, 1, 2].map(|axis| float(at + 4 * axis));
    let least = [0, 1, 2].map(|axis| rows.iter().map(|&at| place(at)[axis]).fold(f32::INFINITY, f32::min));
    let sizes: Vec<f32> = rows.iter().map(|&at| float(at + row - 4)).collect();
    let found = rows.iter().zip(&sizes).map(|(&at, size)| {
        let position = std::array::from_fn(|axis| ((place(at)[axis] - least[axis]) / size).round() as i64);
        let color: [u8; 3] = bytes[at + row - 7..at + row - 4].try_into().unwrap();
        (position, color)
    });
    (found.collect(), sizes)
}

/// Points moved so that the least coordinates are 0.
fn moved(points: impl Iterator<Item = ([i64; 3], [u8; 3])> + Clone) -> Points {
    let least = [0, 1, 2].map(|axis| points.clone().map(|(p, _)| p[axis]).min().unwrap());
    points.map(|(p, color)| (std::array::from_fn(|axis| p[axis] - least[axis]), color)).collect()
}

#[test]
fn a_voxel_model_comes_back_as_it_was() {
    let folder = Folder::new();
    folder.put("box.obj", format!("mtllib m.mtl\nusemtl m\n{BOX}"));
    folder.put("m.mtl", "newmtl m\nKd 0.8 0.3 0.1\n");
    // Deeper than one model reaches.
    folder.ok(&["build", "box.obj", "-o", "a.esvo", "-l", "9", "--no-contours"]);
    folder.ok(&["export", "a.esvo", "-o", "a.ply"]);
    let (all, sizes) = points(&folder, "a.ply");
    assert!(all.len() > 10_000 && sizes.iter().all(|size| *size == sizes[0]), "{}", all.len());
    for (up, turned) in [("z", false), ("y", true)] {
        folder.ok(&["export", "a.esvo", "-o", "a.vox", "-l", "9", "--up", up]);
        folder.ok(&["build", "a.vox", "-o", "b.esvo"]);
        folder.ok(&["export", "b.esvo", "-o", "b.ply"]);
        let turn = |[x, y, z]: [i64; 3]| if turned { [x, -z, y] } else { [x, y, z] };
        let wanted = moved(all.iter().map(|(&p, &color)| (turn(p), color)));
        assert!(points(&folder, "b.ply").0 == wanted, "--up {up}");
    }
    // A lower level has the cubes of the deeper one at half the resolution.
    let line = folder.ok(&["export", "a.esvo", "-o", "half.ply", "--level", "8"]);
    assert!(line.contains("level 8, "), "{line}");
    assert!(points(&folder, "half.ply").1.iter().all(|size| *size == sizes[0] * 2.0));
}

#[test]
fn contours_cut_the_cubes_of_leaves_above_the_level() {
    let folder = Folder::new();
    folder.put("box.obj", BOX);
    folder.ok(&["build", "box.obj", "-o", "a.esvo", "-l", "7", "--contour-error", "4"]);
    folder.ok(&["build", "box.obj", "-o", "b.esvo", "-l", "7", "--no-contours"]);
    let written = |name: &str, file: &str| -> f64 {
        let line = folder.ok(&["export", name, "-o", file, "-l", "7"]);
        line.split(", ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap()
    };
    // Most leaves with contours are far above the level.
    assert!(written("a.esvo", "x.ply") * 4.0 < written("b.esvo", "x.ply"));
    // All cubes of these leaves would be several times as many.
    let (with, without) = (written("a.esvo", "x.nvdb"), written("b.esvo", "x.nvdb"));
    assert!(with > without * 0.9 && with < without * 1.6, "{with} {without}");
}

#[test]
fn nanovdb_s_own_reader_accepts_the_grids() {
    let folder = Folder::new();
    folder.put("box.obj", BOX);
    folder.ok(&["build", "box.obj", "-o", "a.esvo", "-l", "8", "--no-contours"]);
    let line = folder.ok(&["export", "a.esvo", "-o", "a.nvdb"]);
    let cubes = line.split(", ").nth(1).unwrap().split(' ').next().unwrap();
    let run = |command: &mut Command| command.arg(folder.path("a.nvdb")).output().ok();
    let Some(printed) = run(&mut Command::new("nanovdb_print")) else {
        eprintln!("skipped: no nanovdb_print here (Debian: libnanovdb-tools)");
        return;
    };
    let printed = String::from_utf8_lossy(&printed.stdout).into_owned();
    assert!(printed.contains("density") && printed.contains("RGBA8") && printed.contains(cubes), "{printed}");
    // It checks no grids of colours. What it finds, it prints.
    let checked = run(Command::new("nanovdb_validate").args(["-g", "density"])).unwrap();
    assert!(checked.status.success() && checked.stdout.is_empty() && checked.stderr.is_empty(), "{checked:?}");
    // A file that is cut off is noticed.
    let bytes = std::fs::read(folder.path("a.nvdb")).unwrap();
    folder.put("a.nvdb", &bytes[..bytes.len() / 2]);
    let checked = run(Command::new("nanovdb_validate").args(["-g", "density"])).unwrap();
    assert!(!checked.status.success() || !checked.stderr.is_empty(), "{checked:?}");
}

#[test]
fn what_cannot_be_exported_is_an_error() {
    let folder = Folder::with_octree();
    let fails = |arguments: &[&str], code: i32, what: &str| {
        folder.fails(&[&["export", "box.esvo"], arguments].concat(), code, what);
    };
    fails(&["-o", "x.obj"], 1, "exported as .ply, .vox or .nvdb");
    fails(&["-o", "x.ply", "--up", "z"], 1, "--up applies to .vox files only");
    fails(&["-o", "x.ply", "--object", "1"], 1, "has 1 object");
    fails(&["-o", "x.nvdb", "--level", "16"], 1, "choose a lower --level");
    fails(&["-o", "x.ply", "--level", "22"], 2, "not in 1..=21");
    folder.fails(&["export", "box.obj", "-o", "x.ply"], 1, "box.obj");
}
