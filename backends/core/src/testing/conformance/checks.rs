//! The checks that every engine must pass.

use std::sync::Arc;
use std::time::Instant;

use esvo_format::{FormatError, Octree, OpenOptions, ids};
use glam::{Mat3, Vec3};

use super::broken::{Broken, WAYS};
use super::{Fault, Subject, demand};
use crate::reference::ReferenceCaster;
use crate::testing::compare::{Allowed, Comparison};
use crate::testing::sample::{
    Sample, against_reference, bad_views, cameras, strange_against_reference, two_objects, unsound,
};
use crate::{CastError, CastOptions, Caster, DeviceKind, Fan, Fans, Hit, Instances, Nearest, Ray, Rays, View};

/// Size of the pictures that are compared: neither side is a multiple of a packet's, a workgroup's or a block's.
const ODD_SIZE: (u32, u32) = (131, 75);

/// Casts a sample from every camera with every option and compares with the reference.
fn agrees_on(subject: &Subject, octree: &Arc<Octree>, size: (u32, u32)) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    let comparison = against_reference(&mut *caster, octree, size)?;
    demand_agreement(&*caster, &comparison)
}

pub(super) fn demand_agreement(caster: &dyn Caster, comparison: &Comparison) -> Result<(), Fault> {
    let device = caster.device();
    demand(Allowed::on(device.kind).admits(comparison), || {
        format!("{} ({}): {comparison:?}", device.name, device.detail)
    })
}

/// The view of an object by the first of the [`cameras`].
pub(super) fn view_of(octree: &Octree, object: usize, size: (u32, u32), beam: bool) -> Result<View, CastError> {
    let root = octree.objects()[object].root_slot as u32;
    let options = CastOptions { beam, ..CastOptions::default() };
    View::new(&cameras()[0], octree.octree_to_mesh(object), root, size, &options)
}

/// A ray that starts in the middle.
fn ray() -> [Ray; 1] {
    [Ray::new(Vec3::splat(1.5), Vec3::X)]
}

/// Cubical voxels in one block, near pointers only: hits are the reference's with every option and from every camera.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn cubes_agree(subject: &Subject) -> Result<(), Fault> {
    agrees_on(subject, &Sample::plain(6, false).octree()?, ODD_SIZE)
}

/// The same with contours.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn contours_agree(subject: &Subject) -> Result<(), Fault> {
    agrees_on(subject, &Sample::plain(7, true).octree()?, ODD_SIZE)
}

/// The same with contours, in many blocks, with far pointers.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn blocks_and_far_pointers_agree(subject: &Subject) -> Result<(), Fault> {
    agrees_on(subject, &Sample::scattered(7, true).octree()?, ODD_SIZE)
}

/// Pictures of one pixel, one row, one column, and of sizes around those of packets and tiles.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn odd_sizes_agree(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::plain(5, true).octree()?;
    for size in [(1, 1), (1, 33), (33, 1), (3, 5), (4, 4), (15, 17), (64, 48)] {
        agrees_on(subject, &octree, size)?;
    }
    Ok(())
}

/// Each object of an octree can be cast by its own root.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn all_objects_agree(subject: &Subject) -> Result<(), Fault> {
    let octree = two_objects()?;
    let (mut caster, mut reference) = (subject.open()?, ReferenceCaster::default());
    caster.load(&octree)?;
    reference.load(&octree)?;
    let mut pictures = Vec::new();
    for object in 0..octree.objects().len() {
        let view = view_of(&octree, object, (64, 48), false)?;
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        caster.cast(&view, &mut ours)?;
        reference.cast(&view, &mut theirs)?;
        demand_agreement(&*caster, &Comparison::of(&ours, &theirs))?;
        pictures.push(ours);
    }
    demand(pictures[0] != pictures[1], || "both objects look the same: the test tests nothing".into())
}

