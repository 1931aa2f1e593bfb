//! The attachments of one block: their types, sizes and bytes (spec sections 6 and 8).

use crate::file::{AttachmentEntry, attachment};
use crate::layout::place::Placed;
use crate::values::components::Form;
use crate::values::plain::{plain_count, slots};
use crate::{AmbientBlock, ColorBlock, FormatError, NormalBlock, Tree};

/// The content of an attachment.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Content {
    /// One colour for all voxels.
    ConstantColor([u8; 3]),
    /// A colour block for every pair of slots.
    ColorBlocks,
    /// A normal block for every pair of slots.
    NormalBlocks,
    /// An ambient occlusion block for every pair of slots.
    AmbientBlocks,
    /// Plain colours.
    PlainColors,
    /// Plain normals.
    PlainNormals,
    /// Colours and normals at corners.
    Corners,
    /// Components of a column of the tree: its index, its type, how the values are stored.
    Components(usize, u32, Form),
}

/// An attachment of a block that is being laid out.
pub(crate) struct Attached {
    content: Content,
    /// Offset from the start of the block in bytes.
    start: u64,
    size: u64,
}

impl Attached {
    /// Its entry in the directory of the info section, which starts at byte `info` of the block.
    pub(crate) fn entry(&self, info: u64) -> AttachmentEntry {
        AttachmentEntry { kind: self.content.kind(), offset: (self.start - info) as u32, size: self.size }
    }
}

impl Content {
    fn kind(self) -> u32 {
        match self {
            Self::ConstantColor(_) => attachment::COLOR_CONSTANT,
            Self::ColorBlocks => attachment::COLOR_BLOCKS,
            Self::NormalBlocks => attachment::NORMAL_BLOCKS,
            Self::AmbientBlocks => attachment::AMBIENT_BLOCKS,
            Self::PlainColors => attachment::COLORS_PLAIN,
            Self::PlainNormals => attachment::NORMALS_PLAIN,
            Self::Corners => attachment::CORNERS,
            Self::Components(_, kind, _) => kind,
        }
    }

    /// The attachments of a block with these descriptors and a descriptor array of `array_slots` slots, with their
    /// sizes in bytes.
    ///
    /// # Errors
    /// Plain values out of reach of their pointers.
    pub(crate) fn of_block(tree: &Tree, placed: &[Placed], array_slots: u32) -> Result<Vec<(Self, u64)>, FormatError> {
        let (slots, pairs) = (u64::from(array_slots), u64::from(array_slots / 2));
        let plain = |values: fn(&Tree, usize) -> Option<u32>| {
            let count = |p: &Placed| PlainValues::new(tree, p.node, values).count() as u64;
            let words = slots + placed.iter().map(count).sum::<u64>();
            if words > u64::from(MAX_PLAIN_POINTER) {
                return Err(too_many(attachment::COLORS_PLAIN, words));
            }
            Ok(words * 4)
        };
        let mut list = Vec::new();
        match one_color(tree, placed) {
            Some(color) => list.push((Self::ConstantColor(color), 8)),
            None if tree.colors.is_empty() && tree.color_blocks.is_empty() => {}
            None if tree.plain => list.push((Self::PlainColors, plain(color)?)),
            None => list.push((Self::ColorBlocks, pairs * 8)),
        }
        if tree.plain && !tree.normals.is_empty() {
            list.push((Self::PlainNormals, plain(normal)?));
        } else if !(tree.normals.is_empty() && tree.normal_blocks.is_empty()) {
            list.push((Self::NormalBlocks, pairs * 16));
        }
        if !tree.corners.is_empty() {
            let values: u64 = placed.iter().map(|p| tree.corners[p.node].count() as u64).sum();
            list.push((Self::Corners, (slots + values) * 8));
        }
        if !(tree.ambient.is_empty() && tree.ambient_blocks.is_empty()) {
            list.push((Self::AmbientBlocks, pairs * 8));
        }
        for (index, column) in tree.columns.iter().enumerate() {
            let Some((form, words)) = column.form(tree, placed, slots) else { continue };
            if form == Form::Entries && words > u64::from(MAX_PLAIN_POINTER) {
                return Err(too_many(column.kind, words));
            }
            list.push((Self::Components(index, column.kind, form), words * 4));
        }
        Ok(list)
    }
}

