//! A mesh displaced subtree by subtree gives the octree of the mesh displaced as a whole.

use std::collections::{BTreeMap, HashSet};

use esvo_format::Octree;

use super::*;
use crate::displace::tests::{ball, bumpy, cube, material};
use crate::{Material, build, build_displaced, displace, visit_displaced};

/// Small subtrees: their roots are on levels 1 to 4.
const OPTIONS: DisplaceOptions = DisplaceOptions { scale: 1.0, cell: 0.02, max_triangles: 2000 };
const LEVELS: u32 = 8;
/// Below this level nothing differs.
const SAME_BELOW: u32 = 5;

fn settings() -> BuildSettings {
    // Plain attributes do not depend on those of their neighbours.
    BuildSettings { levels: LEVELS, plain_attributes: true, ..BuildSettings::default() }
}

/// All that is stored of a voxel.
#[derive(Debug, PartialEq)]
struct Stored {
    leaf: bool,
    contour: Option<u32>,
    color: Option<[u8; 4]>,
    normal: Option<u32>,
}

type Voxels = BTreeMap<(u32, [u32; 3]), Stored>;

fn voxels(octree: &Octree) -> Voxels {
    fn node(octree: &Octree, slot: u32, level: u32, at: [u32; 3], found: &mut Voxels) {
        let descriptor = octree.descriptor(slot);
        for child in (0..8u8).filter(|c| descriptor.valid_mask() >> c & 1 != 0) {
            let at = std::array::from_fn(|axis| 2 * at[axis] + u32::from(child >> axis & 1));
            let next = octree.child(slot, child);
            let stored = Stored {
                leaf: next.is_none(),
                contour: octree.contour(slot, child).map(|c| c.0),
                color: octree.plain_color(slot, child),
                normal: octree.plain_normal(slot, child).map(|n| n.0),
            };
            found.insert((level + 1, at), stored);
            if let Some(next) = next {
                node(octree, next, level + 1, at, found);
            }
        }
    }
    let mut found = Voxels::new();
    node(octree, octree.objects()[0].root_slot as u32, 0, [0; 3], &mut found);
    found
}

/// Whether voxels and leaves are the same, and whether everything below the roots of the subtrees is.
fn same(a: &Voxels, b: &Voxels) -> (bool, bool) {
    let shape = |v: &Voxels| v.iter().map(|(at, stored)| (*at, stored.leaf)).collect::<Vec<_>>();
    let below =
        |v: &Voxels| v.range((SAME_BELOW + 1, [0; 3])..).map(|(at, s)| format!("{at:?} {s:?}")).collect::<Vec<_>>();
    (shape(a) == shape(b), below(a) == below(b))
}

fn whole(mesh: &Mesh, settings: &BuildSettings) -> Voxels {
    let displaced = displace(mesh, &DisplaceOptions { max_triangles: 1 << 24, ..OPTIONS }).unwrap();
    assert_eq!(displaced.warnings, [""; 0]);
    voxels(&build(&displaced, settings, &|_| ()).unwrap().octree)
}

/// Builds subtree by subtree, after a change that should show.
fn changed(mesh: &Mesh, settings: &BuildSettings, change: impl FnOnce(&mut Subtrees)) -> Voxels {
    let source = Source::new(mesh, &OPTIONS, true).unwrap().unwrap();
    let mut subtrees = Subtrees::new(&source, &OPTIONS, settings).unwrap();
    change(&mut subtrees);
    let store = BlockStore::in_memory();
    let root = subtrees.run(2, &store, None, &|_| ()).unwrap().root.unwrap();
    voxels(&store.octree(root, subtrees.octree_to_mesh).unwrap())
}

fn meshes() -> Vec<Mesh> {
    let bumps = || material(bumpy(32), 0.1, -0.03);
    let coarse = || material(bumpy(5), 0.2, 0.0);
    vec![
        cube(vec![bumps()]),
        cube(vec![bumps(), Material::default(), coarse(), Material::default()]),
        ball(vec![bumps()]),
        ball(vec![bumps(), coarse(), Material::default()]),
        shallow(),
    ]
}

