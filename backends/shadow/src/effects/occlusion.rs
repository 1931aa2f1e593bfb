//! Ambient occlusion: how much of the light from all around reaches a surface.

use super::frame::Frame;
use super::obstacles::Obstacles;
use super::{Rays, ask_around, each_surface};

/// The share of rays that nothing is in the way of, for each pixel, from 0 to 1; 1 where the sky is seen. Rays leave the surface as often in a direction as its
/// cosine is large, and end after `reach`.
pub fn ambient_occlusion(frame: &Frame, obstacles: &impl Obstacles, reach: f32, rays: Rays) -> Vec<f32> {
    each_surface(
        frame,
        1.0,
        |pixel, surface, queries| ask_around(pixel, surface, reach, rays, queries),
        |queries| obstacles.blocked(queries),
        |_, _, _, blocked| {
            let free = blocked.iter().filter(|&&blocked| !blocked).count();
            free as f32 / blocked.len().max(1) as f32
        },
    )
}
