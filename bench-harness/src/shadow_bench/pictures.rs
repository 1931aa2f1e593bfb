//! Pictures in the order of the document that describes the technique.

use std::sync::Arc;

use esvo_builder::BuildSettings;
use esvo_builder::cells::{Cells, build_cells, morton};
use esvo_core::{Camera, Object, Picture};
use esvo_format::{Octree, join};
use esvo_shadow::effects::denoise::{Edges, smooth_shares};
use esvo_shadow::effects::occlusion::ambient_occlusion;
use esvo_shadow::effects::{
    Cone, Frame, How, Lamp, Obstacles, Offset, Query, Rays, Settings, Surface, Through, Wanted, compose,
};
use esvo_shadow::trace::{Fidelity, Ray, first_hit};
use esvo_shadow::{Grid, Occupancy, Pose, Volume, World};
use glam::{DMat4, DVec3, Vec3};

use super::PictureNote;
use super::models::{EDGE, Model, courtyard};
use super::stage::{Stage, failed, frame};
use crate::BenchError;
use crate::output::NamedPicture;
use crate::system::machine::slug;

/// Pictures that were made, and what they show.
pub(super) struct Pictures {
    size: (u32, u32),
    pub(super) made: Vec<NamedPicture>,
    pub(super) notes: Vec<PictureNote>,
}

/// A volume and a picture of what it is of.
struct Shown<'a> {
    name: &'a str,
    frame: &'a Frame,
    world: &'a World,
    /// Units in a metre.
    unit: f32,
    lamp: Lamp,
}

impl Pictures {
    /// None yet. They are larger than those of `size` that errors are measured in, for the eye: 800 x 520 for 320 x 240.
    pub(super) fn new(size: (u32, u32)) -> Self {
        let size = ((size.0 * 5 / 2).max(1), (size.1 * 13 / 6).max(1));
        Self { size, made: Vec::new(), notes: Vec::new() }
    }

    /// A scene of the manifest, from its first viewpoint, through voxels with this edge.
    pub(super) fn scene(&mut self, stage: &Stage, voxel_cm: f64) -> Result<(), BenchError> {
        let frame = stage.frame(self.size)?;
        let world = stage.world(voxel_cm, 2)?;
        let exact = stage.in_octree(stage.octree.objects()[0].levels);
        let lamp = stage.lamp(&frame, &exact, 0.0);
        let shown = Shown { name: &stage.scene.name, frame: &frame, world: &world, unit: stage.unit as f32, lamp };
        self.in_order(&shown);
        let frame = stage.frame_of_triangles(self.size)?;
        let shown = Shown { frame: &frame, ..shown };
        let wanted = Wanted { occlusion: true, shadows: true, fog: true, ..Wanted::default() };
        let settings = Settings { wanted, ..Settings::default() };
        let what = "surfaces from triangles, of materials without textures; ambient occlusion, shadows and fog through the same volume";
        self.put(&shown, "13-from-triangles", what, composed(&shown, 0.3, settings));
        self.levels(&shown);
        Ok(())
    }

