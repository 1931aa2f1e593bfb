//! The checks of [`Caster::cast_instances`](crate::Caster::cast_instances).

use std::sync::Arc;

use esvo_format::Octree;

use super::checks::demand_agreement;
use super::{Fault, Subject, demand};
use crate::gpu::kernel::{GpuOptions, INSTANCES_WGSL};
use crate::instances::{Node, Rules};
use crate::testing::compare::{Allowed, Comparison};
use crate::testing::instances::{against_each_alone, camera, extreme, moving, views};
use crate::testing::sample::{Sample, cameras, options, strange_views, two_objects};
use crate::{
    CastError, CastOptions, Caster, Checked, Device, DeviceKind, FrameTime, Hit, Instances, Nearest, Rays, Roots, View,
};

/// Objects that move.
const COUNT: usize = 100;
const SIZE: (u32, u32) = (83, 61);

/// A hundred objects that move, over several frames, from outside and among them: in every pixel the nearest hit is that of
/// each object cast alone.
///
/// # Errors
/// Rays that end elsewhere, or at another object; what the caster said.
pub fn instances_agree(subject: &Subject) -> Result<(), Fault> {
    let octree = two_objects()?;
    let mut caster = subject.open()?;
    caster.load(&octree)?;
    let bytes = caster.resident_bytes();
    let mut all = Comparison::default();
    for frame in 0..4 {
        let options = options()[[1, 4, 5, 3][frame as usize]];
        let views = views(&octree, &moving(COUNT, frame), &camera(frame % 2 == 1), SIZE, &options)?;
        all = all.and(against_each_alone(&mut *caster, &views)?);
    }
    demand(caster.resident_bytes() == bytes, || "instances take memory of their own for the octree".into())?;
    demand_agreement(&*caster, &all)
}

/// The same for pictures of odd sizes, for one object, for objects none of which is in the picture, and for many blocks.
///
/// # Errors
/// Rays that end elsewhere, or at another object; what the caster said.
pub fn instances_of_odd_sizes_agree(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    let octree = Sample::scattered(6, true).octree()?;
    caster.load(&octree)?;
    let options = CastOptions::default();
    let mut all = Comparison::default();
    for (count, size) in [(1, (64, 48)), (2, (1, 1)), (9, (1, 33)), (30, (33, 1)), (5, (15, 17)), (40, (16, 16))] {
        let views = views(&octree, &moving(count, 7), &camera(true), size, &options)?;
        all = all.and(against_each_alone(&mut *caster, &views)?);
    }
    let away = crate::Camera { forward: [7.0, 4.0, 8.0], ..camera(false) };
    all = all.and(against_each_alone(&mut *caster, &views(&octree, &moving(20, 0), &away, SIZE, &options)?)?);
    demand_agreement(&*caster, &all)
}

/// Objects at places that no scene has, and views that no camera makes: where rounding is the reference's, hits are those of
/// each object cast alone. A GPU that rounds in its own way may send rays that touch planes between voxels either way.
///
/// # Errors
/// Rays that end elsewhere, or at another object; what the caster said.
pub fn strange_instances_agree(subject: &Subject) -> Result<(), Fault> {
    let octree = two_objects()?;
    let mut caster = subject.open()?;
    caster.load(&octree)?;
    let mut all = Comparison::default();
    for (number, camera) in cameras().iter().enumerate() {
        let options = options()[[1, 5, 0, 4, 1][number]];
        let all_views = views(&octree, &extreme(), camera, (33, 25), &options)?;
        all = all.and(against_each_alone(&mut *caster, &all_views)?);
        let strange: Vec<View> =
            strange_views(&all_views[0]).into_iter().chain(all_views[..2].iter().copied()).collect();
        all = all.and(against_each_alone(&mut *caster, &strange)?);
    }
    if caster.device().kind == DeviceKind::Gpu { Ok(()) } else { demand_agreement(&*caster, &all) }
}

/// One way to break a caster of instances.
struct Way {
    what: &'static str,
    rules: fn(&mut Rules),
    nodes: fn(&mut Node),
}

const NONE: Way = Way { what: "", rules: |_| (), nodes: |_| () };

/// Mistakes that an engine could make.
const WAYS: [Way; 8] = [
    Way { what: "boxes end a column too early", nodes: |node| node.high[0] = less(node.low[0], node.high[0]), ..NONE },
    Way { what: "boxes end a row too early", nodes: |node| node.high[1] = less(node.low[1], node.high[1]), ..NONE },
    Way {
        what: "boxes start a column too late",
        nodes: |node| node.low[0] = node.high[0].min(node.low[0] + 1),
        ..NONE
    },
    Way { what: "boxes start too late in depth", nodes: |node| node.t += 0.02, ..NONE },
    Way {
        what: "of equal hits the last",
        rules: |rules| rules.replaces = |(t, view), (other, than)| t < other || (t == other && view > than),
        ..NONE
    },
    Way { what: "rays end before the nearest hit", rules: |rules| rules.end = |t, _| (t - 0.02).min(1.0), ..NONE },
    Way { what: "rays end at one half", rules: |rules| rules.end = |_, _| 0.5, ..NONE },
    Way { what: "the last that is cast", rules: |rules| rules.replaces = |_, _| true, ..NONE },
];

