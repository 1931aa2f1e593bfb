//! A large world, and objects that move in it.

use std::time::Instant;

use esvo_shadow::{Cubes, Extent, Grid, Mesh, ObjectId, Pose, Rule, Shape, Volume, World};
use glam::{DQuat, DVec3, EulerRot};

use super::device::Device;
use super::stage::failed;
use super::{MovingRow, WorldRow};
use crate::{BenchError, Progress};

const GRID: Grid = Grid { origin: DVec3::ZERO, voxel: 0.05 };
const MIPS: u32 = 2;
/// What a region costs beside its bytes, in base cells. A write of a region costs a driver some microseconds, in which it copies as many bytes.
pub(super) const REGION_CELLS: u64 = 1 << 14;

/// A world of hills and houses.
pub(super) fn large_world(voxels: [u32; 3], progress: &Progress) -> Result<(World, WorldRow), BenchError> {
    let error = |e: esvo_shadow::ShadowError| failed("world", e);
    progress.say(format!("a world of {} x {} x {} voxels", voxels[0], voxels[1], voxels[2]));
    let mut world = World::new(GRID, voxels, MIPS).map_err(error)?;
    let start = Instant::now();
    let size = DVec3::from(voxels.map(f64::from)) * GRID.voxel;
    world.add_fixed(&ground(size), &Pose::IDENTITY).map_err(error)?;
    let house = house();
    let across = (size.x / 12.0).floor().max(1.0) as u32;
    for i in 0..across * (size.y / 12.0).floor().max(1.0) as u32 {
        let (x, y) = (f64::from(i % across) * 12.0 + 6.0, f64::from(i / across) * 12.0 + 6.0);
        let pose =
            Pose { rotation: DQuat::from_rotation_z(f64::from(i) * 0.7), position: DVec3::new(x, y, height(x, y)) };
        world.add_fixed(&house, &pose).map_err(error)?;
    }
    let fill_seconds = start.elapsed().as_secs_f64();
    let start = Instant::now();
    world.update(0);
    let update_seconds = start.elapsed().as_secs_f64();
    let (_, bytes) = world.volume().level(0);
    let row = WorldRow {
        voxels,
        mips: MIPS,
        bytes: world.volume().bytes(),
        set: bytes.iter().map(|byte| u64::from(byte.count_ones())).sum(),
        brick_bytes: world.fixed().bytes(),
        fill_seconds,
        update_seconds,
        peak_bytes: crate::system::peak_bytes(),
    };
    Ok((world, row))
}

/// How high the ground is, in metres.
pub(super) fn height(x: f64, y: f64) -> f64 {
    4.0 + 1.6 * (x * 0.11).sin() * (y * 0.07).cos() + 0.5 * (x * 0.31 + y * 0.23).sin()
}

/// A sheet of triangles, half a metre each.
fn ground(size: DVec3) -> Shape {
    let (width, depth) = ((size.x * 2.0).ceil() as u32, (size.y * 2.0).ceil() as u32);
    let corner = |i: u32| {
        let (x, y) = (f64::from(i % (width + 1)) * 0.5, f64::from(i / (width + 1)) * 0.5);
        DVec3::new(x, y, height(x, y))
    };
    let quad = |i: u32| {
        let (x, y) = (i % width, i / width);
        let a = y * (width + 1) + x;
        [[a, a + 1, a + width + 2], [a, a + width + 2, a + width + 1]]
    };
    let corners = (0..(width + 1) * (depth + 1)).map(corner).collect();
    Shape::Mesh(
        Mesh::surface(corners, (0..width * depth).flat_map(quad).collect()).expect("indices are those of the corners"),
    )
}

/// A hut of cubes of 20 cm with a door and windows, 6 m wide.
fn house() -> Shape {
    let inside = |x: i32, y: i32, z: i32| {
        let wall = x == 0 || y == 0 || x == 29 || y == 23;
        let open = z > 3 && z < 9 && (x % 9 > 3 && x % 9 < 7 || y % 8 > 2 && y % 8 < 5)
            || y == 0 && z < 10 && (13..17).contains(&x);
        let roof = z >= 14 && (z - 14 - (x.min(29 - x)) / 2).abs() < 1;
        z < 14 && wall && !open || roof || z == 0
    };
    let cubes = (0..30 * 24 * 24).map(|i| [i % 30, i / 30 % 24, i / 720]).filter(|&[x, y, z]| inside(x, y, z));
    Shape::Cubes(Cubes::new(cubes, 0.2, Rule::Middle).expect("the cubes are near"))
}

/// Objects of several sizes that move in the world, a number of pictures each. Where `check` says so, the volume is compared at the end with one made from nothing.
pub(super) fn moving(
    world: &mut World,
    device: Option<&Device>,
    progress: &Progress,
) -> Result<Vec<MovingRow>, BenchError> {
    let sizes = [(200, 8, 300), (200, 16, 100), (50, 32, 60), (10, 64, 40), (4, 128, 20), (1, 256, 10)];
    let room = world.volume().voxels().iter().copied().min().unwrap_or(0);
    // A small world is for a trial, and is done in few pictures.
    let voxels: u64 = world.volume().voxels().iter().map(|&n| u64::from(n)).product();
    let most = (voxels >> 20).clamp(4, 1000) as u32;
    let fits = sizes.into_iter().filter(|(_, edge, _)| 2 * edge <= room);
    fits.map(|(objects, edge, frames)| {
        progress.say(format!("{objects} objects of {edge} voxels move"));
        move_objects(world, device, objects, edge, frames.min(most))
    })
    .collect()
}

