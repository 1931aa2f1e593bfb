//! Whether a contour encloses the surface in its voxel, in integers.
//!
//! The intersection of a triangle and a cube is a convex polygon. Each of its corners is a corner of the triangle, or the
//! intersection of an edge of the triangle with a face of the cube, or of an edge of the cube with the triangle. All of these
//! are fractions of integers, and all of them are tested.

use num_bigint::BigInt;

use super::integers::{Vector, cross, dot, sub};

/// A contour's slab, decoded from its word as the specification says, in units of `2^-28`.
pub(crate) struct Slab {
    normal: Vector<BigInt>,
    lo: BigInt,
    hi: BigInt,
}

impl Slab {
    pub(crate) fn decode(word: u32) -> Self {
        let signed = |shift: u32| BigInt::from((word << shift) as i32);
        let position = signed(7) * 6;
        let half = BigInt::from(word) * 3;
        let normal = [14, 20, 26].map(|shift| signed(shift) * 4);
        Self { normal, lo: &position - &half, hi: position + half }
    }
}

/// A cube, given by its lower corner and edge.
pub(crate) struct Cube {
    pub corner: Vector<BigInt>,
    pub edge: BigInt,
}

/// A point: integer coordinates divided by a positive integer.
struct Fraction {
    p: Vector<BigInt>,
    over: BigInt,
}

impl Fraction {
    fn new(p: Vector<BigInt>, over: BigInt) -> Self {
        if over < BigInt::ZERO { Self { p: p.map(|x| -x), over: -over } } else { Self { p, over } }
    }

    fn is_in(&self, cube: &Cube) -> bool {
        (0..3).all(|axis| {
            let lo = &cube.corner[axis] * &self.over;
            self.p[axis] >= lo && self.p[axis] <= lo + &cube.edge * &self.over
        })
    }

    /// `None` if the point is in the slab of the cube, else whether it is below the slab.
    fn is_outside(&self, slab: &Slab, cube: &Cube) -> Option<bool> {
        // Compares n·(p - centre) with lo and hi, in units of the cube's edge; everything times two.
        let from_centre: Vector<BigInt> =
            std::array::from_fn(|axis| &self.p[axis] * 2 - (&cube.corner[axis] * 2 + &cube.edge) * &self.over);
        let at = dot(&slab.normal, &from_centre);
        let unit = &cube.edge * &self.over * 2;
        if at < &slab.lo * &unit {
            Some(true)
        } else if at > &slab.hi * &unit {
            Some(false)
        } else {
            None
        }
    }
}

/// Passes the corners of the intersection of triangle and cube to `visit`, some more than once.
fn corners(triangle: &[Vector<BigInt>; 3], cube: &Cube, visit: &mut dyn FnMut(&Fraction)) {
    let faces: [[BigInt; 2]; 3] = std::array::from_fn(|i| [cube.corner[i].clone(), &cube.corner[i] + &cube.edge]);
    let mut found = |point: Fraction| {
        if point.is_in(cube) {
            visit(&point);
        }
    };
    for (i, a) in triangle.iter().enumerate() {
        found(Fraction { p: a.clone(), over: BigInt::from(1) });
        let b = &triangle[(i + 1) % 3];
        let along = sub(b, a);
        for axis in (0..3).filter(|axis| along[*axis] != BigInt::ZERO) {
            for face in &faces[axis] {
                // a + along * t / over, where 0 <= t / over <= 1.
                let (t, over) = (face - &a[axis], &along[axis]);
                let inside = if *over > BigInt::ZERO {
                    t >= BigInt::ZERO && t <= *over
                } else {
                    t <= BigInt::ZERO && t >= *over
                };
                if inside {
                    let p = std::array::from_fn(|k| &a[k] * over + &along[k] * &t);
                    found(Fraction::new(p, over.clone()));
                }
            }
        }
    }
    let normal = cross(&sub(&triangle[1], &triangle[0]), &sub(&triangle[2], &triangle[0]));
    let at = dot(&normal, &triangle[0]);
    for axis in (0..3).filter(|axis| normal[*axis] != BigInt::ZERO) {
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
        for (y, z) in faces[j].iter().flat_map(|y| faces[k].iter().map(move |z| (y, z))) {
            let over = &normal[axis];
            let mut p = [BigInt::ZERO, BigInt::ZERO, BigInt::ZERO];
            p[axis] = &at - &normal[j] * y - &normal[k] * z;
            (p[j], p[k]) = (y * over, z * over);
            // In the plane of the triangle, seen along the axis: on which side of the three edges is the point?
            let sides = [0, 1, 2].map(|i| {
                let (a, b) = (&triangle[i], &triangle[(i + 1) % 3]);
                (&b[j] - &a[j]) * (z - &a[k]) - (&b[k] - &a[k]) * (y - &a[j])
            });
            let inside = sides.iter().all(|s| *s >= BigInt::ZERO) || sides.iter().all(|s| *s <= BigInt::ZERO);
            if inside {
                found(Fraction::new(p, over.clone()));
            }
        }
    }
}

/// Whether the part of the triangle in the cube is completely in the slab.
pub(crate) fn encloses(slab: &Slab, cube: &Cube, triangle: &[Vector<BigInt>; 3]) -> bool {
    let mut all = true;
    corners(triangle, cube, &mut |point| all &= point.is_outside(slab, cube).is_none());
    all
}
