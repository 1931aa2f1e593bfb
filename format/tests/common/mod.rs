//! Trees for the tests, and the comparison of a tree with the octree made from it.
#![allow(dead_code, reason = "every test binary takes a part of this")]

pub(crate) mod break_parts;
pub(crate) mod break_scene;
pub(crate) mod breaks;
pub(crate) mod oct;
pub(crate) mod patch;
pub(crate) mod samples;
pub(crate) mod survive;

use esvo_format::{ColorBlock, Contour, NormalBlock, Octree, RawNormal, Tree, Voxel};
use glam::Vec3;
use proptest::prelude::*;

/// SplitMix64: reproducible random numbers for test trees.
pub(crate) struct Rng(pub(crate) u64);

impl Rng {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// True with probability `p / 256`.
    pub(crate) fn chance(&mut self, p: u32) -> bool {
        (self.bits() >> 56) < u64::from(p)
    }

    pub(crate) fn below(&mut self, n: u64) -> u64 {
        self.bits() % n
    }

    fn direction(&mut self) -> Vec3 {
        let mut component = || (self.bits() >> 40) as f32 / (1u32 << 23) as f32 - 1.0;
        Vec3::new(component(), component(), component()).normalize_or(Vec3::Z)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Colors {
    None,
    One,
    Many,
}

/// Parameters of a random tree. Probabilities are in units of 1/256.
#[derive(Clone, Debug)]
pub(crate) struct Shape {
    pub(crate) seed: u64,
    pub(crate) levels: u32,
    pub(crate) valid: u32,
    pub(crate) leaf: u32,
    pub(crate) contour: u32,
    pub(crate) colors: Colors,
    pub(crate) normals: bool,
    /// Approximate maximum number of nodes.
    pub(crate) nodes: usize,
}

/// Random shapes with these levels, chances of a child in 256ths, and about this many nodes at most.
pub(crate) fn shapes(
    levels: std::ops::RangeInclusive<u32>,
    valid: std::ops::RangeInclusive<u32>,
    nodes: usize,
) -> impl Strategy<Value = Shape> {
    let colors = prop_oneof![Just(Colors::None), Just(Colors::One), Just(Colors::Many)];
    let contour = prop_oneof![Just(0u32), 1u32..=256];
    (any::<u64>(), levels, valid, 0u32..200, contour, colors, any::<bool>()).prop_map(
        move |(seed, levels, valid, leaf, contour, colors, normals)| Shape {
            seed,
            levels,
            valid,
            leaf,
            contour,
            colors,
            normals,
            nodes,
        },
    )
}

impl Shape {
    pub(crate) fn tree(&self) -> Tree {
        let mut tree = Tree::default();
        self.grow(&mut tree, &mut Rng(self.seed), 1);
        tree
    }

    /// A node whose children are at `level`.
    fn grow(&self, tree: &mut Tree, rng: &mut Rng, level: u32) {
        let mut children = [None; 8];
        let forced = rng.below(8) as usize;
        for (slot, child) in children.iter_mut().enumerate() {
            if slot == forced || rng.chance(self.valid) {
                *child = Some(self.voxel(rng, level >= self.levels || tree.nodes.len() >= self.nodes));
            }
        }
        let index = tree.open(&children);
        for voxel in children.into_iter().flatten() {
            if !voxel.leaf {
                self.grow(tree, rng, level + 1);
            }
        }
        tree.close(index);
    }

    fn voxel(&self, rng: &mut Rng, leaf: bool) -> Voxel {
        Voxel {
            color: match self.colors {
                Colors::None => None,
                Colors::One => Some([1, 2, 3]),
                Colors::Many => Some([rng.bits() as u8, rng.bits() as u8, rng.bits() as u8]),
            },
            normal: self.normals.then(|| RawNormal::encode(rng.direction())),
            contour: rng.chance(self.contour).then(|| Contour(rng.bits() as u32 | 1)),
            leaf: leaf || rng.chance(self.leaf),
        }
    }
}

/// Features that the comparison has seen.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Seen {
    pub(crate) descriptors: u64,
    pub(crate) far_pointers: u64,
    pub(crate) deepest: u32,
}

/// Walks tree and octree in parallel. Masks and contours must be identical; colours and normals must be the results of
/// the encoders for each pair of siblings.
pub(crate) fn compare(tree: &Tree, octree: &Octree) -> Seen {
    let root = octree.objects()[0].root_slot as u32;
    let mut seen = Seen::default();
    same_attributes(tree, octree, &[(0, root)]);
    same_node(tree, octree, 0, root, 1, &mut seen);
    seen
}

fn same_node(tree: &Tree, octree: &Octree, index: usize, slot: u32, level: u32, seen: &mut Seen) {
    let node = &tree.nodes[index];
    let descriptor = octree.descriptor(slot);
    assert_eq!(descriptor.valid_mask(), node.valid, "valid mask of node {index}");
    assert_eq!(descriptor.leaf_mask(), node.leaf, "leaf mask of node {index}");
    assert_eq!(descriptor.contour_mask(), node.contours, "contour mask of node {index}");
    seen.descriptors += 1;
    seen.far_pointers += u64::from(descriptor.far());
    seen.deepest = seen.deepest.max(level);
    let mut values = tree.contours[node.first_contour as usize..].iter();
    for child in 0..8 {
        let expected = (node.contours >> child & 1 != 0).then(|| *values.next().expect("a value per mask bit"));
        assert_eq!(octree.contour(slot, child), expected, "contour {child} of node {index}");
    }
    let children: Vec<(u8, usize)> = tree.children(index).collect();
    for child in 0..8u8 {
        let expected = children.iter().any(|c| c.0 == child);
        assert_eq!(octree.child(slot, child).is_some(), expected, "child {child} of node {index}");
    }
    let placed: Vec<(usize, u32)> =
        children.iter().map(|&(child, node)| (node, octree.child(slot, child).expect("checked above"))).collect();
    // Siblings are consecutive and start at an even slot, so pairs of siblings are pairs of slots.
    assert!(placed.first().is_none_or(|first| first.1 % 2 == 0), "first child of node {index}");
    assert!(placed.windows(2).all(|w| w[1].1 == w[0].1 + 1), "children of node {index}");
    for pair in placed.chunks(2) {
        same_attributes(tree, octree, pair);
    }
    for (child, slot) in placed {
        same_node(tree, octree, child, slot, level + 1, seen);
    }
}

/// Compares the attributes of the children of one or two sibling nodes.
fn same_attributes(tree: &Tree, octree: &Octree, pair: &[(usize, u32)]) {
    let (mut colors, mut normals) = ([None; 16], [None; 16]);
    for (k, &(index, _)) in pair.iter().enumerate() {
        let node = &tree.nodes[index];
        let slots = (0..8).filter(|slot| node.valid >> slot & 1 != 0);
        for (voxel, slot) in (node.first_voxel as usize..).zip(slots) {
            colors[8 * k + slot] = tree.colors.get(voxel).copied();
            normals[8 * k + slot] = tree.normals.get(voxel).map(|n| n.decode());
        }
    }
    let (color_block, normal_block) = (ColorBlock::encode(&colors), NormalBlock::encode(&normals));
    for texel in 0..16 {
        let Some(&(index, slot)) = pair.get(texel / 8) else { continue };
        let child = (texel % 8) as u8;
        if tree.nodes[index].valid >> child & 1 == 0 {
            continue;
        }
        match colors[texel] {
            None => assert_eq!(octree.color(slot, child), None),
            Some(color) => {
                let found = octree.color(slot, child).expect("a colour");
                let exact = color.map(|c| f32::from(c) / 255.0);
                assert!(found == exact || found == color_block.decode(texel), "colour {child} of node {index}");
                let used = || colors.iter().flatten();
                for k in 0..3 {
                    let range = used().map(|c| c[k]).max().unwrap() - used().map(|c| c[k]).min().unwrap();
                    let bound = f32::from(range) / 255.0 + 2.0 / 32.0;
                    assert!((found[k] - exact[k]).abs() <= bound, "{found:?} for {exact:?}");
                }
            }
        }
        let expected = normals[texel].map(|_| normal_block.decode(texel));
        assert_eq!(octree.normal(slot, child), expected, "normal {child} of node {index}");
        if let (Some(found), 1) = (expected, normals.iter().flatten().count()) {
            assert!(found.dot(normals[texel].unwrap()) > 0.99999, "a single normal is kept");
        }
    }
}

/// The bytes of the file.
pub(crate) fn bytes_of(octree: &Octree) -> Vec<u8> {
    let mut bytes = Vec::new();
    octree.write_to(&mut bytes).expect("writing to memory does not fail");
    bytes
}
