//! The device's copy of a volume while objects move: it has the processor's bytes after each update, and a part that was not sent is noticed.

mod gpu_common;

use std::time::{Duration, Instant};

use esvo_device::{Gpu, wgpu};
use esvo_shadow::gpu::{GpuVolume, Tracer, texture_size};
use esvo_shadow::trace::{Fidelity, Ray, Traced, first_hit};
use esvo_shadow::{Cubes, Extent, Grid, Mesh, ObjectId, Pose, Rule, Shape, Volume, World};
use glam::{DQuat, DVec3};
use gpu_common::{Random, difference, gpu};

/// A box with its faces outwards.
fn cuboid(size: DVec3) -> Mesh {
    let corner = |i: u32| DVec3::from_array([0, 1, 2].map(|axis| f64::from(i >> axis & 1) - 0.5)) * size;
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh::solid((0..8).map(corner).collect(), triangles).unwrap()
}

/// A model of cubes, of which some are missing.
fn model(rule: Rule) -> Shape {
    let cubes = (0..9 * 5 * 4).map(|i| [i % 9, i / 9 % 5, i / 45]).filter(|[x, y, z]| (x * 7 + y * 5 + z * 3) % 5 > 0);
    Shape::Cubes(Cubes::new(cubes, 0.13, rule).unwrap())
}

/// An object on its way.
struct Moving {
    id: ObjectId,
    shape: Shape,
    pose: Pose,
    way: DVec3,
    axis: DVec3,
}

/// A world of a floor, walls, and objects that move between and through them.
struct Scene {
    world: World,
    fixed: Vec<(Shape, Pose)>,
    objects: Vec<Moving>,
    random: Random,
    size: DVec3,
}

impl Scene {
    fn new(voxels: [u32; 3], mips: u32, objects: u32, seed: u64) -> Self {
        let grid = Grid { origin: DVec3::new(-3.0, 1.0, 0.5), voxel: 0.1 };
        let size = DVec3::from(voxels.map(f64::from)) * grid.voxel;
        let middle = grid.origin + size * 0.5;
        let at = |x: f64, y: f64, z: f64| Pose { position: middle + DVec3::new(x, y, z) * size, ..Pose::IDENTITY };
        let fixed = vec![
            (Shape::Mesh(cuboid(size * DVec3::new(1.2, 1.2, 0.05))), at(0.0, 0.0, -0.5)),
            (Shape::Mesh(cuboid(DVec3::new(0.25, size.y * 0.6, size.z))), at(0.2, -0.1, 0.0)),
            (Shape::Mesh(cuboid(DVec3::new(size.x * 0.5, 0.3, size.z * 0.5))), at(-0.2, 0.3, 0.0)),
        ];
        let mut world = World::new(grid, voxels, mips).unwrap();
        for (shape, pose) in &fixed {
            world.add_fixed(shape, pose).unwrap();
        }
        let mut scene = Self { world, fixed, objects: Vec::new(), random: Random(seed), size };
        for i in 0..objects {
            let shape = match i % 4 {
                0 => model(Rule::Middle),
                1 => model(Rule::Touch),
                2 => Shape::Mesh(cuboid(DVec3::new(0.5, 1.1, 0.7))),
                _ => Shape::Mesh(cuboid(DVec3::new(1.9, 0.3, 0.4))),
            };
            let pose = scene.pose();
            let id = scene.world.insert(shape.clone(), &pose).unwrap();
            let way = scene.vector() * 0.15;
            let axis = scene.vector().normalize();
            scene.objects.push(Moving { id, shape, pose, way, axis });
        }
        scene
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| self.random.unit() - 0.5))
    }

    /// Somewhere in the world or just outside of it, turned.
    fn pose(&mut self) -> Pose {
        let grid = *self.world.grid();
        let position = grid.origin + self.size * 0.5 + self.vector() * (self.size + 2.0);
        let axis = self.vector().normalize();
        Pose { rotation: DQuat::from_axis_angle(axis, 6.0 * self.random.unit()), position }
    }

    /// Moves objects on, all or some; now and then one jumps.
    fn advance(&mut self, some: bool) {
        let mut poses = Vec::new();
        for i in 0..self.objects.len() {
            if some && self.random.below(3) > 0 {
                continue;
            }
            let jump = self.random.below(40) == 0;
            let anew = self.pose();
            let (middle, reach) = (self.world.grid().origin + self.size * 0.5, self.size * 0.5 + 1.0);
            let object = &mut self.objects[i];
            let turn = DQuat::from_axis_angle(object.axis, 0.07);
            let from = object.pose;
            object.pose = Pose { rotation: (turn * from.rotation).normalize(), position: from.position + object.way };
            for axis in 0..3 {
                let off = object.pose.position[axis] - middle[axis];
                if off.abs() > reach[axis] {
                    object.way[axis] = -off.signum() * object.way[axis].abs();
                }
            }
            if jump {
                object.pose = anew;
            }
            poses.push((object.id, object.pose));
        }
        self.world.move_to(&poses).unwrap();
    }

    /// The union of all shapes, voxel by voxel, from nothing.
    fn made_anew(&self) -> Volume {
        let mut volume = Volume::new(self.world.volume().voxels(), self.world.volume().mips()).unwrap();
        let objects = self.objects.iter().map(|object| (&object.shape, &object.pose));
        for (shape, pose) in self.fixed.iter().map(|(shape, pose)| (shape, pose)).chain(objects) {
            let stamp = shape.voxels(pose, self.world.grid()).unwrap();
            for (cell, byte) in stamp.cells() {
                let bits = (0..8).filter(|bit| byte >> bit & 1 == 1);
                volume.set(bits.map(|bit| std::array::from_fn(|axis| 2 * cell[axis] + (bit >> axis & 1))));
            }
        }
        volume
    }

    /// Rays from anywhere to anywhere.
    fn rays(&mut self, count: usize) -> Vec<Ray> {
        let voxels = DVec3::from(self.world.volume().voxels().map(f64::from));
        let mut place = || (self.vector() + 0.5) * voxels;
        (0..count).map(|_| Ray::between(place(), place()).unwrap()).collect()
    }
}

