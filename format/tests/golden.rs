//! Golden files: the accepted bytes of the samples, and the values decoded from them. Readers in other languages can be
//! tested with `golden/*.esvo` and `snapshots/*.snap`.
//!
//! `ESVO_BLESS=1 INSTA_UPDATE=always cargo test -p esvo-format --test golden` accepts the current bytes.

mod common;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use common::bytes_of;
use common::samples::samples;
use esvo_format::{Octree, RawNormal, stats, validate_file};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name).with_extension("esvo")
}

#[test]
fn samples_are_written_as_the_golden_files() {
    for (name, octree) in samples() {
        let bytes = bytes_of(&octree);
        if std::env::var_os("ESVO_BLESS").is_some() {
            std::fs::write(golden(name), &bytes).unwrap();
        }
        let golden = std::fs::read(golden(name)).unwrap();
        let differs = bytes.iter().zip(&golden).position(|(a, b)| a != b);
        assert_eq!(differs, None, "{name}: first byte that differs from the golden file");
        assert_eq!(bytes.len(), golden.len(), "{name}");
    }
}

#[test]
fn every_golden_file_is_a_sample_and_valid() {
    let samples = samples();
    let names: Vec<&str> = samples.iter().map(|(name, _)| *name).collect();
    let mut count = 0;
    for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")).unwrap() {
        let path = entry.unwrap().path();
        assert!(names.contains(&path.file_stem().unwrap().to_str().unwrap()), "{}", path.display());
        let report = validate_file(&path).unwrap();
        assert!(report.findings.is_empty(), "{}: {report}", path.display());
        count += 1;
    }
    assert_eq!(count, names.len());
}

#[test]
fn golden_files_decode_as_they_did() {
    for (name, _) in samples() {
        let octree = Octree::open(&golden(name)).unwrap();
        octree.sound().unwrap();
        insta::assert_snapshot!(name, describe(&octree));
    }
}

#[test]
fn the_samples_cover_what_they_are_named_for() {
    let stats = |name: &str| stats(&samples().into_iter().find(|(n, _)| *n == name).unwrap().1);
    assert_eq!(stats("single_voxel").voxels, 1);
    assert!(stats("contours").contours > 0 && stats("contours").far_pointers == 0);
    assert!(stats("far_pointers").far_pointers > 1 && stats("far_pointers").blocks == 1);
    assert!(stats("blocks").far_pointers > 1 && stats("blocks").blocks > 1);
    assert_eq!(stats("constant_color").bytes.colors, 8);
    assert!(stats("ambient").bytes.ambient > 0 && stats("corners").bytes.corners > 0);
    assert!(stats("components").bytes.components > 0 && stats("components").blocks > 1);
    assert!(stats("plain").bytes.normals > 0 && stats("plain").bytes.colors > 8);
    assert!(stats("colors").bytes.colors > 8 && stats("normals").bytes.normals > 0);
}

/// The tables, and one line per voxel in depth-first order: path of child slots from the root, then its properties.
fn describe(octree: &Octree) -> String {
    let mut text = String::new();
    for object in octree.objects() {
        writeln!(text, "{object:?}").unwrap();
    }
    for block in octree.blocks() {
        writeln!(text, "{block:?}").unwrap();
    }
    if !octree.meta().is_empty() {
        writeln!(text, "meta {}", octree.meta()).unwrap();
    }
    node(octree, octree.objects()[0].root_slot as u32, "", &mut text);
    text
}

fn node(octree: &Octree, slot: u32, path: &str, text: &mut String) {
    let descriptor = octree.descriptor(slot);
    for child in (0..8u8).filter(|child| descriptor.valid_mask() >> child & 1 != 0) {
        let path = format!("{path}{child}");
        write!(text, "{path}").unwrap();
        if let Some(slot) = octree.child(slot, child) {
            write!(text, " at slot {slot} of block {}", octree.block_of(slot)).unwrap();
        } else {
            write!(text, " leaf").unwrap();
        }
        if let Some(contour) = octree.contour(slot, child) {
            let slab = contour.decode();
            let (n, p, t) = (slab.normal, slab.position, slab.thickness);
            write!(text, " | contour {:08x} n {n:?} position {p} thickness {t}", contour.0).unwrap();
        }
        if let Some([r, g, b]) = octree.color(slot, child) {
            write!(text, " | color {r:.5} {g:.5} {b:.5}").unwrap();
        }
        if let Some(n) = octree.normal(slot, child) {
            write!(text, " | normal {:.5} {:.5} {:.5}", n.x, n.y, n.z).unwrap();
        }
        if let Some(color) = octree.plain_color(slot, child) {
            write!(text, " | plain {color:?}").unwrap();
        }
        if let Some(RawNormal(normal)) = octree.plain_normal(slot, child) {
            write!(text, " | raw {normal:08x}").unwrap();
        }
        if let Some(cell) = octree.corners(slot, child) {
            let alphas = cell.corners.map(|corner| corner.color[3]);
            write!(text, " | corners of a cube {} times as large, alphas {alphas:?}", 1.0 / cell.size).unwrap();
        }
        if let Some(ambient) = octree.ambient(slot, child) {
            write!(text, " | ambient {ambient:.5}").unwrap();
        }
        for kind in octree.component_kinds() {
            if let Some(found) = octree.components(slot, child, kind) {
                write!(text, " | {kind} {:?}", found.used()).unwrap();
            }
        }
        writeln!(text).unwrap();
        if let Some(slot) = octree.child(slot, child) {
            node(octree, slot, &path, text);
        }
    }
}
