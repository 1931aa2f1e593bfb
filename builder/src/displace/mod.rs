//! Displacement: surfaces moved along their normals by the height maps of their materials.
//!
//! Triangles with a height map are cut into small ones (diced) and their vertices moved. Three rules keep a closed mesh
//! closed. How an edge is cut depends on that edge alone: on its length and on the cell sizes of the triangles with height
//! maps around it, so that all its triangles, also those without a height map, are cut alike there. All vertices at one place
//! move together, to where the moved surfaces meet, those without a height map staying in their planes as far as can be
//! (`displace/join.rs`). And where they end up is computed once per place.
//!
//! Normals are those of the mesh, leaned against the slope of the displacement: `N - grad d`, brought to unit length, with
//! the slope averaged over the small triangles around a vertex that share its normal. Where the surface is flat this is the
//! normal of the displaced surface; where the mesh's normals round off its facets, they still do.

mod dice;
mod join;
mod weld;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::import::{MAX_ELEMENTS, fill_missing_normals};
use crate::mesh::maps::HeightMap;
use crate::{BuildError, Mesh};

use dice::{Borders, Diced, Dicer, segments};
use join::Moved;
use weld::{Edges, Vertices};

/// How [`displace`] works.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplaceOptions {
    /// Factor of all height maps' amplitudes and biases. Finite.
    pub scale: f64,
    /// Longest side of the small triangles in mesh units, where the texels of the height map are not larger. Above zero.
    pub cell: f64,
    /// Most triangles that those with height maps and their neighbours may become; beyond that, cells are made larger, with
    /// a warning. At least 1.
    pub max_triangles: usize,
}

/// Limit of [`DisplaceOptions::for_levels`].
const MAX_TRIANGLES: usize = 1 << 24;

/// How far surfaces may move, by the mesh's largest extent: far beyond what anybody wants, and far below what overflows.
const MAX_REACH: f64 = 1000.0;

impl DisplaceOptions {
    /// Cells of two of the finest voxels of an octree of `levels` over `mesh`, at most 16.8 million triangles.
    #[must_use]
    pub fn for_levels(mesh: &Mesh, levels: u32, scale: f64) -> Self {
        let cell = 2.0 * extent(mesh).unwrap_or(1.0) * (-f64::from(levels)).exp2();
        Self { scale, cell: if cell > 0.0 { cell } else { 1.0 }, max_triangles: MAX_TRIANGLES }
    }

    fn check(&self) -> Result<(), BuildError> {
        let bad = |name, value: String, range| Err(BuildError::Setting { name, value, range });
        if !self.scale.is_finite() {
            return bad("displacement scale", format!("{:?}", self.scale), "a finite number");
        }
        if !(self.cell > 0.0 && self.cell.is_finite()) {
            return bad("displacement cell", format!("{:?}", self.cell), "above zero and finite");
        }
        if self.max_triangles == 0 || self.max_triangles > MAX_ELEMENTS {
            return bad("displacement triangles", self.max_triangles.to_string(), "between 1 and 134217728");
        }
        Ok(())
    }

    /// Refuses to move surfaces further than [`MAX_REACH`], which would be a mistake.
    fn check_reach(&self, mesh: &Mesh) -> Result<(), BuildError> {
        let Some(extent) = extent(mesh).filter(|&e| e > 0.0) else { return Ok(()) };
        let of = |map: &HeightMap| (f64::from(map.amplitude.abs()) + f64::from(map.bias.abs())) * self.scale.abs();
        let reach = mesh.materials.iter().filter_map(|m| m.height_map.as_ref()).map(of).fold(0.0, f64::max);
        if reach <= MAX_REACH * extent {
            return Ok(());
        }
        let value = format!("up to {reach:?} in a mesh whose largest extent is {extent:?}");
        Err(BuildError::Setting { name: "displacement", value, range: "at most 1000 times that extent" })
    }
}

/// The largest side of the mesh's bounding box.
fn extent(mesh: &Mesh) -> Option<f64> {
    mesh.bounds().map(|(low, high)| (DVec3::from(high) - DVec3::from(low)).max_element())
}

