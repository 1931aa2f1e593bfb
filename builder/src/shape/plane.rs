//! Voxels whose surface is one plane that cuts through the whole cube: most voxels of scenes with walls.
//!
//! The only useful contour there is a slab along the plane, and formulas give how far this slab and those of the ancestors
//! extend: no polyhedron is cut. If the plane is that of a single triangle, the triangle is not clipped either
//! ([`Through`]).

use esvo_format::{Contour, RawNormal};
use glam::{DVec3, Vec3};

use crate::clip::{MARGIN, Piece};
use crate::shape::slab::{Range, Slab, Slabs, greater};
use crate::shape::voxel::{MIN_GAIN, Shape, enclosing, segment_meets_cube};
use crate::surface::attributes::{Attributes, Mean, at_least};
use crate::surface::span::Span;
use crate::surface::voxel::VoxelSurface;
use crate::surface::{Sample, Surface};

/// Edge of the cube that no edge of the surface may meet, in edges of the voxel.
const CLEARANCE: f64 = 1.0 + 1e-6;
/// For the shape of a voxel, normals whose cosine is at least this belong to the same plane.
const SAME_PLANE: f32 = 0.99999;
/// Voxels with more triangles than this are not tested for being one plane.
const MAX_TRIANGLES: usize = 16;

/// Whether the surface in a voxel is, up to small tolerances, a plane that cuts through the whole cube: all its triangles
/// lie in one plane, and no edge meets the voxel except edges across which the plane continues.
pub(crate) fn is_plane(voxel: &VoxelSurface) -> bool {
    let (surface, pieces) = (voxel.surface, voxel.pieces);
    let normal = |piece: &Piece| surface.normals[piece.triangle as usize];
    let first = normal(&pieces[0]);
    let half = voxel.size * 0.5 * CLEARANCE;
    pieces.len() <= MAX_TRIANGLES
        && pieces[1..].iter().all(|piece| normal(piece).dot(first).abs() >= SAME_PLANE)
        && pieces.iter().all(|piece| {
            let (corners, edges) = (&surface.corners[piece.triangle as usize], surface.edges[piece.triangle as usize]);
            (0..3).all(|i| {
                !edges.is_crease(i) || !segment_meets_cube(corners[i], corners[(i + 1) % 3], voxel.centre, half)
            })
        })
}

/// A plane through a voxel, or several nearly equal sheets, in units of the voxel and relative to its centre.
struct Sheets {
    /// The contour's normal, encoded.
    bits: u32,
    /// The contour's normal, decoded.
    n: Vec3,
    /// The unit normal of the plane.
    normal: Vec3,
    /// Extent of the surface along `n`.
    along_n: [f64; 2],
    /// Extent of the surface along `normal`.
    along_normal: Range,
    /// Bound of the depth of a sheet below its highest point, along `normal`.
    fall: f32,
}

impl Sheets {
    /// `limit` is the error bound in units of the voxel. `slabs` bound the voxel; on return they bound its children.
    fn shape(&self, slabs: &mut Slabs, limit: f32, size: f64, deepest: bool) -> Shape {
        slabs.plane = true;
        let mut outer_n = Range::of_cube(self.n);
        for slab in slabs.as_slice() {
            outer_n.intersect(&slab.extent(self.n));
        }
        let per_length = self.n.length_recip();
        let [lo, hi] = self.along_n;
        let gain = greater(outer_n.hi - hi as f32, lo as f32 - outer_n.lo) * per_length;
        // If the voxel exceeds the limit along `n`, the extent along `normal` need not be computed.
        let limit = limit - self.fall;
        let fitted = gain <= limit && self.is_near(slabs, limit);
        let contour = if gain < MIN_GAIN { None } else { enclosing(self.bits, lo, hi, size) };
        let Some(contour) = contour.filter(|_| !deepest && !fitted) else { return Shape { contour, fits: fitted } };
        let slab = Slab::of(contour);
        outer_n.intersect(&Range { lo: slab.lo, hi: slab.hi });
        let gain = greater(outer_n.hi - hi as f32, lo as f32 - outer_n.lo) * per_length;
        // The older slabs matter only for whether this voxel fits; its children are bounded by the new one alone.
        let fits = gain <= limit && {
            let mut all = *slabs;
            all.add(slab);
            self.is_near(&all, limit)
        };
        slabs.clear();
        slabs.plane = true;
        slabs.add(slab);
        Shape { contour: Some(contour), fits }
    }

