//! What core has checked before an engine sees it: roots, views, rays, fans and instances.
//!
//! An engine walks the octree by the numbers that it finds there, without looking at bounds: in a GPU's memory, or by the
//! gathers of a processor. Two checks make that safe. [`Caster::load`](crate::Caster::load) takes only octrees that are
//! [sound](Octree::sound), and a ray starts only at the root of an object. The types of this module make the second check
//! impossible to leave out: the methods that an engine implements take [`Checked`] views, rays, fans or instances. Only core makes
//! them, and their contents are read through the [`Roots`] of the octree that they were checked against.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Weak};

use esvo_format::Octree;

use crate::{CastError, Fans, Instances, Rays, View};

/// The root slots of the octree that an engine holds: the slots at which its rays may start.
///
/// Made by [`Caster::load`](crate::Caster::load), of an octree that is sound. An engine keeps them with the octree.
#[derive(Debug)]
pub struct Roots {
    /// Different for every call of `load`.
    id: u64,
    octree: Weak<Octree>,
    /// Ascending.
    slots: Vec<u32>,
}

/// A [`View`], [`Rays`], [`Fans`] or [`Instances`] that passed every check against the octree that an engine holds; see [`Roots::open`].
#[derive(Clone, Copy, Debug)]
pub struct Checked<T> {
    roots: u64,
    value: T,
}

impl Roots {
    /// The roots of a sound octree.
    ///
    /// # Errors
    /// The octree is not [sound](Octree::sound).
    pub(crate) fn of(octree: &Arc<Octree>) -> Result<Self, CastError> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        octree.sound()?;
        // An image has at most 2^32 slots.
        let mut slots: Vec<u32> = octree.objects().iter().map(|object| object.root_slot as u32).collect();
        slots.sort_unstable();
        Ok(Self { id: NEXT.fetch_add(1, Ordering::Relaxed), octree: Arc::downgrade(octree), slots })
    }

    /// The root slots, ascending.
    pub fn slots(&self) -> &[u32] {
        &self.slots
    }

    /// Checks that these are the roots of `octree`: for [`Caster::load_checked`](crate::Caster::load_checked) of engines that
    /// do not check bounds. Anyone may call that method with roots of one octree and another octree, which nobody checked.
    ///
    /// # Errors
    /// [`CastError::NotLoaded`] if they are the roots of another octree.
    pub fn belong_to(&self, octree: &Arc<Octree>) -> Result<(), CastError> {
        if std::ptr::eq(self.octree.as_ptr(), Arc::as_ptr(octree)) { Ok(()) } else { Err(CastError::NotLoaded) }
    }

    /// What was checked. Its root is one of [`slots`](Self::slots).
    ///
    /// # Errors
    /// [`CastError::NotLoaded`] if it was checked against another octree, or before this one was loaded again.
    pub fn open<'c, T>(&self, checked: &'c Checked<T>) -> Result<&'c T, CastError> {
        if checked.roots == self.id { Ok(&checked.value) } else { Err(CastError::NotLoaded) }
    }

    /// Checks a view.
    ///
    /// # Errors
    /// As [`View::check`]; [`CastError::Root`].
    pub(crate) fn check_view(&self, view: &View) -> Result<Checked<View>, CastError> {
        view.check()?;
        self.check(view.root, *view)
    }

    /// Checks fans. Their rays need no check: one that is not finite or too long misses.
    ///
    /// # Errors
    /// [`CastError::Root`].
    pub(crate) fn check_fans<'a>(&self, fans: &Fans<'a>) -> Result<Checked<Fans<'a>>, CastError> {
        self.check(fans.root, *fans)
    }

    /// Checks rays. The rays themselves need no check: one that [is not cast](crate::Ray::is_cast) misses.
    ///
    /// # Errors
    /// [`CastError::Root`].
    pub fn check_rays<'a>(&self, rays: &Rays<'a>) -> Result<Checked<Rays<'a>>, CastError> {
        self.check(rays.root, *rays)
    }

    /// Checks instances. Their views were checked when they were made, but for their roots.
    ///
    /// # Errors
    /// [`CastError::Root`].
    pub(crate) fn check_instances<'a>(&self, instances: &'a Instances) -> Result<Checked<&'a Instances>, CastError> {
        for view in instances.views() {
            self.check(view.root, ())?;
        }
        Ok(Checked { roots: self.id, value: instances })
    }

    fn check<T>(&self, root: u32, value: T) -> Result<Checked<T>, CastError> {
        match self.slots.binary_search(&root) {
            Ok(_) => Ok(Checked { roots: self.id, value }),
            Err(_) => Err(CastError::Root { root, roots: self.slots.clone() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::sample::Sample;

    #[test]
    fn roots_belong_to_one_octree() {
        let make = || Sample::plain(3, false).octree().expect("assembles");
        let (ours, other) = (make(), make());
        let roots = Roots::of(&ours).expect("is sound");
        assert!(roots.belong_to(&ours).is_ok() && roots.belong_to(&ours.clone()).is_ok());
        assert!(matches!(roots.belong_to(&other), Err(CastError::NotLoaded)));
    }
}
