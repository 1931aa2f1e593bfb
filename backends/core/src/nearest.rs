//! What a camera sees of several objects of an octree.

use crate::{CastError, Caster, Hit, View};

/// The nearest hit of each pixel over several views, and whose it is.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Nearest {
    /// For each pixel, the first row on top: the nearest hit, with the iterations of all views that were cast.
    pub hits: Vec<Hit>,
    /// For each pixel, the number of the view that has this hit; 0 for a miss.
    pub views: Vec<u32>,
}

impl Nearest {
    /// Casts each view and takes the nearest hits; of equal ones, that of the first view. The views are those of one camera,
    /// one for each object: see [`View::new`]. `t` is depth divided by that of the far plane, the same for all objects.
    ///
    /// [`Caster::cast_instances`] finds the same and is faster unless every object fills the picture.
    ///
    /// # Errors
    /// [`CastError::View`]: there is no view, or they differ in size. Those of [`Caster::cast`].
    pub fn cast(caster: &mut dyn Caster, views: &[View]) -> Result<Self, CastError> {
        let Some((first, others)) = views.split_first() else {
            return Err(CastError::View("there is none; give one for each object".into()));
        };
        let mut hits = Vec::new();
        caster.cast(first, &mut hits)?;
        let mut nearest = Self { views: vec![0; hits.len()], hits };
        let mut hits = Vec::new();
        for (number, view) in (1..).zip(others) {
            if (view.width, view.height) != (first.width, first.height) {
                return Err(CastError::View("views of one picture must have the same size".into()));
            }
            caster.cast(view, &mut hits)?;
            for ((to, whose), hit) in nearest.hits.iter_mut().zip(&mut nearest.views).zip(&hits) {
                let iterations = to.iterations.saturating_add(hit.iterations);
                if !hit.is_miss() && (to.is_miss() || hit.raw_t < to.raw_t) {
                    (*to, *whose) = (*hit, number);
                }
                to.iterations = iterations;
            }
        }
        Ok(nearest)
    }

    /// Makes room for the pixels of a view; what they hold has no meaning.
    pub fn resize(&mut self, view: &View) {
        self.hits.resize(view.pixels(), Hit::miss(0));
        self.views.resize(view.pixels(), 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CastOptions;
    use crate::reference::ReferenceCaster;
    use crate::testing::sample::{cameras, two_objects};

    #[test]
    fn each_pixel_is_the_nearer_of_both_cast_alone() {
        let octree = two_objects().unwrap();
        let mut caster = ReferenceCaster::default();
        caster.load(&octree).unwrap();
        let mut seen = [0; 3];
        for camera in cameras() {
            let view = |object: usize| {
                let root = octree.objects()[object].root_slot as u32;
                View::new(&camera, octree.octree_to_mesh(object), root, (61, 47), &CastOptions::default()).unwrap()
            };
            let views = [view(0), view(1)];
            let both = Nearest::cast(&mut caster, &views).unwrap();
            let alone = views.map(|view| {
                let mut hits = Vec::new();
                caster.cast(&view, &mut hits).unwrap();
                hits
            });
            for (pixel, hit) in both.hits.iter().enumerate() {
                let [a, b] = [&alone[0][pixel], &alone[1][pixel]];
                let second = !b.is_miss() && (a.is_miss() || b.raw_t < a.raw_t);
                let nearer = if second { b } else { a };
                assert!(hit.same_voxel(nearer) && hit.raw_t == nearer.raw_t);
                assert_eq!((both.views[pixel], hit.iterations), (u32::from(second), a.iterations + b.iterations));
                seen[if hit.is_miss() { 2 } else { usize::from(second) }] += 1;
            }
        }
        assert!(seen.iter().all(|pixels| *pixels > 100), "{seen:?}: both objects and the sky are seen");
    }

    #[test]
    fn views_that_do_not_go_together_are_refused() {
        let octree = two_objects().unwrap();
        let mut caster = ReferenceCaster::default();
        caster.load(&octree).unwrap();
        assert!(matches!(Nearest::cast(&mut caster, &[]), Err(CastError::View(_))));
        let view = |size| {
            View::new(
                &cameras()[0],
                octree.octree_to_mesh(0),
                octree.objects()[0].root_slot as u32,
                size,
                &CastOptions::default(),
            )
            .unwrap()
        };
        assert!(matches!(Nearest::cast(&mut caster, &[view((8, 8)), view((8, 9))]), Err(CastError::View(_))));
    }
}
