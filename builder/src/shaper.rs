//! Contours: the greedy top-down construction of the paper's section 3.4.
//!
//! For each voxel the polyhedron left by its cube and its ancestors' contours is compared with the surface in it. Where
//! it is already close enough nothing is stored; otherwise the direction in which it overestimates the surface most gets
//! a contour that encloses the surface.

use esvo_format::Contour;
use glam::{DVec3, Vec3, Vec4};

use crate::clip::{Arena, Piece};
use crate::polyhedron::{MAX_SLABS, Polyhedron};
use crate::surface::Surface;

/// A contour's slab `lo <= n·p <= hi` in the units of one voxel, `p` from its centre.
#[derive(Clone, Copy, Debug)]
pub struct Slab {
    n: Vec3,
    lo: f32,
    hi: f32,
}

impl Slab {
    fn of(contour: Contour) -> Self {
        let decoded = contour.decode();
        let n = Vec3::from(decoded.normal.map(|c| c as f32));
        Self { n, lo: decoded.lo() as f32, hi: decoded.hi() as f32 }
    }
}

/// From `lo` to `hi` along some direction.
#[derive(Clone, Copy, Debug)]
struct Range {
    lo: f32,
    hi: f32,
}

impl Range {
    const NONE: Self = Self { lo: f32::MAX, hi: f32::MIN };

    /// That of the unit cube around the origin.
    fn of_cube(direction: Vec3) -> Self {
        let reach = direction.abs().element_sum() * 0.5;
        Self { lo: -reach, hi: reach }
    }

    fn add(&mut self, x: f32) {
        self.lo = self.lo.min(x);
        self.hi = self.hi.max(x);
    }

    fn intersect(&mut self, other: &Self) {
        self.lo = self.lo.max(other.lo);
        self.hi = self.hi.min(other.hi);
    }
}

impl Slab {
    /// How far what the slab leaves of the unit cube around the origin reaches along a direction.
    ///
    /// The farthest point along `g` is a linear program of one constraint beside the box. By its dual it is the least, over
    /// all `l`, of `max(l hi, l lo) + |g - l n|₁ / 2`, which is convex and straight between `l = 0` and the `g_i / n_i`.
    fn extent(&self, g: Vec3) -> Range {
        let Self { n, lo, hi } = *self;
        // One lane for each of the four; where a component of n is zero, 0 once more.
        let l = (g / n).extend(0.0);
        let l = Vec4::select(l.abs().cmple(Vec4::splat(f32::MAX)), l, Vec4::ZERO);
        let across = ((g.x - l * n.x).abs() + (g.y - l * n.y).abs() + (g.z - l * n.z).abs()) * 0.5;
        let (a, b) = (l * lo, l * hi);
        Range { lo: (a.min(b) - across).max_element(), hi: (a.max(b) + across).min_element() }
    }
}

/// The slabs of a voxel's ancestors (and its own) that still bound it.
#[derive(Clone, Copy, Debug)]
pub struct Slabs {
    list: [Slab; MAX_SLABS],
    count: usize,
    /// A plane goes all the way through the voxel, and so through those of its descendants that it meets.
    plane: bool,
}

impl Default for Slabs {
    fn default() -> Self {
        Self { list: [Slab { n: Vec3::ZERO, lo: 0.0, hi: 0.0 }; MAX_SLABS], count: 0, plane: false }
    }
}

impl Slabs {
    /// Becomes the slabs of the parent in the units of child `slot`, those left out that do not bound it.
    pub fn inherit(&mut self, parent: &Slabs, slot: usize) {
        let offset = Vec3::from(std::array::from_fn(|axis| if slot >> axis & 1 != 0 { 0.25 } else { -0.25 }));
        self.clear();
        self.plane = parent.plane;
        for s in parent.as_slice() {
            let at = s.n.dot(offset);
            let (lo, hi) = (2.0 * (s.lo - at), 2.0 * (s.hi - at));
            let reach = s.n.abs().element_sum() * 0.5;
            if lo > -reach || hi < reach {
                self.push(Slab { n: s.n, lo, hi });
            }
        }
    }

