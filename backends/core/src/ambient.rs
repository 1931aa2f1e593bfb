//! Ambient occlusion: how much of the light from all directions reaches each voxel (paper section 1, figure 1; the
//! `ambient` mode of the authors' program).
//!
//! Rays start at a point just above the surface in a leaf voxel and go into the hemisphere around its normal. Their density
//! is proportional to the cosine of the angle to the normal, as for a surface that scatters light equally in all directions.
//! The value is the share of rays that hit nothing within a radius. A voxel that is not a leaf has the mean of its children.
//!
//! Every voxel has the same directions, turned around the normal by an angle that depends on the voxel's place. The same
//! octree therefore always gets the same values, from every engine.

use std::f32::consts::TAU;
use std::sync::Arc;

use esvo_format::{Octree, Slab};
use glam::{DMat3, DVec3, Mat3, Vec2, Vec3};

use crate::{CastError, Caster, Fan, Fans};

/// Rays of one call of the caster, at least.
const BATCH_RAYS: usize = 1 << 20;

/// How ambient occlusion is computed.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct AmbientSettings {
    /// Rays per leaf voxel, 1 to 65536.
    pub rays: u32,
    /// Distance up to which voxels block light, in edges of the root cube: above 0, at most 4.
    pub radius: f64,
    /// Cast rays on the other side of the surface, for meshes whose normals point inwards.
    pub flip_normals: bool,
    /// Clip voxels by their contours; otherwise they are cubes.
    pub contours: bool,
}

impl Default for AmbientSettings {
    /// The authors' settings: 256 rays, 0.05 of the scene.
    fn default() -> Self {
        Self { rays: 256, radius: 0.05, flip_normals: false, contours: true }
    }
}

/// Why ambient occlusion was not computed.
#[derive(Debug, thiserror::Error)]
pub enum AmbientError {
    /// A setting out of its range.
    #[error("{name} is {value}: it must be {range}")]
    Setting {
        /// The setting.
        name: &'static str,
        /// Its value.
        value: String,
        /// The values that it may have.
        range: &'static str,
    },
    /// Without normals, no side of the surface is known to be outside.
    #[error("the octree has no normals, so it has no outside; build it with normals")]
    NoNormals,
    /// What the caster said.
    #[error(transparent)]
    Cast(#[from] CastError),
}

impl AmbientSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// The first setting out of its range.
    pub fn check(&self) -> Result<(), AmbientError> {
        if !(1..=1 << 16).contains(&self.rays) {
            let range = "between 1 and 65536";
            return Err(AmbientError::Setting { name: "rays", value: self.rays.to_string(), range });
        }
        if !(self.radius > 0.0 && self.radius <= 4.0) {
            let range = "above 0 and at most 4 times the scene";
            return Err(AmbientError::Setting { name: "radius", value: format!("{:?}", self.radius), range });
        }
        Ok(())
    }
}

/// One value per voxel, from 0 (no light reaches it) to 255 (all light does).
pub struct Ambient {
    /// By slot of the parent's descriptor and child slot.
    values: Vec<u8>,
}

impl Ambient {
    /// The value of child `child` of the descriptor at `slot`.
    ///
    /// # Panics
    /// Slots outside the image of the octree that this was computed for.
    pub fn value(&self, slot: u32, child: u8) -> u8 {
        self.values[slot as usize * 8 + usize::from(child)]
    }

    /// Computes the values of every voxel of every object. `progress` is called from time to time with the share that is
    /// done, 0 to 1.
    ///
    /// Takes eight bytes of memory per slot of the image, and loads the octree into the caster.
    ///
    /// # Errors
    /// Settings out of range, an octree without normals, the caster's errors.
    pub fn compute(
        octree: &Arc<Octree>,
        caster: &mut dyn Caster,
        settings: &AmbientSettings,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Self, AmbientError> {
        settings.check()?;
        caster.load(octree)?;
        let directions = hemisphere(settings.rays);
        let total = octree.objects().iter().map(|o| o.leaf_voxels).sum::<u64>().max(1);
        let mut run = Run {
            octree,
            settings,
            directions: &directions,
            values: vec![0; octree.slots().len() * 8],
            batch: Vec::new(),
            leaves: Vec::new(),
            hits: Vec::new(),
            done: 0,
        };
        for object in 0..octree.objects().len() {
            run.object(object, caster, &mut |leaves| progress(leaves as f64 / total as f64))?;
        }
        Ok(Self { values: run.values })
    }
}

/// The slab of a contour, of a voxel or of one of its ancestors.
#[derive(Clone, Copy)]
struct Bound {
    /// Centre of the voxel that the contour belongs to, and its edge.
    centre: DVec3,
    size: f64,
    slab: Slab,
}

impl Bound {
    /// `n·p` of a point in the units of the slab.
    fn at(&self, p: DVec3) -> f64 {
        DVec3::from(self.slab.normal).dot(p - self.centre) / self.size
    }

    /// The nearest point with this `n·p`.
    fn moved_to(&self, p: DVec3, at: f64) -> DVec3 {
        let n = DVec3::from(self.slab.normal);
        p + n * ((at - self.at(p)) * self.size / n.length_squared())
    }

