//! Depth error: the distance between the hits of an octree caster and the exact hits of the triangles.

use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::shading::{octree_to_mesh, voxel_normal};
use esvo_core::{Hit, View};
use esvo_format::Octree;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Percentiles, mean and maximum of a set of errors. All zero for an empty set.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Summary {
    /// Half of the errors are at most this.
    pub median: f64,
    /// 90 % of the errors are at most this.
    pub p90: f64,
    /// 99 % of the errors are at most this.
    pub p99: f64,
    /// Mean. A few rays that pass an edge and hit a surface far behind it can dominate it.
    pub mean: f64,
    /// Largest.
    pub max: f64,
}

impl Summary {
    /// Summarizes numbers in any order; none may be NaN. Percentiles are nearest ranks: each is one of the numbers.
    pub fn of(mut errors: Vec<f64>) -> Self {
        if errors.is_empty() {
            return Self::default();
        }
        errors.sort_unstable_by(f64::total_cmp);
        let count = errors.len();
        // The smallest number that is at least as large as `percent` of all numbers.
        let rank = |percent: usize| errors[(count * percent).div_ceil(100).max(1) - 1];
        Self {
            median: rank(50),
            p90: rank(90),
            p99: rank(99),
            mean: errors.iter().sum::<f64>() / count as f64,
            max: errors[count - 1],
        }
    }
}

/// Depth error of a picture.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct DepthError {
    /// Rays compared.
    pub rays: u64,
    /// Rays that hit both triangles and voxels. The summaries are taken over these rays.
    pub both_hit: u64,
    /// Rays that hit a triangle but no voxel: holes.
    pub only_exact: u64,
    /// Rays that hit a voxel but no triangle.
    pub only_octree: u64,
    /// Rays whose `t` is NaN, or outside `0..=1` without being a miss. They are not counted elsewhere. A number above 0 means
    /// that the caster is broken.
    pub strange: u64,
    /// `(only_exact + only_octree + strange) / rays`.
    pub disagreement: f64,
    /// Mean of the signed error along the ray in pixels. Above 0: voxels lie behind the surface.
    pub bias_pixels: f64,
    /// Distance between the two hits along the ray, in pixels: footprints of a pixel at the exact hit.
    pub pixels: Summary,
    /// The same in mesh units.
    pub scene: Summary,
    /// The same in edges of the octree's finest voxels.
    pub voxels: Summary,
    /// The same in edges of the voxel that the ray hit.
    #[serde(default)]
    pub hit_voxels: Summary,
}

impl DepthError {
    /// Compares hits ray by ray. Both were cast with `rays`; `edges` are the octree's ([`voxel_edges`]).
    ///
    /// # Panics
    /// The number of hits is not that of the rays.
    pub fn between(rays: &CameraRays, exact: &[TriangleHit], hits: &[Hit], edges: VoxelEdges) -> Self {
        let mut all = DepthErrors::default();
        all.add(rays, exact, hits, edges);
        all.finish()
    }
}

/// Depth errors of several pictures, collected ray by ray.
#[derive(Clone, Default, Debug)]
pub struct DepthErrors {
    counts: DepthError,
    pixels: Vec<f64>,
    scene: Vec<f64>,
    voxels: Vec<f64>,
    hit_voxels: Vec<f64>,
}

impl DepthErrors {
    /// Adds a picture. The arguments are those of [`DepthError::between`].
    ///
    /// # Panics
    /// The number of hits is not that of the rays.
    pub fn add(&mut self, rays: &CameraRays, exact: &[TriangleHit], hits: &[Hit], edges: VoxelEdges) {
        assert!(exact.len() == rays.pixels() && hits.len() == rays.pixels(), "one hit for every ray");
        let counts = &mut self.counts;
        counts.rays += hits.len() as u64;
        for (index, (exact, hit)) in exact.iter().zip(hits).enumerate() {
            let t = f64::from(hit.raw_t);
            match (exact.is_miss(), hit.is_miss()) {
                (_, false) if !(0.0..=1.0).contains(&t) => counts.strange += 1,
                (_, true) if hit.raw_t != Hit::MISS_T => counts.strange += 1,
                (true, true) => {}
                (false, true) => counts.only_exact += 1,
                (true, false) => counts.only_octree += 1,
                (false, false) => {
                    let distance = (t - exact.t) * rays.ray_at(index).direction.length();
                    let footprint = rays.pixel_size() * exact.t;
                    counts.bias_pixels += distance / footprint;
                    self.pixels.push(distance.abs() / footprint);
                    self.scene.push(distance.abs());
                    self.voxels.push(distance.abs() / edges.finest);
                    self.hit_voxels.push(distance.abs() / (edges.root * f64::from(hit.size())));
                }
            }
        }
    }

