//! A scene of boxes along the axes, which knows exactly what a ray meets.

use esvo_shadow::effects::{Eye, Frame, Obstacles, Query};
use esvo_shadow::{Grid, Mesh, Pose, Shape, World};
use glam::{DVec3, Vec2, Vec3};

pub(crate) const GRID: Grid = Grid { origin: DVec3::ZERO, voxel: 0.05 };
pub(crate) const VOXELS: [u32; 3] = [80, 80, 48];

/// A box with a color.
#[derive(Clone, Copy)]
pub(crate) struct Block {
    pub(crate) low: Vec3,
    pub(crate) high: Vec3,
    pub(crate) color: Vec3,
}

pub(crate) struct Blocks(pub(crate) Vec<Block>);

/// Floor, a red wall behind, a box that stands, and a thin strip that no voxel can show.
pub(crate) fn room() -> Blocks {
    let block = |low: [f32; 3], high: [f32; 3], color: [f32; 3]| Block {
        low: low.into(),
        high: high.into(),
        color: color.into(),
    };
    Blocks(vec![
        block([0.02, 0.02, 0.03], [3.97, 3.97, 0.213], [0.7, 0.7, 0.7]),
        block([0.02, 3.51, 0.213], [3.97, 3.83, 2.11], [0.8, 0.1, 0.1]),
        block([1.52, 1.83, 0.213], [2.13, 2.47, 0.93], [0.2, 0.6, 0.3]),
        block([2.6, 1.0, 0.213], [3.4, 1.02, 0.238], [0.3, 0.3, 0.9]),
    ])
}

impl Blocks {
    /// Where a ray meets a block first: distance, normal and color.
    pub(crate) fn meet(&self, from: Vec3, direction: Vec3, length: f32) -> Option<(f32, Vec3, Vec3)> {
        let mut best = None;
        let mut nearest = length;
        for block in &self.0 {
            let (a, b) = ((block.low - from) / direction, (block.high - from) / direction);
            let (near, far) = (a.min(b), a.max(b));
            let (enter, leave) = (near.max_element(), far.min_element());
            if enter <= leave && enter > 0.0 && enter < nearest {
                nearest = enter;
                let axis = near.max_position();
                let mut normal = Vec3::ZERO;
                normal[axis] = -direction[axis].signum();
                best = Some((enter, normal, block.color));
            }
        }
        best
    }

    pub(crate) fn frame(&self, eye: Eye) -> Frame {
        Frame::of_rays(eye, &|from, direction| self.meet(from, direction, 100.0))
    }

    pub(crate) fn world(&self) -> World {
        let mut world = World::new(GRID, VOXELS, 2).unwrap();
        for block in &self.0 {
            let (corners, triangles) = cuboid(block.low.as_dvec3(), block.high.as_dvec3());
            world.add_fixed(&Shape::Mesh(Mesh::surface(corners, triangles).unwrap()), &Pose::IDENTITY).unwrap();
        }
        world.update(0);
        world
    }
}

impl Obstacles for Blocks {
    fn blocked(&self, queries: &[Query]) -> Vec<bool> {
        self.first(queries).iter().map(Option::is_some).collect()
    }

    fn first(&self, queries: &[Query]) -> Vec<Option<f32>> {
        let first = |query: &Query| {
            let from = query.from + query.normal * 1e-4;
            self.meet(from, query.direction, query.length).map(|(distance, ..)| distance)
        };
        queries.iter().map(first).collect()
    }
}

pub(crate) fn cuboid(low: DVec3, high: DVec3) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let corner =
        |i: u32| DVec3::from_array([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] }));
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    ((0..8).map(corner).collect(), triangles)
}

/// An eye that looks from a place to another.
pub(crate) fn eye(position: [f32; 3], target: [f32; 3], size: (u32, u32)) -> Eye {
    let position = Vec3::from(position);
    let forward = (Vec3::from(target) - position).normalize();
    let right = forward.cross(Vec3::Z).normalize();
    let half = Vec2::new(0.7 * size.0 as f32 / size.1 as f32, 0.7);
    Eye { position, right, up: right.cross(forward), forward, half, size }
}

/// Root of the mean squared difference.
pub(crate) fn rmse(a: &[f32], b: &[f32]) -> f32 {
    (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>() / a.len() as f32).sqrt()
}
