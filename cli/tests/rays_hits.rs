//! Rays and hits in files.

mod common;

use std::process::Command;

use common::Folder;

/// Bytes of the header of a `.bin`.
const HEADER: usize = 192;

fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn rays(folder: &Folder, name: &str) {
    folder.ok(&[
        "rays",
        "box.esvo",
        "-o",
        name,
        "--camera=1,0.5,9,0,0,-1,40",
        "--size",
        "8x6",
        "--max-voxel-pixels",
        "0",
    ]);
}

#[test]
fn rays_and_hits_have_the_documented_layout() {
    let folder = Folder::with_octree();
    rays(&folder, "rays.bin");
    let bytes = std::fs::read(folder.path("rays.bin")).unwrap();
    assert_eq!(bytes.len(), HEADER + 48 * 40);
    assert_eq!(&bytes[..8], b"ESVORAYS");
    // The eye, from the cube 1 to 2 to the mesh.
    let matrix: Vec<f64> =
        (0..16).map(|i| f64::from_le_bytes(bytes[64 + 8 * i..72 + 8 * i].try_into().unwrap())).collect();
    let origin = [0, 4, 8].map(|at| f64::from(float(&bytes, HEADER + at)) - 1.0);
    let mesh: Vec<f64> =
        (0..3).map(|row| matrix[12 + row] + (0..3).map(|c| matrix[4 * c + row] * origin[c]).sum::<f64>()).collect();
    for (found, expected) in mesh.iter().zip([1.0, 0.5, 9.0]) {
        assert!((found - expected).abs() < 1e-4, "{mesh:?}");
    }
    folder.ok(&["hits", "box.esvo", "--rays", "rays.bin", "-o", "hits.bin"]);
    let hits = std::fs::read(folder.path("hits.bin")).unwrap();
    assert_eq!(hits.len(), HEADER + 48 * 48);
    // The middle of the picture looks at the face z = 1.5 of the box.
    let middle = HEADER + 48 * (3 * 8 + 4);
    assert_eq!(hits[middle + 14], 1);
    let z = f64::from_le_bytes(hits[middle + 32..middle + 40].try_into().unwrap());
    assert!((z - 1.5).abs() < 0.1, "{z}");
}

#[test]
fn both_forms_hold_the_same_and_a_file_agrees_with_itself() {
    let folder = Folder::with_octree();
    rays(&folder, "rays.bin");
    rays(&folder, "rays.json");
    folder.ok(&["hits", "box.esvo", "--rays", "rays.json", "-o", "a.bin"]);
    folder.ok(&["hits", "box.esvo", "--rays", "rays.bin", "-o", "b.bin"]);
    folder.ok(&["hits", "box.esvo", "--rays", "rays.bin", "-o", "b.json"]);
    assert!(std::fs::read(folder.path("a.bin")).unwrap() == std::fs::read(folder.path("b.bin")).unwrap());
    for other in ["a.bin", "b.json"] {
        let text = folder.ok(&["hits", "box.esvo", "--rays", "rays.bin", "--compare", other]);
        assert!(text.contains("0 only here, 0 only there; 0 of both at another t"), "{text}");
    }
    // Another caster that misses one of the rays and is late at another one.
    let mut bytes = std::fs::read(folder.path("a.bin")).unwrap();
    let middle = HEADER + 48 * (3 * 8 + 4);
    bytes[middle + 14] = 0;
    bytes[middle - 48..middle - 44].copy_from_slice(&9f32.to_le_bytes());
    folder.put("other.bin", bytes);
    let what = "2 of 48 rays differ";
    folder.fails(&["hits", "box.esvo", "--rays", "rays.bin", "--compare", "other.bin"], 1, what);
}

