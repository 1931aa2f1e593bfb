//! Lights of a scene, and the shadows of what stands before them.

use glam::DVec3;

use crate::attributes::{own_normal, voxel_ambient, voxel_color};
use crate::exact::CameraRays;
use crate::shading::{AMBIENT, DIFFUSE, Lamp, Surface, objects_of, phong, seen_side};
use crate::{CastError, Caster, Hit, HitPoint, Nearest, Object, Picture, Ray, Rays, View};

/// A light, in mesh space. Its strength is that of the lamp of [`shade`](crate::shading::shade), at every distance.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Light {
    /// So far away that its light comes from one direction.
    Directional {
        /// Direction from the scene to the light, of any length above 0.
        to_light: DVec3,
    },
    /// Shines in all directions.
    Point {
        /// Where it is.
        position: DVec3,
    },
    /// Shines in a cone.
    Spot {
        /// Where it is.
        position: DVec3,
        /// The axis of the cone, of any length above 0.
        direction: DVec3,
        /// Full angle of the cone in degrees, more than 0. The outer fifth fades out.
        angle_degrees: f64,
    },
    /// Light from all directions alike, of which a voxel gets the share that its stored ambient occlusion lets through, and all
    /// without that. It casts no shadow and makes no highlight.
    Sky,
}

impl Light {
    /// From a point: the unit vector to the light, its distance in mesh units, and the share of its strength that comes here.
    /// `None` if nothing does, and for the sky, whose light has no direction.
    fn toward(&self, point: DVec3) -> Option<(DVec3, f64, f32)> {
        let (way, distance) = match self {
            Self::Sky => return None,
            Self::Directional { to_light } => (*to_light, f64::INFINITY),
            Self::Point { position } | Self::Spot { position, .. } => (*position - point, position.distance(point)),
        };
        let way = unit(way)?;
        let share = match self {
            Self::Spot { direction, angle_degrees, .. } => {
                let off_axis = (-way).angle_between(unit(*direction)?).to_degrees();
                ((1.0 - 2.0 * off_axis / angle_degrees) * 5.0).clamp(0.0, 1.0)
            }
            _ => 1.0,
        };
        (share > 0.0).then_some((way, distance, share as f32))
    }
}

/// A vector of any length above 0 as one of length 1, also where the square of its length is no number.
pub fn unit(vector: DVec3) -> Option<DVec3> {
    (vector / vector.abs().max_element()).try_normalize()
}

/// What is seen in a pixel.
struct Seen<'a> {
    ray: Ray,
    hit: &'a Hit,
    /// Number of its view and object.
    number: usize,
    to_eye: DVec3,
    normal: DVec3,
}

/// A point that a light shines on, unless something is between them.
struct LitPoint {
    /// Number of its pixel in the band.
    i: usize,
    /// Number of its object.
    number: usize,
    position: DVec3,
    /// The ray to the light, for its own object.
    own_ray: Ray,
    way: DVec3,
    distance: f64,
    share: f32,
}

/// A sphere around the root cube of an object.
struct Sphere {
    middle: DVec3,
    radius: f64,
}

impl Sphere {
    fn around(object: &Object) -> Self {
        let corner = |i: u32| object.from_cast(DVec3::from(std::array::from_fn(|axis| 1.0 + f64::from(i >> axis & 1))));
        let middle = object.from_cast(DVec3::splat(1.5));
        Self { middle, radius: (0..8).map(|i| corner(i).distance(middle)).fold(0.0, f64::max) }
    }

    /// Whether a ray from `position` along a unit vector can meet it, with a margin for the rounding of rays.
    fn may_be_met(&self, position: DVec3, way: DVec3) -> bool {
        let to_middle = self.middle - position;
        let ahead = to_middle.dot(way);
        let reach = self.radius * 1.001 + to_middle.length() * 1e-5;
        // Also if the comparison is of NaN.
        !(ahead < -reach || (to_middle - way * ahead).length_squared() > reach * reach)
    }
}

/// Rows whose shadow rays are cast together: bounds the memory for them.
const ROWS: u32 = 32;

/// The objects of an octree as by [`shade_nearest`](crate::shading::shade_nearest), but lit by these lights. With `shadows`,
/// rays as of [`HitPoint::shadow_ray`] are cast, against every object.
///
/// # Errors
/// Those of [`Caster::cast_rays`]: among others, the caster has loaded another octree, or none.
///
/// # Panics
/// `nearest` are not the hits of this octree and of these views.
pub fn shade_lit(
    caster: &mut dyn Caster,
    octree: &esvo_format::Octree,
    views: &[View],
    nearest: &Nearest,
    lights: &[Light],
    shadows: bool,
) -> Result<Picture, CastError> {
    shade_placed_lit(caster, &objects_of(octree, views), views, nearest, lights, shadows)
}

