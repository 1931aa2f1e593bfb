//! A caster of one's own in the harness: checked, timed in Table 2, its error and its stability measured, beside this project's.
//! `cargo run --release -p esvo-examples --example measure_own_caster`

use std::sync::Arc;

use esvo_bench::paper_bench::{PaperBenchOptions, run_paper_bench, tables};
use esvo_bench::stability_bench::{self, StabilityOptions, run_stability_bench};
use esvo_bench::{Matrix, Progress};
use esvo_core::reference::EPSILON;
use esvo_core::{CastError, Caster, Checked, Device, DeviceKind, Hit, Ray, Rays, Roots};
use esvo_engines::{Allowed, EngineId};
use esvo_format::Octree;
use glam::DVec3;

/// Goes through the octree by recursion, in double precision, on one thread.
struct Recursive(Device, Option<(Arc<Octree>, Roots)>);

impl Caster for Recursive {
    fn name(&self) -> &'static str {
        "recursive"
    }
    fn device(&self) -> &Device {
        &self.0
    }
    fn resident_bytes(&self) -> u64 {
        self.1.as_ref().map_or(0, |(octree, _)| size_of_val(octree.slots()) as u64)
    }
    fn roots(&self) -> Option<&Roots> {
        self.1.as_ref().map(|(_, roots)| roots)
    }
    fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
        self.1 = Some((octree.clone(), roots));
        Ok(())
    }
    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let (octree, roots) = self.1.as_ref().ok_or(CastError::NotLoaded)?;
        let Rays { root, contours, rays } = *roots.open(&rays)?;
        let cast = |ray: &Ray| {
            let direction = ray.direction.map(|d| if d.abs() < EPSILON { EPSILON.copysign(d) } else { d });
            let walk = (octree.as_ref(), ray, contours, ray.origin.as_dvec3(), direction.as_dvec3());
            let hit = || below(&walk, root, DVec3::ONE, 0.5, (ray.t_min.into(), ray.t_max.into()));
            ray.is_cast().then(hit).flatten().unwrap_or(Hit::miss(1))
        };
        *hits = rays.iter().map(cast).collect();
        Ok(())
    }
}

/// The octree, the ray, whether contours clip, the ray's origin and direction.
type Walk<'a> = (&'a Octree, &'a Ray, bool, DVec3, DVec3);

/// The first hit in the children, of edge `size`, of the voxel at `low` whose descriptor is at `slot`, within `span`.
fn below(walk: &Walk, slot: u32, low: DVec3, size: f64, span: (f64, f64)) -> Option<Hit> {
    let &(octree, ray, contours, origin, direction) = walk;
    let valid = octree.descriptor(slot).valid_mask();
    let mut children: Vec<_> = (0..8u8).filter(|child| valid >> child & 1 != 0).collect();
    // Along the ray: with the bits of the axes that it goes backwards, the fewer set the nearer.
    let mirror = (0..3).fold(0, |mask, axis| mask | u8::from(direction[axis] < 0.0) << axis);
    children.sort_by_key(|child| (child ^ mirror).count_ones());
    children.into_iter().find_map(|child| {
        let low = low + size * DVec3::from([0, 1, 2].map(|axis| f64::from(child >> axis & 1)));
        let (a, b) = ((low - origin) / direction, (low + size - origin) / direction);
        let leave = a.max(b).min_element();
        let (mut enter, mut end) = (a.min(b).max_element().max(span.0), leave.min(span.1));
        let hit = |t: f64| Hit::new(t as f32, slot, child.into(), (size.log2() + 23.0) as u32, 1);
        if enter <= end && f64::from(ray.size_at_origin) + leave * f64::from(ray.size_per_t) >= size {
            return Some(hit(enter)); // Small enough.
        }
        if let Some(slab) = octree.contour(slot, child).filter(|_| contours).map(|contour| contour.decode()) {
            let (normal, to_centre) = (DVec3::from(slab.normal), low + 0.5 * size - origin);
            let [a, b] = [slab.lo(), slab.hi()].map(|n| (n * size + normal.dot(to_centre)) / normal.dot(direction));
            (enter, end) = (enter.max(a.min(b)), end.min(a.max(b)));
        }
        match octree.child(slot, child) {
            _ if enter > end => None,
            Some(next) => below(walk, next, low, 0.5 * size, (enter, end)),
            None => Some(hit(enter)),
        }
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Rounded otherwise: a ray in 10,000 may end at another voxel, and t of one that grazes a contour is less exact.
    let allowed = Allowed { share: 1e-4, t: 1e-2 };
    let device = Device { name: "processor".into(), kind: DeviceKind::Cpu, detail: "1 thread".into() };
    let open = move |_: &_| Ok(Recursive(device.clone(), None));
    let own = EngineId::register("recursive", "Recursion in double precision", allowed, open)?;
    let mut matrix = Matrix::default_run();
    matrix.select_scenes(&["sibenik".into()]);
    matrix.scenes[0].levels = vec![7];
    (matrix.resolutions, matrix.backends) = (vec![[160, 120]], vec![EngineId::Cpu, own]);
    let options = PaperBenchOptions { threads: Some(1), ..PaperBenchOptions::new(matrix) };
    let tables = run_paper_bench(&options, &Progress::hidden())?.report;
    print!("{}", tables::to_text(&tables));
    let options =
        StabilityOptions { rays: 20_000, gpu_rays: 20_000, engines: vec![own], ..StabilityOptions::default() };
    let stability = run_stability_bench(&options, &Progress::hidden())?;
    print!("{}", stability_bench::to_text(&stability));
    if tables.passed() && stability.passed() { Ok(()) } else { Err("the casters disagree".into()) }
}
