//! A displaced mesh that is never whole in memory: any box of it can be made alone, in every bit as the whole mesh has it there.
//!
//! Two things make that possible. What triangles share is computed once ([`Border`]). And the cuts of a triangle are a tree: a
//! walk through it leaves out the parts that are farther from the box than the surface can move, and what is left is cut as
//! without leaving out.

use glam::DVec3;
use rayon::prelude::*;

use super::Source;
use super::border::{Border, push_attributes};
use super::dice::{Dicer, Part};
use super::options::DisplaceOptions;
use super::patch::{Normals, Patch};
use super::plan::Plan;
use super::slope::Slopes;
use crate::Mesh;
use crate::surface::prepared::{has_area, unit_scale};

/// Tiles whose extents are found at once.
const CHUNK: usize = 512;
/// Allows for rounding where lengths are compared.
const ROUNDING: f64 = 1.0 + 1e-5;

/// A displaced mesh, made part by part.
pub(crate) struct Parts<'a> {
    plan: Plan<'a>,
    border: Border,
    /// For each touched triangle, how far it moves at most along each axis.
    reach: Vec<DVec3>,
    /// How many small triangles beyond a box are displaced for the slopes in it: 1.
    pub(crate) ring: f64,
}

/// Part of a triangle of the mesh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tile {
    /// The triangle.
    pub(crate) triangle: u32,
    /// Bounds after displacement, relative to [`Tiles::origin`].
    low: [f32; 3],
    high: [f32; 3],
    /// Approximate number of small triangles.
    pub(crate) count: f32,
}

/// Tiles that cover the mesh.
pub(crate) struct Tiles {
    origin: DVec3,
    /// In the order of their triangles.
    pub(crate) list: Vec<Tile>,
}

/// A box, in mesh space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub(crate) low: DVec3,
    pub(crate) high: DVec3,
}

impl Bounds {
    pub(crate) const NONE: Self = Self { low: DVec3::MAX, high: DVec3::MIN };

    fn of(points: &[DVec3; 3]) -> Self {
        let [a, b, c] = *points;
        Self { low: a.min(b).min(c), high: a.max(b).max(c) }
    }

    fn grown(self, by: DVec3) -> Self {
        Self { low: self.low - by, high: self.high + by }
    }

    fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    fn contains(&self, other: &Self) -> bool {
        self.low.cmple(other.low).all() && other.high.cmple(self.high).all()
    }

    fn join(self, other: &Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

impl Tiles {
    pub(crate) fn meets(&self, tile: u32, bounds: &Bounds) -> bool {
        self.bounds(&self.list[tile as usize]).meets(bounds)
    }

    fn bounds(&self, tile: &Tile) -> Bounds {
        let at = |p: [f32; 3]| self.origin + DVec3::from(p.map(f64::from));
        Bounds { low: at(tile.low), high: at(tile.high) }
    }

    fn tile(&self, triangle: u32, bounds: &Bounds, count: f64) -> Tile {
        let low = (bounds.low - self.origin).to_array().map(|x| (x as f32).next_down());
        let high = (bounds.high - self.origin).to_array().map(|x| (x as f32).next_up());
        Tile { triangle, low, high, count: count as f32 }
    }
}

impl<'a> Parts<'a> {
    /// With the cells of `options`, however many triangles that makes.
    pub(crate) fn new(source: &'a Source, options: &'a DisplaceOptions) -> Self {
        let mut plan = source.plan(options);
        plan.cut(1.0);
        let border = Border::of(&plan);
        // Largest height of each material's map; inside a triangle no vertex moves further.
        let highest: Vec<f64> = (source.mesh.materials.iter())
            .map(|m| m.height_map.as_ref().map_or(0.0, |map| f64::from(map.largest()) * options.scale.abs()))
            .collect();
        // Vertices inside are computed in two ways, from the ends of their side and from their weights.
        let rounding = farthest(&source.mesh) * 1e-12;
        let reach = (0..plan.touched.len())
            .into_par_iter()
            .map(|i| {
                let material = source.mesh.triangle_materials[plan.touched[i] as usize] as usize;
                let inside = if plan.facets[i].height_map.is_some() { highest[material] } else { 0.0 };
                (Normals::of(&plan, i).most() * inside).max(border.reach(&plan, i)) * ROUNDING + rounding
            })
            .collect();
        Self { plan, border, reach, ring: 1.0 }
    }

    fn mesh(&self) -> &'a Mesh {
        self.plan.mesh
    }

    /// The number of a triangle among the touched ones.
    fn touched(&self, triangle: u32) -> Option<usize> {
        self.plan.touched.binary_search(&triangle).ok()
    }

    /// The corners of a triangle that is not diced.
    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.mesh().triangles[triangle as usize].map(|v| self.border.corner(&self.plan, v as usize).0.into())
    }

