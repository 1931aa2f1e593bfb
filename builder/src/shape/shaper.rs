//! Contours by the greedy top-down construction of the paper's section 3.4.
//!
//! The polyhedron that remains of a voxel's cube after the contours of its ancestors is compared with the surface in the
//! voxel. If it is close enough, the voxel gets no contour. Otherwise the contour is put across the direction in which the
//! polyhedron exceeds the surface most, and encloses the surface.

use esvo_format::Contour;
use glam::{DVec3, Vec3};

use crate::shape::plane::{is_plane, shape_plane};
use crate::shape::polyhedron::Polyhedron;
use crate::shape::slab::{Range, Slab, Slabs, greater};
use crate::shape::voxel::{MIN_GAIN, Shape, enclosing, segment_meets_cube};
use crate::surface::Surface;
use crate::surface::voxel::VoxelSurface;

/// A voxel with more pieces of surface than this gets no contour: it is large, and its descendants get theirs.
const MAX_PIECES: usize = 512;
/// A voxel with more triangles than this is never considered to fit.
const MAX_FIT_TRIANGLES: usize = 64;
/// Most directions from triangles and from edges that are tried.
const MAX_CANDIDATES: usize = 32;
/// Directions whose cosine is at least this count as the same candidate.
const SAME_DIRECTION: f32 = 0.98;
/// Weight of a direction that comes from an edge of the surface. One from a normal has weight 1.
const EDGE_WEIGHT: f32 = 0.5;

/// Builds contours; holds scratch memory.
#[derive(Default)]
pub(crate) struct Shaper {
    polyhedron: Polyhedron,
    /// Whether the polyhedron has been cut by the slabs of the current voxel.
    is_cut: bool,
    points: Vec<Vec3>,
    candidates: Vec<Candidate>,
    normals: NormalCache,
}

/// A direction that a contour could have.
struct Candidate {
    direction: Vec3,
    weight: f32,
    /// The direction as the bits of a contour's normal.
    bits: u32,
    /// The normal that `bits` decode to, not of unit length.
    n: Vec3,
    /// One divided by the length of `n`.
    per_length: f32,
    /// The extent of the surface along `n`.
    surface: Range,
    /// Bounds of the extent of the voxel along `n`: each of its slabs is considered alone.
    outer: Range,
}

impl Candidate {
    /// How much further than the surface the voxel extends, in edges of the voxel.
    fn excess(&self) -> f32 {
        greater(self.outer.hi - self.surface.hi, self.surface.lo - self.outer.lo) * self.per_length
    }
}

/// A cache of the encoded normals of triangles: neighbouring voxels contain the same triangles.
struct NormalCache {
    /// Triangle and encoded normal, indexed by the low bits of the triangle's number.
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

impl Shaper {
    /// Shapes one voxel. `deviation` is the error bound in octree units. `slabs` are those of the ancestors in the units of
    /// the voxel; on return they are those that bound its children.
    ///
    /// `deepest`: the voxel has no descendants, whatever its shape. Whether it fits with the new contour is not tested then.
    pub(crate) fn shape(&mut self, voxel: &VoxelSurface, slabs: &mut Slabs, deviation: f64, deepest: bool) -> Shape {
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
        let fitted = self.fits(voxel, slabs, limit);
        let best = self.candidates.iter().filter(|c| c.excess() >= MIN_GAIN);
        let best = best.max_by(|a, b| (a.excess() * a.weight).total_cmp(&(b.excess() * b.weight)));
        let contour = best.and_then(|c| enclosing(c.bits, c.surface.lo.into(), c.surface.hi.into(), voxel.size));
        let Some(contour) = contour.filter(|_| !deepest && !fitted) else { return Shape { contour, fits: fitted } };
        let slab = Slab::of(contour);
        for candidate in &mut self.candidates {
            candidate.outer.intersect(&slab.extent(candidate.n));
        }
        // If the polyhedron is already cut by the other slabs, only the new one is missing.
        if self.is_cut {
            self.cut(&slab, slabs.as_slice().len());
        }
        slabs.add(slab);
        Shape { contour: Some(contour), fits: self.fits(voxel, slabs, limit) }
    }

    /// Stores the vertices of the surface, in units of the voxel and relative to its centre.
    fn find_points(&mut self, voxel: &VoxelSurface) {
        self.points.clear();
        let scale = 1.0 / voxel.size;
        for piece in voxel.pieces {
            let vertices = voxel.arena.vertices(piece, &voxel.surface.corners);
            self.points.extend(vertices.iter().map(|v| ((*v - voxel.centre) * scale).as_vec3()));
        }
    }

    /// Measures the extents of the surface, and of what the slabs leave of the voxel, along all candidates.
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

    /// Makes the polyhedron anew: the cube, cut by these slabs.
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

    /// Whether no point of what the slabs leave of the voxel is further than `limit` from the surface.
    ///
    /// If the extent along a candidate, bounded slab by slab, exceeds the surface by more than `limit`, the answer is no.
    /// Otherwise the vertices of the polyhedron that all slabs leave together decide.
    fn fits(&mut self, voxel: &VoxelSurface, slabs: &Slabs, limit: f32) -> bool {
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

    /// Collects the candidates: normals of the surface, and directions perpendicular to its boundary edges.
    fn find_candidates(&mut self, voxel: &VoxelSurface) {
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

/// Whether `p` is within `distance` of a triangle. It must be within `distance` of the triangle's plane.
///
/// If the projection of `p` into the plane is inside the triangle, it is. Otherwise the nearest point is on an edge.
fn within(p: DVec3, [a, b, c]: &[DVec3; 3], distance: f64) -> bool {
    let (ab, bc, ca) = (*b - *a, *c - *b, *a - *c);
    let n = ab.cross(-ca);
    let (pa, pb, pc) = (p - *a, p - *b, p - *c);
    let squared = distance * distance;
    let outside_ab = ab.cross(n).dot(pa) > 0.0;
    let outside_bc = bc.cross(n).dot(pb) > 0.0;
    let outside_ca = ca.cross(n).dot(pc) > 0.0;
    // A triangle whose area rounds to zero has no inside.
    if n != DVec3::ZERO && !(outside_ab || outside_bc || outside_ca) {
        return true;
    }
    let to_segment = |from: DVec3, along: DVec3| {
        let t = (from.dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (from - along * t).length_squared()
    };
    to_segment(pa, ab) <= squared || to_segment(pb, bc) <= squared || to_segment(pc, ca) <= squared
}
