//! Pictures with effects on a device against those of the processor: the same rays, up to the rounding of single precision.

#[expect(dead_code, reason = "other tests need more of it")]
mod gpu_common;
#[expect(dead_code, reason = "other tests need more of it")]
mod scene;

use esvo_core::DeviceKind;
use esvo_device::Gpu;
use esvo_shadow::World;
use esvo_shadow::effects::{Composed, Cone, Counts, Frame, Lamp, Pass, Settings, Wanted, compose};
use esvo_shadow::gpu::{EFFECTS_WGSL, Effects, GpuVolume};
use glam::Vec3;
use gpu_common::gpu;
use scene::{GRID, eye, room};

/// No multiple of a workgroup.
const SIZE: (u32, u32) = (93, 61);
const ALL: Wanted = Wanted { occlusion: true, shadows: true, reflections: true, fog: true, bounce: true };
const NONE: Wanted = Wanted { occlusion: false, shadows: false, reflections: false, fog: false, bounce: false };

struct Set {
    gpu: &'static Gpu,
    world: World,
    copy: GpuVolume,
    frame: Frame,
    lamps: Vec<Lamp>,
}

impl Set {
    fn new() -> Option<Self> {
        let gpu = gpu()?;
        let blocks = room();
        let world = blocks.world();
        let copy = GpuVolume::new(gpu, world.volume()).unwrap();
        let frame = blocks.frame(eye([2.2, -1.6, 1.7], [1.9, 2.2, 0.4], SIZE));
        let lamp = |position: [f32; 3], radius: f32, color: [f32; 3]| Lamp {
            position: position.into(),
            radius,
            color: color.into(),
            reach: f32::INFINITY,
            cone: None,
        };
        let cone = Cone { axis: Vec3::new(0.1, 0.3, -1.0).normalize(), inner: 0.9, outer: 0.7 };
        let lamps = vec![
            lamp([0.9, 0.8, 2.2], 0.2, [2.0, 1.6, 1.2]),
            Lamp { reach: 3.0, ..lamp([3.3, 1.4, 1.6], 0.0, [0.5, 0.6, 1.5]) },
            Lamp { cone: Some(cone), ..lamp([2.6, 1.8, 2.1], 0.1, [1.0, 2.0, 1.0]) },
        ];
        Some(Self { gpu, world, copy, frame, lamps })
    }

    fn here(&self, settings: &Settings) -> Composed {
        compose(&self.frame, self.world.volume(), GRID, &self.lamps, settings)
    }

    fn there(&self, effects: &Effects, settings: &Settings) -> Composed {
        effects.compose(self.gpu, &self.copy, GRID, &self.frame, &self.lamps, settings).unwrap()
    }
}

/// Root of the mean squared difference of two pictures, and the share of pixels that differ by more than rounding.
fn difference(a: &Composed, b: &Composed) -> (f32, f32) {
    assert_eq!(a.light.len(), b.light.len());
    let offs = || a.light.iter().zip(&b.light).map(|(a, b)| (*a - *b).abs().max_element());
    assert!(offs().all(f32::is_finite));
    let pixels = a.light.len() as f32;
    let apart = offs().filter(|off| *off > 1e-3).count() as f32;
    ((offs().map(|off| off * off).sum::<f32>() / pixels).sqrt(), apart / pixels)
}

/// Drivers that run on the processor round sines and roots as it does. A GPU's are a little off, so that a ray in some thousand goes elsewhere.
fn is_near(gpu: &Gpu, error: f32, apart: f32) -> bool {
    match gpu.about().kind {
        DeviceKind::SoftwareGpu => error < 1e-4 && apart < 5e-4,
        _ => error < 0.01 && apart < 0.01,
    }
}

/// Every effect alone, raw and smoothed, and all together.
fn cases() -> Vec<(&'static str, Settings)> {
    let settings = |wanted: Wanted, smoothing: u32| Settings {
        wanted,
        counts: Counts { occlusion: 5, shadows: 3, reflections: 2, fog: 6, bounce: 4 },
        smoothing,
        fog: 0.3,
        ..Settings::default()
    };
    vec![
        ("no effect", settings(NONE, 0)),
        ("ambient occlusion", settings(Wanted { occlusion: true, ..NONE }, 0)),
        ("ambient occlusion, smoothed", settings(Wanted { occlusion: true, ..NONE }, 3)),
        ("shadows", settings(Wanted { shadows: true, ..NONE }, 0)),
        ("shadows, smoothed", settings(Wanted { shadows: true, ..NONE }, 2)),
        ("reflections", settings(Wanted { reflections: true, ..NONE }, 0)),
        ("a mirror", Settings { roughness: 0.0, ..settings(Wanted { reflections: true, ..NONE }, 3) }),
        ("fog", settings(Wanted { fog: true, ..NONE }, 0)),
        ("fog in steps", Settings { fog_step: 1.0, ..settings(Wanted { fog: true, ..NONE }, 0) }),
        ("fog, smoothed", settings(Wanted { fog: true, ..NONE }, 2)),
        ("bounce", settings(Wanted { bounce: true, ..NONE }, 0)),
        ("all", settings(ALL, 2)),
    ]
}

