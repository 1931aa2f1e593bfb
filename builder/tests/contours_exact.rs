//! Every contour of a build encloses all of the surface in its voxel. Checked in integers, contour by contour, against the
//! triangles themselves.

#[path = "exact/enclosure.rs"]
mod enclosure;
#[path = "exact/integers.rs"]
mod integers;
#[path = "exact/random.rs"]
mod random;

use std::path::Path;

use esvo_builder::{BuildSettings, Material, Mesh, build};
use esvo_format::{Contour, Octree};
use esvo_scenes::{SceneManifest, generate, procedural};
use glam::DVec3;
use num_bigint::BigInt;
use rayon::prelude::*;

use enclosure::{Cube, Slab, encloses};
use integers::{Vector, exponent_of, integer};
use random::Random;

type Triangle = [DVec3; 3];

/// Counts of a check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Found {
    contours: u64,
    /// Contours that exclude some of the surface.
    wrong: u64,
    /// Contours that would exclude some of it if their position were one step more or one step less.
    sharp: u64,
    /// Triangles that were tested in integers; `quick`: those that a test in doubles found inside.
    exact: u64,
    quick: u64,
}

impl Found {
    fn and(self, other: Self) -> Self {
        Self {
            contours: self.contours + other.contours,
            wrong: self.wrong + other.wrong,
            sharp: self.sharp + other.sharp,
            exact: self.exact + other.exact,
            quick: self.quick + other.quick,
        }
    }
}

/// How contours are checked.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Care {
    /// All triangles in integers, and each contour also with its position changed.
    Everything,
    /// Triangles that a test in doubles finds clearly inside are not tested in integers.
    Quick,
}

/// A triangle in octree space (rounded), and in integers in the mesh's units.
struct Both {
    rounded: Triangle,
    exact: [Vector<BigInt>; 3],
}

struct Check<'a> {
    octree: &'a Octree,
    triangles: Vec<Both>,
    origin: Vector<BigInt>,
    extent: BigInt,
    care: Care,
}

/// A voxel: lower corner in voxels of its level, level, and the triangles that may be in it.
struct Voxel {
    at: [u32; 3],
    level: u32,
    near: Vec<u32>,
}

impl<'a> Check<'a> {
    fn new(octree: &'a Octree, triangles: &[Triangle], care: Care) -> Self {
        let to_mesh = octree.octree_to_mesh(0);
        let (origin, extent) = (to_mesh.w_axis.truncate(), to_mesh.x_axis.x);
        let mut exponent = exponent_of(extent) + octree.needs().levels as i32;
        for p in triangles.iter().flatten().chain([&origin]) {
            exponent = p.to_array().into_iter().map(exponent_of).fold(exponent, i32::max);
        }
        let exact = |p: DVec3| p.to_array().map(|x| integer(x, exponent));
        let triangles = (triangles.iter())
            .map(|t| Both { rounded: t.map(|p| (p - origin) / extent), exact: t.map(exact) })
            .collect();
        Self { octree, triangles, origin: exact(origin), extent: integer(extent, exponent), care }
    }

    fn run(&self) -> Found {
        let root = self.octree.objects()[0].root_slot as u32;
        let near = (0..self.triangles.len() as u32).collect();
        self.children(root, &Voxel { at: [0; 3], level: 0, near })
    }

    /// Checks the contours of the children of the descriptor at `slot`, and of their descendants.
    fn children(&self, slot: u32, parent: &Voxel) -> Found {
        let descriptor = self.octree.descriptor(slot);
        let child = |child: u8| {
            let voxel = self.part(parent, child);
            let mut found = self.octree.contour(slot, child).map_or(Found::default(), |c| self.contour(c, &voxel));
            if let Some(next) = self.octree.child(slot, child) {
                found = found.and(self.children(next, &voxel));
            }
            found
        };
        let children = (0..8u8).filter(|c| descriptor.valid_mask() >> c & 1 != 0);
        if parent.level < 4 {
            children.collect::<Vec<_>>().into_par_iter().map(child).reduce(Found::default, Found::and)
        } else {
            children.map(child).fold(Found::default(), Found::and)
        }
    }

    /// A child voxel with the triangles near it: those whose box meets its cube, slightly enlarged, and whose plane does.
    fn part(&self, parent: &Voxel, child: u8) -> Voxel {
        let at: [u32; 3] = std::array::from_fn(|axis| 2 * parent.at[axis] + u32::from(child >> axis & 1));
        let level = parent.level + 1;
        let (centre, half) = centre_and_half(at, level);
        let reach = half * (1.0 + 1e-6) + 1e-12;
        let near = (parent.near.iter().copied())
            .filter(|t| {
                let [a, b, c] = self.triangles[*t as usize].rounded.map(|p| p - centre);
                let normal = (b - a).cross(c - a);
                a.min(b).min(c).max_element() <= reach
                    && a.max(b).max(c).min_element() >= -reach
                    && a.dot(normal).abs() <= reach * normal.abs().element_sum() + 1e-14
            })
            .collect();
        Voxel { at, level, near }
    }