fn move_objects(
    world: &mut World,
    device: Option<&Device>,
    objects: u32,
    edge: u32,
    frames: u32,
) -> Result<MovingRow, BenchError> {
    let error = |e: esvo_shadow::ShadowError| failed("moving", e);
    let size = DVec3::from(world.volume().voxels().map(f64::from)) * GRID.voxel;
    // Cubes of a voxel's size; a turned box fills a box 1.7 times as wide.
    let cubes = (f64::from(edge) / 1.75).round().max(1.0) as i32;
    let ball = |c: [i32; 3]| c.iter().map(|&x| (2 * x + 1 - cubes).pow(2)).sum::<i32>() <= 3 * cubes * cubes / 2;
    let all = (0..cubes.pow(3)).map(|i| [i % cubes, i / cubes % cubes, i / cubes / cubes]).filter(|c| ball(*c));
    let shape = Shape::Cubes(Cubes::new(all, GRID.voxel, Rule::Touch).map_err(error)?);
    let pose = |i: u32, frame: u32| {
        let (a, t) = (f64::from(i) * 2.399, f64::from(frame));
        // In groups, as things fall over together.
        let group = f64::from(i / 10);
        let middle = DVec3::new(0.5 + 0.4 * (group * 1.7).sin(), 0.5 + 0.4 * (group * 2.9).cos(), 0.0) * size;
        let spread = f64::from(edge) * GRID.voxel * 2.0;
        let offset = DVec3::new(a.cos(), a.sin(), 0.0) * spread * (f64::from(i % 10) / 10.0).sqrt();
        let z = height(middle.x, middle.y) + 0.6 + 0.2 * (t * 0.2 + a).sin();
        Pose {
            rotation: DQuat::from_euler(EulerRot::XYZ, a + 0.05 * t, 0.03 * t, 0.02 * t * a.cos()),
            position: DVec3::new(middle.x, middle.y, z) + offset + DVec3::new(0.03, 0.02, 0.0) * t,
        }
    };
    let ids: Vec<ObjectId> =
        (0..objects).map(|i| world.insert(shape.clone(), &pose(i, 0)).map_err(error)).collect::<Result<_, _>>()?;
    world.update(0);
    let mut row = MovingRow {
        objects,
        edge,
        frames,
        rasterize_ms: 0.0,
        update_ms: 0.0,
        cells: 0.0,
        regions: 0.0,
        region_bytes: 0.0,
        send_ms: device.map(|_| 0.0),
        single_send_ms: device.map(|_| 0.0),
        single_regions: 0.0,
        single_bytes: 0.0,
        as_if_from_nothing: true,
    };
    let mut copy = device.map(|device| device.copy(world.volume())).transpose()?;
    let share = 1.0 / f64::from(frames);
    let bytes = |extents: &[Extent]| extents.iter().map(region_bytes).sum::<u64>() as f64 * share;
    for frame in 1..=frames {
        let poses: Vec<(ObjectId, Pose)> = (0..).zip(&ids).map(|(i, id)| (*id, pose(i, frame))).collect();
        let start = Instant::now();
        world.move_to(&poses).map_err(error)?;
        row.rasterize_ms += start.elapsed().as_secs_f64() * 1e3 * share;
        let single = world.pending().to_vec();
        row.single_regions += single.len() as f64 * share;
        row.single_bytes += bytes(&single);
        let start = Instant::now();
        let changes = world.update(REGION_CELLS);
        row.update_ms += start.elapsed().as_secs_f64() * 1e3 * share;
        row.cells += changes.cells as f64 * share;
        row.regions += changes.regions.len() as f64 * share;
        row.region_bytes += bytes(&changes.regions);
        if let (Some(device), Some(copy)) = (device, &mut copy)
            && frame <= device.pictures()
        {
            let whole = world.volume().extent();
            let single: Vec<Extent> = single.iter().map(|extent| extent.intersection(&whole)).collect();
            for (sum, regions) in [(&mut row.send_ms, &changes.regions), (&mut row.single_send_ms, &single)] {
                let ms = device.send(copy, world.volume(), regions)?;
                *sum = sum.map(|sum| sum + ms / f64::from(frames.min(device.pictures())));
            }
        }
    }
    let last: Vec<Pose> = (0..objects).map(|i| pose(i, frames)).collect();
    row.as_if_from_nothing = *world.volume() == from_nothing(world, &shape, &last).map_err(error)?;
    for id in ids {
        world.remove(id).map_err(error)?;
    }
    world.update(0);
    Ok(row)
}

/// Bytes of a region in the base level and the mips.
fn region_bytes(extent: &Extent) -> u64 {
    let mips = (0..MIPS).scan(*extent, |part, _| {
        *part = part.parents();
        Some(part.cells())
    });
    extent.cells() + mips.sum::<u64>()
}

/// The volume of what is fixed and of a shape in several poses, voxel by voxel.
fn from_nothing(world: &World, shape: &Shape, poses: &[Pose]) -> Result<Volume, esvo_shadow::ShadowError> {
    let mut volume = Volume::new(world.volume().voxels(), MIPS)?;
    let voxels = |(cell, byte): ([i32; 3], u8)| {
        (0..8)
            .filter(move |bit| byte & 1 << bit != 0)
            .map(move |bit| std::array::from_fn(|axis| 2 * cell[axis] + (bit >> axis & 1)))
    };
    volume.set(world.fixed().cells().flat_map(voxels));
    for pose in poses {
        volume.set(shape.voxels(pose, world.grid())?.cells().flat_map(voxels));
    }
    Ok(volume)
}