    fn clear(&mut self) {
        (self.count, self.plane) = (0, false);
    }

    fn as_slice(&self) -> &[Slab] {
        &self.list[..self.count]
    }

    fn push(&mut self, slab: Slab) {
        self.list[self.count] = slab;
        self.count += 1;
    }

    fn is_full(&self) -> bool {
        self.count == MAX_SLABS
    }

    fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let mut kept = 0;
        for k in (0..self.count).filter(|k| keep(*k)) {
            self.list[kept] = self.list[k];
            kept += 1;
        }
        self.count = kept;
    }
}

/// What was decided for one voxel.
pub struct Shape {
    /// The contour to store.
    pub contour: Option<Contour>,
    /// Whether the shape is within the error bound everywhere, so that no finer voxels are needed.
    pub fits: bool,
}

/// A voxel with more pieces of surface than this gets no contour: it is large, and its descendants get theirs.
const MAX_PIECES: usize = 512;
/// More triangles than this are never taken for a good fit.
const MAX_FIT_TRIANGLES: usize = 64;
/// Directions from triangles and from edges that are looked at.
const MAX_CANDIDATES: usize = 32;
/// Directions whose cosine is above this are the same candidate.
const SAME_DIRECTION: f32 = 0.98;
/// Weight of a direction that comes from an edge of the surface rather than from its normal.
const EDGE_WEIGHT: f32 = 0.5;
/// A contour that moves no plane by more than this part of the voxel is not worth its bytes.
const MIN_GAIN: f32 = 1.0 / 128.0;
/// How far planes are kept from the surface, in octree units: positions in a caster have errors of a few 2^-23, and two
/// contours that both touch the surface must still overlap there.
const CASTER_MARGIN: f32 = 1.0 / (1 << 21) as f32;

/// Builds contours; holds scratch memory.
#[derive(Default)]
pub struct Shaper {
    polyhedron: Polyhedron,
    points: Vec<Vec3>,
    candidates: Vec<Candidate>,
    normals: NormalCache,
}

/// A direction that a contour could have.
struct Candidate {
    direction: Vec3,
    weight: f32,
    /// Its encoding, where it is known.
    bits: Option<u32>,
}

/// Encoded normals of the triangles looked at last: neighbouring voxels share them.
struct NormalCache {
    /// Triangle and encoded normal, at the triangle's lowest bits.
    entries: Vec<(u32, Option<u32>)>,
}

impl Default for NormalCache {
    fn default() -> Self {
        Self { entries: vec![(u32::MAX, None); 256] }
    }
}

impl NormalCache {
    fn bits(&mut self, surface: &Surface, triangle: u32) -> Option<u32> {
        let entry = &mut self.entries[triangle as usize % 256];
        if entry.0 != triangle {
            let normal = surface.normals[triangle as usize];
            *entry = (triangle, Contour::encode_normal(normal.to_array().map(f64::from)));
        }
        entry.1
    }
}

/// A voxel and the surface in it.
pub struct Voxel<'a> {
    pub surface: &'a Surface<'a>,
    pub arena: &'a Arena,
    pub pieces: &'a [Piece],
    pub centre: DVec3,
    pub size: f64,
}

