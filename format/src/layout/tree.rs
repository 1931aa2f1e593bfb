//! An octree in depth-first order, without addresses: made by a builder, laid out by [`assemble`](crate::assemble).

use crate::values::plain::{OWN_CUBE, slots};
use crate::{AmbientBlock, ColorBlock, Column, Contour, CornerValue, FormatError, NodeCorners, NormalBlock, RawNormal};

/// One non-leaf voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct TreeNode {
    /// Mask of the child slots that hold a voxel; never zero.
    pub valid: u8,
    /// Mask of the leaves; a subset of `valid`.
    pub leaf: u8,
    /// Mask of the voxels with a contour; a subset of `valid`.
    pub contours: u8,
    /// Whether the subtrees of its children are not in this tree, but in a block that was packed before
    /// ([`detach`](Tree::detach)).
    pub detached: bool,
    /// Number of nodes in this subtree, including this one.
    pub subtree: u32,
    /// Index of the attributes of the first valid child. The others follow in slot order.
    pub first_voxel: u32,
    /// Index of the contour of the first child that has one. The others follow in slot order.
    pub first_contour: u32,
}

impl TreeNode {
    /// Mask of the children that are nodes. They follow this node in slot order, each with its subtree.
    pub fn nonleaf(&self) -> u8 {
        self.valid & !self.leaf
    }
}

/// An octree or a subtree of one, nodes in depth-first order.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Tree {
    /// The nodes; the root is first.
    pub nodes: Vec<TreeNode>,
    /// Contour values in the order of the nodes.
    pub contours: Vec<Contour>,
    /// sRGB-encoded colour of every voxel except the root, in the order of the nodes; or empty.
    pub colors: Vec<[u8; 3]>,
    /// Normal of every voxel except the root, in the order of the nodes; or empty.
    pub normals: Vec<RawNormal>,
    /// Encoded colours instead of [`colors`](Self::colors): one block for every node, in the order of the nodes; or
    /// empty. Siblings form pairs in slot order, and a pair shares the block of its first node: texel `i` is child `i`
    /// of the first node, texel `8 + i` child `i` of the second. The block of the second node is ignored.
    pub color_blocks: Vec<ColorBlock>,
    /// Encoded normals instead of [`normals`](Self::normals), as [`color_blocks`](Self::color_blocks); or empty.
    pub normal_blocks: Vec<NormalBlock>,
    /// Ambient light of every voxel except the root, in the order of the nodes: the fraction that reaches the voxel, in
    /// units of 1/255; or empty.
    pub ambient: Vec<u8>,
    /// Encoded ambient light instead of [`ambient`](Self::ambient), as [`color_blocks`](Self::color_blocks); or empty.
    pub ambient_blocks: Vec<AmbientBlock>,
    /// Whether colours and normals are stored as plain values of 4 bytes instead of in blocks of 16. More exact, and 4
    /// to 8 times as large.
    pub plain: bool,
    /// Alpha of every colour of a [`plain`](Self::plain) tree, in the same order; empty if all are opaque.
    pub alphas: Vec<u8>,
    /// For every node of a [`plain`](Self::plain) tree, the mask of the voxels whose colour and normal are stored
    /// separately. All other voxels of the node must be equal and share one. If empty, the voxels of each node with its
    /// most frequent value share it.
    pub own: Vec<u8>,
    /// Corners with colours and normals, for every node, instead of colours and normals of voxels; or empty.
    pub corners: Vec<NodeCorners>,
    /// The values that [`corners`](Self::corners) refer to, in the order of the nodes.
    pub corner_values: Vec<CornerValue>,
    /// Components of every voxel except the root, such as emission or opacity: at most one column for each type. A block gets an
    /// attachment only if some of its voxels does not have the default.
    pub columns: Vec<Column>,
    /// Number of the block with the children, for every detached node, in the order of the nodes.
    pub(crate) outside: Vec<u32>,
    voxels: u32,
}

