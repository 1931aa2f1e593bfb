//! The background of pictures.

use glam::{DMat4, DVec3};

use crate::exact::CameraRays;
use crate::picture::to_bytes;
use crate::shading::{decode_srgb, encode_srgb};
use crate::{Nearest, Picture, View};

/// What is seen where nothing is hit.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Sky {
    /// A dome: blue above, white at the horizon, grey below it, by the direction of view. Unlike the background of
    /// [`shade`](crate::shading::shade), which belongs to the picture, it stays where it is when the camera turns.
    Dome {
        /// Direction to its top, any length above 0.
        up: DVec3,
    },
    /// One colour.
    Plain([u8; 3]),
}

/// Colours of the dome, sRGB-encoded: above, at the horizon, below.
const DOME: [[f32; 3]; 3] = [[0.25, 0.45, 0.80], [0.93, 0.95, 0.97], [0.42, 0.41, 0.40]];

impl Sky {
    /// Its colour in a direction of length 1, sRGB-encoded.
    fn color(&self, direction: DVec3) -> [f32; 3] {
        match self {
            Self::Plain(rgb) => rgb.map(|byte| f32::from(byte) / 255.0),
            Self::Dome { up } => {
                let height = direction.dot(up.normalize_or_zero()) as f32;
                // The horizon is bright in a narrow band, and sharper from below.
                let (end, part) =
                    if height >= 0.0 { (DOME[0], height.sqrt()) } else { (DOME[2], (-8.0 * height).min(1.0)) };
                let mixed = |c: usize| decode_srgb(DOME[1][c]) * (1.0 - part) + decode_srgb(end[c]) * part;
                std::array::from_fn(|c| encode_srgb(mixed(c)))
            }
        }
    }

    /// Paints it where nothing is hit. `view` is one of those that were cast, of an object with this transform.
    pub fn paint(&self, picture: &mut Picture, view: &View, octree_to_mesh: DMat4, nearest: &Nearest) {
        let rays = CameraRays::of_view(view, octree_to_mesh);
        let width = picture.width;
        for (pixel, (rgb, hit)) in picture.rgb8.chunks_exact_mut(3).zip(&nearest.hits).enumerate() {
            if hit.is_miss() {
                let ray = rays.ray(pixel as u32 % width, pixel as u32 / width);
                rgb.copy_from_slice(&to_bytes(self.color(ray.direction.normalize_or_zero())));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::ReferenceCaster;
    use crate::testing::sample::two_objects_apart;
    use crate::{Camera, CastOptions, Caster};

    #[test]
    fn a_sky_is_where_nothing_is_hit_and_stays_when_the_camera_turns() {
        let octree = two_objects_apart(1.5).expect("assembles");
        let mut caster = ReferenceCaster::default();
        caster.load(&octree).expect("is sound");
        let up = DVec3::new(0.0, 0.0, 2.0);
        let paint = |caster: &mut ReferenceCaster, sky: Sky, camera: &Camera| {
            let root = octree.objects()[0].root_slot as u32;
            let view = View::new(camera, octree.octree_to_mesh(0), root, (41, 41), &CastOptions::default());
            let view = view.expect("is valid");
            let nearest = Nearest::cast(caster, &[view]).expect("is cast");
            let mut picture = Picture::from_fn((41, 41), |_, _| [1.0, 0.0, 0.0]);
            sky.paint(&mut picture, &view, octree.octree_to_mesh(0), &nearest);
            (picture, nearest)
        };
        let camera = crate::camera::viewpoint::overview(&octree, up.to_array(), 60.0, 1.0);
        let (picture, nearest) = paint(&mut caster, Sky::Plain([1, 2, 3]), &camera);
        let hits = nearest.hits.iter().filter(|hit| !hit.is_miss()).count();
        assert!(hits > 50 && hits < 41 * 41 - 50, "{hits}");
        for (rgb, hit) in picture.rgb8.chunks(3).zip(&nearest.hits) {
            assert_eq!(rgb, if hit.is_miss() { [1, 2, 3] } else { [255, 0, 0] });
        }

        // From behind, away from the objects: the same direction has the same colour, wherever it is in the picture.
        let away = |forward: DVec3| Camera {
            eye: (DVec3::from(camera.eye) - DVec3::from(camera.forward) * 9.0).to_array(),
            forward: forward.to_array(),
            ..camera
        };
        let back = (-DVec3::from(camera.forward)).with_z(0.0).normalize();
        let (level, _) = paint(&mut caster, Sky::Dome { up }, &away(back));
        let (upwards, _) = paint(&mut caster, Sky::Dome { up }, &away(back + DVec3::Z * 0.3));
        // A direction that is in the middle of one and below the middle of the other.
        let slope = 0.3 / (60f64 / 2.0).to_radians().tan();
        let row = (20.5 - 20.5 * slope) as u32;
        let (a, b) = (level.pixel(20, row), upwards.pixel(20, 20));
        assert!(a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 6), "{a:?} {b:?}");
        let [top, middle, bottom] = [0, 19, 40].map(|row| level.pixel(20, row));
        assert!(
            top[2] > top[0] + 40 && middle.iter().all(|c| *c > 200) && bottom[0] < 130,
            "{top:?} {middle:?} {bottom:?}"
        );
        assert!(upwards.pixel(20, 0)[0] < top[0], "higher is bluer");
    }
}
