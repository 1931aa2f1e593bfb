//! Triangles cut to cubes: which child cubes a piece of surface meets, and what of it lies in each.
//!
//! A triangle meets a closed cube exactly if clipping it to the cube leaves something, be it a point. The pieces are cut
//! from the parent's pieces by the three middle planes, so the cost follows what is there. A vertex that is within
//! [`TOLERANCE`] of a plane counts as lying on it, and so on both sides: rounding (below 2^-47 after 23 levels, see
//! there) never loses a voxel, and an extra one holds geometry at most that far away.

use glam::DVec3;

/// Distance from a plane, in units of the root cube, within which a vertex belongs to both sides.
///
/// A cut vertex is one linear interpolation between two others: its error is theirs plus at most two rounding errors of
/// 2^-53. After three cuts on each of 23 levels that is below 138 * 2^-53 < 2^-45.
pub const TOLERANCE: f64 = 1.0 / (1u64 << 45) as f64;

/// A piece of one triangle: a convex polygon in `Pieces::vertices`, or the whole triangle where it was never cut.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    /// Index of the triangle.
    pub triangle: u32,
    /// First vertex.
    first: u32,
    /// Number of vertices; 0: the whole triangle.
    count: u32,
}

impl Piece {
    /// A triangle that has not been cut.
    pub fn whole(triangle: u32) -> Self {
        Self { triangle, first: 0, count: 0 }
    }
}

/// Vertices of the pieces on the current path of the recursion. Used as a stack.
#[derive(Default)]
pub struct Arena {
    vertices: Vec<DVec3>,
    scratch: Scratch,
}

/// The polygon that is being split, and its halves by each axis.
#[derive(Default)]
struct Scratch {
    whole: Polygon,
    z: [Polygon; 2],
    y: [Polygon; 2],
    x: [Polygon; 2],
}

/// A triangle cut by the six planes of a cube has at most nine vertices, and each of three middle planes adds at most one.
/// What the tolerance adds to that, doubled vertices, has room too.
const MAX_VERTICES: usize = 16;

/// A polygon on the stack.
#[derive(Clone, Copy)]
struct Polygon {
    v: [DVec3; MAX_VERTICES],
    n: usize,
}

impl Default for Polygon {
    fn default() -> Self {
        Self { v: [DVec3::ZERO; MAX_VERTICES], n: 0 }
    }
}

impl Polygon {
    fn push(&mut self, p: DVec3) {
        debug_assert!(self.n < MAX_VERTICES);
        if self.n < MAX_VERTICES {
            self.v[self.n] = p;
            self.n += 1;
        }
    }

    fn vertices(&self) -> &[DVec3] {
        &self.v[..self.n]
    }
}

impl Arena {
    /// How much is in use; give it to [`truncate`](Self::truncate) to free what came after.
    pub fn mark(&self) -> usize {
        self.vertices.len()
    }

    /// Frees the vertices of all pieces made since `mark`.
    pub fn truncate(&mut self, mark: usize) {
        self.vertices.truncate(mark);
    }

    /// The vertices of a piece, in order around it; `triangle` gives the corners of a whole one.
    pub fn vertices<'a>(&'a self, piece: &Piece, corners: &'a [[DVec3; 3]]) -> &'a [DVec3] {
        vertices_of(&self.vertices, piece, corners)
    }

    /// A copy that holds only these pieces, for another thread.
    pub fn extract(&self, pieces: &[Piece]) -> (Self, Vec<Piece>) {
        let mut arena = Self::default();
        let pieces = (pieces.iter())
            .map(|piece| {
                let first = arena.vertices.len() as u32;
                arena.vertices.extend_from_slice(&self.vertices[piece.first as usize..][..piece.count as usize]);
                Piece { first: if piece.count == 0 { 0 } else { first }, ..*piece }
            })
            .collect();
        (arena, pieces)
    }

