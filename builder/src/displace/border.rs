//! What the triangles of a mesh share after displacement: the places and normals at their corners and on their edges.
//!
//! This is computed once for the whole mesh. What is left of a triangle, the vertices inside, then depends on nothing but the
//! triangle: any part of the displaced mesh can be made alone, and fits all others in every bit. It needs memory for the
//! points on edges only, whose number grows with the square root of that of the small triangles.

use glam::DVec3;
use rayon::prelude::*;

use super::dice::Dicer;
use super::join::Moved;
use super::patch::{Patch, mix};
use super::plan::Plan;
use super::slope::{Slope, Slopes};
use super::weld::Edges;
use crate::Mesh;

/// Triangles whose slopes are kept at once.
const CHUNK: usize = 1024;

pub(super) struct Border {
    pub(super) moved: Moved,
    /// For each vertex of the mesh, its normal after displacement.
    corner_normals: Vec<[f32; 3]>,
    /// The edges of the touched triangles; the surface is smooth across those with the same number.
    smooth: Edges,
    /// For each point of `smooth`, its normal after displacement.
    point_normals: Vec<[f32; 3]>,
}

/// A vertex on an edge, after displacement.
pub(super) struct EdgePoint {
    pub(super) position: [f64; 3],
    pub(super) normal: [f32; 3],
    /// The vertices at the ends of the edge, and the share of the second.
    ends: [usize; 2],
    t: f64,
}

impl Border {
    /// `plan` must be [cut](Plan::cut).
    pub(super) fn of(plan: &Plan<'_>) -> Self {
        let (mesh, vertices) = (plan.mesh, plan.vertices);
        let moved = Moved::together(plan);
        let corner_lists: Vec<[u32; 3]> = (0..plan.touched.len()).map(|i| plan.corners(i)).collect();
        let mut smooth = Edges::of(&corner_lists, &vertices.place, |v| vertices.smooth[v as usize]);
        smooth.number_points(|i, e| plan.segments(i, e));
        let mut corner_slopes = vec![Slope::default(); vertices.smooth_count];
        let mut point_slopes = vec![Slope::default(); smooth.points()];
        for start in (0..plan.touched.len()).step_by(CHUNK) {
            let slopes: Vec<Vec<Slope>> = (start..(start + CHUNK).min(plan.touched.len()))
                .into_par_iter()
                .map_init(Dicer::default, |dicer, i| {
                    // The slope at the border needs only the small triangles that touch it.
                    let inside = plan.borders(i).first()[3];
                    let patch = Patch::new(plan, dicer, i, |part| part.corners.iter().any(|&v| v < inside));
                    Slopes::of(plan, i, &patch, &moved).border
                })
                .collect();
            // Added in the order of the triangles, so that the rounding does not depend on the number of threads.
            for (i, slopes) in (start..).zip(&slopes) {
                for (k, v) in plan.corners(i).into_iter().enumerate() {
                    corner_slopes[vertices.smooth[v as usize] as usize].add(&slopes[k]);
                }
                let first_local = plan.borders(i).first();
                for (e, &edge) in smooth.of[i].iter().enumerate() {
                    let (first, local) = (smooth.first[edge as usize], first_local[e] as usize);
                    for k in 0..plan.segments(i, e) as usize - 1 {
                        point_slopes[first + k].add(&slopes[local + k]);
                    }
                }
            }
        }
        let corner_normals = (mesh.normals.par_iter().zip(&vertices.smooth))
            .map(|(&n, &s)| corner_slopes[s as usize].lean(DVec3::from(n.map(f64::from)), n))
            .collect();
        let users = smooth.users();
        let point_normals = (0..smooth.ends.len())
            .into_par_iter()
            .flat_map_iter(|edge| {
                let (points, slot) = (smooth.first[edge]..smooth.first[edge + 1], users.of(edge)[0] as usize);
                let [a, b] = plan.ends_of(slot / 3, slot % 3).map(|v| v as usize);
                let (n, point_slopes) = (points.len() + 1, &point_slopes);
                points.enumerate().map(move |(k, point)| {
                    let t = (k + 1) as f64 / n as f64;
                    let mixed = DVec3::from(mix(&mesh.normals, [a, b, b], [1.0 - t, t, 0.0])).try_normalize();
                    let normal = mixed.unwrap_or(DVec3::from(mesh.normals[a].map(f64::from)));
                    point_slopes[point].lean(normal, normal.as_vec3().to_array())
                })
            })
            .collect();
        Self { moved, corner_normals, smooth, point_normals }
    }

