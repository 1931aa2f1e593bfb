//! Every check passes for the reference and fails for some caster.

use std::sync::Arc;

use esvo_format::Octree;

use super::checks::broken_casters_are_caught_by;
use super::instances::broken_casters_of_instances_are_caught_by;
use super::rays::broken_casters_of_rays_are_caught_by;
use super::*;
use crate::filter::{Frame, Radius};
use crate::reference::ReferenceCaster;
use crate::testing::compare::Comparison;
use crate::testing::{instances, rays, sample};
use crate::{Checked, Device, Fans, Filtered, FrameTime, Hit, Ray, Rays, Roots, View};

/// The reference with one fault.
struct Faulty {
    caster: ReferenceCaster,
    fault: Mistake,
    frames: u32,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Mistake {
    /// Every third frame loses a few hits.
    Forgets,
    /// Hits of fans are those of the next ray.
    ShiftsFans,
    /// Hits of lists of rays are those of the next ray.
    ShiftsRays,
    /// Rays that are not finite hit what the ray before hits.
    HitsByNaN,
    /// Nothing is checked, since the provided methods are overridden.
    ChecksNothing,
    /// Takes what was checked against any octree.
    TakesStaleChecks,
    /// Has bytes and casts without an octree.
    NeedsNoOctree,
    /// Takes a thousand times as long as it takes.
    Exaggerates,
    /// Always casts the first object.
    KnowsOneObject,
    /// Hits nothing but gives good reasons.
    Blind,
    /// Gives frames back as they are.
    FiltersNothing,
}

impl Caster for Faulty {
    fn name(&self) -> &'static str {
        "faulty"
    }

    fn device(&self) -> &Device {
        self.caster.device()
    }

    fn resident_bytes(&self) -> u64 {
        if self.fault == Mistake::NeedsNoOctree { 1 } else { self.caster.resident_bytes() }
    }

    fn load(&mut self, octree: &Arc<Octree>) -> Result<(), CastError> {
        match self.caster.load(octree) {
            Err(_) if self.fault == Mistake::ChecksNothing => Ok(()),
            result => result,
        }
    }

    fn cast(&mut self, view: &View, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let checked = self.caster.roots().ok_or(CastError::NotLoaded).and_then(|roots| roots.check_view(view));
        match checked {
            Err(_) if self.fault == Mistake::ChecksNothing => Ok(()),
            checked => self.cast_checked(checked?, hits),
        }
    }

    fn roots(&self) -> Option<&Roots> {
        self.caster.roots()
    }

    fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
        self.caster.load_checked(octree, roots)
    }

    fn cast_checked(&mut self, view: Checked<View>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        if self.fault == Mistake::TakesStaleChecks && self.caster.cast_checked(view, hits).is_err() {
            return Ok(());
        }
        if let (Mistake::KnowsOneObject, Some(roots)) = (self.fault, self.caster.roots()) {
            let view = View { root: roots.slots()[0], ..*roots.open(&view)? };
            return self.caster.cast(&view, hits);
        }
        self.caster.cast_checked(view, hits)?;
        self.frames += 1;
        if self.fault == Mistake::Forgets && self.frames.is_multiple_of(3) {
            hits.iter_mut().filter(|hit| !hit.is_miss()).take(9).for_each(|hit| *hit = Hit::miss(0));
        }
        if self.fault == Mistake::Blind {
            hits.fill(Hit::miss(1));
        }
        Ok(())
    }

    fn filter(&mut self, frame: &Frame, radius: Radius) -> Result<Filtered, CastError> {
        let mut filtered = self.caster.filter(frame, radius)?;
        if self.fault == Mistake::FiltersNothing {
            let rgb = |pixel: &u32| pixel.to_le_bytes().into_iter().take(3);
            filtered.picture.rgb8 = frame.pixels().iter().flat_map(rgb).collect();
        }
        Ok(filtered)
    }

    fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
        let time = self.caster.time_checked(view)?;
        let factor = if self.fault == Mistake::Exaggerates { 1000 } else { 1 };
        Ok(FrameTime { total: time.total * factor, ..time })
    }

    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        self.caster.cast_rays_checked(rays, hits)?;
        if self.fault == Mistake::ShiftsRays && !hits.is_empty() {
            hits.rotate_left(1);
        }
        if let (Mistake::HitsByNaN, Some(roots)) = (self.fault, self.caster.roots()) {
            for (index, ray) in roots.open(&rays)?.rays.iter().enumerate().skip(1) {
                hits[index] = if ray.is_cast() { hits[index] } else { hits[index - 1] };
            }
        }
        Ok(())
    }

    fn cast_fans_checked(&mut self, fans: Checked<Fans<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        self.caster.cast_fans_checked(fans, hits)?;
        if self.fault == Mistake::ShiftsFans && !hits.is_empty() {
            hits.rotate_left(1);
        }
        Ok(())
    }
}

