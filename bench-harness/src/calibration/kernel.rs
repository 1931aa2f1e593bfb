//! The frozen kernel: octree, rays and traversal of a calibration cast.
//!
//! Nothing here is tuned, and nothing here uses another crate's code: times of this kernel on the same machine differ only because
//! of the machine. Whoever changes what it computes or how raises [`VERSION`]; a test holds [`CHECKSUM`].
//!
//! The traversal is the plainest there is: it finds the cube that holds a point of the ray from the root down, leaves it if it is
//! empty, and starts from the root again. Like the casters, it spends its time on dependent loads, comparisons of floats and branches
//! that cannot be foreseen. Sums, products and quotients of `f32` round alike on all processors, so that its answers are the same
//! everywhere.

/// Version of octree, rays and traversal. Times of two versions cannot be compared.
pub const VERSION: u32 = 1;
/// [`Kernel::fold`] of all answers.
pub(super) const CHECKSUM: u64 = 0x2691_4e99_cc5d_68ff;

/// Levels of the octree below its root.
const LEVELS: u32 = 8;
/// Edge of the root in voxels.
const EDGE: i32 = 1 << LEVELS;
/// Width of the picture in pixels.
const WIDTH: usize = 256;
/// Height of the picture in pixels.
const HEIGHT: usize = 192;
/// Rows of a task.
const ROWS: usize = 4;
/// Tasks of a cast, each for a thread to take.
pub(super) const TASKS: usize = HEIGHT / ROWS;
/// Rays of a cast.
pub(super) const RAYS: u64 = (WIDTH * HEIGHT) as u64;
/// A ray that takes more steps is a miss.
const STEPS: usize = 1024;
/// How far behind the border of a cube the next one is looked for, in edges of the root times the length of the direction.
const BUMP: f32 = 1e-5;
/// Position of the camera; the root is the cube from 0 to 1.
const EYE: [f32; 3] = [0.53, 0.47, -0.35];

/// A cube that is not empty. Of the deepest cubes, `first` is the number of the first voxel.
#[derive(Clone, Copy)]
struct Node {
    /// Bit `x + 2 y + 4 z` is set for each child that is not empty.
    mask: u32,
    /// Index of the first child; the others follow.
    first: u32,
}

/// The octree.
pub(super) struct Kernel {
    nodes: Vec<Node>,
}

impl Kernel {
    /// Three spherical shells, one inside the other, the outer two with holes, as voxels.
    pub(super) fn new() -> Self {
        let mut nodes = Vec::new();
        let mut cubes = vec![[0, 0, 0]];
        let mut edge = EDGE;
        while edge > 1 {
            edge /= 2;
            let mut children = Vec::new();
            // Children have the indices after all cubes of this level; voxels are numbered from 0.
            let before = if edge > 1 { nodes.len() + cubes.len() } else { 0 };
            for cube in cubes {
                let first = (before + children.len()) as u32;
                let mut mask = 0;
                for slot in 0..8 {
                    let child: [i32; 3] = std::array::from_fn(|axis| cube[axis] + edge * (slot >> axis & 1));
                    if is_met(child, edge) {
                        mask |= 1 << slot;
                        children.push(child);
                    }
                }
                nodes.push(Node { mask, first });
            }
            cubes = children;
        }
        Self { nodes }
    }

    /// The answers of a task, folded into one number.
    #[inline(never)]
    pub(super) fn cast_task(&self, task: usize) -> u64 {
        let mut sum = task as u64;
        for y in task * ROWS..(task + 1) * ROWS {
            for x in 0..WIDTH {
                let across = (x as f32 + 0.5) / WIDTH as f32 - 0.5;
                let down = (y as f32 + 0.5) / HEIGHT as f32 - 0.5;
                // Turned a little, so that no component is zero.
                let direction = [across * 0.9 + 0.031, down * 0.7 - 0.017, 1.0 - across * 0.1];
                sum = Self::fold(sum, self.cast(EYE, direction).into());
            }
        }
        sum
    }

