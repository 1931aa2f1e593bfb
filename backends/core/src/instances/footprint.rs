//! The part of a picture in which an object can be seen.

use glam::{DMat3, DVec2, DVec3};

use crate::View;
use crate::reference::EPSILON;

/// Share of a coordinate by which a caster may be wrong about where a ray meets a plane between voxels.
///
/// Let a ray cross the plane at `p` of an axis at `t = p c - b`, with `c` one over the direction and `b = o c`. Rounding
/// changes `t` by less than `2^-22 c (|o| + 5)`, as if the plane were moved by less than `2^-22 (|o| + 5)`: at most four sums
/// and products, each of numbers below `c (|o| + 5)`. A caster chooses the child that a ray enters by one such number and
/// leaves it by another, so that on each of at most 23 levels `t` can step back by twice as much. 46 times `2^-22` is less
/// than this.
const ROUNDING: f64 = 1.0 / (1u32 << 16) as f64;
/// The same for the direction of a pixel's ray: two products and two sums, less than `2^-22` of the terms.
const DIRECTION_ROUNDING: f64 = 1.0 / (1u32 << 20) as f64;
/// Below this volume of the unit vectors along the picture's sides and its depth, nothing is computed from them.
const SMALLEST_VOLUME: f64 = 1e-6;
/// Added to each side of the part, in pixels: far above the rounding of the numbers in double precision.
const PIXEL_MARGIN: f64 = 1e-3;
/// Least depth at which a point is projected, as a share of the far plane's.
const NEAREST: f64 = 1e-9;

/// A rectangle of pixels, and how near the object comes.
///
/// A caster's ray through any other pixel misses, and no hit has a smaller `t`.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Footprint {
    /// First column and row.
    pub(crate) low: [u32; 2],
    /// Last column and row.
    pub(crate) high: [u32; 2],
    /// At most the `t` of every hit.
    pub(crate) t: f32,
}

impl Footprint {
    /// The footprint of the object that a view shows, which was [checked](View::check). `None` if no ray can hit it.
    ///
    /// A point of cast space is `o + t (base + x dx + y dy)` with `(x, y)` its place in the picture and `t` its depth over
    /// that of the far plane. The corners of the root cube are brought into these coordinates, after the cube was enlarged by
    /// what rounding can do, and cut off at the near and the far plane. Where that cannot be computed well, the footprint is
    /// the whole picture.
    pub(crate) fn of(view: &View) -> Option<Self> {
        let size = DVec2::new(f64::from(view.width), f64::from(view.height));
        let whole = Self { low: [0; 2], high: [view.width - 1, view.height - 1], t: f32::NEG_INFINITY };
        let seen = Seen::of(view, size);
        match seen {
            Seen::Unknown => Some(whole),
            Seen::Nothing => None,
            Seen::Part { low, high, t } => {
                let low = (low - 0.5 - PIXEL_MARGIN).ceil().max(DVec2::ZERO);
                let high = (high - 0.5 + PIXEL_MARGIN).floor().min(size - 1.0);
                if !(low.cmple(high).all()) {
                    return None;
                }
                let t = t - step_back(view, low + 0.5, high + 0.5);
                let pixels = |v: DVec2| [v.x as u32, v.y as u32];
                Some(Self { low: pixels(low), high: pixels(high), t: (t as f32).next_down() })
            }
        }
    }
}

/// Where the enlarged root cube of a view is in its picture.
enum Seen {
    Unknown,
    Nothing,
    /// Smallest and largest place in pixels, and the smallest `t`.
    Part {
        low: DVec2,
        high: DVec2,
        t: f64,
    },
}

