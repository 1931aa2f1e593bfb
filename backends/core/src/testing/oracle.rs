//! What a ray may hit, in double precision, with bounds of what single precision may do to it.
//!
//! # What is right
//! A ray is a line `o + t d`, whose components of `d` below [`EPSILON`] are replaced by it: that is how casters define it. A plane at
//! `p` is crossed at `t = (p - o) / d`. A voxel's span is where the line is in its cube, in the cubes and contours of its ancestors, in
//! its own contour, and in the ray's own span. The ray ends at the leaf or small enough voxel whose span begins first.
//!
//! # The bounds
//! With `u` = 2^-24, each operation of a caster is off by a factor of at most `1 + u`. With `a = 1 / |d|`, it computes
//! `coef = -a (1 + e)`, and along an axis that it does not mirror
//!
//! ```text
//! t = (p coef - o coef) = a (o - p)      error <= u (2 |t| + a (p + |o|))
//! ```
//!
//! the two `|t|` being the rounding of `coef`, which both products share, and that of the difference. Along an axis that it mirrors,
//! where `p` becomes `3 - p` and the bias `3 coef - o coef`,
//!
//! ```text
//! error <= u (2 |t| + a ((3 - p) + 3 + |o| + |3 - o|))
//! ```
//!
//! Where a voxel begins may be the middle plane of its parent, which is computed from the corner by one more product and sum. With the
//! voxel's edge `s`, that adds `u (5 a s + |t|)`. The planes of a contour are crossed at `N / S` with `S = sum n d` and
//! `N = sum t n d + q`: `Line::contour` bounds both and what the quotient makes of it; where `S` may be zero, anything is possible.
//! Terms of second order are covered by a factor, and the oracle's own errors by one of 2^-50.
//!
//! A voxel may be hit if its span, widened by the bounds, is not empty; it is certainly hit if the span is not empty when narrowed by
//! them. A caster is right if it ends at a voxel that may be hit, not behind one that is certainly hit, at a `t` within the bounds
//! of where the voxel begins; or if it misses and no voxel is certainly hit.

use std::fmt;

use esvo_format::Octree;

use crate::reference::{EPSILON, away_from_zero};
use crate::{Hit, Ray};

/// Half a unit in the last place of 1.
const U: f64 = 1.0 / (1u64 << 24) as f64;
/// For terms of second order.
const MORE: f64 = 1.0 + 1e-5;
/// Of the oracle's own operations, in all.
const OWN: f64 = 1.0 / (1u64 << 50) as f64;
/// Products may underflow by this. They do not overflow: [`MAX_ORIGIN`](crate::reference::MAX_ORIGIN).
const TINY: f64 = 1e-37;

/// An octree's object, and what is right there.
pub struct Oracle<'a> {
    octree: &'a Octree,
    root: u32,
    most_iterations: u64,
}

/// A hit or miss that is right.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Right {
    /// How far `t` is from the exact one, divided by the greater of the bounds to both sides; 0 for a miss and where both are 0.
    pub error: f64,
    /// Lower corner and edge of the voxel, for a hit.
    pub cube: Option<([f64; 3], f64)>,
}

/// What is wrong.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Mistake {
    /// The ray must not be cast: see [`Ray::is_cast`].
    NotCast,
    /// `t` is NaN or infinite, or before the ray begins or behind its end.
    Number(f32),
    /// More iterations than any ray can take, which is this number.
    Iterations(u64),
    /// A miss, although there is a voxel that the ray enters at this `t` and certainly hits.
    Missed(f64),
    /// The voxel is not on the ray, not one that ends rays, or behind one that the ray certainly hits before this `t`, which is infinite if there is none.
    Voxel(f64),
    /// `t`, which has this error and may have that.
    Error(f64, f64),
}

impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotCast => write!(f, "a hit of a ray that must not be cast"),
            Self::Number(t) => write!(f, "a hit at t = {t}, outside of the ray's span"),
            Self::Iterations(most) => write!(f, "more than {most} iterations"),
            Self::Missed(t) => write!(f, "a miss, although a voxel is hit at t = {t}"),
            Self::Voxel(t) if t.is_finite() => {
                write!(f, "a voxel that is not on the ray, or is behind t = {t}, where one is hit")
            }
            Self::Voxel(_) => write!(f, "a voxel that is not on the ray"),
            Self::Error(error, bound) => write!(f, "t is off by {error:e}, and may be by {bound:e}"),
        }
    }
}

