//! Contours: the greedy top-down construction of the paper's section 3.4.
//!
//! For each voxel the polyhedron left by its cube and its ancestors' contours is compared with the surface in it. Where
//! it is already close enough nothing is stored; otherwise the direction in which it overestimates the surface most gets
//! a contour that encloses the surface.

use esvo_format::Contour;
use glam::{DVec3, Vec3};

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

/// The slabs of a voxel's ancestors (and its own) that still bound it.
#[derive(Clone, Copy, Debug)]
pub struct Slabs {
    list: [Slab; MAX_SLABS],
    count: usize,
}

impl Default for Slabs {
    fn default() -> Self {
        Self { list: [Slab { n: Vec3::ZERO, lo: 0.0, hi: 0.0 }; MAX_SLABS], count: 0 }
    }
}

impl Slabs {
    /// The same slabs in the units of child `slot`.
    pub fn for_child(&self, slot: usize) -> Self {
        let offset = Vec3::from(std::array::from_fn(|axis| if slot >> axis & 1 != 0 { 0.25 } else { -0.25 }));
        let mut slabs = Self::default();
        for s in self.as_slice() {
            let at = s.n.dot(offset);
            slabs.push(Slab { n: s.n, lo: 2.0 * (s.lo - at), hi: 2.0 * (s.hi - at) });
        }
        slabs
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
        let old = *self;
        self.count = 0;
        (0..old.count).filter(|k| keep(*k)).for_each(|k| self.push(old.list[k]));
    }
}

/// What was decided for one voxel.
pub struct Shape {
    /// The contour to store.
    pub contour: Option<Contour>,
    /// What bounds the voxel now, in its units.
    pub slabs: Slabs,
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
const MIN_GAIN: f32 = 1.0 / 32.0;
/// How far planes are kept from the surface, in octree units: positions in a caster have errors of a few 2^-23, and two
/// contours that both touch the surface must still overlap there.
const CASTER_MARGIN: f32 = 1.0 / (1 << 21) as f32;

/// Builds contours; holds scratch memory.
#[derive(Default)]
pub struct Shaper {
    polyhedron: Polyhedron,
    points: Vec<Vec3>,
    candidates: Vec<(Vec3, f32)>,
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
    /// Shapes one voxel. `deviation` is the error bound in octree units.
    ///
    /// `deepest` says that the voxel has no descendants whatever its shape: whether the new contour makes it fit is not
    /// looked at then.
    pub fn shape(&mut self, voxel: &Voxel, ancestors: Slabs, deviation: f64, deepest: bool) -> Shape {
        if voxel.pieces.len() > MAX_PIECES {
            return Shape { contour: None, slabs: ancestors, fits: false };
        }
        self.polyhedron.reset();
        for (k, slab) in ancestors.as_slice().iter().enumerate() {
            self.cut(slab, k);
        }
        if self.fits(voxel, deviation) {
            return Shape { contour: None, slabs: self.bounding(ancestors), fits: true };
        }
        self.points.clear();
        let scale = 1.0 / voxel.size;
        for piece in voxel.pieces {
            let vertices = voxel.arena.vertices(piece, &voxel.surface.corners);
            self.points.extend(vertices.iter().map(|v| ((*v - voxel.centre) * scale).as_vec3()));
        }
        self.find_candidates(voxel);
        let Some((contour, gain)) = self.best(voxel.size) else {
            return Shape { contour: None, slabs: self.bounding(ancestors), fits: false };
        };
        if gain < MIN_GAIN {
            return Shape { contour: None, slabs: self.bounding(ancestors), fits: false };
        }
        let decoded = contour.decode();
        let n = Vec3::from(decoded.normal.map(|c| c as f32));
        let slab = Slab { n, lo: decoded.lo() as f32, hi: decoded.hi() as f32 };
        let mut slabs = ancestors;
        if slabs.is_full() && !deepest {
            slabs = self.bounding(slabs);
            // Still full: forget the oldest, which has grown widest.
            if slabs.is_full() {
                slabs.retain(|k| k > 0);
            }
            self.polyhedron.reset();
            for (k, slab) in slabs.as_slice().iter().enumerate() {
                self.cut(slab, k);
            }
        }
        if deepest {
            return Shape { contour: Some(contour), slabs, fits: false };
        }
        self.cut(&slab, slabs.count);
        slabs.push(slab);
        let fits = self.fits(voxel, deviation);
        Shape { contour: Some(contour), slabs: self.bounding(slabs), fits }
    }

    fn cut(&mut self, slab: &Slab, k: usize) {
        let face = 6 + 2 * k as u8;
        self.polyhedron.cut(slab.n, slab.hi, face);
        self.polyhedron.cut(-slab.n, -slab.lo, face + 1);
    }

    /// The slabs that still have a face on the polyhedron.
    fn bounding(&self, mut slabs: Slabs) -> Slabs {
        let faces = self.polyhedron.faces();
        slabs.retain(|k| faces >> (6 + 2 * k) & 3 != 0);
        slabs
    }

    /// Whether no vertex of the polyhedron is further than `deviation` from the surface.
    fn fits(&self, voxel: &Voxel, deviation: f64) -> bool {
        if voxel.pieces.len() > MAX_FIT_TRIANGLES {
            return false;
        }
        let surface = voxel.surface;
        self.polyhedron.vertices().iter().all(|v| {
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
            self.candidate(voxel.surface.normals[piece.triangle as usize], 1.0);
        }
        for piece in voxel.pieces {
            let boundary = voxel.surface.boundary[piece.triangle as usize];
            if boundary == 0 {
                continue;
            }
            let corners = &voxel.surface.corners[piece.triangle as usize];
            for edge in (0..3).filter(|e| boundary >> e & 1 != 0) {
                let (a, b) = (corners[edge], corners[(edge + 1) % 3]);
                if segment_meets_cube(a, b, voxel.centre, voxel.size * 0.5) {
                    let along = (b - a).as_vec3();
                    self.candidate(voxel.surface.normals[piece.triangle as usize].cross(along), EDGE_WEIGHT);
                }
            }
        }
    }

    fn candidate(&mut self, direction: Vec3, weight: f32) {
        let Some(direction) = direction.try_normalize() else { return };
        for (other, w) in &mut self.candidates {
            if other.dot(direction).abs() >= SAME_DIRECTION {
                if weight > *w {
                    (*other, *w) = (direction, weight);
                }
                return;
            }
        }
        if self.candidates.len() < MAX_CANDIDATES {
            self.candidates.push((direction, weight));
        }
    }

    /// The candidate in whose direction the polyhedron overestimates the surface most, as a contour, and by how much, in
    /// parts of the voxel.
    fn best(&self, size: f64) -> Option<(Contour, f32)> {
        let mut best: Option<(u32, f32, f32, f32, f32)> = None;
        for (direction, weight) in &self.candidates {
            let Some(bits) = Contour::encode_normal(direction.to_array().map(f64::from)) else { continue };
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
        let n = Contour::decode_normal(bits);
        let reach = n.iter().map(|c| c.abs()).sum::<f64>();
        let margin = reach * f64::from(CASTER_MARGIN) / size;
        let contour = Contour::encode_bounds(bits, f64::from(lo) - margin, f64::from(hi) + margin)?;
        Some((contour, gain))
    }
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
    if !(outside_ab || outside_bc || outside_ca) {
        return true;
    }
    let to_segment = |from: DVec3, along: DVec3| {
        let t = (from.dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (from - along * t).length_squared()
    };
    to_segment(pa, ab) <= squared || to_segment(pb, bc) <= squared || to_segment(pc, ca) <= squared
}