fn traced(volume: &Volume, rays: &[Ray]) -> Vec<Traced> {
    rays.iter().map(|ray| first_hit(volume, ray, Fidelity::EXACT)).collect()
}

/// Frames of a scene of 200 objects that all move. Every tenth frame: the volume is what it is if made from nothing, the device has the same bytes, and rays
/// meet the same on both.
fn run_frames(gpu: &Gpu, frames: u32) {
    let mut scene = Scene::new([203, 190, 61], 2, 200, 1);
    scene.world.update(0);
    let mut copy = GpuVolume::new(gpu, scene.world.volume()).unwrap();
    let tracer = Tracer::new(gpu).unwrap();
    let (mut update, mut send, mut bytes, mut writes) = (Duration::ZERO, Duration::ZERO, 0, 0);
    for frame in 1..=frames {
        scene.advance(false);
        let start = Instant::now();
        let regions = scene.world.update(500).regions;
        update += start.elapsed();
        let start = Instant::now();
        let sent = copy.update(gpu, scene.world.volume(), &regions).unwrap();
        gpu.run(|_| ()).unwrap();
        send += start.elapsed();
        (bytes, writes) = (bytes + sent.bytes, writes + sent.writes);
        if frame % 10 == 0 {
            assert!(*scene.world.volume() == scene.made_anew(), "frame {frame}");
            assert_eq!(difference(gpu, &copy, scene.world.volume()), None, "frame {frame}");
            let rays = scene.rays(1000);
            let expected = traced(scene.world.volume(), &rays);
            assert!(tracer.trace(gpu, &copy, &rays, Fidelity::EXACT).unwrap().rays == expected, "frame {frame}");
        }
    }
    println!(
        "{frames} frames of 200 objects: {:.2} ms to update and {:.2} ms to send {} bytes in {} writes, each",
        update.as_secs_f64() * 1000.0 / f64::from(frames),
        send.as_secs_f64() * 1000.0 / f64::from(frames),
        bytes / u64::from(frames),
        writes / frames
    );
}

#[test]
fn a_scene_of_moving_objects_stays_exact() {
    let Some(gpu) = gpu() else { return };
    run_frames(gpu, 60);
}

/// The same, five times as long.
#[test]
#[ignore = "takes a minute"]
fn a_scene_of_moving_objects_stays_exact_for_300_frames() {
    let Some(gpu) = gpu() else { return };
    run_frames(gpu, 300);
}

/// Random moves of some objects, regions merged little or much, mips from none to five.
#[test]
fn the_device_has_the_bytes_after_any_moves() {
    let Some(gpu) = gpu() else { return };
    for mips in 0..=5 {
        let mut scene = Scene::new([45 + 3 * mips, 38, 31 + mips], mips, 6, u64::from(mips) + 20);
        let mut copy = GpuVolume::new(gpu, scene.world.volume()).unwrap();
        for frame in 0..15 {
            let regions = scene.world.update([0, 100, 5000][frame % 3]).regions;
            let sent = copy.update(gpu, scene.world.volume(), &regions).unwrap();
            assert_eq!(sent.writes, regions.len() as u32 * (mips + 1));
            assert_eq!(difference(gpu, &copy, scene.world.volume()), None, "{mips} mips, frame {frame}");
            scene.advance(frame % 2 == 0);
        }
    }
}