fn open(fault: Mistake) -> Opened {
    Ok(Box::new(Faulty { caster: ReferenceCaster::default(), fault, frames: 0 }))
}

const REFERENCE: Subject = Subject::native(|| Ok(Box::new(ReferenceCaster::default())));

conformance_suite!(reference, super::REFERENCE);

/// For every check, a caster that fails it.
const FAILING: [(&str, Subject); 27] = [
    ("cubes_agree", Subject::native(|| open(Mistake::Forgets))),
    ("contours_agree", Subject::native(|| open(Mistake::Forgets))),
    ("blocks_and_far_pointers_agree", Subject::native(|| open(Mistake::Forgets))),
    ("odd_sizes_agree", Subject::native(|| open(Mistake::Forgets))),
    ("all_objects_agree", Subject::native(|| open(Mistake::KnowsOneObject))),
    ("fans_agree", Subject::native(|| open(Mistake::ShiftsFans))),
    ("strange_rays_agree", Subject::native(|| open(Mistake::Blind))),
    ("rays_agree", Subject::native(|| open(Mistake::ShiftsRays))),
    ("hard_rays_agree", Subject::native(|| open(Mistake::ShiftsRays))),
    ("lists_of_rays_stand_alone", Subject::native(|| open(Mistake::ShiftsRays))),
    ("strange_lists_of_rays_agree", Subject::native(|| open(Mistake::HitsByNaN))),
    ("bad_views_are_refused", Subject::native(|| open(Mistake::ChecksNothing))),
    ("roots_of_no_object_are_refused", Subject::native(|| open(Mistake::ChecksNothing))),
    ("unsound_octrees_are_refused", Subject::native(|| open(Mistake::ChecksNothing))),
    ("damaged_octrees_are_refused", Subject::native(|| open(Mistake::ChecksNothing))),
    ("checks_against_another_octree_do_not_count", Subject::native(|| open(Mistake::TakesStaleChecks))),
    ("nothing_loaded_is_an_error", Subject::native(|| open(Mistake::NeedsNoOctree))),
    ("nothing_is_left_of_the_frame_before", Subject::native(|| open(Mistake::Forgets))),
    ("times_are_plausible", Subject::native(|| open(Mistake::Exaggerates))),
    ("broken_casters_are_caught", Subject::native(|| Err(CastError::NotLoaded))),
    ("broken_casters_of_rays_are_caught", Subject::native(|| Err(CastError::NotLoaded))),
    ("filters_agree", Subject::native(|| open(Mistake::FiltersNothing))),
    ("broken_filters_are_caught", Subject::native(|| Err(CastError::NotLoaded))),
    ("instances_agree", Subject::native(|| open(Mistake::ShiftsRays))),
    ("instances_of_odd_sizes_agree", Subject::native(|| open(Mistake::ShiftsRays))),
    ("strange_instances_agree", Subject::native(|| open(Mistake::ShiftsRays))),
    ("broken_casters_of_instances_are_caught", Subject::native(|| Err(CastError::NotLoaded))),
];

