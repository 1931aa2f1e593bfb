//! Pictures of voxels and of the pixels that methods shade, like those of the document.

use std::sync::Arc;

use esvo_builder::BuildSettings;
use esvo_builder::cells::{Cells, PreparedMesh, build_cells};
use esvo_core::{Camera, CastOptions, Caster, Picture, View};
use esvo_cpu::CpuCaster;
use esvo_raster::{Method, Options, Surface, Voxelizer, bounds, morton, morton_place};
use glam::{DMat4, DVec3, Vec3};

use super::PictureGroup;
use super::rate::differences;
use super::surface::failed;
use crate::BenchError;
use crate::output::NamedPicture;
use crate::scene::{NamedView, Scene};
use crate::system::machine::slug;

/// Level of the grid of a scene's pictures, and of those of test meshes.
const SCENE_LEVEL: u32 = 8;
const TEST_LEVEL: u32 = 5;
/// Size of pictures of voxels.
const SIZE: (u32, u32) = (640, 480);
/// Edge of a pixel of a method in pictures of pixels.
const PIXEL: u32 = 16;

const PLAIN: [f32; 3] = [0.74, 0.76, 0.80];
const MISSING: [f32; 3] = [0.86, 0.12, 0.10];
const EXTRA: [f32; 3] = [0.98, 0.82, 0.10];
const SKY: [f32; 3] = [0.96, 0.97, 1.0];

/// Makes pictures with the methods of a device.
pub(super) struct Pictures<'a> {
    voxelizer: &'a Voxelizer,
    methods: &'a [Method],
    /// Those that were made.
    pub(super) made: Vec<NamedPicture>,
    /// Their names, by what they show.
    pub(super) groups: Vec<PictureGroup>,
}

/// The exact voxels of a mesh, and those that a method finds.
struct Found {
    level: u32,
    all: Vec<u64>,
    missing: Vec<u64>,
    extra: Vec<u64>,
}

impl<'a> Pictures<'a> {
    pub(super) fn new(voxelizer: &'a Voxelizer, methods: &'a [Method]) -> Self {
        Self { voxelizer, methods, made: Vec::new(), groups: Vec::new() }
    }

    /// A scene from its first viewpoint, by each method.
    pub(super) fn scene(&mut self, scene: &Scene, prepared: &PreparedMesh) -> Result<(), BenchError> {
        let exact = prepared.cells(SCENE_LEVEL).map_err(|e| failed(&scene.name, e))?;
        let NamedView { name, camera } = &scene.views[0];
        self.group(format!("{}, {name}, voxels of a grid of {}^3", scene.name, 1u32 << SCENE_LEVEL), &scene.credit);
        for &method in self.methods {
            let found = self.found(prepared.corners(), SCENE_LEVEL, method, &exact)?;
            let picture = voxels(&found, prepared.octree_to_mesh(), camera)?;
            self.put(format!("voxels-{}-{}", slug(&scene.name), method.name()), picture);
        }
        Ok(())
    }

    /// The document's test cases: cracks in a steep plane, holes between projections, spaghetti of needles, and pixels.
    pub(super) fn test_meshes(&mut self) -> Result<(), BenchError> {
        for (name, title, level, corners, eye) in [
            ("steep", "A steep plane", TEST_LEVEL, steep(), DVec3::new(2.3, -0.9, 1.0)),
            ("profile", "Strips that face different axes", 4, profile(), DVec3::new(0.2, -1.5, 1.1)),
            ("needles", "Needles", TEST_LEVEL, needles(), DVec3::new(0.6, -0.4, 2.0)),
        ] {
            let exact = bounds::voxels(&corners, level);
            self.group(format!("{title}, voxels of a grid of {}^3", 1u32 << level), "generated");
            for &method in self.methods {
                let found = self.found(&corners, level, method, &exact)?;
                let middle = DVec3::new(0.5, 0.5, 0.45);
                let forward = (middle - eye).to_array();
                let camera = Camera {
                    eye: eye.to_array(),
                    forward,
                    up: [0.0, 0.0, 1.0],
                    fov_degrees: 38.0,
                    near: 0.05,
                    far: 9.0,
                };
                self.put(format!("voxels-{name}-{}", method.name()), voxels(&found, DMat4::IDENTITY, &camera)?);
            }
        }
        self.group("Pixels that are shaded for three triangles".into(), "generated");
        for method in self.methods.iter().copied().filter(|method| *method != Method::Compute) {
            let picture = self.pixels(&facing(), method)?;
            self.put(format!("pixels-{}", method.name()), picture);
        }
        Ok(())
    }

