//! Ambient occlusion: laid out with an octree, added to an existing octree, and through files of both formats.

mod common;

use common::oct::damage;
use common::{Colors, Shape, bytes_of, samples};
use esvo_format::{AssembleOptions, Octree, Tree, assemble, diff, file, oct, stats, validate};
use glam::DMat4;

fn shape(seed: u64) -> Shape {
    Shape {
        seed,
        levels: 7,
        valid: 100,
        leaf: 60,
        contour: [0, 128][seed as usize % 2],
        colors: [Colors::None, Colors::One, Colors::Many][seed as usize % 3],
        normals: seed % 4 < 2,
        nodes: 2000,
    }
}

const LAYOUTS: [AssembleOptions; 3] = [
    AssembleOptions { block_slots: 1 << 20, near_limit: 32767 },
    AssembleOptions { block_slots: 64, near_limit: 5 },
    AssembleOptions { block_slots: 500, near_limit: 32767 },
];

/// A value for voxel number `voxel`, similar for neighbours.
fn value(voxel: usize) -> u8 {
    (voxel / 5 * 37 % 200 + voxel % 5 * 11) as u8
}

/// Slot of the descriptor in the octree, child slot, and number in the tree of every voxel.
fn voxels(tree: &Tree, octree: &Octree) -> Vec<(u32, u8, usize)> {
    let mut found = Vec::new();
    let mut stack = vec![(0, octree.objects()[0].root_slot as u32)];
    while let Some((index, slot)) = stack.pop() {
        let node = &tree.nodes[index];
        let valid = (0..8).filter(|child| node.valid >> child & 1 != 0);
        found.extend((node.first_voxel as usize..).zip(valid).map(|(voxel, child)| (slot, child, voxel)));
        stack.extend(tree.children(index).filter_map(|(child, index)| Some((index, octree.child(slot, child)?))));
    }
    found
}

#[test]
fn added_later_is_as_laid_out_at_once() {
    for seed in 0..12 {
        for layout in LAYOUTS {
            let mut tree = shape(seed).tree();
            let without = assemble(&tree, DMat4::IDENTITY, &layout).unwrap();
            tree.ambient = (0..tree.voxels() as usize).map(value).collect();
            let at_once = assemble(&tree, DMat4::IDENTITY, &layout).unwrap();
            assert!(validate(&at_once).findings.is_empty(), "{}", validate(&at_once));
            assert!(at_once.needs().ambient && !without.needs().ambient);

            let numbers: std::collections::HashMap<(u32, u8), usize> =
                voxels(&tree, &without).into_iter().map(|(slot, child, voxel)| ((slot, child), voxel)).collect();
            let later = without.with_ambient_occlusion(|slot, child| value(numbers[&(slot, child)])).unwrap();
            assert!(bytes_of(&later) == bytes_of(&at_once), "seed {seed}, {layout:?}");
            for (slot, child, voxel) in voxels(&tree, &later) {
                let found = later.ambient(slot, child).expect("every voxel has a value") * 255.0;
                // Values of 16 neighbours differ by at most 244.
                assert!((found - f32::from(value(voxel))).abs() <= 245.0 / 14.0, "{found} for {}", value(voxel));
            }
            let differences = diff::diff(&without, &later, usize::MAX).unwrap();
            assert!(differences.list.iter().all(|difference| difference.what == "ambient light"));
            assert_eq!(differences.total, tree.voxels());
        }
    }
}

#[test]
fn what_is_there_is_replaced_in_place() {
    let mut tree = shape(5).tree();
    tree.ambient = (0..tree.voxels() as usize).map(value).collect();
    let octree = assemble(&tree, DMat4::IDENTITY, &LAYOUTS[1]).unwrap();
    let bright = octree.with_ambient_occlusion(|_, _| 255).unwrap();
    assert_eq!(bright.slots().len(), octree.slots().len());
    assert!(validate(&bright).findings.is_empty(), "{}", validate(&bright));
    for (slot, child, _) in voxels(&tree, &bright) {
        assert_eq!(bright.ambient(slot, child), Some(1.0));
    }
    tree.ambient.fill(255);
    assert!(bytes_of(&bright) == bytes_of(&assemble(&tree, DMat4::IDENTITY, &LAYOUTS[1]).unwrap()));
}

