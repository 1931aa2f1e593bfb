//! The slices of an object, level by level, from which a tree is made.

use std::io::{Read, Seek};

use super::clusters::{Clusters, SLICES};
use super::slice::{Place, Slice, entry};
use super::{fault, kind};
use crate::{AmbientBlock, FormatError};

/// Marks a leaf in place of the index of a node.
pub(super) const LEAF: u32 = u32::MAX;

/// A voxel that is not a leaf.
#[derive(Clone, Copy)]
pub(super) struct Node {
    /// Mask of its children; never zero.
    pub(super) valid: u8,
    /// Mask of the children with a contour.
    pub(super) contours: u8,
    /// Index of its first child among the voxels of the next level.
    pub(super) first_child: u32,
    /// Index of the contour of the first child that has one.
    pub(super) first_contour: u32,
    /// Mask of the children, or of the corners of children, with their own colour and normal.
    pub(super) mask: u32,
    /// Index of the first word of its colours and normals.
    pub(super) first_value: u32,
    /// Index of its ambient occlusion block, which it may share with a sibling.
    pub(super) ambient: u32,
}

/// The voxels of one level, in depth-first order.
#[derive(Default)]
pub(super) struct Layer {
    /// For each voxel the index of its node, or [`LEAF`].
    pub(super) voxels: Vec<u32>,
    /// The voxels that are not leaves.
    pub(super) nodes: Vec<Node>,
}

/// The voxels of an object by level.
#[derive(Default)]
pub(super) struct Layers {
    /// The levels, from level 0 (the root) on.
    pub(super) layers: Vec<Layer>,
    /// Contours of all nodes.
    pub(super) contours: Vec<u32>,
    /// Words of the colours and normals of all nodes.
    pub(super) values: Vec<u32>,
    /// Ambient occlusion blocks.
    pub(super) ambient: Vec<AmbientBlock>,
    /// Number of slices that have not been built.
    pub(super) unbuilt: u64,
    /// Whether there are contours.
    with_contours: bool,
    /// Whether there is ambient occlusion.
    pub(super) with_ambient: bool,
    /// Type of the attachment with colours and normals.
    pub(super) kind: Option<u32>,
}

/// A slice to read: its place, and the range of the voxels in its cube.
struct Task {
    id: u32,
    place: Place,
    first: usize,
    count: usize,
}

/// The voxels of the level that is being read.
#[derive(Default)]
struct Front {
    /// Lower corners.
    positions: Vec<[u32; 3]>,
    /// The nodes whose children they are.
    parents: Vec<u32>,
}

impl Layers {
    /// Whether colours and normals are a palette or values at corners.
    pub(super) fn own_values(&self) -> bool {
        matches!(self.kind, Some(kind::PALETTE | kind::CORNERS))
    }

    /// Reads the slices from the root on. `has` tells which types of attachments there are; `kind` is the type with the
    /// colours and normals.
    pub(super) fn read<R: Read + Seek>(
        file: &mut Clusters<R>,
        root: u32,
        has: impl Fn(u32) -> bool,
        kind: Option<u32>,
    ) -> Result<Self, FormatError> {
        let (with_contours, with_ambient) = (has(kind::CONTOURS), has(kind::OCCLUSION));
        let mut layers = Self { with_contours, with_ambient, kind, ..Self::default() };
        let mut front = Front { positions: vec![[0; 3]], parents: vec![0] };
        let mut tasks = vec![Task { id: root, place: Place::ROOT, first: 0, count: 1 }];
        let mut total = 0;
        while !front.positions.is_empty() {
            let mut layer = Layer { voxels: vec![LEAF; front.positions.len()], nodes: Vec::new() };
            let (mut next, mut next_tasks) = (Front::default(), Vec::new());
            for task in tasks {
                let words = file.take((SLICES, task.id))?;
                match Slice::new(task.id, words, task.place, task.count as u32)? {
                    None => layers.unbuilt += 1,
                    Some(slice) => layers.slice(&slice, &task, &front, &mut layer, &mut next, &mut next_tasks)?,
                }
                if total + next.positions.len() >= LEAF as usize {
                    return Err(FormatError::Limit("the .oct file has 2^32 voxels or more".into()));
                }
            }
            layers.layers.push(layer);
            total += next.positions.len();
            (front, tasks) = (next, next_tasks);
        }
        Ok(layers)
    }