impl Shaper {
    /// Shapes one voxel. `deviation` is the error bound in octree units; `slabs` are those of the ancestors, in the units
    /// of the voxel, and become what bounds its children.
    ///
    /// `deepest` says that the voxel has no descendants whatever its shape: whether the new contour makes it fit is not
    /// looked at then.
    pub fn shape(&mut self, voxel: &Voxel, slabs: &mut Slabs, deviation: f64, deepest: bool) -> Shape {
        const NOTHING: Shape = Shape { contour: None, fits: false };
        if voxel.pieces.len() > MAX_PIECES {
            return NOTHING;
        }
        if (slabs.plane || is_plane(voxel))
            && let Some(bits) = self.normals.bits(voxel.surface, voxel.pieces[0].triangle)
        {
            return plane(voxel, bits, slabs, deviation, deepest);
        }
        self.cut_all(slabs);
        if self.fits(voxel, deviation) {
            return Shape { contour: None, fits: true };
        }
        self.points.clear();
        let scale = 1.0 / voxel.size;
        for piece in voxel.pieces {
            let vertices = voxel.arena.vertices(piece, &voxel.surface.corners);
            self.points.extend(vertices.iter().map(|v| ((*v - voxel.centre) * scale).as_vec3()));
        }
        self.find_candidates(voxel);
        let best = self.best(voxel.size).filter(|(_, gain)| *gain >= MIN_GAIN);
        let Some((contour, _)) = best else {
            if !deepest {
                self.bounding(slabs);
            }
            return NOTHING;
        };
        if deepest {
            return Shape { contour: Some(contour), fits: false };
        }
        if slabs.is_full() {
            self.bounding(slabs);
            // Still full: forget the oldest, which has grown widest.
            if slabs.is_full() {
                slabs.retain(|k| k > 0);
            }
            self.cut_all(slabs);
        }
        let slab = Slab::of(contour);
        self.cut(&slab, slabs.count);
        slabs.push(slab);
        let fits = self.fits(voxel, deviation);
        self.bounding(slabs);
        Shape { contour: Some(contour), fits }
    }

    /// Starts from the cube and cuts it by these slabs.
    fn cut_all(&mut self, slabs: &Slabs) {
        self.polyhedron.reset();
        for (k, slab) in slabs.as_slice().iter().enumerate() {
            self.cut(slab, k);
        }
    }

    fn cut(&mut self, slab: &Slab, k: usize) {
        let face = 6 + 2 * k as u8;
        self.polyhedron.cut(slab.n, slab.hi, face);
        self.polyhedron.cut(-slab.n, -slab.lo, face + 1);
    }

    /// Keeps the slabs that still have a face on the polyhedron.
    fn bounding(&self, slabs: &mut Slabs) {
        let faces = self.polyhedron.faces();
        slabs.retain(|k| faces >> (6 + 2 * k) & 3 != 0);
    }

    /// Whether no vertex of the polyhedron is further than `deviation` from the surface.
    fn fits(&self, voxel: &Voxel, deviation: f64) -> bool {
        if voxel.pieces.len() > MAX_FIT_TRIANGLES {
            return false;
        }
        let surface = voxel.surface;
        self.polyhedron.vertices().all(|v| {
            let p = voxel.centre + v.as_dvec3() * voxel.size;
            voxel.pieces.iter().any(|piece| {
                let corners = &surface.corners[piece.triangle as usize];
                let height = (p - corners[0]).dot(surface.normals[piece.triangle as usize].as_dvec3());
                height.abs() <= deviation && within(p, corners, deviation)
            })
        })
    }

    /// Directions of surface normals, and perpendiculars of the surface's boundary.
    fn find_candidates(&mut self, voxel: &Voxel) {
        self.candidates.clear();
        let step = (voxel.pieces.len() / 16).max(1);
        for piece in voxel.pieces.iter().step_by(step) {
            let bits = self.normals.bits(voxel.surface, piece.triangle);
            self.candidate(voxel.surface.normals[piece.triangle as usize], 1.0, bits);
        }
        for piece in voxel.pieces {
            let edges = voxel.surface.edges[piece.triangle as usize];
            if !edges.has_boundary() {
                continue;
            }
            let corners = &voxel.surface.corners[piece.triangle as usize];
            for edge in (0..3).filter(|edge| edges.is_boundary(*edge)) {
                let (a, b) = (corners[edge], corners[(edge + 1) % 3]);
                if segment_meets_cube(a, b, voxel.centre, voxel.size * 0.5) {
                    let along = (b - a).as_vec3();
                    let across = voxel.surface.normals[piece.triangle as usize].cross(along);
                    if let Some(across) = across.try_normalize() {
                        self.candidate(across, EDGE_WEIGHT, None);
                    }
                }
            }
        }
    }