    /// The large world, at half the size that is measured.
    pub(super) fn world(&mut self, frame: &Frame, light: &[Vec3]) {
        let what = "ten lamps, their fog, ambient occlusion and reflections";
        let (width, height) = (frame.eye.size.0 as usize, frame.eye.size.1 as usize);
        let size = ((width / 2).max(1) as u32, (height / 2).max(1) as u32);
        let pixel = |x: u32, y: u32| {
            let four = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| {
                light[(2 * y as usize + j).min(height - 1) * width + (2 * x as usize + i).min(width - 1)]
            });
            displayed(four.into_iter().sum::<Vec3>() * 0.25)
        };
        self.put_of("world", "all", what, Picture::from_fn(size, pixel));
    }

    /// A scene of voxel models, some of which move, before and after they have moved.
    pub(super) fn courtyard(&mut self) -> Result<(), BenchError> {
        let error = |e: &dyn ToString| failed("models", e.to_string());
        let models = courtyard();
        let grid = Grid { origin: DVec3::new(-0.51, -0.52, -0.53), voxel: 0.05 };
        let mut world = World::new(grid, [220, 224, 100], 2).map_err(|e| error(&e))?;
        let mut moving = Vec::new();
        for model in &models {
            if model.moves {
                moving.push((world.insert(model.shape()?, &model.pose).map_err(|e| error(&e))?, model.pose));
            } else {
                world.add_fixed(&model.shape()?, &model.pose).map_err(|e| error(&e))?;
            }
        }
        world.update(0);
        let octrees = models.iter().map(octree).collect::<Result<Vec<_>, _>>()?;
        let octree = Arc::new(join(&octrees.iter().collect::<Vec<_>>()).map_err(|e| error(&e))?);
        let cone = Cone { axis: Vec3::new(-0.35, 0.6, -0.72).normalize(), inner: 0.88, outer: 0.8 };
        let lamp = Lamp {
            position: Vec3::new(6.8, 0.6, 4.6),
            radius: 0.0,
            color: Vec3::splat(32.0),
            reach: f32::INFINITY,
            cone: Some(cone),
        };
        for (name, after) in [("courtyard", false), ("courtyard-moved", true)] {
            if after {
                let poses: Vec<_> = moving.iter().zip(1..).map(|((id, pose), i)| (*id, moved(pose, i))).collect();
                world.move_to(&poses).map_err(|e| error(&e))?;
                world.update(0);
            }
            let mut number = 0;
            let pose = |model: &Model| {
                number += i32::from(model.moves);
                if model.moves && after { moved(&model.pose, number) } else { model.pose }
            };
            let poses: Vec<Pose> = models.iter().map(pose).collect();
            let objects: Vec<Object> =
                poses.iter().enumerate().map(|(i, pose)| Object::of(&octree, i).placed(matrix(pose))).collect();
            let frame = frame(&octree, &objects, &camera(), self.size).map_err(|e| error(&e))?;
            let shown = Shown { name, frame: &frame, world: &world, unit: 1.0, lamp };
            if after {
                let wanted = Wanted { occlusion: true, shadows: true, reflections: true, fog: true, bounce: true };
                let settings = Settings { wanted, ..Settings::default() };
                self.put(&shown, "all", "all effects, after the things have moved", composed(&shown, 0.3, settings));
            } else {
                self.in_order(&shown);
                self.levels(&shown);
            }
        }
        Ok(())
    }

    fn put(&mut self, shown: &Shown, name: &str, what: &str, picture: Picture) {
        self.put_of(shown.name, name, what, picture);
    }

    fn put_of(&mut self, of: &str, name: &str, what: &str, picture: Picture) {
        let file = format!("{}-{name}.png", slug(of));
        self.notes.push(PictureNote { what: format!("{of}: {what}"), file: file.clone() });
        self.made.push(NamedPicture { name: file, picture });
    }

    fn in_order(&mut self, shown: &Shown) {
        let frame = shown.frame;
        let five = Rays { count: 5, seed: 1 };
        let reach = 5.0 * shown.unit;
        let open = |offset, screen| ambient_occlusion(frame, &shown.through(offset, screen), reach, five);
        self.put(shown, "1-no-occlusion", "no occlusion", ambient(shown, &vec![1.0; frame.surfaces.len()]));
        let what = "ambient occlusion, five rays from the surface itself";
        self.put(shown, "2-from-the-surface", what, ambient(shown, &open(Offset::NONE, false)));
        let half = Offset { share: 0.5, ..Offset::SAFE };
        let what = "ambient occlusion, five rays with half the offset";
        self.put(shown, "2-with-half-the-offset", what, ambient(shown, &open(half, false)));
        let what = "ambient occlusion, five rays with the offset";
        self.put(shown, "3-with-offset", what, ambient(shown, &open(Offset::SAFE, false)));
        let what = "ambient occlusion, five rays in the picture alone, for as far as the offset";
        let on_screen = ambient_occlusion(frame, &OnScreen(shown), reach, five);
        self.put(shown, "4-picture-alone", what, ambient(shown, &on_screen));
        let both = open(Offset::SAFE, true);
        let what = "ambient occlusion, five rays, first in the picture, then through the volume";
        self.put(shown, "5-both", what, ambient(shown, &both));
        self.put(shown, "6-smoothed", "the same, smoothed", ambient(shown, &smoothed(shown, &both, five.count)));
        let lit = Wanted { occlusion: true, shadows: true, ..Wanted::default() };
        let with = |wanted| Settings { wanted, ..Settings::default() };
        let mirrors = Wanted { reflections: true, ..lit };
        let all = Wanted { fog: true, bounce: true, ..mirrors };
        let sharp = Settings { roughness: 0.0, ..with(mirrors) };
        for (name, what, radius, settings) in [
            ("7-hard-shadow", "a lamp without a radius", 0.0, with(lit)),
            ("8-soft-shadow", "a lamp of 30 cm, 16 rays", 0.3, with(lit)),
            ("9-fog", "fog with shafts of light, 16 rays", 0.3, with(Wanted { fog: true, ..lit })),
            ("10-reflections", "surfaces that mirror, sharp", 0.3, sharp),
            ("11-blurred-reflections", "surfaces that mirror, blurred, 16 rays", 0.3, with(mirrors)),
            ("12-all", "all effects, and one bounce of light", 0.3, with(all)),
        ] {
            self.put(shown, name, what, composed(shown, radius, settings));
        }
    }

    /// The levels of the volume, as cubes.
    fn levels(&mut self, shown: &Shown) {
        for level in 0..=shown.world.volume().mips() + 1 {
            let what = format!("level {level} of the volume: cells of {} voxels", 1 << level);
            if let Some(picture) = cubes(shown, level) {
                self.put(shown, &format!("level-{level}"), &what, picture);
            }
        }
    }
}

