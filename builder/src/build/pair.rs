//! The children of one or two sibling cubes, whose colours and normals share a block of sixteen: what the children are, and
//! which of them are leaves.
//!
//! A reader sees what a block decodes to, which differs from each voxel's own colour and normal by the error of the block. So
//! the test for refinement is made on the decoded block: a voxel whose shape fits is a leaf only if what it decodes to is
//! within the bounds of the settings for all the surface in it ([`Span`]). For that, every voxel of the block needs its
//! attributes at this time, from the surface in it.
//!
//! If the block has such a leaf, its voxels keep these attributes, so that it is stored as it was tested. In other blocks the
//! attributes of voxels that are split are the means of their children, which take less time and are as good. Two exceptions
//! are rare: a voxel of the block that turns out to be all hole is removed later, and the roots of subtrees that are displaced
//! one by one are tested apart from each other.

use esvo_format::{ColorBlock, NormalBlock, RawNormal, Voxel as TreeVoxel};

use super::recursion::Cube;
use crate::BuildSettings;
use crate::clip::{Arena, Piece};
use crate::shape::plane::Through;
use crate::shape::shaper::Shaper;
use crate::shape::slab::Slabs;
use crate::shape::voxel::Shape;
use crate::surface::Surface;
use crate::surface::attributes::{Attributes, Mean, attributes, span};
use crate::surface::span::Span;
use crate::surface::voxel::VoxelSurface;

/// What one child slot contains.
#[derive(Clone)]
pub(super) struct Child {
    /// `None` if there is no surface in the slot.
    pub voxel: Option<TreeVoxel>,
    /// What bounds the child's shape; only used if it is not a leaf.
    pub bounds: Bounds,
    /// The mean that its attributes are encoded from, if it has them.
    pub mean: Mean,
    span: Span,
}

impl Default for Child {
    fn default() -> Self {
        Self { voxel: None, bounds: Bounds::default(), mean: Mean::default(), span: Span::EMPTY }
    }
}

/// What is known about the shape of a voxel from the voxel and its ancestors.
#[derive(Clone, Default)]
pub(super) struct Bounds {
    /// The shape is within the error bound, and so in every part of the voxel: only attributes can require finer voxels.
    pub fits: bool,
    /// If not `fits`: the slabs that bound the shape.
    pub slabs: Slabs,
}

/// The children of up to two cubes: of the first, then of the second.
#[derive(Default)]
pub(super) struct Pair {
    pub children: [[Child; 8]; 2],
    /// Whether the block is stored as it was tested.
    pub keeps_attributes: bool,
}

/// Where the surface in a cube comes from.
#[derive(Clone, Copy)]
pub(super) enum Found<'a> {
    /// The pieces in each child: from `ends[slot]` to `ends[slot + 1]`.
    Pieces { arena: &'a Arena, pieces: &'a [Piece], ends: [usize; 9] },
    /// One triangle that cuts through the cube.
    Through(&'a Through),
}

/// A cube that is split, and what is known of it.
pub(super) struct Parent<'a> {
    pub cube: Cube,
    pub found: Found<'a>,
    pub bounds: &'a Bounds,
}

/// Decides about voxels.
pub(super) struct Decider<'a> {
    pub surface: &'a Surface<'a>,
    pub settings: &'a BuildSettings,
    /// Largest distance of a voxel's shape from the surface, in octree units.
    pub deviation: f64,
}

