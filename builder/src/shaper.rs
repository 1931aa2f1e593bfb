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

impl Slab {
    fn of(contour: Contour) -> Self {
        let decoded = contour.decode();
        let n = Vec3::from(decoded.normal.map(|c| c as f32));
        Self { n, lo: decoded.lo() as f32, hi: decoded.hi() as f32 }
    }
}

/// The slabs of a voxel's ancestors (and its own) that still bound it.
#[derive(Clone, Copy, Debug)]
pub struct Slabs {
    list: [Slab; MAX_SLABS],
    count: usize,
    /// One triangle goes all the way through the voxel, and so through each of its descendants.
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
        if let [piece] = voxel.pieces
            && (slabs.plane || goes_through(voxel, piece))
            && let Some(bits) = self.normals.bits(voxel.surface, piece.triangle)
        {
            return self.plane(voxel, piece, bits, slabs, deviation, deepest);
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

    /// Shapes a voxel that one triangle goes all the way through: a slab along its plane is all that is of use, and how far
    /// it is from the triangle needs no search.
    fn plane(
        &mut self,
        voxel: &Voxel,
        piece: &Piece,
        bits: u32,
        slabs: &mut Slabs,
        deviation: f64,
        deepest: bool,
    ) -> Shape {
        slabs.plane = true;
        let scale = 1.0 / voxel.size;
        let normal = voxel.surface.normals[piece.triangle as usize];
        let vertices = voxel.arena.vertices(piece, &voxel.surface.corners);
        let n = Vec3::from(Contour::decode_normal(bits).map(|c| c as f32));
        let (mut lo, mut hi, mut height) = (f32::MAX, f32::MIN, 0.0);
        for v in vertices {
            let p = ((*v - voxel.centre) * scale).as_vec3();
            let d = n.dot(p);
            (lo, hi) = (lo.min(d), hi.max(d));
            height = normal.dot(p);
        }
        let limit = (deviation * scale) as f32;
        // The last slab is the narrowest across the plane.
        let last = slabs.as_slice().last().copied();
        if last.is_some_and(|slab| self.slab_fits(&slab, normal, height, limit)) {
            return Shape { contour: None, fits: true };
        }
        let reach = n.abs().element_sum() * 0.5;
        let (outer_lo, outer_hi) =
            last.filter(|s| s.n == n).map_or((-reach, reach), |s| (s.lo.max(-reach), s.hi.min(reach)));
        let gain = (outer_hi - hi).max(lo - outer_lo) / n.length();
        let contour = if gain < MIN_GAIN { None } else { enclosing(bits, lo, hi, voxel.size) };
        let Some(contour) = contour else { return Shape { contour: None, fits: false } };
        let slab = Slab::of(contour);
        let fits = !deepest && self.slab_fits(&slab, normal, height, limit);
        slabs.clear();
        slabs.plane = true;
        slabs.push(slab);
        Shape { contour: Some(contour), fits }
    }

    /// Whether no point of the voxel within the slab is further than `limit` from the plane `normal·p = height`.
    fn slab_fits(&mut self, slab: &Slab, normal: Vec3, height: f32, limit: f32) -> bool {
        let Slab { n, lo, hi } = *slab;
        let reach = n.abs().element_sum() * 0.5;
        if (hi.min(reach) - lo.max(-reach)) > 2.0 * limit * n.length() {
            return false;
        }
        // Along n the slab bounds the distance; across it, the cube does.
        let along = normal.dot(n) / n.length_squared();
        let across = (normal - n * along).abs().element_sum() * 0.5;
        if (along * hi - height + across).max(height - along * lo + across) <= limit {
            return true;
        }
        self.polyhedron.reset();
        self.cut(slab, 0);
        self.polyhedron.vertices().all(|v| (normal.dot(v) - height).abs() <= limit)
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
            let boundary = voxel.surface.boundary[piece.triangle as usize];
            if boundary == 0 {
                continue;
            }
            let corners = &voxel.surface.corners[piece.triangle as usize];
            for edge in (0..3).filter(|e| boundary >> e & 1 != 0) {
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

/// Whether none of the triangle's edges meets the voxel.
fn goes_through(voxel: &Voxel, piece: &Piece) -> bool {
    let corners = &voxel.surface.corners[piece.triangle as usize];
    let half = voxel.size * 0.5 * (1.0 + 1e-6);
    (0..3).all(|i| !segment_meets_cube(corners[i], corners[(i + 1) % 3], voxel.centre, half))
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