    fn contour(&self, contour: Contour, voxel: &Voxel) -> Found {
        let edge = &self.extent >> voxel.level;
        assert_eq!(&edge << voxel.level, self.extent, "the unit is too large");
        let cube = Cube { corner: std::array::from_fn(|axis| &self.origin[axis] + &edge * voxel.at[axis]), edge };
        let mut found = Found { contours: 1, ..Found::default() };
        let slab = Slab::decode(contour.0);
        let mut all = true;
        for t in &voxel.near {
            let triangle = &self.triangles[*t as usize];
            let clearly = is_clearly_inside(contour, voxel, &triangle.rounded);
            if self.care == Care::Quick && clearly {
                found.quick += 1;
                continue;
            }
            found.exact += 1;
            let inside = encloses(&slab, &cube, &triangle.exact);
            assert!(inside || !clearly, "doubles found inside what is not");
            all &= inside;
        }
        found.wrong = u64::from(!all);
        if self.care == Care::Everything {
            let caught = |word: u32| {
                let slab = Slab::decode(word);
                voxel.near.iter().any(|t| !encloses(&slab, &cube, &self.triangles[*t as usize].exact))
            };
            found.sharp = u64::from(moved(contour, 1).is_none_or(caught) || moved(contour, -1).is_none_or(caught));
        }
        found
    }
}

fn centre_and_half(at: [u32; 3], level: u32) -> (DVec3, f64) {
    let edge = (-f64::from(level)).exp2();
    ((DVec3::from(at.map(f64::from)) + 0.5) * edge, 0.5 * edge)
}

/// The contour with its position changed by one step; `None` if the position is at the end of its range.
fn moved(contour: Contour, by: i32) -> Option<u32> {
    let position = ((contour.0 << 7) as i32 >> 25) + by;
    (-64..64).contains(&position).then_some(contour.0 & !(0x7f << 18) | (position as u32 & 0x7f) << 18)
}

/// Whether the part of a triangle in the voxel, and slightly beyond, is inside the slab by more than all rounding errors.
///
/// The triangle is cut by planes slightly outside the cube. By the argument in the builder's `clip` module, this keeps every
/// point inside the cube, up to an error in the last digits.
fn is_clearly_inside(contour: Contour, voxel: &Voxel, triangle: &Triangle) -> bool {
    const BEYOND: f64 = 1e-9;
    let (centre, half) = centre_and_half(voxel.at, voxel.level);
    let mut polygon: Vec<DVec3> = triangle.iter().map(|p| (*p - centre) / (2.0 * half)).collect();
    for (axis, sign) in (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
        let over = |p: &DVec3| p[axis] * sign - (0.5 + BEYOND);
        let mut cut = Vec::with_capacity(polygon.len() + 2);
        for (i, b) in polygon.iter().enumerate() {
            let a = &polygon[(i + polygon.len() - 1) % polygon.len()];
            let (da, db) = (over(a), over(b));
            if da * db < 0.0 {
                cut.push(*a + (*b - *a) * (da / (da - db)));
            }
            if db <= 0.0 {
                cut.push(*b);
            }
        }
        polygon = cut;
        if polygon.is_empty() {
            return true;
        }
    }
    // A corner of a triangle that is 2^level voxels large has an error of up to 2^level units of 2^-52 here.
    let error = 1e-6;
    let slab = contour.decode();
    let normal = DVec3::from(slab.normal);
    polygon.iter().all(|p| {
        let at = normal.dot(*p);
        at >= slab.lo() + error && at <= slab.hi() - error
    })
}

fn triangles_of(mesh: &Mesh) -> Vec<Triangle> {
    mesh.triangles.iter().map(|t| t.map(|i| DVec3::from(mesh.positions[i as usize]))).collect()
}