    /// Position and normal of a vertex of the mesh.
    pub(super) fn corner(&self, plan: &Plan<'_>, v: usize) -> ([f64; 3], [f32; 3]) {
        let place = plan.vertices.place[v] as usize;
        ((plan.vertices.positions[place] + self.moved.places[place]).to_array(), self.corner_normals[v])
    }

    /// Point `k` on edge `e` of touched triangle `i`.
    pub(super) fn point(&self, plan: &Plan<'_>, i: usize, e: usize, k: usize) -> EdgePoint {
        let t = (k + 1) as f64 / f64::from(plan.segments(i, e));
        let place_edge = plan.places.of[i][e] as usize;
        let [pa, pb] = plan.places.ends[place_edge].map(|p| plan.vertices.positions[p as usize]);
        let position = pa.lerp(pb, t) + self.moved.points[plan.places.first[place_edge] + k];
        let normal = self.point_normals[self.smooth.first[self.smooth.of[i][e] as usize] + k];
        EdgePoint { position: position.to_array(), normal, ends: plan.ends_of(i, e).map(|v| v as usize), t }
    }

    /// How far the corners and points on edges of touched triangle `i` move at most along each axis.
    pub(super) fn reach(&self, plan: &Plan<'_>, i: usize) -> DVec3 {
        let corners = plan.places_of(i).into_iter().map(|p| self.moved.places[p as usize]);
        let edges = plan.places.of[i].map(|e| plan.places.first[e as usize]..plan.places.first[e as usize + 1]);
        let points = edges.into_iter().flatten().map(|k| self.moved.points[k]);
        corners.chain(points).fold(DVec3::ZERO, |most, moved| most.max(moved.abs()))
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        let (moved, smooth) = (&self.moved, &self.smooth);
        24 * (moved.places.len() + moved.points.len())
            + 12 * (self.corner_normals.len() + self.point_normals.len() + smooth.of.len())
            + 16 * smooth.ends.len()
    }
}

impl EdgePoint {
    /// Adds the vertex to a mesh.
    pub(super) fn push(&self, out: &mut Mesh, mesh: &Mesh) {
        out.positions.push(self.position);
        out.normals.push(self.normal);
        let [a, b] = self.ends;
        push_attributes(out, mesh, [a, b, b], [1.0 - self.t, self.t, 0.0]);
    }
}

/// Adds a vertex's interpolated attributes except position and normal.
pub(super) fn push_attributes(out: &mut Mesh, mesh: &Mesh, vertices: [usize; 3], weights: [f64; 3]) {
    out.uvs.push(mix(&mesh.uvs, vertices, weights).map(|x| x as f32));
    if !mesh.colors.is_empty() {
        out.colors.push(mix(&mesh.colors, vertices, weights).map(|x| x as f32));
    }
    if !mesh.tangents.is_empty() {
        let handed = vertices.map(|v| mesh.tangents[v][3]);
        let [x, y, z, _] = mix(&mesh.tangents, vertices, weights);
        let t = DVec3::new(x, y, z).normalize_or_zero().as_vec3();
        // Between corners of different handedness the tangent is undefined: zero.
        let one = handed[0] != 0.0 && handed[0] == handed[1] && handed[1] == handed[2];
        out.tangents.push(if one { [t.x, t.y, t.z, handed[0]] } else { [0.0; 4] });
    }
}
