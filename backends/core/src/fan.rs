//! Bundles of rays from many points: rays that no camera makes.

use glam::{Mat3, Vec3};

use crate::Ray;

/// Where a bundle of rays starts, and how it is turned.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Fan {
    /// Common origin, in cast space: see [`Object`](crate::Object).
    pub origin: Vec3,
    /// Turns and stretches the directions that all fans share into those of this fan.
    pub axes: Mat3,
}

/// Bundles of rays, all of the same number and shape. The rays of a bundle start at one point.
#[derive(Clone, Copy, Debug)]
pub struct Fans<'a> {
    /// Slot of the root's child descriptor: the root slot of one of the octree's objects.
    pub root: u32,
    /// Clip voxels by their contours; otherwise they are cubes.
    pub contours: bool,
    /// The bundles.
    pub fans: &'a [Fan],
    /// The rays of each bundle before [`Fan::axes`] turns them, from `t` = 0 to `t` = 1. Neighbours in the list should have
    /// similar directions, since engines cast several at once.
    pub directions: &'a [Vec3],
}

impl Fans<'_> {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.fans.len() * self.directions.len()
    }

    /// Whether there are no rays.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One of the rays of a fan.
    #[inline]
    pub fn ray(fan: &Fan, direction: Vec3) -> Ray {
        let direction = fan.axes * direction;
        Ray { origin: fan.origin, direction, t_min: 0.0, t_max: 1.0, size_at_origin: 0.0, size_per_t: 0.0 }
    }

    /// All rays, fan by fan.
    pub fn rays(&self) -> impl Iterator<Item = Ray> + '_ {
        self.fans.iter().flat_map(|fan| self.directions.iter().map(|direction| Self::ray(fan, *direction)))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use esvo_format::Octree;

    use super::*;
    use crate::reference::{ReferenceCaster, cast_ray};
    use crate::testing::sample::Sample;
    use crate::{CastError, Caster, Checked, Device, FrameTime, Hit, Rays, Roots, View};

    /// A caster with the required methods only.
    struct RaysOnly(ReferenceCaster);

    impl Caster for RaysOnly {
        fn name(&self) -> &'static str {
            self.0.name()
        }

        fn device(&self) -> &Device {
            self.0.device()
        }

        fn resident_bytes(&self) -> u64 {
            self.0.resident_bytes()
        }

        fn roots(&self) -> Option<&Roots> {
            self.0.roots()
        }

        fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
            self.0.load_checked(octree, roots)
        }

        fn cast_checked(&mut self, view: Checked<View>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
            self.0.cast_checked(view, hits)
        }

        fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
            self.0.time_checked(view)
        }

        fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
            self.0.cast_rays_checked(rays, hits)
        }
    }

    #[test]
    fn fans_are_cast_as_their_rays_are() {
        let octree = Sample::plain(6, true).octree().expect("assembles");
        let root = octree.objects()[0].root_slot as u32;
        let fans: Vec<Fan> = (0..20)
            .map(|i| Fan {
                origin: Vec3::splat(1.5) + Vec3::new(0.02, -0.013, 0.007) * i as f32,
                axes: Mat3::from_rotation_y(i as f32) * 0.35,
            })
            .collect();
        let directions: Vec<Vec3> = (0..40).map(|i| Vec3::new((i as f32).sin(), 0.4, (i as f32).cos())).collect();
        let casters: [&mut dyn Caster; 2] =
            [&mut ReferenceCaster::default(), &mut RaysOnly(ReferenceCaster::default())];
        for caster in casters {
            let mut hits = Vec::new();
            let nothing = Fans { root, contours: true, fans: &[], directions: &directions };
            assert!(matches!(caster.cast_fans(&Fans { fans: &fans, ..nothing }, &mut hits), Err(CastError::NotLoaded)));
            caster.load(&octree).expect("is sound");
            for contours in [false, true] {
                let fans = Fans { root, contours, fans: &fans, directions: &directions };
                caster.cast_fans(&fans, &mut hits).expect("casts");
                let expected: Vec<_> = fans.rays().map(|ray| cast_ray(&octree, root, &ray, contours)).collect();
                let found = expected.iter().filter(|hit| !hit.is_miss()).count();
                assert!(found > 100 && found < expected.len() - 100, "{found}");
                assert_eq!(hits, expected);
            }
            caster.cast_fans(&nothing, &mut hits).expect("casts nothing");
            assert!(hits.is_empty() && nothing.is_empty());
        }
    }
}
