//! Pictures of voxels and of the pixels that methods shade, like those of the document.
//!
//! - `mod.rs`: which there are. `meshes.rs`: the test meshes. `pixels.rs`: pixels of a method. `cubes.rs`: voxels.
//! - `projections.rs`: the axis that is chosen. `columns.rs`: how many voxels a pixel has. `facets.rs`: faces that one can see through.

mod columns;
mod cubes;
mod facets;
mod meshes;
mod pixels;
mod projections;

use esvo_builder::cells::PreparedMesh;
use esvo_core::{Camera, Picture};
use esvo_raster::{Method, Options, Surface, Voxelizer, bounds};
use glam::{DMat4, DVec3};

use super::PictureGroup;
use super::rate::differences;
use super::surface::failed;
use crate::BenchError;
use crate::output::NamedPicture;
use crate::scene::{NamedView, Scene};
use crate::system::machine::slug;
use cubes::cubes;

/// Level of the grid of a scene's pictures, and of those of test meshes.
const SCENE_LEVEL: u32 = 8;
const TEST_LEVEL: u32 = 5;
/// Size of pictures of voxels.
const SIZE: (u32, u32) = (640, 480);

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
            let picture = found.picture(prepared.octree_to_mesh(), camera)?;
            self.put(format!("voxels-{}-{}", slug(&scene.name), method.name()), picture);
        }
        Ok(())
    }

    /// The document's test cases: cracks in a steep plane, the axis that is chosen, holes between projections, spaghetti of needles, the
    /// voxels of one pixel, and pixels.
    pub(super) fn test_meshes(&mut self) -> Result<(), BenchError> {
        let middle = DVec3::new(0.5, 0.5, 0.45);
        for (name, title, level, corners, eye) in [
            ("steep", "A steep plane", TEST_LEVEL, meshes::steep(), DVec3::new(2.3, -0.9, 1.0)),
            ("profile", "Strips that face different axes", 4, meshes::profile(), DVec3::new(0.2, -1.5, 1.1)),
            ("needles", "Needles", TEST_LEVEL, meshes::needles(), DVec3::new(0.6, -0.4, 2.0)),
            (
                "slope",
                "A plane that rises one voxel for each along x and y",
                columns::LEVEL,
                meshes::slope(),
                columns::EYE,
            ),
        ] {
            let exact = bounds::voxels(&corners, level);
            self.group(format!("{title}, voxels of a grid of {}^3", 1u32 << level), "generated");
            for &method in self.methods {
                let found = self.found(&corners, level, method, &exact)?;
                let picture = found.picture(DMat4::IDENTITY, &camera(eye, middle, 38.0))?;
                self.put(format!("voxels-{name}-{}", method.name()), picture);
            }
        }
        self.group("Voxels that one pixel stands for: one grey, two blue, three red".into(), "generated");
        for (name, picture) in columns::pictures(self.voxelizer)? {
            self.put(name.into(), picture);
        }
        self.group("The axis that a triangle is projected along: x red, y green, z blue".into(), "generated");
        for (name, picture) in projections::pictures(self.voxelizer)? {
            self.put(name.into(), picture);
        }
        self.group("Pixels that are shaded for three triangles".into(), "generated");
        for method in self.methods.iter().copied().filter(|method| *method != Method::Compute) {
            let picture = self.pixels(&meshes::facing(), method)?;
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
}

impl Found {
    /// Voxels with missing ones in red and extra ones in yellow.
    fn picture(&self, octree_to_mesh: DMat4, camera: &Camera) -> Result<Picture, BenchError> {
        cubes((self.level, &self.all), octree_to_mesh, camera, |code| {
            if self.missing.binary_search(&code).is_ok() {
                MISSING
            } else if self.extra.binary_search(&code).is_ok() {
                EXTRA
            } else {
                PLAIN
            }
        })
    }
}

/// A camera from a point towards another, z upwards.
fn camera(eye: DVec3, to: DVec3, fov_degrees: f64) -> Camera {
    let forward = (to - eye).to_array();
    Camera { eye: eye.to_array(), forward, up: [0.0, 0.0, 1.0], fov_degrees, near: 0.05, far: 9.0 }
}

/// A picture of [`SIZE`] with two rays along each side of a pixel.
fn smooth(color: impl Fn(u32, u32) -> [f32; 3] + Sync) -> Picture {
    Picture::from_fn_on_all_cores(SIZE, |x, y| {
        let mut sum = [0.0; 3];
        for k in 0..4 {
            let part = color(2 * x + k % 2, 2 * y + k / 2);
            (0..3).for_each(|c| sum[c] += 0.25 * part[c]);
        }
        sum
    })
}

#[cfg(test)]
mod tests {
    use esvo_raster::Voxelizer;

    /// A device; `None`, with a line of output, where there is none and none is required.
    pub(super) fn voxelizer() -> Option<Voxelizer> {
        match Voxelizer::open(None) {
            Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_none() => {
                println!("skipped: {error}");
                None
            }
            opened => Some(opened.unwrap()),
        }
    }
}