    /// Distributes a piece to the children of the cube with this centre: calls `found` with each child slot that it
    /// meets and the part of it there.
    pub fn split(&mut self, piece: &Piece, corners: &[[DVec3; 3]], centre: DVec3, mut found: impl FnMut(usize, Piece)) {
        let vertices = vertices_of(&self.vertices, piece, corners);
        self.scratch.whole.n = vertices.len();
        self.scratch.whole.v[..vertices.len()].copy_from_slice(vertices);
        let vertices = self.scratch.whole.vertices();
        let (mut lo, mut hi) = (vertices[0], vertices[0]);
        for v in &vertices[1..] {
            lo = lo.min(*v);
            hi = hi.max(*v);
        }
        // Per axis: 1 = meets the lower half, 2 = the upper, 3 = both.
        let sides: [u8; 3] = std::array::from_fn(|axis| {
            u8::from(lo[axis] <= centre[axis] + TOLERANCE) | u8::from(hi[axis] >= centre[axis] - TOLERANCE) << 1
        });
        if sides.iter().all(|s| *s != 3) {
            let slot = (0..3).map(|axis| usize::from(sides[axis] >> 1) << axis).sum();
            found(slot, *piece);
            return;
        }
        let Self { vertices: stack, scratch: Scratch { whole, z, y, x } } = self;
        for (high_z, polygon) in halves(whole, 2, centre.z, sides[2], z) {
            for (high_y, polygon) in halves(polygon, 1, centre.y, sides[1], y) {
                for (high_x, polygon) in halves(polygon, 0, centre.x, sides[0], x) {
                    let first = stack.len() as u32;
                    stack.extend_from_slice(polygon.vertices());
                    found(high_x | high_y << 1 | high_z << 2, Piece { first, count: polygon.n as u32, ..*piece });
                }
            }
        }
    }
}

fn vertices_of<'a>(stack: &'a [DVec3], piece: &Piece, corners: &'a [[DVec3; 3]]) -> &'a [DVec3] {
    if piece.count == 0 {
        &corners[piece.triangle as usize]
    } else {
        &stack[piece.first as usize..][..piece.count as usize]
    }
}

/// The parts of a polygon on the lower (0) and upper (1) side of the plane where there are any. `sides` says on which the
/// whole could be.
fn halves<'a>(
    polygon: &'a Polygon,
    axis: usize,
    at: f64,
    sides: u8,
    parts: &'a mut [Polygon; 2],
) -> impl Iterator<Item = (usize, &'a Polygon)> {
    let found = match sides {
        1 => [Some(polygon), None],
        2 => [None, Some(polygon)],
        _ => {
            cut(polygon, axis, at, parts);
            [Some(&parts[0]), Some(&parts[1])]
        }
    };
    found.into_iter().enumerate().filter_map(|(side, part)| Some((side, part.filter(|p| p.n > 0)?)))
}

/// Cuts by one plane, closed on both sides.
fn cut(polygon: &Polygon, axis: usize, at: f64, parts: &mut [Polygon; 2]) {
    let [low, high] = parts;
    (low.n, high.n) = (0, 0);
    let vertices = polygon.vertices();
    let mut previous = vertices[vertices.len() - 1];
    let mut d0 = previous[axis] - at;
    for &current in vertices {
        let d1 = current[axis] - at;
        // Strictly on opposite sides, and neither counts as on the plane.
        if (d0 > TOLERANCE && d1 < -TOLERANCE) || (d0 < -TOLERANCE && d1 > TOLERANCE) {
            let mut p = previous + (current - previous) * (d0 / (d0 - d1));
            p[axis] = at;
            low.push(p);
            high.push(p);
        }
        if d1 <= TOLERANCE {
            low.push(current);
        }
        if d1 >= -TOLERANCE {
            high.push(current);
        }
        (previous, d0) = (current, d1);
    }
}

/// Twice the vector area of a polygon, and its centroid weighted by area (the mean of the vertices without any).
pub fn area_and_centroid(vertices: &[DVec3]) -> (f64, DVec3) {
    let origin = vertices[0];
    let mut area = 0.0;
    let mut centroid = DVec3::ZERO;
    for pair in vertices[1..].windows(2) {
        let a = (pair[0] - origin).cross(pair[1] - origin).length();
        area += a;
        centroid += (origin + pair[0] + pair[1]) * (a / 3.0);
    }
    if area > 0.0 { (area, centroid / area) } else { (0.0, vertices.iter().sum::<DVec3>() / vertices.len() as f64) }
}