/// Moves the surfaces of `mesh` that have a height map along their interpolated normals (see the source's head for how). The
/// mesh returned has the materials of `mesh` and all its attributes; without height maps it is `mesh` itself and a warning.
///
/// # Errors
/// If `mesh` is not valid, if it has height maps but no texture coordinates, or if an option is out of range.
pub fn displace(mesh: &Mesh, options: &DisplaceOptions) -> Result<Mesh, BuildError> {
    displace_with(mesh, options, true)
}

fn displace_with(mesh: &Mesh, options: &DisplaceOptions, weld: bool) -> Result<Mesh, BuildError> {
    options.check()?;
    mesh.validate().map_err(|e| BuildError::Mesh(e.to_string()))?;
    let moves = |map: &HeightMap| options.scale != 0.0 && (map.amplitude != 0.0 || map.bias != 0.0);
    let moving: Vec<bool> = mesh.materials.iter().map(|m| m.height_map.as_ref().is_some_and(moves)).collect();
    if !mesh.triangle_materials.iter().any(|&m| moving[m as usize]) {
        let mut same = mesh.clone();
        same.warnings.push("nothing was displaced: no triangle has a height map of any height".into());
        return Ok(same);
    }
    options.check_reach(mesh)?;
    if mesh.uvs.is_empty() {
        return Err(BuildError::Mesh("it has height maps, but no texture coordinates to read them with".into()));
    }
    let mut mesh = mesh.clone();
    if mesh.normals.is_empty() {
        mesh.normals = vec![[0.0; 3]; mesh.positions.len()];
        fill_missing_normals(&mut mesh);
    }
    let vertices = Vertices::of(&mesh, weld);
    let plan = Plan::new(&mesh, &vertices, &moving, options);
    plan.carry_out()
}

/// A triangle as the dicing sees it.
struct Facet<'a> {
    height_map: Option<&'a HeightMap>,
    /// Longest side wanted, in mesh units; infinite without a height map.
    step: f64,
    /// Texels of the height map per mesh unit, in the direction where they are densest.
    density: f64,
}

/// What is to be done, before the number of triangles is known.
struct Plan<'a> {
    mesh: &'a Mesh,
    vertices: &'a Vertices,
    options: &'a DisplaceOptions,
    /// Triangles with a place that moves.
    touched: Vec<u32>,
    facets: Vec<Facet<'a>>,
    places: Edges,
    /// Per edge of `places`: the shortest step of the triangles with height maps around it.
    edge_steps: Vec<f64>,
}

impl<'a> Plan<'a> {
    fn new(mesh: &'a Mesh, vertices: &'a Vertices, moving: &[bool], options: &'a DisplaceOptions) -> Self {
        let moves = |t: usize| moving[mesh.triangle_materials[t] as usize];
        let mut active = vec![false; vertices.positions.len()];
        for (t, corners) in mesh.triangles.iter().enumerate() {
            if moves(t) {
                corners.iter().for_each(|&v| active[vertices.place[v as usize] as usize] = true);
            }
        }
        let is_touched = |t: &[u32; 3]| t.iter().any(|&v| active[vertices.place[v as usize] as usize]);
        let touched: Vec<u32> =
            (0..mesh.triangles.len() as u32).filter(|&t| is_touched(&mesh.triangles[t as usize])).collect();
        let corner_lists: Vec<[u32; 3]> = touched.iter().map(|&t| mesh.triangles[t as usize]).collect();
        let places = Edges::of(&corner_lists, &vertices.place, |v| vertices.place[v as usize]);
        let facets: Vec<Facet<'_>> = (touched.par_iter())
            .map(|&t| {
                let t = t as usize;
                let material = &mesh.materials[mesh.triangle_materials[t] as usize];
                let height_map = material.height_map.as_ref().filter(|_| moves(t));
                let density = height_map.map_or(0.0, |map| texel_density(mesh, t, map));
                // Where the height does not change there is no need to cut.
                let step = if density > 0.0 { options.cell.max(1.0 / density) } else { f64::INFINITY };
                Facet { height_map, step, density }
            })
            .collect();
        let mut edge_steps = vec![f64::INFINITY; places.ends.len()];
        for (facet, edges) in facets.iter().zip(&places.of) {
            for &edge in edges {
                edge_steps[edge as usize] = edge_steps[edge as usize].min(facet.step);
            }
        }
        Self { mesh, vertices, options, touched, facets, places, edge_steps }
    }

