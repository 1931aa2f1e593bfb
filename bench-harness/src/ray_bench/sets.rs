//! The rays that are cast.

use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::sample::Noise;
use esvo_core::{CastError, Caster, Hit, HitPoint, Object, Ray, View};
use glam::DVec3;

use super::SetRow;

/// Rays of the short lists.
const FEW: usize = 1000;
/// Length of the rays of ambient occlusion: this share of the diagonal of the mesh's bounds.
const AMBIENT: f64 = 0.05;

/// A set of rays, and the reference's hits.
pub(super) struct Set {
    pub(super) row: SetRow,
    work: Work,
    pub(super) expected: Vec<Hit>,
}

enum Work {
    Picture(View),
    List(Vec<Ray>),
    /// Each ray is a list of its own.
    OneByOne(Vec<Ray>),
}

impl Set {
    fn new(name: &str, work: Work, reference: &mut ReferenceCaster, object: &Object) -> Result<Self, CastError> {
        let (rays, calls) = match &work {
            Work::Picture(view) => (view.pixels(), 1),
            Work::List(rays) => (rays.len(), 1),
            Work::OneByOne(rays) => (rays.len(), rays.len()),
        };
        let row = SetRow { name: name.into(), rays: rays as u64, calls: calls as u64, hits: 0 };
        let mut set = Self { row, work, expected: Vec::new() };
        let mut expected = Vec::new();
        set.cast(reference, object, &mut expected)?;
        set.row.hits = expected.iter().filter(|hit| !hit.is_miss()).count() as u64;
        set.expected = expected;
        Ok(set)
    }

    /// Casts the rays by an engine that has loaded the octree.
    pub(super) fn cast(&self, caster: &mut dyn Caster, object: &Object, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        match &self.work {
            Work::Picture(view) => caster.cast(view, hits),
            Work::List(rays) => caster.cast_rays(&object.rays(rays), hits),
            Work::OneByOne(rays) => {
                let mut one = Vec::new();
                hits.clear();
                rays.chunks(1).try_for_each(|ray| {
                    caster.cast_rays(&object.rays(ray), &mut one)?;
                    hits.append(&mut one);
                    Ok(())
                })
            }
        }
    }
}

/// All sets. `bounds` are those of the mesh; the reference has loaded the octree.
pub(super) fn all(
    object: &Object,
    view: &View,
    bounds: [[f64; 3]; 2],
    rays: usize,
    reference: &mut ReferenceCaster,
) -> Result<Vec<Set>, CastError> {
    let picture = Set::new("picture", Work::Picture(*view), reference, object)?;
    let pixels: Vec<Ray> = (0..view.height).flat_map(|y| (0..view.width).map(move |x| view.ray(x, y))).collect();
    let shadow = shadow_rays(object, &pixels, &picture.expected);
    let diagonal = (DVec3::from(bounds[1]) - DVec3::from(bounds[0])).length();
    let ambient = scattered(object, &pixels, &picture.expected, AMBIENT * diagonal, 3);
    let bounce = scattered(object, &pixels, &picture.expected, f64::INFINITY, 4);
    let few = incoherent(object, bounds, FEW, 1);
    let lists = [
        ("the picture's rays", Work::List(pixels)),
        ("shadow rays", Work::List(shadow)),
        ("ambient occlusion", Work::List(ambient)),
        ("diffuse bounce", Work::List(bounce)),
        ("incoherent, few", Work::List(few.clone())),
        ("few, one by one", Work::OneByOne(few)),
        ("incoherent, many", Work::List(incoherent(object, bounds, rays, 2))),
    ];
    let mut sets = vec![picture];
    for (name, work) in lists {
        sets.push(Set::new(name, work, reference, object)?);
    }
    Ok(sets)
}

/// Rays from anywhere in the bounds of the mesh in any direction, without end: neighbours have nothing in common.
fn incoherent(object: &Object, [low, high]: [[f64; 3]; 2], count: usize, seed: u64) -> Vec<Ray> {
    let mut noise = Noise(seed);
    let mut vector = || DVec3::from(std::array::from_fn(|_| noise.number()));
    let (low, high) = (DVec3::from(low), DVec3::from(high));
    let ray = |_| {
        let origin = low + (high - low) * vector();
        // Equally dense in all directions.
        let direction = std::iter::repeat_with(|| vector() * 2.0 - 1.0).find(|v| (1e-3..1.0).contains(&v.length()));
        object.ray(origin, direction.unwrap_or(DVec3::X), 0.0..f64::INFINITY)
    };
    (0..count).map(ray).collect()
}

/// From each hit to a lamp in the middle of the root cube.
fn shadow_rays(object: &Object, rays: &[Ray], hits: &[Hit]) -> Vec<Ray> {
    let lamp = object.octree_to_mesh().transform_point3(DVec3::splat(0.5));
    let points = rays.iter().zip(hits).filter_map(|(ray, hit)| HitPoint::new(object, ray, hit));
    points
        .map(|point| {
            let way = lamp - point.position();
            point.next_ray(way, way.length())
        })
        .collect()
}

/// One ray from each hit, of at most this length in mesh units, into the hemisphere around the normal. As for a surface that scatters light
/// equally in all directions, their density is proportional to the cosine of the angle to the normal.
fn scattered(object: &Object, rays: &[Ray], hits: &[Hit], length: f64, seed: u64) -> Vec<Ray> {
    let mut noise = Noise(seed);
    let points = rays.iter().zip(hits).filter_map(|(ray, hit)| HitPoint::new(object, ray, hit));
    points
        .map(|point| {
            let around = around(point.normal(), [noise.number(), noise.number()]);
            point.next_ray(around, length)
        })
        .collect()
}

/// A direction around a unit normal, of two numbers from 0 to 1.
fn around(normal: DVec3, [first, second]: [f64; 2]) -> DVec3 {
    let (right, up) = normal.any_orthonormal_pair();
    let (radius, angle) = (first.sqrt(), std::f64::consts::TAU * second);
    let height = (1.0 - first).max(1e-6).sqrt();
    right * (radius * angle.cos()) + up * (radius * angle.sin()) + normal * height
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scattered_rays_are_denser_around_the_normal() {
        let normal = DVec3::new(1.0, -2.0, 0.5).normalize();
        let mut noise = Noise(5);
        let cosines: Vec<f64> = (0..20_000)
            .map(|_| around(normal, [noise.number(), noise.number()]))
            .map(|way| way.normalize().dot(normal))
            .collect();
        assert!(cosines.iter().all(|cosine| *cosine > 0.0));
        // The mean cosine of such a distribution is 2/3, and that of an even one is 1/2.
        let mean = cosines.iter().sum::<f64>() / cosines.len() as f64;
        assert!((mean - 2.0 / 3.0).abs() < 0.01, "{mean}");
    }
}