    /// A number that depends on all that were folded into it and on their order.
    pub(super) fn fold(sum: u64, next: u64) -> u64 {
        (sum ^ next).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23)
    }

    /// The number of the voxel that a ray hits, plus 1; 0 for a miss.
    fn cast(&self, origin: [f32; 3], direction: [f32; 3]) -> u32 {
        let inverse = direction.map(|d| 1.0 / d);
        let (mut t, mut end) = (0.0f32, f32::INFINITY);
        for axis in 0..3 {
            let (a, b) = (-origin[axis] * inverse[axis], (1.0 - origin[axis]) * inverse[axis]);
            t = t.max(a.min(b));
            end = end.min(a.max(b));
        }
        for _ in 0..STEPS {
            if t >= end {
                return 0;
            }
            let mut cell = [0; 3];
            for axis in 0..3 {
                let at = (origin[axis] + direction[axis] * (t + BUMP)) * EDGE as f32;
                cell[axis] = (at as i32).clamp(0, EDGE - 1);
            }
            let mut node = 0;
            let mut edge = EDGE;
            loop {
                edge /= 2;
                let bit = |axis: usize| u32::from(cell[axis] & edge != 0) << axis;
                let slot = bit(0) | bit(1) | bit(2);
                let Node { mask, first } = self.nodes[node];
                if mask >> slot & 1 == 0 {
                    break;
                }
                let child = first + (mask & ((1 << slot) - 1)).count_ones();
                if edge == 1 {
                    return child + 1;
                }
                node = child as usize;
            }
            // Leave the empty cube.
            let mut leave = f32::INFINITY;
            for axis in 0..3 {
                let low = cell[axis] & !(edge - 1);
                let plane = if direction[axis] > 0.0 { low + edge } else { low };
                leave = leave.min((plane as f32 / EDGE as f32 - origin[axis]) * inverse[axis]);
            }
            t = leave.max(t + BUMP);
        }
        0
    }
}

/// Whether a cube meets the shape. `low` is its lower corner and `edge` its edge in voxels.
fn is_met(low: [i32; 3], edge: i32) -> bool {
    // Shells by radius in voxels, and the edge of the cubes of which every third is left out; 0: none is.
    const SHELLS: [(i32, i32); 3] = [(120, 16), (83, 8), (41, 0)];
    let (mut nearest, mut farthest) = (0, 0);
    for low in low {
        let (from, to) = (low - EDGE / 2, low + edge - EDGE / 2);
        let near = if from > 0 {
            from
        } else if to < 0 {
            -to
        } else {
            0
        };
        let far = from.abs().max(to.abs());
        nearest += near * near;
        farthest += far * far;
    }
    SHELLS.iter().any(|&(radius, hole)| {
        let is_hole = hole >= edge && hole > 0 && low.map(|x| x / hole).iter().sum::<i32>() % 3 == 0;
        nearest <= radius * radius && radius * radius <= farthest && !is_hole
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checksum(kernel: &Kernel) -> u64 {
        (0..TASKS).fold(0, |sum, task| Kernel::fold(sum, kernel.cast_task(task)))
    }

    /// Fails if octree, rays or traversal change: then times are no longer those of this version.
    #[test]
    fn the_answers_are_those_of_this_version() {
        assert_eq!((VERSION, checksum(&Kernel::new())), (1, CHECKSUM));
    }

    /// The negative controls: one voxel less, and a ray that goes a little elsewhere.
    #[test]
    fn a_change_shows_in_the_checksum() {
        let mut kernel = Kernel::new();
        let (ray, beside) = ([0.1, 0.05, 1.0], [0.1, 0.06, 1.0]);
        let hit = kernel.cast(EYE, ray);
        assert!(hit > 0 && kernel.cast(EYE, [0.1, 0.05, -1.0]) == 0);
        assert_ne!(hit, kernel.cast(EYE, beside), "rays through different voxels");
        // The node that has the voxel: those of the deepest level come last, and number voxels from 0.
        let deepest = kernel.nodes.iter().position(|node| node.first == 0).unwrap();
        let node = deepest + kernel.nodes[deepest..].partition_point(|node| node.first < hit) - 1;
        kernel.nodes[node].mask = 0;
        assert_ne!(kernel.cast(EYE, ray), hit);
        assert_ne!(checksum(&kernel), CHECKSUM);
    }

    /// The picture has hits on all shells and misses, so that the traversal is exercised.
    #[test]
    fn the_picture_shows_holes_and_all_shells() {
        let kernel = Kernel::new();
        assert_eq!(kernel.nodes.len(), 100_049);
        let hits: Vec<u32> = (0..WIDTH * HEIGHT)
            .map(|i| {
                let (x, y) = (i % WIDTH, i / WIDTH);
                let direction = [x as f32 / WIDTH as f32 - 0.5, y as f32 / HEIGHT as f32 - 0.5, 1.001];
                kernel.cast(EYE, direction)
            })
            .collect();
        let misses = hits.iter().filter(|&&hit| hit == 0).count();
        assert!(misses > 100 && misses < hits.len() / 2, "{misses}");
    }
}