    fn corners(&self, i: usize) -> [u32; 3] {
        self.mesh.triangles[self.touched[i] as usize]
    }

    fn places_of(&self, i: usize) -> [u32; 3] {
        self.corners(i).map(|v| self.vertices.place[v as usize])
    }

    fn positions_of(&self, i: usize) -> [DVec3; 3] {
        self.places_of(i).map(|p| self.vertices.positions[p as usize])
    }

    /// Roughly how many triangles there will be with all steps times `factor`.
    fn estimate(&self, factor: f64) -> f64 {
        let count = |i: usize| {
            let [a, b, c] = self.positions_of(i);
            let lengths = [a.distance(b), b.distance(c), c.distance(a)];
            let segments =
                |e: usize| (lengths[e] / (self.edge_steps[self.places.of[i][e] as usize] * factor)).ceil().max(1.0);
            let around = segments(0) + segments(1) + segments(2) - 2.0;
            let step = self.facets[i].step * factor;
            around.max(1.7 * (b - a).cross(c - a).length() / (step * step))
        };
        // In pieces of a fixed size, so that the sum does not depend on the threads.
        let chunks: Vec<f64> = (0..self.touched.len().div_ceil(1024))
            .into_par_iter()
            .map(|k| (k * 1024..((k + 1) * 1024).min(self.touched.len())).map(count).sum())
            .collect();
        chunks.iter().sum()
    }

    /// Dices and displaces, with larger cells if it would be too many.
    fn carry_out(mut self) -> Result<Mesh, BuildError> {
        let limit = self.options.max_triangles as f64;
        let mut factor = 1.0;
        loop {
            let mut count = self.estimate(factor);
            // What no cell size can change is not held against it.
            let least = self.touched.len() as f64;
            if count <= limit || count <= least {
                let work = Work::new(&mut self, factor);
                let found = work.pieces.iter().map(|p| p.diced.triangles.len()).sum::<usize>();
                if found as f64 <= limit || found <= work.plan.touched.len() {
                    let mut mesh = work.finish()?;
                    if factor > 1.0 {
                        let (cell, limit) = (self.options.cell, self.options.max_triangles);
                        mesh.warnings.push(format!(
                            "displacement in cells of {cell} would need more than {limit} triangles; they are {factor:.2} times as large"
                        ));
                    }
                    return Ok(mesh);
                }
                count = found as f64;
            }
            factor *= (count / limit).sqrt().max(1.05);
        }
    }
}

/// Texels of `map` per mesh unit on triangle `t`, in the direction where they are densest; 0 where the triangle has no area.
fn texel_density(mesh: &Mesh, t: usize, map: &HeightMap) -> f64 {
    let corners = mesh.triangles[t].map(|v| v as usize);
    let [a, b, c] = corners.map(|v| DVec3::from(mesh.positions[v]));
    let [ua, ub, uc] = corners.map(|v| {
        let [u, v] = map.uv_transform.apply(mesh.uvs[v]).map(f64::from);
        DVec2::new(u, v)
    });
    let full = &map.texture.mips[0];
    let size = DVec2::new(f64::from(full.width), f64::from(full.height));
    let (d1, d2) = ((ub - ua) * size, (uc - ua) * size);
    // The triangle in its plane: along its first edge, and across.
    let (e1, e2) = (b - a, c - a);
    let x1 = e1.length();
    let x2 = e2.dot(e1) / x1;
    let y2 = e1.cross(e2).length() / x1;
    // Derivatives of the texel coordinates by those two, and the larger singular value of the matrix they make.
    let p = d1 / x1;
    let q = (d2 - p * x2) / y2;
    let (square, mixed) = (p.length_squared() + q.length_squared(), p.perp_dot(q));
    let density = (0.5 * (square + (square * square - 4.0 * mixed * mixed).max(0.0).sqrt())).sqrt();
    if density.is_finite() { density } else { 0.0 }
}

