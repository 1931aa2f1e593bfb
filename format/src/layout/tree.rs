//! An octree in depth-first order, before it has addresses: what a builder makes and [`assemble`](crate::assemble) lays out.

use crate::values::plain::{OWN_CUBE, slots};
use crate::{AmbientBlock, ColorBlock, Contour, CornerValue, FormatError, NodeCorners, NormalBlock, RawNormal};

/// One non-leaf voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct TreeNode {
    /// Which child slots hold a voxel; never zero.
    pub valid: u8,
    /// Which of them are leaves.
    pub leaf: u8,
    /// Which of them have a contour.
    pub contours: u8,
    /// Whether the subtrees of its children are in a block that has been packed already
    /// ([`detach`](Tree::detach)): nothing of them is in this tree.
    pub detached: bool,
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
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Tree {
    /// The nodes; the root is first.
    pub nodes: Vec<TreeNode>,
    /// Contour values in the order of the nodes.
    pub contours: Vec<Contour>,
    /// sRGB-encoded colour of every voxel but the root, in the order of the nodes; or empty.
    pub colors: Vec<[u8; 3]>,
    /// Normal of every voxel but the root, likewise; or empty.
    pub normals: Vec<RawNormal>,
    /// Instead of [`colors`](Self::colors), blocks that are encoded already: one for every node, in the order of the
    /// nodes; or empty. Sibling nodes share a block two by two, in slot order from the first; the one that counts is
    /// that of the first of the two, texel `i` being its child `i` and texel `8 + i` child `i` of the second.
    pub color_blocks: Vec<ColorBlock>,
    /// Instead of [`normals`](Self::normals), likewise.
    pub normal_blocks: Vec<NormalBlock>,
    /// Ambient light of every voxel but the root, in the order of the nodes, 0 (none reaches it) to 255 (all of it); or
    /// empty.
    pub ambient: Vec<u8>,
    /// Instead of [`ambient`](Self::ambient), blocks that are encoded already, as with colours.
    pub ambient_blocks: Vec<AmbientBlock>,
    /// Whether colours and normals are stored as they are, 4 bytes each, instead of in blocks of 16. More exact, and four
    /// to eight times as large.
    pub plain: bool,
    /// Alpha of the colours of a [`plain`](Self::plain) tree, likewise; or empty: they are opaque.
    pub alphas: Vec<u8>,
    /// For every node of a [`plain`](Self::plain) tree, which voxels have a colour and a normal of their own. The others
    /// have the same as each other, and share one. Or empty: the most frequent of each node is shared.
    pub own: Vec<u8>,
    /// Instead of colours and normals of voxels, those of their corners, for every node; or empty.
    pub corners: Vec<NodeCorners>,
    /// What they refer to, in the order of the nodes.
    pub corner_values: Vec<CornerValue>,
    /// Of every detached node, in the order of the nodes, what stands for the block that has its children.
    pub(crate) outside: Vec<u32>,
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
            detached: false,
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

    /// Gives voxel `slot` of the node at `index` other attributes, of the kinds that it was opened with.
    ///
    /// # Panics
    /// If there is no such voxel, or it was opened without attributes of these kinds.
    pub fn set_attributes(&mut self, index: usize, slot: usize, color: Option<[u8; 3]>, normal: Option<RawNormal>) {
        let node = &self.nodes[index];
        assert!(node.valid >> slot & 1 != 0, "no voxel in slot {slot}");
        let voxel = node.first_voxel as usize + (node.valid & ((1 << slot) - 1)).count_ones() as usize;
        if let Some(color) = color {
            self.colors[voxel] = color;
        }
        if let Some(normal) = normal {
            self.normals[voxel] = normal;
        }
    }

    /// Takes voxel `slot` out of the node at `index`, for which nothing has been pushed. Takes as long as there is of the
    /// tree behind the node. A node whose last voxel goes must be [cancelled](Self::cancel).
    ///
    /// # Panics
    /// If there is no such voxel, or attributes are encoded already.
    pub fn remove_voxel(&mut self, index: usize, slot: usize) {
        assert!(self.color_blocks.is_empty() && self.normal_blocks.is_empty() && self.ambient_blocks.is_empty());
        let bit = 1u8 << slot;
        let node = &mut self.nodes[index];
        assert!(node.valid & bit != 0, "no voxel in slot {slot}");
        let voxel = node.first_voxel as usize + (node.valid & (bit - 1)).count_ones() as usize;
        let contour = node.first_contour as usize + (node.contours & (bit - 1)).count_ones() as usize;
        let has_contour = node.contours & bit != 0;
        (node.valid, node.leaf, node.contours) = (node.valid & !bit, node.leaf & !bit, node.contours & !bit);
        for later in &mut self.nodes[index + 1..] {
            later.first_voxel -= 1;
            later.first_contour -= u32::from(has_contour);
        }
        if has_contour {
            self.contours.remove(contour);
        }
        self.voxels -= 1;
        let all = self.voxels as usize + 1;
        if self.colors.len() == all {
            self.colors.remove(voxel);
        }
        if self.normals.len() == all {
            self.normals.remove(voxel);
        }
        if self.ambient.len() == all {
            self.ambient.remove(voxel);
        }
    }

    /// Takes back the node that was opened last and has no voxels any more.
    ///
    /// # Panics
    /// If it has, or another was opened since.
    pub fn cancel(&mut self, index: usize) {
        assert!(
            index + 1 == self.nodes.len() && self.nodes[index].valid == 0,
            "only an empty last node can be cancelled"
        );
        self.nodes.pop();
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
        self.color_blocks.extend_from_slice(&subtree.color_blocks);
        self.normal_blocks.extend_from_slice(&subtree.normal_blocks);
        self.ambient.extend_from_slice(&subtree.ambient);
        self.ambient_blocks.extend_from_slice(&subtree.ambient_blocks);
        self.alphas.extend_from_slice(&subtree.alphas);
        self.own.extend_from_slice(&subtree.own);
        let values = self.corner_values.len() as u32;
        let moved = |corners: &NodeCorners| NodeCorners { first: corners.first + values, ..*corners };
        self.corners.extend(subtree.corners.iter().map(moved));
        self.corner_values.extend_from_slice(&subtree.corner_values);
        self.outside.extend_from_slice(&subtree.outside);
        self.voxels += subtree.voxels;
    }

    /// Takes what is below node `index` out of the tree: a tree of its own, whose root is a copy of the node. The node
    /// stays, with its attributes and contours. Its subtree must have been closed and be the last of the tree.
    ///
    /// Pack the result into a block ([`pack`](crate::pack())), then say which with [`attach`](Self::attach).
    ///
    /// # Panics
    /// If the node's subtree is not the last.
    pub fn detach(&mut self, index: usize) -> Tree {
        let top = self.nodes[index];
        assert_eq!(index + top.subtree as usize, self.nodes.len(), "only the last subtree can be detached");
        let (voxel, contour) = (top.first_voxel, top.first_contour);
        let below = self.nodes[index + 1..].iter();
        let outside = below.clone().filter(|node| node.detached).count();
        let rebased = |node: &TreeNode| TreeNode {
            first_voxel: node.first_voxel - voxel,
            first_contour: node.first_contour - contour,
            ..*node
        };
        let corner = self.corners.get(index).map_or(0, |corners| corners.first);
        let rebased_corners = |corners: &NodeCorners| NodeCorners { first: corners.first - corner, ..*corners };
        let detached = Tree {
            nodes: std::iter::once(&top).chain(below).map(rebased).collect(),
            contours: self.contours[contour as usize..].to_vec(),
            colors: self.colors.get(voxel as usize..).unwrap_or_default().to_vec(),
            normals: self.normals.get(voxel as usize..).unwrap_or_default().to_vec(),
            color_blocks: self.color_blocks.get(index..).unwrap_or_default().to_vec(),
            normal_blocks: self.normal_blocks.get(index..).unwrap_or_default().to_vec(),
            ambient: self.ambient.get(voxel as usize..).unwrap_or_default().to_vec(),
            ambient_blocks: self.ambient_blocks.get(index..).unwrap_or_default().to_vec(),
            plain: self.plain,
            alphas: self.alphas.get(voxel as usize..).unwrap_or_default().to_vec(),
            own: self.own.get(index..).unwrap_or_default().to_vec(),
            corners: self.corners.get(index..).unwrap_or_default().iter().map(rebased_corners).collect(),
            corner_values: self.corner_values.get(corner as usize..).unwrap_or_default().to_vec(),
            outside: self.outside.split_off(self.outside.len() - outside),
            voxels: self.voxels - voxel,
        };
        let own_voxels = voxel + top.valid.count_ones();
        self.nodes.truncate(index + 1);
        (self.nodes[index].detached, self.nodes[index].subtree) = (true, 1);
        self.contours.truncate((contour + top.contours.count_ones()) as usize);
        self.colors.truncate(own_voxels as usize);
        self.normals.truncate(own_voxels as usize);
        self.color_blocks.truncate(index + 1);
        self.normal_blocks.truncate(index + 1);
        self.ambient.truncate(own_voxels as usize);
        self.ambient_blocks.truncate(index + 1);
        self.alphas.truncate(own_voxels as usize);
        self.own.truncate(index + 1);
        let own_corners = self.corners.get(index).map_or(0, |corners| corner as usize + corners.count());
        self.corners.truncate(index + 1);
        self.corner_values.truncate(own_corners);
        self.voxels = own_voxels;
        detached
    }

    /// Says which block has the children of the node that was detached last.
    pub fn attach(&mut self, block: u32) {
        self.outside.push(block);
    }

    /// Number of voxels, the root not counted.
    pub fn voxels(&self) -> u64 {
        u64::from(self.voxels)
    }

    /// The non-leaf children of node `index` in slot order: (slot, node index). None if they have been detached.
    pub fn children(&self, index: usize) -> impl Iterator<Item = (u8, usize)> + '_ {
        let mut next = index + 1;
        let nonleaf = if self.nodes[index].detached { 0 } else { self.nodes[index].nonleaf() };
        (0..8u8).filter(move |slot| nonleaf >> slot & 1 != 0).map(move |slot| {
            let child = next;
            next += self.nodes[child].subtree as usize;
            (slot, child)
        })
    }

    /// Level of the deepest voxel; the root is level 0.
    pub fn levels(&self) -> u32 {
        // The ends of the subtrees that are open: as many as the node is deep.
        let (mut open, mut deepest) = (Vec::new(), 0);
        for (index, node) in self.nodes.iter().enumerate() {
            while open.last().is_some_and(|end| *end <= index) {
                open.pop();
            }
            open.push(index + node.subtree as usize);
            deepest = deepest.max(open.len());
        }
        deepest as u32
    }

    /// Whether the nodes are what [`open`](Self::open) and [`close`](Self::close) make of an octree, each node with
    /// its children behind it and its attributes in place.
    ///
    /// # Errors
    /// What is wrong with the first node that is not.
    pub(crate) fn check(&self) -> Result<(), FormatError> {
        if self.nodes.is_empty() {
            return Err(FormatError::Limit("an octree needs at least one voxel".into()));
        }
        for (what, count) in
            [("colours", self.colors.len()), ("normals", self.normals.len()), ("ambient values", self.ambient.len())]
        {
            if count != 0 && count != self.voxels as usize {
                let what = format!("{count} {what} for {} voxels: give every voxel one, or none", self.voxels);
                return Err(FormatError::Limit(what));
            }
        }
        for (what, values, blocks) in [
            ("colour", self.colors.len(), self.color_blocks.len()),
            ("normal", self.normals.len(), self.normal_blocks.len()),
            ("ambient", self.ambient.len(), self.ambient_blocks.len()),
        ] {
            if blocks != 0 && (blocks != self.nodes.len() || values != 0) {
                let what = format!("{blocks} {what} blocks for {} nodes: one each and no values", self.nodes.len());
                return Err(FormatError::Limit(what));
            }
        }
        self.check_values()?;
        if let Some(index) = self.contours.iter().position(|c| c.0 << 14 == 0) {
            return Err(FormatError::Limit(format!("contour {index} has no normal")));
        }
        let (mut voxels, mut contours, mut detached) = (0, 0, 0);
        // End of each open subtree and the children still to come in it.
        let mut open = vec![(self.nodes.len(), 1u32)];
        for (index, node) in self.nodes.iter().enumerate() {
            while open.last() == Some(&(index, 0)) {
                open.pop();
            }
            let fits = open.last_mut().is_some_and(|(end, children)| {
                let fits = *children > 0 && index + node.subtree as usize <= *end;
                *children = children.saturating_sub(1);
                fits
            });
            let masks = node.valid != 0
                && (node.leaf | node.contours) & !node.valid == 0
                && (!node.detached || node.subtree == 1 && node.nonleaf() != 0);
            detached += usize::from(node.detached);
            if !fits || !masks || node.first_voxel != voxels || node.first_contour as usize != contours {
                return Err(FormatError::Limit(format!("node {index} of the tree is not well-formed: {node:?}")));
            }
            voxels += node.valid.count_ones();
            contours += node.contours.count_ones() as usize;
            let children = if node.detached { 0 } else { node.nonleaf().count_ones() };
            open.push((index + node.subtree as usize, children));
        }
        while open.last() == Some(&(self.nodes.len(), 0)) {
            open.pop();
        }
        if !open.is_empty()
            || voxels != self.voxels
            || contours != self.contours.len()
            || detached != self.outside.len()
        {
            return Err(FormatError::Limit("the tree ends before all its nodes are closed".into()));
        }
        Ok(())
    }
}

