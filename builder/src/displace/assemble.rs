//! Dices all patches and assembles the displaced mesh from them.

use glam::DVec3;
use rayon::prelude::*;

use super::dice::{Dicer, segments};
use super::join::Moved;
use super::patch::{Patch, mix};
use super::plan::Plan;
use super::slope::{Slope, Slopes};
use super::weld::Edges;
use crate::mesh::MAX_ELEMENTS;
use crate::{BuildError, Mesh};

/// All patches, diced with all steps multiplied by one factor.
pub(super) struct Work<'p, 'a> {
    pub(super) plan: &'p Plan<'a>,
    pub(super) patches: Vec<Patch>,
    /// Number of segments of each edge of `plan.places`.
    segments: Vec<u32>,
}

impl<'p, 'a> Work<'p, 'a> {
    pub(super) fn new(plan: &'p mut Plan<'a>, factor: f64) -> Self {
        let position = |p: u32| plan.vertices.positions[p as usize];
        let edge_segments: Vec<u32> = (plan.places.ends.iter().zip(&plan.edge_steps))
            .map(|(&[a, b], step)| segments(position(a).distance(position(b)), step * factor))
            .collect();
        let of = plan.places.of.clone();
        plan.places.number_points(|i, e| edge_segments[of[i][e] as usize]);
        let plan: &Plan<'a> = plan;
        let patches = (0..plan.touched.len())
            .into_par_iter()
            .map_init(Dicer::default, |dicer, i| Patch::new(plan, dicer, i, &edge_segments, factor))
            .collect();
        Self { plan, patches, segments: edge_segments }
    }

