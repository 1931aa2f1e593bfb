//! Which voxels meet a set of triangles, by the separating axis theorem in integers: thirteen directions, with both the
//! triangle and the cube closed. Nothing here rounds, and no code is shared with the builder.

use std::collections::HashSet;

use glam::DVec3;
use num_bigint::BigInt;

use super::integers::{Integer, Vector, cross, dot, exponent_of, integer, sub};

/// The root cube, and the unit in which all coordinates are integers.
pub(crate) struct Space<T> {
    /// One unit is `2^-exponent` of the mesh's unit.
    exponent: i32,
    pub origin: Vector<T>,
    /// Edge of the root cube.
    extent: BigInt,
}

/// Which points of a cube belong to it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Cube {
    /// All points.
    Closed,
    /// All points except the upper faces. This is wrong: the tests must notice it.
    HalfOpen,
}

/// A triangle, projected to each of the directions that can separate it from a cube.
pub(crate) struct Projected<T> {
    axes: Vec<Axis<T>>,
}

struct Axis<T> {
    direction: Vector<T>,
    /// The triangle's extent, times two.
    lo: T,
    hi: T,
    /// Extent of a cube of edge 1.
    reach: T,
    is_cubes: bool,
}

impl<T: Integer> Space<T> {
    /// A space in which this cube, its cubes down to level `levels`, `2^-extra_bits` of its edge, and these points
    /// are integers.
    pub(crate) fn new(
        origin: DVec3,
        extent: f64,
        points: impl Iterator<Item = DVec3>,
        levels: u32,
        extra_bits: i32,
    ) -> Self {
        let mut exponent = exponent_of(extent) + (levels as i32).max(extra_bits);
        for p in points.chain([origin]) {
            exponent = p.to_array().into_iter().map(exponent_of).fold(exponent, i32::max);
        }
        let convert = |x: f64| T::try_from(integer(x, exponent)).unwrap();
        Self { exponent, origin: origin.to_array().map(convert), extent: integer(extent, exponent) }
    }

    pub(crate) fn point(&self, p: DVec3) -> Vector<T> {
        p.to_array().map(|x| T::try_from(integer(x, self.exponent)).unwrap())
    }

    /// `2^-level` of the root cube's edge.
    pub(crate) fn edge(&self, level: u32) -> T {
        assert!(self.extent.trailing_zeros() >= Some(level.into()), "the unit is too large");
        T::try_from(&self.extent >> level).unwrap()
    }
}

impl<T: Integer> Projected<T> {
    pub(crate) fn new(triangle: &[Vector<T>; 3]) -> Self {
        let units: [Vector<T>; 3] = std::array::from_fn(|i| std::array::from_fn(|j| T::from(i64::from(i == j))));
        let edges: [Vector<T>; 3] = std::array::from_fn(|i| sub(&triangle[(i + 1) % 3], &triangle[i]));
        let mut axes: Vec<Axis<T>> = units.iter().map(|unit| Axis::new(unit.clone(), triangle, true)).collect();
        axes.push(Axis::new(cross(&edges[0], &edges[1]), triangle, false));
        for edge in &edges {
            axes.extend(units.iter().map(|unit| Axis::new(cross(edge, unit), triangle, false)));
        }
        Self { axes }
    }

    /// Whether the triangle meets a cube, given by its lower corner and edge.
    pub(crate) fn meets(&self, corner: &Vector<T>, edge: &T, cube: Cube) -> bool {
        let centre: Vector<T> = std::array::from_fn(|i| corner[i].clone() + corner[i].clone() + edge.clone());
        self.axes.iter().all(|axis| {
            let at = dot(&axis.direction, &centre);
            let reach = axis.reach.clone() * edge.clone();
            let (lo, hi) = (at.clone() - reach.clone(), at + reach);
            let below = if axis.is_cubes && cube == Cube::HalfOpen { axis.lo < hi } else { axis.lo <= hi };
            below && axis.hi >= lo
        })
    }
}

impl<T: Integer> Axis<T> {
    fn new(direction: Vector<T>, triangle: &[Vector<T>; 3], is_cubes: bool) -> Self {
        let twice = triangle.each_ref().map(|p| {
            let d = dot(&direction, p);
            d.clone() + d
        });
        let magnitude = |x: &T| x.clone().max(-x.clone());
        let reach = (1..3).fold(magnitude(&direction[0]), |sum, i| sum + magnitude(&direction[i]));
        let [a, b, c] = twice;
        let lo = a.clone().min(b.clone()).min(c.clone());
        Self { direction, lo, hi: a.max(b).max(c), reach, is_cubes }
    }
}

/// A voxel: its level and its position in voxels of that level.
pub(crate) type Voxel = (u32, [u32; 3]);

/// Every voxel of levels `1..=levels` that meets one of the triangles. Only children of such voxels can meet one.
pub(crate) fn voxels<T: Integer>(
    space: &Space<T>,
    triangles: &[Projected<T>],
    levels: u32,
    cube: Cube,
) -> HashSet<Voxel> {
    struct Walk<'a, T> {
        space: &'a Space<T>,
        triangles: &'a [Projected<T>],
        edges: Vec<T>,
        cube: Cube,
        found: HashSet<Voxel>,
    }
    impl<T: Integer> Walk<'_, T> {
        fn children(&mut self, (level, at): Voxel, corner: &Vector<T>, inside: &[usize]) {
            let Some(edge) = self.edges.get(level as usize).cloned() else { return };
            for slot in 0..8u32 {
                let bits: [u32; 3] = std::array::from_fn(|axis| slot >> axis & 1);
                let voxel = (level + 1, std::array::from_fn(|axis| 2 * at[axis] + bits[axis]));
                let corner: Vector<T> = std::array::from_fn(|axis| {
                    if bits[axis] == 0 { corner[axis].clone() } else { corner[axis].clone() + edge.clone() }
                });
                let inside: Vec<usize> =
                    inside.iter().copied().filter(|t| self.triangles[*t].meets(&corner, &edge, self.cube)).collect();
                if !inside.is_empty() {
                    self.found.insert(voxel);
                    self.children(voxel, &corner, &inside);
                }
            }
        }
    }
    let edges = (1..=levels).map(|level| space.edge(level)).collect();
    let mut walk = Walk { space, triangles, edges, cube, found: HashSet::new() };
    let all: Vec<usize> = (0..triangles.len()).collect();
    walk.children((0, [0; 3]), &walk.space.origin.clone(), &all);
    walk.found
}
