//! Clips triangles to cubes: which child cubes a piece of surface meets, and which part of it lies in each.
//!
//! A triangle meets a closed cube exactly if clipping it to the cube leaves something, even a single point. The pieces in
//! the child cubes are cut from the piece in the parent by the three planes through the parent's centre, so the cost is
//! proportional to the surface that is present. Each cut keeps [`MARGIN`] more than it should on both sides. The margin
//! exceeds the sum of all rounding errors, so that no voxel is ever lost. An extra voxel can result; the surface is then
//! at most twice the margin outside of it, 2^-45 of the root cube.
//!
//! # Why no voxel is lost
//!
//! Let `u = 2^-53`. The unit of length is the root cube's edge, and distances are the largest difference of a coordinate.
//! Compare each computed piece, with vertices `v_i`, to a convex polygon `P` with vertices `V_i` in the true triangle,
//! such that (1) each `v_i` is within `e` of `V_i`, and (2) `P` contains all of the triangle that is in the closed cube.
//!
//! * At first `P` is the triangle and `v_i = (V_i - origin) * scale`: three roundings of numbers of at most 1, so
//!   `e = 3 u`. `origin` and `1 / scale` are the octree's stored transform, hence exact by definition.
//! * A cut at `x = c` keeps for the lower side the `v_i` with `x <= c + m`, where `m` is [`MARGIN`], and adds a point
//!   `w = v_i + (v_j - v_i) * t`, `t = d0 / (d0 - d1)`, for each edge that crosses `x = c + m`. `c + m` has 46 bits and is
//!   exact, so `d0` and `d1` are off by factors within `1 ± u`; their signs differ, so nothing cancels and `t` is off by a
//!   factor within `1 ± 4 u`. With the roundings of the difference and of the product the step along the edge is off
//!   by at most `6 u |v_j - v_i|`, and the sum by `u` more: by `r = (6 * 2^-k + 1) u` in a cube of level `k`.
//! * The new `P` has the `V_i` of the vertices that were kept and `W = V_i + (V_j - V_i) * t` on the edges. It is convex
//!   again, because its vertices are points in order around the old one; and (1) holds with `e + r` instead of `e`.
//! * What `P` lost is the hull of some `V_i` whose `v_i` have `x > c + m`, and of the `W` next to them, whose `w` have
//!   `x = c + m`. So it has `x >= c + m - e - r`, which is above `c`: (2) holds as well.
//! * A piece that goes to one side whole has all its `v_i` more than `m` from the other, and `P` more than `m - e`.
//!
//! Three cuts on each level add up to `e <= 3 u + 3 (6 * 2 + 23) u = 108 u` down to level 23, and `m = 128 u`. Conversely
//! the `v_i` are within `m` of the cube and within `e` of the triangle: the cube of an extra voxel is at most
//! `2 m = 2^-45` from the triangle.
//!
//! Cutting at the planes themselves and counting vertices near a plane as on it is not enough, however large the tolerance:
//! where a triangle is almost parallel to the plane, an error of `e` in one coordinate moves the cut by `e / slope` in
//! another.

mod chain;
pub(crate) mod polygon;

use glam::DVec3;

pub(crate) use chain::meets;

/// How far beyond a cube its pieces are cut off, in edges of the root cube. Larger than the sum of all rounding errors.
pub(crate) const MARGIN: f64 = 1.0 / (1u64 << 46) as f64;

/// A piece of one triangle: a convex polygon in `Arena::vertices`, or the whole triangle if it was never cut.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece {
    /// Index of the triangle.
    pub triangle: u32,
    /// First vertex.
    first: u32,
    /// Number of vertices; 0: the whole triangle.
    count: u32,
}

impl Piece {
    /// A triangle that has not been cut.
    pub(crate) fn whole(triangle: u32) -> Self {
        Self { triangle, first: 0, count: 0 }
    }
}

/// Vertices of the pieces on the current path of the recursion. Used as a stack.
#[derive(Default)]
pub(crate) struct Arena {
    vertices: Vec<DVec3>,
    scratch: Scratch,
}

/// The polygon that is being split, and its halves along each axis.
#[derive(Default)]
struct Scratch {
    whole: Polygon,
    z: [Polygon; 2],
    y: [Polygon; 2],
    x: [Polygon; 2],
}