#[test]
fn every_check_fails_for_some_caster() {
    assert_eq!(FAILING.map(|(name, _)| name)[..], CHECKS.iter().map(|(name, _)| *name).collect::<Vec<_>>());
    for ((name, faulty), (_, check)) in FAILING.iter().zip(CHECKS) {
        match (*name, check(faulty)) {
            (_, Err(Fault::Wrong(what))) => println!("{name}: {what}"),
            // No caster fails these, but comparisons that are blind: see the next test.
            (name, Err(Fault::Cast(CastError::NotLoaded))) if name.starts_with("broken_") => {}
            (_, other) => panic!("{name} of a faulty caster: {other:?}"),
        }
    }
}

/// The reference runs no kernel, so that it is no subject of these.
#[test]
fn checks_of_kernels_need_one() {
    for (name, check) in KERNEL_CHECKS {
        assert!(check(&REFERENCE).is_err(), "{name}");
        let deaf: Subject = Subject::kernel(|_| Ok(Box::new(ReferenceCaster::default())));
        let agreement = [
            "several_bindings_agree",
            "octrees_in_buffers_and_in_textures_agree",
            "other_workgroups_agree",
            "beams_of_both_blocks_save_the_same",
            "batches_of_rays_agree",
            "filters_in_bands_agree",
        ]
        .contains(name);
        assert!(agreement || matches!(check(&deaf), Err(Fault::Wrong(_))), "{name}");
    }
}

#[test]
fn only_what_may_be_missing_is_skipped() {
    const VARIABLE: &str = "ESVO_TEST_THAT_NOBODY_SETS";
    const MISSING: Subject = Subject::native(|| Err(CastError::Device("no such thing".into())));
    let never: Check = |_| panic!("is not run");
    assert!(run(&MISSING, "x", never).is_err());
    assert!(run(&MISSING.required_by(VARIABLE), "x", never).is_ok());
    assert!(run(&MISSING.required_by("PATH"), "x", never).is_err());
    let other = Subject::native(|| Err(CastError::NotLoaded)).required_by(VARIABLE);
    assert!(run(&other, "x", never).is_err());
    assert!(tell_what_is_tested(&[("it", MISSING.required_by(VARIABLE)), ("reference", REFERENCE)]).is_ok());
    assert!(tell_what_is_tested(&[("it", MISSING)]).is_err());
}

/// The checks of broken casters fail if the comparison does not see every difference.
#[test]
fn comparisons_that_overlook_something_are_caught() {
    type Blind = fn(Comparison) -> Comparison;
    let blind: [(&str, Blind); 3] = [
        ("", |found| Comparison { rays: found.rays, ..Comparison::default() }),
        ("in another voxel", |found| Comparison { other_voxel: 0, ..found }),
        ("last bit", |found| Comparison { max_t_difference: 0.0, ..found }),
    ];
    for (what, blind) in blind {
        let compare = move |caster: &mut dyn Caster, octree: &Arc<Octree>, size| {
            sample::against_reference(caster, octree, size).map(blind)
        };
        let Err(Fault::Wrong(text)) = broken_casters_are_caught_by(&REFERENCE, &compare) else { panic!("{what}") };
        assert!(text.contains(what), "{what}: {text}");
        let compare = move |caster: &mut dyn Caster, octree: &Arc<Octree>, rays: &[Ray]| {
            rays::against_reference(caster, octree, rays).map(blind)
        };
        let Err(Fault::Wrong(text)) = broken_casters_of_rays_are_caught_by(&REFERENCE, &compare) else {
            panic!("{what}")
        };
        assert!(text.contains(what), "{what}: {text}");
    }
    let (_, sees_nothing) = blind[0];
    let compare =
        move |caster: &mut dyn Caster, views: &[View]| instances::against_each_alone(caster, views).map(sees_nothing);
    assert!(matches!(broken_casters_of_instances_are_caught_by(&REFERENCE, &compare), Err(Fault::Wrong(_))));
}