    /// Moves the vertices, corrects the normals, and assembles the mesh.
    pub(super) fn finish(self) -> Result<Mesh, BuildError> {
        let Self { plan, patches, segments } = &self;
        let (mesh, vertices) = (plan.mesh, plan.vertices);
        let corner_lists: Vec<[u32; 3]> = (0..patches.len()).map(|i| plan.corners(i)).collect();
        let of_edge = |i: usize, e: usize| segments[plan.places.of[i][e] as usize];
        let mut smooth = Edges::of(&corner_lists, &vertices.place, |v| vertices.smooth[v as usize]);
        smooth.number_points(of_edge);
        let mut own = Edges::of(&corner_lists, &vertices.place, |v| v);
        own.number_points(of_edge);
        let inside: usize = patches.iter().map(|p| p.diced.interior.len()).sum();
        let triangles =
            mesh.triangles.len() - patches.len() + patches.iter().map(|p| p.diced.triangles.len()).sum::<usize>();
        let total = mesh.positions.len() + own.points() + inside;
        if total.max(triangles) > MAX_ELEMENTS {
            return Err(BuildError::Mesh(format!(
                "displaced, it has {} triangles and vertices; the limit is {MAX_ELEMENTS}; choose larger cells",
                total.max(triangles)
            )));
        }

        let moved = Moved::together(plan, patches);
        let slopes: Vec<Slopes> = patches.par_iter().enumerate().map(|(i, p)| Slopes::of(plan, i, p, &moved)).collect();
        let mut corner_slopes = vec![Slope::default(); vertices.smooth_count];
        let mut point_slopes = vec![Slope::default(); smooth.points()];
        for (i, (patch, slopes)) in patches.iter().zip(&slopes).enumerate() {
            for (k, v) in plan.corners(i).into_iter().enumerate() {
                corner_slopes[vertices.smooth[v as usize] as usize].add(&slopes.border[k]);
            }
            for (e, &edge) in smooth.of[i].iter().enumerate() {
                let (first, local) = (smooth.first[edge as usize], patch.borders.first()[e] as usize);
                for j in 0..patch.borders.segments[e] as usize - 1 {
                    point_slopes[first + j].add(&slopes.border[local + j]);
                }
            }
        }

        let mut out = Mesh { materials: mesh.materials.clone(), warnings: mesh.warnings.clone(), ..Mesh::default() };
        // Order of the vertices: those of the mesh, then the points on edges, then those inside patches.
        out.positions = (vertices.place.par_iter())
            .map(|&p| (vertices.positions[p as usize] + moved.places[p as usize]).to_array())
            .collect();
        out.normals = (mesh.normals.par_iter().zip(&vertices.smooth))
            .map(|(&n, &s)| corner_slopes[s as usize].lean(DVec3::from(n.map(f64::from)), n))
            .collect();
        out.uvs.clone_from(&mesh.uvs);
        out.colors.clone_from(&mesh.colors);
        out.tangents.clone_from(&mesh.tangents);
        let mut done = vec![false; own.ends.len()];
        for i in 0..patches.len() {
            for e in 0..3 {
                let edge = own.of[i][e] as usize;
                if std::mem::replace(&mut done[edge], true) || own.first[edge] == own.first[edge + 1] {
                    continue;
                }
                let n = of_edge(i, e);
                let [a, b] = own.ends[edge].map(|v| v as usize);
                let place_edge = plan.places.of[i][e] as usize;
                let [pa, pb] = plan.places.ends[place_edge].map(|p| vertices.positions[p as usize]);
                for j in 1..n {
                    let t = f64::from(j) / f64::from(n);
                    let k = j as usize - 1;
                    let position = pa.lerp(pb, t) + moved.points[plan.places.first[place_edge] + k];
                    out.positions.push(position.to_array());
                    let normal = unit_or(mix(&mesh.normals, [a, b, b], [1.0 - t, t, 0.0]), mesh.normals[a]);
                    let point = smooth.first[smooth.of[i][e] as usize] + k;
                    out.normals.push(point_slopes[point].lean(normal, normal.as_vec3().to_array()));
                    push_attributes(&mut out, mesh, [a, b, b], [1.0 - t, t, 0.0]);
                }
            }
        }
        // The points were added edge by edge, in the order in which triangles first use the edges.
        let begins = beginnings(&own, mesh.positions.len());
        out.triangles.reserve(triangles);
        out.triangle_materials.reserve(triangles);
        let mut next = 0;
        for (t, &material) in mesh.triangle_materials.iter().enumerate() {
            if plan.touched.get(next) != Some(&(t as u32)) {
                out.triangles.push(mesh.triangles[t]);
                out.triangle_materials.push(material);
                continue;
            }
            let (i, patch, slopes) = (next, &patches[next], &slopes[next]);
            next += 1;
            let first_inside = out.positions.len() as u32;
            let corners = plan.corners(i).map(|v| v as usize);
            out.positions.extend_from_slice(&slopes.inside_positions);
            out.normals.extend_from_slice(&slopes.inside_normals);
            for &w in &patch.diced.interior {
                push_attributes(&mut out, mesh, corners, w);
            }
            let first = patch.borders.first();
            let global = |local: u32| match local {
                0..3 => plan.corners(i)[local as usize],
                _ if local >= first[3] => first_inside + (local - first[3]),
                _ => {
                    let e = (1..3).rev().find(|&e| local >= first[e]).unwrap_or(0);
                    begins[own.of[i][e] as usize] + (local - first[e])
                }
            };
            out.triangles.extend(patch.diced.triangles.iter().map(|t| t.map(global)));
            out.triangle_materials.resize(out.triangles.len(), material);
        }
        Ok(out)
    }
}

/// The number of the first vertex on each edge. The edges' vertices start at `next`, in the order in which triangles first
/// use the edges.
fn beginnings(edges: &Edges, mut next: usize) -> Vec<u32> {
    let mut begins = vec![u32::MAX; edges.ends.len()];
    for &edge in edges.of.as_flattened() {
        let edge = edge as usize;
        if begins[edge] == u32::MAX {
            begins[edge] = next as u32;
            next += edges.first[edge + 1] - edges.first[edge];
        }
    }
    begins
}

fn unit_or(vector: [f64; 3], otherwise: [f32; 3]) -> DVec3 {
    DVec3::from(vector).try_normalize().unwrap_or(DVec3::from(otherwise.map(f64::from)))
}

/// Adds a vertex's interpolated attributes except position and normal.
fn push_attributes(out: &mut Mesh, mesh: &Mesh, vertices: [usize; 3], weights: [f64; 3]) {
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
