//! One object of an octree: its place in mesh space, and its rays.

use std::ops::Range;

use esvo_format::Octree;
use glam::{DMat3, DMat4, DVec3};

use crate::ray::{Ray, Rays};
use crate::{Camera, CastError, CastOptions, View};

/// One object of an octree, and the way between its spaces.
///
/// - **Mesh space** is that of the mesh file. Cameras, positions, normals and distances are in it.
/// - **Octree space** is that of the file format (spec section 4): the root cube is `[0, 1]³`. [`Octree::octree_to_mesh`]
///   leads to mesh space. A built octree's root cube is as wide as the mesh's largest extent and has the mesh in its middle.
/// - **Scene space** is that in which an octree is placed by [`placed`](Object::placed). Where these pages say mesh space, it is
///   the scene space of such an object; of others, both are the same.
/// - **Cast space** is octree space plus 1 on each axis: the root cube is `[1, 2]³`, so that the bits of a coordinate are the
///   path of a voxel from the root. Only what kernels read is in it: [`Ray`], [`View`](crate::View), [`Fan`](crate::Fan).
#[derive(Clone, Copy)]
pub struct Object<'a> {
    octree: &'a Octree,
    root: u32,
    contours: bool,
    octree_to_mesh: DMat4,
    mesh_to_octree: DMat4,
    /// Turns stored normals, which are those of the mesh, into scene space. `None` if both are the same.
    turn: Option<DMat3>,
}

impl<'a> Object<'a> {
    /// An object of an octree, to be cast with contours.
    ///
    /// # Panics
    /// The octree has no such object.
    pub fn of(octree: &'a Octree, index: usize) -> Self {
        let octree_to_mesh = octree.octree_to_mesh(index);
        let root = octree.objects()[index].root_slot as u32;
        Self { octree, root, contours: true, octree_to_mesh, mesh_to_octree: octree_to_mesh.inverse(), turn: None }
    }

    /// All objects of an octree.
    pub fn all(octree: &'a Octree) -> Vec<Self> {
        (0..octree.objects().len()).map(|index| Self::of(octree, index)).collect()
    }

    /// The object at another place: `mesh_to_scene` is affine and can be inverted.
    pub fn placed(self, mesh_to_scene: DMat4) -> Self {
        let octree_to_mesh = mesh_to_scene * self.octree_to_mesh;
        let turn = DMat3::from_mat4(mesh_to_scene).inverse().transpose() * self.turn.unwrap_or(DMat3::IDENTITY);
        Self { octree_to_mesh, mesh_to_octree: octree_to_mesh.inverse(), turn: Some(turn), ..self }
    }

    /// The object that a view shows: that of its root, else the first.
    pub fn of_view(octree: &'a Octree, view: &View) -> Self {
        let index = octree.objects().iter().position(|object| object.root_slot == u64::from(view.root)).unwrap_or(0);
        let object = Self::of(octree, index);
        if view.contours() { object } else { object.without_contours() }
    }

    /// What a camera sees of it.
    ///
    /// # Errors
    /// Those of [`View::new`].
    pub fn view(&self, camera: &Camera, size: (u32, u32), options: &CastOptions) -> Result<View, CastError> {
        View::new(camera, self.octree_to_mesh, self.root, size, options)
    }

    /// What turns a stored normal into mesh space, if that is not where it is.
    pub(crate) fn turn(&self) -> Option<&DMat3> {
        self.turn.as_ref()
    }

    /// The same object with voxels as cubes.
    pub fn without_contours(self) -> Self {
        Self { contours: false, ..self }
    }

    /// The octree.
    pub fn octree(&self) -> &'a Octree {
        self.octree
    }

    /// Slot of the root's child descriptor: the `root` of a [`View`](crate::View), of [`Rays`] and of
    /// [`Fans`](crate::Fans).
    pub fn root(&self) -> u32 {
        self.root
    }

    /// Whether voxels are clipped by their contours.
    pub fn contours(&self) -> bool {
        self.contours
    }

    /// Octree space to mesh space.
    pub fn octree_to_mesh(&self) -> &DMat4 {
        &self.octree_to_mesh
    }

    /// Mesh space to octree space.
    pub fn mesh_to_octree(&self) -> &DMat4 {
        &self.mesh_to_octree
    }

    /// A point of mesh space in cast space.
    pub fn to_cast(&self, point: DVec3) -> DVec3 {
        self.mesh_to_octree.transform_point3(point) + DVec3::ONE
    }

    /// A point of cast space in mesh space.
    pub fn from_cast(&self, point: DVec3) -> DVec3 {
        self.octree_to_mesh.transform_point3(point - DVec3::ONE)
    }

    /// A ray from a point of mesh space. `direction` may have any length above 0. The ray is cast between two `distances` from
    /// its origin, in mesh units: `0.0..f64::INFINITY` has no end.
    ///
    /// In cast space the direction has length 1, so `t` counts edges of the root cube;
    /// [`HitPoint::distance`](crate::HitPoint::distance) is in mesh units again. Only leaves end the ray: for other ends set
    /// its sizes. A direction without length or with NaN makes a ray that misses.
    pub fn ray(&self, origin: DVec3, direction: DVec3, distances: Range<f64>) -> Ray {
        // Squares of very small and very large components are 0 or infinite.
        let direction = near_one(self.mesh_to_octree.transform_vector3(near_one(direction))).normalize();
        let mesh_units_per_t = self.octree_to_mesh.transform_vector3(direction).length();
        Ray {
            t_min: (distances.start / mesh_units_per_t) as f32,
            t_max: (distances.end / mesh_units_per_t) as f32,
            ..Ray::new(self.to_cast(origin).as_vec3(), direction.as_vec3())
        }
    }

    /// Rays to cast against this object.
    pub fn rays<'r>(&self, rays: &'r [Ray]) -> Rays<'r> {
        Rays { root: self.root, contours: self.contours, rays }
    }
}

