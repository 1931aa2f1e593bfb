//! Rays into sparse voxel octrees: cameras, the trait that every engine implements, the reference caster, the GPU kernel.
//!
//! ```
//! use esvo_core::camera::viewpoint::overview;
//! use esvo_core::reference::ReferenceCaster;
//! use esvo_core::testing::sample::Sample;
//! use esvo_core::{CastOptions, Caster, View, shading};
//!
//! let octree = Sample::plain(5, true).octree()?; // or Arc::new(Octree::open(path)?)
//! let mut caster = ReferenceCaster::default();
//! caster.load(&octree)?;
//! let camera = overview(&octree, [0.0, 1.0, 0.0], 60.0, 4.0 / 3.0);
//! let root = octree.objects()[0].root_slot as u32;
//! let view = View::new(&camera, octree.octree_to_mesh(0), root, (64, 48), &CastOptions::default())?;
//! let mut hits = Vec::new();
//! caster.cast(&view, &mut hits)?;
//! let picture = shading::shade(&octree, &view, &hits);
//! assert_eq!((picture.width, picture.height), (64, 48));
//! assert!(hits.iter().any(|hit| !hit.is_miss()));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The same with your own rays, in the units of the mesh, and a ray from each hit to a lamp:
//!
//! ```
//! use esvo_core::glam::DVec3;
//! use esvo_core::reference::ReferenceCaster;
//! use esvo_core::testing::sample::Sample;
//! use esvo_core::{Caster, HitPoint, Object, Ray};
//!
//! let octree = Sample::plain(5, true).octree()?;
//! let mut caster = ReferenceCaster::default();
//! caster.load(&octree)?;
//! let object = Object::of(&octree, 0);
//! let middle = object.from_cast(DVec3::splat(1.5));
//! let rays: Vec<Ray> = (0..100).map(|i| object.ray(middle, DVec3::new(1.0, f64::from(i) / 50.0 - 1.0, 0.3), 0.0..f64::INFINITY)).collect();
//! let mut hits = Vec::new();
//! caster.cast_rays(&object.rays(&rays), &mut hits)?;
//!
//! let lamp = middle;
//! let points: Vec<HitPoint> = rays.iter().zip(&hits).filter_map(|(ray, hit)| HitPoint::new(&object, ray, hit)).collect();
//! let to_lamp = |point: &HitPoint| point.shadow_ray(lamp - point.position(), (lamp - point.position()).length());
//! let shadow_rays: Vec<Ray> = points.iter().filter_map(to_lamp).collect();
//! let mut blockers = Vec::new();
//! caster.cast_rays(&object.rays(&shadow_rays), &mut blockers)?;
//! let dark = points.len() - blockers.iter().filter(|hit| hit.is_miss()).count();
//! println!("{} of {} rays hit, {dark} points are dark", points.len(), rays.len());
//! # assert!(!points.is_empty());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is where
//!
//! | to | see |
//! |---|---|
//! | place a camera | [`Camera`]; [`camera::viewpoint`]: one that sees all objects |
//! | know the rays of a picture | [`View`], [`Ray`]; in double precision: [`exact`] |
//! | cast a picture | [`Caster::cast`] |
//! | read only the parts of a file that a picture needs | [`Detail`] |
//! | cast a picture of several objects, or of one placed many times | [`Instances`], [`Caster::cast_instances`]; each whole: [`Nearest::cast`] |
//! | cast your own rays | [`Object::ray`], [`Object::rays`], [`Caster::cast_rays`]; many from few points: [`Fans`], [`Caster::cast_fans`] |
//! | read a hit | [`Hit`]; its position, normal, colour and voxel in mesh space: [`HitPoint`] |
//! | go on from a hit | [`HitPoint::next_ray`]; to a light: [`HitPoint::shadow_ray`] |
//! | place an object elsewhere, once or many times | [`Object::placed`], [`Object::view`] |
//! | make a picture | [`shading`], [`Picture`]; files: [`picture`] with the feature `png` |
//! | light a picture by lamps, the sun and the sky, with shadows | [`lights`] |
//! | give it another background | [`sky`] |
//! | filter a picture where voxels are larger than a pixel | [`filter`], [`Caster::filter`] |
//! | compute ambient occlusion | [`ambient`] |
//! | know what a correct hit is | [`mod@reference`]: the paper's Figure 8 |
//! | write an engine | the methods of [`Caster`] that end in `_checked`, [`Checked`], [`Roots`] |
//! | write an engine for a GPU | [`gpu::choice`], [`gpu::kernel`], [`gpu::resident`]; for triangles: [`gpu::triangles`] |
//! | test an engine | [`testing::conformance`]: one macro makes its tests |
//! | compare two engines | [`testing::compare`], [`testing::sample`] |
//!
//! The engines are crates of their own: `esvo-cpu`, `esvo-wgpu`, `esvo-ash`. The crate `esvo-engines` opens one by name.
//!
//! # Spaces and units
//!
//! [`Object`] names the spaces. Cameras, positions and distances are in mesh space. Octree space, the cube `[0, 1]³`, is
//! that of the file format. Kernels read rays and views in cast space, octree space plus 1. [`Object::ray`] and [`View::new`]
//! lead there from mesh space, [`HitPoint`] leads back.
//!
//! `t` counts lengths of the ray's direction. A ray of a picture reaches the far plane at `t` = 1; the direction of a ray of
//! [`Object::ray`] is as long as an edge of the root cube.
//!
//! # Bad input
//!
//! [`Caster::load`] takes only octrees that are [intact](esvo_format::Octree::intact) and
//! [sound](esvo_format::Octree::sound), and [`Caster::cast`] only views that are
//! finite and start at a root of the loaded octree. Everything else is a [`CastError`]; nothing panics.
//!
//! # Features
//!
//! `png`: [`picture`] reads and writes files, with the crate `image`.

pub mod ambient;
mod attributes;
pub mod camera;
mod caster;
mod checked;
mod detail;
mod error;
pub mod exact;
mod fan;
pub mod filter;
mod frame;
pub mod gpu;
mod hit;
mod hit_point;
pub mod instances;
mod leave_out;
pub mod lights;
mod nearest;
mod object;
pub mod picture;
mod ray;
pub mod reference;
pub mod shading;
mod shape;
pub mod sky;
pub mod testing;

pub use camera::Camera;
pub use caster::{Caster, Device, DeviceKind, Filtered, FrameTime};
pub use checked::{Checked, Roots};
pub use detail::Detail;
pub use error::CastError;
pub use fan::{Fan, Fans};
pub use frame::{
    BEAM_BLOCK, COARSE_VOXEL_BLOCKS, CastOptions, FLAG_BEAM, FLAG_CONTOURS, FLAG_WIDE_BEAM, MAX_PIXELS, View,
    WIDE_BEAM_BLOCK, check_size,
};
pub use glam;
pub use hit::{Hit, exp2};
pub use hit_point::{HitPoint, VoxelCube};
pub use instances::Instances;
pub use leave_out::LeaveOut;
pub use nearest::Nearest;
pub use object::Object;
pub use picture::Picture;
pub use ray::{Ray, Rays};