    /// Whether what the slabs leave of the voxel extends at most `limit` above the highest and below the lowest sheet.
    fn is_near(&self, slabs: &Slabs, limit: f32) -> bool {
        let mut outer = Range::of_cube(self.normal);
        for slab in slabs.as_slice() {
            outer.intersect(&slab.extent(self.normal));
        }
        outer.hi - self.along_normal.hi <= limit && self.along_normal.lo - outer.lo <= limit
    }
}

/// Shapes a voxel whose surface [is a plane](is_plane); `bits` is the encoded normal of its first triangle.
/// `deviation` is the error bound in octree units; for the other parameters see `Shaper::shape`.
pub(crate) fn shape_plane(voxel: &VoxelSurface, bits: u32, slabs: &mut Slabs, deviation: f64, deepest: bool) -> Shape {
    let scale = 1.0 / voxel.size;
    let normal = voxel.surface.normals[voxel.pieces[0].triangle as usize];
    let n = Vec3::from(Contour::decode_normal(bits).map(|c| c as f32));
    // There may be several sheets, and each is only approximately a plane. The depth of a sheet below its highest point is
    // at most the sum of the depths of its triangles.
    let (mut along_n, mut along_normal, mut fall) = (Range::NONE, Range::NONE, 0.0);
    for piece in voxel.pieces {
        let mut of_piece = Range::NONE;
        for v in voxel.arena.vertices(piece, &voxel.surface.corners) {
            let p = ((*v - voxel.centre) * scale).as_vec3();
            along_n.add(n.dot(p));
            of_piece.add(normal.dot(p));
        }
        fall += of_piece.hi - of_piece.lo;
        along_normal.add(of_piece.lo);
        along_normal.add(of_piece.hi);
    }
    let sheets = Sheets { bits, n, normal, along_n: [along_n.lo.into(), along_n.hi.into()], along_normal, fall };
    sheets.shape(slabs, (deviation * scale) as f32, voxel.size, deepest)
}

/// A triangle that meets a cube with no edge inside it: in this cube and all cubes inside, the triangle equals its plane.
///
/// # Why no voxel is lost
///
/// With `u = 2^-53` and the root cube's edge as unit, as for [`crate::clip`]: the cross product `N` of two edges, each of
/// at most `L`, is off by at most `8 u L²`, so its direction by `8 u L² / |N|`. A height `N·(p - a) / |N|` in the cube is
/// off by that times `|p - a|`, which [`Through::new`] keeps below `40 u`, by `3 u` for the corner `a`, and by about `6 u`
/// for its own roundings: together by less than half of [`MARGIN`]. So [`Through::meets`] holds for every cube that the
/// triangle meets; and if it holds for a cube, the plane is within `2 MARGIN` of the cube. The triangle extends that far:
/// it is larger than the cube with its clearance.
pub(crate) struct Through {
    /// The triangle.
    pub triangle: u32,
    normal: DVec3,
    /// The corner nearest to the cube.
    corner: DVec3,
    /// Half the extent along the normal of a cube of edge 1.
    reach: f64,
    /// The contour's normal, encoded (`bits`) and decoded (`n`).
    bits: u32,
    n: DVec3,
    /// The multipliers `n_i / normal_i` for [`Through::extent`].
    multiples: [f64; 3],
    /// Colour and normal, if they are the same everywhere on the triangle.
    constant: Option<([u8; 3], RawNormal, Sample)>,
    /// Absolute components of the normal divided by the largest, in descending order; the first is 1.
    slopes: [f64; 3],
}