    /// Cuts the mesh into tiles of at most `most` segments on a side.
    pub(crate) fn tiles(&self, most: u32) -> Tiles {
        let mut tiles = Tiles { origin: self.mesh().positions[0].into(), list: Vec::new() };
        tiles.list = (0..self.mesh().triangles.len() as u32)
            .into_par_iter()
            .map_init(Dicer::default, |dicer, triangle| {
                let Some(i) = self.touched(triangle) else {
                    return vec![tiles.tile(triangle, &Bounds::of(&self.corners(triangle)), 1.0)];
                };
                let (mut found, step) = (Vec::new(), self.plan.step(i));
                dicer.walk(self.plan.positions_of(i), &self.plan.borders(i), step, |part| {
                    if part.most() > most {
                        return true;
                    }
                    let [a, b, c] = part.positions;
                    let count = 1.7 * (b - a).cross(c - a).length() / (step * step);
                    let around = part.segments.iter().sum::<u32>() - 2;
                    let bounds = Bounds::of(&part.positions).grown(self.reach[i]);
                    found.push(tiles.tile(triangle, &bounds, count.max(f64::from(around))));
                    false
                });
                found
            })
            .flatten_iter()
            .collect();
        tiles
    }

    /// The bounds of the triangles that have an area: exactly those of the whole displaced mesh.
    ///
    /// Only tiles that may reach beyond what was found before are diced.
    pub(crate) fn bounds(&self, tiles: &Tiles) -> Bounds {
        let mut best = Bounds::NONE;
        let scale = unit_scale(farthest(self.mesh()));
        // Neighbours are alike, so from all over the mesh.
        let order: Vec<usize> = (0..64).flat_map(|k| (k..tiles.list.len()).step_by(64)).collect();
        for chunk in order.chunks(CHUNK) {
            let found = (chunk.par_iter())
                .map_init(Dicer::default, |dicer, &k| self.bounds_of(dicer, tiles, &tiles.list[k], &best, scale))
                .reduce(|| Bounds::NONE, |a, b| a.join(&b));
            best = best.join(&found);
        }
        best
    }

    /// The bounds of the triangles with an area in a tile; those that are surely within `known` may be left out.
    fn bounds_of(&self, dicer: &mut Dicer, tiles: &Tiles, tile: &Tile, known: &Bounds, scale: f64) -> Bounds {
        let mut found = Bounds::NONE;
        let bounds = tiles.bounds(tile);
        if known.contains(&bounds) {
            return found;
        }
        let mut add = |corners: [DVec3; 3]| {
            if has_area(&corners.map(|p| p * scale)) {
                found = found.join(&Bounds::of(&corners));
            }
        };
        let Some(i) = self.touched(tile.triangle) else {
            add(self.corners(tile.triangle));
            return found;
        };
        let reach = self.reach[i];
        let here = bounds.grown(-reach);
        let patch = Patch::new(&self.plan, dicer, i, |part| {
            let of_part = Bounds::of(&part.positions);
            of_part.meets(&here) && !known.contains(&of_part.grown(reach))
        });
        let (corners, normals) = (self.plan.positions_of(i), Normals::of(&self.plan, i));
        let position = |local: u32| match local as usize {
            local if local < patch.inside() => self.on_border(i, &patch, local).into(),
            local => {
                let (position, normal, height) = patch.vertex_inside(&corners, &normals, local - patch.inside());
                position + normal * height
            }
        };
        patch.diced.triangles.iter().for_each(|t| add(t.map(position)));
        found
    }