    fn candidate(&mut self, direction: Vec3, weight: f32, bits: Option<u32>) {
        for other in &mut self.candidates {
            if other.direction.dot(direction).abs() >= SAME_DIRECTION {
                if weight > other.weight {
                    *other = Candidate { direction, weight, bits };
                }
                return;
            }
        }
        if self.candidates.len() < MAX_CANDIDATES {
            self.candidates.push(Candidate { direction, weight, bits });
        }
    }

    /// The candidate in whose direction the polyhedron overestimates the surface most, as a contour, and by how much, in
    /// parts of the voxel.
    fn best(&self, size: f64) -> Option<(Contour, f32)> {
        let mut best: Option<(u32, f32, f32, f32, f32)> = None;
        for Candidate { direction, weight, bits } in &self.candidates {
            let encode = || Contour::encode_normal(direction.to_array().map(f64::from));
            let Some(bits) = bits.or_else(encode) else { continue };
            let n = Vec3::from(Contour::decode_normal(bits).map(|c| c as f32));
            let (mut lo, mut hi) = (f32::MAX, f32::MIN);
            for p in &self.points {
                let d = n.dot(*p);
                lo = lo.min(d);
                hi = hi.max(d);
            }
            let (outer_lo, outer_hi) = self.polyhedron.extent(n);
            let gain = (outer_hi - hi).max(lo - outer_lo) / n.length();
            if best.is_none_or(|b| gain * weight > b.4) {
                best = Some((bits, lo, hi, gain, gain * weight));
            }
        }
        let (bits, lo, hi, gain, _) = best?;
        Some((enclosing(bits, lo, hi, size)?, gain))
    }
}

/// The contour with this normal that encloses what lies between `lo` and `hi` in a voxel of this size.
fn enclosing(bits: u32, lo: f32, hi: f32, size: f64) -> Option<Contour> {
    let reach = Contour::decode_normal(bits).iter().map(|c| c.abs()).sum::<f64>();
    let margin = reach * f64::from(CASTER_MARGIN) / size;
    Contour::encode_bounds(bits, f64::from(lo) - margin, f64::from(hi) + margin)
}

/// Normals whose cosine is above this belong to the same plane, as far as the shape of a voxel goes.
const SAME_PLANE: f32 = 0.99999;
/// More triangles than this are not looked through for whether they are one plane.
const MAX_PLANE_TRIANGLES: usize = 16;

/// Whether the surface in a voxel is all but a plane that goes all the way through: its triangles lie in one plane, and no
/// edge meets the voxel but those where the plane goes on.
fn is_plane(voxel: &Voxel) -> bool {
    let (surface, pieces) = (voxel.surface, voxel.pieces);
    let normal = |piece: &Piece| surface.normals[piece.triangle as usize];
    let first = normal(&pieces[0]);
    let half = voxel.size * 0.5 * (1.0 + 1e-6);
    pieces.len() <= MAX_PLANE_TRIANGLES
        && pieces[1..].iter().all(|piece| normal(piece).dot(first).abs() >= SAME_PLANE)
        && pieces.iter().all(|piece| {
            let (corners, edges) = (&surface.corners[piece.triangle as usize], surface.edges[piece.triangle as usize]);
            (0..3).all(|i| {
                !edges.is_crease(i) || !segment_meets_cube(corners[i], corners[(i + 1) % 3], voxel.centre, half)
            })
        })
}