impl Through {
    /// `None` if an edge of the triangle meets the cube, if the triangle is too narrow for its plane to be known precisely
    /// enough, or if it has holes.
    pub(crate) fn new(surface: &Surface, triangle: u32, centre: DVec3, size: f64) -> Option<Self> {
        let corners = &surface.corners[triangle as usize];
        let half = size * 0.5 * CLEARANCE;
        let edge_meets = |i: usize| segment_meets_cube(corners[i], corners[(i + 1) % 3], centre, half);
        if !surface.is_solid(triangle) || edge_meets(0) || edge_meets(1) || edge_meets(2) {
            return None;
        }
        let nearest = (0..3).min_by(|i, j| {
            let distance = |i: usize| (corners[i] - centre).length_squared();
            distance(*i).total_cmp(&distance(*j))
        })?;
        let corner = corners[nearest];
        let (ab, ac) = (corners[(nearest + 1) % 3] - corner, corners[(nearest + 2) % 3] - corner);
        let cross = ab.cross(ac);
        let longest = ab.length_squared().max(ac.length_squared()).max((ac - ab).length_squared());
        let length = cross.length();
        if longest * ((centre - corner).length() + size) > 5.0 * length {
            return None;
        }
        let normal = cross / length;
        let bits = Contour::encode_normal(normal.to_array())?;
        let n = DVec3::from(Contour::decode_normal(bits));
        let reach = normal.abs().element_sum() * 0.5;
        // Dividing by a component that is almost zero would overflow: repeat the multiplier of the largest instead.
        let largest = (0..3).max_by(|i, j| normal[*i].abs().total_cmp(&normal[*j].abs()))?;
        let multiples = [0, 1, 2].map(|i| {
            let i = if normal[i].abs() < 1e-6 { largest } else { i };
            n[i] / normal[i]
        });
        let constant = surface.constant(&[Piece::whole(triangle)]);
        let constant = constant.map(|(color, raw)| (color, raw, surface.sample_at(triangle, corner, size)));
        let mut slopes = (normal.abs() / normal[largest].abs()).to_array();
        slopes.sort_by(|a, b| b.total_cmp(a));
        Some(Self { triangle, normal, corner, reach, bits, n, multiples, constant, slopes })
    }

    /// Signed distance of a cube's centre from the plane.
    pub(crate) fn height(&self, centre: DVec3) -> f64 {
        self.normal.dot(centre - self.corner)
    }

    /// Whether the cube of edge `size` whose centre is at this height meets the triangle.
    pub(crate) fn meets(&self, height: f64, size: f64) -> bool {
        height.abs() <= self.reach * size + MARGIN
    }

    /// The children that the triangle [`meets`](Self::meets), of the cube of edge `size` with this centre: a mask of slots.
    pub(crate) fn children(&self, centre: DVec3, size: f64) -> u8 {
        let (quarter, reach) = (size * 0.25, self.reach * (size * 0.5) + MARGIN);
        // The heights of the children's centres, with the roundings of `height`: the terms of each axis take two values.
        let term = |axis: usize, offset: f64| self.normal[axis] * (centre[axis] + offset - self.corner[axis]);
        let [x, y, z] = [0, 1, 2].map(|axis| [term(axis, -quarter), term(axis, quarter)]);
        (0..8).fold(0, |mask, slot| {
            let height = x[slot & 1] + y[slot >> 1 & 1] + z[slot >> 2];
            mask | u8::from(height.abs() <= reach) << slot
        })
    }

    /// Extent along `n` of the part of the plane `normal·p = height` inside the unit cube around the origin.
    ///
    /// The upper end is a linear program. Its dual is the minimum, over all `l`, of `l height + |n - l normal|₁ / 2`: every
    /// `l` gives a bound, and the tight one is among the `n_i / normal_i`.
    fn extent(&self, height: f64) -> [f64; 2] {
        let (mut lo, mut hi) = (f64::MIN, f64::MAX);
        for l in self.multiples {
            let across = (self.n - self.normal * l).abs().element_sum() * 0.5;
            let (a, b) = (l * height - across, l * height + across);
            lo = if a > lo { a } else { lo };
            hi = if b < hi { b } else { hi };
        }
        // For a plane that passes the cube within the margin the ends are swapped.
        if lo <= hi { [lo, hi] } else { [hi, lo] }
    }

    /// Shapes the voxel of edge `size` whose centre is at this height. For the other parameters see `Shaper::shape`.
    pub(crate) fn shape(&self, height: f64, size: f64, slabs: &mut Slabs, deviation: f64, deepest: bool) -> Shape {
        let scale = 1.0 / size;
        let height = -height * scale;
        let sheets = Sheets {
            bits: self.bits,
            n: self.n.as_vec3(),
            normal: self.normal.as_vec3(),
            along_n: self.extent(height),
            along_normal: Range { lo: height as f32, hi: height as f32 },
            fall: 0.0,
        };
        sheets.shape(slabs, (deviation * scale) as f32, size, deepest)
    }