/// A ball with bumps lower than the small triangles are wide.
fn shallow() -> Mesh {
    ball(vec![material(bumpy(32), 0.003, -0.001)])
}

#[test]
fn subtrees_give_the_octree_of_the_whole_mesh() {
    for (k, mesh) in meshes().iter().enumerate() {
        let found = changed(mesh, &settings(), |_| ());
        let expected = whole(mesh, &settings());
        assert!(expected.len() > 30_000, "{k}: {}", expected.len());
        assert_eq!(same(&found, &expected), (true, true), "mesh {k}");
    }
}

#[test]
fn what_is_left_out_is_noticed() {
    // Without small triangles around a subtree's box the slopes at its border are wrong, and only they.
    let (mesh, expected) = (shallow(), whole(&shallow(), &settings()));
    let no_ring = changed(&mesh, &settings(), |subtrees| subtrees.parts.ring = 0.0);
    assert_eq!(same(&no_ring, &expected), (true, false));
    // Parts of triangles from which the surface moves into the box.
    let (mesh, expected) = (&meshes()[2], whole(&meshes()[2], &settings()));
    let narrow = changed(mesh, &settings(), |subtrees| subtrees.parts.ring = -4.0);
    assert!(!same(&narrow, &expected).0);
    // The tiles of one triangle.
    let torn = changed(mesh, &settings(), |subtrees| {
        let near = subtrees.tiles.list[77].triangle;
        subtrees.tiles.list.retain(|tile| tile.triangle != near);
    });
    assert!(!same(&torn, &expected).0);
}

#[test]
fn every_triangle_is_visited() {
    let mesh = &meshes()[1];
    let whole = displace(mesh, &DisplaceOptions { max_triangles: 1 << 24, ..OPTIONS }).unwrap();
    let places = |mesh: &Mesh| {
        let place = |v: u32| mesh.positions[v as usize].map(f64::to_bits);
        mesh.triangles.iter().map(|t| t.map(place)).collect::<Vec<_>>()
    };
    let found = Mutex::new(HashSet::new());
    let visit = |part: &Mesh| {
        part.validate().unwrap();
        assert!(part.triangle_count() < whole.triangle_count() / 4);
        found.lock().unwrap().extend(places(part));
    };
    visit_displaced(mesh, &OPTIONS, &visit).unwrap();
    assert!(found.into_inner().unwrap() == places(&whole).into_iter().collect());
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let mesh = &meshes()[3];
    let settings = BuildSettings { levels: 7, ..BuildSettings::default() };
    let bytes = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let built = pool.install(|| build_displaced(mesh, &OPTIONS, &settings, &|_| ())).unwrap();
        built.octree.sound().unwrap();
        (built.octree.words().to_vec(), built.stats.triangles)
    };
    let (alone, three) = (bytes(1), bytes(3));
    assert!(alone == three);
    let whole = displace(mesh, &DisplaceOptions { max_triangles: 1 << 24, ..OPTIONS }).unwrap();
    assert_eq!(alone.1, whole.triangle_count(), "each small triangle is counted once");
}

#[test]
fn the_root_cube_is_that_of_the_whole_mesh() {
    for mesh in meshes() {
        let source = Source::new(&mesh, &OPTIONS, true).unwrap().unwrap();
        let settings = BuildSettings::default();
        let subtrees = Subtrees::new(&source, &OPTIONS, &settings).unwrap();
        let whole = displace(&mesh, &DisplaceOptions { max_triangles: 1 << 24, ..OPTIONS }).unwrap();
        let prepared = crate::PreparedMesh::new(&whole, 10).unwrap();
        assert_eq!(subtrees.octree_to_mesh, prepared.octree_to_mesh());
    }
}

#[test]
fn a_mesh_that_does_not_move_is_built_as_it_is() {
    let mesh = cube(vec![Material::default()]);
    let settings = BuildSettings { levels: 6, ..BuildSettings::default() };
    let (as_is, built) = (build(&mesh, &settings, &|_| ()), build_displaced(&mesh, &OPTIONS, &settings, &|_| ()));
    assert_eq!(built.unwrap().octree.words(), as_is.unwrap().octree.words());
}
