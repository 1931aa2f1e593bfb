//! Converts the chunks of an `.oct` file to an octree.

use std::io::{Read, Seek};

use glam::{DMat4, DVec4, Vec3};

use super::clusters::{Clusters, MESHES, OCTREE_CHUNK, SLICES};
use super::layers::{BLOCK_WORDS, LEAF, Layers, Node};
use super::values::{Attributes, own_values};
use super::{Imported, fault, kind};
use crate::layout::join::join;
use crate::values::plain::{OWN_CUBE, slots};
use crate::{
    AssembleOptions, ColorBlock, Contour, CornerValue, FormatError, NodeCorners, NormalBlock, Octree, RawNormal, Tree,
    Voxel, assemble,
};

/// Words of an object before its list of attachments.
const OBJECT_WORDS: usize = 34;

/// An entry of the object list.
struct Object {
    transform: DMat4,
    /// Slice of the root; `None` if nothing has been built.
    root: Option<u32>,
    attachments: Vec<u32>,
}

pub(super) fn import<R: Read + Seek>(mut file: Clusters<R>) -> Result<Imported, FormatError> {
    let objects = read_objects(&file.take(OCTREE_CHUNK)?)?;
    let mut lost = Vec::new();
    let mut octrees = Vec::new();
    for (index, object) in objects.iter().enumerate() {
        match object.root {
            Some(root) => octrees.push(import_object(&mut file, index, root, object, &mut lost)?),
            None => lost.push(format!("object {index} has no voxels")),
        }
    }
    let unused = [(SLICES, "slices that belong to no object"), (MESHES, "meshes that octrees were built from")];
    for (group, what) in unused {
        match file.left(group) {
            0 => {}
            count => lost.push(format!("{count} {what}")),
        }
    }
    if octrees.is_empty() {
        return Err(fault("octree chunk", "no object has voxels"));
    }
    let octree = match octrees.len() {
        1 => octrees.remove(0),
        _ => join(&octrees.iter().collect::<Vec<_>>())?,
    };
    Ok(Imported { octree, lost })
}

fn read_objects(words: &[u32]) -> Result<Vec<Object>, FormatError> {
    let broken = |what: &str| fault("octree chunk", what);
    let short = || broken("it is too short");
    let (header, mut rest) = words.split_first_chunk::<5>().ok_or_else(short)?;
    if bytemuck::bytes_of(header)[..8] != *b"Octree  " || header[2] != 1 {
        return Err(broken("it does not begin with \"Octree  \" and version 1"));
    }
    let mut objects = Vec::new();
    for index in 0..header[3] {
        let (head, tail) = rest.split_first_chunk::<OBJECT_WORDS>().ok_or_else(short)?;
        let matrix =
            |at: usize| DMat4::from_cols_array(&std::array::from_fn(|i| f64::from(f32::from_bits(head[at + i]))));
        let (to_world, to_object) = (matrix(0), matrix(16));
        let mut transform = to_world * to_object;
        // The product of two affine matrices is affine; remove rounding errors.
        if to_world.row(3) == DVec4::W && to_object.row(3) == DVec4::W {
            transform = DMat4::from_cols(
                transform.x_axis.truncate().extend(0.0),
                transform.y_axis.truncate().extend(0.0),
                transform.z_axis.truncate().extend(0.0),
                transform.w_axis.truncate().extend(1.0),
            );
        }
        if !crate::check::tables::is_usable(&transform.to_cols_array()) {
            return Err(broken(&format!("the transform of object {index} is not finite, affine and invertible")));
        }
        let root =
            match head[32] as i32 {
                -1 => None,
                root => Some(u32::try_from(root).map_err(|_| {
                    broken(&format!("the root slice of object {index} is {root}, expected -1 or above"))
                })?),
            };
        let attachments = tail.get(..head[33] as usize).ok_or_else(short)?;
        rest = &tail[attachments.len()..];
        objects.push(Object { transform, root, attachments: attachments.to_vec() });
    }
    Ok(objects)
}

