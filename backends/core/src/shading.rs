//! Pictures of hits: shaded, and as maps of iterations, normals and depth.
//!
//! Octrees and triangles are shaded in the same way, with the same light in mesh space, so that pictures of both can be
//! compared pixel by pixel. Colours are decoded from sRGB, lit in linear light and encoded again.

use esvo_format::Octree;
pub use esvo_format::srgb::{decode as decode_srgb, encode as encode_srgb};
use glam::{DMat4, DVec3};

pub use crate::attributes::{PLAIN_COLOR, voxel_ambient, voxel_color, voxel_normal};
use crate::attributes::{facing_normal, own_normal};
use crate::exact::{CameraRays, TriangleHit};
use crate::filter::{code_at, code_of};
use crate::{Hit, Nearest, Object, Picture, View};

/// A surface at a point.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Surface {
    /// Normal in mesh space, any length; either side may face the viewer. Zero: lit as if it faced the viewer.
    pub normal: DVec3,
    /// Colour, sRGB-encoded, channels in `0.0..=1.0`.
    pub color: [f32; 3],
}

/// Light from all directions, as a share of the colour.
pub(crate) const AMBIENT: f32 = 0.18;
/// Light from the lamp that the surface scatters equally in all directions, as a share of the colour.
pub(crate) const DIFFUSE: f32 = 0.78;
/// Strength and exponent of the highlight.
const SPECULAR: (f32, f32) = (0.12, 24.0);
/// The sky at the top and at the bottom of the picture, sRGB-encoded.
const SKY: [[f32; 3]; 2] = [[0.45, 0.62, 0.87], [0.90, 0.93, 0.96]];

/// A lamp far away, above the left side of the camera, which moves with it.
pub(crate) struct Lamp {
    to_light: DVec3,
    height: u32,
}

impl Lamp {
    pub(crate) fn new(rays: &CameraRays) -> Self {
        let (right, down) = (rays.dx.normalize_or_zero(), rays.dy.normalize_or_zero());
        let forward = rays.direction(f64::from(rays.width) / 2.0, f64::from(rays.height) / 2.0).normalize_or_zero();
        Self { to_light: (-forward - right * 0.35 - down * 0.5).normalize_or_zero(), height: rays.height }
    }

    pub(crate) fn sky(&self, y: u32) -> [f32; 3] {
        let at = (y as f32 + 0.5) / self.height as f32;
        std::array::from_fn(|i| SKY[0][i] + (SKY[1][i] - SKY[0][i]) * at)
    }

    /// A surface under this lamp. `open` is the share of the light from all directions that reaches it. As in the authors'
    /// program it scales all scattered light and not the highlight.
    /// `glow` is what the surface emits, linear.
    fn lit(&self, surface: &Surface, open: f32, glow: [f32; 3], direction: DVec3) -> [f32; 3] {
        let to_eye = -direction.normalize_or_zero();
        let normal = mirrored(surface.normal, direction).try_normalize().unwrap_or(to_eye);
        let (diffuse, specular) = phong(normal, to_eye, self.to_light);
        surface.shown(open * (AMBIENT + diffuse), specular, glow)
    }
}

impl Surface {
    /// Its colour, sRGB-encoded: this much light is scattered, this much is reflected, and this much, linear, is emitted.
    pub(crate) fn shown(&self, diffuse: f32, specular: f32, glow: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|k| encode_srgb(decode_srgb(self.color[k]) * diffuse + specular + glow[k]))
    }
}

/// Phong's model: what a surface scatters and reflects of a light. All directions have length 1.
pub(crate) fn phong(normal: DVec3, to_eye: DVec3, to_light: DVec3) -> (f32, f32) {
    let toward = normal.dot(to_light);
    let mirrored = normal * (2.0 * toward) - to_light;
    let specular =
        if toward > 0.0 { SPECULAR.0 * (mirrored.dot(to_eye).max(0.0) as f32).powf(SPECULAR.1) } else { 0.0 };
    (DIFFUSE * toward.max(0.0) as f32, specular)
}