impl Seen {
    fn of(view: &View, size: DVec2) -> Self {
        let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        let (origin, base) = (wide(view.origin), wide(view.base));
        let (across, down) = (wide(view.dx) * size.x, wide(view.dy) * size.y);
        // The ray through the middle, and half the sides of the picture on the far plane.
        let axes = DMat3::from_cols(across * 0.5, down * 0.5, base + (across + down) * 0.5);
        let rows = axes.transpose();
        let of_rows = DVec3::new(largest(rows.x_axis), largest(rows.y_axis), largest(rows.z_axis)).recip();
        let even = DMat3::from_diagonal(of_rows) * axes;
        let of_columns = DVec3::new(even.x_axis.length(), even.y_axis.length(), even.z_axis.length()).recip();
        let even = even * DMat3::from_diagonal(of_columns);
        // False for NaN.
        let usable = even.determinant().abs() >= SMALLEST_VOLUME;
        let near = f64::from(view.t_near);
        if !usable || near < NEAREST {
            return Self::Unknown;
        }
        let to_picture = DMat3::from_diagonal(of_columns) * even.inverse() * DMat3::from_diagonal(of_rows);
        let margin =
            ROUNDING * (origin.abs() + 5.0) + DIRECTION_ROUNDING * (base.abs() + across.abs() + down.abs() + 1.0);
        let corners: [DVec3; 8] = std::array::from_fn(|corner| {
            let at = DVec3::from(std::array::from_fn(|axis| match corner >> axis & 1 {
                0 => 1.0 - margin[axis],
                _ => 2.0 + margin[axis],
            }));
            to_picture * (at - origin)
        });
        let planes = [near * (1.0 - NEAREST), 1.0 + NEAREST];
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut visit = |point: DVec3| {
            let at = (point.truncate() / point.z).extend(point.z);
            (low, high) = (low.min(at), high.max(at));
        };
        for (number, &corner) in corners.iter().enumerate() {
            if !corner.is_finite() {
                return Self::Unknown;
            }
            if (planes[0]..=planes[1]).contains(&corner.z) {
                visit(corner);
            }
            for other in (0..3).filter(|axis| number >> axis & 1 == 0).map(|axis| corners[number | 1 << axis]) {
                for plane in planes {
                    let (before, behind) = (corner.z - plane, other.z - plane);
                    if (before < 0.0) != (behind < 0.0) {
                        let on_plane = corner + (other - corner) * (before / (before - behind));
                        visit(on_plane.truncate().extend(plane));
                    }
                }
            }
        }
        if low.z > high.z {
            return Self::Nothing;
        }
        let pixels = |v: DVec3| (v.truncate() + 1.0) * 0.5 * size;
        let (t, low, high) = (low.z, pixels(low), pixels(high));
        if low.is_finite() && high.is_finite() { Self::Part { low, high, t } } else { Self::Unknown }
    }
}

fn largest(v: DVec3) -> f64 {
    v.abs().max_element()
}

/// How far `t` can step back along the rays through a rectangle, see [`ROUNDING`]: far along rays that run along a plane.
fn step_back(view: &View, low: DVec2, high: DVec2) -> f64 {
    let axis = |axis: usize| {
        let [base, dx, dy] = [view.base, view.dx, view.dy].map(|v| f64::from(v[axis]));
        let at = |x: f64, y: f64| base + x * dx + y * dy;
        let corners = [at(low.x, low.y), at(low.x, high.y), at(high.x, low.y), at(high.x, high.y)];
        let one_side = corners.iter().all(|d| *d > 0.0) || corners.iter().all(|d| *d < 0.0);
        let least = corners.iter().fold(f64::INFINITY, |least, d| least.min(d.abs()));
        let rounded = DIRECTION_ROUNDING * (base.abs() + high.x * dx.abs() + high.y * dy.abs());
        let least = if one_side { least - rounded } else { 0.0 };
        ROUNDING * (f64::from(view.origin[axis].abs()) + 5.0) / least.max(f64::from(EPSILON))
    };
    axis(0).max(axis(1)).max(axis(2))
}