    /// Adds the nodes of a slice, and the voxels and slices of the next level below it.
    fn slice(
        &mut self,
        slice: &Slice,
        task: &Task,
        front: &Front,
        layer: &mut Layer,
        next: &mut Front,
        tasks: &mut Vec<Task>,
    ) -> Result<(), FormatError> {
        if slice.nodes() == 0 {
            return Ok(());
        }
        if task.place.voxel_scale == 0 {
            return Err(slice.broken("voxels of scale 0 have children"));
        }
        let first_node = layer.nodes.len();
        let first_child = next.positions.len();
        let half = 1 << (task.place.voxel_scale - 1);
        let mut parents = Vec::with_capacity(slice.nodes() as usize);
        for voxel in (0..slice.voxels()).filter(|voxel| slice.is_split(*voxel)) {
            let index = task.first + voxel as usize;
            let node = layer.nodes.len() as u32;
            let valid = slice.mask(node - first_node as u32)?;
            layer.voxels[index] = node;
            let first_child = next.positions.len() as u32;
            layer.nodes.push(Node {
                valid,
                contours: 0,
                first_child,
                first_contour: 0,
                mask: 0,
                first_value: 0,
                ambient: 0,
            });
            parents.push(front.parents[index]);
            for slot in (0..8).filter(|slot| valid >> slot & 1 != 0) {
                let corner = front.positions[index];
                next.positions.push(std::array::from_fn(|axis| corner[axis] + (slot >> axis & 1) * half));
                next.parents.push(node);
            }
        }
        let nodes = &mut layer.nodes[first_node..];
        if self.with_contours {
            self.contours(slice, nodes)?;
        }
        match self.kind {
            None => {}
            Some(kind::BLOCKS) => self.blocks(slice, nodes, &parents)?,
            Some(kind) => self.values(slice, nodes, kind)?,
        }
        if self.with_ambient {
            self.ambient(slice, nodes, &parents)?;
        }
        let place = Place { voxel_scale: task.place.voxel_scale - 1, ..task.place };
        let mut cursor = first_child;
        follow(slice, &mut slice.entries(), place, &next.positions, &mut cursor, tasks)
    }

    fn contours(&mut self, slice: &Slice, nodes: &mut [Node]) -> Result<(), FormatError> {
        let words = slice.attachment(kind::CONTOURS, nodes.len())?;
        for (index, node) in nodes.iter_mut().enumerate() {
            let (pointer, mask) = (words[index] >> 8, words[index] as u8);
            node.contours = mask;
            node.first_contour = self.contours.len() as u32;
            let values = (words.get(pointer as usize..))
                .and_then(|rest| rest.get(..mask.count_ones() as usize))
                .filter(|values| mask & !node.valid == 0 && values.iter().all(|value| value << 14 != 0));
            let Some(values) = values else {
                let what = format!(
                    "mask {mask:08b} at word {pointer} does not fit its voxels or the attachment, or a normal is zero"
                );
                return Err(slice.broken(format!("contours of node {index}: {what}")));
            };
            self.contours.extend_from_slice(values);
        }
        Ok(())
    }

    /// Colour and normal blocks.
    fn blocks(&mut self, slice: &Slice, nodes: &mut [Node], parents: &[u32]) -> Result<(), FormatError> {
        let first = self.values.len();
        let pairs = pairs(parents, |index, pair| nodes[index].first_value = (first + pair * BLOCK_WORDS) as u32);
        let words = slice.attachment(kind::BLOCKS, pairs * BLOCK_WORDS)?;
        self.values.extend_from_slice(&words[..pairs * BLOCK_WORDS]);
        Ok(())
    }