/// A touched triangle, diced.
struct Piece {
    borders: Borders,
    diced: Diced,
    /// At its corners and the points on its edges: its normal, and how far along it the triangle asks them to move; empty
    /// without a height map.
    wishes: Vec<(DVec3, f64)>,
    /// Displacement of the vertices inside along their normals; empty without a height map.
    heights: Vec<f32>,
}

/// Everything diced, at a given factor of the steps.
struct Work<'p, 'a> {
    plan: &'p Plan<'a>,
    pieces: Vec<Piece>,
    /// Per edge of `plan.places`.
    segments: Vec<u32>,
}

impl<'p, 'a> Work<'p, 'a> {
    fn new(plan: &'p mut Plan<'a>, factor: f64) -> Self {
        let position = |p: u32| plan.vertices.positions[p as usize];
        let edge_segments: Vec<u32> = (plan.places.ends.iter().zip(&plan.edge_steps))
            .map(|(&[a, b], step)| segments(position(a).distance(position(b)), step * factor))
            .collect();
        let of = plan.places.of.clone();
        plan.places.number_points(|i, e| edge_segments[of[i][e] as usize]);
        let plan: &Plan<'a> = plan;
        let pieces = (0..plan.touched.len())
            .into_par_iter()
            .map_init(Dicer::default, |dicer, i| piece(plan, dicer, i, &edge_segments, factor))
            .collect();
        Self { plan, pieces, segments: edge_segments }
    }

    /// Vertices moved and normals leaned: the mesh.
    fn finish(self) -> Result<Mesh, BuildError> {
        let Self { plan, pieces, segments } = &self;
        let (mesh, vertices) = (plan.mesh, plan.vertices);
        let corner_lists: Vec<[u32; 3]> = (0..pieces.len()).map(|i| plan.corners(i)).collect();
        let of_edge = |i: usize, e: usize| segments[plan.places.of[i][e] as usize];
        let mut smooth = Edges::of(&corner_lists, &vertices.place, |v| vertices.smooth[v as usize]);
        smooth.number_points(of_edge);
        let mut own = Edges::of(&corner_lists, &vertices.place, |v| v);
        own.number_points(of_edge);
        let inside: usize = pieces.iter().map(|p| p.diced.interior.len()).sum();
        let triangles =
            mesh.triangles.len() - pieces.len() + pieces.iter().map(|p| p.diced.triangles.len()).sum::<usize>();
        let total = mesh.positions.len() + own.points() + inside;
        if total.max(triangles) > MAX_ELEMENTS {
            return Err(BuildError::Mesh(format!(
                "displaced, it has {} triangles and vertices; the limit is {MAX_ELEMENTS}; choose larger cells",
                total.max(triangles)
            )));
        }

        let moved = Moved::together(plan, pieces);
        let slopes: Vec<Slopes> = pieces.par_iter().enumerate().map(|(i, p)| Slopes::of(plan, i, p, &moved)).collect();
        let mut corner_slopes = vec![Slope::default(); vertices.smooth_count];
        let mut point_slopes = vec![Slope::default(); smooth.points()];
        for (i, (piece, slopes)) in pieces.iter().zip(&slopes).enumerate() {
            for (k, v) in plan.corners(i).into_iter().enumerate() {
                corner_slopes[vertices.smooth[v as usize] as usize].add(&slopes.border[k]);
            }
            for (e, &edge) in smooth.of[i].iter().enumerate() {
                let (first, local) = (smooth.first[edge as usize], piece.borders.first()[e] as usize);
                for j in 0..piece.borders.segments[e] as usize - 1 {
                    point_slopes[first + j].add(&slopes.border[local + j]);
                }
            }
        }

        let mut out = Mesh { materials: mesh.materials.clone(), warnings: mesh.warnings.clone(), ..Mesh::default() };
        // Vertices of the mesh first, then points on edges, then those inside.
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
        for i in 0..pieces.len() {
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
        // Points are pushed edge by edge in the order of first use: where each edge begins.
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
            let (i, piece, slopes) = (next, &pieces[next], &slopes[next]);
            next += 1;
            let first_inside = out.positions.len() as u32;
            let corners = plan.corners(i).map(|v| v as usize);
            out.positions.extend_from_slice(&slopes.inside_positions);
            out.normals.extend_from_slice(&slopes.inside_normals);
            for &w in &piece.diced.interior {
                push_attributes(&mut out, mesh, corners, w);
            }
            let first = piece.borders.first();
            let global = |local: u32| match local {
                0..3 => plan.corners(i)[local as usize],
                _ if local >= first[3] => first_inside + (local - first[3]),
                _ => {
                    let e = (1..3).rev().find(|&e| local >= first[e]).unwrap_or(0);
                    begins[own.of[i][e] as usize] + (local - first[e])
                }
            };
            out.triangles.extend(piece.diced.triangles.iter().map(|t| t.map(global)));
            out.triangle_materials.resize(out.triangles.len(), material);
        }
        Ok(out)
    }
}

