//! Converts an octree to the chunks of an `.oct` file.

use std::collections::BTreeSet;

use glam::Vec3;

use super::clusters::{NewFile, OCTREE_CHUNK, SLICES};
use super::export_values::{Gaps, Inherited};
use super::kind;
use super::layers::LEAF;
use super::slice::{COMPLETE, NewSlice, Place, entry};
use crate::file::attachment;
use crate::{AmbientBlock, BlockParts, ColorBlock, FormatError, NormalBlock, Octree};

/// The average number of voxels per slice that the authors' builder aims at.
const SLICE_VOXELS: f64 = 49152.0;
/// A cube is divided if its voxels, their ancestors and possible descendants might not fit into one block in the
/// authors' memory layout, in which contour pointers have 24 bits and a voxel takes up to 17 words.
const BLOCK_VOXELS: usize = (1 << 24) / 17;
/// Cubes of levels below this one are always divided, as in the authors' builder.
const DIVIDED_LEVELS: usize = 2;
/// Slice states per word. The object list has states for a multiple of this many slices.
const STATES_PER_WORD: usize = 16;

/// A file in memory, and what was lost or changed.
pub(super) struct Exported {
    pub(super) file: NewFile,
    pub(super) lost: Vec<String>,
}

pub(super) fn export(octree: &Octree) -> Result<Exported, FormatError> {
    octree.verified()?;
    octree.sound()?;
    let mut exporter = Exporter { octree, file: NewFile::default(), slices: 0, lost: Vec::new() };
    let mut list = vec![0, 0, 1, octree.objects().len() as u32, 0];
    bytemuck::cast_slice_mut::<u32, u8>(&mut list)[..8].copy_from_slice(b"Octree  ");
    for index in 0..octree.objects().len() {
        exporter.object(index, &mut list)?;
    }
    let slices = (exporter.slices as usize).next_multiple_of(STATES_PER_WORD);
    list[4] = slices as u32;
    list.extend((0..slices).step_by(STATES_PER_WORD).map(|first| {
        let used = (exporter.slices as usize - first).min(STATES_PER_WORD);
        (0..used).fold(0, |word, slice| word | COMPLETE << (2 * slice))
    }));
    exporter.file.put(OCTREE_CHUNK, list);
    exporter.file.check()?;
    if !octree.meta().is_empty() {
        exporter.lost.push("the metadata".into());
    }
    if !octree.instances().is_empty() {
        exporter.lost.push("the instances".into());
    }
    if octree.file_hash().is_some() {
        exporter.lost.push("the id and the SHA-256 of the file".into());
    }
    for section in octree.unknown_sections() {
        exporter.lost.push(format!("the section {}", section.tag.escape_ascii()));
    }
    Ok(Exported { file: exporter.file, lost: exporter.lost })
}

/// The voxels of one level, in depth-first order.
struct Layer {
    /// Slot of the descriptor of each, or [`LEAF`].
    slots: Vec<u32>,
    /// For each, the index of its first child among the voxels of the next level; then the end of the last.
    first: Vec<u32>,
}

/// A slice to write: the voxels of the current level in the cube of a voxel of a coarser level.
#[derive(Clone, Copy)]
struct Task {
    id: u32,
    place: Place,
    /// Level and index of the voxel whose cube it is.
    level: usize,
    voxel: usize,
}

struct Exporter<'a> {
    octree: &'a Octree,
    file: NewFile,
    slices: u32,
    lost: Vec<String>,
}

