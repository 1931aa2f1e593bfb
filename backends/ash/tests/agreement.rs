//! The kernel against the reference caster, on whatever device there is.

use std::sync::Arc;

use esvo_ash::{AshCaster, GpuOptions};
use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::conformance::{REQUIRE_GPU, Subject};
use esvo_core::testing::sample::Sample;
use esvo_core::{CastError, Caster, Checked, Device, FrameTime, Hit, Rays, Roots, View};
use esvo_format::Octree;

const ENGINE: Subject = Subject::kernel(|options| Ok(Box::new(AshCaster::new(options)?)));

esvo_core::kernel_suite!(ash, super::super::ENGINE);

/// An engine of somebody else, which gives away the roots that core hands to it.
#[derive(Default)]
struct Leaky {
    reference: ReferenceCaster,
    roots: Option<Roots>,
}

impl Caster for Leaky {
    fn name(&self) -> &'static str {
        "leaky"
    }
    fn device(&self) -> &Device {
        self.reference.device()
    }
    fn resident_bytes(&self) -> u64 {
        0
    }
    fn roots(&self) -> Option<&Roots> {
        self.roots.as_ref()
    }
    fn load_checked(&mut self, _: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
        self.roots = Some(roots);
        Ok(())
    }
    fn cast_checked(&mut self, _: Checked<View>, _: &mut Vec<Hit>) -> Result<(), CastError> {
        Err(CastError::NotLoaded)
    }
    fn time_checked(&mut self, _: Checked<View>) -> Result<FrameTime, CastError> {
        Err(CastError::NotLoaded)
    }
    fn cast_rays_checked(&mut self, _: Checked<Rays<'_>>, _: &mut Vec<Hit>) -> Result<(), CastError> {
        Err(CastError::NotLoaded)
    }
}

/// The caster does not check bounds, so it must not take an octree that core has not checked.
#[test]
fn roots_of_one_octree_do_not_load_another() {
    let mut caster = match AshCaster::new(&GpuOptions::default()) {
        Ok(caster) => caster,
        Err(error) if std::env::var_os(REQUIRE_GPU).is_some() => panic!("{error}"),
        Err(error) => return eprintln!("skipped: {error}"),
    };
    let make = || Sample::plain(3, false).octree().unwrap();
    let (checked, unchecked) = (make(), make());
    let roots_of = |octree| {
        let mut leaky = Leaky::default();
        leaky.load(octree).unwrap();
        leaky.roots.unwrap()
    };
    let refused = caster.load_checked(&unchecked, roots_of(&checked));
    assert!(matches!(refused, Err(CastError::NotLoaded)), "{refused:?}");
    caster.load_checked(&checked, roots_of(&checked)).unwrap();
}