/// Most vertices of a polygon. A triangle cut by the six planes of a cube has at most nine vertices, and each of the three
/// planes through the centre adds at most one. Rounding can make an outline slightly concave, and it may then need more;
/// a polygon that would not fit is not cut.
pub(crate) const MAX_VERTICES: usize = 16;

/// A polygon of bounded size, kept on the call stack.
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
    /// Adds a vertex. When the polygon is full, only the count grows.
    fn push(&mut self, p: DVec3) {
        if let Some(v) = self.v.get_mut(self.n) {
            *v = p;
        }
        self.n += 1;
    }

    /// Copies `vertices` into this polygon. A loop, because a call to `memcpy` takes longer for this few elements.
    fn set(&mut self, vertices: &[DVec3]) {
        self.n = vertices.len().min(MAX_VERTICES);
        for (to, from) in self.v.iter_mut().zip(vertices) {
            *to = *from;
        }
    }

    fn vertices(&self) -> &[DVec3] {
        &self.v[..self.n]
    }
}

impl Arena {
    /// The number of vertices in use. Pass it to [`truncate`](Self::truncate) to free what was added later.
    pub(crate) fn mark(&self) -> usize {
        self.vertices.len()
    }

    /// Frees the vertices of all pieces made since `mark`.
    pub(crate) fn truncate(&mut self, mark: usize) {
        self.vertices.truncate(mark);
    }

    /// The vertices of a piece, in order around it. `corners` holds the corners of all triangles, for uncut pieces.
    pub(crate) fn vertices<'a>(&'a self, piece: &Piece, corners: &'a [[DVec3; 3]]) -> &'a [DVec3] {
        vertices_of(&self.vertices, piece, corners)
    }

    /// Appends the vertices of pieces of another arena, and to `list` these pieces with the vertices in this one.
    pub(crate) fn extend(&mut self, other: &Self, pieces: &[Piece], list: &mut Vec<Piece>) {
        list.extend(pieces.iter().map(|piece| {
            let first = self.vertices.len() as u32;
            self.vertices.extend_from_slice(&other.vertices[piece.first as usize..][..piece.count as usize]);
            Piece { first: if piece.count == 0 { 0 } else { first }, ..*piece }
        }));
    }

    /// Distributes a piece to the children of the cube with this centre: calls `found` with each child slot that the piece
    /// meets and the part of the piece there.
    pub(crate) fn split(
        &mut self,
        piece: &Piece,
        corners: &[[DVec3; 3]],
        centre: DVec3,
        mut found: impl FnMut(usize, Piece),
    ) {
        self.scratch.whole.set(vertices_of(&self.vertices, piece, corners));
        let sides = sides(self.scratch.whole.vertices(), centre);
        if let Some(slot) = only_slot(&sides) {
            found(slot, *piece);
            return;
        }
        let Self { vertices: stack, scratch: Scratch { whole, z, y, x } } = self;
        for (high_z, polygon) in halves(whole, 2, centre.z, sides[2], z) {
            for (high_y, polygon) in halves(polygon, 1, centre.y, sides[1], y) {
                for (high_x, polygon) in halves(polygon, 0, centre.x, sides[0], x) {
                    let first = stack.len() as u32;
                    push(stack, polygon);
                    found(high_x | high_y << 1 | high_z << 2, Piece { first, count: polygon.n as u32, ..*piece });
                }
            }
        }
    }

    /// The child slots that a piece meets: bit `i` is set exactly if [`split`](Self::split) calls `found` with slot `i`. Takes
    /// less time, because the last cut needs no vertices.
    pub(crate) fn slots(&mut self, piece: &Piece, corners: &[[DVec3; 3]], centre: DVec3) -> u8 {
        let Self { vertices: stack, scratch: Scratch { whole, z, y, .. } } = self;
        whole.set(vertices_of(stack, piece, corners));
        let sides = sides(whole.vertices(), centre);
        if let Some(slot) = only_slot(&sides) {
            return 1 << slot;
        }
        let mut found = 0;
        for (high_z, polygon) in halves(whole, 2, centre.z, sides[2], z) {
            for (high_y, polygon) in halves(polygon, 1, centre.y, sides[1], y) {
                // A part that a cut keeps has a vertex of the polygon on its side.
                let x = if sides[0] == 3 { vertices_meet(polygon.vertices(), centre.x, |v| v.x) } else { sides[0] };
                found |= x << (high_y << 1 | high_z << 2);
            }
        }
        found
    }
}