/// Number of the first vertex on each edge, where edges follow each other in the order in which triangles first use them.
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

/// Dices touched triangle `i` and reads the heights of its vertices.
fn piece(plan: &Plan<'_>, dicer: &mut Dicer, i: usize, segments: &[u32], factor: f64) -> Piece {
    let places = plan.places_of(i);
    let facet = &plan.facets[i];
    let borders = Borders {
        segments: plan.places.of[i].map(|edge| segments[edge as usize]),
        reversed: std::array::from_fn(|e| places[e] > places[(e + 1) % 3]),
    };
    let positions = plan.positions_of(i);
    let step = facet.step * factor;
    let diced = dicer.dice(positions, &borders, step);
    let (mut wishes, mut heights) = (Vec::new(), Vec::new());
    if let Some(map) = facet.height_map {
        let corners = plan.corners(i).map(|v| v as usize);
        let footprint = if step.is_finite() { (step * facet.density) as f32 } else { 1.0 };
        let scale = plan.options.scale;
        let height = |w: [f64; 3]| {
            let uv = mix(&plan.mesh.uvs, corners, w).map(|x| x as f32);
            f64::from(map.sample(uv, footprint)) * scale
        };
        let normals = Normals::of(plan, i);
        wishes.extend(borders.all_weights().map(|w| (normals.at(w), height(w))));
        heights.extend(diced.interior.iter().map(|&w| height(w) as f32));
    }
    Piece { borders, diced, wishes, heights }
}

/// Shading normals on a triangle.
struct Normals {
    corners: [DVec3; 3],
    flat: DVec3,
}

impl Normals {
    fn of(plan: &Plan<'_>, i: usize) -> Self {
        let corners = plan.corners(i).map(|v| DVec3::from(plan.mesh.normals[v as usize].map(f64::from)));
        let [a, b, c] = plan.positions_of(i);
        Self { corners, flat: (b - a).cross(c - a).normalize_or_zero() }
    }

    /// The interpolated normal, of unit length (or zero, on a triangle without area whose normals cancel out).
    fn at(&self, [a, b, c]: [f64; 3]) -> DVec3 {
        (self.corners[0] * a + self.corners[1] * b + self.corners[2] * c).try_normalize().unwrap_or(self.flat)
    }
}

/// Slope of the displacement around a vertex, summed over small triangles by area.
#[derive(Clone, Copy, Debug, Default)]
struct Slope {
    gradient: DVec3,
    area: f64,
}

impl Slope {
    fn add(&mut self, other: &Self) {
        self.gradient += other.gradient;
        self.area += other.area;
    }

    /// The unit `normal` leaned against the slope; `as_it_was` if there is none.
    fn lean(&self, normal: DVec3, as_it_was: [f32; 3]) -> [f32; 3] {
        if self.gradient == DVec3::ZERO || self.area <= 0.0 {
            return as_it_was;
        }
        match (normal - self.gradient / self.area).try_normalize() {
            Some(n) => n.as_vec3().to_array(),
            None => as_it_was,
        }
    }
}