/// The same for one ray of a view: a ray that is cast up to this far behind a `t` finds every hit before that `t` that it
/// would find without an end, and finds it first.
///
/// The end decides only whether a voxel is entered. One that it forbids is entered behind the end; what is in it or comes after
/// it is met later still, or earlier by no more than this. And where no voxel is forbidden, both rays take the same steps.
pub(crate) fn ray_margin(view: &View, direction: glam::Vec3) -> f32 {
    let axis = |axis: usize| (view.origin[axis].abs() + 5.0) / direction[axis].abs().max(EPSILON);
    axis(0).max(axis(1)).max(axis(2)) * ROUNDING as f32
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DQuat};

    use super::*;
    use crate::gpu::kernel::INSTANCES_WGSL;
    use crate::{Camera, CastOptions, FLAG_CONTOURS};

    const SIZE: (u32, u32) = (200, 100);

    /// A unit cube around a point, seen from the origin along -z at 90 degrees over the height of the picture.
    fn seen(middle: DVec3, edge: f64) -> Option<Footprint> {
        let camera = Camera {
            eye: [0.0; 3],
            forward: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            fov_degrees: 90.0,
            near: 0.01,
            far: 100.0,
        };
        let place = DMat4::from_translation(middle)
            * DMat4::from_scale(DVec3::splat(edge))
            * DMat4::from_translation(DVec3::splat(-0.5));
        Footprint::of(&View::new(&camera, place, 2, SIZE, &CastOptions::default()).unwrap())
    }

    #[test]
    fn a_cube_in_front_has_its_own_rectangle_and_depth() {
        // Its front is 9.5 away, where the picture is 19 high: 100 / 19 pixels, and half of them on each side of 100 and 50.
        let there = seen(DVec3::new(0.0, 0.0, -10.0), 1.0).unwrap();
        assert_eq!((there.low, there.high), ([97, 47], [102, 52]));
        // The eye looks along the cube, so that rays may run along its planes.
        assert!(there.t < 0.0);
        let aside = seen(DVec3::new(3.0, 2.0, -10.0), 1.0).unwrap();
        assert!(aside.low[0] > 110 && aside.high[1] < 43, "{aside:?}");
        assert!(aside.t < 0.095 && aside.t > 0.094, "{aside:?}");
    }

    #[test]
    fn what_cannot_be_seen_has_none() {
        for middle in [[0.0, 0.0, 3.0], [0.0, 0.0, -101.0], [50.0, 0.0, -10.0], [0.0, -20.0, -10.0]] {
            assert_eq!(seen(middle.into(), 1.0), None, "{middle:?}");
        }
        // Around the eye, and behind it but partly in front of the near plane.
        for (middle, edge) in [([0.0; 3], 1.0), ([0.0, 0.0, 0.4], 1.0)] {
            let around = seen(middle.into(), edge).unwrap();
            assert_eq!((around.low, around.high), ([0, 0], [SIZE.0 - 1, SIZE.1 - 1]));
        }
    }

    #[test]
    fn without_volume_or_near_plane_it_is_the_whole_picture() {
        let view = View {
            origin: [0.0; 3],
            base: [1.0, 1.0, 1.0],
            dx: [0.0, 0.01, 0.0],
            dy: [0.0, 0.0, 0.01],
            t_near: 0.01,
            width: 100,
            height: 100,
            flags: FLAG_CONTOURS,
            ..bytemuck::Zeroable::zeroed()
        };
        let whole =
            |view: &View| Footprint::of(view).is_some_and(|f| f.low == [0; 2] && f.high == [99; 2] && f.t < 0.0);
        assert!(!whole(&View { origin: [0.0, 0.0, -0.9], ..view }));
        assert!(whole(&View { dx: [0.0; 3], ..view }));
        assert!(whole(&View { dx: [0.0, 1e-9, 0.01], ..view }));
        assert!(whole(&View { t_near: 0.0, ..view }));
        assert!(whole(&View { dx: [f32::MAX; 3], dy: [f32::MIN; 3], ..view }));
    }

    #[test]
    fn it_is_close_to_what_it_holds() {
        // Of any cube in front of the eye, less than a hundredth of a pixel is added.
        for turn in 0..50 {
            let turned = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 0.5).normalize(), f64::from(turn));
            let middle = turned * DVec3::new(3.0, 1.0, 4.0);
            let Some(there) = seen(middle, 1.0) else { continue };
            if middle.z > -1.5 {
                continue;
            }
            let corners =
                (0..8).map(|i: u32| middle + DVec3::from_array(std::array::from_fn(|a| f64::from(i >> a & 1) - 0.5)));
            let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
            for corner in corners {
                let at = DVec2::new(corner.x, -corner.y) / -corner.z * 50.0 + DVec2::new(100.0, 50.0);
                (low, high) = (low.min(at), high.max(at));
            }
            let tight = [(low - 0.5 - 0.01).ceil().max(DVec2::ZERO), (high - 0.5 + 0.01).floor()];
            assert!(f64::from(there.low[0]) >= tight[0].x && f64::from(there.low[1]) >= tight[0].y);
            assert!(f64::from(there.high[0]) <= tight[1].x && f64::from(there.high[1]) <= tight[1].y);
        }
    }

    #[test]
    fn the_kernel_has_the_same_margin() {
        let text =
            INSTANCES_WGSL.split("const STEP_BACK: f32 = ").nth(1).and_then(|rest| rest.split(';').next()).unwrap();
        assert_eq!(text.parse::<f64>().unwrap(), ROUNDING);
    }
}