fn mesh_of(triangles: &[Triangle]) -> Mesh {
    Mesh {
        positions: triangles.iter().flatten().map(|p| p.to_array()).collect(),
        triangles: (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        triangle_materials: vec![0; triangles.len()],
        materials: vec![Material::default()],
        ..Mesh::default()
    }
}

/// Builds and checks. Every contour must enclose its surface.
fn check(name: &str, mesh: &Mesh, settings: BuildSettings, care: Care) -> Found {
    let octree = build(mesh, &settings, &|_| ()).unwrap().octree;
    octree.sound().unwrap();
    let found = Check::new(&octree, &triangles_of(mesh), care).run();
    println!("{name}, {} levels, contour error {}: {found:?}", settings.levels, settings.contour_error);
    assert_eq!(found.wrong, 0, "{name}: of {} contours, {} leave out some of the surface", found.contours, found.wrong);
    found
}

/// Settings for geometry only, refined to the last level.
fn settings(levels: u32, contour_error: f64) -> BuildSettings {
    BuildSettings { levels, contour_error, color_error: 256.0, normal_error: 2.0, ..BuildSettings::default() }
}

fn soup(random: &mut Random, count: usize, size: f64) -> Mesh {
    let near = |random: &mut Random, p: DVec3| p + (random.point(53) - 0.5) * size;
    let triangles: Vec<Triangle> = (0..count)
        .map(|_| {
            let a = random.point(53);
            [a, near(random, a), near(random, a)]
        })
        .collect();
    mesh_of(&triangles)
}

#[test]
fn contours_of_random_triangles_enclose_them() {
    let mut random = Random(1);
    for (count, size, levels) in [(12, 2.0, 5), (60, 0.4, 5), (200, 0.05, 6)] {
        for contour_error in [15.0, 5.0] {
            let found =
                check("soup", &soup(&mut random, count, size), settings(levels, contour_error), Care::Everything);
            assert!(found.contours > 200, "{found:?}");
            // Rounding adds up to half a step of thickness and of position on either side, but not both on both sides.
            assert_eq!(found.sharp, found.contours, "a contour moved by a step must be noticed");
        }
    }
}

#[test]
fn contours_of_small_scenes_enclose_them() {
    let far = |mut mesh: Mesh| {
        mesh.positions.iter_mut().for_each(|p| *p = (DVec3::from(*p) * 0.37 + DVec3::new(1e6, -3e5, 77.7)).to_array());
        mesh
    };
    for (name, mesh, levels) in [
        ("cube", generate::cube(), 6),
        ("sphere", generate::sphere(2), 5),
        ("sphere, far away", far(generate::sphere(2)), 5),
        ("slivers", generate::slivers(), 5),
        ("bumpy sphere on plane", generate::bumpy_sphere_on_plane(), 4),
    ] {
        let found = check(name, &mesh, settings(levels, 15.0), Care::Everything);
        assert_eq!(found.sharp, found.contours, "{name}: a contour moved by a step must be noticed");
    }
}

#[test]
fn contours_of_interiors_enclose_them() {
    for (name, levels) in [("sibenik", 6), ("conference", 5)] {
        for (name, mesh) in [(format!("{name}, stand-in"), procedural(name).unwrap()), scene(name)] {
            let found = check(&name, &mesh, settings(levels, 15.0), Care::Quick);
            assert!(found.contours > 1000 && found.quick > 0, "{found:?}");
        }
    }
}

#[test]
fn deep_contours_enclose_the_surface() {
    let mut random = Random(2);
    let around = DVec3::new(0.3, 0.7, 0.55);
    let tiny = |random: &mut Random, size: f64| [0; 3].map(|_| around + (random.point(40) - 0.5) * size);
    let mut triangles: Vec<Triangle> = (0..10).map(|_| tiny(&mut random, 2.0f64.powi(-16))).collect();
    triangles.push([DVec3::ZERO, DVec3::X * 1e-6, DVec3::Y * 1e-6]);
    triangles.push([DVec3::ONE, DVec3::ONE - DVec3::X * 1e-6, DVec3::ONE - DVec3::Y * 1e-6]);
    for levels in [16, 19, 21] {
        check("deep", &mesh_of(&triangles), settings(levels, 23.0), Care::Everything);
    }
}

/// The real mesh of a scene if it is found, else its procedural stand-in.
fn scene(name: &str) -> (String, Mesh) {
    let manifest = SceneManifest::builtin().unwrap();
    let entry = manifest.scene(name).unwrap();
    // Tests run in the folder of their crate.
    match esvo_scenes::find_scene_file(entry, Some(Path::new("../../shared/scenes"))) {
        Some(path) => (format!("{name}, real"), esvo_builder::import::load_mesh(&path).unwrap()),
        None => (format!("{name}, stand-in"), entry.stand_in.as_ref().unwrap().generate().unwrap()),
    }
}

#[test]
#[ignore = "long: minutes in release"]
fn contours_of_large_scenes_enclose_them() {
    for (name, levels) in [("sibenik", 10), ("conference", 10), ("hairball", 8), ("fairy", 8), ("city", 8)] {
        let (name, mesh) = scene(name);
        check(&name, &mesh, BuildSettings { levels, ..BuildSettings::default() }, Care::Quick);
    }
}
