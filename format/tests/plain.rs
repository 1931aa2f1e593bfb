//! Plain colours and normals of voxels and of their corners, through files of both formats.

mod common;

use common::{Colors, Rng, Shape, bytes_of};
use esvo_format::{
    AssembleOptions, ColorBlock, CornerValue, NodeCorners, Octree, RawNormal, Region, StreamReader, Tree, assemble,
    diff, oct, pack, stats, validate,
};
use glam::{DMat4, Vec3};

const LAYOUTS: [AssembleOptions; 3] = [
    AssembleOptions { block_slots: 1 << 20, near_limit: 32767 },
    AssembleOptions { block_slots: 64, near_limit: 5 },
    AssembleOptions { block_slots: 500, near_limit: 32767 },
];

fn shape(seed: u64) -> Shape {
    Shape {
        seed,
        levels: 1 + seed as u32 % 8,
        valid: 110,
        leaf: 50,
        contour: [0, 128][seed as usize % 2],
        colors: [Colors::None, Colors::One, Colors::Many, Colors::Many][seed as usize % 4],
        normals: !seed.is_multiple_of(3),
        nodes: 1500,
    }
}

/// A tree of plain values, in which about half of the voxels share their values.
fn plain_tree(seed: u64) -> Tree {
    let mut tree = shape(seed).tree();
    tree.plain = true;
    let mut rng = Rng(seed);
    for voxel in 1..tree.voxels() as usize {
        if rng.chance(128) {
            let other = voxel - 1 - rng.below(voxel.min(3) as u64) as usize;
            if !tree.colors.is_empty() {
                tree.colors[voxel] = tree.colors[other];
            }
            if !tree.normals.is_empty() {
                tree.normals[voxel] = tree.normals[other];
            }
        }
    }
    if seed.is_multiple_of(5) && !tree.colors.is_empty() {
        tree.alphas = (0..tree.voxels()).map(|_| if rng.chance(200) { 255 } else { 40 }).collect();
    }
    tree
}

/// Slot of the descriptor, child slot, number of the voxel and of its node in the tree.
fn voxels(tree: &Tree, octree: &Octree) -> Vec<(u32, u8, usize, usize)> {
    let mut found = Vec::new();
    let mut stack = vec![(0, octree.objects()[0].root_slot as u32)];
    while let Some((index, slot)) = stack.pop() {
        let node = &tree.nodes[index];
        let valid = (0..8).filter(|child| node.valid >> child & 1 != 0);
        found.extend((node.first_voxel as usize..).zip(valid).map(|(voxel, child)| (slot, child, voxel, index)));
        stack.extend(tree.children(index).filter_map(|(child, index)| Some((index, octree.child(slot, child)?))));
    }
    found
}

fn laid_out(tree: &Tree, options: &AssembleOptions) -> Octree {
    let octree = assemble(tree, DMat4::IDENTITY, options).expect("a well-formed tree");
    let octree = Octree::from_bytes(&bytes_of(&octree)).expect("our own bytes");
    assert!(validate(&octree).findings.is_empty(), "{}", validate(&octree));
    octree
}

/// Exports to the authors' format and imports again. Returns what the export lists as lost.
fn through_oct(octree: &Octree) -> (Octree, Vec<String>) {
    let mut bytes = Vec::new();
    let lost = oct::write_to(octree, &mut bytes).expect("a sound octree");
    let back = oct::from_bytes(&bytes).expect("our own file");
    assert!(back.lost.is_empty(), "{:?}", back.lost);
    assert!(validate(&back.octree).findings.is_empty(), "{}", validate(&back.octree));
    // Exporting again must give the same file.
    let mut again = Vec::new();
    assert!(oct::write_to(&back.octree, &mut again).unwrap().is_empty());
    assert!(again == bytes, "the same octree, the same file");
    (back.octree, lost)
}

#[test]
fn every_bit_comes_back() {
    for seed in 0..24 {
        let tree = plain_tree(seed);
        for layout in LAYOUTS {
            let octree = laid_out(&tree, &layout);
            for (slot, child, voxel, _) in voxels(&tree, &octree) {
                let expected = tree.colors.get(voxel).map(|[r, g, b]| {
                    let alpha = tree.alphas.get(voxel).copied().unwrap_or(255);
                    [*r, *g, *b, alpha]
                });
                assert_eq!(octree.plain_color(slot, child), expected, "seed {seed}");
                let normal = tree.normals.get(voxel).copied();
                assert_eq!(octree.plain_normal(slot, child), normal, "seed {seed}");
                let color = expected.map(|[r, g, b, _]| [r, g, b].map(|c| f32::from(c) / 255.0));
                assert_eq!(octree.color(slot, child), color);
                assert_eq!(octree.normal(slot, child), normal.map(RawNormal::decode));
            }
        }
    }
}