/// The same of objects that may have been [placed](Object::placed): one for each view.
///
/// # Errors
/// As [`shade_lit`].
///
/// # Panics
/// `nearest` are not the hits of these objects and of these views.
pub fn shade_placed_lit(
    caster: &mut dyn Caster,
    objects: &[Object],
    views: &[View],
    nearest: &Nearest,
    lights: &[Light],
    shadows: bool,
) -> Result<Picture, CastError> {
    let cameras: Vec<_> =
        views.iter().zip(objects).map(|(view, object)| CameraRays::of_view(view, *object.octree_to_mesh())).collect();
    let spheres: Vec<_> = objects.iter().map(Sphere::around).collect();
    let lamp = Lamp::new(&cameras[0]);
    let sky = lights.iter().filter(|light| matches!(light, Light::Sky)).count() as f32 * DIFFUSE;
    let (width, height) = (views[0].width, views[0].height);
    let mut rgb8 = Vec::with_capacity(3 * width as usize * height as usize);
    for top in (0..height).step_by(ROWS as usize) {
        let rows = ROWS.min(height - top);
        let pixel_at = |x: u32, y: u32| (top + y) as usize * width as usize + x as usize;
        // The surface of a pixel, and its ray.
        let at = |x: u32, y: u32| {
            let pixel = pixel_at(x, y);
            let (hit, number) = (&nearest.hits[pixel], nearest.views[pixel] as usize);
            let ray = views[number].ray(x, top + y);
            let to_eye = -cameras[number].ray(x, top + y).direction.normalize_or_zero();
            (!hit.is_miss()).then(|| {
                let normal = seen_side(own_normal(&objects[number], &ray, hit), to_eye);
                Seen { ray, hit, number, to_eye, normal }
            })
        };
        // What each light adds.
        let mut lit = vec![Vec::new(); width as usize * rows as usize];
        for light in lights {
            let mut lit_points = Vec::new();
            for (i, (x, y)) in (0..rows).flat_map(|y| (0..width).map(move |x| (x, y))).enumerate() {
                let Some(seen) = at(x, y) else { continue };
                let Some(point) = HitPoint::new(&objects[seen.number], &seen.ray, seen.hit) else { continue };
                let position = point.position();
                let Some((way, distance, share)) = light.toward(position) else { continue };
                if seen.normal.dot(way) <= 0.0 {
                    continue;
                }
                let own_ray = point.ray_to_light(way, distance);
                lit_points.push(LitPoint { i, number: seen.number, position, own_ray, way, distance, share });
            }
            let mut dark = vec![false; lit_points.len()];
            for (number, (object, sphere)) in objects.iter().zip(&spheres).enumerate().filter(|_| shadows) {
                let mut numbers = Vec::new();
                let mut list = Vec::new();
                for (k, point) in lit_points.iter().enumerate().filter(|(k, _)| !dark[*k]) {
                    if point.number == number {
                        list.push(point.own_ray);
                    } else if sphere.may_be_met(point.position, point.way) {
                        list.push(object.ray(point.position, point.way, 0.0..point.distance));
                    } else {
                        continue;
                    }
                    numbers.push(k);
                }
                if list.is_empty() {
                    continue;
                }
                let mut hits = Vec::new();
                caster.cast_rays(&Rays { root: object.root(), contours: object.contours(), rays: &list }, &mut hits)?;
                numbers.iter().zip(&hits).for_each(|(k, hit)| dark[*k] |= !hit.is_miss());
            }
            for (LitPoint { i, way, share, .. }, dark) in lit_points.into_iter().zip(dark) {
                if !dark {
                    lit[i].push((way, share));
                }
            }
        }
        let band = Picture::from_fn_on_all_cores((width, rows), |x, y| {
            let Some(Seen { ray, hit, to_eye, normal, number }) = at(x, y) else { return lamp.sky(top + y) };
            let octree = objects[number].octree();
            let surface = Surface { normal, color: voxel_color(octree, &ray, hit) };
            let open = voxel_ambient(octree, hit);
            let (mut diffuse, mut specular) = (open * (AMBIENT + sky), 0.0);
            for (way, share) in &lit[y as usize * width as usize + x as usize] {
                let (scattered, highlight) = phong(normal, to_eye, *way);
                diffuse += open * share * scattered;
                specular += share * highlight;
            }
            surface.shown(diffuse, specular, octree.emission(hit.slot, hit.child()))
        });
        rgb8.extend(band.rgb8);
    }
    Ok(Picture { width, height, rgb8 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CastOptions;
    use crate::camera::viewpoint::overview;
    use crate::reference::ReferenceCaster;
    use crate::shading::decode_srgb;
    use crate::testing::sample::two_objects_apart;

    /// An object above another one, and the sun above both.
    #[test]
    fn objects_cast_shadows_on_each_other() {
        let octree = two_objects_apart(1.5).expect("assembles");
        let mut caster = ReferenceCaster::default();
        caster.load(&octree).expect("is sound");
        let camera = overview(&octree, [0.0, 1.0, 0.0], 60.0, 1.0);
        let view = |object: usize| {
            let root = octree.objects()[object].root_slot as u32;
            View::new(&camera, octree.octree_to_mesh(object), root, (64, 64), &CastOptions::default())
                .expect("is valid")
        };
        let (both, alone) = ([view(0), view(1)], [view(0)]);
        let sun = [Light::Directional { to_light: octree.octree_to_mesh(0).transform_vector3(DVec3::Y) }];
        let nearest = Nearest::cast(&mut caster, &both).expect("is cast");
        let with = shade_lit(&mut caster, &octree, &both, &nearest, &sun, true).expect("is shaded");
        let below = Nearest::cast(&mut caster, &alone).expect("is cast");
        let without = shade_lit(&mut caster, &octree, &alone, &below, &sun, true).expect("is shaded");
        let brightness = |picture: &Picture, pixel: usize| -> u32 {
            picture.pixel(pixel as u32 % 64, pixel as u32 / 64).iter().map(|c| u32::from(*c)).sum()
        };
        let (mut shown, mut darker) = ([0, 0], 0);
        for (pixel, hit) in nearest.hits.iter().enumerate().filter(|(_, hit)| !hit.is_miss()) {
            let number = nearest.views[pixel] as usize;
            shown[number] += 1;
            if number == 0 && hit.same_voxel(&below.hits[pixel]) {
                let (with, without) = (brightness(&with, pixel), brightness(&without, pixel));
                assert!(with <= without, "{pixel}: another object makes no light");
                darker += usize::from(with + 30 < without);
            }
        }
        assert!(shown.iter().all(|pixels| *pixels > 50), "both are seen: {shown:?}");
        assert!(darker > 20, "{darker} of {shown:?} are in the shadow of the other object");
    }

    /// Each pixel gets what its voxel's ambient occlusion lets through, whatever way it faces.
    #[test]
    fn the_sky_lights_what_is_open_to_it() {
        let plain = two_objects_apart(1.5).expect("assembles");
        let camera = overview(&plain, [0.0, 1.0, 0.0], 60.0, 1.0);
        let green = |open: u8| {
            let octree = std::sync::Arc::new(plain.with_ambient_occlusion(|_, _| open).expect("is sound"));
            let root = octree.objects()[0].root_slot as u32;
            let view = View::new(&camera, octree.octree_to_mesh(0), root, (64, 64), &CastOptions::default());
            let views = [view.expect("is valid")];
            let mut caster = ReferenceCaster::default();
            caster.load(&octree).expect("is sound");
            let nearest = Nearest::cast(&mut caster, &views).expect("is cast");
            let picture = shade_lit(&mut caster, &octree, &views, &nearest, &[Light::Sky], true).expect("is shaded");
            let seen = nearest.hits.iter().enumerate().filter(|(_, hit)| !hit.is_miss());
            let seen = seen.map(|(pixel, hit)| {
                let (x, y) = (pixel as u32 % 64, pixel as u32 / 64);
                let color = decode_srgb(voxel_color(&octree, &views[0].ray(x, y), hit)[1]);
                (color, decode_srgb(f32::from(picture.pixel(x, y)[1]) / 255.0))
            });
            seen.collect::<Vec<_>>()
        };
        for open in [255u8, 100, 0] {
            let seen = green(open);
            assert!(seen.len() > 100);
            for (color, lit) in seen {
                let expected = color * f32::from(open) / 255.0 * (AMBIENT + DIFFUSE);
                assert!((lit - expected).abs() < 0.01, "{open}: {lit}, not {expected}");
            }
        }
    }

    #[test]
    fn lights_shine_where_they_should() {
        let sun = Light::Directional { to_light: DVec3::new(0.0, 3.0, 0.0) };
        assert_eq!(sun.toward(DVec3::splat(7.0)), Some((DVec3::Y, f64::INFINITY, 1.0)));
        let point = Light::Point { position: DVec3::new(0.0, 2.0, 0.0) };
        assert_eq!(point.toward(DVec3::ZERO), Some((DVec3::Y, 2.0, 1.0)));
        assert_eq!(point.toward(DVec3::new(0.0, 2.0, 0.0)), None, "in the light");
        let spot = Light::Spot { position: DVec3::new(0.0, 2.0, 0.0), direction: DVec3::NEG_Y, angle_degrees: 90.0 };
        let share = |x: f64| spot.toward(DVec3::new(x, 0.0, 0.0)).map_or(0.0, |(_, _, share)| share);
        assert_eq!((share(0.0), share(1.0), share(2.1), share(-9.0)), (1.0, 1.0, 0.0, 0.0));
        assert!(share(1.7) > 0.0 && share(1.7) < 1.0, "the edge is soft");
        assert_eq!(spot.toward(DVec3::new(0.0, 4.0, 0.0)), None, "behind it");
        for huge in [1e-320, 1e300] {
            let sun = Light::Directional { to_light: DVec3::Y * huge };
            assert_eq!(sun.toward(DVec3::ZERO), Some((DVec3::Y, f64::INFINITY, 1.0)));
        }
    }
}