/// The unit normal of the side that is seen: turned around if it points away from the viewer by more than 15 degrees. One that
/// points away by less is that of a voxel at a silhouette, which reaches beyond it. `to_eye` for a normal without length.
pub(crate) fn seen_side(normal: DVec3, to_eye: DVec3) -> DVec3 {
    /// Sine of 15 degrees.
    const BEYOND: f64 = 0.2588;
    let normal = normal.try_normalize().unwrap_or(to_eye);
    if normal.dot(to_eye) < -BEYOND { -normal } else { normal }
}

/// The normal, mirrored to the viewer's side if it points away: its angle to the ray and its direction across the ray stay.
/// Voxels at a silhouette reach beyond it, with normals that point slightly away. Reversed normals would make such voxels
/// bright where their neighbours are dark.
fn mirrored(normal: DVec3, direction: DVec3) -> DVec3 {
    let away = normal.dot(direction);
    if away > 0.0 { normal - direction * (2.0 * away / direction.length_squared()) } else { normal }
}

/// Octree space to mesh space of the object that `view` shows: the object of its root, else the first.
pub fn octree_to_mesh(octree: &Octree, view: &View) -> DMat4 {
    let object = octree.objects().iter().position(|o| o.root_slot == u64::from(view.root)).unwrap_or(0);
    octree.octree_to_mesh(object)
}

/// The octree, shaded: a lamp at the camera, the colours and normals of the voxels, a sky where nothing was hit.
///
/// # Panics
/// `hits` are not those of this octree and view.
pub fn shade(octree: &Octree, view: &View, hits: &[Hit]) -> Picture {
    shade_all(&[Object::of_view(octree, view)], std::slice::from_ref(view), hits, |_| 0)
}

/// The objects of an octree, shaded as by [`shade`]: the nearest hits over these views.
///
/// # Panics
/// `nearest` are not the hits of this octree and of these views.
pub fn shade_nearest(octree: &Octree, views: &[View], nearest: &Nearest) -> Picture {
    shade_placed(&objects_of(octree, views), views, nearest)
}

/// The same of objects that may have been [placed](Object::placed): one for each view.
///
/// # Panics
/// `nearest` are not the hits of these objects and of these views.
pub fn shade_placed(objects: &[Object], views: &[View], nearest: &Nearest) -> Picture {
    shade_all(objects, views, &nearest.hits, |pixel| nearest.views[pixel] as usize)
}

/// The object of each view.
pub(crate) fn objects_of<'a>(octree: &'a Octree, views: &[View]) -> Vec<Object<'a>> {
    views.iter().map(|view| Object::of_view(octree, view)).collect()
}

/// `view_of`: the number of the view of a pixel's hit.
fn shade_all(objects: &[Object], views: &[View], hits: &[Hit], view_of: impl Fn(usize) -> usize + Sync) -> Picture {
    let rays: Vec<_> =
        views.iter().zip(objects).map(|(view, object)| CameraRays::of_view(view, *object.octree_to_mesh())).collect();
    let lamp = Lamp::new(&rays[0]);
    Picture::from_fn_on_all_cores((views[0].width, views[0].height), |x, y| {
        let pixel = y as usize * views[0].width as usize + x as usize;
        let hit = &hits[pixel];
        if hit.is_miss() {
            return lamp.sky(y);
        }
        let number = view_of(pixel);
        let (ray, object) = (views[number].ray(x, y), &objects[number]);
        let color = voxel_color(object.octree(), &ray, hit);
        let surface = Surface { normal: own_normal(object, &ray, hit), color };
        let glow = object.octree().emission(hit.slot, hit.child());
        lamp.lit(&surface, voxel_ambient(object.octree(), hit), glow, rays[number].ray(x, y).direction)
    })
}

