//! Dumps compared with the JSON of the vectors; comparisons of equal and of different octrees.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::samples::samples;
use common::{Colors, Shape};
use esvo_format::dump::{self, Purpose};
use esvo_format::{AssembleOptions, Octree, Tree, Voxel, assemble, diff::diff};
use glam::DMat4;
use serde_json::Value;

/// The valid vectors with the values that they decode to.
fn vectors() -> Vec<(String, Octree, Value)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../spec/v1/vectors/valid");
    let mut paths: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "esvo"));
    paths.sort();
    let read = |path: &PathBuf| {
        let json = fs::read_to_string(path.with_extension("json")).unwrap();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        (name, Octree::open(path).unwrap(), serde_json::from_str(&json).unwrap())
    };
    paths.iter().map(read).collect()
}

#[test]
fn dumps_show_what_the_vectors_say() {
    for (name, octree, json) in vectors() {
        let blocks: Vec<_> = (0..octree.blocks().len()).map(|i| dump::block(&octree, i).unwrap()).collect();
        let mut descriptors = 0;
        for (object, expected) in json["objects"].as_array().unwrap().iter().enumerate() {
            for node in expected["nodes"].as_array().unwrap() {
                let path = node["path"].as_str().unwrap();
                let found = dump::node(&octree, object, &dump::parse_path(path).unwrap()).unwrap();
                let position: Vec<u64> = found.position.iter().map(|x| u64::from(*x)).collect();
                assert_eq!(Value::from(position), node["position"], "{name} {path}");
                assert_eq!((u64::from(found.block), found.path.as_str()), (node["block"].as_u64().unwrap(), path));
                assert_eq!(found.voxels.len(), node["voxels"].as_array().unwrap().len(), "{name} {path}");
                for (voxel, expected) in found.voxels.iter().zip(node["voxels"].as_array().unwrap()) {
                    assert_eq!(voxel.leaf, expected["leaf"], "{name} {path}");
                    let word = voxel.contour.map(|c| u64::from(c.word));
                    assert_eq!(word, expected["contour"]["word"].as_u64(), "{name} {path}");
                    assert_eq!(voxel.color.is_some(), expected.get("color").is_some(), "{name} {path}");
                    assert_eq!(voxel.normal.is_some(), expected.get("normal").is_some(), "{name} {path}");
                }
                let slot = &blocks[found.block as usize].slots[found.slot as usize];
                assert_eq!((slot.value, &slot.purpose), (found.value, &found.fields), "{name} {path}");
                descriptors += 1;
            }
        }
        let count = |is: fn(&Purpose) -> bool| blocks.iter().flat_map(|b| &b.slots).filter(|s| is(&s.purpose)).count();
        assert_eq!(count(|p| matches!(p, Purpose::Descriptor { .. })), descriptors, "{name}");
        let far: u64 = octree.objects().iter().map(|o| o.far_pointers).sum();
        assert_eq!(count(|p| matches!(p, Purpose::FarPointer { .. })) as u64, far, "{name}");
        let pages: usize = blocks.iter().map(|b| b.slots.len().div_ceil(1024)).sum();
        assert_eq!(count(|p| matches!(p, Purpose::PageHeader { .. })), pages, "{name}");
        // Text and JSON of everything.
        assert!(!dump::tables(&octree).to_string().is_empty());
        assert_eq!(serde_json::to_value(&blocks[0]).unwrap()["slots"][0]["is"], "page_header");
        assert!(blocks[0].to_string().contains("descriptor of /"), "{name}");
    }
}

#[test]
fn a_leaf_is_shown_alone_and_paths_that_leave_the_octree_are_explained() {
    let octree = samples().into_iter().find(|(name, _)| *name == "everything").unwrap().1;
    let leaf = dump::node(&octree, 0, &[3]).unwrap();
    assert_eq!((leaf.path.as_str(), leaf.voxels.len(), leaf.voxels[0].slot), ("", 1, 3));
    assert!(leaf.voxels[0].leaf);
    assert!(leaf.to_string().contains("colour"), "{leaf}");
    let error = |object, path: &[u8]| dump::node(&octree, object, path).unwrap_err().to_string();
    assert_eq!(error(0, &[1]), "there is no voxel at 1 below the root, only at 0, 3 (leaf), 6");
    assert!(error(0, &[0, 7, 3]).starts_with("there is no voxel at 3 below path 07"));
    assert!(error(0, &[3, 0]).starts_with("there is no voxel at 3 below the root"));
    assert!(error(0, &[200]).starts_with("there is no voxel at 200"));
    assert!(error(1, &[]).starts_with("there is no object 1"));
    assert!(dump::block(&octree, 1).unwrap_err().to_string().starts_with("there is no block 1"));
    assert!(dump::parse_path("/").unwrap().is_empty());
    assert_eq!(dump::parse_path("0/3/7").unwrap(), [0, 3, 7]);
    assert_eq!(dump::parse_path("037").unwrap(), [0, 3, 7]);
    for bad in ["8", "0.3", "a", "000000000000000000000000"] {
        assert!(dump::parse_path(bad).is_err(), "{bad}");
    }
}