#[test]
fn pictures_are_those_of_the_processor() {
    let Some(set) = Set::new() else { return };
    let effects = Effects::new(set.gpu).unwrap();
    for (what, settings) in cases() {
        let (here, there) = (set.here(&settings), set.there(&effects, &settings));
        let (error, apart) = difference(&here, &there);
        println!("{what}: {error} apart, {:.2} % of pixels", 100.0 * apart);
        let names = |made: &Composed| made.passes.iter().map(|(pass, _)| *pass).collect::<Vec<_>>();
        assert_eq!(names(&here), names(&there), "{what}");
        assert!(is_near(set.gpu, error, apart), "{what}: {error} {apart}");
    }
}

/// Mistakes in each kernel, and in what they share, are seen in a picture of the effect. Some are as small as what a GPU may round otherwise.
#[test]
fn mistakes_are_noticed() {
    let Some(set) = Set::new().filter(|set| set.gpu.about().kind == DeviceKind::SoftwareGpu) else { return };
    let mistakes = [
        ("ambient occlusion", "key + i * 3242174889u", "key + i * 2242174889u"),
        ("ambient occlusion", "sqrt(point.y)", "point.y"),
        ("ambient occlusion", "depth * half)", "depth)"),
        ("ambient occlusion", "if below > 0.5 * footprint", "if below > -1.0"),
        ("ambient occlusion", "* job.share + MARGIN", "* job.share * 0.5"),
        (
            "ambient occlusion",
            "query.direction * offset.x + query.normal",
            "query.direction * 0.5 * offset.x + query.normal",
        ),
        (
            "ambient occlusion, smoothed",
            "kind == 2u {\n                    let off",
            "kind == 3u {\n                    let off",
        ),
        ("ambient occlusion, smoothed", "ACROSS * ACROSS * f32(job.rays)", "ACROSS * ACROSS"),
        ("shadows", "smoothstep(lamp.outer, lamp.inner, cosine)", "step(lamp.outer, cosine)"),
        ("shadows", "distance / (lamp.reach * lamp.reach)", "distance / lamp.reach"),
        ("shadows", "job.seed + i)", "job.seed)"),
        ("shadows", "select(job.rays, 1u, lamp.radius == 0.0)", "1u"),
        ("shadows, smoothed", "off <= job.distance", "off <= 9.0"),
        ("shadows, smoothed", "beside(pixel, i, j, job.apart)", "beside(pixel, i, j, 1)"),
        ("reflections", "surface.is_some && near && dot", "surface.is_some && dot"),
        ("reflections", "(0.1 * size())", "(0.2 * size())"),
        ("a mirror", "(off * off) * (off * off) * off", "(off * off) * (off * off)"),
        ("fog", "+ jitter.x) * step", "+ 0.5) * step"),
        ("fog", "exp(-job.density * length) * scattered", "scattered"),
        ("fog in steps", "direction * (step / size * 65536.0)", "direction * (step * 2.0 / size * 65536.0)"),
        ("fog, smoothed", "return vec4<f32>(sum / weights, own.w)", "return vec4<f32>(sum / weights, 1.0)"),
        ("bounce", "colors[shown.pixel].xyz * slope", "colors[shown.pixel].xyz"),
        ("bounce", "!is_in_the_way(Query(place, normal, direction, far))", "true"),
    ];
    let (cases, mut missed) = (cases(), Vec::new());
    for (what, right, wrong) in mistakes {
        assert!(EFFECTS_WGSL.contains(right), "{right}");
        let effects = Effects::with_kernels(set.gpu, &EFFECTS_WGSL.replacen(right, wrong, 1)).unwrap();
        let (_, settings) = cases.iter().find(|(name, _)| *name == what).unwrap();
        let (error, apart) = difference(&set.here(settings), &set.there(&effects, settings));
        println!("{what}, {wrong}: {error} apart, {:.2} % of pixels", 100.0 * apart);
        if is_near(set.gpu, error, apart) {
            missed.push(format!("{what}: {wrong}: {error} {apart}"));
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}

/// Passes that nothing asks for do not run, and without lamps, a surface, or a voxel there is a picture all the same.
#[test]
fn what_is_not_there_costs_nothing() {
    let Some(mut set) = Set::new() else { return };
    let effects = Effects::new(set.gpu).unwrap();
    let settings = Settings { counts: Counts::all(2), ..Settings::default() };
    let passes = |made: &Composed| made.passes.iter().map(|(pass, _)| *pass).collect::<Vec<_>>();
    assert_eq!(passes(&set.there(&effects, &settings)), [Pass::Shade]);
    let points = Settings { wanted: Wanted { shadows: true, ..NONE }, ..settings.clone() };
    set.lamps.truncate(2);
    set.lamps.remove(0);
    assert_eq!(passes(&set.there(&effects, &points)), [Pass::Shadows, Pass::Shade]);
    set.lamps.clear();
    let all = Settings { wanted: ALL, ..settings };
    assert_eq!(difference(&set.here(&all), &set.there(&effects, &all)).1, 0.0);
    set.frame.surfaces.fill(None);
    let empty = set.there(&effects, &all);
    assert!(empty.light.iter().all(|light| light.is_finite() && light.x > 0.0));
}
