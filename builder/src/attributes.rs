//! Colour and normal of a voxel: means over the surface in it, weighted by area.

use esvo_format::RawNormal;
use glam::Vec3;

use crate::clip::area_and_centroid;
use crate::range::encode_srgb;
use crate::shaper::Voxel;

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

/// Attributes of a voxel; `bounds` is `None` where it does not matter whether they are uniform.
pub fn attributes(voxel: &Voxel, bounds: Option<AttributeBounds>) -> Attributes {
    let surface = voxel.surface;
    let (mut weight, mut color, mut normal) = (0.0f32, Vec3::ZERO, Vec3::ZERO);
    let mut largest = (-1.0f32, Vec3::Z);
    let per_area = 1.0 / (voxel.size * voxel.size);
    for piece in voxel.pieces {
        let vertices = voxel.arena.vertices(piece, &surface.corners);
        let (area, centroid) = area_and_centroid(vertices);
        // A voxel that only touches the surface still needs a colour: every piece weighs something.
        let w = ((area * per_area) as f32).max(1e-8);
        let sample = surface.sample(piece.triangle, centroid, voxel.size);
        weight += w;
        color += sample.color * w;
        normal += sample.normal * w;
        if w > largest.0 {
            largest = (w, sample.normal);
        }
    }
    let color = encode_srgb(color / weight);
    // Two sides of a thin sheet cancel out: take one of them.
    let mean = if normal.length() > 0.05 * weight { normal.normalize() } else { largest.1 };
    let uniform = bounds.is_some_and(|bounds| {
        voxel.pieces.iter().all(|piece| {
            let vertices = voxel.arena.vertices(piece, &surface.corners);
            let (lo, hi) = surface.color_range(piece.triangle, vertices);
            let beyond = |k: usize| color[k].saturating_sub(lo[k]).max(hi[k].saturating_sub(color[k]));
            (bounds.color >= 255.0 || (0..3).all(|k| f32::from(beyond(k)) <= bounds.color))
                && (bounds.normal >= 2.0 || surface.normal_deviation(piece.triangle, vertices, mean) <= bounds.normal)
        })
    });
    Attributes { color, normal: RawNormal::encode(mean), uniform }
}
