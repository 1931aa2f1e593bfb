//! Whether one triangle meets one cube, without the other cubes.

use glam::DVec3;

use super::{MARGIN, MAX_VERTICES, Polygon, sides};

/// Whether the splits of this triangle from the root cube down lead to the cube with the coordinates `at` on `level`: the
/// decision of [`Arena::split`](super::Arena::split), repeated on each level, bit for bit. Coordinates count cubes of the
/// level and must be below `2^level`; `level` is at most 23.
pub(crate) fn meets(corners: &[DVec3; 3], at: [u32; 3], level: u32) -> bool {
    let mut polygons = [Polygon::default(), Polygon::default()];
    let [mut from, mut to] = polygons.each_mut();
    from.set(corners);
    let (mut centre, mut quarter) = (DVec3::splat(0.5), 0.25);
    for step in (0..level).rev() {
        let upper = at.map(|x| x >> step & 1 != 0);
        // As in a split, all three follow from the polygon before it is cut.
        let sides = sides(from.vertices(), centre);
        if (0..3).any(|axis| sides[axis] >> u8::from(upper[axis]) & 1 == 0) {
            return false;
        }
        for axis in [2, 1, 0].into_iter().filter(|&axis| sides[axis] == 3) {
            match axis {
                0 => keep(from, centre.x, upper[0], to, |v| v.x, |v, x| v.x = x),
                1 => keep(from, centre.y, upper[1], to, |v| v.y, |v, y| v.y = y),
                _ => keep(from, centre.z, upper[2], to, |v| v.z, |v, z| v.z = z),
            }
            if to.n == 0 {
                return false;
            }
            (from, to) = (to, from);
        }
        centre += DVec3::from_array(upper.map(|upper| if upper { quarter } else { -quarter }));
        quarter *= 0.5;
    }
    true
}

/// One of the two parts of [`cut`](super::cut): the upper or the lower one, with the same vertices.
#[inline(always)]
fn keep(
    polygon: &Polygon,
    at: f64,
    upper: bool,
    part: &mut Polygon,
    coordinate: impl Fn(&DVec3) -> f64,
    set: impl Fn(&mut DVec3, f64),
) {
    part.n = 0;
    let (end, sign) = if upper { (at - MARGIN, -1.0) } else { (at + MARGIN, 1.0) };
    let vertices = polygon.vertices();
    let mut previous = vertices[vertices.len() - 1];
    // Distance beyond the end of the part; positive: the vertex is cut off.
    let mut d0 = (coordinate(&previous) - end) * sign;
    for &current in vertices {
        let d1 = (coordinate(&current) - end) * sign;
        if d0 * d1 < 0.0 {
            let mut p = previous + (current - previous) * (d0 / (d0 - d1));
            set(&mut p, end);
            part.push(p);
        }
        if d1 <= 0.0 {
            part.push(current);
        }
        (previous, d0) = (current, d1);
    }
    if part.n > MAX_VERTICES {
        *part = *polygon;
    }
}
