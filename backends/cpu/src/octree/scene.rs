//! What of an octree the casters read.

use esvo_core::{LeaveOut, Ray, View};
use esvo_format::Octree;

/// The image of a sound octree, and the root at which rays start.
pub(super) struct Scene<'a> {
    slots: &'a [u64],
    words: &'a [u32],
    root: u32,
    /// What the code for this octree contains.
    contours: bool,
    far_pointers: bool,
    sizes: bool,
}

impl<'a> Scene<'a> {
    /// The octree must be [sound](Octree::sound), and `root` the root slot of one of its objects: both are known of what
    /// [`Roots::open`](esvo_core::Roots::open) returns.
    pub(super) fn new(octree: &'a Octree, root: u32, leave_out: LeaveOut) -> Self {
        let needs = octree.needs();
        Self {
            slots: octree.slots(),
            words: octree.words(),
            root,
            contours: needs.contours || !leave_out.contours,
            far_pointers: needs.far_pointers || !leave_out.far_pointers,
            sizes: !leave_out.sizes,
        }
    }

    /// The image in slots of 8 bytes.
    #[inline(always)]
    pub(super) fn slots(&self) -> &'a [u64] {
        self.slots
    }

    /// The image in 32-bit words.
    #[inline(always)]
    pub(super) fn words(&self) -> &'a [u32] {
        self.words
    }

    /// Slot of the root's descriptor.
    #[inline(always)]
    pub(super) fn root(&self) -> u32 {
        self.root
    }

    /// Whether code that follows far pointers is used.
    #[inline(always)]
    pub(super) fn has_far_pointers(&self) -> bool {
        self.far_pointers
    }

    /// Whether code that clips by contours is used for rays of which this is asked.
    pub(super) fn clips(&self, contours: bool) -> bool {
        contours && self.contours
    }

    /// Whether code with a test for small voxels is used for a picture.
    pub(super) fn view_has_sizes(&self, view: &View) -> bool {
        view.max_voxel_pixels > 0.0 || self.sizes
    }

    /// The same for a list of rays.
    pub(super) fn rays_have_sizes(&self, rays: &[Ray]) -> bool {
        self.sizes || rays.iter().any(Ray::has_size)
    }
}

#[cfg(test)]
mod tests {
    use esvo_core::testing::sample::Sample;
    use glam::Vec3;

    use super::*;

    #[test]
    fn only_what_is_not_needed_is_left_out() {
        let rays = |size_per_t| [Ray { size_per_t, ..Ray::new(Vec3::ZERO, Vec3::X) }];
        for contours in [false, true] {
            let octree = Sample::plain(5, contours).octree().expect("assembles");
            let root = octree.objects()[0].root_slot as u32;
            let (all, nothing) =
                (Scene::new(&octree, root, LeaveOut::ALL), Scene::new(&octree, root, LeaveOut::NOTHING));
            assert_eq!((all.clips(true), all.clips(false)), (contours, false));
            assert_eq!((nothing.clips(true), nothing.clips(false)), (true, false));
            assert!(!octree.needs().far_pointers && !all.has_far_pointers() && nothing.has_far_pointers());
            assert!(!all.rays_have_sizes(&rays(0.0)) && all.rays_have_sizes(&rays(0.1)));
            assert!(nothing.rays_have_sizes(&rays(0.0)));
        }
    }
}