impl Decider<'_> {
    /// Fills in the children of one or two sibling cubes.
    pub(super) fn decide(&self, shaper: &mut Shaper, pair: &mut Pair, parents: &[Option<Parent>; 2]) {
        let mut candidates = 0u32;
        for (k, parent) in parents.iter().enumerate() {
            for slot in 0..8 {
                let child = &mut pair.children[k][slot];
                child.voxel = None;
                let Some(parent) = parent else { continue };
                self.shape(shaper, parent, slot, child);
                let candidate = child.voxel.is_some_and(|v| !v.leaf) && child.bounds.fits;
                candidates |= u32::from(candidate) << (8 * k + slot);
            }
        }
        retain(&mut candidates, |i| {
            let span = parents[i / 8].as_ref().and_then(|parent| self.span(parent, i % 8));
            let children = pair.children.as_flattened_mut();
            children[i].span = span.unwrap_or(Span::EMPTY);
            span.is_some()
        });
        for (k, parent) in parents.iter().enumerate() {
            let Some(parent) = parent else { continue };
            for slot in 0..8 {
                let child = &mut pair.children[k][slot];
                let Some(voxel) = &mut child.voxel else { continue };
                if (voxel.leaf || candidates != 0) && self.surface.stores(self.settings) {
                    let found = self.attributes(parent, slot);
                    child.mean = found.mean;
                    (voxel.color, voxel.normal) = self.settings.wanted(found.color, found.normal);
                }
            }
        }
        pair.keeps_attributes = candidates != 0 && self.test(pair, candidates);
    }

    /// Decides the shape of child `slot`, and makes it a leaf if it is on the deepest level.
    fn shape(&self, shaper: &mut Shaper, parent: &Parent, slot: usize, child: &mut Child) {
        let cube = parent.cube.child(slot);
        let deepest = cube.level == self.settings.levels;
        let ancestors = parent.bounds;
        let shaped = !ancestors.fits && self.settings.contours;
        let mut shape = Shape { contour: None, fits: ancestors.fits };
        let slabs = &mut child.bounds.slabs;
        match &parent.found {
            Found::Pieces { arena, pieces, ends } => {
                let pieces = &pieces[ends[slot]..ends[slot + 1]];
                if pieces.is_empty() {
                    return;
                }
                if shaped {
                    let voxel = self.voxel(arena, pieces, &cube);
                    slabs.inherit(&ancestors.slabs, slot);
                    shape = shaper.shape(&voxel, slabs, self.deviation, deepest);
                }
            }
            Found::Through(through) => {
                let height = through.height(cube.centre);
                if !through.meets(height, cube.size) {
                    return;
                }
                if shaped {
                    slabs.inherit(&ancestors.slabs, slot);
                    shape = through.shape(height, cube.size, slabs, self.deviation, deepest);
                }
            }
        }
        child.bounds.fits = shape.fits;
        let (color, normal) = self.settings.wanted([0; 3], RawNormal::default());
        child.voxel = Some(TreeVoxel { color, normal, contour: shape.contour, leaf: deepest });
    }

    fn voxel<'a>(&'a self, arena: &'a Arena, pieces: &'a [Piece], cube: &Cube) -> VoxelSurface<'a> {
        VoxelSurface { surface: self.surface, arena, pieces, centre: cube.centre, size: cube.size }
    }

    #[inline(always)]
    pub(super) fn attributes(&self, parent: &Parent, slot: usize) -> Attributes {
        let cube = parent.cube.child(slot);
        match &parent.found {
            Found::Pieces { arena, pieces, ends } => {
                attributes(&self.voxel(arena, &pieces[ends[slot]..ends[slot + 1]], &cube))
            }
            Found::Through(through) => {
                through.attributes(self.surface, cube.centre, through.height(cube.centre), cube.size)
            }
        }
    }

    /// The range of colours and normals in child `slot`; `None` if no colour and no normal can represent all of its surface.
    fn span(&self, parent: &Parent, slot: usize) -> Option<Span> {
        let cube = parent.cube.child(slot);
        let (color, normal) = self.bounds();
        match &parent.found {
            Found::Pieces { arena, pieces, ends } => {
                let voxel = self.voxel(arena, &pieces[ends[slot]..ends[slot + 1]], &cube);
                if self.settings.stores_attributes() {
                    span(&voxel, color, normal)
                } else {
                    (!voxel.has_holes()).then_some(Span::EMPTY)
                }
            }
            Found::Through(_) if !self.settings.stores_attributes() => Some(Span::EMPTY),
            Found::Through(through) => {
                let span = through.span(self.surface, cube.centre, through.height(cube.centre), cube.size);
                Some(span).filter(|span| span.color_fits(color) && span.normal_fits(normal))
            }
        }
        .filter(|_| !self.surface.emission_varies || self.emission_fits(parent, slot, color))
    }

    /// Whether one emission can stand for all surface in child `slot`.
    fn emission_fits(&self, parent: &Parent, slot: usize, bound: f32) -> bool {
        let cube = parent.cube.child(slot);
        match &parent.found {
            Found::Pieces { arena, pieces, ends } => {
                let pieces = pieces[ends[slot]..ends[slot + 1]].iter();
                let pieces = pieces.map(|piece| (piece.triangle, arena.vertices(piece, &self.surface.corners)));
                self.surface.emission_fits(pieces, cube.size, bound)
            }
            Found::Through(through) => {
                through.emission_fits(self.surface, cube.centre, through.height(cube.centre), cube.size, bound)
            }
        }
    }

    /// The largest errors of a decoded colour and normal. What is not stored is not tested.
    fn bounds(&self) -> (f32, f32) {
        let settings = self.settings;
        let color = if settings.colors { settings.color_error } else { 256.0 };
        let normal = if settings.normals { settings.normal_error } else { 2.0 };
        (color as f32, normal as f32)
    }

    /// Makes those of the candidates leaves that the decoded block represents well enough. Returns whether there is one.
    ///
    /// Where all the surface in a block looks the same, finer voxels would decode to the same: they are not asked for, however
    /// small the bounds.
    fn test(&self, pair: &mut Pair, candidates: u32) -> bool {
        let settings = self.settings;
        let (color_error, normal_error) = self.bounds();
        let children = pair.children.as_flattened_mut();
        let mut left = candidates;
        if color_error < 256.0 {
            let colors: [_; 16] = std::array::from_fn(|i| children[i].voxel.and_then(|voxel| voxel.color));
            let same = |i: usize| children[i].span.color == [colors[i].unwrap_or_default(); 2];
            if !is_one(&colors) || !all(left, same) {
                let block = ColorBlock::encode(&colors);
                retain(&mut left, |i| {
                    let plain = || colors[i].unwrap_or_default().map(|c| f32::from(c) / 255.0);
                    let decoded = if settings.plain_attributes { plain() } else { block.decode(i) };
                    children[i].span.color_within(decoded, color_error)
                });
            }
        }
        if normal_error < 2.0 && left != 0 {
            let raw: [_; 16] = std::array::from_fn(|i| children[i].voxel.and_then(|voxel| voxel.normal));
            let same = |i: usize| children[i].span.normal[0] == children[i].span.normal[1];
            if !is_one(&raw) || !all(left, same) {
                let normals = raw.map(|normal| Some(normal?.decode()));
                let block = NormalBlock::encode(&normals);
                retain(&mut left, |i| {
                    let plain = || normals[i].unwrap_or_default();
                    let decoded = if settings.plain_attributes { plain() } else { block.decode(i) };
                    children[i].span.normal_within(decoded.into(), normal_error)
                });
            }
        }
        for (i, child) in children.iter_mut().enumerate() {
            if left >> i & 1 != 0
                && let Some(voxel) = &mut child.voxel
            {
                voxel.leaf = true;
            }
        }
        left != 0
    }
}

/// Whether the values that are present are all equal.
fn is_one<T: PartialEq + Copy>(values: &[Option<T>; 16]) -> bool {
    let mut present = values.iter().flatten();
    let first = present.next();
    present.all(|value| Some(value) == first)
}

/// Whether `holds` for all bits of a mask.
fn all(mask: u32, holds: impl Fn(usize) -> bool) -> bool {
    (0..16).all(|i| mask >> i & 1 == 0 || holds(i))
}

/// Clears the bits of a mask for which `keep` is false.
fn retain(mask: &mut u32, mut keep: impl FnMut(usize) -> bool) {
    let mut bits = *mask;
    while bits != 0 {
        let i = bits.trailing_zeros();
        bits &= bits - 1;
        if !keep(i as usize) {
            *mask &= !(1 << i);
        }
    }
}