impl<'a> Shown<'a> {
    fn through(&self, offset: Offset, screen: bool) -> Through<'a, Volume> {
        Through {
            volume: self.world.volume(),
            grid: *self.world.grid(),
            how: How::Walk(Fidelity::EXACT),
            offset,
            screen: screen.then_some(self.frame),
        }
    }
}

/// Rays that look at the picture for as far as the offset reaches, and at nothing then.
struct OnScreen<'a>(&'a Shown<'a>);

impl Obstacles for OnScreen<'_> {
    fn blocked(&self, queries: &[Query]) -> Vec<bool> {
        self.first(queries).iter().map(Option::is_some).collect()
    }

    fn first(&self, queries: &[Query]) -> Vec<Option<f32>> {
        let voxel = self.0.world.grid().voxel as f32;
        let first = |query: &Query| {
            let (along, above) = Offset::SAFE.of(query.normal, query.direction);
            let reach = ((along + above) * voxel).min(query.length);
            esvo_shadow::effects::screen::first(self.0.frame, query.from, query.direction, reach, 2.0 * voxel)
        };
        queries.iter().map(first).collect()
    }
}

fn smoothed(shown: &Shown, values: &[f32], rays: u32) -> Vec<f32> {
    let edges = Edges { passes: 3, distance: shown.world.grid().voxel as f32, cosine: 0.9 };
    let noisy: Vec<[f32; 1]> = values.iter().map(|&value| [value]).collect();
    smooth_shares(shown.frame, &noisy, rays, &edges).iter().map(|value| value[0]).collect()
}

/// A picture in the light from all around alone, of which each surface gets a share.
fn ambient(shown: &Shown, open: &[f32]) -> Picture {
    let settings = Settings::default();
    let pixel = |(surface, open): (&Option<Surface>, &f32)| {
        surface.as_ref().map_or(settings.sky, |surface| surface.color * (settings.ambient * open))
    };
    to_picture(shown.frame, &shown.frame.surfaces.iter().zip(open).map(pixel).collect::<Vec<_>>())
}

fn to_picture(frame: &Frame, light: &[Vec3]) -> Picture {
    Picture::from_fn(frame.eye.size, |x, y| displayed(light[(y * frame.eye.size.0 + x) as usize]))
}

/// Linear light as sRGB.
fn displayed(light: Vec3) -> [f32; 3] {
    light.to_array().map(|x| esvo_format::srgb::encode(x.clamp(0.0, 1.0)))
}

/// A picture with these effects and a lamp of this radius in metres.
fn composed(shown: &Shown, radius: f32, settings: Settings) -> Picture {
    let settings = Settings { metre: shown.unit, ..settings };
    let lamp = Lamp { radius: radius * shown.unit, ..shown.lamp };
    to_picture(shown.frame, &compose(shown.frame, shown.world.volume(), *shown.world.grid(), &[lamp], &settings).light)
}

