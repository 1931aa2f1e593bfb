//! The pieces that are measured: each is work that can be repeated, and says how many units of it there were.

use std::hint::black_box;
use std::sync::Arc;

use esvo_builder::{BuildSettings, Mesh, build};
use esvo_core::camera::viewpoint;
use esvo_core::reference::{self, ReferenceCaster};
use esvo_core::{Camera, CastOptions, Caster, Hit, Object, View};
use esvo_cpu::{CpuCaster, InstructionSet};
use esvo_format::{ColorBlock, Contour, NormalBlock, Octree};
use glam::{DVec3, Vec3};

pub(crate) type Error = Box<dyn std::error::Error>;

/// A piece of work.
pub(crate) struct Piece {
    pub(crate) name: String,
    /// What [`work`](Self::work) counts.
    pub(crate) unit: &'static str,
    /// Does the work once, and returns the number of its units.
    pub(crate) work: Box<dyn FnMut() -> u64>,
}

/// Levels of the octree that is cast.
const LEVELS: u32 = 7;
/// Levels of the two octrees whose times differ by the pushes of one packet.
const CHAINS: [u32; 2] = [8, 16];
/// Packets that are cast in a row, so that a thread that wakes up does not count.
const PACKETS: u64 = 1000;
/// Contours, colours and normals that are decoded and encoded in a row.
const ROW: usize = 4096;

/// All pieces.
///
/// # Errors
/// An octree that cannot be built.
pub(crate) fn pieces() -> Result<Vec<Piece>, Error> {
    let mesh = esvo_scenes::generate::bumpy_sphere_on_plane();
    let settings = BuildSettings { levels: LEVELS, ..BuildSettings::default() };
    let octree = Arc::new(build(&mesh, &settings, &|_| ())?.octree);
    let camera = viewpoint::overview(&octree, [0.0, 1.0, 0.0], 50.0, 4.0 / 3.0);
    let view = Object::of(&octree, 0).view(&camera, (96, 64), &CastOptions::default())?;
    let mut hits = Vec::new();
    reference::cast_fine(&octree, &view, &[], &mut hits);

    let mut pieces = attributes(&octree, hits);
    pieces.push(traversal("reference caster", Box::new(ReferenceCaster::default()), &octree, view)?);
    for set in InstructionSet::available() {
        let caster = CpuCaster::with_instructions(Some(1), set)?;
        pieces.push(traversal(&format!("{} caster", set.name()), Box::new(caster), &octree, view)?);
    }
    for levels in CHAINS {
        pieces.push(packet(levels)?);
    }
    Ok(pieces)
}

fn piece(name: &str, unit: &'static str, work: impl FnMut() -> u64 + 'static) -> Piece {
    Piece { name: name.into(), unit, work: Box::new(work) }
}

/// What reads and writes the values of voxels.
fn attributes(octree: &Arc<Octree>, hits: Vec<Hit>) -> Vec<Piece> {
    let hits: Vec<_> = hits.into_iter().filter(|hit| !hit.is_miss()).collect();
    let count = hits.len() as u64;
    let of = |octree: &Arc<Octree>| (octree.clone(), hits.clone());
    let contours: Vec<Contour> =
        hits.iter().filter_map(|hit| octree.contour(hit.slot, hit.child())).cycle().take(ROW).collect();
    let colors: Vec<_> =
        (0..ROW / 16).map(|k| std::array::from_fn(|j| Some([3, 5, 7].map(|c| (k * 11 + j * c) as u8)))).collect();
    let normals: Vec<_> = (0..ROW / 16).map(|k| std::array::from_fn(|j| Some(direction(k, j)))).collect();

    let (tree, at) = of(octree);
    let first = piece("find the first child", "descriptor", move || {
        at.iter().for_each(|hit| _ = black_box(tree.child(hit.slot, hit.child())));
        count
    });
    let words = contours.clone();
    let decode = piece("decode a contour", "contour", move || {
        words.iter().for_each(|contour| _ = black_box(contour.decode()));
        words.len() as u64
    });
    let encode = piece("encode a contour", "contour", move || {
        for contour in &contours {
            let slab = contour.decode();
            let bits = Contour::encode_normal(slab.normal).unwrap_or_default();
            _ = black_box(Contour::encode_bounds(bits, slab.lo(), slab.hi()));
        }
        contours.len() as u64
    });
    let (tree, at) = of(octree);
    let color = piece("decode a colour", "colour", move || {
        at.iter().for_each(|hit| _ = black_box(tree.color(hit.slot, hit.child())));
        count
    });
    let (tree, at) = of(octree);
    let normal = piece("decode a normal", "normal", move || {
        at.iter().for_each(|hit| _ = black_box(tree.normal(hit.slot, hit.child())));
        count
    });
    let encode_colors = piece("encode colours", "block of 16", move || {
        colors.iter().for_each(|block| _ = black_box(ColorBlock::encode(block)));
        colors.len() as u64
    });
    let encode_normals = piece("encode normals", "block of 16", move || {
        normals.iter().for_each(|block| _ = black_box(NormalBlock::encode(block)));
        normals.len() as u64
    });
    vec![first, decode, encode, color, normal, encode_colors, encode_normals]
}

