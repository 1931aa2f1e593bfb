//! The check before timing, and its negative controls: casters that are broken on purpose, which it must detect.

use std::sync::Arc;

use esvo_bench::paper_bench::check::{check, check_triangles};
use esvo_builder::BuildSettings;
use esvo_core::exact::{CameraRays, ExactRay};
use esvo_core::gpu::triangles::{Question, TriangleCaster, TriangleRecord, WideTriangles};
use esvo_core::reference::ReferenceCaster;
use esvo_core::{Camera, CastError, CastOptions, Caster, Checked, Device, FrameTime, Hit, Rays, Roots, View};
use esvo_cpu::triangles::TriangleScene;
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::Octree;

/// The reference caster with hits that are changed by `break_it`.
struct Broken<F> {
    inner: ReferenceCaster,
    break_it: F,
}

impl<F: FnMut(&mut Vec<Hit>) + Send> Caster for Broken<F> {
    fn name(&self) -> &'static str {
        "broken"
    }
    fn device(&self) -> &Device {
        self.inner.device()
    }
    fn resident_bytes(&self) -> u64 {
        self.inner.resident_bytes()
    }
    fn roots(&self) -> Option<&Roots> {
        self.inner.roots()
    }
    fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
        self.inner.load_checked(octree, roots)
    }
    fn cast_checked(&mut self, view: Checked<View>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        self.inner.cast_checked(view, hits)?;
        (self.break_it)(hits);
        Ok(())
    }
    fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
        self.inner.time_checked(view)
    }
    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        self.inner.cast_rays_checked(rays, hits)
    }
}

fn octree() -> Arc<Octree> {
    let mesh = esvo_scenes::procedural("sphere").unwrap();
    let settings = BuildSettings { levels: 6, ..BuildSettings::default() };
    Arc::new(esvo_builder::build(&mesh, &settings, &|_| {}).unwrap().octree)
}

fn views(octree: &Octree) -> Vec<View> {
    let camera = esvo_core::camera::viewpoint::overview(octree, [0.0, 1.0, 0.0], 40.0, 96.0 / 72.0);
    let root = octree.objects()[0].root_slot as u32;
    let view = |beam| {
        let options = CastOptions { beam, ..CastOptions::default() };
        View::new(&camera, octree.octree_to_mesh(0), root, (96, 72), &options).unwrap()
    };
    vec![view(false), view(true)]
}

fn passes(break_it: impl FnMut(&mut Vec<Hit>) + Send, backend: EngineId) -> bool {
    let octree = octree();
    let mut caster = Broken { inner: ReferenceCaster::default(), break_it };
    caster.load(&octree).unwrap();
    check(&mut caster, &octree, &views(&octree), backend.allowed()).unwrap().passed()
}

fn first_hit(hits: &mut [Hit]) -> &mut Hit {
    hits.iter_mut().find(|h| !h.is_miss()).unwrap()
}

#[test]
fn right_answers_pass() {
    assert!(passes(|_| {}, EngineId::Cpu));
    assert!(passes(|_| {}, EngineId::Ash));
}

#[test]
fn one_wrong_pixel_is_caught() {
    for backend in [EngineId::Cpu, EngineId::Wgpu] {
        assert!(!passes(|hits| first_hit(hits).slot += 1, backend), "another parent");
        assert!(!passes(|hits| first_hit(hits).voxel ^= 1, backend), "another child");
        assert!(!passes(|hits| *first_hit(hits) = Hit::miss(1), backend), "a hole");
        assert!(!passes(|hits| first_hit(hits).raw_t += 0.01, backend), "another distance");
        assert!(!passes(|hits| first_hit(hits).raw_t = f32::NAN, backend), "no distance");
        assert!(!passes(|hits| hits.truncate(hits.len() - 1), backend), "a pixel less");
        assert!(!passes(Vec::clear, backend), "nothing");
    }
}

#[test]
fn the_cpu_may_not_even_round_differently() {
    let nudge = |hits: &mut Vec<Hit>| first_hit(hits).raw_t = first_hit(hits).raw_t.next_up();
    assert!(!passes(nudge, EngineId::Cpu));
    assert!(passes(nudge, EngineId::Ash));
}

#[test]
fn the_cpu_caster_agrees() {
    let octree = octree();
    let mut caster = EngineId::Cpu.open(&OpenOptions { threads: Some(2), ..OpenOptions::default() }).unwrap();
    caster.load(&octree).unwrap();
    let agreement = check(&mut *caster, &octree, &views(&octree), EngineId::Cpu.allowed()).unwrap();
    assert!(agreement.passed(), "{agreement:?}");
    assert_eq!(agreement.pixels, 2 * 96 * 72);
}

/// A triangle caster that answers what `answer` says about the pixel's exact triangle.
struct Triangles<F> {
    scene: TriangleScene,
    device: Device,
    answer: F,
}

impl<F: Fn(u32) -> TriangleRecord> TriangleCaster for Triangles<F> {
    fn name(&self) -> &'static str {
        "triangles"
    }
    fn device(&self) -> &Device {
        &self.device
    }
    fn resident_bytes(&self) -> u64 {
        0
    }
    fn load(&mut self, _: &WideTriangles) -> Result<(), CastError> {
        Ok(())
    }
    fn cast(&mut self, rays: &CameraRays, records: &mut Vec<TriangleRecord>) -> Result<(), CastError> {
        *records = self.scene.cast_exact(rays).iter().map(|hit| (self.answer)(hit.triangle)).collect();
        Ok(())
    }
    fn cast_rays(&mut self, _: &[ExactRay], _: Question, _: &mut Vec<TriangleRecord>) -> Result<(), CastError> {
        Err(CastError::NotLoaded)
    }
    fn time(&mut self, _: &CameraRays) -> Result<std::time::Duration, CastError> {
        Err(CastError::NotLoaded)
    }
}

#[test]
fn wrong_triangles_are_noticed() {
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
    let scene = || TriangleScene::new(vec![corners, corners.map(|[x, y, _]| [x, y, -1.0])]).unwrap();
    let camera = Camera {
        eye: [0.0, 0.0, 3.0],
        forward: [0.0, 0.0, -1.0],
        up: [0.0, 1.0, 0.0],
        fov_degrees: 45.0,
        near: 0.1,
        far: 10.0,
    };
    let pictures = [CameraRays::new(&camera, (40, 30)).unwrap()];
    let found = |answer: &dyn Fn(u32) -> TriangleRecord| {
        let device = ReferenceCaster::default().device().clone();
        check_triangles(&mut Triangles { scene: scene(), device, answer }, &scene(), &pictures).unwrap()
    };
    let right = |triangle| TriangleRecord { t: 0.5, triangle };
    let (agreement, undecided) = found(&right);
    assert!(agreement.passed() && undecided == 0 && agreement.pixels == 1200, "{agreement:?}");
    let (agreement, undecided) = found(&|_| TriangleRecord::UNDECIDED);
    assert!(agreement.passed() && undecided == 1200, "{agreement:?}");
    for wrong in [|t: u32| if t == 0 { 1 } else { t }, |t| if t == 0 { u32::MAX } else { t }, |_| 0, |_| 7] {
        let (agreement, _) = found(&|triangle| right(wrong(triangle)));
        assert!(!agreement.passed() && agreement.different_voxel > 100, "{agreement:?}");
    }
}
