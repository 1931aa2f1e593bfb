//! Colour and normal of a voxel: means over the surface in it, weighted by area, on every level.
//!
//! # Which voxels are refined for the sake of their attributes
//! A voxel's colour `c` and normal `n` stand for everything that is in it. Finer voxels are asked for where one of the
//! samples of [`TextureTest`](crate::TextureTest) is further from what the voxel's own colour and normal decode to (5:6:5
//! bits, a raw normal) than the settings allow, in any channel or component. Where all samples are the same nothing is
//! asked for: finer voxels would look no different.
//!
//! A reader sees what a block of up to sixteen voxels decodes to. That differs from a voxel's own colour and normal by the
//! error of the block, which the encoders keep small and which is not part of the test; so what is decoded from a leaf is
//! within the error of the settings plus that of its block, and only on the deepest level, where there is nothing left to
//! refine, beyond that.
//!
//! # Thin sheets
//! The two sides of a sheet that is thinner than a voxel have opposite normals, and their mean says nothing. There the
//! normals are turned to one side first: the one with more surface, or, where there is about as much of both, the one
//! whose largest component is positive, so that neighbours agree. If the sheet is thinner than the finest voxels, no
//! refinement can part its sides, and the test looks at the turned normals.

use esvo_format::{ColorBlock, RawNormal};
use glam::{DVec3, Vec3A};

use crate::clip::Piece;
use crate::range::encode_srgb;
use crate::shaper::Voxel;
use crate::surface::Sample;

/// How far attributes may be from what they stand for.
#[derive(Clone, Copy)]
pub struct AttributeBounds {
    /// Steps of 1/256 per channel.
    pub color: f32,
    /// Per component of the unit normal.
    pub normal: f32,
}

/// Attributes of one voxel.
pub struct Attributes {
    /// sRGB-encoded colour.
    pub color: [u8; 3],
    /// Shading normal.
    pub normal: RawNormal,
    /// Whether all the surface in the voxel is within the bounds of them.
    pub uniform: bool,
}

/// A mean normal shorter than this (of unit normals) is one of sides that cancel out: a right angle between two walls
/// gives 0.71, a corner of three 0.58.
const CANCELLED: f32 = 0.5;
/// Sides that differ by less than this part of the surface count as equal.
const SIDES_EQUAL: f32 = 0.25;

/// Sums over the pieces of surface in a voxel.
struct Sums {
    weight: f32,
    color: Vec3A,
    normal: Vec3A,
    color_range: [Vec3A; 2],
    normal_range: [Vec3A; 2],
}

impl Sums {
    const NONE: Self = Self {
        weight: 0.0,
        color: Vec3A::ZERO,
        normal: Vec3A::ZERO,
        color_range: [Vec3A::MAX, Vec3A::MIN],
        normal_range: [Vec3A::MAX, Vec3A::MIN],
    };

    fn add(&mut self, weight: f32, sample: &Sample) {
        self.weight += weight;
        self.color += sample.color * weight;
        self.normal += sample.normal * weight;
        self.color_range = [self.color_range[0].min(sample.color), self.color_range[1].max(sample.color)];
        self.normal_range = [self.normal_range[0].min(sample.normal), self.normal_range[1].max(sample.normal)];
    }
}

/// Attributes of a voxel; `bounds` is `None` where it does not matter whether they are uniform.
pub fn attributes(voxel: &Voxel, bounds: Option<AttributeBounds>) -> Attributes {
    let surface = voxel.surface;
    if let Some((color, normal)) = surface.constant(voxel.pieces) {
        return Attributes { color, normal, uniform: bounds.is_some() };
    }
    if let [piece] = voxel.pieces {
        return attributes_of_one(voxel, piece, bounds);
    }
    let mut sums = Sums::NONE;
    each_sample(voxel, |weight, sample, _| sums.add(weight, sample));
    if sums.normal.length_squared() < (CANCELLED * sums.weight).powi(2) {
        turn_to_one_side(voxel, &mut sums);
    }
    let color = encode_srgb((sums.color / sums.weight).into());
    let normal = RawNormal::encode(sums.normal.into());
    let uniform = bounds.is_some_and(|bounds| {
        !surface.is_cut_through(voxel.arena, voxel.pieces)
            && colors_within(color, &sums, bounds.color)
            && normals_within(normal, &sums, bounds.normal)
            && (!surface.tests_texels || texels_within(voxel, color, normal, bounds))
    });
    Attributes { color, normal, uniform }
}

/// The attributes of a voxel with one piece of surface: there is nothing to weigh, and nothing differs from the sample.
fn attributes_of_one(voxel: &Voxel, piece: &Piece, bounds: Option<AttributeBounds>) -> Attributes {
    let surface = voxel.surface;
    let vertices = voxel.arena.vertices(piece, &surface.corners);
    let middle = vertices.iter().sum::<DVec3>() * (1.0 / vertices.len() as f64);
    let (color, normal) = surface.sample_at(piece.triangle, middle, voxel.size).encode();
    let uniform = bounds.is_some_and(|bounds| {
        !surface.is_cut_through(voxel.arena, voxel.pieces)
            && (!surface.tests_texels || texels_within(voxel, color, normal, bounds))
    });
    Attributes { color, normal, uniform }
}

