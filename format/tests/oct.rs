//! Files of the paper's authors: round trips of our octrees, and damaged files.

mod common;

use common::oct::{contents, damage, same};
use common::{Colors, Rng, Shape, samples};
use esvo_format::{AssembleOptions, FormatError, Octree, assemble, oct, validate};
use glam::{DMat4, DVec3};

fn shape(seed: u64) -> Shape {
    let mut rng = Rng(seed);
    Shape {
        seed,
        levels: 1 + rng.below(7) as u32,
        valid: 40 + rng.below(150) as u32,
        leaf: rng.below(120) as u32,
        contour: [0, 128, 255][rng.below(3) as usize],
        colors: [Colors::None, Colors::One, Colors::Many][rng.below(3) as usize],
        normals: rng.below(2) == 0,
        nodes: 3000,
    }
}

fn octree_of(shape: &Shape, options: &AssembleOptions) -> Octree {
    let transform = DMat4::from_translation(DVec3::new(0.5, -2.0, 3.25)) * DMat4::from_scale(DVec3::splat(0.125));
    assemble(&shape.tree(), transform, options).expect("a well-formed tree")
}

fn exported(octree: &Octree) -> (Vec<u8>, Vec<String>) {
    let mut bytes = Vec::new();
    let lost = oct::write_to(octree, &mut bytes).expect("a sound octree");
    (bytes, lost)
}

#[test]
fn octrees_return_as_they_were() {
    let small_blocks = AssembleOptions { block_slots: 64, near_limit: 5 };
    for seed in 0..60 {
        let shape = shape(seed);
        let options = if seed % 2 == 0 { AssembleOptions::default() } else { small_blocks };
        let octree = octree_of(&shape, &options);
        let (bytes, lost) = exported(&octree);
        let back = oct::from_bytes(&bytes).unwrap_or_else(|e| panic!("{shape:?}: {e}"));
        assert!(back.lost.is_empty(), "{:?}", back.lost);
        assert!(validate(&back.octree).findings.is_empty(), "{:?}", validate(&back.octree).findings);
        assert_eq!(back.octree.octree_to_mesh(0), octree.octree_to_mesh(0));
        let (mut before, after) = (contents(&octree, 0), contents(&back.octree, 0));
        // The losses must be exactly those that were listed.
        let neither = shape.colors == Colors::None && !shape.normals;
        for (missing, word) in [(shape.colors == Colors::None, "colour"), (!shape.normals, "normal")] {
            assert_eq!(lost.iter().any(|l| l.contains(&format!("no {word}"))), missing && !neither, "{lost:?}");
        }
        for (before, after) in before.iter_mut().zip(&after) {
            if shape.colors != Colors::Many {
                before.color = after.color;
            }
            if !shape.normals {
                before.normal = after.normal;
            }
        }
        same(&before, &after);
        // The second export loses nothing.
        let (again, lost) = exported(&back.octree);
        assert!(lost.is_empty(), "{lost:?}");
        assert!(again == exported(&oct::from_bytes(&again).unwrap().octree).0);
        same(&after, &contents(&oct::from_bytes(&again).unwrap().octree, 0));
    }
}

#[test]
fn what_an_oct_file_cannot_hold_is_listed() {
    let lost = |name: &str| {
        let samples = samples::samples();
        let (_, octree) = samples.iter().find(|(found, _)| *found == name).expect("a sample");
        exported(octree).1.join("\n")
    };
    assert!(lost("contours").is_empty());
    assert!(lost("everything").contains("metadata"));
    assert!(lost("constant_color").contains("constant colours became blocks"));
    assert!(lost("normals").contains("no colour"));
    let mut shape = shape(3);
    shape.colors = Colors::None;
    let transform = DMat4::from_scale(DVec3::splat(0.1));
    let octree = assemble(&shape.tree(), transform, &AssembleOptions::default()).unwrap();
    assert!(exported(&octree).1.join("\n").contains("32-bit"));
    let beyond = assemble(&shape.tree(), DMat4::from_scale(DVec3::splat(1e50)), &AssembleOptions::default()).unwrap();
    assert!(matches!(oct::write_to(&beyond, &mut Vec::new()), Err(FormatError::Limit(_))));
}

#[test]
fn deep_and_large_octrees_are_divided() {
    // A full octree of 6 levels and one path down to level 23.
    let full = Shape {
        seed: 1,
        levels: 6,
        valid: 256,
        leaf: 0,
        contour: 200,
        colors: Colors::Many,
        normals: true,
        nodes: usize::MAX,
    };
    let deep = Shape { levels: 23, valid: 0, ..full.clone() };
    for shape in [full, deep] {
        let octree = octree_of(&shape, &AssembleOptions::default());
        let (bytes, lost) = exported(&octree);
        assert!(lost.is_empty(), "{lost:?}");
        let back = oct::from_bytes(&bytes).expect("our own file").octree;
        assert_eq!(back.objects()[0].levels, shape.levels);
        same(&contents(&octree, 0), &contents(&back, 0));
    }
}

#[test]
fn files_are_written_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("octree.oct");
    let octree = octree_of(&shape(8), &AssembleOptions::default());
    let lost = oct::write(&octree, &path).unwrap();
    let (bytes, same_lost) = exported(&octree);
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    assert_eq!(lost, same_lost);
    same(&contents(&oct::open(&path).unwrap().octree, 0), &contents(&oct::from_bytes(&bytes).unwrap().octree, 0));
    assert!(matches!(oct::write(&octree, folder.path()), Err(FormatError::Io { .. })));
    assert!(matches!(oct::open(folder.path()), Err(FormatError::Io { .. })));
    assert!(matches!(oct::open(&folder.path().join("none.oct")), Err(FormatError::Io { .. })));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary is left");
}

#[test]
fn other_files_are_refused_with_a_reason() {
    let said = |bytes: &[u8]| oct::from_bytes(bytes).err().expect("no .oct file").to_string();
    assert!(said(b"").contains("too few"));
    assert!(said(&[7; 100]).contains("not an .oct file"));
    let (bytes, _) = exported(&octree_of(&shape(5), &AssembleOptions::default()));
    let with = |word: usize, value: u32| {
        let mut bytes = bytes.clone();
        bytes[4 * word..4 * word + 4].copy_from_slice(&value.to_le_bytes());
        said(&bytes)
    };
    assert!(with(2, 3).contains("version 3"));
    // The second chunk of the list has the objects, the third is slice 0.
    assert!(with(7 + 6 + 3, 1).contains("compressed"));
    assert!(with(7 + 6 + 2, 0).contains("octree chunk") || with(7 + 6 + 2, 0).contains("used twice"));
    assert!(with(7 + 12 + 1, 99).contains("chunk 0 of group 2"));
    assert!(with(5, u32::MAX).contains("too few"));
    assert!(with(7 + 12 + 5, u32::MAX).contains("chunk 0 of group 2"));
}

#[test]
fn damaged_files_are_refused_or_read_and_nothing_else() {
    for seed in [2, 5, 9, 14] {
        let (bytes, _) = exported(&octree_of(&Shape { nodes: 60, ..shape(seed) }, &AssembleOptions::default()));
        damage(&bytes, seed, 400);
    }
}
