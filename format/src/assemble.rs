//! From a tree to the image: blocks, pages, pairs, far pointers (paper section 3.1; spec sections 4 to 8).

use std::collections::{HashMap, VecDeque};

use glam::DMat4;
use rayon::prelude::*;

use crate::descriptor::MAX_NEAR_POINTER;
use crate::file::{
    ATTACHMENT_BYTES, AttachmentEntry, BlockEntry, CODEC_RAW, FIRST_SLOT, INFO_BYTES, InfoSection, NO_PARENT,
    ObjectEntry, PAGE_BYTES, PAGE_SLOTS, attachment, to_bytes,
};
use crate::{ChildDescriptor, ColorBlock, FormatError, NormalBlock, Octree, Tree};

/// How a tree is cut into blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AssembleOptions {
    /// Largest descriptor array of a block in slots, 64 to 2^20. Small values force many blocks.
    pub block_slots: u32,
    /// Largest distance in slots that may use the 15-bit child pointer, 1 to 32767. Small values force far pointers.
    pub near_limit: u32,
}

impl Default for AssembleOptions {
    /// Blocks of up to 8 MiB of descriptors, the full reach of the child pointer.
    fn default() -> Self {
        Self { block_slots: 1 << 20, near_limit: MAX_NEAR_POINTER }
    }
}

/// Lays the tree out as the only object of an octree.
///
/// # Errors
/// A tree that is empty, not well-formed or deeper than 23 levels, a transform that cannot be inverted, options out of
/// range, more than 2^32 slots.
pub fn assemble(tree: &Tree, octree_to_mesh: DMat4, options: &AssembleOptions) -> Result<Octree, FormatError> {
    if !(64..=1 << 20).contains(&options.block_slots) || !(1..=MAX_NEAR_POINTER).contains(&options.near_limit) {
        return Err(FormatError::Limit(format!("block_slots 64..=1048576 and near_limit 1..=32767, not {options:?}")));
    }
    tree.check()?;
    let levels = tree.levels();
    if levels > 23 {
        return Err(FormatError::Limit(format!("{levels} levels: an octree has at most 23")));
    }
    let sizes = subtree_slots(tree);
    let plan = Plan::new(tree, &sizes, options);
    let layouts: Vec<Layout> = (0..plan.blocks.len())
        .into_par_iter()
        .map(|block| Layout::new(tree, &sizes, &plan, block, options.near_limit))
        .collect::<Result<_, _>>()?;

    let mut blocks = Vec::with_capacity(layouts.len());
    let mut image_offset = 0u64;
    for (planned, layout) in plan.blocks.iter().zip(&layouts) {
        let image_size = layout.parts.total_bytes.next_multiple_of(PAGE_BYTES);
        blocks.push(BlockEntry {
            object: 0,
            parent: planned.parent,
            cube_position: planned.cube_position,
            cube_scale: planned.cube_scale,
            image_offset,
            image_size,
            file_offset: 0,
            stored_size: image_size,
            codec: CODEC_RAW,
            crc: 0,
            reserved: 0,
        });
        image_offset += image_size;
    }
    if image_offset / 8 > u64::from(u32::MAX) {
        return Err(FormatError::Limit(format!("{image_offset} bytes: an image has at most 2^32 slots of 8 bytes")));
    }
    let mut image = vec![0u64; (image_offset / 8) as usize];
    let mut rest = &mut image[..];
    let mut slices = Vec::with_capacity(blocks.len());
    for block in &blocks {
        let (head, tail) = rest.split_at_mut((block.image_size / 8) as usize);
        slices.push(head);
        rest = tail;
    }
    slices.into_par_iter().zip(&layouts).enumerate().for_each(|(index, (slice, layout))| {
        layout.encode(tree, &blocks, index, slice);
    });
    let object = ObjectEntry {
        octree_to_mesh: octree_to_mesh.to_cols_array(),
        root_block: 0,
        levels,
        root_slot: u64::from(FIRST_SLOT),
        descriptors: tree.nodes.len() as u64,
        leaf_voxels: tree.nodes.iter().map(|node| u64::from(node.leaf.count_ones())).sum(),
        contours: tree.contours.len() as u64,
        far_pointers: layouts.iter().map(|layout| layout.far_pointers).sum(),
        reserved: [0; 4],
    };
    Octree::from_parts(vec![object], blocks, image)
}

