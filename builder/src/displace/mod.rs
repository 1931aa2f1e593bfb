//! Displacement: moves surfaces along their normals by the height maps of their materials.
//!
//! Triangles with a height map are cut into small ones (diced), and their vertices are moved. Three rules keep a closed mesh
//! closed:
//! 1. How an edge is cut depends only on its length and on the cell sizes of the triangles with height maps around it. So
//!    all triangles at the edge, including those without a height map, are cut in the same way there.
//! 2. All vertices at one place move together, to where the moved surfaces meet. Surfaces without a height map stay in their
//!    planes as far as possible (`displace/join.rs`).
//! 3. The new position of a place is computed only once.
//!
//! A mesh is displaced whole ([`displace`]), or box by box while it is built (`displace/parts.rs`), with the same result in every
//! bit. All triangles are diced to the same cells, so the boxes fit whatever they are: there are no levels of dicing between which
//! the surface could tear.
//!
//! The new normals are those of the mesh minus the slope of the displacement, `N - grad d`, brought to unit length. The slope
//! is averaged over the small triangles around a vertex that share its normal. On a flat surface this is the normal of the
//! displaced surface; where the mesh's normals smooth its facets, the new normals do so, too.

mod assemble;
mod border;
mod dice;
mod join;
mod options;
mod parts;
mod patch;
mod plan;
mod slope;
mod weld;

use rayon::prelude::*;

use crate::mesh::maps::HeightMap;
use crate::{BuildError, Mesh};

use dice::Dicer;
pub use options::DisplaceOptions;
pub(crate) use parts::{Bounds, Parts, Tiles};
use patch::Patch;
use plan::Plan;
use weld::Vertices;

/// Moves the surfaces of `mesh` that have a height map along their interpolated normals. The new mesh has the same materials
/// and attributes. If nothing moves, it is a copy of `mesh` with a warning.
///
/// # Errors
/// If `mesh` is not valid, if it has height maps but no texture coordinates, if an option is out of its range, or if the new
/// mesh would exceed [`MAX_ELEMENTS`](crate::import::MAX_ELEMENTS).
pub fn displace(mesh: &Mesh, options: &DisplaceOptions) -> Result<Mesh, BuildError> {
    displace_with(mesh, options, true)
}

fn displace_with(mesh: &Mesh, options: &DisplaceOptions, weld: bool) -> Result<Mesh, BuildError> {
    match Source::new(mesh, options, weld)? {
        Some(source) => carry_out(source.plan(options)),
        None => {
            let mut same = mesh.clone();
            same.warnings.push(NOTHING_MOVES.into());
            Ok(same)
        }
    }
}

/// The approximate number of triangles that [`displace`] would make of `mesh` if
/// [`max_triangles`](DisplaceOptions::max_triangles) did not limit it, within 10 %: tells whether the mesh fits
/// into memory as a whole, or is better built by [`build_displaced_file`](crate::build_displaced_file). Always the same for the same
/// mesh and options.
///
/// # Errors
/// Those of [`displace`].
pub fn displaced_triangles(mesh: &Mesh, options: &DisplaceOptions) -> Result<f64, BuildError> {
    /// Small triangles that are looked at, at least: so many make the error small in a mesh of few triangles.
    const SAMPLES: usize = 1 << 15;
    let Some(source) = Source::new(mesh, options, true)? else { return Ok(mesh.triangles.len() as f64) };
    let mut plan = source.plan(options);
    plan.cut(1.0);
    let samples = SAMPLES.div_ceil(plan.touched.len().max(1)) as u32;
    let counts: Vec<f64> = (0..plan.touched.len())
        .into_par_iter()
        .map_init(Dicer::default, |dicer, i| {
            // A seed of the triangle's own, so that the result does not depend on the number of threads.
            dicer.estimate(plan.positions_of(i), &plan.borders(i), plan.step(i), samples, i as u64)
        })
        .collect();
    Ok(counts.iter().sum::<f64>() + (mesh.triangles.len() - plan.touched.len()) as f64)
}

/// The warning if no surface moves.
const NOTHING_MOVES: &str =
    "nothing was displaced: no triangle has a height map with an amplitude or bias other than 0";

/// A mesh with height maps, checked and ready to be planned.
pub(crate) struct Source {
    /// With normals.
    pub(crate) mesh: Mesh,
    vertices: Vertices,
    /// For each material, whether it moves.
    moving: Vec<bool>,
}

impl Source {
    /// `None` if no surface moves. `weld`: see [`Vertices::of`].
    pub(crate) fn new(mesh: &Mesh, options: &DisplaceOptions, weld: bool) -> Result<Option<Self>, BuildError> {
        options.check()?;
        mesh.validate().map_err(|e| BuildError::Mesh(e.to_string()))?;
        let moves = |map: &HeightMap| options.scale != 0.0 && (map.amplitude != 0.0 || map.bias != 0.0);
        let moving: Vec<bool> = mesh.materials.iter().map(|m| m.height_map.as_ref().is_some_and(moves)).collect();
        if !mesh.triangle_materials.iter().any(|&m| moving[m as usize]) {
            return Ok(None);
        }
        options.check_reach(mesh)?;
        if mesh.uvs.is_empty() {
            return Err(BuildError::Mesh("it has height maps, but no texture coordinates to read them with".into()));
        }
        let mut mesh = mesh.clone();
        if mesh.normals.is_empty() {
            mesh.normals = vec![[0.0; 3]; mesh.positions.len()];
            mesh.fill_missing_normals();
        }
        let vertices = Vertices::of(&mesh, weld);
        Ok(Some(Self { mesh, vertices, moving }))
    }

    fn plan<'a>(&'a self, options: &'a DisplaceOptions) -> Plan<'a> {
        Plan::new(&self.mesh, &self.vertices, &self.moving, options)
    }
}

/// Dices and displaces, with larger cells if there would be too many triangles.
fn carry_out(mut plan: Plan<'_>) -> Result<Mesh, BuildError> {
    let limit = plan.options.max_triangles as f64;
    let mut factor = 1.0;
    loop {
        let mut count = plan.estimate(factor);
        // Larger cells cannot reduce the number below that of the triangles to dice.
        let least = plan.touched.len();
        if count <= limit || count <= least as f64 {
            plan.cut(factor);
            let patches: Vec<Patch> = (0..least)
                .into_par_iter()
                .map_init(Dicer::default, |dicer, i| Patch::new(&plan, dicer, i, |_| true))
                .collect();
            let found = patches.iter().map(|p| p.diced.triangles.len()).sum::<usize>();
            if found as f64 <= limit || found <= least {
                let mut mesh = assemble::whole(&plan, &patches)?;
                if factor > 1.0 {
                    let (cell, limit) = (plan.options.cell, plan.options.max_triangles);
                    mesh.warnings.push(format!(
                        "displacement in cells of {cell} would need more than {limit} triangles; the cells are made {factor:.2} times larger"
                    ));
                }
                return Ok(mesh);
            }
            count = found as f64;
        }
        factor *= (count / limit).sqrt().max(1.05);
    }
}

#[cfg(test)]
pub(crate) mod tests;
