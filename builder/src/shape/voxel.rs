//! What the two ways to shape a voxel share: the result, and contours that enclose the surface.

use esvo_format::Contour;
use glam::DVec3;

/// The shape of one voxel.
pub(crate) struct Shape {
    /// The contour to store.
    pub contour: Option<Contour>,
    /// Whether the shape is within the error bound everywhere, so that no finer voxels are needed.
    pub fits: bool,
}

/// A contour must move a plane by at least this, in edges of the voxel, to be worth its bytes. That holds for voxels that fit
/// without it, too: most of these are leaves, and end rays nearer to the surface with it.
pub(crate) const MIN_GAIN: f32 = 1.0 / 128.0;
/// Distance that planes keep from the surface, in octree units. Positions in a caster have errors of a few 2^-23, and two
/// contours that both touch the surface must still overlap there.
const CASTER_MARGIN: f32 = 1.0 / (1 << 21) as f32;

/// The contour with this encoded normal that encloses `lo..=hi` along it, in a voxel of this size (with a margin for the
/// rounding errors of casters); `None` if it would not bound the voxel.
pub(crate) fn enclosing(bits: u32, lo: f64, hi: f64, size: f64) -> Option<Contour> {
    let reach = Contour::decode_normal(bits).iter().map(|c| c.abs()).sum::<f64>();
    let margin = reach * f64::from(CASTER_MARGIN) / size;
    Contour::encode_bounds(bits, lo - margin, hi + margin)
}

/// Whether a segment meets the cube with this centre and half edge.
pub(crate) fn segment_meets_cube(a: DVec3, b: DVec3, centre: DVec3, half: f64) -> bool {
    let (a, d) = (a - centre, b - a);
    let (mut t0, mut t1) = (0.0f64, 1.0f64);
    for axis in 0..3 {
        if d[axis] == 0.0 {
            if a[axis].abs() > half {
                return false;
            }
            continue;
        }
        let (x, y) = ((-half - a[axis]) / d[axis], (half - a[axis]) / d[axis]);
        let (enter, leave) = if x < y { (x, y) } else { (y, x) };
        t0 = if enter > t0 { enter } else { t0 };
        t1 = if leave < t1 { leave } else { t1 };
    }
    t0 <= t1
}
