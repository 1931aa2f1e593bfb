//! The options that tell which rays are cast: camera, scene, size of the picture.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::scene::{self, SceneSource};
use esvo_core::camera::viewpoint;
use esvo_core::{Camera, CastOptions, Object, View, WIDE_BEAM_BLOCK};
use esvo_format::Octree;
use glam::DVec3;

use crate::fail::{Failure, complain};
use crate::values::{parse_numbers, parse_size};

/// Field of view without `--fov`, over the shorter side in degrees.
pub(crate) const DEFAULT_FOV: f64 = 60.0;

/// A view of an octree.
#[derive(Debug, Args)]
pub(crate) struct ViewArguments {
    /// Eye and viewing direction: ex,ey,ez,fx,fy,fz, optionally followed by the field of view in degrees
    #[arg(long, value_name = "NUMBERS", allow_hyphen_values = true, conflicts_with = "scene")]
    pub(crate) camera: Option<String>,
    /// The direction that is up in the picture
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, default_value = "0,1,0", conflicts_with = "scene")]
    pub(crate) up: String,
    /// Field of view over the shorter side in degrees [default: 60]
    #[arg(long, value_name = "DEGREES")]
    pub(crate) fov: Option<f64>,
    /// Take the camera from the manifest of this scene
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,
    /// Number of the camera in the manifest, from 1
    #[arg(long, value_name = "K", default_value_t = 1, requires = "scene")]
    pub(crate) view: usize,
    /// Take the cameras of the scene's procedural stand-in even if the real mesh is found
    #[arg(long, requires = "scene", conflicts_with = "scenes_dir")]
    pub(crate) stand_in: bool,
    /// Folder that is searched first for the real mesh; its cameras are taken if it is found
    #[arg(long, value_name = "FOLDER", requires = "scene")]
    pub(crate) scenes_dir: Option<PathBuf>,
    /// Read the scene from this manifest of your own instead of the paper's: see scenes/README.md
    #[arg(long, value_name = "FILE", requires = "scene", conflicts_with = "scenes_dir")]
    pub(crate) manifest: Option<PathBuf>,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = parse_size)]
    pub(crate) size: [u32; 2],
    /// Ignore contours: draw voxels as cubes
    #[arg(long)]
    pub(crate) no_contours: bool,
    /// Rays end at voxels of this size in pixels; 0: at leaves only
    #[arg(long, value_name = "PIXELS", default_value_t = 1.0)]
    pub(crate) max_voxel_pixels: f32,
}

impl ViewArguments {
    /// Rejects values that are wrong for every octree.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        let pixels = self.max_voxel_pixels;
        if pixels >= 0.0 && pixels.is_finite() {
            return Ok(());
        }
        Err(format!("--max-voxel-pixels {pixels}: expected 0 or a positive number").into())
    }

    /// The camera and the view of the first object of an octree, without the beam.
    pub(crate) fn view(&self, octree: &Octree) -> Result<(Camera, View), Failure> {
        let objects = Object::all(octree);
        let camera = self.camera(&objects)?;
        let view = objects[0].view(&camera, self.size.into(), &self.options(!self.no_contours, false))?;
        Ok((camera, view))
    }

    /// The camera.
    pub(crate) fn camera(&self, objects: &[Object]) -> Result<Camera, Failure> {
        camera(self, objects)
    }

    /// A camera that a user wrote. `place` is where: an error starts with it.
    pub(crate) fn camera_of(&self, key: &Key, objects: &[Object], place: &str) -> Result<Camera, Failure> {
        let up = self.up()?;
        let direction = key.forward.normalize_or_zero();
        if up.normalize_or_zero().cross(direction).length() < 1e-9 {
            let what = "is parallel to the viewing direction; give another direction, e.g. --up";
            let place = if self.camera.is_some() { String::new() } else { format!("{place}: ") };
            return Err(format!("{place}--up {}: {what} {}", self.up, across(direction)).into());
        }
        let fov_degrees = key.fov_degrees.or(self.fov()?).unwrap_or(DEFAULT_FOV);
        let (eye, forward) = (key.eye.to_array(), key.forward.to_array());
        let (near, far) = viewpoint::planes_of(objects, eye);
        if !far.is_finite() {
            return Err(format!("{place}: the eye is too far away").into());
        }
        Ok(Camera { eye, forward, up: up.to_array(), fov_degrees, near, far })
    }

    /// The direction that is up, of any length above 0.
    pub(crate) fn up(&self) -> Result<DVec3, Failure> {
        let up: [f64; 3] = parse_numbers(&self.up)
            .and_then(|n| n.try_into().ok())
            .ok_or_else(|| format!("--up {}: expected three numbers, e.g. 0,1,0", self.up))?;
        if up == [0.0; 3] {
            return Err(format!("--up {}: is not a direction; expected one, e.g. 0,1,0", self.up).into());
        }
        Ok(up.into())
    }

    /// The field of view of `--fov`.
    pub(crate) fn fov(&self) -> Result<Option<f64>, Failure> {
        Ok(self.fov.map(|degrees| check_fov(&format!("--fov {degrees}"), degrees)).transpose()?)
    }

    /// Width of the picture divided by its height.
    pub(crate) fn aspect(&self) -> f64 {
        let [width, height] = self.size.map(f64::from);
        width / height
    }

    /// The view of each object by a camera, with or without contours; with the beam in blocks of so many pixels, or without.
    pub(crate) fn views(
        &self,
        camera: &Camera,
        objects: &[Object],
        contours: bool,
        beam: Option<u32>,
    ) -> Result<Vec<View>, Failure> {
        let options = self.options(contours, beam.is_some());
        let view = |object: &Object| {
            let view = object.view(camera, self.size.into(), &options)?;
            Ok(view.with_wide_beam(beam == Some(WIDE_BEAM_BLOCK)))
        };
        objects.iter().map(view).collect()
    }

    fn options(&self, contours: bool, beam: bool) -> CastOptions {
        CastOptions { contours, beam, max_voxel_pixels: self.max_voxel_pixels }
    }
}