    /// Summarizes all pictures.
    pub fn finish(self) -> DepthError {
        let mut error = self.counts;
        error.both_hit = self.pixels.len() as u64;
        error.bias_pixels /= self.pixels.len().max(1) as f64;
        let disagreeing = error.only_exact + error.only_octree + error.strange;
        error.disagreement = disagreeing as f64 / error.rays.max(1) as f64;
        error.pixels = Summary::of(self.pixels);
        error.scene = Summary::of(self.scene);
        error.voxels = Summary::of(self.voxels);
        error.hit_voxels = Summary::of(self.hit_voxels);
        error
    }
}

/// Edge lengths of cubes in mesh units.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct VoxelEdges {
    /// Edge of the root cube.
    pub root: f64,
    /// Edge of the finest voxels.
    pub finest: f64,
}

/// Edge lengths of the root cube and of the finest voxels of an object.
///
/// # Panics
/// There is no such object.
pub fn voxel_edges(octree: &Octree, object: usize) -> VoxelEdges {
    let root = octree.octree_to_mesh(object).determinant().abs().cbrt();
    VoxelEdges { root, finest: root * (-f64::from(octree.objects()[object].levels)).exp2() }
}

/// Angles in degrees between the normals of voxels and of the surface, for rays that hit both. Opposite normals count as
/// equal: angles are 0 to 90.
///
/// `surface_normal` gives the normal of a triangle at a point, in mesh space, of any length. Triangles and voxels whose normal
/// is zero are left out.
///
/// # Panics
/// The hits are not of this octree and view.
pub fn normal_error(
    octree: &Octree,
    view: &View,
    exact: &[TriangleHit],
    hits: &[Hit],
    mut surface_normal: impl FnMut(u32, DVec3) -> DVec3,
) -> Summary {
    let to_mesh = octree_to_mesh(octree, view);
    let rays = CameraRays::of_view(view, to_mesh);
    let normals: Vec<DVec3> = (exact.iter().enumerate())
        .map(|(index, exact)| {
            let ray = rays.ray_at(index);
            let point = || ray.origin + ray.direction * exact.t;
            if exact.is_miss() { DVec3::ZERO } else { surface_normal(exact.triangle, point()) }
        })
        .collect();
    Summary::of(normal_angles(octree, view, &normals, hits))
}

/// Angles in degrees, as [`normal_error`] summarizes them. `surface` has the normal at the exact hit of each ray, of any length;
/// zero for a miss.
///
/// # Panics
/// The hits are not of this octree and view.
pub fn normal_angles(octree: &Octree, view: &View, surface: &[DVec3], hits: &[Hit]) -> Vec<f64> {
    let to_mesh = octree_to_mesh(octree, view);
    let angle = |(index, (surface, hit)): (usize, (&DVec3, &Hit))| {
        let (x, y) = (index as u32 % view.width, index as u32 / view.width);
        let voxel = || voxel_normal(octree, &to_mesh, &view.ray(x, y), hit);
        if hit.is_miss() || *surface == DVec3::ZERO { None } else { normal_angle(*surface, voxel()) }
    };
    surface.iter().zip(hits).enumerate().filter_map(angle).collect()
}

