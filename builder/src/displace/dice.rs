//! Dices a triangle: cuts it into small ones, for given numbers of segments on its edges.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use glam::DVec3;

/// A diced triangle. Its vertices are numbered locally: the corners 0, 1, 2; then the points on edge 0 (from corner 0 to 1),
/// on edge 1 and on edge 2; then `interior`. The points on an edge are counted from the end at which the neighbouring
/// triangles start, too (see [`Borders::reversed`]).
#[derive(Debug, Default)]
pub(super) struct Diced {
    /// Barycentric coordinates of the vertices inside.
    pub(super) interior: Vec<[f64; 3]>,
    /// Triples of local vertices, with the winding of the triangle.
    pub(super) triangles: Vec<[u32; 3]>,
}

/// How the edges of a triangle are cut.
#[derive(Clone, Copy, Debug)]
pub(super) struct Borders {
    /// Segments per edge, at least 1.
    pub(super) segments: [u32; 3],
    /// Whether the points of edge `i` are counted from corner `i + 1` instead of corner `i`.
    pub(super) reversed: [bool; 3],
}

impl Borders {
    /// Local number of the first point on each edge, and of the first vertex inside.
    pub(super) fn first(&self) -> [u32; 4] {
        let [a, b, c] = self.segments.map(|n| n - 1);
        [3, 3 + a, 3 + a + b, 3 + a + b + c]
    }

    /// The edge of a local vertex that is on one, and its number among the points of the edge.
    pub(super) fn edge_of(&self, local: usize) -> (usize, usize) {
        let first = self.first().map(|f| f as usize);
        let edge = (1..3).rev().find(|&edge| local >= first[edge]).unwrap_or(0);
        (edge, local - first[edge])
    }

    /// Barycentric coordinates of point `j` of `edge`.
    pub(super) fn weights(&self, edge: usize, j: u32) -> [f64; 3] {
        let n = f64::from(self.segments[edge]);
        let (from, to) = if self.reversed[edge] { ((edge + 1) % 3, edge) } else { (edge, (edge + 1) % 3) };
        let mut weights = [0.0; 3];
        weights[from] = f64::from(self.segments[edge] - j) / n;
        weights[to] = f64::from(j) / n;
        weights
    }

    /// Barycentric coordinates of the local vertices at the corners and on the edges.
    pub(super) fn all_weights(self) -> impl Iterator<Item = [f64; 3]> {
        let corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let points = (0..3).flat_map(move |edge| (1..self.segments[edge]).map(move |j| self.weights(edge, j)));
        corners.into_iter().chain(points)
    }
}

/// A side of a piece of the triangle.
#[derive(Clone, Copy, Debug)]
enum Side {
    /// Part of an edge of the triangle, from one of its points to another (0 and the number of segments are its ends).
    Border { edge: u8, from: u32, to: u32 },
    /// Between two pieces.
    Inner { segments: u32 },
}