    /// Where a local vertex at a corner or on an edge is moved to.
    fn on_border(&self, i: usize, patch: &Patch, local: usize) -> [f64; 3] {
        if local < 3 {
            return self.border.corner(&self.plan, self.plan.corners(i)[local] as usize).0;
        }
        let (e, k) = patch.borders.edge_of(local);
        self.border.point(&self.plan, i, e, k).position
    }

    /// The displaced triangles whose bounds meet a box, of these triangles of the mesh (ascending), in the order of the whole
    /// displaced mesh. Without warnings. Triangles of the mesh share no vertices here.
    pub(crate) fn within(&self, triangles: &[u32], bounds: &Bounds) -> Mesh {
        let mut out = Mesh { materials: self.mesh().materials.clone(), ..Mesh::default() };
        let mut dicer = Dicer::default();
        for &triangle in triangles {
            let before = out.triangles.len();
            match self.touched(triangle) {
                Some(i) => self.push_patch(&mut out, &mut dicer, i, bounds),
                None if Bounds::of(&self.corners(triangle)).meets(bounds) => {
                    let first = out.positions.len() as u32;
                    for v in self.mesh().triangles[triangle as usize] {
                        self.push_corner(&mut out, v as usize);
                    }
                    out.triangles.push([first, first + 1, first + 2]);
                }
                None => {}
            }
            if out.triangles.len() > before {
                let material = self.mesh().triangle_materials[triangle as usize];
                out.triangle_materials.resize(out.triangles.len(), material);
            }
        }
        out
    }

    fn push_patch(&self, out: &mut Mesh, dicer: &mut Dicer, i: usize, bounds: &Bounds) {
        let step = self.plan.step(i) * ROUNDING;
        // The small triangles that meet the box lie within the reach of the displacement before it. The slope at a vertex
        // inside needs all triangles around: those of one step more. Without a step there are no vertices inside.
        let ring = if step.is_finite() { step * self.ring } else { 0.0 };
        let near = bounds.grown(self.reach[i] + DVec3::splat(ring));
        let patch = Patch::new(&self.plan, dicer, i, |part: &Part| Bounds::of(&part.positions).meets(&near));
        if patch.diced.triangles.is_empty() {
            return;
        }
        let slopes = Slopes::of(&self.plan, i, &patch, &self.border.moved);
        let inside = patch.inside();
        let mut numbers = vec![u32::MAX; inside + patch.diced.interior.len()];
        let corners = self.plan.corners(i).map(|v| v as usize);
        for t in &patch.diced.triangles {
            let t = t.map(|v| v as usize);
            let position = |local: usize| match local.checked_sub(inside) {
                Some(k) => slopes.inside_positions[k],
                None => self.on_border(i, &patch, local),
            };
            if !Bounds::of(&t.map(|v| position(v).into())).meets(bounds) {
                continue;
            }
            for local in t {
                if numbers[local] != u32::MAX {
                    continue;
                }
                numbers[local] = out.positions.len() as u32;
                if local < 3 {
                    self.push_corner(out, corners[local]);
                } else if let Some(k) = local.checked_sub(inside) {
                    out.positions.push(slopes.inside_positions[k]);
                    out.normals.push(slopes.inside_normals[k]);
                    push_attributes(out, self.mesh(), corners, patch.diced.interior[k]);
                } else {
                    let (e, k) = patch.borders.edge_of(local);
                    self.border.point(&self.plan, i, e, k).push(out, self.mesh());
                }
            }
            out.triangles.push(t.map(|local| numbers[local]));
        }
    }

    fn push_corner(&self, out: &mut Mesh, v: usize) {
        let mesh = self.mesh();
        let (position, normal) = self.border.corner(&self.plan, v);
        out.positions.push(position);
        out.normals.push(normal);
        out.uvs.push(mesh.uvs[v]);
        out.colors.extend(mesh.colors.get(v));
        out.tangents.extend(mesh.tangents.get(v));
    }

    /// Bytes in memory, without the mesh.
    pub(crate) fn bytes(&self) -> usize {
        let plan = &self.plan;
        self.border.bytes() + 24 * self.reach.len() + plan.touched.len() * (4 + 32 + 12) + plan.places.ends.len() * 28
    }
}

/// The largest absolute coordinate.
fn farthest(mesh: &Mesh) -> f64 {
    mesh.positions.as_flattened().iter().fold(0.0, |most, x| most.max(x.abs()))
}
