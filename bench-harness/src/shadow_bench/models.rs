//! Voxel models of a small scene, generated: a courtyard with things that move in it.

use esvo_shadow::{Cubes, Pose, Rule, Shape};
use glam::{DQuat, DVec3, IVec3};

use super::stage::failed;
use crate::BenchError;

/// Edge of a model's cubes in metres.
pub(super) const EDGE: f64 = 0.1;

/// A model: its cubes, and the color of each by a rule.
pub(super) struct Model {
    pub(super) cubes: Vec<[i32; 3]>,
    pub(super) color: [u8; 3],
    /// Whether it moves.
    pub(super) moves: bool,
    pub(super) pose: Pose,
}

impl Model {
    /// As an object of a volume.
    pub(super) fn shape(&self) -> Result<Shape, BenchError> {
        let cubes = Cubes::new(self.cubes.iter().copied(), EDGE, Rule::Touch);
        cubes.map(Shape::Cubes).map_err(|e| failed("models", e))
    }
}

fn cubes(low: [i32; 3], high: [i32; 3], keep: impl Fn(IVec3) -> bool) -> Vec<[i32; 3]> {
    let mut cubes = Vec::new();
    for z in low[2]..high[2] {
        for y in low[1]..high[1] {
            for x in low[0]..high[0] {
                if keep(IVec3::new(x, y, z)) {
                    cubes.push([x, y, z]);
                }
            }
        }
    }
    cubes
}

/// A courtyard of 10 m x 10 m, its walls, pillars and an arch, and things that stand and roll about, turned in every way.
pub(super) fn courtyard() -> Vec<Model> {
    let at = |x: f64, y: f64, z: f64, turn: DQuat| Pose { rotation: turn, position: DVec3::new(x, y, z) };
    let model = |cubes, color, moves, pose| Model { cubes, color, moves, pose };
    let mut models = vec![
        // The ground, which is as good as endless in the picture.
        model(cubes([0, 0, 0], [100, 100, 3], |_| true), [168, 160, 150], false, at(0.0, 0.0, 0.0, DQuat::IDENTITY)),
        // Two walls with windows.
        model(
            cubes([0, 0, 0], [100, 4, 32], |c| !(c.x % 20 > 7 && c.x % 20 < 14 && c.z > 12 && c.z < 24)),
            [196, 120, 92],
            false,
            at(0.0, 9.6, 0.3, DQuat::IDENTITY),
        ),
        model(
            cubes([0, 0, 0], [4, 96, 32], |c| !(c.y % 24 > 8 && c.y % 24 < 16 && c.z > 8 && c.z < 24)),
            [190, 176, 140],
            false,
            at(0.0, 0.0, 0.3, DQuat::IDENTITY),
        ),
        // An arch.
        model(
            cubes([0, 0, 0], [36, 8, 26], |c| {
                let (x, z) = (f64::from(c.x) - 17.5, f64::from(c.z) - 10.0);
                (x.hypot(z.max(0.0)) > 12.0 || z < 0.0 && x.abs() > 12.0) && (x.hypot(z.max(0.0)) < 17.5 || z < 0.0)
            }),
            [150, 152, 160],
            false,
            at(5.2, 5.6, 0.3, DQuat::from_rotation_z(-0.35)),
        ),
    ];
    let ball = cubes([-7, -7, -7], [7, 7, 7], |c| (c.as_dvec3() + 0.5).length() < 6.6);
    let crate_cubes = cubes([0, 0, 0], [9, 9, 9], |c| {
        let rim = [c.x, c.y, c.z].iter().filter(|&&x| x == 0 || x == 8).count();
        rim >= 2 || rim == 1 && (c.x + c.y + c.z) % 3 > 0
    });
    let pillar = cubes([-4, -4, 0], [4, 4, 26], |c| {
        let far = (c.as_dvec3().truncate() + 0.5).length();
        far < if c.z < 3 || c.z > 22 { 4.0 } else { 2.7 }
    });
    for i in 0..4 {
        models.push(model(
            pillar.clone(),
            [205, 200, 186],
            false,
            at(2.2 + 1.9 * f64::from(i), 8.2, 0.3, DQuat::IDENTITY),
        ));
    }
    for i in 0..7 {
        let a = f64::from(i) * 0.9;
        let turn = DQuat::from_rotation_z(a) * DQuat::from_rotation_x(0.4 * a);
        let place =
            at(2.0 + 0.95 * f64::from(i), 3.0 + 1.6 * (2.3 * a).sin(), 0.75 + 0.1 * (a * 1.7).cos().abs(), turn);
        let (cubes, color) = if i % 2 == 0 { (&crate_cubes, [178, 128, 70]) } else { (&ball, [70, 110, 176]) };
        models.push(model(cubes.clone(), color, true, place));
    }
    models
}