/// Fans of any number of rays give the reference's hits, and rays of fans that are not finite or too long miss.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn fans_agree(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    let root = octree.objects()[0].root_slot as u32;
    let mut fans: Vec<Fan> = (0..5)
        .map(|i| Fan {
            origin: Vec3::splat(1.5) + Vec3::new(0.024, -0.033, 0.027) * i as f32,
            axes: Mat3::from_rotation_x(i as f32) * 0.4,
        })
        .collect();
    fans.push(Fan { origin: Vec3::new(1.5, f32::NAN, 1.5), axes: Mat3::IDENTITY });
    fans.push(Fan { origin: Vec3::splat(1.5), axes: Mat3::IDENTITY * f32::INFINITY });
    fans.push(Fan { origin: Vec3::splat(1.5), axes: Mat3::IDENTITY * 1e30 });
    let (mut caster, mut reference) = (subject.open()?, ReferenceCaster::default());
    caster.load(&octree)?;
    reference.load(&octree)?;
    for rays in [0, 1, 15, 16, 17, 33] {
        let directions: Vec<Vec3> = (0..rays).map(|i| Vec3::new((i as f32).sin(), 0.3, (i as f32).cos())).collect();
        for contours in [false, true] {
            let fans = Fans { root, contours, fans: &fans, directions: &directions };
            let (mut ours, mut theirs) = (vec![Hit::miss(7); 3], Vec::new());
            caster.cast_fans(&fans, &mut ours)?;
            reference.cast_fans(&fans, &mut theirs)?;
            let comparison = Comparison::of(&ours, &theirs);
            let agrees = comparison.rays == fans.len() as u64
                && (fans.is_empty() || Allowed::on(caster.device().kind).admits(&comparison));
            demand(agrees, || format!("{rays} rays a fan, contours {contours}: {comparison:?}"))?;
            let found = theirs.iter().filter(|hit| !hit.is_miss()).count();
            demand(rays < 15 || (found > rays && found < theirs.len() - rays), || format!("{found} hits"))?;
        }
    }
    Ok(())
}

/// Rays that no camera makes end; where rounding is the reference's, they end where the reference's do. A GPU that rounds
/// in its own way may send rays that touch planes between voxels either way.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn strange_rays_agree(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    for sample in [Sample::plain(7, true), Sample::scattered(6, true)] {
        let comparison = strange_against_reference(&mut *caster, &sample.octree()?, (32, 24))?;
        if caster.device().kind != DeviceKind::Gpu {
            demand_agreement(&*caster, &comparison)?;
        }
    }
    Ok(())
}

/// A view without pixels, with too many, or with a number out of its range is an error that names the field, and the
/// caster works afterwards.
///
/// # Errors
/// A view that is taken, or refused for another reason; what the caster said elsewhere.
pub fn bad_views_are_refused(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::plain(4, true).octree()?;
    let mut caster = subject.open()?;
    caster.load(&octree)?;
    let good = view_of(&octree, 0, (24, 16), true)?;
    let mut before = Vec::new();
    caster.cast(&good, &mut before)?;
    for (field, view) in bad_views(&good) {
        let results = [caster.cast(&view, &mut Vec::new()), caster.time(&view).map(drop)];
        for result in results {
            let refused = matches!(&result, Err(CastError::View(text)) if text.contains(field));
            demand(refused, || format!("a bad {field}: {result:?}"))?;
        }
    }
    let mut after = Vec::new();
    caster.cast(&good, &mut after)?;
    demand(before == after, || "the same view gives other hits after bad ones".into())
}

/// Rays start at the root of an object of the loaded octree and nowhere else.
///
/// # Errors
/// A slot that is taken although it is no root, or a root that is refused; what the caster said elsewhere.
pub fn roots_of_no_object_are_refused(subject: &Subject) -> Result<(), Fault> {
    let (two, one) = (two_objects()?, Sample::plain(4, true).octree()?);
    let mut caster = subject.open()?;
    for octree in [&two, &one, &two] {
        caster.load(octree)?;
        let roots: Vec<u32> = octree.objects().iter().map(|object| object.root_slot as u32).collect();
        let child = octree.first_child(roots[0]);
        let end = octree.slots().len() as u32;
        // The second root of `two` is not a root of `one`.
        let second = two.objects()[1].root_slot as u32;
        for root in [0, 1, roots[0] + 1, child, second, end - 1, end, end * 2, i32::MAX as u32, u32::MAX] {
            let view = View { root, ..view_of(octree, 0, (9, 7), true)? };
            let fan = [Fan { origin: Vec3::splat(1.5), axes: Mat3::IDENTITY }];
            let fans = Fans { root, contours: true, fans: &fan, directions: &[Vec3::X] };
            let results = [
                caster.cast(&view, &mut Vec::new()),
                caster.time(&view).map(drop),
                caster.cast_fans(&fans, &mut Vec::new()),
                caster.cast_rays(&Rays { root, contours: true, rays: &ray() }, &mut Vec::new()),
                caster.cast_instances(
                    &Instances::new(vec![view_of(octree, 0, (9, 7), true)?, view])?,
                    &mut Nearest::default(),
                ),
            ];
            for result in results {
                let right = match &result {
                    Ok(()) => roots.contains(&root),
                    Err(CastError::Root { root: named, .. }) => *named == root && !roots.contains(&root),
                    Err(_) => false,
                };
                demand(right, || format!("root {root} of an octree with the roots {roots:?}: {result:?}"))?;
            }
        }
    }
    Ok(())
}