/// The properties of a voxel that are known when its parent is pushed.
#[derive(Clone, Copy, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Voxel {
    /// sRGB-encoded colour.
    pub color: Option<[u8; 3]>,
    /// Shading normal.
    pub normal: Option<RawNormal>,
    /// Contour.
    pub contour: Option<Contour>,
    /// Whether it has no descriptor.
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
            self.columns.iter_mut().for_each(Column::push_default);
            self.voxels += 1;
        }
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// Replaces attributes of voxel `slot` of the node at `index`. It must have been opened with attributes of these
    /// kinds.
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

    /// Sets components of voxel `slot` of the node at `index`, which has the default otherwise: `words` are those of column `column`
    /// ([`Column::set`]).
    ///
    /// # Panics
    /// If there is no such voxel or column.
    pub fn set_components(&mut self, index: usize, slot: usize, column: usize, words: &[u32]) {
        let node = &self.nodes[index];
        assert!(node.valid >> slot & 1 != 0, "no voxel in slot {slot}");
        let voxel = node.first_voxel as usize + (node.valid & ((1 << slot) - 1)).count_ones() as usize;
        self.columns[column].set(voxel, words);
    }

    /// Removes voxel `slot`, for which no node has been pushed, from the node at `index`. Time is linear in the part of
    /// the tree after the node. A node whose last voxel is removed must be [cancelled](Self::cancel).
    ///
    /// # Panics
    /// If there is no such voxel, or attributes are in encoded blocks.
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
        self.columns.iter_mut().for_each(|column| column.remove(voxel));
    }

    /// Removes the node that was opened last. All its voxels must have been removed.
    ///
    /// # Panics
    /// If it has voxels, or is not the last node.
    pub fn cancel(&mut self, index: usize) {
        assert!(
            index + 1 == self.nodes.len() && self.nodes[index].valid == 0,
            "only an empty last node can be cancelled"
        );
        self.nodes.pop();
    }

    /// Ends the subtree of the node at `index`: all nodes pushed since belong to it.
    pub fn close(&mut self, index: usize) {
        self.nodes[index].subtree = (self.nodes.len() - index) as u32;
    }

    /// Appends a subtree as the next child of the node that is open. It must have the same columns.
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
        for (column, other) in self.columns.iter_mut().zip(&subtree.columns) {
            column.values.extend_from_slice(&other.values);
        }
        self.outside.extend_from_slice(&subtree.outside);
        self.voxels += subtree.voxels;
    }

    /// Moves the descendants of node `index` to a new tree, whose root is a copy of the node. The node stays in this
    /// tree, with its attributes and contours. Its subtree must be closed and the last of the tree.
    ///
    /// Next, [`pack`](crate::pack()) the result into a block, and pass the number of that block to
    /// [`attach`](Self::attach).
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
        let mut detached = Tree {
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
            columns: Vec::new(),
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
        let split = |column: &mut Column| column.split(voxel as usize, own_voxels as usize);
        detached.columns = self.columns.iter_mut().map(split).collect();
        self.voxels = own_voxels;
        detached
    }

    /// Sets the block with the children of the node that was detached last.
    pub fn attach(&mut self, block: u32) {
        self.outside.push(block);
    }

    /// Adds a number to those of all blocks that were [attached](Self::attach): their store has become part of a larger one
    /// ([`BlockStore::in_files`](crate::BlockStore::in_files)).
    ///
    /// # Errors
    /// A number would be 2^32 or more.
    pub fn move_blocks(&mut self, by: u32) -> Result<(), FormatError> {
        for block in &mut self.outside {
            let moved = block.checked_add(by);
            *block = moved.ok_or_else(|| FormatError::Limit("the store has more than 2^32 - 1 blocks".into()))?;
        }
        Ok(())
    }

    /// Number of voxels, not counting the root.
    pub fn voxels(&self) -> u64 {
        u64::from(self.voxels)
    }

    /// The non-leaf children of node `index` in slot order: (slot, node index). Empty if they are detached.
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
        // Ends of the open subtrees; their number is the depth of the node.
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

    /// Checks that the tree is well-formed, as [`open`](Self::open) and [`close`](Self::close) make it: every node is
    /// followed by its children, and the numbers of attributes fit.
    ///
    /// # Errors
    /// A description of the first fault.
    pub(crate) fn check(&self) -> Result<(), FormatError> {
        if self.nodes.is_empty() {
            return Err(FormatError::Limit("an octree needs at least one voxel".into()));
        }
        for (what, count) in
            [("colours", self.colors.len()), ("normals", self.normals.len()), ("ambient values", self.ambient.len())]
        {
            if count != 0 && count != self.voxels as usize {
                let what = format!(
                    "the tree has {count} {what} and {} voxels, expected one for every voxel or none",
                    self.voxels
                );
                return Err(FormatError::Limit(what));
            }
        }
        for (what, values, blocks) in [
            ("colour", self.colors.len(), self.color_blocks.len()),
            ("normal", self.normals.len(), self.normal_blocks.len()),
            ("ambient", self.ambient.len(), self.ambient_blocks.len()),
        ] {
            if blocks != 0 && (blocks != self.nodes.len() || values != 0) {
                let what = format!(
                    "the tree has {blocks} {what} blocks and {values} {what} values for {} nodes, \
                     expected one block for every node and no values",
                    self.nodes.len()
                );
                return Err(FormatError::Limit(what));
            }
        }
        self.check_values()?;
        for (index, column) in self.columns.iter().enumerate() {
            column.check(self.voxels as usize)?;
            if self.columns[..index].iter().any(|other| other.kind == column.kind) {
                return Err(FormatError::Limit(format!("the tree has two columns of type {}", column.kind)));
            }
        }
        if let Some(index) = self.contours.iter().position(|c| c.0 << 14 == 0) {
            return Err(FormatError::Limit(format!("the normal of contour {index} is zero")));
        }
        let (mut voxels, mut contours, mut detached) = (0, 0, 0);
        // For each open subtree: its end, and the number of children still missing.
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
                let TreeNode { valid, leaf, contours: mask, subtree, first_voxel, first_contour, .. } = *node;
                return Err(FormatError::Limit(format!(
                    "node {index} of the tree is not well-formed: valid mask {valid:08b}, leaf mask {leaf:08b}, contour \
                     mask {mask:08b}, {subtree} nodes, first voxel {first_voxel} (expected {voxels}), first contour \
                     {first_contour} (expected {contours})"
                )));
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
    /// Checks that plain values and values at corners fit the nodes.
    fn check_values(&self) -> Result<(), FormatError> {
        let refuse = |what: String| Err(FormatError::Limit(what));
        let blocks = !(self.color_blocks.is_empty() && self.normal_blocks.is_empty());
        let voxels = !(self.colors.is_empty() && self.normals.is_empty());
        let of_plain = !(self.alphas.is_empty() && self.own.is_empty());
        if self.plain && blocks || of_plain && !self.plain {
            return refuse("alphas and masks of plain values need a plain tree, which has no encoded blocks".into());
        }
        if !self.alphas.is_empty() && self.alphas.len() != self.colors.len() {
            return refuse(format!(
                "the tree has {} alphas and {} colours, expected one for every colour",
                self.alphas.len(),
                self.colors.len()
            ));
        }
        for (what, count) in [("masks of plain values", self.own.len()), ("corner masks", self.corners.len())] {
            if count != 0 && count != self.nodes.len() {
                return refuse(format!(
                    "the tree has {count} {what} and {} nodes, expected one for every node or none",
                    self.nodes.len()
                ));
            }
        }
        if !self.corners.is_empty() && (blocks || voxels) {
            return refuse("a tree with values at corners must not have other colours and normals".into());
        }
        for (index, (own, node)) in self.own.iter().zip(&self.nodes).enumerate() {
            let range = node.first_voxel as usize..;
            let others = || range.clone().zip(slots(node.valid)).filter(|(_, slot)| own >> slot & 1 == 0);
            let value = |voxel: usize| (self.colors.get(voxel), self.alphas.get(voxel), self.normals.get(voxel));
            let mut values = others().map(|(voxel, _)| value(voxel));
            let first = values.next();
            if own & !node.valid != 0 || values.any(|value| Some(value) != first) {
                return refuse(format!(
                    "the voxels of node {index} that share a value (outside mask {own:08b}) differ"
                ));
            }
        }
        let mut next = 0;
        for (index, corners) in self.corners.iter().enumerate() {
            if corners.mask >= OWN_CUBE << 1 || corners.first as usize != next {
                return refuse(format!(
                    "the corners of node {index} have mask {:#x} and first value {}, \
                     expected a mask of 28 bits and first value {next}",
                    corners.mask, corners.first
                ));
            }
            next += corners.count();
        }
        if next != self.corner_values.len() {
            return refuse(format!("the tree has {} corner values, its masks need {next}", self.corner_values.len()));
        }
        Ok(())
    }
}