    /// Area of the part of the plane `normal·p = height` inside the unit cube around the origin.
    ///
    /// Project the plane along the normal's largest component onto a square of edge 1. There the plane rises by `a x + b y`,
    /// where `a >= b` are the other two `slopes`, and it is inside the cube where this is between two heights that differ
    /// by 1. The share of the square where `a x + b y` is below a height is the integral of a trapezoid.
    fn area(&self, height: f64) -> f64 {
        let [_, a, b] = self.slopes;
        let middle = height.abs() / self.reach * 0.5 * (1.0 + a + b);
        let below = |t: f64| {
            let (outer, inner) = ((a + b) * 0.5, (a - b) * 0.5);
            // Symmetric around 0: compute the smaller side.
            let over = outer - t.abs();
            let part = if over <= 0.0 {
                0.0
            } else if t.abs() <= inner {
                0.5 - t.abs() / a
            } else {
                over * over / (2.0 * a * b)
            };
            if t < 0.0 { part } else { 1.0 - part }
        };
        (below(middle + 0.5) - below(middle - 0.5)) * (1.0 + a * a + b * b).sqrt()
    }

    /// Attributes of the voxel of edge `size` whose centre is at this height.
    pub(crate) fn attributes(&self, surface: &Surface, centre: DVec3, height: f64, size: f64) -> Attributes {
        let area = self.area(height / size) * size * size;
        let weight = at_least(area as f32, size);
        let foot = || {
            let half = DVec3::splat(size * 0.5);
            (centre - self.normal * height).clamp(centre - half, centre + half)
        };
        let mut found = if let Some((color, normal, sample)) = &self.constant {
            Attributes { color: *color, normal: *normal, mean: Mean::new(weight, sample) }
        } else {
            let sample = surface.sample_at(self.triangle, foot(), size);
            let (color, normal) = sample.encode();
            Attributes { color, normal, mean: Mean::new(weight, &sample) }
        };
        if !surface.columns.is_empty() {
            found.mean.extra = surface.properties_at(self.triangle, foot(), size).of(weight);
        }
        found
    }

    /// Whether one emission can stand for all in the voxel of edge `size` whose centre is at this height.
    pub(crate) fn emission_fits(&self, surface: &Surface, centre: DVec3, height: f64, size: f64, bound: f32) -> bool {
        let (vertices, count) = self.outline(centre, height, size * 0.5);
        surface.emission_fits(std::iter::once((self.triangle, &vertices[..count])), size, bound)
    }

    /// The range of colours and normals in the voxel of edge `size` whose centre is at this height.
    pub(crate) fn span(&self, surface: &Surface, centre: DVec3, height: f64, size: f64) -> Span {
        if let Some((color, _, sample)) = &self.constant {
            return Span::of(*color, sample.normal);
        }
        let (vertices, count) = self.outline(centre, height, size * 0.5);
        surface.span(self.triangle, &vertices[..count], size)
    }

