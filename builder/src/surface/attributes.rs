//! Colour and normal of a voxel: the mean over the surface in it, weighted by area, on every level. For a leaf the mean is
//! taken over the surface itself, for other voxels over their children ([`Mean::of_parts`]).
//!
//! # What represents the surface
//! The [`span`] of a voxel holds the least and greatest value of each channel and component over the surface in it, as
//! [`TextureTest`](crate::TextureTest) says. A voxel is refined if what its block of sixteen decodes to differs from this by
//! more than the settings allow (`build/pair.rs`).
//!
//! # Thin sheets
//! The two sides of a sheet thinner than a voxel have opposite normals, and their mean is meaningless. There all normals
//! are first turned to one side: the side with more surface or, if both have about as much, the side whose largest
//! component is positive, so that neighbouring voxels agree. If the sheet is thinner than the finest voxels, no refinement
//! can separate its sides, and the test uses the turned normals.

use esvo_format::RawNormal;
use glam::{DVec3, Vec3A};

use super::Sample;
use super::properties::{self, Extra};
use super::span::Span;
use super::srgb::encode_srgb;
use super::voxel::VoxelSurface;
use crate::clip::Piece;

/// Attributes of one voxel.
pub(crate) struct Attributes {
    /// sRGB-encoded colour.
    pub color: [u8; 3],
    /// Shading normal.
    pub normal: RawNormal,
    /// The mean that they are encoded from.
    pub mean: Mean,
}

/// Colour and normal of some surface, as sums weighted by area.
#[derive(Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
#[serde(from = "([f32; 7], Extra)", into = "([f32; 7], Extra)")]
pub(crate) struct Mean {
    /// The area, in any unit that is the same for all parts of a mean.
    pub weight: f32,
    /// Linear RGB times the area.
    pub color: Vec3A,
    /// Unit normals times the area. For thin sheets, turned to one side.
    pub normal: Vec3A,
    /// What components come from, if there are any.
    pub extra: Extra,
}

impl From<([f32; 7], Extra)> for Mean {
    fn from(([weight, r, g, b, x, y, z], extra): ([f32; 7], Extra)) -> Self {
        Self { weight, color: Vec3A::new(r, g, b), normal: Vec3A::new(x, y, z), extra }
    }
}

impl From<Mean> for ([f32; 7], Extra) {
    fn from(mean: Mean) -> Self {
        let ([r, g, b], [x, y, z]) = (mean.color.to_array(), mean.normal.to_array());
        ([mean.weight, r, g, b, x, y, z], mean.extra)
    }
}

impl Mean {
    /// The mean over surface with the same colour and normal everywhere.
    pub(crate) fn new(weight: f32, sample: &Sample) -> Self {
        Self { weight, color: sample.color * weight, normal: sample.normal * weight, extra: Extra::default() }
    }

    fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        self.color += other.color;
        self.normal += other.normal;
    }

    /// Whether the sum of the normals is so short that opposite sides cancel out.
    fn cancels(&self) -> bool {
        self.normal.length_squared() < (CANCELLED * self.weight).powi(2)
    }

    /// The mean over several parts together.
    pub(crate) fn of_parts<'a>(parts: impl Iterator<Item = &'a Self> + Clone) -> Self {
        let mut sum = Self::default();
        parts.clone().for_each(|part| sum.add(part));
        if parts.clone().any(|part| part.extra != Extra::default()) {
            sum.extra = Extra::of_parts(parts.clone().map(|part| (part.weight, part.extra)));
        }
        if !sum.cancels() {
            return sum;
        }
        let largest = parts.clone().max_by(|a, b| a.weight.total_cmp(&b.weight));
        let mut sides = Sides::new(largest.map_or(Vec3A::Z, |part| part.normal));
        parts.for_each(|part| sides.add(part.weight, part.normal));
        Self { normal: sides.normal(sum.weight), ..sum }
    }

    /// sRGB-encoded colour and shading normal.
    pub(crate) fn encode(&self) -> ([u8; 3], RawNormal) {
        (encode_srgb((self.color / self.weight).into()), RawNormal::encode(self.normal.into()))
    }
}

/// Normals turned to one side of a thin sheet.
struct Sides {
    axis: Vec3A,
    /// Sum of the normals, each turned to the side of the axis.
    turned: Vec3A,
    /// How much more weight the side of the axis has than the other.
    excess: f32,
}

impl Sides {
    fn new(axis: Vec3A) -> Self {
        Self { axis, turned: Vec3A::ZERO, excess: 0.0 }
    }

    /// 1 for a normal on the side of the axis, -1 on the other.
    fn of(&self, normal: Vec3A) -> f32 {
        1.0f32.copysign(self.axis.dot(normal))
    }

    /// Adds a normal times its weight.
    fn add(&mut self, weight: f32, weighted: Vec3A) {
        let side = self.of(weighted);
        self.excess += side * weight;
        self.turned += weighted * side;
    }

    /// The sum of the turned normals, or the axis if that is zero.
    fn mean(&self) -> Vec3A {
        if self.turned.length_squared() > 0.0 { self.turned } else { self.axis }
    }

    /// Whether the side opposite to the axis is the one to show. `weight` is the total weight.
    fn is_backwards(&self, weight: f32) -> bool {
        if self.excess.abs() >= SIDES_EQUAL * weight {
            return self.excess < 0.0;
        }
        let mean = self.mean();
        let largest = mean.abs().max_element();
        mean.to_array().into_iter().find(|c| c.abs() == largest).is_some_and(|c| c < 0.0)
    }