/// Calls `visit` with the weight, the sample and the vertices of each piece.
fn each_sample(voxel: &Voxel, mut visit: impl FnMut(f32, &Sample, &[DVec3])) {
    let per_area = (1.0 / (voxel.size * voxel.size)) as f32;
    for piece in voxel.pieces {
        let vertices = voxel.arena.vertices(piece, &voxel.surface.corners);
        let (area, sample) = voxel.surface.sample(piece.triangle, vertices, voxel.size);
        // A voxel that only touches the surface still needs attributes: every piece weighs something.
        visit((area * per_area).max(1e-8), &sample, vertices);
    }
}

/// Turns the normals of a voxel in which they cancel out to one side, in their sum, and in their range too where finer
/// voxels could not part the sides.
fn turn_to_one_side(voxel: &Voxel, sums: &mut Sums) {
    let mut largest = (0.0, Vec3A::Z);
    each_sample(voxel, |weight, sample, _| {
        if weight > largest.0 {
            largest = (weight, sample.normal);
        }
    });
    let axis = largest.1;
    let side = |normal: Vec3A| 1.0f32.copysign(axis.dot(normal));
    let (mut turned, mut excess) = (Sums::NONE, 0.0);
    let (mut lo, mut hi) = (f64::MAX, f64::MIN);
    each_sample(voxel, |weight, sample, vertices| {
        let side = side(sample.normal);
        excess += side * weight;
        turned.add(weight, &Sample { normal: sample.normal * side, ..*sample });
        for v in vertices {
            let at = v.dot(axis.as_dvec3());
            (lo, hi) = (lo.min(at), hi.max(at));
        }
    });
    let mean = if turned.normal.length_squared() > 0.0 { turned.normal } else { axis };
    let backwards = if excess.abs() < SIDES_EQUAL * sums.weight {
        let largest = mean.abs().max_element();
        mean.to_array().into_iter().find(|c| c.abs() == largest).is_some_and(|c| c < 0.0)
    } else {
        excess < 0.0
    };
    let sign = if backwards { -1.0 } else { 1.0 };
    sums.normal = mean * sign;
    if hi - lo <= voxel.surface.finest_voxel() {
        let [least, most] = turned.normal_range;
        sums.normal_range = if backwards { [-most, -least] } else { [least, most] };
    }
}

/// Whether no sample is further than `bound` steps from what `color` decodes to.
fn colors_within(color: [u8; 3], sums: &Sums, bound: f32) -> bool {
    let [lo, hi] = sums.color_range;
    if bound >= 256.0 || lo == hi {
        return true;
    }
    let decoded = decode(color);
    let (lo, hi) = (encode_srgb(lo.into()), encode_srgb(hi.into()));
    (0..3).all(|k| beyond(decoded[k], lo[k], hi[k]) <= bound)
}

/// What an sRGB-encoded colour decodes to where it has a block to itself, in `0.0..1.0`.
fn decode(color: [u8; 3]) -> [f32; 3] {
    let mut colors = [None; 16];
    colors[0] = Some(color);
    ColorBlock::encode(&colors).decode(0)
}

/// How many steps of 1/256 `value` is from the further end of a range of bytes.
fn beyond(value: f32, lo: u8, hi: u8) -> f32 {
    let steps = |byte: u8| (f32::from(byte) / 255.0 - value).abs() * 256.0;
    steps(lo).max(steps(hi))
}

/// Whether no component of a sample is further than `bound` from what `normal` decodes to.
fn normals_within(normal: RawNormal, sums: &Sums, bound: f32) -> bool {
    let [lo, hi] = sums.normal_range;
    if bound >= 2.0 || lo == hi {
        return true;
    }
    let decoded = Vec3A::from(normal.decode());
    (decoded - lo).max(hi - decoded).max_element() <= bound
}

/// Whether no texel that the finest voxels show is further than the bounds from what colour and normal decode to.
fn texels_within(voxel: &Voxel, color: [u8; 3], normal: RawNormal, bounds: AttributeBounds) -> bool {
    let surface = voxel.surface;
    let (decoded, normal) = (decode(color), Vec3A::from(normal.decode()));
    voxel.pieces.iter().all(|piece| {
        let vertices = voxel.arena.vertices(piece, &surface.corners);
        let (lo, hi) = surface.color_range(piece.triangle, vertices);
        (bounds.color >= 256.0 || lo == hi || (0..3).all(|k| beyond(decoded[k], lo[k], hi[k]) <= bounds.color))
            && (bounds.normal >= 2.0 || surface.normal_deviation(piece.triangle, vertices, normal) <= bounds.normal)
    })
}