/// A direction that changes within a block.
fn direction(block: usize, voxel: usize) -> Vec3 {
    let angle = (block * 31 + voxel * 3) as f32 * 0.01;
    Vec3::new(angle.cos(), angle.sin() * 0.8, angle.sin() * 0.6)
}

/// A picture; its units are iterations of the traversal where a caster counts each ray's own.
fn traversal(name: &str, mut caster: Box<dyn Caster>, octree: &Arc<Octree>, view: View) -> Result<Piece, Error> {
    caster.load(octree)?;
    let mut hits = Vec::new();
    caster.cast(&view, &mut hits)?;
    let steps = hits.iter().map(|hit| u64::from(hit.iterations)).sum();
    Ok(piece(name, "step of a ray", move || {
        caster.cast(black_box(&view), &mut hits).expect("it was cast before");
        steps
    }))
}

/// One packet of rays that all end at the same leaf, by the fastest instructions. Around the leaf there is nothing, so that the packet
/// is pushed once per level.
fn packet(levels: u32) -> Result<Piece, Error> {
    // Smaller than the smallest voxel; the outer two make the root cube.
    let speck =
        |at: DVec3| [[0.0; 3], [1e-6, 0.0, 0.0], [0.0, 1e-6, 1e-6]].map(|corner| (at + DVec3::from(corner)).into());
    let place = DVec3::new(0.28, 0.41, 0.31);
    let corners = [DVec3::ZERO, place, DVec3::ONE].map(speck).concat();
    let mesh = Mesh::from_triangles(corners, vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]])?;
    let settings = BuildSettings { levels, contours: false, ..BuildSettings::default() };
    let octree = Arc::new(build(&mesh, &settings, &|_| ())?.octree);
    let object = Object::of(&octree, 0);
    let leaves = CastOptions { max_voxel_pixels: 0.0, ..CastOptions::default() };
    // Through so narrow a lens that all rays are in one voxel.
    let way = DVec3::new(0.3, 0.8, 0.5);
    let (eye, forward) = ((place + way * 2.0).into(), (-way).into());
    let camera = Camera { eye, forward, up: [0.0, 1.0, 0.0], fov_degrees: 1e-6, near: 0.1, far: 10.0 };
    let view = object.view(&camera, (16, 16), &leaves)?;
    let mut caster = CpuCaster::with_instructions(Some(1), InstructionSet::best())?;
    caster.load(&octree)?;
    let mut hits = Vec::new();
    caster.cast(&view, &mut hits)?;
    if !hits.iter().all(|hit| !hit.is_miss() && hit.level() == levels && hit.same_voxel(&hits[0])) {
        return Err(format!("{levels} levels: the rays do not end at one leaf").into());
    }
    Ok(piece(&format!("a packet to level {levels}"), "packet of 16 x 16 rays", move || {
        for _ in 0..PACKETS {
            caster.cast(black_box(&view), &mut hits).expect("it was cast before");
        }
        PACKETS
    }))
}
