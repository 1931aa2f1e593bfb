//! Rays that try to leave closed rooms.

use esvo_shadow::rooms::{Room, Wall};
use esvo_shadow::trace::{Fidelity, Steps, is_blocked};
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

/// Traces about `rays` rays in rooms with each wall, in each way.
pub(super) fn leaks(rays: u64, progress: &Progress) -> Result<Vec<LeakRow>, BenchError> {
    let mut rows = Vec::new();
    for wall in Wall::ALL {
        let name = format!("{wall:?}").to_lowercase();
        progress.say(format!("leaks of walls of {name}"));
        let rooms = Room::all(EDGE, 2, wall, TURNS).map_err(|e| failed("rooms", e))?;
        let each = rays.div_ceil(3 * rooms.len() as u64 * 64);
        let parts: Vec<(usize, u64)> =
            (0..rooms.len()).flat_map(|room| (0..64).map(move |part| (room, part))).collect();
        let counts = parts.par_iter().map(|&(room, part)| {
            let mut counts = [0u64; STEPS.len() + 1];
            for ray in rooms[room].rays(part * 1_000_003 + room as u64).take(each as usize) {
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