impl Tree {
    /// Whether what is stored as it is fits the nodes.
    fn check_values(&self) -> Result<(), FormatError> {
        let refuse = |what: String| Err(FormatError::Limit(what));
        let blocks = !(self.color_blocks.is_empty() && self.normal_blocks.is_empty());
        let voxels = !(self.colors.is_empty() && self.normals.is_empty());
        let of_plain = !(self.alphas.is_empty() && self.own.is_empty());
        if self.plain && blocks || of_plain && !self.plain {
            return refuse("alphas and masks of plain values take a plain tree, and that has no blocks".into());
        }
        if !self.alphas.is_empty() && self.alphas.len() != self.colors.len() {
            return refuse(format!("{} alphas for {} colours", self.alphas.len(), self.colors.len()));
        }
        for (what, count) in [("masks of plain values", self.own.len()), ("corner masks", self.corners.len())] {
            if count != 0 && count != self.nodes.len() {
                return refuse(format!("{count} {what} for {} nodes: one each, or none", self.nodes.len()));
            }
        }
        if !self.corners.is_empty() && (blocks || voxels) {
            return refuse("a tree with corners has no other colours and normals".into());
        }
        for (index, (own, node)) in self.own.iter().zip(&self.nodes).enumerate() {
            let range = node.first_voxel as usize..;
            let others = || range.clone().zip(slots(node.valid)).filter(|(_, slot)| own >> slot & 1 == 0);
            let value = |voxel: usize| (self.colors.get(voxel), self.alphas.get(voxel), self.normals.get(voxel));
            let mut values = others().map(|(voxel, _)| value(voxel));
            let first = values.next();
            if own & !node.valid != 0 || values.any(|value| Some(value) != first) {
                return refuse(format!("voxels of node {index} without values of their own differ: mask {own:08b}"));
            }
        }
        let mut next = 0;
        for (index, corners) in self.corners.iter().enumerate() {
            if corners.mask >= OWN_CUBE << 1 || corners.first as usize != next {
                return refuse(format!("corners of node {index} do not fit: {corners:?}"));
            }
            next += corners.count();
        }
        if next != self.corner_values.len() {
            return refuse(format!("{} corner values for masks of {next}", self.corner_values.len()));
        }
        Ok(())
    }
}