fn import_object<R: Read + Seek>(
    file: &mut Clusters<R>,
    index: usize,
    root: u32,
    object: &Object,
    lost: &mut Vec<String>,
) -> Result<Octree, FormatError> {
    let mut lose = |what: String| lost.push(format!("object {index}: {what}"));
    let has = |kind: u32| object.attachments.contains(&kind);
    let source = [kind::BLOCKS, kind::PALETTE, kind::CORNERS].into_iter().find(|kind| has(*kind));
    let taken = |kind: &u32| [0, kind::CONTOURS, kind::OCCLUSION].contains(kind) || Some(*kind) == source;
    for other in object.attachments.iter().filter(|kind| !taken(kind)) {
        lose(format!("attachments of type {other}"));
    }
    let layers = Layers::read(file, root, has, source)?;
    if layers.layers[0].nodes.is_empty() {
        return Err(fault(format!("slice {root}"), "the root has no children, so there are no voxels"));
    }
    if layers.unbuilt > 0 {
        lose(format!("{} slices that have not been built, their voxels are leaves", layers.unbuilt));
    }
    let mut planter = Planter { layers: &layers, tree: Tree::default(), bare: 0, rounded: 0 };
    planter.tree.plain = source == Some(kind::PALETTE);
    planter.plant(0, 0, Attributes::None);
    let Planter { mut tree, bare, rounded, .. } = planter;
    if tree.alphas.iter().all(|alpha| *alpha == u8::MAX) {
        tree.alphas.clear();
    }
    let octree = assemble(&tree, object.transform, &AssembleOptions::default())?;
    if bare > 0 {
        lose(format!("{bare} voxels and their ancestors have no colour and normal, they are white with normal +z"));
    }
    if rounded > 0 {
        lose(format!(
            "colours and normals at the corners of {rounded} voxels are interpolated from an ancestor's and rounded"
        ));
    }
    Ok(octree)
}

/// Makes the tree, depth-first.
struct Planter<'a> {
    layers: &'a Layers,
    tree: Tree,
    /// Number of voxels without a value of their own or of an ancestor.
    bare: u64,
    /// Voxels whose corners had to be interpolated.
    rounded: u64,
}

impl Planter<'_> {
    /// Adds a node of a level and its descendants.
    fn plant(&mut self, level: usize, index: u32, attributes: Attributes) {
        let layers = self.layers;
        let node = &layers.layers[level].nodes[index as usize];
        let mut contour = node.first_contour as usize;
        let mut children = [None; 8];
        let mut below = [None; 8];
        let valid = (0..8).filter(|slot| node.valid >> slot & 1 != 0);
        for (child, slot) in (node.first_child as usize..).zip(valid) {
            let next = layers.layers[level + 1].voxels[child];
            let mut voxel = Voxel { leaf: next == LEAF, ..Voxel::default() };
            if node.contours >> slot & 1 != 0 {
                voxel.contour = Some(Contour(layers.contours[contour]));
                contour += 1;
            }
            let own = if layers.own_values() { attributes.child(layers, node, slot) } else { Attributes::None };
            match (layers.kind, own) {
                (Some(kind::PALETTE), Attributes::One(value)) => self.value(&mut voxel, value),
                (Some(kind::PALETTE), _) => {
                    self.bare += 1;
                    self.value(&mut voxel, CornerValue { color: [u8::MAX; 4], normal: RawNormal::encode(Vec3::Z) });
                }
                _ => {}
            }
            below[slot as usize] = (!voxel.leaf).then_some((next, own));
            children[slot as usize] = Some(voxel);
        }
        let opened = self.tree.open(&children);
        if layers.kind == Some(kind::BLOCKS) {
            let words = &layers.values[node.first_value as usize..][..BLOCK_WORDS];
            self.tree.color_blocks.push(ColorBlock { head: words[0], indices: words[1] });
            self.tree.normal_blocks.push(NormalBlock {
                base: RawNormal(words[2]),
                u_indices: words[3],
                axes: words[4],
                v_indices: words[5],
            });
        }
        match layers.kind {
            Some(kind::PALETTE) => self.tree.own.push(node.mask as u8),
            Some(kind::CORNERS) => self.corners(node, attributes),
            _ => {}
        }
        if layers.with_ambient {
            self.tree.ambient_blocks.push(layers.ambient[node.ambient as usize]);
        }
        for (next, own) in below.into_iter().flatten() {
            self.plant(level + 1, next, own);
        }
        self.tree.close(opened);
    }

    fn value(&mut self, voxel: &mut Voxel, CornerValue { color: [r, g, b, alpha], normal }: CornerValue) {
        (voxel.color, voxel.normal) = (Some([r, g, b]), Some(normal));
        self.tree.alphas.push(alpha);
    }

    /// Adds the corners of a node. If some are missing, adds the corners of its own voxel, which has these attributes.
    fn corners(&mut self, node: &Node, attributes: Attributes) {
        let mut corners = NodeCorners { mask: node.mask, first: self.tree.corner_values.len() as u32 };
        self.tree.corner_values.extend(own_values(self.layers, node));
        let lacking = slots(node.valid).any(|child| !corners.has_child(child));
        if let (true, Attributes::Corners(cell)) = (lacking, attributes) {
            corners.mask |= OWN_CUBE;
            self.rounded += u64::from(cell.size < 1.0);
            self.tree.corner_values.extend(cell.of_voxel());
        }
        self.tree.corners.push(corners);
    }
}