impl Side {
    fn segments(self) -> u32 {
        match self {
            Self::Border { from, to, .. } => from.abs_diff(to),
            Self::Inner { segments } => segments,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Piece {
    corners: [u32; 3],
    sides: [Side; 3],
}

/// A part of a triangle on the way to the small ones.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// Local vertices.
    pub(super) corners: [u32; 3],
    /// Where they are before displacement.
    pub(super) positions: [DVec3; 3],
    /// The segments that its sides are still to be cut into.
    pub(super) segments: [u32; 3],
}

impl Part {
    /// The segments of the side that has most.
    pub(super) fn most(&self) -> u32 {
        self.segments[0].max(self.segments[1]).max(self.segments[2])
    }
}

/// Dices triangles one after the other; holds scratch memory.
#[derive(Debug, Default)]
pub(super) struct Dicer {
    positions: Vec<DVec3>,
    weights: Vec<[f64; 3]>,
    stack: Vec<Piece>,
    /// Vertices on inner sides of which only one of the two adjacent pieces has been cut. The key holds the side's ends.
    open: HashMap<u64, u32, BuildHasherDefault<PairHasher>>,
}

impl Dicer {
    /// Cuts a triangle until no side is longer than `step` and all points of `borders` are used. For every edge,
    /// `borders.segments` must be at least the edge's length divided by `step`.
    ///
    /// Parts for which `keep` is false are left out with everything that they would be cut into. What is left is the same,
    /// in the same order, as without leaving out: only the numbers of the vertices inside differ.
    pub(super) fn dice(
        &mut self,
        corners: [DVec3; 3],
        borders: &Borders,
        step: f64,
        mut keep: impl FnMut(&Part) -> bool,
    ) -> Diced {
        let mut diced = Diced::default();
        self.walk(corners, borders, step, |part| {
            let kept = keep(part);
            if kept && part.most() <= 1 {
                diced.triangles.push(part.corners);
            }
            kept
        });
        diced.interior.extend_from_slice(&self.weights[borders.first()[3] as usize..]);
        diced
    }

    /// Cuts a triangle into ever smaller parts, and calls `visit` with each. A part is cut further if `visit` returns true
    /// and a side has more than one segment.
    ///
    /// Each piece is cut across its longest sides, counted in segments. A new inner side is never longer than the longest
    /// side of the piece, so the largest count of segments decreases at least with every second cut.
    pub(super) fn walk(
        &mut self,
        corners: [DVec3; 3],
        borders: &Borders,
        step: f64,
        mut visit: impl FnMut(&Part) -> bool,
    ) {
        self.begin(corners, borders);
        let first = borders.first();
        while let Some(piece) = self.stack.pop() {
            let part = self.part(&piece);
            let most = part.most();
            if visit(&part) && most > 1 {
                self.cut(piece, long_sides(&part), &first, step);
            }
        }
    }

    /// An estimate of the number of small triangles that [`dice`](Self::dice) makes, from `samples` of them: its mean over all seeds is
    /// exact.
    ///
    /// Each sample goes down from the triangle to a small one, at each cut into one of the parts by chance, and counts as many as the
    /// product of the numbers of parts (Knuth, Estimating the Efficiency of Backtrack Programs, 1975). Parts of a cut are much alike,
    /// so that samples differ little.
    pub(super) fn estimate(
        &mut self,
        corners: [DVec3; 3],
        borders: &Borders,
        step: f64,
        samples: u32,
        seed: u64,
    ) -> f64 {
        let mut random = random(seed);
        self.begin(corners, borders);
        let (first, on_border) = (borders.first(), self.weights.len());
        let whole = self.stack.pop();
        let mut sum = 0.0;
        for _ in 0..samples {
            let Some(mut piece) = whole else { break };
            let mut product = 1.0;
            loop {
                let part = self.part(&piece);
                if part.most() <= 1 {
                    break;
                }
                self.cut(piece, long_sides(&part), &first, step);
                product *= self.stack.len() as f64;
                piece = self.stack[random() as usize % self.stack.len()];
                self.stack.clear();
            }
            sum += product;
            self.positions.truncate(on_border);
            self.weights.truncate(on_border);
            self.open.clear();
        }
        sum / f64::from(samples)
    }

    fn part(&self, piece: &Piece) -> Part {
        Part {
            corners: piece.corners,
            positions: piece.corners.map(|v| self.positions[v as usize]),
            segments: piece.sides.map(Side::segments),
        }
    }

    /// Starts with the triangle as the only piece.
    fn begin(&mut self, corners: [DVec3; 3], borders: &Borders) {
        self.positions.clear();
        self.weights.clear();
        self.stack.clear();
        self.open.clear();
        let position = |[a, b, c]: [f64; 3]| corners[0] * a + corners[1] * b + corners[2] * c;
        self.weights.extend(borders.all_weights());
        self.positions.extend(self.weights.iter().map(|&w| position(w)));
        let sides = std::array::from_fn(|edge| {
            let n = borders.segments[edge];
            let (from, to) = if borders.reversed[edge] { (n, 0) } else { (0, n) };
            Side::Border { edge: edge as u8, from, to }
        });
        self.stack.push(Piece { corners: [0, 1, 2], sides });
    }

    /// Cuts a piece across its `long` sides.
    fn cut(&mut self, piece: Piece, long: [bool; 3], first: &[u32; 4], step: f64) {
        // Rotate so that side 0 is cut and, unless all three are, side 2 is not.
        let turn = match long {
            [true, true, true] | [true, true, false] | [true, false, false] => 0,
            [false, true, _] => 1,
            _ => 2,
        };
        let [a, b, c] = std::array::from_fn(|i| piece.corners[(i + turn) % 3]);
        let [ab, bc, ca] = std::array::from_fn(|i| piece.sides[(i + turn) % 3]);
        let number = long.iter().filter(|&&l| l).count();
        let (m, am, mb) = self.halve(a, b, ab, first);
        let mut push = |corners, sides| self.stack.push(Piece { corners, sides });
        if number == 1 {
            let inner = inner(&self.positions, m, c, step);
            push([a, m, c], [am, inner, ca]);
            push([m, b, c], [mb, bc, inner]);
            return;
        }
        let (k, bk, kc) = self.halve(b, c, bc, first);
        if number == 2 {
            let mk = inner(&self.positions, m, k, step);
            let length = |u: u32, v: u32| self.positions[u as usize].distance_squared(self.positions[v as usize]);
            let shorter = length(a, k) <= length(m, c);
            let diagonal =
                if shorter { inner(&self.positions, a, k, step) } else { inner(&self.positions, m, c, step) };
            let mut push = |corners, sides| self.stack.push(Piece { corners, sides });
            push([m, b, k], [mb, bk, mk]);
            if shorter {
                push([a, m, k], [am, mk, diagonal]);
                push([a, k, c], [diagonal, kc, ca]);
            } else {
                push([a, m, c], [am, diagonal, ca]);
                push([m, k, c], [mk, kc, diagonal]);
            }
            return;
        }
        let (l, cl, la) = self.halve(c, a, ca, first);
        let [mk, kl, lm] = [(m, k), (k, l), (l, m)].map(|(u, v)| inner(&self.positions, u, v, step));
        let mut push = |corners, sides| self.stack.push(Piece { corners, sides });
        push([a, m, l], [am, lm, la]);
        push([m, b, k], [mb, bk, mk]);
        push([l, k, c], [kl, kc, cl]);
        push([m, k, l], [mk, kl, lm]);
    }

    /// The vertex near the middle of the side from `a` to `b`, and the two halves of the side.
    fn halve(&mut self, a: u32, b: u32, side: Side, first: &[u32; 4]) -> (u32, Side, Side) {
        match side {
            Side::Border { edge, from, to } => {
                let middle = from.min(to) + from.abs_diff(to) / 2;
                let vertex = first[edge as usize] + middle - 1;
                (vertex, Side::Border { edge, from, to: middle }, Side::Border { edge, from: middle, to })
            }
            Side::Inner { segments } => {
                let key = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
                // Halved from one end, whoever halves it. The vertices' numbers cannot say from which: they depend on what
                // is left out.
                let [(u, p), (v, q)] = [a, b].map(|v| (v as usize, self.weights[v as usize]));
                let low = if p < q { a } else { b };
                let ((u, p), (v, q)) = if p < q { ((u, p), (v, q)) } else { ((v, q), (u, p)) };
                let near_low = segments / 2;
                // The piece beyond this side needs the same vertex: take it if that piece was cut first, else keep it.
                let vertex = match self.open.remove(&key) {
                    Some(vertex) => vertex,
                    None => {
                        let vertex = self.positions.len() as u32;
                        let t = f64::from(near_low) / f64::from(segments);
                        self.positions.push(self.positions[u].lerp(self.positions[v], t));
                        self.weights.push(std::array::from_fn(|i| p[i] + (q[i] - p[i]) * t));
                        self.open.insert(key, vertex);
                        vertex
                    }
                };
                let part = |segments| Side::Inner { segments };
                let (low_part, high_part) = (part(near_low), part(segments - near_low));
                if a == low { (vertex, low_part, high_part) } else { (vertex, high_part, low_part) }
            }
        }
    }
}

/// Random numbers (splitmix64).
fn random(seed: u64) -> impl FnMut() -> u32 {
    let mut state = seed;
    move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (state ^ state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed >> 32) as u32
    }
}

/// Which sides of a part are cut: those with more than half as many segments as the side that has most.
fn long_sides(part: &Part) -> [bool; 3] {
    let most = u64::from(part.most());
    part.segments.map(|n| n > 1 && 2 * u64::from(n) > most)
}

/// A new inner side between vertices `u` and `v`.
fn inner(positions: &[DVec3], u: u32, v: u32, step: f64) -> Side {
    Side::Inner { segments: segments(positions[u as usize].distance(positions[v as usize]), step) }
}

/// The number of segments of at most `step` that a length is divided into, at least 1.
pub(super) fn segments(length: f64, step: f64) -> u32 {
    // A length that exceeds a multiple of the step only by rounding gets no extra segment.
    (length / step * (1.0 - 1e-9)).ceil().max(1.0) as u32
}

/// Hashes pairs of small numbers. The standard hasher would take most of the time.
#[derive(Debug, Default)]
struct PairHasher(u64);

impl Hasher for PairHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_u64(byte.into());
        }
    }

    fn write_u64(&mut self, value: u64) {
        // The odd number is 2^64 divided by the golden ratio. The map uses the high and the low bits of the hash.
        let mixed = (self.0 ^ value).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ (mixed >> 32);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    /// Dices, and checks that the pieces cover the triangle exactly once and use every point on its edges.
    fn check(corners: [DVec3; 3], borders: Borders, step: f64) -> usize {
        let mut dicer = Dicer::default();
        let diced = dicer.dice(corners, &borders, step, |_| true);
        let weights: Vec<[f64; 3]> = borders.all_weights().chain(diced.interior.iter().copied()).collect();
        let mut area = 0.0;
        let mut sides: HashMap<(u32, u32), i32> = HashMap::new();
        let mut used = vec![false; weights.len()];
        for t in &diced.triangles {
            let [a, b, c] = t.map(|v| weights[v as usize]);
            let part = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1]);
            assert!(part > 0.0, "a piece is turned over or flat: {t:?}");
            area += part;
            for i in 0..3 {
                used[t[i] as usize] = true;
                let (u, v) = (t[i], t[(i + 1) % 3]);
                *sides.entry((u.min(v), u.max(v))).or_default() += if u < v { 1 } else { -1 };
                assert!(sides[&(u.min(v), u.max(v))].abs() <= 1, "two pieces on one side of {u} {v}");
            }
        }
        assert!((area - 1.0).abs() < 1e-9, "{area}");
        assert!(used.iter().all(|&u| u));
        // The unmatched sides are the segments of the three edges.
        let border = sides.values().filter(|&&n| n != 0).count();
        assert_eq!(border as u32, borders.segments.iter().sum::<u32>());
        assert!(dicer.open.is_empty(), "both pieces at an inner side were cut");
        diced.triangles.len()
    }

    /// What is left when parts are left out has the same places, in the same order.
    #[test]
    fn leaving_parts_out_changes_nothing_else() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::new(0.3, 0.9, 0.2)];
        let step = 0.013;
        let [a, b, c] = lengths(corners, step);
        let borders = Borders { segments: [a + 3, b, 2 * c], reversed: [false, true, false] };
        let mut dicer = Dicer::default();
        let mut places = |keep: &dyn Fn(&Part) -> bool| {
            let diced = dicer.dice(corners, &borders, step, keep);
            let weights: Vec<[f64; 3]> = borders.all_weights().chain(diced.interior.iter().copied()).collect();
            let bits = |v: u32| weights[v as usize].map(f64::to_bits);
            diced.triangles.iter().map(|t| t.map(bits)).collect::<Vec<_>>()
        };
        let near = |p: &Part| {
            let (low, high) = (p.positions[0].min(p.positions[1]).min(p.positions[2]), p.positions.iter().copied());
            let high = high.fold(DVec3::MIN, DVec3::max);
            (low - 0.05).cmple(DVec3::new(0.4, 0.3, 0.1)).all() && (high + 0.05).cmpge(DVec3::new(0.4, 0.3, 0.0)).all()
        };
        let (all, some) = (places(&|_| true), places(&near));
        assert!(some.len() > 20 && some.len() * 4 < all.len(), "{} of {}", some.len(), all.len());
        let mut rest = all.iter();
        assert!(some.iter().all(|t| rest.any(|other| other == t)));
    }

    fn lengths(corners: [DVec3; 3], step: f64) -> [u32; 3] {
        std::array::from_fn(|i| segments(corners[i].distance(corners[(i + 1) % 3]), step))
    }

    #[test]
    fn triangles_of_many_shapes_are_covered_once() {
        let even = [DVec3::ZERO, DVec3::X, DVec3::new(0.5, 0.9, 0.0)];
        let needle = [DVec3::ZERO, DVec3::X * 30.0, DVec3::new(15.0, 0.2, 0.0)];
        let sliver = [DVec3::ZERO, DVec3::X * 9.0, DVec3::new(9.0, 0.01, 0.0)];
        for corners in [even, needle, sliver] {
            for step in [2.0, 0.7, 0.3, 0.11, 0.05] {
                let base = lengths(corners, step);
                for extra in [[0, 0, 0], [1, 0, 0], [0, 5, 0], [7, 0, 20], [3, 2, 1]] {
                    for reversed in [[false; 3], [true, false, true]] {
                        let segments = std::array::from_fn(|i| base[i] + extra[i]);
                        check(corners, Borders { segments, reversed }, step);
                    }
                }
            }
        }
    }

    #[test]
    fn pieces_are_as_many_as_the_step_asks_for() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::new(0.5, 0.75f64.sqrt(), 0.0)];
        let borders = Borders { segments: lengths(corners, 1.0 / 64.0), reversed: [false; 3] };
        assert_eq!(check(corners, borders, 1.0 / 64.0), 64 * 64);
        let borders = Borders { segments: lengths(corners, 1.0 / 50.0), reversed: [false; 3] };
        let found = check(corners, borders, 1.0 / 50.0);
        assert!((2500..5000).contains(&found), "{found}");
    }

    #[test]
    fn samples_tell_the_number_of_small_triangles() {
        let mut dicer = Dicer::default();
        for (k, (far, step)) in [(0.9, 0.013), (0.9, 0.0071), (0.08, 0.004), (3.0, 0.021)].into_iter().enumerate() {
            let corners = [DVec3::ZERO, DVec3::X, DVec3::new(0.3, far, 0.2)];
            let [a, b, c] = lengths(corners, step);
            for (segments, step) in [([a, b, c], step), ([a + 30, b, 2 * c], step), ([90, 1, 7], f64::INFINITY)] {
                let borders = Borders { segments, reversed: [true, false, false] };
                let count = dicer.dice(corners, &borders, step, |_| true).triangles.len() as f64;
                let found = dicer.estimate(corners, &borders, step, 4000, k as u64);
                assert!((found / count - 1.0).abs() < 0.03, "{k}, {segments:?}: {found}, not {count}");
            }
        }
    }

    #[test]
    fn a_neighbours_points_alone_make_a_fan() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let borders = Borders { segments: [100, 1, 1], reversed: [true, false, false] };
        assert_eq!(check(corners, borders, f64::INFINITY), 100);
    }
}