    /// Ambient occlusion blocks.
    fn ambient(&mut self, slice: &Slice, nodes: &mut [Node], parents: &[u32]) -> Result<(), FormatError> {
        let first = self.ambient.len();
        let pairs = pairs(parents, |index, pair| nodes[index].ambient = (first + pair) as u32);
        let words = slice.attachment(kind::OCCLUSION, pairs * 2)?;
        let block = |words: &[u32]| AmbientBlock(u64::from(words[1]) << 32 | u64::from(words[0]));
        self.ambient.extend(words[..pairs * 2].chunks_exact(2).map(block));
        Ok(())
    }

    /// Colours and normals of children, or of the corners of children.
    fn values(&mut self, slice: &Slice, nodes: &mut [Node], kind: u32) -> Result<(), FormatError> {
        let entry_words = if kind == kind::CORNERS { 2 } else { 1 };
        let words = slice.attachment(kind, nodes.len() * entry_words)?;
        for (index, node) in nodes.iter_mut().enumerate() {
            let (mask, pointer, allowed) = match words[index * entry_words..][..entry_words] {
                [mask, pointer] => (mask, pointer, (1 << 27) - 1),
                _ => (words[index] & 0xff, words[index] >> 8, u32::from(node.valid)),
            };
            node.mask = mask;
            node.first_value = self.values.len() as u32;
            let values = (words.get(pointer as usize..))
                .and_then(|rest| rest.get(..2 * mask.count_ones() as usize))
                .filter(|_| mask & !allowed == 0 && self.values.len() < LEAF as usize - 64);
            let Some(values) = values else {
                let what = format!("mask {mask:b} at word {pointer} does not fit its voxels or the attachment");
                return Err(slice.broken(format!("attributes of node {index}: {what}")));
            };
            self.values.extend_from_slice(values);
        }
        Ok(())
    }
}

/// Siblings that are not leaves share blocks in pairs. Calls `of(node, pair)` for each node and returns the number of
/// pairs.
fn pairs(parents: &[u32], mut of: impl FnMut(usize, usize)) -> usize {
    let (mut pairs, mut index) = (0, 0);
    while index < parents.len() {
        let size = if parents.get(index + 1) == Some(&parents[index]) { 2 } else { 1 };
        (index..index + size).for_each(|index| of(index, pairs));
        (index, pairs) = (index + size, pairs + 1);
    }
    pairs
}

/// Words of a colour block and a normal block.
pub(super) const BLOCK_WORDS: usize = 6;

/// Reads the child entries of one cube. Adds the slices of the next level with the voxels, from `cursor` on, in each.
fn follow(
    slice: &Slice,
    entries: &mut impl Iterator<Item = i32>,
    place: Place,
    voxels: &[[u32; 3]],
    cursor: &mut usize,
    tasks: &mut Vec<Task>,
) -> Result<(), FormatError> {
    let entry = entries.next().ok_or_else(|| slice.broken("it has too few child entries"))?;
    if entry == entry::SPLIT {
        // Siblings share blocks, so they must be in the same slice.
        if place.cube_scale < place.voxel_scale + 2 {
            return Err(slice.broken(format!(
                "it divides a cube of scale {} with voxels of scale {} too far",
                place.cube_scale, place.voxel_scale
            )));
        }
        return (0..8).try_for_each(|slot| follow(slice, entries, place.octant(slot), voxels, cursor, tasks));
    }
    let first = *cursor;
    while voxels.get(*cursor).is_some_and(|position| place.contains(*position)) {
        *cursor += 1;
    }
    let count = *cursor - first;
    match u32::try_from(entry) {
        Ok(id) if count > 0 => tasks.push(Task { id, place, first, count }),
        Ok(id) => return Err(fault(format!("slice {id}"), "there are no voxels in its cube")),
        Err(_) if entry == entry::NONE => {}
        Err(_) => return Err(slice.broken(format!("child entry {entry} is invalid, expected -2 or above"))),
    }
    Ok(())
}