/// Appends the vertices of a polygon. Most have few: for these a copy of fixed size takes less time than a call to `memcpy`.
#[inline(always)]
fn push(stack: &mut Vec<DVec3>, polygon: &Polygon) {
    const FEW: usize = 5;
    if polygon.n > FEW {
        stack.extend_from_slice(polygon.vertices());
        return;
    }
    let end = stack.len() + polygon.n;
    stack.extend_from_slice(&polygon.v[..FEW]);
    stack.truncate(end);
}

fn vertices_of<'a>(stack: &'a [DVec3], piece: &Piece, corners: &'a [[DVec3; 3]]) -> &'a [DVec3] {
    if piece.count == 0 {
        &corners[piece.triangle as usize]
    } else {
        &stack[piece.first as usize..][..piece.count as usize]
    }
}

/// Per axis, on which sides of the plane through `centre` there are vertices, see [`vertices_meet`].
#[inline(always)]
fn sides(vertices: &[DVec3], centre: DVec3) -> [u8; 3] {
    [
        vertices_meet(vertices, centre.x, |v| v.x),
        vertices_meet(vertices, centre.y, |v| v.y),
        vertices_meet(vertices, centre.z, |v| v.z),
    ]
}

/// The child slot with all vertices, if no plane separates them.
#[inline(always)]
fn only_slot(sides: &[u8; 3]) -> Option<usize> {
    sides.iter().all(|s| *s != 3).then(|| (0..3).map(|axis| usize::from(sides[axis] >> 1) << axis).sum())
}

/// On which sides of the plane at `at` there are vertices, [`MARGIN`] included: 1 the lower, 2 the upper, 3 both.
#[inline(always)]
fn vertices_meet(vertices: &[DVec3], at: f64, coordinate: impl Fn(&DVec3) -> f64) -> u8 {
    let (mut lo, mut hi) = (f64::MAX, f64::MIN);
    for x in vertices.iter().map(coordinate) {
        // Not `f64::min` and `f64::max`: their NaN handling costs several instructions.
        lo = if x < lo { x } else { lo };
        hi = if x > hi { x } else { hi };
    }
    u8::from(lo <= at + MARGIN) | u8::from(hi >= at - MARGIN) << 1
}

/// The parts of a polygon on the lower (0) and the upper (1) side of a plane, without empty ones. `sides` is the result of
/// [`vertices_meet`].
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

/// Cuts a polygon by one plane. Each part reaches [`MARGIN`] beyond the plane.
fn cut(polygon: &Polygon, axis: usize, at: f64, parts: &mut [Polygon; 2]) {
    match axis {
        0 => cut_along(polygon, at, parts, |v| v.x, |v, x| v.x = x),
        1 => cut_along(polygon, at, parts, |v| v.y, |v, y| v.y = y),
        _ => cut_along(polygon, at, parts, |v| v.z, |v, z| v.z = z),
    }
}

#[inline(always)]
fn cut_along(
    polygon: &Polygon,
    at: f64,
    parts: &mut [Polygon; 2],
    coordinate: impl Fn(&DVec3) -> f64,
    set: impl Fn(&mut DVec3, f64),
) {
    let [low, high] = parts;
    (low.n, high.n) = (0, 0);
    let (end_of_low, end_of_high) = (at + MARGIN, at - MARGIN);
    let crossing = |from: DVec3, to: DVec3, d0: f64, d1: f64, end: f64| {
        let mut p = from + (to - from) * (d0 / (d0 - d1));
        set(&mut p, end);
        p
    };
    let vertices = polygon.vertices();
    let mut previous = vertices[vertices.len() - 1];
    // Distances beyond the ends of the two parts; positive: the vertex is cut off.
    let (mut low0, mut high0) = (coordinate(&previous) - end_of_low, end_of_high - coordinate(&previous));
    for &current in vertices {
        let (low1, high1) = (coordinate(&current) - end_of_low, end_of_high - coordinate(&current));
        if low0 * low1 < 0.0 {
            low.push(crossing(previous, current, low0, low1, end_of_low));
        }
        if high0 * high1 < 0.0 {
            high.push(crossing(previous, current, high0, high1, end_of_high));
        }
        if low1 <= 0.0 {
            low.push(current);
        }
        if high1 <= 0.0 {
            high.push(current);
        }
        (previous, low0, high0) = (current, low1, high1);
    }
    for part in [low, high] {
        if part.n > MAX_VERTICES {
            *part = *polygon;
        }
    }
}