/// For every node, the slots that the groups below it take, page headers and far pointers not counted.
fn subtree_slots(tree: &Tree) -> Vec<u32> {
    let mut sizes = vec![0u32; tree.nodes.len()];
    for index in (0..tree.nodes.len()).rev() {
        let group = tree.nodes[index].nonleaf().count_ones().next_multiple_of(2);
        // Saturated sizes are far beyond what the image can hold; that is refused once its length is known.
        sizes[index] = tree.children(index).fold(group, |sum, (_, child)| sum.saturating_add(sizes[child]));
    }
    sizes
}

/// An upper bound for the same with everything counted: up to 18 slots of every 1024 go to a page header and to a
/// group that did not fit. A far pointer takes siblings with more than about `near_limit` slots below them; such a
/// group and its ancestors hold at most 22 times 8 far pointers.
fn upper_bound(size: u32, near_limit: u32) -> u32 {
    let far = u64::from(size).min(u64::from(size) * 256 / u64::from(near_limit));
    let size = u64::from(size) + far;
    (size + size / 32 + 64).min(u64::from(u32::MAX)) as u32
}

struct PlannedBlock {
    /// The node whose descendants the block holds; `None`: the root itself and its descendants.
    above: Option<usize>,
    parent: u32,
    cube_position: [u32; 3],
    cube_scale: u32,
}

/// Which nodes have their children in another block, and in which.
struct Plan {
    blocks: Vec<PlannedBlock>,
    cuts: HashMap<usize, u32>,
}

/// A cube: lower corner in units of 2^-23 of the root, and scale.
type Cube = ([u32; 3], u32);

fn child_cube((position, scale): Cube, slot: u8) -> Cube {
    let size = 1 << (scale - 1);
    (std::array::from_fn(|axis| position[axis] + if slot >> axis & 1 != 0 { size } else { 0 }), scale - 1)
}

impl Plan {
    fn new(tree: &Tree, sizes: &[u32], options: &AssembleOptions) -> Self {
        let root: Cube = ([0; 3], 23);
        let first = PlannedBlock { above: None, parent: NO_PARENT, cube_position: root.0, cube_scale: root.1 };
        let mut plan = Self { blocks: vec![first], cuts: HashMap::new() };
        let bound = |index: usize| upper_bound(sizes[index], options.near_limit);
        if bound(0) <= options.block_slots {
            return plan;
        }
        // Breadth first over blocks, so that coarse blocks come first; depth first over the nodes of one block.
        let mut queue = VecDeque::from([(0usize, 0u32, root)]);
        while let Some((top, block, cube)) = queue.pop_front() {
            let mut used = 64;
            let mut stack = vec![(top, cube)];
            while let Some((index, cube)) = stack.pop() {
                for (slot, child) in tree.children(index) {
                    if sizes[child] == 0 {
                        continue;
                    }
                    let (bound, cube) = (bound(child), child_cube(cube, slot));
                    if bound <= options.block_slots / 8 && used + bound <= options.block_slots {
                        used += bound; // Too small to deserve a block of its own.
                    } else if bound > options.block_slots && used + 32 <= options.block_slots {
                        used += 32;
                        stack.push((child, cube));
                    } else {
                        let new = plan.blocks.len() as u32;
                        plan.cuts.insert(child, new);
                        plan.blocks.push(PlannedBlock {
                            above: Some(child),
                            parent: block,
                            cube_position: cube.0,
                            cube_scale: cube.1,
                        });
                        if bound > options.block_slots {
                            queue.push_back((child, new, cube));
                        }
                    }
                }
            }
        }
        plan
    }
}

/// Where a descriptor's children are.
#[derive(Clone, Copy)]
enum Children {
    None,
    /// First child at this slot of the block.
    Near(u32),
    /// Far pointer at the first slot, first child at the second.
    Far(u32, u32),
    /// Far pointer at the slot, children in the other block.
    Block(u32, u32),
}

struct Placed {
    node: usize,
    slot: u32,
    children: Children,
}

/// Byte offsets of the parts of a block from its start.
struct Parts {
    info: u64,
    contours: u64,
    color: u64,
    normals: u64,
    total_bytes: u64,
}

/// One block, every descriptor with its slot.
struct Layout {
    placed: Vec<Placed>,
    array_slots: u32,
    contour_count: u32,
    far_pointers: u64,
    color: Color,
    normals: bool,
    parts: Parts,
}

#[derive(Clone, Copy, PartialEq)]
enum Color {
    None,
    Constant([u8; 3]),
    Blocks,
}

/// Walks the nodes of one block and gives them slots.
struct Placer<'a> {
    tree: &'a Tree,
    sizes: &'a [u32],
    plan: &'a Plan,
    near_limit: u32,
    cursor: u32,
    placed: Vec<Placed>,
    far_pointers: u64,
}

