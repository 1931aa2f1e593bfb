//! Contours: the greedy top-down construction of the paper's section 3.4.
//!
//! For each voxel the polyhedron left by its cube and its ancestors' contours is compared with the surface in it. Where
//! it is already close enough nothing is stored; otherwise the direction in which it overestimates the surface most gets
//! a contour that encloses the surface.

use esvo_format::Contour;
use glam::{DVec3, Vec3};

use crate::clip::{Arena, Piece};
use crate::shape::plane::{is_plane, shape_plane};
use crate::shape::polyhedron::Polyhedron;
use crate::shape::slab::{Range, Slab, Slabs, greater};
use crate::surface::Surface;

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
pub const MIN_GAIN: f32 = 1.0 / 128.0;
/// How far planes are kept from the surface, in octree units: positions in a caster have errors of a few 2^-23, and two
/// contours that both touch the surface must still overlap there.
const CASTER_MARGIN: f32 = 1.0 / (1 << 21) as f32;

/// Builds contours; holds scratch memory.
#[derive(Default)]
pub struct Shaper {
    polyhedron: Polyhedron,
    /// Whether the slabs of the voxel at hand have been cut from the polyhedron.
    is_cut: bool,
    points: Vec<Vec3>,
    candidates: Vec<Candidate>,
    normals: NormalCache,
}

/// A direction that a contour could have.
struct Candidate {
    direction: Vec3,
    weight: f32,
    /// Encoded, and as that decodes.
    bits: u32,
    n: Vec3,
    per_length: f32,
    /// How far the surface reaches along `n`.
    surface: Range,
    /// How far the voxel does: a bound, each of its slabs being looked at alone.
    outer: Range,
}

impl Candidate {
    /// How much further than the surface the voxel reaches, in parts of the voxel.
    fn excess(&self) -> f32 {
        greater(self.outer.hi - self.surface.hi, self.surface.lo - self.outer.lo) * self.per_length
    }
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
            return shape_plane(voxel, bits, slabs, deviation, deepest);
        }
        self.find_points(voxel);
        self.find_candidates(voxel);
        self.measure(slabs);
        self.is_cut = false;
        let limit = (deviation / voxel.size) as f32;
        if self.fits(voxel, slabs, limit) {
            return Shape { contour: None, fits: true };
        }
        let best = self.candidates.iter().filter(|c| c.excess() >= MIN_GAIN);
        let best = best.max_by(|a, b| (a.excess() * a.weight).total_cmp(&(b.excess() * b.weight)));
        let contour = best.and_then(|c| enclosing(c.bits, c.surface.lo.into(), c.surface.hi.into(), voxel.size));
        let Some(contour) = contour else { return NOTHING };
        if deepest {
            return Shape { contour: Some(contour), fits: false };
        }
        let slab = Slab::of(contour);
        for candidate in &mut self.candidates {
            candidate.outer.intersect(&slab.extent(candidate.n));
        }
        // What has been cut by the others needs only the new one.
        if self.is_cut {
            self.cut(&slab, slabs.as_slice().len());
        }
        slabs.add(slab);
        Shape { contour: Some(contour), fits: self.fits(voxel, slabs, limit) }
    }

    /// The vertices of the surface in units of the voxel.
    fn find_points(&mut self, voxel: &Voxel) {
        self.points.clear();
        let scale = 1.0 / voxel.size;
        for piece in voxel.pieces {
            let vertices = voxel.arena.vertices(piece, &voxel.surface.corners);
            self.points.extend(vertices.iter().map(|v| ((*v - voxel.centre) * scale).as_vec3()));
        }
    }

    /// Finds how far the surface and what the slabs leave of the voxel reach along the candidates.
    fn measure(&mut self, slabs: &Slabs) {
        for candidate in &mut self.candidates {
            candidate.n = Vec3::from(Contour::decode_normal(candidate.bits).map(|c| c as f32));
            candidate.per_length = candidate.n.length_recip();
            let mut surface = Range::NONE;
            for p in &self.points {
                surface.add(candidate.n.dot(*p));
            }
            candidate.surface = surface;
            candidate.outer = Range::of_cube(candidate.n);
            for slab in slabs.as_slice() {
                candidate.outer.intersect(&slab.extent(candidate.n));
            }
        }
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

    /// Whether what the slabs leave of the voxel is nowhere further than `limit` from the surface.
    ///
    /// Where it reaches further than that along one of the candidates it does not, as far as the slabs one by one tell;
    /// else the vertices of their polyhedron decide.
    fn fits(&mut self, voxel: &Voxel, slabs: &Slabs, limit: f32) -> bool {
        if voxel.pieces.len() > MAX_FIT_TRIANGLES || self.candidates.iter().any(|c| c.excess() > limit) {
            return false;
        }
        if !self.is_cut {
            self.cut_all(slabs);
            self.is_cut = true;
        }
        let (surface, deviation) = (voxel.surface, f64::from(limit) * voxel.size);
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
        let same = self.candidates.iter().position(|other| other.direction.dot(direction).abs() >= SAME_DIRECTION);
        if same.is_some_and(|same| weight <= self.candidates[same].weight) {
            return;
        }
        let encode = || Contour::encode_normal(direction.to_array().map(f64::from));
        let Some(bits) = bits.or_else(encode) else { return };
        let candidate = Candidate {
            direction,
            weight,
            bits,
            n: Vec3::ZERO,
            per_length: 0.0,
            surface: Range::NONE,
            outer: Range::NONE,
        };
        match same {
            Some(same) => self.candidates[same] = candidate,
            None if self.candidates.len() < MAX_CANDIDATES => self.candidates.push(candidate),
            None => {}
        }
    }
}

/// The contour with this normal that encloses what lies between `lo` and `hi` in a voxel of this size.
pub fn enclosing(bits: u32, lo: f64, hi: f64, size: f64) -> Option<Contour> {
    let reach = Contour::decode_normal(bits).iter().map(|c| c.abs()).sum::<f64>();
    let margin = reach * f64::from(CASTER_MARGIN) / size;
    Contour::encode_bounds(bits, lo - margin, hi + margin)
}

/// Whether a segment meets the cube with this centre and half edge.
pub fn segment_meets_cube(a: DVec3, b: DVec3, centre: DVec3, half: f64) -> bool {
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
        let (enter, leave) = if x < y { (x, y) } else { (y, x) };
        t0 = if enter > t0 { enter } else { t0 };
        t1 = if leave < t1 { leave } else { t1 };
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