    /// Distance from a point inside to where `direction` leaves the slab.
    fn exit(&self, p: DVec3, direction: DVec3) -> f64 {
        let speed = DVec3::from(self.slab.normal).dot(direction) / self.size;
        let end = if speed > 0.0 { self.slab.hi() } else { self.slab.lo() };
        if speed == 0.0 { f64::MAX } else { ((end - self.at(p)) / speed).max(0.0) }
    }
}

/// A descriptor: its slot, and the lower corner and edge of its cube in the root cube `[0, 1]³`.
#[derive(Clone, Copy)]
struct Node {
    slot: u32,
    corner: DVec3,
    size: f64,
}

struct Run<'a> {
    octree: &'a Octree,
    settings: &'a AmbientSettings,
    directions: &'a [Vec3],
    values: Vec<u8>,
    /// Leaves whose rays are not cast yet, and the places of their values.
    batch: Vec<Fan>,
    leaves: Vec<usize>,
    hits: Vec<crate::Hit>,
    done: u64,
}

impl Run<'_> {
    fn object(
        &mut self,
        object: usize,
        caster: &mut dyn Caster,
        progress: &mut dyn FnMut(u64),
    ) -> Result<(), AmbientError> {
        let to_mesh = DMat3::from_mat4(self.octree.octree_to_mesh(object));
        let root = self.octree.objects()[object].root_slot as u32;
        let mut job = Job { caster, progress, root, to_octree: to_mesh.transpose() };
        self.descend(&mut job, Node { slot: root, corner: DVec3::ZERO, size: 1.0 }, &mut Vec::new())?;
        self.cast(&mut job)?;
        self.average(root);
        Ok(())
    }

    /// Collects the leaves below a descriptor; `bounds` are the contours of its ancestors.
    fn descend(&mut self, job: &mut Job, node: Node, bounds: &mut Vec<Bound>) -> Result<(), AmbientError> {
        let descriptor = self.octree.descriptor(node.slot);
        let size = node.size * 0.5;
        for child in (0..8u8).filter(|c| descriptor.valid_mask() >> c & 1 != 0) {
            let offset = DVec3::from(std::array::from_fn(|axis| f64::from(child >> axis & 1)));
            let corner = node.corner + offset * size;
            let contour = self.octree.contour(node.slot, child).filter(|_| self.settings.contours);
            let kept = bounds.len();
            bounds.extend(contour.map(|c| Bound { centre: corner + size * 0.5, size, slab: c.decode() }));
            if let Some(slot) = self.octree.child(node.slot, child) {
                self.descend(job, Node { slot, corner, size }, bounds)?;
            } else {
                let normal = self.octree.normal(node.slot, child).ok_or(AmbientError::NoNormals)?.as_dvec3();
                let normal = if self.settings.flip_normals { -normal } else { normal };
                let normal = (job.to_octree * normal).normalize_or(DVec3::Z);
                self.batch.push(self.fan(corner + size * 0.5, size, normal, bounds));
                self.leaves.push(node.slot as usize * 8 + usize::from(child));
                if self.batch.len() * self.directions.len() >= BATCH_RAYS {
                    self.cast(job)?;
                }
            }
            bounds.truncate(kept);
        }
        Ok(())
    }

    /// The rays of a leaf, which start above its surface.
    ///
    /// The surface is assumed in the middle of the leaf's own contour, else within the contours of its ancestors, else in the
    /// middle of the cube. With contours, rays start a quarter of the leaf's edge beyond the point where the normal leaves
    /// the leaf's shape: that is above the shapes of its neighbours on the same surface. Without contours, let `s` be the
    /// extent of a cube along the normal. All cubes of a flat surface are within `s` of it, and the surface is within `s / 2`
    /// of the leaf's centre: rays start `1.5 s` above the centre.
    fn fan(&self, centre: DVec3, size: f64, normal: DVec3, bounds: &[Bound]) -> Fan {
        let mut p = centre;
        for bound in bounds {
            let own = bound.size == size;
            let at = if own { bound.slab.position } else { bound.at(p).clamp(bound.slab.lo(), bound.slab.hi()) };
            p = bound.moved_to(p, at);
        }
        p = p.clamp(centre - size * 0.5, centre + size * 0.5);
        let exit_of_cube = (0..3).map(|axis| {
            let to_face = 0.5 * size - (p[axis] - centre[axis]) * normal[axis].signum();
            to_face / normal[axis].abs().max(1e-9)
        });
        let exit_of_cube = exit_of_cube.fold(f64::MAX, f64::min);
        let exit = bounds.iter().map(|b| b.exit(p, normal)).fold(f64::MAX, f64::min);
        let lift = if bounds.is_empty() {
            exit_of_cube.max(1.5 * size * normal.abs().element_sum()) + 0.01 * size
        } else {
            exit.min(exit_of_cube) + 0.25 * size
        };
        let origin = p + normal * lift;
        let normal = normal.as_vec3();
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let turn = Vec2::from_angle(noise(centre) * TAU);
        let axes =
            Mat3::from_cols(tangent * turn.x + bitangent * turn.y, bitangent * turn.x - tangent * turn.y, normal);
        Fan { origin: (origin + 1.0).as_vec3(), axes: axes * self.settings.radius as f32 }
    }

    /// Casts the rays of the collected leaves.
    fn cast(&mut self, job: &mut Job) -> Result<(), AmbientError> {
        let contours = self.settings.contours;
        let fans = Fans { root: job.root, contours, fans: &self.batch, directions: self.directions };
        job.caster.cast_fans(&fans, &mut self.hits)?;
        let rays = self.directions.len();
        for (hits, leaf) in self.hits.chunks(rays).zip(&self.leaves) {
            let free = hits.iter().filter(|hit| hit.is_miss()).count();
            self.values[*leaf] = ((free * 510 + rays) / (2 * rays)) as u8;
        }
        self.done += self.leaves.len() as u64;
        self.batch.clear();
        self.leaves.clear();
        (job.progress)(self.done);
        Ok(())
    }

    /// Sets the values of the voxels below a descriptor that are not leaves. Returns the mean of its children.
    fn average(&mut self, slot: u32) -> f32 {
        let valid = self.octree.descriptor(slot).valid_mask();
        let mut sum = 0.0;
        for child in (0..8u8).filter(|c| valid >> c & 1 != 0) {
            let at = slot as usize * 8 + usize::from(child);
            sum += if let Some(next) = self.octree.child(slot, child) {
                let mean = self.average(next);
                self.values[at] = mean.round() as u8;
                mean
            } else {
                f32::from(self.values[at])
            };
        }
        sum / valid.count_ones().max(1) as f32
    }
}