/// Cells of a level that have a voxel, as cubes, seen from the picture's eye.
fn cubes(shown: &Shown, level: u32) -> Option<Picture> {
    let volume = shown.world.volume();
    let eye = &shown.frame.eye;
    let size = volume.voxels().map(|n| n.div_ceil(1 << level));
    let mut coarse = Volume::new(size, 2).ok()?;
    let [width, height, depth] = size.map(|n| n as i32);
    let cells = (0..depth).flat_map(|z| (0..height).flat_map(move |y| (0..width).map(move |x| [x, y, z])));
    coarse.set(cells.filter(|cell| volume.occupied(level, *cell)));
    let scale = f64::from(1u32 << level);
    let from = shown.world.grid().to_voxels(eye.position.as_dvec3()) / scale;
    Some(Picture::from_fn_on_all_cores(eye.size, |x, y| {
        let direction = eye.direction(glam::Vec2::new(x as f32 + 0.5, y as f32 + 0.5)).as_dvec3().normalize();
        let hit = Ray::new(from, direction, 8000.0 / scale)
            .ok()
            .and_then(|ray| first_hit(&coarse, &ray, Fidelity::EXACT).hit);
        let Some(hit) = hit else { return [0.96, 0.97, 1.0] };
        // The face that the point lies on, and how near it is to an edge of the cube.
        let at = from + direction * f64::from(hit.distance) - DVec3::from(hit.cell.map(f64::from));
        let border = (0.5 - (at - 0.5).abs()).to_array();
        let face = (0..3).min_by(|a, b| border[*a].total_cmp(&border[*b])).unwrap_or(0);
        let edge = (0..3).filter(|axis| *axis != face).map(|axis| border[axis]).fold(1.0, f64::min);
        let far = (f64::from(hit.distance) * scale * shown.world.grid().voxel / f64::from(shown.unit)).min(40.0) as f32;
        let light = [0.80, 0.66, 0.97][face] * if edge < 0.06 { 0.75 } else { 1.0 } * (1.0 - far / 90.0);
        [0.80 * light, 0.84 * light, 0.90 * light]
    }))
}

fn camera() -> Camera {
    let (eye, target) = (DVec3::new(9.3, -2.2, 4.3), DVec3::new(4.3, 5.2, 0.7));
    Camera {
        eye: eye.to_array(),
        forward: (target - eye).to_array(),
        up: [0.0, 0.0, 1.0],
        fov_degrees: 52.0,
        near: 0.1,
        far: 60.0,
    }
}

/// Where the `i`th thing that moves has gone.
fn moved(pose: &Pose, i: i32) -> Pose {
    let a = f64::from(i);
    let turn = glam::DQuat::from_rotation_z(1.1 + a) * glam::DQuat::from_rotation_x(0.7);
    Pose {
        rotation: turn * pose.rotation,
        position: pose.position + DVec3::new(0.5 * (a * 2.0).sin(), 1.2 + 0.3 * a.cos(), 0.15),
    }
}

fn matrix(pose: &Pose) -> DMat4 {
    DMat4::from_rotation_translation(pose.rotation, pose.position)
}

/// A model as an octree of cubes.
fn octree(model: &Model) -> Result<Octree, BenchError> {
    let low: [i32; 3] = std::array::from_fn(|axis| model.cubes.iter().map(|cube| cube[axis]).min().unwrap_or(0));
    let most = model.cubes.iter().flat_map(|cube| (0..3).map(move |axis| cube[axis] - low[axis])).max().unwrap_or(0);
    let levels = (u32::BITS - most.unsigned_abs().leading_zeros()).max(1);
    let code = |cube: &[i32; 3]| morton(std::array::from_fn(|axis| (cube[axis] - low[axis]) as u32));
    let mut codes: Vec<u64> = model.cubes.iter().map(code).collect();
    codes.sort_unstable();
    let colors = vec![model.color; codes.len()];
    let cells = Cells { levels, codes, colors, normals: Vec::new() };
    let scale = EDGE * f64::from(1u32 << levels);
    let place = DVec3::from(low.map(f64::from)) * EDGE;
    let octree_to_mesh = DMat4::from_translation(place) * DMat4::from_scale(DVec3::splat(scale));
    let built = build_cells(&cells, octree_to_mesh, &BuildSettings::default()).map_err(|e| failed("models", e))?;
    Ok(built.octree)
}
