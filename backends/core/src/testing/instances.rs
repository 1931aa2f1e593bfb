//! Many placed objects for tests of [`Caster::cast_instances`], and a comparison with each of them cast alone.

use esvo_format::Octree;
use glam::{DMat4, DQuat, DVec3};

use crate::testing::compare::Comparison;
use crate::testing::sample::{Noise, cameras};
use crate::{Camera, CastError, CastOptions, Caster, Instances, Nearest, View};

/// A camera that looks at what [`moving`] places, from outside or from its middle.
pub fn camera(inside: bool) -> Camera {
    let (eye, forward, far) =
        if inside { ([0.1, 0.2, 0.3], [0.6, -0.2, -1.0], 12.0) } else { ([7.0, 4.0, 8.0], [-7.0, -4.2, -8.0], 24.0) };
    Camera { eye, forward, up: [0.0, 1.0, 0.0], fov_degrees: 60.0, near: far * 1e-4, far }
}

/// Where `count` objects are in one frame, in mesh space: each turns and moves on a way of its own, among its neighbours and
/// through them. Some are mirrored, some stretched, some sheared. Every tenth is where the one before it is.
pub fn moving(count: usize, frame: u32) -> Vec<DMat4> {
    let mut noise = Noise(11);
    let mut places: Vec<DMat4> = Vec::with_capacity(count);
    for number in 0..count {
        let mut number_in = |low: f64, high: f64| low + (high - low) * noise.number();
        let mut vector = |half: f64| DVec3::from(std::array::from_fn(|_| number_in(-half, half)));
        let (middle, way, axis) = (vector(3.5), vector(0.6), vector(1.0));
        let (speed, size) = (number_in(0.2, 0.9), number_in(0.4, 1.6));
        let at = f64::from(frame) * speed;
        let stretched = match number % 7 {
            0 => DVec3::new(1.0, 0.3, 2.0),
            1 => DVec3::new(-1.0, 1.0, 1.0),
            2 => DVec3::new(-1.0, -0.5, -1.0),
            _ => DVec3::ONE,
        };
        let mut sheared = DMat4::IDENTITY;
        if number % 7 == 3 {
            sheared.y_axis.x = 0.8;
            sheared.z_axis.y = -0.4;
        }
        let turned = DQuat::from_axis_angle(axis.try_normalize().unwrap_or(DVec3::Y), at + number as f64);
        let place = DMat4::from_translation(middle + way * at.sin())
            * DMat4::from_quat(turned)
            * sheared
            * DMat4::from_scale(stretched * size)
            * DMat4::from_translation(DVec3::splat(-0.5));
        places.push(match places.last() {
            Some(before) if number % 10 == 9 => *before,
            _ => place,
        });
    }
    places
}

/// The views of objects of an octree at these places, by one camera: object `i` modulo the number of objects, but each tenth
/// the object before it.
///
/// # Errors
/// A camera or options out of range.
pub fn views(
    octree: &Octree,
    places: &[DMat4],
    camera: &Camera,
    size: (u32, u32),
    options: &CastOptions,
) -> Result<Vec<View>, CastError> {
    let objects = octree.objects();
    let root = |number: usize| objects[(number - usize::from(number % 10 == 9)) % objects.len()].root_slot as u32;
    (0..).zip(places).map(|(number, place)| View::new(camera, *place, root(number), size, options)).collect()
}

/// Places that are unlike what a scene has: minute, huge, flat, thin, almost without volume, sheared beyond measure, mirrored,
/// around the eye of the first of the [`cameras`], behind it, along its axes, far away; and some plain ones among them.
pub fn extreme() -> Vec<DMat4> {
    let eye = DVec3::from(cameras()[0].eye);
    let forward = DVec3::from(cameras()[0].forward).normalize();
    let around = |point: DVec3, scale: DVec3| {
        DMat4::from_translation(point) * DMat4::from_scale(scale) * DMat4::from_translation(DVec3::splat(-0.5))
    };
    let ahead = |distance: f64| eye + forward * distance;
    let sheared = |x: f64, y: f64| {
        let mut sheared = DMat4::IDENTITY;
        (sheared.y_axis.x, sheared.z_axis.x) = (x, y);
        sheared
    };
    let mut places = vec![DMat4::IDENTITY, around(ahead(1.0), DVec3::splat(0.2))];
    for scale in [1e-8, 1e-5, 1e-3, 0.02, 30.0, 1e4, 1e8] {
        places.push(around(ahead(0.8), DVec3::splat(scale)));
        places.push(around(eye, DVec3::splat(scale)));
        places.push(around(ahead(0.5), DVec3::new(1.0, scale, 1.0)));
        places.push(around(ahead(1.5), DVec3::new(scale, scale, 0.5)));
        places.push(around(ahead(1.2), DVec3::new(-1.0, scale, -scale)));
        places.push(around(ahead(1.1), DVec3::ONE) * sheared(scale, -scale));
        places.push(around(ahead(scale), DVec3::splat(0.5 * scale)));
        places.push(around(ahead(-scale), DVec3::splat(scale)));
        places.push(around(eye + DVec3::X * scale, DVec3::splat(1.5 * scale)));
    }
    let forward = DQuat::from_rotation_arc(DVec3::NEG_Z, forward);
    places.push(DMat4::from_translation(eye) * DMat4::from_quat(forward) * around(DVec3::NEG_Z, DVec3::ONE));
    places.push(DMat4::from_translation(eye) * DMat4::from_quat(forward) * around(DVec3::ZERO, DVec3::splat(0.01)));
    places
}

/// Compares hits with those of each view cast alone, the nearest taken. A hit of another view counts as one of another voxel.
///
/// # Errors
/// What the caster said.
pub fn against_each_alone(caster: &mut dyn Caster, views: &[View]) -> Result<Comparison, CastError> {
    let alone = Nearest::cast(caster, views)?;
    let mut together = Nearest::default();
    caster.cast_instances(&Instances::new(views.to_vec())?, &mut together)?;
    Ok(compare(&together, &alone))
}

/// The comparison of [`against_each_alone`].
pub fn compare(ours: &Nearest, theirs: &Nearest) -> Comparison {
    let pixels = ours.hits.iter().zip(&theirs.hits).zip(ours.views.iter().zip(&theirs.views));
    let elsewhere = pixels.filter(|((a, b), (mine, other))| a.same_voxel(b) && mine != other).count() as u64;
    let mut found = Comparison::of(&ours.hits, &theirs.hits);
    found.other_voxel += elsewhere;
    found.other_size += u64::from(ours.views.len() != theirs.views.len() || ours.views.len() != ours.hits.len());
    found
}