/// What the batches of an object have in common.
struct Job<'a> {
    caster: &'a mut dyn Caster,
    progress: &'a mut dyn FnMut(u64),
    root: u32,
    /// Transforms normals from mesh space to octree space.
    to_octree: DMat3,
}

/// Unit vectors around z with a density proportional to the cosine of the angle to it. Neighbours in the list are close.
fn hemisphere(count: u32) -> Vec<Vec3> {
    // Points of equal area along a spiral with the golden angle, on the disc below the hemisphere.
    let golden = TAU * (1.0 - 2.0 / (1.0 + 5.0f32.sqrt()));
    let mut directions: Vec<Vec3> = (0..count)
        .map(|i| {
            let u = (i as f32 + 0.5) / count as f32;
            let around = Vec2::from_angle(i as f32 % 65536.0 * golden) * u.sqrt();
            around.extend((1.0 - u).sqrt())
        })
        .collect();
    let cell = |x: f32| ((x * 0.5 + 0.5) * 16.0) as u32 & 15;
    let spread = |x: u32| (0..4).fold(0, |sum, bit| sum | (x >> bit & 1) << (2 * bit));
    directions.sort_by_key(|d| spread(cell(d.x)) | spread(cell(d.y)) << 1);
    directions
}

/// A number in `0.0..1.0` that depends on a place.
fn noise(p: DVec3) -> f32 {
    let mut x = p
        .to_array()
        .into_iter()
        .fold(0u64, |h, c| (h ^ c.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
    x = (x ^ x >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93);
    ((x ^ x >> 32) >> 40 & 0xff_ffff) as f32 / (1u32 << 24) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::ReferenceCaster;
    use crate::testing::sample::Sample;

    #[test]
    fn directions_are_those_of_a_matt_surface() {
        for count in [1, 16, 256, 1000] {
            let directions = hemisphere(count);
            assert_eq!(directions.len(), count as usize);
            assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-5 && d.z > 0.0));
        }
        let directions = hemisphere(1000);
        let mean = directions.iter().sum::<Vec3>() / 1000.0;
        // The mean cosine of such a distribution is 2/3.
        assert!((mean - Vec3::new(0.0, 0.0, 2.0 / 3.0)).length() < 0.01, "{mean}");
        let close = directions.windows(2).filter(|d| d[0].dot(d[1]) > 0.8).count();
        assert!(close > 900, "{close}");
    }

    #[test]
    fn settings_and_octrees_that_make_no_sense_are_errors() {
        let octree = Sample::plain(3, true).octree().expect("assembles");
        let mut caster = ReferenceCaster::default();
        let mut message = |change: fn(&mut AmbientSettings)| {
            let mut settings = AmbientSettings::default();
            change(&mut settings);
            Ambient::compute(&octree, &mut caster, &settings, &mut |_| ()).err().map(|e| e.to_string())
        };
        assert_eq!(message(|s| s.rays = 0).as_deref(), Some("rays is 0: it must be between 1 and 65536"));
        let radius = "radius is NaN: it must be above 0 and at most 4 times the scene";
        assert_eq!(message(|s| s.radius = f64::NAN).as_deref(), Some(radius));
        assert_eq!(
            message(|_| ()).as_deref(),
            Some("the octree has no normals, so it has no outside; build it with normals")
        );
    }
}