/// A vector of the same direction whose largest component is 1 to 4, or 2^-51 to 1 for a subnormal one. It is multiplied by
/// a power of two, so that no component is rounded unless it is negligible. Zero, infinity and NaN stay.
fn near_one(vector: DVec3) -> DVec3 {
    const FRACTION_BITS: u32 = 52;
    const TWICE_THE_BIAS: u64 = 2 * 1023;
    let exponent = vector.abs().max_element().to_bits() >> FRACTION_BITS;
    vector * f64::from_bits(TWICE_THE_BIAS.saturating_sub(exponent).max(1) << FRACTION_BITS)
}

impl Ray {
    /// [`Object::ray`] for a few rays: inverts the object's matrix at each call.
    ///
    /// # Panics
    /// The octree has no such object.
    pub fn from_mesh(octree: &Octree, object: usize, origin: DVec3, direction: DVec3, distances: Range<f64>) -> Self {
        Object::of(octree, object).ray(origin, direction, distances)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esvo_format::{AssembleOptions, Tree, Voxel, assemble};

    /// One voxel, the octant at the origin, in a root cube that is turned, moved and `edge` mesh units wide.
    fn octree(edge: f64) -> Octree {
        let mut tree = Tree::default();
        let mut children = [None; 8];
        children[0] = Some(Voxel { leaf: true, ..Voxel::default() });
        let root = tree.open(&children);
        tree.close(root);
        let to_mesh = DMat4::from_translation(DVec3::new(-3.0, 5.0, 0.5) * edge)
            * DMat4::from_rotation_y(0.4)
            * DMat4::from_scale(DVec3::splat(edge));
        assemble(&tree, to_mesh, &AssembleOptions::default()).unwrap()
    }

    #[test]
    fn points_go_both_ways() {
        let octree = octree(16.0);
        let object = Object::of(&octree, 0);
        let point = DVec3::new(0.1, 0.7, 0.3);
        let mesh = object.octree_to_mesh().transform_point3(point);
        assert!((object.to_cast(mesh) - point - 1.0).length() < 1e-12);
        assert!((object.from_cast(point + 1.0) - mesh).length() < 1e-12);
        assert!((object.mesh_to_octree().transform_point3(mesh) - point).length() < 1e-12);
        assert!(object.contours() && !object.without_contours().rays(&[]).contours && object.root() == 2);
    }

    #[test]
    fn rays_of_meshes_of_any_size_end_where_they_must() {
        for edge in [1e-9, 1.0, 1e9] {
            let octree = octree(edge);
            let object = Object::of(&octree, 0);
            let at = |point: DVec3| object.octree_to_mesh().transform_point3(point);
            // From half an edge in front of the voxel's side at x = 0.
            let (origin, towards) = (at(DVec3::new(-0.5, 0.25, 0.2)), at(DVec3::new(0.5, 0.25, 0.2)));
            let cast = |direction: DVec3, distances| {
                let ray = object.ray(origin, direction, distances);
                crate::reference::cast_ray(&octree, object.root(), &ray, true)
            };
            let direction = towards - origin;
            for length in [1e-290, 1e-3, 1.0, 1e20, 1e290] {
                let hit = cast(direction * length, 0.0..f64::INFINITY);
                assert!(!hit.is_miss() && (hit.raw_t - 0.5).abs() < 1e-6, "{edge} {length}: {hit:?}");
            }
            assert!(cast(direction, 0.0..0.49 * edge).is_miss() && !cast(direction, 0.0..0.51 * edge).is_miss());
            assert!(cast(direction, 1.01 * edge..2.0 * edge).is_miss());
            assert!((cast(direction, 0.75 * edge..2.0 * edge).raw_t - 0.75).abs() < 1e-6);
            for none in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY, DVec3::new(0.0, f64::NAN, 1.0)] {
                assert!(cast(none, 0.0..1.0).is_miss(), "{none}");
            }
            assert_eq!(
                Ray::from_mesh(&octree, 0, origin, direction, 0.0..1.0),
                object.ray(origin, direction, 0.0..1.0)
            );
        }
    }
}