/// The axis that is farthest from a direction.
fn across(direction: DVec3) -> &'static str {
    let [x, y, z] = direction.abs().to_array();
    match () {
        () if y <= x && y <= z => "0,1,0",
        () if z <= x => "0,0,1",
        () => "1,0,0",
    }
}

/// Rejects an angle that is no field of view. `place`: what has it.
fn check_fov(place: &str, degrees: f64) -> Result<f64, String> {
    if degrees > 0.0 && degrees < 180.0 {
        return Ok(degrees);
    }
    Err(format!("{place}: the field of view must be between 0 and 180 degrees"))
}

/// A camera as a user writes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Key {
    pub(crate) eye: DVec3,
    /// Any length above 0.
    pub(crate) forward: DVec3,
    /// Above 0 and below 180.
    pub(crate) fov_degrees: Option<f64>,
}

impl Key {
    /// Reads six or seven numbers. `place` is where they stand: an error starts with it.
    pub(crate) fn parse(numbers: &str, place: &str) -> Result<Self, String> {
        let n = parse_numbers(numbers).filter(|n| n.len() == 6 || n.len() == 7).ok_or_else(|| {
            format!(
                "{place}: expected six numbers, eye and direction, or seven with the field of view: ex,ey,ez,fx,fy,fz,60"
            )
        })?;
        let fov_degrees = n.get(6).map(|degrees| check_fov(place, *degrees)).transpose()?;
        let forward = DVec3::new(n[3], n[4], n[5]);
        if forward.try_normalize().is_none() {
            return Err(format!("{place}: the direction (fourth to sixth number) is zero"));
        }
        Ok(Self { eye: DVec3::new(n[0], n[1], n[2]), forward, fov_degrees })
    }
}

fn camera(arguments: &ViewArguments, objects: &[Object]) -> Result<Camera, Failure> {
    if let Some(text) = &arguments.camera {
        let place = format!("--camera {text}");
        let key = Key::parse(text, &place)?;
        if key.fov_degrees.is_some() && arguments.fov.is_some() {
            return Err(format!("{place}: has a field of view, and so has --fov; give only one of them").into());
        }
        return arguments.camera_of(&key, objects, &place);
    }
    let up = arguments.up()?;
    let fov = arguments.fov()?;
    let Some(name) = &arguments.scene else {
        return Ok(viewpoint::overview_of(objects, up.to_array(), fov.unwrap_or(DEFAULT_FOV), arguments.aspect()));
    };
    let manifest = scene::manifest(arguments.manifest.as_deref())?;
    let entry = scene::buildable(&manifest, name)?;
    let source = SceneSource::find(entry, arguments.scenes_dir.as_deref(), arguments.stand_in)?;
    if let Some(why) = source.absent() {
        return Err(format!("--scene {name}: {why}").into());
    }
    let views = source.views();
    if views.is_empty() {
        let what =
            "the manifest has no cameras for it; add `cameras` to the manifest, or give --camera instead of --scene";
        return Err(format!("--scene {name}: {what}").into());
    }
    let index = arguments.view.wrapping_sub(1);
    let view =
        views.get(index).ok_or_else(|| format!("--view {}: {name} has views 1 to {}", arguments.view, views.len()))?;
    if let Some(other) = source.other() {
        let what = "not the mesh that the manifest lists; the viewpoints are those of the listed one";
        complain("warning", &format!("--scene {name}: {other}: {what}"));
    }
    if source.is_replaced() {
        let why = source.missing();
        complain("warning", &format!("--scene {name}: this is a viewpoint of its stand-in: {why}"));
    }
    let mut camera = view.camera;
    camera.fov_degrees = fov.unwrap_or(camera.fov_degrees);
    Ok(camera)
}