/// What a piece contributes to slopes at its border, and its finished vertices inside.
struct Slopes {
    border: Vec<Slope>,
    inside_positions: Vec<[f64; 3]>,
    inside_normals: Vec<[f32; 3]>,
}

impl Slopes {
    fn of(plan: &Plan<'_>, i: usize, piece: &Piece, moved: &Moved) -> Self {
        let normals = Normals::of(plan, i);
        let corners = plan.positions_of(i);
        let base = |w: [f64; 3]| corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
        let inside = piece.borders.first()[3] as usize;
        let count = inside + piece.diced.interior.len();
        let mut positions = Vec::with_capacity(count);
        let mut heights = Vec::with_capacity(count);
        for (local, w) in piece.borders.all_weights().enumerate() {
            positions.push(base(w));
            heights.push(normals.at(w).dot(moved.of(plan, i, piece, local)));
        }
        let mut inside_positions = Vec::with_capacity(count - inside);
        let mut inside_unit = Vec::with_capacity(count - inside);
        for (k, &w) in piece.diced.interior.iter().enumerate() {
            let height = piece.heights.get(k).map_or(0.0, |&h| f64::from(h));
            let (position, normal) = (base(w), normals.at(w));
            positions.push(position);
            heights.push(height);
            inside_positions.push((position + normal * height).to_array());
            inside_unit.push(normal);
        }
        let mut slopes = vec![Slope::default(); count];
        for t in &piece.diced.triangles {
            let t = t.map(|v| v as usize);
            let [a, b, c] = t.map(|v| positions[v]);
            let [ha, hb, hc] = t.map(|v| heights[v]);
            let area = 0.5 * (b - a).cross(c - a).dot(normals.flat);
            if area <= 0.0 {
                continue;
            }
            // Times the area: half of each height by the side opposite, turned inwards.
            let turned = (c - b) * ha + (a - c) * hb + (b - a) * hc;
            let slope = Slope { gradient: normals.flat.cross(turned) * 0.5, area };
            for v in t {
                slopes[v].add(&slope);
            }
        }
        let inside_normals =
            slopes[inside..].iter().zip(&inside_unit).map(|(s, n)| s.lean(*n, n.as_vec3().to_array())).collect();
        slopes.truncate(inside);
        Self { border: slopes, inside_positions, inside_normals }
    }
}

/// Weighted sum of an attribute over three vertices.
fn mix<const N: usize>(values: &[[f32; N]], vertices: [usize; 3], weights: [f64; 3]) -> [f64; N] {
    std::array::from_fn(|c| (0..3).map(|k| f64::from(values[vertices[k]][c]) * weights[k]).sum())
}

fn unit_or(vector: [f64; 3], otherwise: [f32; 3]) -> DVec3 {
    DVec3::from(vector).try_normalize().unwrap_or(DVec3::from(otherwise.map(f64::from)))
}

/// Interpolates everything but position and normal.
fn push_attributes(out: &mut Mesh, mesh: &Mesh, vertices: [usize; 3], weights: [f64; 3]) {
    out.uvs.push(mix(&mesh.uvs, vertices, weights).map(|x| x as f32));
    if !mesh.colors.is_empty() {
        out.colors.push(mix(&mesh.colors, vertices, weights).map(|x| x as f32));
    }
    if !mesh.tangents.is_empty() {
        let handed = vertices.map(|v| mesh.tangents[v][3]);
        let [x, y, z, _] = mix(&mesh.tangents, vertices, weights);
        let t = DVec3::new(x, y, z).normalize_or_zero().as_vec3();
        // Across a change of handedness there is no tangent: zero says so.
        let one = handed[0] != 0.0 && handed[0] == handed[1] && handed[1] == handed[2];
        out.tangents.push(if one { [t.x, t.y, t.z, handed[0]] } else { [0.0; 4] });
    }
}

#[cfg(test)]
mod tests;