    /// The part of the plane in the cube of half edge `half` whose centre is at this height: vertices in order around it, and
    /// their number, 1 to 6.
    ///
    /// Seen along the normal's largest component the cube is a square, of which two lines cut off what is above and below.
    fn outline(&self, centre: DVec3, height: f64, half: f64) -> ([DVec3; 6], usize) {
        let normal = self.normal;
        let up = (0..3).fold(0, |best, i| if normal[i].abs() > normal[best].abs() { i } else { best });
        let (u, v) = ((up + 1) % 3, (up + 2) % 3);
        // The plane is at `(-height - a·normal[u] - b·normal[v]) / normal[up]` above the centre.
        let rise = |[a, b]: [f64; 2]| (-height - a * normal[u] - b * normal[v]) / normal[up];
        let mut polygon = [[0.0; 2]; 8];
        polygon[..4].copy_from_slice(&[[-half, -half], [half, -half], [half, half], [-half, half]]);
        let mut count = 4;
        for side in [1.0, -1.0] {
            let below = |p: [f64; 2]| half - side * rise(p);
            let (mut cut, mut kept) = ([[0.0; 2]; 8], 0);
            for i in 0..count {
                let (p, q) = (polygon[i], polygon[(i + 1) % count]);
                let (d, e) = (below(p), below(q));
                if d >= 0.0 {
                    (cut[kept], kept) = (p, kept + 1);
                }
                if d * e < 0.0 {
                    let t = d / (d - e);
                    (cut[kept], kept) = ([p[0] + (q[0] - p[0]) * t, p[1] + (q[1] - p[1]) * t], kept + 1);
                }
            }
            (polygon, count) = (cut, kept.min(6));
        }
        let mut vertices = [DVec3::ZERO; 6];
        for (vertex, p) in vertices.iter_mut().zip(&polygon[..count]) {
            let mut at = centre;
            at[u] += p[0];
            at[v] += p[1];
            at[up] += rise(*p).clamp(-half, half);
            *vertex = at;
        }
        if count == 0 {
            // The plane passes the cube within the margin.
            vertices[0] = (centre - normal * height).clamp(centre - half, centre + half);
        }
        (vertices, count.max(1))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::clip::Arena;
    use crate::{BuildSettings, Material, Mesh};

    /// A mesh of which the root cube is the unit cube: its largest extent is 1. The second triangle is `t`.
    fn with_triangle(t: [[f64; 3]; 3]) -> Mesh {
        let frame = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]];
        Mesh {
            positions: frame.into_iter().chain(t).collect(),
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            triangle_materials: vec![0, 0],
            materials: vec![Material::default()],
            ..Mesh::default()
        }
    }

    proptest! {
        /// Down to level 8, the plane meets the same cubes as the clipped pieces, with the same extents and areas.
        #[test]
        fn the_plane_is_the_triangle(t in prop::array::uniform3(prop::array::uniform3(0.0f64..1.0)), path in prop::array::uniform8(0usize..8)) {
            let mesh = with_triangle(t);
            let surface = Surface::new(&mesh, &BuildSettings::default()).unwrap();
            prop_assume!(surface.len() == 2);
            let mut arena = Arena::default();
            let (mut piece, mut centre, mut size) = (Piece::whole(1), DVec3::splat(0.5), 1.0);
            let mut through: Option<Through> = None;
            for wish in path {
                let mut found = Vec::new();
                arena.split(&piece, &surface.corners, centre, |slot, part| found.push((slot, part)));
                let child = |slot: usize| centre + size * DVec3::from([0, 1, 2].map(|k| if slot >> k & 1 != 0 { 0.25 } else { -0.25 }));
                if let Some(through) = &through {
                    for slot in 0..8 {
                        let height = through.height(child(slot));
                        let part = found.iter().find(|f| f.0 == slot).map(|f| f.1);
                        let edge = (height.abs() - through.reach * size * 0.5).abs();
                        prop_assert!(part.is_some() == through.meets(height, size * 0.5) || edge < 4.0 * MARGIN);
                        let Some(part) = part else { continue };
                        let [lo, hi] = through.extent(-height / (size * 0.5));
                        let points = arena.vertices(&part, &surface.corners);
                        let along = points.iter().map(|v| through.n.dot((*v - child(slot)) / (size * 0.5)));
                        let (least, most) = along.fold((f64::MAX, f64::MIN), |(lo, hi), d| (lo.min(d), hi.max(d)));
                        prop_assert!((least - lo).abs() < 1e-7 && (most - hi).abs() < 1e-7, "{lo} to {hi} for {least} to {most}");
                        let (outline, count) = through.outline(child(slot), height, size * 0.25);
                        for v in points {
                            let near = outline[..count].iter().map(|w| (*w - *v).length()).fold(f64::MAX, f64::min);
                            prop_assert!(near < 1e-7, "{near} from an outline of {count}");
                        }
                        let (area, true_area) = (through.area(height / (size * 0.5)), surface.area(1, points) / (size * size * 0.25) as f32);
                        prop_assert!((area as f32 - true_area).abs() < 1e-4, "{area} for {true_area}");
                    }
                }
                let Some(next) = found.get(wish % found.len().max(1)) else { break };
                (centre, piece, size) = (child(next.0), next.1, size * 0.5);
                through = Through::new(&surface, 1, centre, size);
            }
        }
    }
}