/// The triangles, shaded in the same way; `surface` gives the surface of a triangle at a point in mesh space.
///
/// # Panics
/// There are fewer hits than pixels.
pub fn shade_triangles(
    rays: &CameraRays,
    hits: &[TriangleHit],
    mut surface: impl FnMut(u32, DVec3) -> Surface,
) -> Picture {
    let lamp = Lamp::new(rays);
    Picture::from_fn((rays.width, rays.height), |x, y| {
        let hit = &hits[y as usize * rays.width as usize + x as usize];
        if hit.is_miss() {
            return lamp.sky(y);
        }
        let ray = rays.ray(x, y);
        lamp.lit(&surface(hit.triangle, ray.origin + ray.direction * hit.t), 1.0, [0.0; 3], ray.direction)
    })
}

/// Iterations of every ray as [heat]; `most` and more are white.
///
/// # Panics
/// There are fewer hits than pixels.
pub fn iteration_map(view: &View, hits: &[Hit], most: u32) -> Picture {
    Picture::from_fn((view.width, view.height), |x, y| {
        heat(hits[y as usize * view.width as usize + x as usize].iterations as f32 / most.max(1) as f32)
    })
}

/// Normals that face the viewer, in mesh space: components from -1 to 1 become red, green and blue. Misses are black.
///
/// # Panics
/// `nearest` are not the hits of this octree and of these views.
pub fn normal_map(octree: &Octree, views: &[View], nearest: &Nearest) -> Picture {
    normal_map_placed(&objects_of(octree, views), views, nearest)
}

/// The same of objects that may have been [placed](Object::placed): one for each view.
///
/// # Panics
/// `nearest` are not the hits of these objects and of these views.
pub fn normal_map_placed(objects: &[Object], views: &[View], nearest: &Nearest) -> Picture {
    Picture::from_fn_on_all_cores((views[0].width, views[0].height), |x, y| {
        let pixel = y as usize * views[0].width as usize + x as usize;
        let hit = &nearest.hits[pixel];
        if hit.is_miss() {
            return [0.0; 3];
        }
        let number = nearest.views[pixel] as usize;
        let normal = facing_normal(&objects[number], &views[number].ray(x, y), hit);
        normal.as_vec3().to_array().map(|c| c * 0.5 + 0.5)
    })
}

/// Levels of the hit voxels as [heat], from level 1 (black) to `deepest` (white); misses are black.
///
/// # Panics
/// There are fewer hits than pixels.
pub fn level_map(view: &View, hits: &[Hit], deepest: u32) -> Picture {
    Picture::from_fn((view.width, view.height), |x, y| {
        let hit = &hits[y as usize * view.width as usize + x as usize];
        let level = if hit.is_miss() { 0 } else { hit.level() };
        heat(level as f32 / deepest.max(1) as f32)
    })
}

/// Sizes of the hit voxels in pixels as [heat] of their logarithm, from one pixel or less (black) to 64 (white); misses are black.
///
/// # Panics
/// `nearest` are not the hits of these views.
pub fn size_map(views: &[View], nearest: &Nearest) -> Picture {
    Picture::from_fn((views[0].width, views[0].height), |x, y| {
        let pixel = y as usize * views[0].width as usize + x as usize;
        let code = code_at(&views[nearest.views[pixel] as usize], &nearest.hits[pixel]);
        heat(f32::from(code) / code_of(64.0) as f32)
    })
}

/// Stored ambient occlusion: the share of the light from all directions that reaches the surface, black to white. Misses are black.
///
/// # Panics
/// `hits` are not those of this octree and view.
pub fn ambient_map(octree: &Octree, view: &View, hits: &[Hit]) -> Picture {
    Picture::from_fn((view.width, view.height), |x, y| {
        let hit = &hits[y as usize * view.width as usize + x as usize];
        if hit.is_miss() { [0.0; 3] } else { [voxel_ambient(octree, hit); 3] }
    })
}