/// Regions of all shapes: thin, flat, of one cell, whole, outside. The device gets them and nothing else.
#[test]
fn regions_of_any_shape_are_sent() {
    let Some(gpu) = gpu() else { return };
    let random = &mut Random(4);
    for (voxels, mips) in [([37, 50, 23], 3), ([512, 6, 40], 1), ([1, 1, 1], 5), ([64, 64, 64], 0)] {
        let mut volume = Volume::new(voxels, mips).unwrap();
        volume.set((0..2000).map(|_| voxels.map(|n| random.below(n))));
        let mut copy = GpuVolume::new(gpu, &volume).unwrap();
        let cells = volume.extent().high;
        for _ in 0..40 {
            let mut region = Extent { low: [0; 3], high: [0; 3] };
            for axis in 0..3 {
                let whole = random.below(3) == 0;
                let low = if whole { 0 } else { random.between(-2, cells[axis]) };
                let size = if whole { cells[axis] } else { random.between(0, 6) };
                (region.low[axis], region.high[axis]) = (low, low + size);
            }
            volume.rewrite(&region, |_, row| row.iter_mut().for_each(|byte| *byte = random.below(256) as u8));
            let sent = copy.update(gpu, &volume, &[region]).unwrap();
            let part = region.intersection(&volume.extent());
            let levels = std::iter::successors(Some(part), |part| Some(part.parents()));
            let bytes = levels.take(mips as usize + 1).map(|part| part.cells()).sum();
            let is_empty = part.is_empty();
            assert_eq!((sent.bytes, sent.writes), if is_empty { (0, 0) } else { (bytes, mips + 1) }, "{region:?}");
            assert_eq!(difference(gpu, &copy, &volume), None, "{region:?} of {voxels:?}");
        }
    }
}

/// A volume of more bytes than are sent or read at once.
#[test]
fn large_volumes_are_sent_in_pieces() {
    let Some(gpu) = gpu() else { return };
    let voxels = [901, 900, 803];
    let mut volume = Volume::new(voxels, 2).unwrap();
    let random = &mut Random(2);
    volume.set((0..500_000).map(|_| voxels.map(|n| random.below(n))));
    assert!(volume.level(0).1.len() > 64 << 20);
    let copy = GpuVolume::new(gpu, &volume).unwrap();
    assert_eq!(difference(gpu, &copy, &volume), None);
}

/// Negative controls: one region of an update is left out, or the device's mips stay as they were.
#[test]
fn what_was_not_sent_is_noticed() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new([120, 100, 60], 3, 12, 8);
    scene.world.update(0);
    let before = scene.world.volume().clone();
    scene.advance(false);
    let regions = scene.world.update(0).regions;
    let now = scene.world.volume();
    assert!(regions.len() > 1);

    let mut copy = GpuVolume::new(gpu, &before).unwrap();
    assert!(difference(gpu, &copy, now).is_some());
    copy.update(gpu, now, &regions[1..]).unwrap();
    assert!(difference(gpu, &copy, now).is_some(), "a region was left out");
    copy.update(gpu, now, &regions[..1]).unwrap();
    assert_eq!(difference(gpu, &copy, now), None);

    // The base as it is, a mip as it was.
    let rays = scene.rays(20_000);
    let now = scene.world.volume();
    let tracer = Tracer::new(gpu).unwrap();
    let expected = traced(now, &rays);
    for mip in 1..=3 {
        let (size, bytes) = before.level(mip);
        let [width, height, depth_or_array_layers] = size.map(|n| n as u32);
        let to = wgpu::TexelCopyTextureInfo {
            texture: copy.texture(),
            mip_level: mip,
            origin: wgpu::Origin3d::ZERO,
            aspect: wgpu::TextureAspect::All,
        };
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width), rows_per_image: Some(height) };
        let size = wgpu::Extent3d { width, height, depth_or_array_layers };
        gpu.checked(|_| gpu.queue().write_texture(to, bytes, layout, size)).unwrap();
        let found = difference(gpu, &copy, now);
        assert!(found.as_ref().is_some_and(|found| found.starts_with(&format!("mip {mip}"))), "{found:?}");
        assert!(tracer.trace(gpu, &copy, &rays, Fidelity::EXACT).unwrap().rays != expected, "mip {mip}");
        copy.update(gpu, now, &regions).unwrap();
        assert!(tracer.trace(gpu, &copy, &rays, Fidelity::EXACT).unwrap().rays == expected);
    }
}

/// A volume that the device has no texture for, an update from another volume, and a mip that is not there are errors; the copy stays as it was.
#[test]
fn what_does_not_fit_is_refused() {
    let Some(own) = gpu() else { return };
    let volume = Volume::new([4099, 3, 3], 1).unwrap();
    assert_eq!(texture_size([4099, 3, 3], 1), [2050, 2, 2]);
    // A device with the limits that every device has.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).unwrap();
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
    let error = GpuVolume::new(&Gpu::from_device(device, queue), &volume).unwrap_err().to_string();
    assert!(error.contains("2050 x 2 x 2") && error.contains("2048 along an axis"), "{error}");

    let mut volume = Volume::new([40, 30, 20], 1).unwrap();
    volume.set([[7, 8, 9]]);
    let mut copy = GpuVolume::new(own, &volume).unwrap();
    assert_eq!((copy.voxels(), copy.mips(), copy.bytes()), ([40, 30, 20], 1, 20 * 16 * 10 + 10 * 8 * 5));
    for other in [Volume::new([40, 30, 21], 1).unwrap(), Volume::new([40, 30, 20], 2).unwrap()] {
        let error = copy.update(own, &other, &[other.extent()]).unwrap_err().to_string();
        assert!(error.contains("make a new copy"), "{error}");
    }
    assert!(copy.read_level(own, 2).is_err());
    assert_eq!(difference(own, &copy, &volume), None);
}