fn less(low: u32, high: u32) -> u32 {
    low.max(high.saturating_sub(1))
}

/// An engine whose instances are cast by core with a mistake.
struct Broken<'a> {
    caster: Box<dyn Caster>,
    way: &'a Way,
}

impl Caster for Broken<'_> {
    fn name(&self) -> &'static str {
        "broken"
    }

    fn device(&self) -> &Device {
        self.caster.device()
    }

    fn resident_bytes(&self) -> u64 {
        self.caster.resident_bytes()
    }

    fn roots(&self) -> Option<&Roots> {
        self.caster.roots()
    }

    fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
        self.caster.load_checked(octree, roots)
    }

    fn cast_checked(&mut self, view: Checked<View>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        self.caster.cast_checked(view, hits)
    }

    fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
        self.caster.time_checked(view)
    }

    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        self.caster.cast_rays_checked(rays, hits)
    }

    fn cast_instances(&mut self, instances: &Instances, nearest: &mut Nearest) -> Result<(), CastError> {
        let broken = instances.clone().broken(self.way.rules, self.way.nodes);
        broken.cast_all(nearest, |view, rays, hits| {
            self.caster.cast_rays(&Rays { root: view.root, contours: view.contours(), rays }, hits)
        })
    }
}

/// A scene in which every mistake shows.
fn telling(octree: &Octree) -> Result<Vec<View>, CastError> {
    views(octree, &moving(COUNT, 2), &camera(false), SIZE, &CastOptions::default())
}

/// The comparison has teeth: the engine with any of several mistakes added does not pass, and passes without.
///
/// # Errors
/// A mistake that is not noticed; what the caster said.
pub fn broken_casters_of_instances_are_caught(subject: &Subject) -> Result<(), Fault> {
    broken_casters_of_instances_are_caught_by(subject, &against_each_alone)
}

/// Compares instances with each cast alone.
pub(super) type CompareInstances = dyn Fn(&mut dyn Caster, &[View]) -> Result<Comparison, CastError>;

pub(super) fn broken_casters_of_instances_are_caught_by(
    subject: &Subject,
    compare: &CompareInstances,
) -> Result<(), Fault> {
    let octree = two_objects()?;
    let views = telling(&octree)?;
    let mut right = Broken { caster: subject.open()?, way: &NONE };
    right.load(&octree)?;
    let comparison = compare(&mut right, &views)?;
    demand_agreement(&right, &comparison)?;
    for way in &WAYS {
        let mut broken = Broken { caster: subject.open()?, way };
        broken.load(&octree)?;
        let comparison = compare(&mut broken, &views)?;
        demand(!Allowed::on(broken.device().kind).admits(&comparison), || {
            format!("not noticed: {}: {comparison:?}", way.what)
        })?;
    }
    Ok(())
}

/// Lines of the kernel of instances, and mistakes to put in their place.
const MISTAKES: [(&str, &str); 7] = [
    ("x > nodes[at].high.x", "x >= nodes[at].high.x"),
    ("y < nodes[at].low.y", "y <= nodes[at].low.y"),
    ("nodes[at].t > nearest.hit.raw_t", "nodes[at].t + 0.02 > nearest.hit.raw_t"),
    ("nearest.hit.raw_t + margin", "nearest.hit.raw_t - 0.02"),
    (
        "hit.raw_t == nearest.hit.raw_t && number < nearest.number",
        "hit.raw_t == nearest.hit.raw_t && number > nearest.number",
    ),
    ("ray.root = nodes[at].view.root;", "ray.root = nodes[0u].view.root;"),
    ("ray.t_min = nodes[at].view.t_near;", "ray.t_min = 0.4;"),
];

/// The comparison has teeth: a kernel with any of several mistakes in it does not pass.
///
/// # Errors
/// A mistake that is not noticed, or that replaces a line that the kernel no longer has; what the caster said.
pub fn kernels_that_break_instances_are_caught(subject: &Subject) -> Result<(), Fault> {
    let octree = two_objects()?;
    let views = telling(&octree)?;
    for (right, wrong) in MISTAKES {
        demand(INSTANCES_WGSL.contains(right), || format!("the kernel has no {right:?}"))?;
        let instances_kernel = Some(INSTANCES_WGSL.replace(right, wrong));
        let mut caster = subject.open_with(&GpuOptions { instances_kernel, ..GpuOptions::default() })??;
        caster.load(&octree)?;
        let comparison = against_each_alone(&mut *caster, &views)?;
        demand(!Allowed::GPU.admits(&comparison), || format!("not noticed: {wrong}: {comparison:?}"))?;
    }
    Ok(())
}
