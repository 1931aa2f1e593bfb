//! Trees through [`assemble`], bytes and back.

mod common;

use std::time::{Duration, Instant};

use common::{Colors, Shape, bytes_of, compare, shapes};
use esvo_format::{AssembleOptions, Contour, MAX_NEAR_POINTER, Octree, Tree, Voxel, assemble, pack};
use glam::DMat4;
use proptest::prelude::*;

fn shape() -> impl Strategy<Value = Shape> {
    shapes(1..=8, 0..=256, 3000)
}

/// Assembles, writes, reads, compares; returns the octree that was read.
fn through_bytes(tree: &Tree, options: &AssembleOptions) -> Octree {
    let transform =
        DMat4::from_translation(glam::DVec3::new(1.5, -2.0, 1e6)) * DMat4::from_scale(glam::DVec3::splat(3.0));
    let octree = assemble(tree, transform, options).expect("a well-formed tree assembles");
    let bytes = bytes_of(&octree);
    let octree = Octree::from_bytes(&bytes).expect("what was written can be read");
    assert_eq!(octree.sound(), Ok(()));
    let report = esvo_format::validate_bytes(&bytes).expect("no limit is reached");
    assert!(report.findings.is_empty(), "{report}");
    assert_eq!(bytes_of(&octree), bytes, "reading and writing again changes nothing");
    let seen = compare(tree, &octree);
    let object = octree.objects()[0];
    assert_eq!(octree.octree_to_mesh(0), transform);
    assert_eq!(object.descriptors, tree.nodes.len() as u64);
    assert_eq!(seen.descriptors, object.descriptors);
    assert_eq!(object.voxels(), tree.voxels());
    assert_eq!(object.contours, tree.contours.len() as u64);
    assert_eq!(object.far_pointers, seen.far_pointers);
    assert_eq!(object.levels, seen.deepest);
    assert_eq!(tree.levels(), seen.deepest);
    let needs = octree.needs();
    assert_eq!(needs.contours, !tree.contours.is_empty());
    assert_eq!(needs.far_pointers, seen.far_pointers > 0);
    assert_eq!(needs.levels, seen.deepest);
    assert_eq!((needs.colors, needs.normals), (!tree.colors.is_empty(), !tree.normals.is_empty()));
    let stats = esvo_format::stats(&octree);
    assert_eq!((stats.descriptors, stats.voxels, stats.levels), (object.descriptors, tree.voxels(), object.levels));
    assert_eq!((stats.contours, stats.far_pointers), (object.contours, object.far_pointers));
    assert_eq!(stats.voxels_per_level.iter().sum::<u64>(), tree.voxels() + 1);
    assert_eq!(stats.bytes.total(), octree.slots().len() as u64 * 8);
    assert_eq!(stats.bytes.contours, tree.contours.len() as u64 * 4);
    for (block, parts) in octree.blocks().iter().zip(octree.parts()) {
        assert_eq!(block.image_offset / 8, u64::from(parts.start));
        assert!(parts.array_slots <= options.block_slots.max(18), "{} slots", parts.array_slots);
    }
    octree
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn trees_come_back_under_default_limits(shape in shape()) {
        let octree = through_bytes(&shape.tree(), &AssembleOptions::default());
        prop_assert_eq!(octree.blocks().len(), 1);
        prop_assert_eq!(octree.objects()[0].far_pointers, 0, "3000 nodes are within reach of each other");
    }

    #[test]
    fn trees_come_back_in_small_blocks(shape in shape(), block_slots in 64u32..6000, near_limit in 1u32..3000) {
        let tree = shape.tree();
        let octree = through_bytes(&tree, &AssembleOptions { block_slots, near_limit });
        let blocks = octree.blocks().len() as u64;
        prop_assert!(octree.objects()[0].far_pointers + 1 >= blocks, "each block but the first is behind a far pointer");
        let descriptors: u64 = octree.parts().iter().map(|p| u64::from(p.array_slots)).sum();
        prop_assert!(descriptors >= tree.nodes.len() as u64);
    }
}

fn full(levels: u32, nodes: usize) -> Shape {
    Shape { seed: 1, levels, valid: 200, leaf: 60, contour: 128, colors: Colors::Many, normals: true, nodes }
}

#[test]
fn small_limits_force_blocks_and_far_pointers() {
    let tree = full(6, 2000).tree();
    let octree = through_bytes(&tree, &AssembleOptions { block_slots: 64, near_limit: 1 });
    assert!(octree.blocks().len() > 100, "{} blocks", octree.blocks().len());
    let octree = through_bytes(&tree, &AssembleOptions { block_slots: 1 << 20, near_limit: 1 });
    assert_eq!(octree.blocks().len(), 1);
    let inner = tree.nodes.iter().filter(|node| node.nonleaf() != 0).count() as u64;
    assert_eq!(octree.objects()[0].far_pointers, inner, "every child pointer is far");
    let octree = through_bytes(&tree, &AssembleOptions { block_slots: 1 << 20, near_limit: 300 });
    let far = octree.objects()[0].far_pointers;
    assert!(far > 0 && far < inner, "{far} of {inner} are far");
    let octree = through_bytes(&tree, &AssembleOptions { block_slots: 1500, near_limit: MAX_NEAR_POINTER });
    assert!(octree.blocks().len() > 1);
    assert_eq!(octree.objects()[0].far_pointers + 1, octree.blocks().len() as u64);
}