    /// The sum of the normals, turned to the side to show. `weight` is the total weight.
    fn normal(&self, weight: f32) -> Vec3A {
        if self.is_backwards(weight) { -self.mean() } else { self.mean() }
    }
}

/// A mean of unit normals shorter than this comes from sides that cancel out. For comparison: two walls at a right angle
/// give 0.71, three walls at a corner 0.58.
const CANCELLED: f32 = 0.5;
/// Sides whose areas differ by less than this share of the whole count as equal.
const SIDES_EQUAL: f32 = 0.25;

/// Attributes of a voxel from the surface in it.
#[inline(always)]
pub(crate) fn attributes(voxel: &VoxelSurface) -> Attributes {
    let surface = voxel.surface;
    if let Some((color, normal)) = surface.constant(voxel.pieces) {
        let area = voxel.pieces.iter().map(|piece| surface.area(piece.triangle, vertices(voxel, piece))).sum::<f32>();
        let sample = surface.sample_at(voxel.pieces[0].triangle, voxel.centre, voxel.size);
        let mut mean = Mean::new(at_least(area, voxel.size), &sample);
        if !surface.columns.is_empty() {
            mean.extra = properties::extra(voxel);
        }
        return Attributes { color, normal, mean };
    }
    let mut mean = Mean::default();
    each_sample(voxel, |weight, sample, _| mean.add(&Mean::new(weight, sample)));
    if mean.cancels() {
        mean.normal = Sheet::of(voxel).sides.normal(mean.weight);
    }
    if !surface.columns.is_empty() {
        mean.extra = properties::extra(voxel);
    }
    let (color, normal) = mean.encode();
    Attributes { color, normal, mean }
}

/// The range of colours and normals over all the surface in a voxel; `None` if they spread further than what one colour and
/// one normal within these bounds can represent, or if the surface has holes.
#[inline]
pub(crate) fn span(voxel: &VoxelSurface, color_error: f32, normal_error: f32) -> Option<Span> {
    let surface = voxel.surface;
    let mut span = Span::EMPTY;
    let (mut front, mut two_sided) = (None, false);
    for piece in voxel.pieces {
        span.extend(&surface.span(piece.triangle, vertices(voxel, piece), voxel.size));
        if !span.color_fits(color_error) {
            return None;
        }
        let normal = Vec3A::from(surface.normals[piece.triangle as usize]);
        two_sided |= front.get_or_insert(normal).dot(normal) < 0.0;
    }
    if voxel.has_holes() {
        return None;
    }
    if span.normal_fits(normal_error) {
        return Some(span);
    }
    if !two_sided {
        return None;
    }
    // A thin sheet: if finer voxels could not separate its sides, its normals count turned to one side.
    let mut mean = Mean::default();
    each_sample(voxel, |weight, sample, _| mean.add(&Mean::new(weight, sample)));
    let sheet = Some(Sheet::of(voxel)).filter(|sheet| mean.cancels() && sheet.thickness <= surface.finest_voxel())?;
    let front = if sheet.sides.is_backwards(mean.weight) { -1.0 } else { 1.0 };
    span.normal = Span::EMPTY.normal;
    for piece in voxel.pieces {
        let of_piece = surface.span(piece.triangle, vertices(voxel, piece), voxel.size);
        let side = sheet.sides.of(surface.normals[piece.triangle as usize].into());
        span.extend_normal(of_piece.normal_times(front * side));
    }
    Some(span).filter(|span| span.normal_fits(normal_error))
}

fn vertices<'a>(voxel: &'a VoxelSurface, piece: &Piece) -> &'a [DVec3] {
    voxel.arena.vertices(piece, &voxel.surface.corners)
}

/// The weight of an area. Above zero, because a voxel that the surface only touches needs attributes, too.
pub(crate) fn at_least(area: f32, voxel_size: f64) -> f32 {
    area.max(1e-8 * (voxel_size * voxel_size) as f32)
}

/// Calls `visit` with the weight, the sample and the vertices of each piece.
fn each_sample(voxel: &VoxelSurface, mut visit: impl FnMut(f32, &Sample, &[DVec3])) {
    for piece in voxel.pieces {
        let vertices = vertices(voxel, piece);
        let (area, sample) = voxel.surface.sample(piece.triangle, vertices, voxel.size);
        visit(at_least(area, voxel.size), &sample, vertices);
    }
}

/// The surface in a voxel whose normals cancel out.
struct Sheet {
    sides: Sides,
    /// Its extent along the axis of the sides, in octree units.
    thickness: f64,
}

impl Sheet {
    fn of(voxel: &VoxelSurface) -> Self {
        let mut largest = (0.0, Vec3A::Z);
        each_sample(voxel, |weight, sample, _| {
            if weight > largest.0 {
                largest = (weight, sample.normal);
            }
        });
        let mut sides = Sides::new(largest.1);
        let (mut lo, mut hi) = (f64::MAX, f64::MIN);
        each_sample(voxel, |weight, sample, vertices| {
            sides.add(weight, sample.normal * weight);
            for v in vertices {
                let at = v.dot(sides.axis.as_dvec3());
                (lo, hi) = (lo.min(at), hi.max(at));
            }
        });
        Self { sides, thickness: hi - lo }
    }
}
