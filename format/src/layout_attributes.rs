//! The attachments of one block: which it has, and their bytes (spec sections 6 and 8).

use crate::file::{AttachmentEntry, FIRST_SLOT, InfoSection, attachment, to_bytes};
use crate::layout::{Layout, Placed};
use crate::{ColorBlock, NormalBlock, Tree};

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Color {
    None,
    Constant([u8; 3]),
    Blocks,
}

impl Layout {
    pub(crate) fn color_kind(tree: &Tree, placed: &[Placed]) -> Color {
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

    pub(crate) fn encode_info(&self, index: usize, words: &mut [u32]) {
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

    pub(crate) fn encode_attributes(&self, tree: &Tree, words: &mut [u32]) {
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