#[test]
fn near_pointers_respect_their_limit() {
    let tree = full(7, 8000).tree();
    for near_limit in [70, 200, 1000, 4000] {
        let octree = through_bytes(&tree, &AssembleOptions { block_slots: 1 << 20, near_limit });
        let mut stack = vec![octree.objects()[0].root_slot as u32];
        while let Some(slot) = stack.pop() {
            let descriptor = octree.descriptor(slot);
            assert!(descriptor.far() || descriptor.child_ptr() <= near_limit, "{descriptor:?} under {near_limit}");
            stack.extend((0..8).filter_map(|child| octree.child(slot, child)));
        }
    }
}

#[test]
fn far_pointers_occur_by_themselves_in_a_large_tree() {
    let started = Instant::now();
    let tree = Shape { leaf: 20, ..full(9, 120_000) }.tree();
    assert!(tree.nodes.len() > 100_000, "{} nodes", tree.nodes.len());
    let octree = through_bytes(&tree, &AssembleOptions::default());
    assert_eq!(octree.blocks().len(), 1);
    assert!(octree.objects()[0].far_pointers > 0);
    assert!(started.elapsed() < Duration::from_secs(20), "took {:?}", started.elapsed());
}

#[test]
fn blocks_occur_by_themselves_in_a_larger_tree() {
    let tree = Shape { leaf: 20, contour: 0, colors: Colors::None, normals: false, ..full(10, 1_300_000) }.tree();
    let octree = through_bytes(&tree, &AssembleOptions::default());
    assert!(octree.blocks().len() > 1, "{} blocks", octree.blocks().len());
}

#[test]
fn chains_reach_level_23_and_no_further() {
    let chain = |levels| Shape { valid: 0, leaf: 0, ..full(levels, usize::MAX) }.tree();
    for options in [AssembleOptions::default(), AssembleOptions { block_slots: 64, near_limit: 1 }] {
        let octree = through_bytes(&chain(23), &options);
        assert_eq!(octree.objects()[0].levels, 23);
    }
    let error = assemble(&chain(24), DMat4::IDENTITY, &AssembleOptions::default()).err().expect("too deep");
    assert!(error.to_string().contains("24 levels"), "{error}");
    // Deep enough to overflow the stack of a recursive function.
    let mut tree = Tree::default();
    for index in 0..1_000_000 {
        tree.open(&[
            Some(esvo_format::Voxel { leaf: index == 999_999, ..Default::default() }),
            None,
            None,
            None,
            None,
            None,
            None,
            None,
        ]);
    }
    for index in 0..1_000_000 {
        tree.close(index);
    }
    assert!(assemble(&tree, DMat4::IDENTITY, &AssembleOptions::default()).is_err());
}

#[test]
fn malformed_trees_and_options_are_refused() {
    let refused = |what: &str, tree: &Tree, options: &AssembleOptions| {
        let error = assemble(tree, DMat4::IDENTITY, options).err().expect(what);
        assert!(error.to_string().contains(what), "{error}");
    };
    let options = AssembleOptions::default();
    refused("at least one voxel", &Tree::default(), &options);
    let mut tree = Tree::default();
    let root = tree.open(&[None; 8]);
    tree.close(root);
    refused("not well-formed", &tree, &options);
    // A non-leaf child whose node is missing.
    let mut tree = Tree::default();
    let root = tree.open(&[Some(Default::default()); 8]);
    tree.close(root);
    refused("before all its nodes", &tree, &options);
    let good = full(4, 100).tree();
    for change in [
        |tree: &mut Tree| tree.nodes[1].subtree += 1,
        |tree: &mut Tree| tree.nodes[0].subtree -= 1,
        |tree: &mut Tree| tree.nodes[3].leaf = !tree.nodes[3].valid,
        |tree: &mut Tree| tree.nodes[3].first_voxel += 1,
        |tree: &mut Tree| tree.nodes[3].first_contour += 1,
    ] {
        let mut tree = good.clone();
        change(&mut tree);
        assert!(assemble(&tree, DMat4::IDENTITY, &options).is_err());
    }
    let mut tree = good.clone();
    tree.colors.pop();
    refused("expected one for every voxel or none", &tree, &options);
    let mut tree = good.clone();
    tree.contours[5].0 = 0xfff << 18;
    refused("the normal of contour 5 is zero", &tree, &options);
    for (block_slots, near_limit, what) in [
        (63, 1, "block_slots is 63, expected 64 to 1048576"),
        (1 << 21, 1, "block_slots is 2097152"),
        (64, 0, "near_limit is 0, expected 1 to 32767"),
        (64, 1 << 15, "near_limit is 32768"),
    ] {
        refused(what, &good, &AssembleOptions { block_slots, near_limit });
    }
}

#[test]
fn a_block_whose_contours_are_out_of_reach_is_refused() {
    fn grow(tree: &mut Tree, levels: u32) {
        let voxel = Voxel { contour: Some(Contour(1)), leaf: levels == 1, ..Voxel::default() };
        let node = tree.open(&[Some(voxel); 8]);
        if levels > 1 {
            (0..8).for_each(|_| grow(tree, levels - 1));
        }
        tree.close(node);
    }
    // 2.4 million descriptors fit into a block, 19 million contours do not.
    for (levels, fits) in [(7, true), (8, false)] {
        let mut tree = Tree::default();
        grow(&mut tree, levels);
        let packed = pack(&tree, None, &AssembleOptions::default());
        assert_eq!(packed.is_ok(), fits, "{levels} levels");
        assert!(packed.err().is_none_or(|error| error.to_string().contains("words away")));
    }
}