/// Largest distance in words from the start of a plain attachment to a value: entries have 24 bits for it.
const MAX_PLAIN_POINTER: u32 = (1 << 24) - 1;

fn too_many(kind: u32, words: u64) -> FormatError {
    let name = if attachment::has_components(kind) { "component" } else { "plain" };
    FormatError::Limit(format!(
        "a {name} attachment has {words} words, expected at most {MAX_PLAIN_POINTER}: use smaller blocks"
    ))
}

/// The colour of a voxel, as stored.
fn color(tree: &Tree, voxel: usize) -> Option<u32> {
    let [r, g, b] = *tree.colors.get(voxel)?;
    Some(u32::from_le_bytes([r, g, b, tree.alphas.get(voxel).copied().unwrap_or(u8::MAX)]))
}

/// The normal of a voxel, as stored.
fn normal(tree: &Tree, voxel: usize) -> Option<u32> {
    Some(tree.normals.get(voxel)?.0)
}

/// The plain values of the voxels of one node.
struct PlainValues {
    valid: u8,
    /// Mask of the voxels whose value is stored separately.
    mask: u8,
    /// By child slot.
    values: [u32; 8],
}

impl PlainValues {
    fn new(tree: &Tree, index: usize, value: fn(&Tree, usize) -> Option<u32>) -> Self {
        let node = &tree.nodes[index];
        let mut values = [0; 8];
        for (voxel, slot) in (node.first_voxel as usize..).zip(slots(node.valid)) {
            values[usize::from(slot)] = value(tree, voxel).unwrap_or(0);
        }
        let mask = tree.own.get(index).copied().unwrap_or_else(|| {
            // The voxels with the most frequent value (the first such) share it, if there are at least two.
            let same = |slot: u8| {
                let equal = |other: &u8| values[usize::from(*other)] == values[usize::from(slot)];
                slots(node.valid).filter(equal).fold(0u8, |mask, slot| mask | 1 << slot)
            };
            let shared = slots(node.valid).map(same).reduce(|a, b| if b.count_ones() > a.count_ones() { b } else { a });
            let shared = shared.unwrap_or(0);
            if shared.count_ones() > 1 { node.valid & !shared } else { node.valid }
        });
        Self { valid: node.valid, mask, values }
    }

    fn count(&self) -> usize {
        plain_count(self.mask, self.valid)
    }

    /// The values in the order in which they are stored.
    fn stored(&self) -> impl Iterator<Item = u32> + '_ {
        let others = slots(self.valid & !self.mask).take(1);
        slots(self.mask).chain(others).map(|slot| self.values[usize::from(slot)])
    }
}

/// Places attachments one after the other from byte `start` of the block on. Also returns the end of the last.
pub(crate) fn place(contents: Vec<(Content, u64)>, start: u64) -> (Vec<Attached>, u64) {
    let mut end = start;
    let place = |(content, size): (Content, u64)| {
        let start = end.next_multiple_of(8);
        end = start + size;
        Attached { content, start, size }
    };
    let attached = contents.into_iter().map(place).collect();
    (attached, end)
}

/// The colour of all voxels of these descriptors, if it is the same and opaque.
fn one_color(tree: &Tree, placed: &[Placed]) -> Option<[u8; 3]> {
    let colors = |p: &Placed| {
        let node = &tree.nodes[p.node];
        let range = node.first_voxel as usize..(node.first_voxel + node.valid.count_ones()) as usize;
        if tree.alphas.get(range).is_some_and(|alphas| alphas.iter().any(|alpha| *alpha != u8::MAX)) {
            return None;
        }
        tree.colors.get(node.first_voxel as usize..)?.get(..node.valid.count_ones() as usize)
    };
    let first = *colors(placed.first()?)?.first()?;
    placed.iter().all(|p| colors(p).is_some_and(|c| c.iter().all(|c| *c == first))).then_some(first)
}

/// The descriptors of the block whose attachments are encoded.
pub(crate) struct Described<'a> {
    pub(crate) placed: &'a [Placed],
    pub(crate) array_slots: u32,
}

