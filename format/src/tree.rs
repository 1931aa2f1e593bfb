//! An octree in depth-first order, before it has addresses: what a builder makes and [`assemble`](crate::assemble) lays out.

use crate::{Contour, RawNormal};

/// One non-leaf voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TreeNode {
    /// Which child slots hold a voxel; never zero.
    pub valid: u8,
    /// Which of them are leaves.
    pub leaf: u8,
    /// Which of them have a contour.
    pub contours: u8,
    /// Number of nodes in this subtree, this one included.
    pub subtree: u32,
    /// Index of the attributes of the first valid child; the others follow in slot order.
    pub first_voxel: u32,
    /// Index of the contour of the first child that has one; the others follow in slot order.
    pub first_contour: u32,
}

impl TreeNode {
    /// Which children are nodes themselves. They follow this node in slot order, each with its subtree.
    pub fn nonleaf(&self) -> u8 {
        self.valid & !self.leaf
    }
}

/// A whole octree or one subtree of it, nodes in depth-first order.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    /// The nodes; the root is first.
    pub nodes: Vec<TreeNode>,
    /// Contour values in the order of the nodes.
    pub contours: Vec<Contour>,
    /// sRGB-encoded colour of every voxel but the root, in the order of the nodes; or empty.
    pub colors: Vec<[u8; 3]>,
    /// Normal of every voxel but the root, likewise; or empty.
    pub normals: Vec<RawNormal>,
    voxels: u32,
}

/// What is known of a voxel when its parent is pushed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Voxel {
    /// sRGB-encoded colour.
    pub color: Option<[u8; 3]>,
    /// Shading normal.
    pub normal: Option<RawNormal>,
    /// Contour.
    pub contour: Option<Contour>,
    /// No descriptor of its own.
    pub leaf: bool,
}

impl Tree {
    /// Appends a node with these child voxels and returns its index. The caller pushes the subtrees of the non-leaf
    /// children in slot order, then calls [`close`](Self::close).
    pub fn open(&mut self, children: &[Option<Voxel>; 8]) -> usize {
        let mut node = TreeNode {
            valid: 0,
            leaf: 0,
            contours: 0,
            subtree: 1,
            first_voxel: self.voxels,
            first_contour: self.contours.len() as u32,
        };
        for (slot, voxel) in children.iter().enumerate() {
            let Some(voxel) = voxel else { continue };
            node.valid |= 1 << slot;
            node.leaf |= u8::from(voxel.leaf) << slot;
            if let Some(contour) = voxel.contour {
                node.contours |= 1 << slot;
                self.contours.push(contour);
            }
            self.colors.extend(voxel.color);
            self.normals.extend(voxel.normal);
            self.voxels += 1;
        }
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// Ends the subtree of the node at `index`: everything pushed since belongs to it.
    pub fn close(&mut self, index: usize) {
        self.nodes[index].subtree = (self.nodes.len() - index) as u32;
    }

    /// Appends a whole subtree, as the next child of the node that is open.
    pub fn append(&mut self, subtree: &Tree) {
        let (voxels, contours) = (self.voxels, self.contours.len() as u32);
        self.nodes.extend(subtree.nodes.iter().map(|node| TreeNode {
            first_voxel: node.first_voxel + voxels,
            first_contour: node.first_contour + contours,
            ..*node
        }));
        self.contours.extend_from_slice(&subtree.contours);
        self.colors.extend_from_slice(&subtree.colors);
        self.normals.extend_from_slice(&subtree.normals);
        self.voxels += subtree.voxels;
    }

    /// Number of voxels, the root not counted.
    pub fn voxels(&self) -> u64 {
        u64::from(self.voxels)
    }

    /// The non-leaf children of node `index` in slot order: (slot, node index).
    pub fn children(&self, index: usize) -> impl Iterator<Item = (u8, usize)> + '_ {
        let mut next = index + 1;
        let nonleaf = self.nodes[index].nonleaf();
        (0..8u8).filter(move |slot| nonleaf >> slot & 1 != 0).map(move |slot| {
            let child = next;
            next += self.nodes[child].subtree as usize;
            (slot, child)
        })
    }

    /// Level of the deepest voxel; the root is level 0.
    pub fn levels(&self) -> u32 {
        fn depth(tree: &Tree, index: usize) -> u32 {
            1 + tree.children(index).map(|(_, child)| depth(tree, child)).max().unwrap_or(0)
        }
        if self.nodes.is_empty() { 0 } else { depth(self, 0) }
    }
}