impl<'a> Oracle<'a> {
    /// The oracle of an object of a [sound](Octree::sound) octree.
    ///
    /// # Panics
    /// The octree has no such object.
    pub fn new(octree: &'a Octree, object: usize) -> Self {
        let root = octree.objects()[object].root_slot as u32;
        // A ray crosses a grid of n cubes per edge in at most 3 n - 2 of them, and 4 of the 8 children of a cube.
        let mut nodes = vec![root];
        let mut most_iterations = 0;
        for level in 0.. {
            let cubes = (3u64 << level) - 2;
            most_iterations += 4 * cubes.min(nodes.len() as u64);
            nodes = nodes.iter().flat_map(|&node| children(octree, node).filter_map(|child| child.node)).collect();
            if nodes.is_empty() || level == 23 {
                break;
            }
        }
        Self { octree, root, most_iterations }
    }

    /// More iterations no ray takes, whatever it is: a ray crosses a grid of n³ cubes in at most 3n - 2 of them, enters each node at
    /// most once, and 4 of its 8 children.
    pub fn most_iterations(&self) -> u64 {
        self.most_iterations
    }

    /// Whether a caster that counts as the reference does is right.
    ///
    /// # Errors
    /// It is not; why.
    pub fn judge(&self, ray: &Ray, contours: bool, hit: &Hit) -> Result<Right, Mistake> {
        if u64::from(hit.iterations) > self.most_iterations {
            return Err(Mistake::Iterations(self.most_iterations));
        }
        self.judge_hit(ray, contours, hit)
    }

    /// The same for a caster that counts otherwise.
    ///
    /// # Errors
    /// It is not right; why.
    pub fn judge_hit(&self, ray: &Ray, contours: bool, hit: &Hit) -> Result<Right, Mistake> {
        let miss = Right { error: 0.0, cube: None };
        if !ray.is_cast() {
            return if hit.is_miss() { Ok(miss) } else { Err(Mistake::NotCast) };
        }
        let in_span = hit.raw_t.is_finite() && ray.t_min <= hit.raw_t && hit.raw_t <= ray.t_max;
        if !(hit.is_miss() || in_span) {
            return Err(Mistake::Number(hit.raw_t));
        }
        let line = Line::new(ray);
        let mut search = Search {
            octree: self.octree,
            line: &line,
            contours,
            hit: (!hit.is_miss()).then_some(*hit),
            certain: f64::INFINITY,
            certain_t: f64::INFINITY,
            found: None,
        };
        let span = Between { at: ray.t_min.into(), from: ray.t_min.into(), to: ray.t_min.into() };
        let end = Between { at: ray.t_max.into(), from: ray.t_max.into(), to: ray.t_max.into() };
        let cube = line.cube([1.0; 3], 1.0);
        search.descend(self.root, [1.0; 3], 1.0, Span { start: span.later(cube.start), end: end.earlier(cube.end) });
        let (certain, certain_t) = (search.certain, search.certain_t);
        if hit.is_miss() {
            return if certain < f64::INFINITY { Err(Mistake::Missed(certain_t)) } else { Ok(miss) };
        }
        let Some((start, corner, edge)) = search.found else { return Err(Mistake::Voxel(certain_t)) };
        let t = f64::from(hit.raw_t);
        if start.from > certain {
            return Err(Mistake::Voxel(certain_t));
        }
        let error = (t - start.at).abs();
        let bound = if t > start.at { start.to - start.at } else { start.at - start.from };
        if error > bound {
            return Err(Mistake::Error(error, bound));
        }
        // On the side of an exact number, as the ray's own beginning, the bound may be smaller than the error that a plane could have.
        let bound = (start.to - start.at).max(start.at - start.from);
        let error = if error == 0.0 { 0.0 } else { error / bound };
        Ok(Right { error, cube: Some((corner, edge)) })
    }
}

/// A child voxel.
struct Child {
    slot: u8,
    /// The slot of its descriptor, unless it is a leaf.
    node: Option<u32>,
    contour: Option<u32>,
}