#[test]
fn palettes_go_through_files_of_the_authors() {
    for seed in 0..24 {
        let tree = plain_tree(seed);
        if tree.normals.is_empty() {
            continue;
        }
        let octree = laid_out(&tree, &LAYOUTS[seed as usize % 3]);
        let (back, lost) = through_oct(&octree);
        let expected: &[&str] = if tree.colors.is_empty() { &["no colour"] } else { &[] };
        assert_eq!(lost.len(), expected.len(), "{lost:?}");
        assert!(lost.iter().zip(expected).all(|(lost, word)| lost.contains(word)), "{lost:?}");
        let differences = diff::diff(&octree, &back, 3).unwrap();
        assert!(differences.list.iter().all(|d| d.what == "colour" && tree.colors.is_empty()), "{differences:?}");
    }
}

#[test]
fn what_voxels_share_is_stored_once() {
    let mut tree = plain_tree(2);
    tree.colors.clear();
    tree.alphas.clear();
    let bytes = |tree: &Tree| stats(&laid_out(tree, &LAYOUTS[0])).bytes.normals;
    let shared = bytes(&tree);
    let (nodes, voxels) = (tree.nodes.len(), tree.voxels() as usize);
    tree.own = tree.nodes.iter().map(|node| node.valid).collect();
    let apart = bytes(&tree);
    assert_eq!(apart - shared, {
        let most = |node: &esvo_format::TreeNode| {
            let range = node.first_voxel as usize..(node.first_voxel + node.valid.count_ones()) as usize;
            let values = &tree.normals[range];
            values.iter().map(|a| values.iter().filter(|b| *b == a).count()).max().unwrap() as u64 - 1
        };
        4 * tree.nodes.iter().map(most).sum::<u64>()
    });
    tree.normals.fill(RawNormal(7));
    tree.own.fill(0);
    assert_eq!(apart - bytes(&tree), 4 * (voxels - nodes) as u64);
    // A single colour takes eight bytes, plain or not, unless it is transparent.
    tree.colors = vec![[1, 2, 3]; voxels];
    assert_eq!(stats(&laid_out(&tree, &LAYOUTS[0])).bytes.colors, 8);
    tree.alphas = vec![254; voxels];
    assert!(stats(&laid_out(&tree, &LAYOUTS[0])).bytes.colors > 8);
}

#[test]
fn subtrees_take_their_values_along() {
    let mut seen_any = false;
    for seed in 0..24 {
        let tree = plain_tree(seed);
        let mut with_corners = shape(seed).tree();
        corners(&mut with_corners, seed);
        for tree in [tree, with_corners] {
            let divided = tree.children(0).last().filter(|(_, index)| tree.nodes[*index].nonleaf() != 0);
            let Some((child, last)) = divided else { continue };
            seen_any = true;
            let mut rest = tree.clone();
            let below = rest.detach(last);
            rest.attach(0);
            rest.close(0);
            pack(&rest, None, &LAYOUTS[0]).expect("what is left is well-formed");
            let (octree, full) = (laid_out(&below, &LAYOUTS[0]), laid_out(&tree, &LAYOUTS[0]));
            let slot = full.child(full.objects()[0].root_slot as u32, child).expect("a node");
            let mut stack = vec![(octree.objects()[0].root_slot as u32, slot)];
            let mut seen = 0;
            while let Some((a, b)) = stack.pop() {
                for child in (0..8).filter(|child| octree.descriptor(a).valid_mask() >> child & 1 != 0) {
                    assert_eq!(octree.color(a, child), full.color(b, child), "seed {seed}");
                    assert_eq!(octree.normal(a, child), full.normal(b, child), "seed {seed}");
                    assert_eq!(octree.corners(a, child), full.corners(b, child), "seed {seed}");
                    stack.extend(octree.child(a, child).zip(full.child(b, child)));
                    seen += 1;
                }
            }
            assert_eq!(seen, below.voxels());
        }
    }
    assert!(seen_any);
}