/// An octree with a pointer that leads out of it is not loaded, and the caster works afterwards.
///
/// # Errors
/// An octree that is taken, or refused for another reason; what the caster said elsewhere.
pub fn unsound_octrees_are_refused(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    let good = Sample::plain(3, false).octree()?;
    for _ in 0..2 {
        let result = caster.load(&unsound()?);
        demand(matches!(result, Err(CastError::Unsound(_))), || format!("an unsound octree: {result:?}"))?;
        caster.load(&good)?;
        caster.cast(&view_of(&good, 0, (9, 7), false)?, &mut Vec::new())?;
    }
    Ok(())
}

/// An octree of a file with a changed byte is not loaded, unless checksums are left out; the caster works afterwards.
///
/// # Errors
/// An octree that is taken, or refused for another reason; what the caster said elsewhere.
pub fn damaged_octrees_are_refused(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    let good = Sample::plain(3, false).octree()?;
    let mut file = Vec::new();
    good.write_to(&mut file).map_err(|source| FormatError::Io { path: "memory".into(), source })?;
    // The last byte is in the last block: padding, which no caster reads.
    let last = file.len() - 1;
    file[last] ^= 1;
    let result = caster.load(&Arc::new(Octree::from_bytes(&file)?));
    let right = matches!(&result, Err(CastError::Damaged(broken)) if broken.rule == ids::BLOCK_CHECKSUM);
    demand(right, || format!("a damaged octree: {result:?}"))?;
    caster
        .load(&Arc::new(Octree::from_bytes_with(&file, &OpenOptions { verify: false, ..OpenOptions::default() })?))?;
    caster.load(&good)?;
    caster.cast(&view_of(&good, 0, (9, 7), false)?, &mut Vec::new())?;
    Ok(())
}

/// What was checked against an octree that is no longer loaded is not cast.
///
/// # Errors
/// A view or fans that are cast; what the caster said elsewhere.
pub fn checks_against_another_octree_do_not_count(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::plain(4, true).octree()?;
    let mut caster = subject.open()?;
    let view = view_of(&octree, 0, (9, 7), false)?;
    let fan = [Fan { origin: Vec3::splat(1.5), axes: Mat3::IDENTITY }];
    let fans = Fans { root: view.root, contours: true, fans: &fan, directions: &[Vec3::X] };
    let roots = crate::Roots::of(&octree)?;
    let ray = ray();
    let rays = roots.check_rays(&Rays { root: view.root, contours: true, rays: &ray })?;
    let instances = Instances::new(vec![view])?;
    let instances = roots.check_instances(&instances)?;
    let (view, fans) = (roots.check_view(&view)?, roots.check_fans(&fans)?);
    for _ in 0..2 {
        let results = [
            caster.cast_checked(view, &mut Vec::new()),
            caster.time_checked(view).map(drop),
            caster.cast_fans_checked(fans, &mut Vec::new()),
            caster.cast_rays_checked(rays, &mut Vec::new()),
            caster.cast_instances_checked(instances, &mut Nearest::default()),
        ];
        for result in results {
            demand(matches!(result, Err(CastError::NotLoaded)), || {
                format!("checked against another octree: {result:?}")
            })?;
        }
        caster.load(&octree)?;
    }
    Ok(())
}