impl Exporter<'_> {
    /// Writes the slices of an object, and appends its entry.
    fn object(&mut self, index: usize, list: &mut Vec<u32>) -> Result<(), FormatError> {
        let object = &self.octree.objects()[index];
        let exact = self.octree.octree_to_mesh(index);
        let rounded = exact.as_mat4();
        if !(rounded.is_finite() && rounded.as_dmat4().determinant().is_normal()) {
            return Err(FormatError::Limit(format!(
                "the transform of object {index} cannot be rounded to 32-bit floats"
            )));
        }
        if rounded.as_dmat4() != exact {
            self.lost.push(format!("object {index}: the transform is rounded to 32-bit floats"));
        }
        let kinds = self.kinds(index);
        list.extend(glam::Mat4::IDENTITY.to_cols_array().map(f32::to_bits));
        list.extend(rounded.to_cols_array().map(f32::to_bits));
        list.extend([self.slices, kinds.len() as u32]);
        list.extend(&kinds);

        let root = object.root_slot as u32;
        let layers = layers(self.octree, root)?;
        let mut gaps = Gaps::default();
        let inherited = match kinds.as_slice() {
            kinds if kinds.contains(&kind::PALETTE) => Inherited::palette(self.octree, root, &mut gaps),
            kinds if kinds.contains(&kind::CORNERS) => Inherited::corners(self.octree, root, &mut gaps),
            _ => Inherited::default(),
        };
        let mut tasks = vec![Task { id: self.slices, place: Place::ROOT, level: 0, voxel: 0 }];
        self.slices += 1;
        for level in 0.. {
            let mut next = Vec::new();
            for task in tasks {
                let mut entries = Vec::new();
                self.follow(&layers, level, task, &mut entries, &mut next);
                let words = self.slice(&layers, level, &task, &entries, (&kinds, &inherited), &mut gaps);
                self.file.put((SLICES, task.id), words);
            }
            if next.is_empty() {
                break;
            }
            tasks = next;
        }
        let mut lose = |what: &str| self.lost.push(format!("object {index}: {what}"));
        if gaps.colors {
            lose("some or all voxels have no colour, they are white in the file");
        }
        if gaps.normals {
            lose("some or all voxels have no normal, it is +z in the file");
        }
        if gaps.rounded {
            lose("colours and normals of blocks or corners are converted to one value for every voxel and rounded");
        }
        if gaps.lattice > 0 {
            lose(&format!("{} voxels have values at corners that are stored in another way", gaps.lattice));
        }
        if gaps.ambient {
            lose("some voxels have no ambient occlusion, all light reaches them in the file");
        }
        if let Some(error) = gaps.constant.filter(|error| *error > 0.0) {
            lose(&format!("constant colours became blocks, channels are off by up to {error:.1}/255"));
        }
        Ok(())
    }

    /// Types of the attachments of an object in the file. Adds attachments without a counterpart to `lost`.
    fn kinds(&mut self, index: usize) -> Vec<u32> {
        let parts: Vec<&BlockParts> = (self.octree.blocks().iter().zip(self.octree.parts()))
            .filter(|(block, _)| block.object as usize == index)
            .map(|(_, parts)| parts)
            .collect();
        let has = |parts: &BlockParts, kinds: &[u32]| parts.attachments.iter().any(|a| kinds.contains(&a.0));
        let any = |kinds: &[u32]| parts.iter().any(|parts| has(parts, kinds));
        let mut kinds = Vec::new();
        if self.octree.objects()[index].contours > 0 {
            kinds.push(kind::CONTOURS);
        }
        let corners = [attachment::CORNERS];
        if any(&corners) && parts.iter().all(|parts| has(parts, &corners)) {
            kinds.push(kind::CORNERS);
        } else if any(&[attachment::COLORS_PLAIN, attachment::NORMALS_PLAIN, attachment::CORNERS]) {
            kinds.push(kind::PALETTE);
        } else if any(&attachment::COLORS) || any(&attachment::NORMALS) {
            kinds.push(kind::BLOCKS);
        }
        if any(&[attachment::AMBIENT_BLOCKS]) {
            kinds.push(kind::OCCLUSION);
        }
        let known = |kind: &u32| (attachment::COLOR_BLOCKS..=attachment::CORNERS).contains(kind);
        let attachments = parts.iter().flat_map(|parts| &parts.attachments);
        for other in attachments.map(|a| a.0).filter(|kind| !known(kind)).collect::<BTreeSet<u32>>() {
            self.lost.push(format!("object {index}: attachments of type {other:#x}"));
        }
        kinds
    }

    /// Appends the child entries and the slices for a cube, or a part of one, at the next level.
    fn follow(&mut self, layers: &[Layer], level: usize, cube: Task, entries: &mut Vec<i32>, tasks: &mut Vec<Task>) {
        let voxels = |at: usize| range(layers, cube.level, cube.voxel, at);
        let next = match layers.get(level + 1) {
            Some(layer) if layer.slots[voxels(level + 1)].iter().any(|slot| *slot != LEAF) => voxels(level + 1).len(),
            _ => return entries.push(entry::NONE),
        };
        // Decides as the authors' builder does, so that importing and exporting keeps the slices. Any choice is valid.
        let all = || (cube.level..=level + 1).map(|at| voxels(at).len()).sum::<usize>() + 8 * next;
        let uneven = || {
            let octants = voxels(cube.level + 1).filter(|v| !range(layers, cube.level + 1, *v, level + 1).is_empty());
            let n = octants.count() as f64;
            n < 2.0 || 4.0 * next as f64 > SLICE_VOXELS * n * n.ln() / (n - 1.0)
        };
        let large = cube.level < DIVIDED_LEVELS || all() > BLOCK_VOXELS || uneven();
        if level - cube.level <= 1 || !large {
            let place = Place { voxel_scale: 22 - level as u32, ..cube.place };
            entries.push(self.slices as i32);
            tasks.push(Task { id: self.slices, place, ..cube });
            self.slices += 1;
            return;
        }
        entries.push(entry::SPLIT);
        let layer = &layers[cube.level];
        let valid = self.octree.descriptor(layer.slots[cube.voxel]).valid_mask();
        let mut child = layer.first[cube.voxel] as usize;
        for slot in 0..8 {
            if valid >> slot & 1 == 0 {
                entries.push(entry::NONE);
                continue;
            }
            let octant = Task { place: cube.place.octant(slot), level: cube.level + 1, voxel: child, ..cube };
            self.follow(layers, level, octant, entries, tasks);
            child += 1;
        }
    }

    fn slice(
        &self,
        layers: &[Layer],
        level: usize,
        task: &Task,
        entries: &[i32],
        (kinds, inherited): (&[u32], &Inherited),
        gaps: &mut Gaps,
    ) -> Vec<u32> {
        let slots = &layers[level].slots[range(layers, task.level, task.voxel, level)];
        let split: Vec<bool> = slots.iter().map(|slot| *slot != LEAF).collect();
        let nodes: Vec<u32> = slots.iter().copied().filter(|slot| *slot != LEAF).collect();
        let masks: Vec<u8> = nodes.iter().map(|slot| self.octree.descriptor(*slot).valid_mask()).collect();
        let attachments: Vec<(u32, Vec<u32>)> = (kinds.iter())
            .map(|kind| match *kind {
                kind::CONTOURS => (*kind, self.contours(&nodes)),
                kind::OCCLUSION => (*kind, self.ambient(&nodes, gaps)),
                kind::PALETTE => (*kind, inherited.palette_words(self.octree, &nodes, gaps)),
                kind::CORNERS => (*kind, inherited.corner_words(self.octree, &nodes)),
                _ => (*kind, self.blocks(&nodes, gaps)),
            })
            .collect();
        let (id, place) = (task.id, task.place);
        NewSlice { id, place, entries, split: &split, masks: &masks, attachments: &attachments }.words()
    }

    /// A word with mask and pointer for each node, then the contours.
    fn contours(&self, nodes: &[u32]) -> Vec<u32> {
        let mut words = vec![0; nodes.len()];
        for (index, slot) in nodes.iter().enumerate() {
            words[index] = (words.len() as u32) << 8 | u32::from(self.octree.descriptor(*slot).contour_mask());
            words.extend((0..8).filter_map(|child| self.octree.contour(*slot, child)).map(|contour| contour.0));
        }
        words
    }

    /// A colour block and a normal block for every pair of siblings, which are pairs of slots in both formats.
    fn blocks(&self, nodes: &[u32], gaps: &mut Gaps) -> Vec<u32> {
        let mut words = Vec::new();
        for slot in nodes.iter().filter(|slot| **slot % 2 == 0) {
            let parts = &self.octree.parts()[self.octree.block_of(*slot) as usize];
            let pair = ((slot - parts.start) / 2) as usize;
            match self.words(parts, attachment::COLOR_BLOCKS, pair * 2, 2) {
                Some(block) => words.extend_from_slice(block),
                None => {
                    let constant = self.words(parts, attachment::COLOR_CONSTANT, 0, 1);
                    gaps.colors |= constant.is_none();
                    let [r, g, b, _] = constant.map_or([255; 4], |word| word[0].to_le_bytes());
                    let block = ColorBlock::encode(&[Some([r, g, b]); 16]);
                    if constant.is_some() {
                        let off = |(exact, found): (u8, f32)| (f32::from(exact) - found * 255.0).abs();
                        let worst = [r, g, b].into_iter().zip(block.decode(0)).map(off).fold(0.0, f32::max);
                        gaps.constant = Some(gaps.constant.unwrap_or(0.0).max(worst));
                    }
                    words.extend([block.head, block.indices]);
                }
            }
            match self.words(parts, attachment::NORMAL_BLOCKS, pair * 4, 4) {
                Some(block) => words.extend_from_slice(block),
                None => {
                    gaps.normals = true;
                    words.extend_from_slice(bytemuck::cast_slice(&[NormalBlock::encode(&[Some(Vec3::Z); 16])]));
                }
            }
        }
        words
    }

    /// An ambient occlusion block for every pair of siblings.
    fn ambient(&self, nodes: &[u32], gaps: &mut Gaps) -> Vec<u32> {
        let block = |slot: &u32| {
            let parts = &self.octree.parts()[self.octree.block_of(*slot) as usize];
            let pair = ((slot - parts.start) / 2) as usize;
            self.words(parts, attachment::AMBIENT_BLOCKS, pair * 2, 2).map(|words| [words[0], words[1]])
        };
        let blocks = nodes.iter().filter(|slot| **slot % 2 == 0).map(|slot| {
            block(slot).unwrap_or_else(|| {
                gaps.ambient = true;
                let AmbientBlock(bits) = AmbientBlock::encode(&[Some(u8::MAX); 16]);
                [bits as u32, (bits >> 32) as u32]
            })
        });
        blocks.flatten().collect()
    }

    /// Words of an attachment of a block.
    fn words(&self, parts: &BlockParts, kind: u32, first: usize, count: usize) -> Option<&[u32]> {
        let (_, at, _) = parts.attachments.iter().find(|attachment| attachment.0 == kind)?;
        self.octree.words().get(*at as usize / 4 + first..)?.get(..count)
    }
}

/// The voxels of every level of an object.
fn layers(octree: &Octree, root: u32) -> Result<Vec<Layer>, FormatError> {
    let mut layers = Vec::new();
    let mut slots = vec![root];
    while !slots.is_empty() {
        let (mut first, mut next) = (Vec::with_capacity(slots.len() + 1), Vec::new());
        for &slot in &slots {
            first.push(next.len() as u32);
            if slot == LEAF {
                continue;
            }
            let descriptor = octree.descriptor(slot);
            for child in (0..8).filter(|child| descriptor.valid_mask() >> child & 1 != 0) {
                next.push(octree.child(slot, child).unwrap_or(LEAF));
            }
        }
        if next.len() >= LEAF as usize {
            return Err(FormatError::Limit("a level has 2^32 voxels or more".into()));
        }
        first.push(next.len() as u32);
        layers.push(Layer { slots, first });
        slots = next;
    }
    Ok(layers)
}

/// The descendants of a voxel at level `at`, as a range of indices.
fn range(layers: &[Layer], level: usize, voxel: usize, at: usize) -> std::ops::Range<usize> {
    layers[level..at]
        .iter()
        .fold(voxel..voxel + 1, |r, layer| layer.first[r.start] as usize..layer.first[r.end] as usize)
}
