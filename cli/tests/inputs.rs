//! What `esvo build` reads: meshes from standard input, and voxel models.

mod common;

use std::io::Write;
use std::process::{Output, Stdio};

use common::{BOX, Folder};

/// Runs the program with `bytes` as standard input.
fn with_input(folder: &Folder, arguments: &[&str], bytes: &[u8]) -> Output {
    let mut command = folder.command(arguments);
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // The program may end without reading.
    let _ = child.stdin.take().unwrap().write_all(bytes);
    child.wait_with_output().unwrap()
}

/// A model of 3 x 1 x 2: three voxels in the colours 1, 2 and 1 of the default palette.
fn model() -> Vec<u8> {
    let chunk = |name: &[u8; 4], content: &[u8], children: &[u8]| {
        let lengths = [content.len() as u32, children.len() as u32].map(u32::to_le_bytes).concat();
        [name, &lengths[..], content, children].concat()
    };
    let size = chunk(b"SIZE", &[3u32, 1, 2].map(u32::to_le_bytes).concat(), b"");
    let voxels = chunk(b"XYZI", &[3, 0, 0, 0, 0, 0, 0, 1, 1, 0, 1, 2, 2, 0, 0, 1], b"");
    [b"VOX \x96\0\0\0", &chunk(b"MAIN", b"", &[size, voxels].concat())[..]].concat()
}

#[test]
fn a_mesh_from_standard_input_is_that_of_the_file() {
    let folder = Folder::new();
    folder.put("box.obj", BOX);
    folder.ok(&["build", "box.obj", "-o", "file.esvo", "-l", "5"]);
    let arguments = ["build", "-", "--format", "obj", "-o", "stream.esvo", "-l", "5"];
    let out = with_input(&folder, &arguments, BOX.as_bytes());
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    assert_eq!(folder.ok(&["diff", "file.esvo", "stream.esvo"]), "the same octree\n");
    let info = folder.ok(&["info", "stream.esvo"]);
    assert!(info.contains("standard input"), "{info}");
    // The format of a file with another extension.
    folder.put("box.txt", BOX);
    folder.ok(&["build", "box.txt", "--format", "obj", "-o", "text.esvo", "-l", "5"]);
    // A device never ends.
    if cfg!(unix) {
        let device = ["build", "/dev/zero", "--format", "obj", "-o", "x.esvo"];
        folder.fails(&device, 1, "/dev/zero: is not a regular file");
    }
    folder.fails(&["build", "absent.txt", "--format", "obj", "-o", "x.esvo"], 1, "absent.txt: cannot be read");
    folder.fails(&["build", "box.txt", "-o", "x.esvo"], 1, "unknown kind of mesh");
    folder.fails(&["build", "-", "-o", "x.esvo"], 1, "standard input has no extension; give its format");
    folder.fails(&["build", "-", "--format", "obj", "-o", "x.esvo"], 1, "standard input: is empty");
    folder.fails(
        &["build", "-", "--format", "doc", "-o", "x.esvo"],
        2,
        "possible values: obj, gltf, glb, ply, stl, vox",
    );
    let out = with_input(&folder, &["build", "-", "--format", "ply", "-o", "x.esvo"], BOX.as_bytes());
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(error, "error: standard input: is a text file, not a PLY file as the given format says\n");
}

#[test]
fn a_voxel_model_becomes_an_octree() {
    let folder = Folder::new();
    folder.put("a.vox", model());
    folder.fails(&["info", "a.vox"], 1, "a.vox: is a voxel model, not an octree; build an octree from it first");
    let out = folder.ok(&["build", "a.vox", "-o", "a.esvo"]);
    assert!(out.starts_with("a.esvo: 2 levels, 5 voxels"), "{out}");
    assert!(folder.ok(&["validate", "a.esvo"]).contains("keeps every rule"));
    folder.ok(&["render", "a.esvo", "-o", "a.png", "--size", "8x8", "--up", "0,0,1"]);
    let out = with_input(&folder, &["build", "-", "--format", "vox", "-o", "b.esvo"], &model());
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    for option in
        [&["--levels", "5"][..], &["--no-contours"], &["--resume"], &["--preset", "fine"], &["--displace", "1"]]
    {
        let arguments = [&["build", "a.vox", "-o", "x.esvo"][..], option].concat();
        folder.fails(&arguments, 1, &format!("{} does not apply to voxel models", option[0]));
    }
    folder.put("a.las", "LASF");
    folder.fails(&["build", "a.las", "-o", "x.esvo"], 1, "is a LAS point cloud");
}

#[test]
fn pictures_do_not_depend_on_where_the_mesh_is() {
    // A box on a floor, and a floor alone, which is flat. All numbers have few digits, so that the sums are exact.
    let floor = "v -1 0.125 -1\nv 3 0.125 -1\nv 3 0.125 3\nv -1 0.125 3\nf -4 -3 -2 -1\n";
    let block = "v 0 0.5 0\nv 2 0.5 0\nv 2 1 0\nv 0 1 0\nv 0 0.5 1.5\nv 2 0.5 1.5\nv 2 1 1.5\nv 0 1 1.5\nf 1 2 3 4\nf 5 6 7 8\n\
                 f 1 2 6 5\nf 4 3 7 8\nf 1 4 8 5\nf 2 3 7 6\n";
    let moved = |text: &str| {
        let mut lines = String::new();
        for line in text.lines() {
            match line.strip_prefix("v ") {
                Some(place) => {
                    let place: Vec<f64> = place.split(' ').map(|word| word.parse().unwrap()).collect();
                    let [x, y, z] = [place[0] + 431_872.0, place[1] + 300.5, place[2] - 5_411_328.25];
                    lines += &format!("v {x} {y} {z}\n");
                }
                None => lines += &format!("{line}\n"),
            }
        }
        lines
    };
    let folder = Folder::new();
    for (name, text) in [("scene", format!("{block}{floor}")), ("floor", floor.to_owned())] {
        let picture = |place: &str, text: &str| {
            folder.put(&format!("{place}.obj"), text);
            folder.ok(&["build", &format!("{place}.obj"), "-o", &format!("{place}.esvo"), "-l", "7"]);
            folder.ok(&["render", &format!("{place}.esvo"), "-o", &format!("{place}.png"), "--size", "64x48"]);
            std::fs::read(folder.path(&format!("{place}.png"))).unwrap()
        };
        assert!(picture("here", &text) == picture("there", &moved(&text)), "{name}");
    }
}