#[test]
fn damaged_blocks_are_dumped_as_far_as_they_can_be_followed() {
    let octree = samples().into_iter().find(|(name, _)| *name == "contours").unwrap().1;
    let mut image = octree.slots().to_vec();
    image[5] |= 0x7fff << 17;
    image[7] = 0xdead_beef;
    let damaged = Octree::from_parts(octree.objects().to_vec(), octree.blocks().to_vec(), image).unwrap();
    assert!(damaged.sound().is_err() && dump::node(&damaged, 0, &[]).is_err());
    let block = dump::block(&damaged, 0).unwrap();
    assert!(matches!(block.slots[5].purpose, Purpose::Descriptor { child_pointer: 0x7fff, .. }));
    assert_eq!(block.slots[7].purpose, Purpose::Unused);
    assert!(block.to_string().contains("00000000deadbeef  unused, but not zero"), "{block}");
}

#[test]
fn layout_makes_no_difference() {
    let shape = Shape {
        seed: 8,
        levels: 7,
        valid: 90,
        leaf: 60,
        contour: 120,
        colors: Colors::Many,
        normals: true,
        nodes: 900,
    };
    let tree = shape.tree();
    let make = |block_slots, near_limit| {
        assemble(&tree, DMat4::IDENTITY, &AssembleOptions { block_slots, near_limit }).unwrap()
    };
    let (one, many) = (make(1 << 20, 32767), make(64, 3));
    assert!(many.blocks().len() > 10);
    assert!(diff(&one, &many, 10).unwrap().is_empty());
    let mut named = make(1 << 20, 32767);
    named.set_meta("{}".into());
    assert!(diff(&one, &named, 10).unwrap().is_empty());
}

/// An octree of two levels: voxel 2 of the root has these children.
fn two_levels(below: &[(usize, Voxel)], transform: DMat4) -> Octree {
    let (mut tree, mut top, mut children) = (Tree::default(), [None; 8], [None; 8]);
    let color = below[0].1.color;
    top[2] = Some(Voxel { color, ..Voxel::default() });
    top[5] = Some(Voxel { color, leaf: true, ..Voxel::default() });
    for &(slot, voxel) in below {
        children[slot] = Some(Voxel { leaf: true, ..voxel });
    }
    let root = tree.open(&top);
    let node = tree.open(&children);
    tree.close(node);
    tree.close(root);
    assemble(&tree, transform, &AssembleOptions::default()).unwrap()
}

#[test]
fn every_kind_of_difference_is_found_where_it_is() {
    let plain = Voxel::default();
    let contour = Voxel { contour: Some(esvo_format::Contour(0x0de1_ec10)), ..plain };
    let base = two_levels(&[(1, plain), (6, contour)], DMat4::IDENTITY);
    let texts = |other: &Octree| {
        let found = diff(&base, other, 100).unwrap();
        assert_eq!(found.total, found.list.len() as u64);
        found.list.iter().map(|d| d.to_string()).collect::<Vec<_>>()
    };
    assert_eq!(texts(&base), [""; 0]);
    assert_eq!(
        texts(&two_levels(&[(1, plain), (7, contour)], DMat4::IDENTITY)),
        [
            "object 0, 26: is a leaf in the first, nothing in the second",
            "object 0, 27: is nothing in the first, a leaf in the second",
        ]
    );
    assert_eq!(
        texts(&two_levels(&[(1, contour), (6, plain)], DMat4::IDENTITY)),
        [
            "object 0, 21: contour none in the first, 0de1ec10 in the second",
            "object 0, 26: contour 0de1ec10 in the first, none in the second",
        ]
    );
    let moved = texts(&two_levels(&[(1, plain), (6, contour)], DMat4::from_scale(glam::DVec3::splat(2.0))));
    assert!(moved.len() == 1 && moved[0].starts_with("object 0, /: transform 1 0 0 0 0 1 "), "{moved:?}");
    let red = Some([255, 0, 0]);
    let colored = [(1, Voxel { color: red, ..plain }), (6, Voxel { color: red, ..contour })];
    let colored = two_levels(&colored, DMat4::IDENTITY);
    assert_eq!(diff(&base, &colored, 1).unwrap().total, 4);
    assert_eq!(diff(&base, &colored, 1).unwrap().list[0].path, "2");
    let single = samples().remove(0).1;
    assert_eq!(
        texts(&single),
        [
            "object 0, /: levels 2 in the first, 1 in the second",
            "object 0, 2: is a divided voxel in the first, nothing in the second",
        ]
    );
}
