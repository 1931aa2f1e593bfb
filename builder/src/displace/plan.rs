//! Which triangles are to be diced and how finely, before the number of new triangles is known.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::dice::{Borders, segments};
use super::options::DisplaceOptions;
use super::weld::{Edges, Vertices};
use crate::Mesh;
use crate::mesh::maps::HeightMap;

/// How a triangle is to be diced.
pub(super) struct Facet<'a> {
    pub(super) height_map: Option<&'a HeightMap>,
    /// Longest side of the new triangles, in mesh units; infinite without a height map.
    pub(super) step: f64,
    /// Texels of the height map per mesh unit, in the direction in which they are densest.
    pub(super) density: f64,
}

/// What is to be diced and displaced.
pub(super) struct Plan<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) vertices: &'a Vertices,
    pub(super) options: &'a DisplaceOptions,
    /// The triangles with a vertex at a place that moves.
    pub(super) touched: Vec<u32>,
    pub(super) facets: Vec<Facet<'a>>,
    pub(super) places: Edges,
    /// For each edge of `places`, the shortest step of the triangles with height maps around it.
    edge_steps: Vec<f64>,
    /// All steps are multiplied by this.
    factor: f64,
    /// For each edge of `places`, the number of segments that it is cut into. Empty until [`cut`](Self::cut).
    segments: Vec<u32>,
}

impl<'a> Plan<'a> {
    pub(super) fn new(mesh: &'a Mesh, vertices: &'a Vertices, moving: &[bool], options: &'a DisplaceOptions) -> Self {
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
                // If the height is constant, no cuts are needed.
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
        Self { mesh, vertices, options, touched, facets, places, edge_steps, factor: 1.0, segments: Vec::new() }
    }

    /// Decides how all edges are cut if all steps are multiplied by `factor`.
    pub(super) fn cut(&mut self, factor: f64) {
        let position = |p: u32| self.vertices.positions[p as usize];
        self.factor = factor;
        self.segments = (self.places.ends.iter().zip(&self.edge_steps))
            .map(|(&[a, b], step)| segments(position(a).distance(position(b)), step * factor))
            .collect();
        let (of, segments) = (self.places.of.clone(), &self.segments);
        self.places.number_points(|i, e| segments[of[i][e] as usize]);
    }

    /// Longest side of the small triangles of touched triangle `i`.
    pub(super) fn step(&self, i: usize) -> f64 {
        self.facets[i].step * self.factor
    }

    /// Segments of edge `e` of touched triangle `i`.
    pub(super) fn segments(&self, i: usize, e: usize) -> u32 {
        self.segments[self.places.of[i][e] as usize]
    }

    /// How the edges of touched triangle `i` are cut.
    pub(super) fn borders(&self, i: usize) -> Borders {
        let places = self.places_of(i);
        Borders {
            segments: std::array::from_fn(|e| self.segments(i, e)),
            reversed: std::array::from_fn(|e| places[e] > places[(e + 1) % 3]),
        }
    }

    pub(super) fn corners(&self, i: usize) -> [u32; 3] {
        self.mesh.triangles[self.touched[i] as usize]
    }

    pub(super) fn places_of(&self, i: usize) -> [u32; 3] {
        self.corners(i).map(|v| self.vertices.place[v as usize])
    }

    pub(super) fn positions_of(&self, i: usize) -> [DVec3; 3] {
        self.places_of(i).map(|p| self.vertices.positions[p as usize])
    }

    /// The vertices at the ends of edge `e` of touched triangle `i`, the one at the lower place first.
    pub(super) fn ends_of(&self, i: usize, e: usize) -> [u32; 2] {
        let corners = self.corners(i);
        let (a, b) = (corners[e], corners[(e + 1) % 3]);
        let place = |v: u32| self.vertices.place[v as usize];
        if place(a) <= place(b) { [a, b] } else { [b, a] }
    }

    /// About how many new triangles there are at least if all steps are multiplied by `factor`: as if halving sides left no triangle
    /// smaller than its step asks for. There are up to 1.8 times as many, as
    /// [`displaced_triangles`](super::displaced_triangles) finds; this is cheap, and never makes cells larger in vain.
    pub(super) fn estimate(&self, factor: f64) -> f64 {
        let count = |i: usize| {
            let [a, b, c] = self.positions_of(i);
            let lengths = [a.distance(b), b.distance(c), c.distance(a)];
            let segments =
                |e: usize| (lengths[e] / (self.edge_steps[self.places.of[i][e] as usize] * factor)).ceil().max(1.0);
            let around = segments(0) + segments(1) + segments(2) - 2.0;
            let step = self.facets[i].step * factor;
            around.max(1.7 * (b - a).cross(c - a).length() / (step * step))
        };
        // Summed in chunks of a fixed size, so that the rounding does not depend on the number of threads.
        let chunks: Vec<f64> = (0..self.touched.len().div_ceil(1024))
            .into_par_iter()
            .map(|k| (k * 1024..((k + 1) * 1024).min(self.touched.len())).map(count).sum())
            .collect();
        chunks.iter().sum()
    }
}

/// Texels of `map` per mesh unit on triangle `t`, in the direction in which they are densest; 0 for a triangle without area.
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
    // Coordinates in the triangle's plane: x along its first edge, y across.
    let (e1, e2) = (b - a, c - a);
    let x1 = e1.length();
    let x2 = e2.dot(e1) / x1;
    let y2 = e1.cross(e2).length() / x1;
    // Derivatives of the texel coordinates by x and y. The density is the larger singular value of their matrix.
    let p = d1 / x1;
    let q = (d2 - p * x2) / y2;
    let (square, mixed) = (p.length_squared() + q.length_squared(), p.perp_dot(q));
    let density = (0.5 * (square + (square * square - 4.0 * mixed * mixed).max(0.0).sqrt())).sqrt();
    if density.is_finite() { density } else { 0.0 }
}