/// Without an octree, casting is an error and no memory is taken; with one, it is.
///
/// # Errors
/// Something else; what the caster said elsewhere.
pub fn nothing_loaded_is_an_error(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::plain(3, false).octree()?;
    let mut caster = subject.open()?;
    let view = view_of(&octree, 0, (8, 8), false)?;
    let fans = Fans { root: view.root, contours: true, fans: &[], directions: &[Vec3::X] };
    let rays = Rays { root: view.root, contours: true, rays: &[] };
    let results = [
        caster.cast(&view, &mut Vec::new()),
        caster.time(&view).map(drop),
        caster.cast_fans(&fans, &mut Vec::new()),
        caster.cast_rays(&rays, &mut Vec::new()),
        caster.cast_instances(&Instances::new(vec![view])?, &mut Nearest::default()),
    ];
    for result in results {
        demand(matches!(result, Err(CastError::NotLoaded)), || format!("before an octree is loaded: {result:?}"))?;
    }
    demand(caster.resident_bytes() == 0, || format!("{} bytes of no octree", caster.resident_bytes()))?;
    demand(!caster.name().is_empty() && !caster.device().name.is_empty(), || "an engine without a name".into())?;
    caster.load(&octree)?;
    demand(caster.resident_bytes() > 0, || "no bytes of an octree".into())?;
    Ok(caster.cast(&view, &mut Vec::new())?)
}

/// Pictures of changing sizes: each has its own hits and nothing of the one before.
///
/// # Errors
/// A picture of a wrong size, or a second one that differs; what the caster said.
pub fn nothing_is_left_of_the_frame_before(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    let octree = Sample::plain(5, true).octree()?;
    caster.load(&octree)?;
    let mut cast = |size, beam| {
        let mut hits = vec![Hit::miss(7); 3];
        caster.cast(&view_of(&octree, 0, size, beam)?, &mut hits)?;
        Ok::<_, Fault>(hits)
    };
    let small = cast((20, 10), false)?;
    let large = cast((90, 70), true)?;
    demand((small.len(), large.len()) == (200, 6300), || format!("{} and {} hits", small.len(), large.len()))?;
    demand(cast((20, 10), false)? == small, || "the same view gives other hits".into())
}

/// Times are of work done: not zero, not more than passed, and on a processor not much less either.
///
/// # Errors
/// Times that cannot be; what the caster said.
pub fn times_are_plausible(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    let octree = Sample::plain(7, true).octree()?;
    caster.load(&octree)?;
    for beam in [false, true] {
        let view = view_of(&octree, 0, (256, 192), beam)?;
        // Compiles and warms up.
        caster.time(&view)?;
        let mut mostly_work = caster.device().kind == DeviceKind::Gpu;
        for _ in 0..10 {
            let start = Instant::now();
            let time = caster.time(&view)?;
            let wall = start.elapsed();
            demand(time.total <= wall && !time.total.is_zero(), || format!("{time:?} of {wall:?}"))?;
            demand(time.coarse <= time.total && time.coarse.is_zero() != beam, || format!("beam {beam}: {time:?}"))?;
            mostly_work |= time.total * 4 >= wall;
        }
        // On a busy machine a run may wait longer than it works, but not every time.
        demand(mostly_work, || "the engine's own times leave most of the time unexplained".into())?;
    }
    Ok(())
}

/// The comparison has teeth: the engine with any of several mistakes added does not pass.
///
/// # Errors
/// A mistake that is not noticed; what the caster said.
pub fn broken_casters_are_caught(subject: &Subject) -> Result<(), Fault> {
    broken_casters_are_caught_by(subject, &against_reference)
}

/// Compares an engine with the reference on an octree, in pictures of a size.
pub(super) type Compare = dyn Fn(&mut dyn Caster, &Arc<Octree>, (u32, u32)) -> Result<Comparison, CastError>;

pub(super) fn broken_casters_are_caught_by(subject: &Subject, compare: &Compare) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    for way in &WAYS {
        let mut broken = Broken { caster: subject.open()?, way };
        let allowed = Allowed::on(broken.device().kind);
        if way.only_exact && allowed != Allowed::EXACT {
            continue;
        }
        let comparison = compare(&mut broken, &octree, (64, 48))?;
        demand(!allowed.admits(&comparison), || format!("not noticed: {}: {comparison:?}", way.what))?;
    }
    Ok(())
}