/// Components of a voxel that a picture can show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    /// Emitted light as a colour; what is brighter than white is white.
    Emission,
    /// Roughness, from black (smooth) to white.
    Roughness,
    /// Metalness, from black to white (metal).
    Metalness,
    /// Opacity, from black (invisible) to white.
    Opacity,
    /// A colour of its own for each material; that of number 0 is grey.
    Material,
}

/// A component of the hit voxels; misses are black.
///
/// # Panics
/// `nearest` are not the hits of these objects and of these views.
pub fn component_map_placed(objects: &[Object], views: &[View], nearest: &Nearest, shown: Component) -> Picture {
    Picture::from_fn_on_all_cores((views[0].width, views[0].height), |x, y| {
        let pixel = y as usize * views[0].width as usize + x as usize;
        let hit = &nearest.hits[pixel];
        if hit.is_miss() {
            return [0.0; 3];
        }
        let (octree, slot, child) = (objects[nearest.views[pixel] as usize].octree(), hit.slot, hit.child());
        match shown {
            Component::Emission => octree.emission(slot, child).map(encode_srgb),
            Component::Roughness => [octree.roughness_metalness(slot, child)[0]; 3],
            Component::Metalness => [octree.roughness_metalness(slot, child)[1]; 3],
            Component::Opacity => [octree.opacity(slot, child); 3],
            Component::Material => own_color(octree.material(slot, child)),
        }
    })
}

/// A colour for a number, sRGB-encoded, so that neighbouring numbers look different.
fn own_color(number: u32) -> [f32; 3] {
    if number == 0 {
        return [0.5; 3];
    }
    // Hues by the golden ratio are far apart for any run of numbers.
    let hue = (f64::from(number) * 0.618_033_988_749_895).fract() as f32 * 6.0;
    let bright = if number.is_multiple_of(2) { 0.95 } else { 0.7 };
    [5.0, 3.0, 1.0].map(|turn: f32| {
        let at = (turn + hue) % 6.0;
        bright * (1.0 - 0.75 * at.min(4.0 - at).clamp(0.0, 1.0))
    })
}

/// Depth: white at the nearest hit of the picture, dark grey at the farthest, black where nothing was hit.
///
/// # Panics
/// There are fewer hits than pixels.
pub fn depth_map(view: &View, hits: &[Hit]) -> Picture {
    let depths = || hits.iter().filter(|hit| !hit.is_miss()).map(|hit| hit.raw_t);
    let (nearest, farthest) = (depths().fold(f32::MAX, f32::min), depths().fold(0.0, f32::max));
    Picture::from_fn((view.width, view.height), |x, y| {
        let hit = &hits[y as usize * view.width as usize + x as usize];
        if hit.is_miss() {
            return [0.0; 3];
        }
        let span = farthest - nearest;
        let at = if span > 0.0 { (hit.raw_t - nearest) / span } else { 0.0 };
        [1.0 - 0.85 * at; 3]
    })
}