/// The children of a node, in the order of their slots.
fn children(octree: &Octree, node: u32) -> impl Iterator<Item = Child> {
    let descriptor = octree.descriptor(node);
    let is_in = |mask: u8, slot: u8| mask >> slot & 1 != 0;
    (0..8u8).filter(move |&slot| is_in(descriptor.valid_mask(), slot)).map(move |slot| {
        let contour = is_in(descriptor.contour_mask(), slot)
            .then(|| octree.words()[(2 * node + descriptor.contour_ptr() + descriptor.contour_rank(slot)) as usize]);
        let inner = !is_in(descriptor.leaf_mask(), slot);
        Child { slot, node: inner.then(|| octree.first_child(node) + descriptor.child_rank(slot)), contour }
    })
}

/// A number that a caster knows to be between two, and what it is.
#[derive(Clone, Copy, Debug)]
struct Between {
    at: f64,
    from: f64,
    to: f64,
}

impl Between {
    fn new(at: f64, error: f64) -> Self {
        Self { at, from: at - error, to: at + error }
    }

    fn later(self, other: Self) -> Self {
        Self { at: self.at.max(other.at), from: self.from.max(other.from), to: self.to.max(other.to) }
    }

    fn earlier(self, other: Self) -> Self {
        Self { at: self.at.min(other.at), from: self.from.min(other.from), to: self.to.min(other.to) }
    }
}

#[derive(Clone, Copy)]
struct Span {
    start: Between,
    end: Between,
}

impl Span {
    fn intersect(self, other: Self) -> Self {
        Self { start: self.start.later(other.start), end: self.end.earlier(other.end) }
    }

    fn may_be(self) -> bool {
        self.start.from <= self.end.to
    }

    fn is_certain(self) -> bool {
        self.start.to <= self.end.from
    }
}

/// A ray as casters define it.
struct Line {
    origin: [f64; 3],
    direction: [f64; 3],
    size_at_origin: f64,
    size_per_t: f64,
}

impl Line {
    fn new(ray: &Ray) -> Self {
        Self {
            origin: ray.origin.to_array().map(f64::from),
            direction: ray.direction.to_array().map(|d| away_from_zero(d).into()),
            size_at_origin: ray.size_at_origin.into(),
            size_per_t: ray.size_per_t.into(),
        }
    }

    /// Where the plane at `p` is crossed, and the bound.
    fn crossing(&self, axis: usize, p: f64) -> (f64, f64) {
        let (o, d) = (self.origin[axis], self.direction[axis]);
        let a = 1.0 / d.abs();
        let t = (p - o) / d;
        let parts = if d > 0.0 { (3.0 - p) + 3.0 + o.abs() + (3.0 - o).abs() } else { p + o.abs() };
        (t, U * MORE * (2.0 * t.abs() + a * parts) + OWN * (t.abs() + a * (p + o.abs())) + TINY)
    }

    /// Where the ray is in a cube. Its end is where it leaves the cube, whatever else ends it.
    fn cube(&self, corner: [f64; 3], edge: f64) -> Span {
        let mut span = Span { start: Between::new(f64::NEG_INFINITY, 0.0), end: Between::new(f64::INFINITY, 0.0) };
        for axis in 0..3 {
            let (low, high) = (corner[axis], corner[axis] + edge);
            let against = self.direction[axis] < 0.0;
            let (near, far) = if against { (high, low) } else { (low, high) };
            let (t, error) = self.crossing(axis, near);
            let extra = U * MORE * (5.0 * edge / self.direction[axis].abs() + t.abs());
            span.start = span.start.later(Between::new(t, error + extra));
            let (t, error) = self.crossing(axis, far);
            span.end = span.end.earlier(Between::new(t, error));
        }
        span
    }

