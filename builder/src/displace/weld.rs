//! Finds vertices and edges of triangles that coincide: by place, by place and normal, or by index.

use glam::DVec3;
use rayon::prelude::*;

use crate::Mesh;

/// The vertices of a mesh, numbered by place and by place and normal.
#[derive(Debug)]
pub(super) struct Vertices {
    /// For each vertex, the number of its place (position).
    pub(super) place: Vec<u32>,
    /// The position of each place.
    pub(super) positions: Vec<DVec3>,
    /// For each vertex, the number of its pair of place and normal. The surface is smooth across vertices with the same pair.
    pub(super) smooth: Vec<u32>,
    /// The number of such pairs.
    pub(super) smooth_count: usize,
}

impl Vertices {
    /// With `weld`, vertices with the same coordinates are at one place. Without, each has a place of its own and the surface
    /// tears; for tests, which must detect that.
    pub(super) fn of(mesh: &Mesh, weld: bool) -> Self {
        // Adding zero turns minus zero into zero.
        let position = |v: usize| mesh.positions[v].map(|x| (x + 0.0).to_bits());
        let index = |v: usize| if weld { 0 } else { v };
        let (place, firsts) = classes(mesh.positions.len(), |v| (position(v), index(v)));
        let normal = |v: usize| mesh.normals[v].map(|x| (x + 0.0).to_bits());
        let (smooth, smooth_firsts) = classes(mesh.positions.len(), |v| (place[v], normal(v)));
        let positions = firsts.iter().map(|&v| DVec3::from(mesh.positions[v as usize])).collect();
        Self { place, positions, smooth, smooth_count: smooth_firsts.len() }
    }
}

/// Numbers the distinct keys of the items 0..count. Returns the number of each item, and one item for each number.
fn classes<K: Ord + Send>(count: usize, key: impl Fn(usize) -> K + Sync) -> (Vec<u32>, Vec<u32>) {
    let mut order: Vec<(K, u32)> = (0..count).into_par_iter().map(|i| (key(i), i as u32)).collect();
    order.par_sort_unstable();
    let mut numbers = vec![0; count];
    let mut firsts = Vec::new();
    let mut last: Option<&K> = None;
    for (k, i) in &order {
        if last != Some(k) {
            firsts.push(*i);
            last = Some(k);
        }
        numbers[*i as usize] = firsts.len() as u32 - 1;
    }
    (numbers, firsts)
}

/// Edges of triangles, and the points at which they are cut.
#[derive(Debug)]
pub(super) struct Edges {
    /// For each triangle the numbers of its edges. Edge `i` leads from corner `i` to the next corner.
    pub(super) of: Vec<[u32; 3]>,
    /// The ends of each edge, the one with the lower place first.
    pub(super) ends: Vec<[u32; 2]>,
    /// The number of the first point on each edge (without its ends); a last entry holds the total number of points.
    pub(super) first: Vec<usize>,
}

impl Edges {
    /// The edges of `triangles`, where vertices with the same `name` are the same. `name` must distinguish places.
    pub(super) fn of(triangles: &[[u32; 3]], place: &[u32], name: impl Fn(u32) -> u32 + Sync) -> Self {
        let ends = |slot: usize| {
            let t = triangles[slot / 3];
            let (a, b) = (t[slot % 3], t[(slot % 3 + 1) % 3]);
            if place[a as usize] <= place[b as usize] { [name(a), name(b)] } else { [name(b), name(a)] }
        };
        let (numbers, firsts) = classes(triangles.len() * 3, ends);
        Self {
            of: numbers.as_chunks::<3>().0.to_vec(),
            ends: firsts.iter().map(|&slot| ends(slot as usize)).collect(),
            first: Vec::new(),
        }
    }

    /// Numbers the points. `segments_of` returns the segments of an edge of a triangle, both given by number.
    pub(super) fn number_points(&mut self, segments_of: impl Fn(usize, usize) -> u32) {
        let mut counts = vec![0usize; self.ends.len()];
        for (triangle, edges) in self.of.iter().enumerate() {
            for (i, &edge) in edges.iter().enumerate() {
                counts[edge as usize] = segments_of(triangle, i) as usize - 1;
            }
        }
        let mut total = 0;
        self.first = Vec::with_capacity(counts.len() + 1);
        for count in counts {
            self.first.push(total);
            total += count;
        }
        self.first.push(total);
    }

    /// Which triangles use which edges.
    pub(super) fn users(&self) -> Users {
        let mut first = vec![0u32; self.ends.len() + 1];
        for &edge in self.of.as_flattened() {
            first[edge as usize + 1] += 1;
        }
        for k in 1..first.len() {
            first[k] += first[k - 1];
        }
        let mut next = first.clone();
        let mut slots = vec![0; self.of.len() * 3];
        for (slot, &edge) in self.of.as_flattened().iter().enumerate() {
            let place = &mut next[edge as usize];
            slots[*place as usize] = slot as u32;
            *place += 1;
        }
        Users { first, slots }
    }

    /// The number of points on all edges.
    pub(super) fn points(&self) -> usize {
        self.first.last().copied().unwrap_or(0)
    }
}

/// For each edge, where triangles use it.
#[derive(Debug)]
pub(super) struct Users {
    first: Vec<u32>,
    slots: Vec<u32>,
}

impl Users {
    /// Three times the number of each triangle that has this edge, plus which of its edges it is. Ascending.
    pub(super) fn of(&self, edge: usize) -> &[u32] {
        &self.slots[self.first[edge] as usize..self.first[edge + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_are_told_apart_by_place_and_by_normal() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [-0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0; 3]],
            normals: vec![[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            ..Mesh::default()
        };
        let welded = Vertices::of(&mesh, true);
        assert_eq!((welded.place.as_slice(), welded.positions.len()), ([0, 0, 1, 0].as_slice(), 2));
        assert_eq!((welded.smooth[0] == welded.smooth[1], welded.smooth_count), (true, 3));
        let apart = Vertices::of(&mesh, false);
        assert_eq!(apart.positions.len(), 4);
    }

    #[test]
    fn edges_run_from_the_lower_place_whoever_uses_them() {
        let place = [0, 1, 2, 0];
        let mut edges = Edges::of(&[[0, 1, 2], [2, 1, 3]], &place, |v| place[v as usize]);
        assert_eq!(edges.ends, [[0, 1], [0, 2], [1, 2]]);
        assert_eq!(edges.of, [[0, 2, 1], [2, 0, 1]]);
        let users = edges.users();
        assert_eq!([users.of(0), users.of(1), users.of(2)], [[0, 4], [2, 5], [1, 3]]);
        edges.number_points(edges_segments);
        assert_eq!((edges.first.as_slice(), edges.points()), ([0, 2, 2, 5].as_slice(), 5));
        let by_index = Edges::of(&[[0, 1, 2], [2, 1, 3]], &place, |v| v);
        assert_eq!(by_index.ends.len(), 5);
    }

    fn edges_segments(triangle: usize, i: usize) -> u32 {
        [[3, 4, 1], [4, 3, 1]][triangle][i]
    }
}