impl Placer<'_> {
    /// Places the children of `above` (or the root alone), then what is below each of them. Returns the first slot.
    fn place(&mut self, above: Option<usize>) -> Result<u32, FormatError> {
        let group: Vec<usize> = match above {
            Some(index) => self.tree.children(index).map(|(_, child)| child).collect(),
            None => vec![0],
        };
        // A descriptor needs a far pointer if what its elder siblings have below them may push its children too far.
        let mut ahead = 16u32.saturating_sub(group.len() as u32);
        let far: Vec<bool> = (group.iter())
            .map(|&node| {
                let needs = self.sizes[node] != 0
                    && (self.plan.cuts.contains_key(&node) || ahead.saturating_add(64) > self.near_limit);
                ahead = ahead.saturating_add(upper_bound(self.sizes[node], self.near_limit));
                needs
            })
            .collect();
        let far_count = far.iter().filter(|&&f| f).count() as u32;
        let needed = group.len() as u32 + far_count;
        let in_page = self.cursor % PAGE_SLOTS;
        if in_page == 0 || in_page + needed > PAGE_SLOTS {
            self.cursor = self.cursor.next_multiple_of(PAGE_SLOTS) + FIRST_SLOT;
        }
        let first = self.cursor;
        let mut far_slot = first + group.len() as u32;
        self.cursor = (first + needed).next_multiple_of(2);
        self.far_pointers += u64::from(far_count);
        let start = self.placed.len();
        self.placed.extend((first..).zip(&group).map(|(slot, &node)| Placed { node, slot, children: Children::None }));
        for (i, &node) in group.iter().enumerate() {
            if self.sizes[node] == 0 {
                continue;
            }
            let children = if let Some(&block) = self.plan.cuts.get(&node) {
                Children::Block(far_slot, block)
            } else {
                let target = self.place(Some(node))?;
                if far[i] { Children::Far(far_slot, target) } else { Children::Near(target) }
            };
            far_slot += u32::from(far[i]);
            if let Children::Near(target) = children
                && target - (first + i as u32) > MAX_NEAR_POINTER
            {
                return Err(FormatError::Limit(format!("node {node} at slot {first} is too far from its children")));
            }
            self.placed[start + i].children = children;
        }
        Ok(first)
    }
}

impl Layout {
    fn new(tree: &Tree, sizes: &[u32], plan: &Plan, block: usize, near_limit: u32) -> Result<Self, FormatError> {
        let mut placer =
            Placer { tree, sizes, plan, near_limit, cursor: FIRST_SLOT, placed: Vec::new(), far_pointers: 0 };
        placer.place(plan.blocks[block].above)?;
        let Placer { placed, cursor: array_slots, far_pointers, .. } = placer;
        let contour_count = placed.iter().map(|p| tree.nodes[p.node].contours.count_ones()).sum();
        let color = Self::color_kind(tree, &placed);
        let normals = !(tree.normals.is_empty() && tree.normal_blocks.is_empty());
        let attachments = u64::from(color != Color::None) + u64::from(normals);
        let pairs = u64::from(array_slots / 2);
        let info = u64::from(array_slots) * 8;
        let contours = info + INFO_BYTES + ATTACHMENT_BYTES * attachments;
        let color_start = (contours + u64::from(contour_count) * 4).next_multiple_of(8);
        let color_bytes = match color {
            Color::None => 0,
            Color::Constant(_) => 8,
            Color::Blocks => pairs * 8,
        };
        let normals_start = color_start + color_bytes;
        let total_bytes = normals_start + if normals { pairs * 16 } else { 0 };
        let parts = Parts { info, contours, color: color_start, normals: normals_start, total_bytes };
        Ok(Self { placed, array_slots, contour_count, far_pointers, color, normals, parts })
    }

    fn color_kind(tree: &Tree, placed: &[Placed]) -> Color {
        let colors = |p: &Placed| {
            let node = &tree.nodes[p.node];
            &tree.colors[node.first_voxel as usize..][..node.valid.count_ones() as usize]
        };
        if tree.colors.is_empty() {
            return if tree.color_blocks.is_empty() { Color::None } else { Color::Blocks };
        }
        let first = colors(&placed[0])[0];
        if placed.iter().all(|p| colors(p).iter().all(|c| *c == first)) {
            Color::Constant(first)
        } else {
            Color::Blocks
        }
    }