#[test]
fn bad_files_are_refused() {
    let folder = Folder::with_octree();
    rays(&folder, "rays.bin");
    let good = std::fs::read(folder.path("rays.bin")).unwrap();
    let cast = |name: &str, bytes: &[u8], what: &str| {
        folder.put(name, bytes);
        folder.fails(&["hits", "box.esvo", "--rays", name, "-o", "x.bin"], 1, what);
    };
    cast("short.bin", &good[..100], "the header alone has 192");
    cast("cut.bin", &good[..good.len() - 1], "cut.bin: 48 rays take 2112 bytes, but the file has 2111\n");
    cast("long.bin", &[&good[..], b"x"].concat(), "long.bin: 48 rays take 2112 bytes, but the file has 2113\n");
    cast("foreign.bin", &[b'x'; 400], "it must start with ESVORAYS");
    let with = |at: usize, value: &[u8]| {
        let mut bytes = good.clone();
        bytes[at..at + value.len()].copy_from_slice(value);
        bytes
    };
    cast(
        "huge.bin",
        &with(24, &[0xff; 8]),
        "18446744073709551615 rays take 737869762948382064792 bytes, but the file has 2112",
    );
    cast("version.bin", &with(8, &[2]), "version: 2; expected 1");
    cast(
        "object.bin",
        &with(20, &[7]),
        "error: object.bin: its rays are for object 7, counted from 0; the octree has 1\n",
    );
    cast("size.bin", &with(36, &[9]), "a picture of 9x6");
    cast("flags.bin", &with(32, &[3]), "flags or reserved bytes");
    cast("a.json", b"{}", "a.json: ");
    cast("a.txt", b"", "expected .bin or .json");
    folder.fails(&["hits", "box.esvo", "--rays", "rays.bin", "-o", "x.txt"], 1, "expected .bin or .json");
    folder.fails(&["rays", "box.esvo", "-o", "x.txt"], 1, "expected .bin or .json");
    folder.fails(&["hits", "box.esvo", "--rays", "rays.bin"], 2, "--output");
    folder.fails(&["hits", "box.esvo", "--rays", "rays.bin", "--compare", "rays.bin"], 1, "ESVOHITS");
    // Files that break off while the output is written are named, not the output.
    folder.ok(&["hits", "box.esvo", "--rays", "rays.bin", "-o", "hits.bin"]);
    let mut hits = std::fs::read(folder.path("hits.bin")).unwrap();
    hits[HEADER + 3 * 48 + 14] = 7;
    folder.put("other.bin", hits);
    let both = ["hits", "box.esvo", "--rays", "rays.bin", "--compare", "other.bin", "-o", "x.bin"];
    folder.fails(&both, 1, "error: other.bin: record 3: `hit` is 7");
}

/// The lines of the help, where numpy is installed.
#[test]
fn numpy_reads_them_in_one_line() {
    let has_numpy =
        |python: &str| Command::new(python).args(["-c", "import numpy"]).output().is_ok_and(|out| out.status.success());
    if !has_numpy("python3") {
        println!("skipped: python3 has no numpy");
        return;
    }
    let folder = Folder::with_octree();
    rays(&folder, "rays.bin");
    folder.ok(&["hits", "box.esvo", "--rays", "rays.bin", "-o", "hits.bin"]);
    let line = |command: &str| {
        let help = folder.ok(&[command, "--help"]);
        let start = help.find(&format!("{command} = numpy")).unwrap();
        help[start..].split("\n\n").next().unwrap().to_string()
    };
    let program = format!(
        "import numpy\n{}\n{}\nassert len(rays) == len(hits) == 48 and hits['hit'].max() == 1 and (hits['zero'] == 0).all()\n\
         assert rays['t_max'].max() == 1",
        line("rays"),
        line("hits")
    );
    let out = Command::new("python3").args(["-c", &program]).current_dir(folder.path("")).output().unwrap();
    assert!(out.status.success(), "{program}\n{}", String::from_utf8_lossy(&out.stderr));
}

#[test]
fn engines_give_the_same_hits() {
    let folder = Folder::with_octree();
    rays(&folder, "rays.bin");
    folder.ok(&["hits", "box.esvo", "--rays", "rays.bin", "-o", "reference.bin"]);
    for engine in ["cpu", "wgpu", "ash"] {
        let out =
            folder.run(&["hits", "box.esvo", "--rays", "rays.bin", "--backend", engine, "--compare", "reference.bin"]);
        let (text, error) = (String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
        if engine != "cpu" && error.contains("Vulkan") && std::env::var_os("ESVO_REQUIRE_GPU").is_none() {
            println!("skipped: {engine}: {error}");
            continue;
        }
        assert!(out.status.success(), "{engine}: {error}");
        assert!(text.contains(&format!("cast by {engine} on ")), "{text}");
        assert!(text.contains(" 0 only here, 0 only there; 0 of both at another t"), "{text}");
    }
}