    /// Where the ray is between the planes of a contour.
    fn contour(&self, word: u32, corner: [f64; 3], edge: f64) -> Span {
        let anywhere = Span {
            start: Between { at: f64::NEG_INFINITY, from: f64::NEG_INFINITY, to: f64::INFINITY },
            end: Between { at: f64::INFINITY, from: f64::NEG_INFINITY, to: f64::INFINITY },
        };
        // A field with the fields below it, as casters read it.
        let field = |shift: u32| f64::from((word << shift) as i32);
        let normal = [field(14), field(20), field(26)];
        let (mut sum, mut sum_of_sizes) = (0.0, 0.0);
        let position = field(7) * edge * 1.5;
        let (mut above, mut above_sizes, mut above_error) = (position, position.abs(), 0.0);
        for axis in 0..3 {
            let weight = normal[axis] * self.direction[axis];
            let middle = corner[axis] + edge * 0.5;
            let (t, _) = self.crossing(axis, middle);
            // From the corner that the ray leaves by, as `t_centre`.
            let far = if self.direction[axis] < 0.0 { corner[axis] } else { corner[axis] + edge };
            let (_, error) = self.crossing(axis, far);
            let error = error + U * MORE * (edge / self.direction[axis].abs() + t.abs());
            sum += weight;
            sum_of_sizes += weight.abs();
            above += t * weight;
            above_sizes += (t * weight).abs();
            above_error += weight.abs() * error;
        }
        let sum_error = (3.0 * U * MORE + OWN) * sum_of_sizes;
        let above_error = above_error + (7.0 * U * MORE + OWN) * above_sizes;
        if sum.abs() <= 2.0 * sum_error || sum.abs() < 1.5 * f64::from(EPSILON) {
            return anywhere;
        }
        let (middle, half) = (above / sum, (f64::from(word) * edge * 0.75 / sum).abs());
        let relative = sum_error / sum.abs() + 2.0 * U;
        let error = (above_error + above.abs() * relative) / (sum.abs() - sum_error)
            + half * (relative + 3.0 * U) * MORE
            + U * (middle.abs() + half);
        Span { start: Between::new(middle - half, error), end: Between::new(middle + half, error) }
    }

    /// Whether the ray may end, and certainly ends, at a voxel of this edge that it leaves at `leave`.
    fn ends_by_size(&self, leave: Between, edge: f64) -> (bool, bool) {
        if self.size_at_origin == 0.0 && self.size_per_t == 0.0 {
            return (false, false);
        }
        let grown = |t: f64| t * self.size_per_t;
        let (a, b) = (grown(leave.from), grown(leave.to));
        let error = 2.0 * U * MORE * (a.abs().max(b.abs()) + self.size_at_origin.abs()) + TINY;
        let (a, b) = (a + self.size_at_origin, b + self.size_at_origin);
        if !(a.is_finite() && b.is_finite() && error.is_finite()) {
            return (true, false);
        }
        (a.max(b) + error >= edge, a.min(b) - error >= edge)
    }
}

/// The search for what ends a ray.
struct Search<'a> {
    octree: &'a Octree,
    line: &'a Line,
    contours: bool,
    hit: Option<Hit>,
    /// At the latest, the first voxel that certainly ends the ray begins here; and where it does in truth.
    certain: f64,
    certain_t: f64,
    /// Where the hit voxel begins, its corner and edge.
    found: Option<(Between, [f64; 3], f64)>,
}

impl Search<'_> {
    fn descend(&mut self, node: u32, corner: [f64; 3], edge: f64, span: Span) {
        let half = edge * 0.5;
        // Front to back.
        let nearest = (0..3).fold(0u8, |bits, axis| bits | u8::from(self.line.direction[axis] < 0.0) << axis);
        let mut all: Vec<_> = children(self.octree, node).collect();
        all.sort_by_key(|child| child.slot ^ nearest);
        for child in all {
            let at: [f64; 3] = std::array::from_fn(|axis| corner[axis] + half * f64::from(child.slot >> axis & 1));
            let cube = self.line.cube(at, half);
            let here = span.intersect(cube);
            if !here.may_be() || here.start.from > self.certain {
                continue;
            }
            let (may_end, ends) = self.line.ends_by_size(cube.end, half);
            if may_end {
                self.end(node, child.slot, at, half, here, ends);
                if ends {
                    continue;
                }
            }
            let here = match child.contour.filter(|_| self.contours) {
                Some(word) => here.intersect(self.line.contour(word, at, half)),
                None => here,
            };
            if !here.may_be() {
                continue;
            }
            match child.node {
                None => self.end(node, child.slot, at, half, here, true),
                Some(below) => self.descend(below, at, half, here),
            }
        }
    }

    /// A voxel at which the ray may end, if it is there, or must.
    fn end(&mut self, node: u32, slot: u8, corner: [f64; 3], edge: f64, span: Span, ends: bool) {
        if ends && span.is_certain() && span.start.to < self.certain {
            (self.certain, self.certain_t) = (span.start.to, span.start.at);
        }
        let Some(hit) = self.hit else { return };
        if hit.slot == node && hit.child() == slot && f64::from(hit.size()) == edge {
            let t = f64::from(hit.raw_t);
            let distance = |start: &Between| (t - start.at).abs();
            if self.found.is_none_or(|(before, ..)| distance(&span.start) < distance(&before)) {
                self.found = Some((span.start, corner, edge));
            }
        }
    }
}