#[test]
fn parts_of_a_file_have_the_values_of_the_whole() {
    let mut trees = [plain_tree(6), shape(6).tree()];
    corners(&mut trees[1], 6);
    for mut tree in trees {
        tree.ambient = (0..tree.voxels()).map(|k| (k * 7) as u8).collect();
        let whole = laid_out(&tree, &LAYOUTS[1]);
        let bytes = bytes_of(&whole);
        let reader = StreamReader::open(&bytes).unwrap();
        let blocks = reader.blocks_for(0, &Region::cube([0; 3], 22), 23);
        assert!(blocks.len() > 1 && blocks.len() < whole.blocks().len(), "{} blocks", blocks.len());
        let part = reader.partial(&blocks).unwrap();
        assert!(validate(&part).is_ok(), "{}", validate(&part));
        let mut stack = vec![(part.objects()[0].root_slot as u32, whole.objects()[0].root_slot as u32)];
        while let Some((a, b)) = stack.pop() {
            for child in (0..8).filter(|child| part.descriptor(a).valid_mask() >> child & 1 != 0) {
                assert_eq!(part.plain_color(a, child), whole.plain_color(b, child));
                assert_eq!(part.plain_normal(a, child), whole.plain_normal(b, child));
                assert_eq!(part.corners(a, child), whole.corners(b, child));
                assert_eq!(part.ambient(a, child), whole.ambient(b, child));
                stack.extend(part.child(a, child).zip(whole.child(b, child)));
            }
        }
    }
}

/// Replaces colours and normals of a tree by noise at corners: whole lattices, parts of them, none.
fn corners(tree: &mut Tree, seed: u64) {
    tree.colors.clear();
    tree.normals.clear();
    let mut rng = Rng(seed + 77);
    for _ in 0..tree.nodes.len() {
        let mask = match rng.below(4) {
            0 | 1 => (1 << 27) - 1,
            2 => 1 << 27 | rng.bits() as u32 >> 5 & 0x7ff_ffff,
            _ => 0,
        };
        let corners = NodeCorners { mask, first: tree.corner_values.len() as u32 };
        tree.corner_values.extend((0..corners.count()).map(|_| {
            let color = rng.bits().to_le_bytes();
            let alpha = if color[3] < 60 { 0 } else { color[3] };
            CornerValue { color: [color[0], color[1], color[2], alpha], normal: RawNormal(rng.bits() as u32) }
        }));
        tree.corners.push(corners);
    }
}

#[test]
fn corners_come_back() {
    for seed in 0..12 {
        let mut tree = shape(seed).tree();
        corners(&mut tree, seed);
        for layout in LAYOUTS {
            let octree = laid_out(&tree, &layout);
            for (slot, child, _, index) in voxels(&tree, &octree) {
                let node = tree.corners[index];
                let values = &tree.corner_values[node.first as usize..][..node.count()];
                let cell = octree.corners(slot, child);
                if !node.has_child(child) {
                    let own = (node.mask >> 27 != 0).then(|| &values[values.len() - 8..]);
                    assert_eq!(cell.as_ref().map(|cell| &cell.corners[..]), own);
                    assert!(cell.is_none_or(|cell| cell.size == 0.5));
                    continue;
                }
                let cell = cell.expect("corners of its own");
                for (k, corner) in cell.corners.iter().enumerate() {
                    let point = (0..3).map(|a| ((child >> a & 1) + (k as u8 >> a & 1)) * [1, 3, 9][a]).sum::<u8>();
                    let rank = (0..point).filter(|below| node.mask >> below & 1 != 0).count();
                    assert_eq!(*corner, values[rank]);
                }
                let middle = cell.middle();
                assert_eq!(octree.color(slot, child), middle.map(|([r, g, b, _], _)| [r, g, b]));
                assert_eq!(octree.normal(slot, child), middle.map(|(_, normal)| normal));
            }
        }
    }
}

