//! Rays that try to leave closed rooms.

use esvo_shadow::rooms::{Room, Wall};
use esvo_shadow::trace::{FRACTION_BITS, Fidelity, Ray, Steps, is_blocked};
use glam::{DMat3, DQuat, EulerRot};
use rayon::prelude::*;

use super::LeakRow;
use super::stage::failed;
use crate::{BenchError, Progress};

/// Voxels along the edge of a room's volume.
const EDGE: u32 = 48;
/// Boxes turned to so many directions, and a ball.
const TURNS: u32 = 11;
/// Voxels from sample to sample.
const STEPS: [f64; 5] = [0.1, 0.25, 0.5, 1.0, 2.0];

/// Numbers from a seed, which rays of all machines have in common.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u32) -> i32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) % u64::from(end)) as i32
    }
}

/// Traces about `rays` rays in rooms with each wall, in each way.
pub(super) fn leaks(rays: u64, progress: &Progress) -> Result<Vec<LeakRow>, BenchError> {
    let mut rows = Vec::new();
    for wall in Wall::ALL {
        let name = format!("{wall:?}").to_lowercase();
        progress.say(format!("leaks of walls of {name}"));
        let turn = |i: u32| {
            let angle = f64::from(i) * 0.137;
            DMat3::from_quat(DQuat::from_euler(EulerRot::XYZ, angle, 2.0 * angle, 3.1 * angle))
        };
        let turns = (0..TURNS).map(|i| Some(turn(i))).chain([None]);
        let rooms: Vec<Room> = turns
            .map(|turned| Room::new(EDGE, 2, wall, turned).map_err(|e| failed("rooms", e)))
            .collect::<Result<_, _>>()?;
        let each = rays.div_ceil(3 * rooms.len() as u64 * 64);
        let parts: Vec<(usize, u64)> =
            (0..rooms.len()).flat_map(|room| (0..64).map(move |part| (room, part))).collect();
        let counts = parts.par_iter().map(|&(room, part)| {
            let mut random = Random(part * 1_000_003 + room as u64);
            let mut counts = [0u64; STEPS.len() + 1];
            for _ in 0..each {
                let ray = ray(&rooms[room], &mut random);
                counts[0] += u64::from(!is_blocked(&rooms[room].volume, &ray, Fidelity::EXACT).0);
                for (count, length) in counts[1..].iter_mut().zip(STEPS) {
                    let free = Steps::new(&ray, length)
                        .is_ok_and(|steps| steps.first_hit(&rooms[room].volume, &ray, Fidelity::EXACT).hit.is_none());
                    *count += u64::from(free);
                }
            }
            counts
        });
        let add = |a: [u64; STEPS.len() + 1], b: [u64; STEPS.len() + 1]| std::array::from_fn(|i| a[i] + b[i]);
        let counts = counts.reduce(|| [0; STEPS.len() + 1], add);
        let steps = [None].into_iter().chain(STEPS.map(Some));
        let rays = each * parts.len() as u64;
        rows.extend(counts.iter().zip(steps).map(|(&leaks, step)| LeakRow { wall: name.clone(), step, rays, leaks }));
    }
    Ok(rows)
}

/// A ray from inside a room to far outside: through corners and edges of voxels, along diagonals, and in any direction.
fn ray(room: &Room, random: &mut Random) -> Ray {
    let unit = 1 << FRACTION_BITS;
    loop {
        let voxel = room.inside[random.below(room.inside.len() as u32) as usize];
        let kind = random.below(4);
        let from = voxel.map(|c| {
            let within = match kind {
                0 => [0, unit][random.below(2) as usize],
                1 => unit / 2,
                _ => random.below(unit as u32 + 1),
            };
            c * unit + within
        });
        let way: [i32; 3] = std::array::from_fn(|_| match kind {
            0 | 1 => (random.below(5) - 2) * 40 * unit,
            _ => (random.below(2001) - 1000) * 13,
        });
        let far = way.iter().map(|d| d.abs()).max().unwrap_or(0).max(1);
        // Long enough to leave the room.
        let way = way.map(|d| (i64::from(d) * 65_535 / i64::from(far)) as i32);
        if let Some(ray) = Ray::exact(from, way) {
            return ray;
        }
    }
}