/// A colour, sRGB-encoded, for a value from 0 (black) over violet, red and yellow to 1 (white). Other values are clamped. The
/// brightness rises with the value, so that the colours can be read in grey.
pub fn heat(value: f32) -> [f32; 3] {
    const STOPS: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.0], [0.2, 0.1, 0.45], [0.85, 0.2, 0.2], [1.0, 0.8, 0.1], [1.0, 1.0, 1.0]];
    let at = value.clamp(0.0, 1.0) * (STOPS.len() - 1) as f32;
    let stop = (at as usize).min(STOPS.len() - 2);
    let part = at - stop as f32;
    std::array::from_fn(|i| STOPS[stop][i] + (STOPS[stop + 1][i] - STOPS[stop][i]) * part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attributes::facing;
    use crate::camera::viewpoint::overview;
    use crate::reference::{ReferenceCaster, cast_fine};
    use crate::testing::sample::two_objects_apart;
    use crate::{Camera, CastOptions, Caster};
    use esvo_format::file::attachment;
    use esvo_format::{
        AssembleOptions, Column, ComponentFormat, Contour, CornerValue, NodeCorners, RawNormal, Tree, Voxel, assemble,
    };
    use glam::Vec3;

    const SIZE: (u32, u32) = (48, 32);

    /// One voxel, the child at the origin of the root cube, which spans 2 mesh units around zero.
    fn octree(voxel: Voxel) -> Octree {
        let mut tree = Tree::default();
        let mut children = [None; 8];
        children[0] = Some(Voxel { leaf: true, ..voxel });
        let root = tree.open(&children);
        tree.close(root);
        let to_mesh = DMat4::from_translation(DVec3::splat(-1.0)) * DMat4::from_scale(DVec3::splat(2.0));
        assemble(&tree, to_mesh, &AssembleOptions::default()).unwrap()
    }

    /// Looks along z at the lower corner.
    fn camera() -> Camera {
        Camera {
            eye: [-0.5, -0.5, -4.0],
            forward: [0.0, 0.0, 1.0],
            up: [0.0, 1.0, 0.0],
            fov_degrees: 30.0,
            near: 0.1,
            far: 10.0,
        }
    }

    fn view_and_hits(octree: &Octree) -> (View, Vec<Hit>) {
        let root = octree.objects()[0].root_slot as u32;
        let view = View::new(&camera(), octree.octree_to_mesh(0), root, SIZE, &CastOptions::default()).unwrap();
        let mut hits = Vec::new();
        cast_fine(octree, &view, &[], &mut hits);
        (view, hits)
    }

    #[test]
    fn a_voxel_is_shaded_in_its_colour_and_the_rest_is_sky() {
        let octree = octree(Voxel { color: Some([255, 0, 0]), ..Voxel::default() });
        let (view, hits) = view_and_hits(&octree);
        let picture = shade(&octree, &view, &hits);
        assert_eq!(picture.rgb8.len(), 3 * 48 * 32);
        let [r, g, b] = picture.pixel(24, 16);
        assert!(r > 200 && g < 120 && g == b, "{r} {g} {b}");
        let [top, bottom] = [picture.pixel(0, 0), picture.pixel(0, 31)];
        assert!(top[2] > top[0] && bottom[0] > top[0], "{top:?} {bottom:?}");
        // The voxel's side is 1 wide at depth 3, where the picture is 1.6 high: 20 of 32 pixels.
        assert_eq!(hits.iter().filter(|hit| !hit.is_miss()).count(), 20 * 20);
    }

    /// The voxel of [`octree`], grey, with components of all types.
    fn with_components(emission: [f64; 3]) -> Octree {
        let mut tree = Tree::default();
        for (kind, format) in [
            (attachment::EMISSION, ComponentFormat::EMISSION),
            (attachment::ROUGHNESS_METALNESS, ComponentFormat::ROUGHNESS_METALNESS),
            (attachment::OPACITY, ComponentFormat::OPACITY),
            (attachment::MATERIAL, ComponentFormat::MATERIAL),
        ] {
            tree.columns.push(Column::new(kind, format));
        }
        let mut children = [None; 8];
        children[0] = Some(Voxel { leaf: true, color: Some([100; 3]), ..Voxel::default() });
        let root = tree.open(&children);
        let numbers: [&[f64]; 4] = [&emission, &[0.2, 0.6], &[0.4], &[5.0]];
        for (column, numbers) in numbers.into_iter().enumerate() {
            let words = tree.columns[column].format.encode(numbers);
            tree.set_components(root, 0, column, &words);
        }
        tree.close(root);
        let to_mesh = DMat4::from_translation(DVec3::splat(-1.0)) * DMat4::from_scale(DVec3::splat(2.0));
        assemble(&tree, to_mesh, &AssembleOptions::default()).unwrap()
    }

    #[test]
    fn emission_is_added_to_what_is_lit() {
        let light = |emission: [f64; 3]| {
            let octree = with_components(emission);
            let (view, hits) = view_and_hits(&octree);
            let picture = shade(&octree, &view, &hits);
            assert_eq!(picture.pixel(0, 0), shade(&with_components([0.0; 3]), &view, &hits).pixel(0, 0), "the sky");
            picture.pixel(24, 16).map(|c| decode_srgb(f32::from(c) / 255.0))
        };
        let (dark, bright) = (light([0.0; 3]), light([0.0, 0.25, 8.0]));
        assert!((bright[0] - dark[0]).abs() < 1e-6 && (bright[1] - dark[1] - 0.25).abs() < 0.01, "{dark:?} {bright:?}");
        assert_eq!(bright[2], 1.0, "white is the brightest");
        assert!(dark[2] < 0.5);
    }

    #[test]
    fn components_are_shown() {
        let octree = with_components([0.0, 0.25, 8.0]);
        let (view, hits) = view_and_hits(&octree);
        let nearest = Nearest { views: vec![0; hits.len()], hits };
        let shown = |component| {
            let objects = [Object::of_view(&octree, &view)];
            let picture = component_map_placed(&objects, std::slice::from_ref(&view), &nearest, component);
            assert_eq!(picture.pixel(0, 0), [0; 3], "a miss");
            picture.pixel(24, 16)
        };
        assert_eq!(shown(Component::Emission), [0, 137, 255]);
        assert_eq!([shown(Component::Roughness), shown(Component::Metalness)], [[51; 3], [153; 3]]);
        assert_eq!(shown(Component::Opacity), [102; 3]);
        let colors: std::collections::BTreeSet<_> = (0..40).map(|n| own_color(n).map(|c| (c * 15.0) as u8)).collect();
        assert!(colors.len() > 35, "{} colours of 40 materials", colors.len());
        assert_eq!(shown(Component::Material), own_color(5).map(|c| (c * 255.0).round() as u8));
    }

    #[test]
    fn light_does_not_jump_where_a_surface_begins_to_point_away() {
        let rays = CameraRays::new(&camera(), SIZE).unwrap();
        let lamp = Lamp::new(&rays);
        let direction = rays.ray(24, 16).direction;
        let lit = |normal: DVec3| lamp.lit(&Surface { normal, color: [0.5; 3] }, 1.0, [0.0; 3], direction)[0];
        for across in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y] {
            let [before, beyond] = [-0.01, 0.01].map(|away| lit(across + direction.normalize() * away));
            assert!((before - beyond).abs() < 0.02, "{across}: {before} {beyond}");
        }
        assert!((lit(DVec3::NEG_X) - lit(DVec3::X)).abs() > 0.1, "the sides are lit differently");
    }

    #[test]
    fn the_picture_of_the_same_square_as_triangles_is_the_same() {
        let octree = octree(Voxel { color: Some([40, 160, 90]), ..Voxel::default() });
        let (view, hits) = view_and_hits(&octree);
        let rays = CameraRays::new(&camera(), SIZE).unwrap();
        let triangles: Vec<_> = (hits.iter())
            .map(|h| if h.is_miss() { TriangleHit::MISS } else { TriangleHit { t: 0.3, triangle: 5 } })
            .collect();
        let color = [40.0, 160.0, 90.0].map(|c: f32| c / 255.0);
        let surface = |triangle: u32, point: DVec3| {
            assert_eq!(triangle, 5);
            assert!((point.z - -1.0).abs() < 1e-9, "{point}");
            // The length of a normal does not change the picture.
            Surface { normal: DVec3::NEG_Z * 3.0, color }
        };
        let expected = shade_triangles(&rays, &triangles, surface);
        let worst = shade(&octree, &view, &hits).rgb8.iter().zip(&expected.rgb8).map(|(a, b)| a.abs_diff(*b)).max();
        // The colour of a single voxel is stored with at least 5 or 6 bits per channel.
        assert!(worst.unwrap() <= 6, "{worst:?}");
        let turned = shade_triangles(&rays, &triangles, |_, _| Surface { normal: DVec3::X, color });
        assert_ne!(turned, expected, "the normal matters");
    }

    #[test]
    fn ambient_occlusion_takes_from_what_is_scattered() {
        let bright = octree(Voxel { color: Some([40, 160, 90]), ..Voxel::default() });
        let (view, hits) = view_and_hits(&bright);
        let green = |octree: &Octree| decode_srgb(f32::from(shade(octree, &view, &hits).pixel(24, 16)[1]) / 255.0);
        assert_eq!(
            shade(&bright, &view, &hits),
            shade(&bright.with_ambient_occlusion(|_, _| 255).unwrap(), &view, &hits)
        );
        // Where no light reaches, only the highlight remains.
        let [all, half, none] = [255, 128, 0].map(|value| green(&bright.with_ambient_occlusion(|_, _| value).unwrap()));
        assert!(all > half + 0.05 && half > none + 0.05, "{all} {half} {none}");
        assert!((half - (all + none) / 2.0).abs() < 0.01, "{all} {half} {none}");
    }

    #[test]
    fn values_at_corners_are_interpolated_over_the_voxel() {
        let mut tree = Tree::default();
        let mut children = [None; 8];
        children[0] = Some(Voxel { leaf: true, ..Voxel::default() });
        let root = tree.open(&children);
        tree.close(root);
        // Black on the left side of the voxel, white on the right one, facing along z.
        let normal = RawNormal::encode(Vec3::NEG_Z);
        let value = |x: usize| CornerValue { color: [[0, 0, 0, 255], [255; 4], [9, 9, 9, 0]][x], normal };
        tree.corners = vec![NodeCorners { mask: (1 << 27) - 1, first: 0 }];
        tree.corner_values = (0..27).map(|point| value(point % 3)).collect();
        let to_mesh = DMat4::from_translation(DVec3::splat(-1.0)) * DMat4::from_scale(DVec3::splat(2.0));
        let octree = assemble(&tree, to_mesh, &AssembleOptions::default()).unwrap();
        let (view, hits) = view_and_hits(&octree);
        for x in 15..33 {
            let (ray, hit) = (view.ray(x, 16), &hits[16 * 48 + x as usize]);
            assert!(!hit.is_miss());
            let at = ((ray.origin + ray.direction * hit.raw_t).x - 1.0) * 2.0;
            let [red, ..] = voxel_color(&octree, &ray, hit);
            assert!((red - at).abs() < 2e-3, "{red} at {at}");
            assert_eq!(voxel_normal(&octree, &to_mesh, &ray, hit), DVec3::NEG_Z);
        }
    }

    #[test]
    fn plain_values_are_seen_as_they_are() {
        let mut tree = Tree::default();
        tree.plain = true;
        let mut children = [None; 8];
        let normal = RawNormal::encode(Vec3::new(0.3, 0.2, -0.9));
        children[0] = Some(Voxel { color: Some([13, 77, 201]), normal: Some(normal), leaf: true, ..Voxel::default() });
        children[7] = Some(Voxel { color: Some([1, 2, 3]), ..children[0].unwrap() });
        let root = tree.open(&children);
        tree.close(root);
        let octree = assemble(&tree, DMat4::IDENTITY, &AssembleOptions::default()).unwrap();
        let ray = view_and_hits(&octree).0.ray(24, 16);
        let hit = Hit::new(0.5, 2, 0, 22, 1);
        assert_eq!(voxel_color(&octree, &ray, &hit), [13.0, 77.0, 201.0].map(|c: f32| c / 255.0));
        assert_eq!(
            voxel_normal(&octree, &DMat4::IDENTITY, &ray, &hit),
            facing(normal.decode().as_dvec3(), ray.direction.as_dvec3()).normalize()
        );
    }

    #[test]
    fn normals_come_from_the_contour_or_the_side() {
        let to_mesh = DMat4::from_scale(DVec3::splat(2.0));
        let plain = octree(Voxel::default());
        let (view, hits) = view_and_hits(&plain);
        let at = 16 * 48 + 24;
        let normal = voxel_normal(&plain, &to_mesh, &view.ray(24, 16), &hits[at]);
        assert_eq!(normal, DVec3::NEG_Z);

        let bits = Contour::encode_normal([0.0, 1.0, 2.0]).unwrap();
        let contour = Contour::encode_bounds(bits, -8.0, 8.0).unwrap();
        let slanted = octree(Voxel { contour: Some(contour), ..Voxel::default() });
        let (view, hits) = view_and_hits(&slanted);
        let normal = voxel_normal(&slanted, &to_mesh, &view.ray(24, 16), &hits[at]);
        let expected = DVec3::new(0.0, -1.0, -2.0).normalize();
        assert!(normal.dot(expected) > 0.999, "{normal}");
        let nearest = Nearest { views: vec![0; hits.len()], hits };
        let map = normal_map(&slanted, &[view], &nearest);
        assert_eq!(map.pixel(0, 0), [0; 3]);
        let [_, g, b] = map.pixel(24, 16);
        assert!(g.abs_diff(70) < 4 && b.abs_diff(13) < 4, "{g} {b}");
    }

    #[test]
    fn objects_are_shaded_as_if_they_were_alone() {
        let octree = two_objects_apart(1.2).unwrap();
        let mut caster = ReferenceCaster::default();
        caster.load(&octree).unwrap();
        let camera = overview(&octree, [0.0, 1.0, 0.0], 60.0, 1.5);
        let view = |object: usize| {
            let root = octree.objects()[object].root_slot as u32;
            View::new(&camera, octree.octree_to_mesh(object), root, SIZE, &CastOptions::default()).unwrap()
        };
        let views = [view(0), view(1)];
        let nearest = Nearest::cast(&mut caster, &views).unwrap();
        let both = shade_nearest(&octree, &views, &nearest);
        let normals = normal_map(&octree, &views, &nearest);
        let alone = views.map(|view| {
            let mut hits = Vec::new();
            caster.cast(&view, &mut hits).unwrap();
            let picture = shade(&octree, &view, &hits);
            let nearest = Nearest { views: vec![0; hits.len()], hits };
            (picture, normal_map(&octree, &[view], &nearest))
        });
        let mut seen = [0; 2];
        for (pixel, view) in nearest.views.iter().enumerate().filter(|(pixel, _)| !nearest.hits[*pixel].is_miss()) {
            let (x, y) = (pixel as u32 % SIZE.0, pixel as u32 / SIZE.0);
            let (picture, own_normals) = &alone[*view as usize];
            assert_eq!(normals.pixel(x, y), own_normals.pixel(x, y));
            let (found, expected) = (both.pixel(x, y), picture.pixel(x, y));
            assert!(found.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 1), "{x}, {y}: {found:?} {expected:?}");
            seen[*view as usize] += 1;
        }
        assert!(seen.iter().all(|pixels| *pixels > 20), "{seen:?}");
    }

    #[test]
    fn maps_show_what_they_say() {
        let octree = octree(Voxel::default());
        let (view, mut hits) = view_and_hits(&octree);
        assert_eq!(depth_map(&view, &hits).pixel(0, 0), [0; 3]);
        assert_eq!(depth_map(&view, &hits).pixel(24, 16), [255; 3]);
        hits[0].iterations = 0;
        hits[1].iterations = 1000;
        let map = iteration_map(&view, &hits, 50);
        assert_eq!((map.pixel(0, 0), map.pixel(1, 0)), ([0; 3], [255; 3]));
        let brightness =
            |[r, g, b]: [f32; 3]| 0.2126 * decode_srgb(r) + 0.7152 * decode_srgb(g) + 0.0722 * decode_srgb(b);
        for k in 0..100 {
            let (a, b) = (brightness(heat(k as f32 / 100.0)), brightness(heat((k + 1) as f32 / 100.0)));
            assert!(b >= a, "{k}");
        }
    }
}
