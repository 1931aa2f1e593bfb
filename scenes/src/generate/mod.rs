//! Procedural meshes: stand-ins for the paper's scenes, and small meshes for tests.
//!
//! Every mesh is a function of its seed alone, with the same bits on every platform.

mod city;
mod conference;
mod fairy;
mod hairball;
mod numeric;
mod shape;
mod sibenik;
mod small;

use esvo_builder::mesh::Mesh;

pub use city::{CITY_TRIANGLES, city};
pub use conference::{CONFERENCE_TRIANGLES, conference};
pub use fairy::{FAIRY_TRIANGLES, fairy};
pub use hairball::{HAIRBALL_TRIANGLES, hairball};
pub use sibenik::{SIBENIK_TRIANGLES, sibenik};
pub use small::{
    BUMPY_SPHERE_ON_PLANE_TRIANGLES, SLIVERS_TRIANGLES, bumpy_sphere_on_plane, cube, single_triangle, slivers, sphere,
};

/// A named generator.
#[derive(Clone, Copy, Debug)]
pub struct Generator {
    /// The name that [`procedural`] and manifests use.
    pub name: &'static str,
    /// Exact number of triangles, for every seed.
    pub triangles: usize,
    /// The seed that [`procedural`] uses.
    pub seed: u64,
    /// Makes the mesh. Generators without random parts ignore the seed.
    pub make: fn(seed: u64) -> Mesh,
}

/// Every generator, the paper's scenes first.
pub const GENERATORS: &[Generator] = &[
    Generator { name: "city", triangles: CITY_TRIANGLES, seed: 1, make: city },
    Generator { name: "sibenik", triangles: SIBENIK_TRIANGLES, seed: 1, make: sibenik },
    Generator { name: "hairball", triangles: HAIRBALL_TRIANGLES, seed: 1, make: hairball },
    Generator { name: "fairy", triangles: FAIRY_TRIANGLES, seed: 1, make: fairy },
    Generator { name: "conference", triangles: CONFERENCE_TRIANGLES, seed: 1, make: conference },
    Generator { name: "single-triangle", triangles: 1, seed: 0, make: |_| single_triangle() },
    Generator { name: "cube", triangles: 12, seed: 0, make: |_| cube() },
    Generator { name: "sphere", triangles: 20 << 10, seed: 0, make: |_| sphere(5) },
    Generator {
        name: "bumpy-sphere-on-plane",
        triangles: BUMPY_SPHERE_ON_PLANE_TRIANGLES,
        seed: 0,
        make: |_| bumpy_sphere_on_plane(),
    },
    Generator { name: "slivers", triangles: SLIVERS_TRIANGLES, seed: 0, make: |_| slivers() },
];

/// The generator of that name; letter case does not matter and `_` may stand for `-`.
pub fn generator(name: &str) -> Option<&'static Generator> {
    let name = name.to_ascii_lowercase().replace('_', "-");
    GENERATORS.iter().find(|g| g.name == name)
}

/// The mesh of that name with its usual seed, or `None` if no generator has that name (see [`GENERATORS`]).
pub fn procedural(name: &str) -> Option<Mesh> {
    let generator = generator(name)?;
    Some((generator.make)(generator.seed))
}