    fn encode(&self, tree: &Tree, blocks: &[BlockEntry], index: usize, image: &mut [u64]) {
        let info_slot = self.array_slots;
        let block_slot = |block: usize| (blocks[block].image_offset / 8) as u32;
        for page in (0..info_slot).step_by(PAGE_SLOTS as usize) {
            image[page as usize] = u64::from(info_slot - page);
        }
        let (array, rest) = image.split_at_mut(info_slot as usize);
        let rest_words: &mut [u32] = bytemuck::cast_slice_mut(rest);
        let pool = ((self.parts.contours - self.parts.info) / 4) as usize;
        let mut contour = 0u32;
        for placed in &self.placed {
            let node = &tree.nodes[placed.node];
            let (child_ptr, far) = match placed.children {
                Children::None => (0, false),
                Children::Near(target) => (target - placed.slot, false),
                Children::Far(far, target) => {
                    array[far as usize] = u64::from(target - placed.slot);
                    (far - placed.slot, true)
                }
                Children::Block(far, block) => {
                    let target = block_slot(block as usize) + FIRST_SLOT;
                    array[far as usize] = u64::from(target - (block_slot(index) + placed.slot));
                    (far - placed.slot, true)
                }
            };
            let contour_ptr =
                if node.contours != 0 { info_slot * 2 + pool as u32 + contour - placed.slot * 2 } else { 0 };
            let count = node.contours.count_ones();
            let values = &tree.contours[node.first_contour as usize..][..count as usize];
            rest_words[pool + contour as usize..][..values.len()].copy_from_slice(bytemuck::cast_slice(values));
            contour += count;
            array[placed.slot as usize] =
                ChildDescriptor::new(node.valid, node.leaf, child_ptr, far, node.contours, contour_ptr).0;
        }
        self.encode_info(index, rest_words);
        self.encode_attributes(tree, rest_words);
    }

    fn encode_info(&self, index: usize, words: &mut [u32]) {
        let relative = |offset: u64| (offset - self.parts.info) as u32;
        let pairs = u64::from(self.array_slots / 2);
        let mut directory = Vec::new();
        match self.color {
            Color::None => {}
            Color::Constant(_) => directory.push((attachment::COLOR_CONSTANT, self.parts.color, 8)),
            Color::Blocks => directory.push((attachment::COLOR_BLOCKS, self.parts.color, pairs * 8)),
        }
        if self.normals {
            directory.push((attachment::NORMAL_BLOCKS, self.parts.normals, pairs * 16));
        }
        let mut bytes = to_bytes(&InfoSection {
            block: index as u32,
            array_slots: self.array_slots,
            first_descriptor: self.array_slots - FIRST_SLOT,
            contour_offset: relative(self.parts.contours) / 4,
            contour_count: self.contour_count,
            attachment_count: directory.len() as u32,
            reserved: 0,
        });
        for (kind, offset, size) in directory {
            bytes.extend(to_bytes(&AttachmentEntry { kind, offset: relative(offset), size }));
        }
        bytemuck::cast_slice_mut::<u32, u8>(words)[..bytes.len()].copy_from_slice(&bytes);
    }

    fn encode_attributes(&self, tree: &Tree, words: &mut [u32]) {
        let word = |offset: u64| ((offset - self.parts.info) / 4) as usize;
        if let Color::Constant([r, g, b]) = self.color {
            words[word(self.parts.color)] = u32::from_le_bytes([r, g, b, 0]);
        }
        // Consecutive slots 2k, 2k + 1 share block k; siblings are consecutive, so a pair never mixes parents.
        let mut rest = &self.placed[..];
        while let Some(first) = rest.first() {
            let pair = first.slot / 2;
            let count = rest.iter().take(2).filter(|p| p.slot / 2 == pair).count();
            let (members, tail) = rest.split_at(count);
            rest = tail;
            let mut colors = [None; 16];
            let mut normals = [None; 16];
            for member in members {
                let node = &tree.nodes[member.node];
                let base = 8 * (member.slot % 2) as usize;
                let slots = (0..8).filter(|slot| node.valid >> slot & 1 != 0);
                for (voxel, slot) in (node.first_voxel as usize..).zip(slots) {
                    colors[base + slot] = tree.colors.get(voxel).copied();
                    normals[base + slot] = tree.normals.get(voxel).map(|n| n.decode());
                }
            }
            let first = members[0].node;
            if self.color == Color::Blocks {
                let block = tree.color_blocks.get(first).copied().unwrap_or_else(|| ColorBlock::encode(&colors));
                let at = word(self.parts.color) + pair as usize * 2;
                words[at..at + 2].copy_from_slice(bytemuck::cast_slice(&[block]));
            }
            if self.normals {
                let block = tree.normal_blocks.get(first).copied().unwrap_or_else(|| NormalBlock::encode(&normals));
                let at = word(self.parts.normals) + pair as usize * 4;
                words[at..at + 4].copy_from_slice(bytemuck::cast_slice(&[block]));
            }
        }
    }
}