    /// Begins a group, which the next pictures belong to.
    fn group(&mut self, what: String, credit: &str) {
        self.groups.push(PictureGroup { what, credit: credit.into(), files: Vec::new() });
    }

    fn put(&mut self, name: String, picture: Picture) {
        let name = format!("{name}.png");
        if let Some(group) = self.groups.last_mut() {
            group.files.push(name.clone());
        }
        self.made.push(NamedPicture { name, picture });
    }

    fn found(&self, corners: &[[DVec3; 3]], level: u32, method: Method, exact: &[u64]) -> Result<Found, BenchError> {
        let surface = Surface { corners, looks: None };
        let voxels =
            self.voxelizer.voxelize(&surface, &Options::new(level, method)).map_err(|e| failed(method.name(), e))?;
        let (missing, extra) = differences(exact, &voxels.codes);
        let mut all = [&voxels.codes[..], &missing].concat();
        all.sort_unstable();
        Ok(Found { level, all, missing, extra })
    }

    /// Which pixels of triangles that face the z axis a method shades: green, if the middle is covered; red, if another part of the pixel
    /// is; yellow, if no part is. Pale red: a pixel that a part of is covered, and that is not shaded.
    fn pixels(&self, corners: &[[DVec3; 3]], method: Method) -> Result<Picture, BenchError> {
        let surface = Surface { corners, looks: None };
        let counts = |method| {
            let options = Options::new(TEST_LEVEL, method);
            self.voxelizer.pixels(&surface, &options).map_err(|e| failed(method.name(), e))
        };
        let (shaded, covered) = (counts(method)?, counts(Method::DominantAxis)?);
        let mut touched = vec![false; (shaded.edge as usize).pow(2)];
        for code in bounds::voxels(corners, TEST_LEVEL) {
            let [x, y, _] = morton_place(code);
            touched[(y * shaded.edge + x) as usize] = true;
        }
        let edge = shaded.edge;
        let of_z = 2 * (edge as usize).pow(2);
        let scale = f64::from(edge * PIXEL);
        Ok(Picture::from_fn((edge * PIXEL, edge * PIXEL), |x, y| {
            // y points up.
            let y = edge * PIXEL - 1 - y;
            let at = (y / PIXEL * edge + x / PIXEL) as usize;
            let pixel = match (shaded.counts[of_z + at] > 0, covered.counts[of_z + at] > 0, touched[at]) {
                (true, true, _) => [0.45, 0.78, 0.45],
                (true, false, true) => [0.90, 0.45, 0.42],
                (true, false, false) => EXTRA,
                (false, _, true) => [1.0, 0.86, 0.85],
                (false, _, false) => [1.0; 3],
            };
            let border = x.is_multiple_of(PIXEL) || y.is_multiple_of(PIXEL);
            let p = [(f64::from(x) + 0.5) / scale, (f64::from(y) + 0.5) / scale];
            if corners.iter().any(|triangle| near_edge(triangle, p, 0.9 / scale)) {
                [0.1, 0.1, 0.4]
            } else if border {
                pixel.map(|c| c * 0.86)
            } else {
                pixel
            }
        }))
    }
}

/// Whether a point is so near to an edge of a triangle, seen along z.
fn near_edge(triangle: &[DVec3; 3], p: [f64; 2], reach: f64) -> bool {
    (0..3).any(|edge| {
        let (a, b) = (triangle[edge].truncate(), triangle[(edge + 1) % 3].truncate());
        let p = glam::DVec2::from(p);
        let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        p.distance(a + (b - a) * t) <= reach
    })
}

