//! Colour and normal of a voxel: the mean over the surface in it, weighted by area, on every level. For a leaf the mean is
//! taken over the surface itself, for other voxels over their children ([`Mean::of_parts`]).
//!
//! # Which voxels are refined because of their attributes
//! A voxel's colour and normal represent all the surface in it. The voxel is refined if one of the samples of
//! [`TextureTest`](crate::TextureTest) differs from what the voxel's own colour and normal decode to (5:6:5 bits, a raw
//! normal) by more than the settings allow, in any channel or component. If all samples are equal it is not refined:
//! finer voxels would look the same.
//!
//! A reader sees what a block of up to sixteen voxels decodes to. This differs from a voxel's own colour and normal by the
//! error of the block, which the encoders keep small and which is not part of the test. So what is decoded from a leaf is
//! within the error of the settings plus that of its block. Only on the deepest level, where no refinement is possible, can
//! the error be larger.
//!
//! # Thin sheets
//! The two sides of a sheet thinner than a voxel have opposite normals, and their mean is meaningless. There all normals
//! are first turned to one side: the side with more surface or, if both have about as much, the side whose largest
//! component is positive, so that neighbouring voxels agree. If the sheet is thinner than the finest voxels, no refinement
//! can separate its sides, and the test uses the turned normals.

use esvo_format::{ColorBlock, RawNormal};
use glam::{DVec3, Vec3A};

use super::Sample;
use super::srgb::encode_srgb;
use super::voxel::VoxelSurface;
use crate::clip::Piece;

/// Largest difference of attributes from the samples that they represent.
#[derive(Clone, Copy)]
pub(crate) struct AttributeBounds {
    /// Steps of 1/256 per channel.
    pub color: f32,
    /// Per component of the unit normal.
    pub normal: f32,
}

/// Attributes of one voxel.
pub(crate) struct Attributes {
    /// sRGB-encoded colour.
    pub color: [u8; 3],
    /// Shading normal.
    pub normal: RawNormal,
    /// The mean that they are encoded from.
    pub mean: Mean,
    /// Whether all the surface in the voxel is within the bounds. False if no bounds were given.
    pub uniform: bool,
}

/// Colour and normal of some surface, as sums weighted by area.
#[derive(Clone, Copy, Default)]
pub(crate) struct Mean {
    /// The area, in any unit that is the same for all parts of a mean.
    pub weight: f32,
    /// Linear RGB times the area.
    pub color: Vec3A,
    /// Unit normals times the area. For thin sheets, turned to one side.
    pub normal: Vec3A,
}