/// Angle in degrees between two normals of any length, 0 to 90, as opposite normals count as equal; `None` if one of them is zero.
pub fn normal_angle(a: DVec3, b: DVec3) -> Option<f64> {
    // atan2 of sine and cosine: the arc cosine alone loses half the digits of a small angle.
    let angle = a.cross(b).length().atan2(a.dot(b).abs());
    (a != DVec3::ZERO && b != DVec3::ZERO && angle.is_finite()).then(|| angle.to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;
    use esvo_core::reference::cast_fine;
    use esvo_core::{Camera, CastOptions};
    use esvo_cpu::triangles::TriangleScene;
    use esvo_format::{AssembleOptions, Tree, Voxel, assemble};
    use glam::DMat4;

    #[test]
    fn percentiles_are_nearest_ranks() {
        assert_eq!(Summary::of(Vec::new()), Summary::default());
        let one = Summary::of(vec![3.0]);
        assert_eq!((one.median, one.p90, one.p99, one.mean, one.max), (3.0, 3.0, 3.0, 3.0, 3.0));
        let hundred = Summary::of((1..=100).rev().map(f64::from).collect());
        assert_eq!((hundred.median, hundred.p90, hundred.p99, hundred.max), (50.0, 90.0, 99.0, 100.0));
        assert_eq!(hundred.mean, 50.5);
        let ten = Summary::of((1..=10).map(f64::from).collect());
        assert_eq!((ten.median, ten.p90, ten.p99), (5.0, 9.0, 10.0));
        assert_eq!(Summary::of(vec![2.0, 1.0]).median, 1.0);
    }

    /// The lower half of the root cube, full at one level: its top is the plane z = 0 in mesh space, 4 units wide.
    fn slab() -> Octree {
        let mut tree = Tree::default();
        let voxel = |slot: usize| (slot < 4).then_some(Voxel { leaf: true, ..Voxel::default() });
        let root = tree.open(&std::array::from_fn(voxel));
        tree.close(root);
        let to_mesh = DMat4::from_translation(DVec3::splat(-2.0)) * DMat4::from_scale(DVec3::splat(4.0));
        assemble(&tree, to_mesh, &AssembleOptions::default()).unwrap()
    }

    fn plane(z: f64, half: f64) -> TriangleScene {
        let p = |x: f64, y: f64| [x * half, y * half, z];
        let triangles = vec![[p(-1., -1.), p(1., -1.), p(1., 1.)], [p(-1., -1.), p(1., 1.), p(-1., 1.)]];
        TriangleScene::new(triangles).unwrap()
    }

    fn pictures(octree: &Octree, scene: &TriangleScene) -> (CameraRays, View, Vec<TriangleHit>, Vec<Hit>) {
        let camera = Camera {
            eye: [0.03, 0.05, 4.0],
            forward: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            fov_degrees: 40.0,
            near: 0.1,
            far: 8.0,
        };
        let root = octree.objects()[0].root_slot as u32;
        let options = CastOptions { max_voxel_pixels: 0.0, ..CastOptions::default() };
        let view = View::new(&camera, octree.octree_to_mesh(0), root, (60, 40), &options).unwrap();
        let rays = CameraRays::new(&camera, (60, 40)).unwrap();
        let mut hits = Vec::new();
        cast_fine(octree, &view, &[], &mut hits);
        (rays, view, scene.cast_exact(&rays), hits)
    }

    #[test]
    fn a_plane_that_lies_deeper_by_a_known_distance() {
        let octree = slab();
        let edges = voxel_edges(&octree, 0);
        assert_eq!(edges.finest, 2.0);
        let (rays, view, exact, hits) = pictures(&octree, &plane(0.0, 2.0));
        let same = DepthError::between(&rays, &exact, &hits, edges);
        assert!(same.disagreement < 0.01 && same.both_hit > 1500, "{same:?}");
        assert!(same.scene.max < 1e-5, "{same:?}");

        // The triangles lie 0.25 in front of the voxels: straight ahead that is the error, more towards the corners.
        let (_, _, exact, _) = pictures(&octree, &plane(0.25, 1.2));
        let error = DepthError::between(&rays, &exact, &hits, edges);
        assert!(error.scene.median > 0.25 && error.scene.max < 0.25 * 1.25, "{error:?}");
        assert!((error.voxels.mean - error.scene.mean / 2.0).abs() < 1e-12);
        // A pixel is 2 tan(20°) 3.75 / 40 wide there.
        let footprint = 2.0 * 20f64.to_radians().tan() * 3.75 / 40.0;
        assert!((error.pixels.max - error.scene.max / footprint).abs() < 1e-3, "{error:?}");
        assert!((error.bias_pixels - error.pixels.mean).abs() < 1e-9, "voxels lie behind: {error:?}");
        // The triangles cover less of the picture.
        assert!(error.only_octree > 100 && error.only_exact == 0 && error.strange == 0, "{error:?}");
        assert_eq!(error.disagreement, error.only_octree as f64 / 2400.0);

        let flat = normal_error(&octree, &view, &exact, &hits, |_, _| DVec3::NEG_Z * 5.0);
        assert!(flat.max < 1e-6, "{flat:?}");
        let tilted = normal_error(&octree, &view, &exact, &hits, |_, _| DVec3::new(0.0, 1.0, 1.0));
        assert!((tilted.median - 45.0).abs() < 1e-9 && (tilted.max - 45.0).abs() < 1e-9, "{tilted:?}");
    }

    /// The negative control: what a caster may get wrong shows.
    #[test]
    fn faults_are_counted() {
        let (octree, scene) = (slab(), plane(0.0, 2.0));
        let (rays, _, exact, hits) = pictures(&octree, &scene);
        let edges = VoxelEdges { root: 16.0, finest: 2.0 };
        let good = DepthError::between(&rays, &exact, &hits, edges);
        let mut bad = hits.clone();
        let full: Vec<usize> = (0..bad.len()).filter(|&i| !bad[i].is_miss() && !exact[i].is_miss()).collect();
        bad[full[0]].raw_t = f32::NAN;
        bad[full[1]].raw_t = -0.1;
        bad[full[2]] = Hit::miss(1);
        bad[full[3]].raw_t *= 1.5;
        bad[full[4]] = Hit { raw_t: 0.3, ..Hit::miss(1) };
        let error = DepthError::between(&rays, &exact, &bad, edges);
        assert_eq!((error.strange, error.only_exact), (3, good.only_exact + 1));
        assert!(error.scene.max > 1.9 && error.pixels.p99 < 1e-3, "{error:?}");
        assert!(error.disagreement > good.disagreement);
        // A missing triangle is noticed too.
        let half = TriangleScene::new(vec![scene.triangles()[0].map(Into::into)]).unwrap();
        let error = DepthError::between(&rays, &half.cast_exact(&rays), &hits, edges);
        assert!(error.disagreement > 0.3, "{error:?}");
    }
}