impl Described<'_> {
    /// Writes the attachments. `words` starts at byte `from` of the block.
    pub(crate) fn encode(&self, tree: &Tree, attached: &[Attached], from: u64, words: &mut [u32]) {
        for &Attached { content, start, size } in attached {
            let words = &mut words[((start - from) / 4) as usize..][..(size / 4) as usize];
            match content {
                Content::ConstantColor([r, g, b]) => words[0] = u32::from_le_bytes([r, g, b, 0]),
                Content::ColorBlocks => self.encode_pairs(words, |members| {
                    tree.color_blocks.get(members[0].node).copied().unwrap_or_else(|| {
                        ColorBlock::encode(&texels(tree, members, |voxel| tree.colors.get(voxel).copied()))
                    })
                }),
                Content::NormalBlocks => self.encode_pairs(words, |members| {
                    tree.normal_blocks.get(members[0].node).copied().unwrap_or_else(|| {
                        NormalBlock::encode(&texels(tree, members, |voxel| Some(tree.normals.get(voxel)?.decode())))
                    })
                }),
                Content::PlainColors => self.encode_plain(words, tree, color),
                Content::PlainNormals => self.encode_plain(words, tree, normal),
                Content::Corners => self.encode_corners(words, tree),
                Content::Components(column, _, form) => {
                    tree.columns[column].encode(tree, self.placed, self.array_slots as usize, form, words);
                }
                Content::AmbientBlocks => self.encode_pairs(words, |members| {
                    tree.ambient_blocks.get(members[0].node).copied().unwrap_or_else(|| {
                        AmbientBlock::encode(&texels(tree, members, |voxel| tree.ambient.get(voxel).copied()))
                    })
                }),
            }
        }
    }

    /// Writes an entry for every descriptor, then the values in the same order.
    fn encode_plain(&self, words: &mut [u32], tree: &Tree, value: fn(&Tree, usize) -> Option<u32>) {
        let mut next = self.array_slots as usize;
        for placed in self.placed {
            let plain = PlainValues::new(tree, placed.node, value);
            words[placed.slot as usize] = (next as u32) << 8 | u32::from(plain.mask);
            for value in plain.stored() {
                words[next] = value;
                next += 1;
            }
        }
    }

    /// Like [`encode_plain`](Self::encode_plain), for values at corners.
    fn encode_corners(&self, words: &mut [u32], tree: &Tree) {
        let mut next = self.array_slots as usize * 2;
        for placed in self.placed {
            let corners = tree.corners[placed.node];
            let values = &tree.corner_values[corners.first as usize..][..corners.count()];
            if values.is_empty() {
                continue;
            }
            let entry = placed.slot as usize * 2;
            words[entry..entry + 2].copy_from_slice(&[corners.mask, next as u32]);
            words[next..next + 2 * values.len()].copy_from_slice(bytemuck::cast_slice(values));
            next += 2 * values.len();
        }
    }

    /// Writes a block for every pair of slots with descriptors: slots `2 k` and `2 k + 1` share block `k`. The two
    /// descriptors of a pair are siblings.
    fn encode_pairs<T: bytemuck::NoUninit>(&self, words: &mut [u32], block: impl Fn(&[Placed]) -> T) {
        let size = size_of::<T>() / 4;
        for members in self.placed.chunk_by(|a, b| a.slot / 2 == b.slot / 2) {
            let block = block(members);
            let words = &mut words[members[0].slot as usize / 2 * size..][..size];
            bytemuck::cast_slice_mut::<u32, u8>(words).copy_from_slice(bytemuck::bytes_of(&block));
        }
    }
}

/// The values of the voxels of one or two descriptors, by texel of their block.
fn texels<T: Copy>(tree: &Tree, members: &[Placed], value: impl Fn(usize) -> Option<T>) -> [Option<T>; 16] {
    let mut texels = [None; 16];
    for member in members {
        let node = &tree.nodes[member.node];
        let base = 8 * (member.slot % 2) as usize;
        let slots = (0..8).filter(|slot| node.valid >> slot & 1 != 0);
        for (voxel, slot) in (node.first_voxel as usize..).zip(slots) {
            texels[base + slot] = value(voxel);
        }
    }
    texels
}
