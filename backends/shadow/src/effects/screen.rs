//! Short rays through the picture: what they would meet, as far as it is seen.

use glam::Vec3;

use super::frame::Frame;

/// Most samples of a ray.
const MOST: f32 = 48.0;

/// How far along a ray the picture has something in its way, in the world's unit; `None` if it has not, or is left. The ray starts at a surface of the
/// picture, goes in `direction`, of length 1, and is `distance` long. A surface is taken to be `thickness` deep: what passes farther behind it
/// passes unseen.
pub fn first(frame: &Frame, from: Vec3, direction: Vec3, distance: f32, thickness: f32) -> Option<f32> {
    let eye = &frame.eye;
    let (start, start_depth) = eye.project(from)?;
    // A ray towards the eye ends before it.
    let falls = -direction.dot(eye.forward);
    let distance = if falls > 0.0 { distance.min(0.9 * start_depth / falls) } else { distance };
    let (end, end_depth) = eye.project(from + direction * distance)?;
    let pixels = (end - start).abs().max_element();
    if pixels < 1.0 {
        return None;
    }
    let samples = pixels.ceil().min(MOST);
    let own = frame.at(start)?.0;
    for sample in 1..=samples as u32 {
        let share = sample as f32 / samples;
        let at = start + (end - start) * share;
        let Some((pixel, surface)) = frame.at(at) else {
            // Sky hides nothing, but outside of the picture nothing is known.
            if at.min_element() < 0.0 || at.x >= eye.size.0 as f32 || at.y >= eye.size.1 as f32 {
                return None;
            }
            continue;
        };
        if pixel == own {
            continue;
        }
        // One over the depth is linear along the ray's picture.
        let depth = 1.0 / ((1.0 - share) / start_depth + share / end_depth);
        let along = distance * share * depth / end_depth;
        let place = from + direction * along;
        // Below the plane of what is seen there, by more than a pixel can make it; a flat surface never hides itself.
        let below = (surface.position - place).dot(surface.normal);
        let behind = depth - surface.depth;
        let footprint = surface.depth * eye.pixel();
        if below > 0.5 * footprint && behind > 0.0 && behind < thickness + footprint {
            return Some(along);
        }
    }
    None
}