impl Mean {
    /// The mean over surface with the same colour and normal everywhere.
    pub(crate) fn new(weight: f32, sample: &Sample) -> Self {
        Self { weight, color: sample.color * weight, normal: sample.normal * weight }
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

/// Sums and ranges over the pieces of surface in a voxel.
struct Sums {
    mean: Mean,
    color_range: [Vec3A; 2],
    normal_range: [Vec3A; 2],
}

impl Sums {
    const RANGE: [Vec3A; 2] = [Vec3A::MAX, Vec3A::MIN];

    fn add(&mut self, weight: f32, sample: &Sample) {
        self.mean.add(&Mean::new(weight, sample));
        self.color_range = [self.color_range[0].min(sample.color), self.color_range[1].max(sample.color)];
        self.normal_range = [self.normal_range[0].min(sample.normal), self.normal_range[1].max(sample.normal)];
    }
}

/// Attributes of a voxel from the surface in it. `bounds` is `None` if the caller does not need to know whether they are
/// uniform.
pub(crate) fn attributes(voxel: &VoxelSurface, bounds: Option<AttributeBounds>) -> Attributes {
    let surface = voxel.surface;
    if let Some((color, normal)) = surface.constant(voxel.pieces) {
        let area = voxel.pieces.iter().map(|piece| surface.area(piece.triangle, vertices(voxel, piece))).sum::<f32>();
        let sample = surface.sample_at(voxel.pieces[0].triangle, voxel.centre, voxel.size);
        let mean = Mean::new(at_least(area, voxel.size), &sample);
        return Attributes { color, normal, mean, uniform: bounds.is_some() };
    }
    if let [piece] = voxel.pieces {
        return attributes_of_one(voxel, piece, bounds);
    }
    let mut sums = Sums { mean: Mean::default(), color_range: Sums::RANGE, normal_range: Sums::RANGE };
    each_sample(voxel, |weight, sample, _| sums.add(weight, sample));
    if sums.mean.cancels() {
        turn_to_one_side(voxel, &mut sums);
    }
    let (color, normal) = sums.mean.encode();
    let uniform = bounds.is_some_and(|bounds| {
        !surface.is_cut_through(voxel.arena, voxel.pieces)
            && colors_within(color, &sums, bounds.color)
            && normals_within(normal, &sums, bounds.normal)
            && (!surface.tests_texels || texels_within(voxel, color, normal, bounds))
    });
    Attributes { color, normal, mean: sums.mean, uniform }
}

/// The attributes of a voxel with one piece of surface: they are those of its only sample.
fn attributes_of_one(voxel: &VoxelSurface, piece: &Piece, bounds: Option<AttributeBounds>) -> Attributes {
    let surface = voxel.surface;
    let vertices = vertices(voxel, piece);
    let middle = vertices.iter().sum::<DVec3>() * (1.0 / vertices.len() as f64);
    let sample = surface.sample_at(piece.triangle, middle, voxel.size);
    let mean = Mean::new(at_least(surface.area(piece.triangle, vertices), voxel.size), &sample);
    let (color, normal) = sample.encode();
    let uniform = bounds.is_some_and(|bounds| {
        !surface.is_cut_through(voxel.arena, voxel.pieces)
            && (!surface.tests_texels || texels_within(voxel, color, normal, bounds))
    });
    Attributes { color, normal, mean, uniform }
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

/// For a voxel whose normals cancel out: turns the sum of the normals to one side. Turns their range as well if finer
/// voxels could not separate the sides.
fn turn_to_one_side(voxel: &VoxelSurface, sums: &mut Sums) {
    let mut largest = (0.0, Vec3A::Z);
    each_sample(voxel, |weight, sample, _| {
        if weight > largest.0 {
            largest = (weight, sample.normal);
        }
    });
    let mut sides = Sides::new(largest.1);
    let [mut least, mut most] = Sums::RANGE;
    let (mut lo, mut hi) = (f64::MAX, f64::MIN);
    each_sample(voxel, |weight, sample, vertices| {
        sides.add(weight, sample.normal * weight);
        let turned = sample.normal * sides.of(sample.normal);
        (least, most) = (least.min(turned), most.max(turned));
        for v in vertices {
            let at = v.dot(sides.axis.as_dvec3());
            (lo, hi) = (lo.min(at), hi.max(at));
        }
    });
    sums.mean.normal = sides.normal(sums.mean.weight);
    if hi - lo <= voxel.surface.finest_voxel() {
        sums.normal_range = if sides.is_backwards(sums.mean.weight) { [-most, -least] } else { [least, most] };
    }
}

/// Whether all samples are within `bound` steps of what `color` decodes to.
fn colors_within(color: [u8; 3], sums: &Sums, bound: f32) -> bool {
    let [lo, hi] = sums.color_range;
    if bound >= 256.0 || lo == hi {
        return true;
    }
    let decoded = decode(color);
    let (lo, hi) = (encode_srgb(lo.into()), encode_srgb(hi.into()));
    (0..3).all(|k| beyond(decoded[k], lo[k], hi[k]) <= bound)
}

/// What an sRGB-encoded colour decodes to if it is alone in its block, in `0.0..=1.0`.
fn decode(color: [u8; 3]) -> [f32; 3] {
    let mut colors = [None; 16];
    colors[0] = Some(color);
    ColorBlock::encode(&colors).decode(0)
}

/// Distance in steps of 1/256 from `value` to the farther end of a range of bytes.
fn beyond(value: f32, lo: u8, hi: u8) -> f32 {
    let steps = |byte: u8| (f32::from(byte) / 255.0 - value).abs() * 256.0;
    steps(lo).max(steps(hi))
}

/// Whether all samples are within `bound` of what `normal` decodes to, in each component.
fn normals_within(normal: RawNormal, sums: &Sums, bound: f32) -> bool {
    let [lo, hi] = sums.normal_range;
    if bound >= 2.0 || lo == hi {
        return true;
    }
    let decoded = Vec3A::from(normal.decode());
    (decoded - lo).max(hi - decoded).max_element() <= bound
}

/// Whether all texels that the finest voxels show are within the bounds of what colour and normal decode to.
fn texels_within(voxel: &VoxelSurface, color: [u8; 3], normal: RawNormal, bounds: AttributeBounds) -> bool {
    let surface = voxel.surface;
    let (decoded, normal) = (decode(color), Vec3A::from(normal.decode()));
    voxel.pieces.iter().all(|piece| {
        let vertices = vertices(voxel, piece);
        let (lo, hi) = surface.color_range(piece.triangle, vertices);
        (bounds.color >= 256.0 || lo == hi || (0..3).all(|k| beyond(decoded[k], lo[k], hi[k]) <= bounds.color))
            && (bounds.normal >= 2.0 || surface.normal_deviation(piece.triangle, vertices, normal) <= bounds.normal)
    })
}
