//! A picture of an octree on a server: only what it needs is read.

use esvo_core::camera::viewpoint;
use esvo_core::{Detail, Object};
use esvo_format::Region;

use super::RenderArguments;
use super::look::Look;
use super::path::CameraPath;
use crate::fail::Failure;
use crate::remote::Served;
use crate::stage::Stage;

impl RenderArguments {
    /// The objects as far as the pictures need them, and a line about what was read.
    pub(super) fn served_stage(&self, path: Option<&CameraPath>, looks: &[Look]) -> Result<(Stage, String), Failure> {
        let mut served = Served::open(&self.file, &self.remote)?;
        // Rays of shadows and effects go where the camera does not look.
        let beyond = !self.lights.is_empty() && !self.no_shadows || !self.effects.effects.is_empty();
        let octree = if beyond {
            served.octree_by(|_, _| u32::MAX)?
        } else {
            // A camera that is not given depends on where the octree is filled.
            let given = self.rays.camera.is_some() || self.rays.scene.is_some() || path.is_some();
            let least = if given && !self.turn { 1 } else { viewpoint::LEVELS };
            let coarse = served.octree_by(|_, _| least)?;
            let details = self.details(&Object::all(&coarse), path, looks)?;
            let level = |object: usize, cube: &Region| {
                let of_views = details.iter().filter_map(|views| views.get(object)).map(|detail| detail.level(cube));
                of_views.fold(least, u32::max)
            };
            served.octree_by(level)?
        };
        Ok((Stage::of(octree), format!("{}\n", served.about())))
    }

    /// What the rays of each picture need of each object.
    fn details(
        &self,
        objects: &[Object],
        path: Option<&CameraPath>,
        looks: &[Look],
    ) -> Result<Vec<Vec<Detail>>, Failure> {
        let mut details = Vec::new();
        for camera in self.cameras(objects, path)? {
            for look in looks {
                let views = self.rays.views(&camera, objects, look.contours, look.beam)?;
                details.push(views.iter().map(Detail::of).collect());
            }
        }
        Ok(details)
    }
}
