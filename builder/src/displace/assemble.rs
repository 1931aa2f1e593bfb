//! Assembles the whole displaced mesh from its patches.

use rayon::prelude::*;

use super::border::{Border, push_attributes};
use super::patch::Patch;
use super::plan::Plan;
use super::slope::Slopes;
use super::weld::Edges;
use crate::mesh::MAX_ELEMENTS;
use crate::{BuildError, Mesh};

/// The displaced mesh. `patches` are whole.
pub(super) fn whole(plan: &Plan<'_>, patches: &[Patch]) -> Result<Mesh, BuildError> {
    let mesh = plan.mesh;
    let corner_lists: Vec<[u32; 3]> = (0..patches.len()).map(|i| plan.corners(i)).collect();
    let mut own = Edges::of(&corner_lists, &plan.vertices.place, |v| v);
    own.number_points(|i, e| plan.segments(i, e));
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

    let border = Border::of(plan);
    let slopes: Vec<Slopes> =
        patches.par_iter().enumerate().map(|(i, p)| Slopes::of(plan, i, p, &border.moved)).collect();
    let mut out = Mesh { materials: mesh.materials.clone(), warnings: mesh.warnings.clone(), ..Mesh::default() };
    // Order of the vertices: those of the mesh, then the points on edges, then those inside patches.
    (out.positions, out.normals) = (0..mesh.positions.len()).into_par_iter().map(|v| border.corner(plan, v)).unzip();
    out.uvs.clone_from(&mesh.uvs);
    out.colors.clone_from(&mesh.colors);
    out.tangents.clone_from(&mesh.tangents);
    let mut done = vec![false; own.ends.len()];
    for i in 0..patches.len() {
        for e in 0..3 {
            if !std::mem::replace(&mut done[own.of[i][e] as usize], true) {
                for k in 0..plan.segments(i, e) as usize - 1 {
                    border.point(plan, i, e, k).push(&mut out, mesh);
                }
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
        let inside = patch.inside();
        let global = |local: u32| match local as usize {
            corner @ 0..3 => plan.corners(i)[corner],
            local if local >= inside => first_inside + (local - inside) as u32,
            local => {
                let (e, k) = patch.borders.edge_of(local);
                begins[own.of[i][e] as usize] + k as u32
            }
        };
        out.triangles.extend(patch.diced.triangles.iter().map(|t| t.map(global)));
        out.triangle_materials.resize(out.triangles.len(), material);
    }
    Ok(out)
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