/// In the authors' format, a voxel without corners inherits those of the nearest ancestor. Differences are listed.
#[test]
fn corners_go_through_files_of_the_authors() {
    for seed in 0..12 {
        let mut tree = shape(seed).tree();
        corners(&mut tree, seed);
        let octree = laid_out(&tree, &LAYOUTS[seed as usize % 3]);
        let mut bytes = Vec::new();
        let lost = oct::write_to(&octree, &mut bytes).unwrap();
        assert!(lost.iter().all(|lost| lost.contains("in another way")), "{lost:?}");
        let oct::Imported { octree: back, lost: rounded } = oct::from_bytes(&bytes).unwrap();
        assert!(rounded.is_empty(), "{rounded:?}");
        let differences = diff::diff(&octree, &back, usize::MAX).unwrap();
        let of_corners = |what: &str| ["corners", "colour", "normal"].contains(&what);
        assert!(differences.list.iter().all(|d| of_corners(d.what)), "{:?}", differences.list.first());
        assert_eq!(differences.is_empty(), lost.is_empty(), "{:?}", differences.list.first());
        // The second export loses nothing.
        let (last, lost) = through_oct(&back);
        assert!(lost.is_empty(), "{lost:?}");
        assert!(diff::diff(&back, &last, 3).unwrap().is_empty());
    }
    // Whole lattices are the same in both formats.
    let mut tree = shape(7).tree();
    tree.colors.clear();
    tree.normals.clear();
    let value = |k: u32| CornerValue { color: [k as u8, 2, 3, 255], normal: RawNormal(k.wrapping_mul(0x9e37_79b1)) };
    for first in (0..tree.nodes.len() as u32).map(|k| 27 * k) {
        tree.corners.push(NodeCorners { mask: (1 << 27) - 1, first });
        tree.corner_values.extend((first..first + 27).map(value));
    }
    let octree = laid_out(&tree, &LAYOUTS[2]);
    let (back, lost) = through_oct(&octree);
    assert!(lost.is_empty() && diff::diff(&octree, &back, 3).unwrap().is_empty());
}

/// Blocks with different kinds of attachments: the file then has one value for every voxel.
#[test]
fn kinds_that_an_oct_file_does_not_mix_become_a_palette() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../spec/v1/vectors/valid");
    let octree = Octree::open(&folder.join("plain_colors_normal_blocks.esvo")).unwrap();
    let (back, lost) = through_oct(&octree);
    assert_eq!(lost.len(), 1);
    assert!(lost[0].contains("rounded"), "{lost:?}");
    assert_eq!(back.plain_color(2, 1), octree.plain_color(2, 1));
    let angle = back.normal(2, 1).unwrap().angle_between(octree.normal(2, 1).unwrap());
    assert!(angle.to_degrees() < 0.05);
    let octree = Octree::open(&folder.join("plain_normals_constant_color.esvo")).unwrap();
    let (back, lost) = through_oct(&octree);
    assert!(lost.is_empty(), "{lost:?}");
    assert!(diff::diff(&octree, &back, 3).unwrap().is_empty());
}

#[test]
fn trees_whose_values_do_not_fit_are_refused() {
    let refused = |what: &str, change: fn(&mut Tree)| {
        let mut tree = plain_tree(6);
        assert!(!tree.colors.is_empty());
        change(&mut tree);
        let Err(error) = assemble(&tree, DMat4::IDENTITY, &LAYOUTS[0]) else { panic!("{what}") };
        assert!(!error.to_string().is_empty());
    };
    refused("alphas of some", |tree| tree.alphas = vec![255]);
    refused("alphas without plain", |tree| {
        tree.alphas = vec![255; tree.voxels() as usize];
        tree.plain = false;
    });
    refused("plain blocks", |tree| {
        tree.colors.clear();
        tree.color_blocks = vec![ColorBlock::default(); tree.nodes.len()];
    });
    refused("masks of some nodes", |tree| tree.own = vec![1]);
    refused("a mask beyond the valid mask", |tree| {
        tree.own = tree.nodes.iter().map(|node| node.valid).collect();
        tree.own[1] = !tree.nodes[1].valid;
    });
    refused("voxels that differ and share", |tree| tree.own = vec![0; tree.nodes.len()]);
    refused("corners and colours", |tree| corners_of(tree, 0));
    refused("corners that do not follow each other", |tree| {
        tree.colors.clear();
        tree.normals.clear();
        corners_of(tree, 1);
    });
}

/// Eight corners for every voxel with children, whose values begin `late` places too late.
fn corners_of(tree: &mut Tree, late: u32) {
    tree.corners = (0..tree.nodes.len() as u32).map(|k| NodeCorners { mask: 1 << 27, first: 8 * k + late }).collect();
    tree.corner_values =
        vec![CornerValue { color: [255; 4], normal: RawNormal::encode(Vec3::X) }; 8 * tree.nodes.len()];
}