#[test]
fn metadata_unknown_sections_and_vendors_stay() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../spec/v1/vectors/valid");
    for name in ["unknown_sections", "meta_unicode", "vendor_attachments_between", "two_objects_three_blocks"] {
        let octree = Octree::open(&folder.join(name).with_extension("esvo")).unwrap();
        let with = octree.with_ambient_occlusion(|slot, child| (slot * 31) as u8 ^ child).unwrap();
        assert!(validate(&with).findings.is_empty(), "{name}: {}", validate(&with));
        assert_eq!((with.meta(), with.unknown_sections()), (octree.meta(), octree.unknown_sections()), "{name}");
        for (old, new) in octree.parts().iter().zip(with.parts()) {
            let bytes = |octree: &Octree, at: u64, size: u64| {
                bytemuck::cast_slice::<u64, u8>(octree.slots())[at as usize..(at + size) as usize].to_vec()
            };
            for ((kind, at, size), (other, there, same)) in old.attachments.iter().zip(&new.attachments) {
                assert_eq!((kind, size), (other, same), "{name}");
                assert_eq!(bytes(&octree, *at, *size), bytes(&with, *there, *same), "{name}, type {kind}");
            }
            assert_eq!(new.attachments.len(), old.attachments.len() + 1);
            assert_eq!(new.attachments.last().unwrap().0, file::attachment::AMBIENT_BLOCKS);
        }
        let differences = diff::diff(&octree, &with, usize::MAX).unwrap();
        assert!(differences.list.iter().all(|difference| difference.what == "ambient light"), "{name}");
    }
    let full = Octree::open(&folder.join("attachments_64.esvo")).unwrap();
    assert!(full.with_ambient_occlusion(|_, _| 0).is_err_and(|e| e.to_string().contains("64 attachments")));
}

#[test]
fn it_goes_through_files_of_the_authors() {
    for seed in 0..6 {
        let mut tree = Shape { colors: Colors::Many, normals: true, ..shape(seed) }.tree();
        tree.ambient = (0..tree.voxels() as usize).map(value).collect();
        let octree = assemble(&tree, DMat4::IDENTITY, &LAYOUTS[seed as usize % 2 * 2]).unwrap();
        let mut bytes = Vec::new();
        let lost = oct::write_to(&octree, &mut bytes).unwrap();
        assert!(lost.is_empty(), "{lost:?}");
        let back = oct::from_bytes(&bytes).unwrap();
        assert!(back.lost.is_empty(), "{:?}", back.lost);
        assert!(diff::diff(&octree, &back.octree, 3).unwrap().is_empty());
        assert_eq!(stats(&back.octree).bytes.ambient > 0, back.octree.needs().ambient);
    }
    let mut tree = Shape { nodes: 60, colors: Colors::Many, ..shape(4) }.tree();
    (tree.plain, tree.ambient) = (true, (0..tree.voxels() as usize).map(value).collect());
    let mut bytes = Vec::new();
    oct::write_to(&assemble(&tree, DMat4::IDENTITY, &LAYOUTS[0]).unwrap(), &mut bytes).unwrap();
    assert!(damage(&bytes, 4, 400) > 50);
    // Without colours: the only attachment.
    let plain = samples::single_voxel().with_ambient_occlusion(|_, _| 77).unwrap();
    let mut bytes = Vec::new();
    assert!(oct::write_to(&plain, &mut bytes).unwrap().is_empty());
    assert!(diff::diff(&plain, &oct::from_bytes(&bytes).unwrap().octree, 3).unwrap().is_empty());
}