/// Voxels as cubes with dark edges: missing ones red, extra ones yellow.
fn voxels(found: &Found, octree_to_mesh: DMat4, camera: &Camera) -> Result<Picture, BenchError> {
    let error = |e: &dyn ToString| failed("picture", e.to_string());
    if found.all.is_empty() {
        return Ok(Picture::from_fn(SIZE, |_, _| SKY));
    }
    let cells = Cells { levels: found.level, codes: found.all.clone(), ..Cells::default() };
    let built = build_cells(&cells, octree_to_mesh, &BuildSettings::default()).map_err(|e| error(&e))?;
    let octree = Arc::new(built.octree);
    let root = octree.objects()[0].root_slot as u32;
    // Two rays along each side of a pixel.
    let (width, height) = (SIZE.0 * 2, SIZE.1 * 2);
    let options = CastOptions { contours: false, beam: false, max_voxel_pixels: 0.0 };
    let view = View::new(camera, octree.octree_to_mesh(0), root, (width, height), &options).map_err(|e| error(&e))?;
    let mut caster = CpuCaster::new(None).map_err(|e| error(&e))?;
    caster.load(&octree).map_err(|e| error(&e))?;
    let mut hits = Vec::new();
    caster.cast(&view, &mut hits).map_err(|e| error(&e))?;
    let color = |x: u32, y: u32| -> [f32; 3] {
        let Some(t) = hits[(y * width + x) as usize].t() else { return SKY };
        let ray = view.ray(x, y);
        let scale = (1u32 << found.level) as f32;
        let at = (ray.origin + ray.direction * t - 1.0) * scale;
        let inside = at + ray.direction.normalize() * 1e-2;
        let cell = inside.floor().clamp(Vec3::ZERO, Vec3::splat(scale - 1.0));
        let code = morton(cell.to_array().map(|x| x as u32));
        let base = if found.missing.binary_search(&code).is_ok() {
            MISSING
        } else if found.extra.binary_search(&code).is_ok() {
            EXTRA
        } else {
            PLAIN
        };
        // The face that the point lies on, and how near it is to an edge of the cube.
        let from_border = (0.5 - (at - cell - 0.5).abs()).to_array();
        let face = (0..3).min_by(|a, b| from_border[*a].total_cmp(&from_border[*b])).unwrap_or(0);
        let to_edge = (0..3).filter(|axis| *axis != face).map(|axis| from_border[axis]).fold(1.0, f32::min);
        let light = [0.80, 0.66, 1.0][face] * if to_edge < 0.05 { 0.72 } else { 1.0 };
        base.map(|c| c * light)
    };
    Ok(Picture::from_fn(SIZE, |x, y| {
        let mut sum = [0.0; 3];
        for k in 0..4 {
            let part = color(2 * x + k % 2, 2 * y + k / 2);
            (0..3).for_each(|c| sum[c] += 0.25 * part[c]);
        }
        sum
    }))
}

/// A plane that rises three voxels for each voxel along x: Figures 3 and 4.
fn steep() -> Vec<[DVec3; 3]> {
    let (a, b, side) = (DVec3::new(0.3, 0.1, 0.05), DVec3::new(0.59, 0.1, 0.92), DVec3::new(0.0, 0.8, 0.0));
    vec![[a, b, b + side], [a, b + side, a + side]]
}

/// Strips that are projected along different axes: Figures 7 and 8.
fn profile() -> Vec<[DVec3; 3]> {
    let at = |x: f64, z: f64| [DVec3::new(x / 16.0, 0.03, z / 16.0), DVec3::new(x / 16.0, 0.97, z / 16.0)];
    let points = [at(1.2, 5.3), at(6.7, 4.7), at(6.9, 5.45), at(12.2, 5.2), at(12.4, 8.6), at(15.3, 9.4)];
    let strip = |pair: &[[DVec3; 2]]| [[pair[0][0], pair[1][0], pair[1][1]], [pair[0][0], pair[1][1], pair[0][1]]];
    points.windows(2).flat_map(strip).collect()
}

/// A fan of narrow triangles: Figures 9 and 10.
fn needles() -> Vec<[DVec3; 3]> {
    let tip = DVec3::new(0.22, 0.2, 0.4);
    let end = |angle: f64| DVec3::new(0.22 + 0.55 * angle.cos(), 0.2 + 0.55 * angle.sin(), 0.4 + 0.06 * angle);
    (0..6).map(|i| f64::from(i) * 0.29).map(|angle| [tip, end(angle), end(angle + 0.045)]).collect()
}

/// Triangles that face the z axis: Figures 15 to 17.
fn facing() -> Vec<[DVec3; 3]> {
    let p = |x: f64, y: f64| DVec3::new(x / 32.0, y / 32.0, 0.5 + 0.01 * x / 32.0);
    vec![
        [p(3.2, 4.1), p(26.7, 8.3), p(9.4, 27.6)],
        [p(14.3, 27.2), p(29.6, 12.4), p(28.1, 14.9)],
        [p(5.1, 1.6), p(30.2, 2.9), p(29.5, 3.6)],
    ]
}