/// Shapes a voxel that a plane goes all the way through: a slab along it is all that is of use, and how far what is left
/// of the voxel is from the plane needs no search.
fn plane(voxel: &Voxel, bits: u32, slabs: &mut Slabs, deviation: f64, deepest: bool) -> Shape {
    slabs.plane = true;
    let scale = 1.0 / voxel.size;
    let normal = voxel.surface.normals[voxel.pieces[0].triangle as usize];
    let n = Vec3::from(Contour::decode_normal(bits).map(|c| c as f32));
    // The surface along the contour's normal and along its own. There may be several sheets of it, and each is a plane
    // only about: from its highest point it falls by no more than its triangles do together.
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
    let limit = (deviation * scale) as f32 - fall;
    let is_near = |outer: &Range| outer.hi - along_normal.hi <= limit && along_normal.lo - outer.lo <= limit;
    let (mut outer_n, mut outer_normal) = (Range::of_cube(n), Range::of_cube(normal));
    for slab in slabs.as_slice() {
        outer_n.intersect(&slab.extent(n));
        outer_normal.intersect(&slab.extent(normal));
    }
    if is_near(&outer_normal) {
        return Shape { contour: None, fits: true };
    }
    let gain = (outer_n.hi - along_n.hi).max(along_n.lo - outer_n.lo) / n.length();
    let contour = if gain < MIN_GAIN { None } else { enclosing(bits, along_n.lo, along_n.hi, voxel.size) };
    let Some(contour) = contour else { return Shape { contour: None, fits: false } };
    if deepest {
        return Shape { contour: Some(contour), fits: false };
    }
    let slab = Slab::of(contour);
    outer_normal.intersect(&slab.extent(normal));
    slabs.clear();
    slabs.plane = true;
    slabs.push(slab);
    Shape { contour: Some(contour), fits: is_near(&outer_normal) }
}

/// Whether a segment meets the cube with this centre and half edge.
fn segment_meets_cube(a: DVec3, b: DVec3, centre: DVec3, half: f64) -> bool {
    let (a, d) = (a - centre, b - a);
    let (mut t0, mut t1) = (0.0f64, 1.0f64);
    for axis in 0..3 {
        if d[axis] == 0.0 {
            if a[axis].abs() > half {
                return false;
            }
            continue;
        }
        let (x, y) = ((-half - a[axis]) / d[axis], (half - a[axis]) / d[axis]);
        t0 = t0.max(x.min(y));
        t1 = t1.min(x.max(y));
    }
    t0 <= t1
}

/// Whether `p`, which is within `distance` of a triangle's plane, is within `distance` of the triangle.
///
/// Above the inside of the triangle the plane decides; elsewhere the nearest point is on an edge.
fn within(p: DVec3, [a, b, c]: &[DVec3; 3], distance: f64) -> bool {
    let (ab, bc, ca) = (*b - *a, *c - *b, *a - *c);
    let n = ab.cross(-ca);
    let (pa, pb, pc) = (p - *a, p - *b, p - *c);
    let squared = distance * distance;
    let outside_ab = ab.cross(n).dot(pa) > 0.0;
    let outside_bc = bc.cross(n).dot(pb) > 0.0;
    let outside_ca = ca.cross(n).dot(pc) > 0.0;
    // An area that rounds to zero has no inside.
    if n != DVec3::ZERO && !(outside_ab || outside_bc || outside_ca) {
        return true;
    }
    let to_segment = |from: DVec3, along: DVec3| {
        let t = (from.dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (from - along * t).length_squared()
    };
    to_segment(pa, ab) <= squared || to_segment(pb, bc) <= squared || to_segment(pc, ca) <= squared
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_extent_of_a_slab_is_that_of_the_cut_cube(
            n in prop::array::uniform3(-31.0f32..31.0), g in prop::array::uniform3(-1.0f32..1.0), zero in 0usize..8,
            middle in -0.9f32..0.9, thickness in 0.01f32..1.0,
        ) {
            let mut n = Vec3::from(n);
            for axis in (0..3).filter(|axis| zero >> axis & 1 != 0) {
                n[axis] = 0.0;
            }
            prop_assume!(n.length() > 1.0);
            let (g, reach) = (Vec3::from(g), n.abs().element_sum() * 0.5);
            let slab = Slab { n, lo: (middle - thickness) * reach, hi: (middle + thickness) * reach };
            let mut polyhedron = Polyhedron::default();
            polyhedron.cut(n, slab.hi, 6);
            polyhedron.cut(-n, -slab.lo, 7);
            let (lo, hi) = polyhedron.extent(g);
            let found = slab.extent(g);
            prop_assert!((found.lo - lo).abs() < 1e-4 && (found.hi - hi).abs() < 1e-4, "{found:?} for {lo} to {hi}");
        }
    }
}
