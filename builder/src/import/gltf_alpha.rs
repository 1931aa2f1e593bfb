//! Triangles whose vertices have an opacity of their own (the fourth component of `COLOR_0`), cut where it is too low.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::assembly::Part;

/// A part in two: what is to be seen of it, and what is not.
pub(super) struct Cut {
    /// May have no triangles.
    pub(super) visible: Part,
    /// The opacity of each vertex of `visible`.
    pub(super) alphas: Vec<f32>,
    /// Only positions. May have no triangles.
    pub(super) hidden: Part,
}

/// Cuts triangles along the lines on which the opacity, which is linear between the corners, is `least`. What has at least
/// this opacity is visible.
pub(super) fn cut(mut part: Part, mut alphas: Vec<f32>, least: f32) -> Cut {
    let mut visible = Vec::with_capacity(part.triangles.len());
    let mut hidden = Vec::new();
    let mut on_edges: HashMap<(u32, u32), u32> = HashMap::new();
    for triangle in std::mem::take(&mut part.triangles) {
        let seen = triangle.map(|v| alphas[v as usize] >= least);
        match seen.into_iter().filter(|seen| *seen).count() {
            3 => visible.push(triangle),
            0 => hidden.push(triangle),
            count => {
                // The corner that is alone on its side comes first.
                let alone = (0..3).find(|&k| seen[k] == (count == 1)).unwrap_or(0);
                let [a, b, c] = [triangle[alone], triangle[(alone + 1) % 3], triangle[(alone + 2) % 3]];
                let mut point = |from, to| point_on_edge(&mut part, &mut alphas, &mut on_edges, from, to, least);
                let (ab, ac) = (point(a, b), point(a, c));
                let (tip, rest) = if count == 1 { (&mut visible, &mut hidden) } else { (&mut hidden, &mut visible) };
                tip.push([a, ab, ac]);
                rest.extend([[ab, b, c], [ab, c, ac]]);
            }
        }
    }
    let hidden = if hidden.is_empty() {
        Part::default()
    } else {
        Part { positions: part.positions.clone(), triangles: hidden, ..Part::default() }
    };
    part.triangles = visible;
    Cut { visible: part, alphas, hidden }
}

/// The vertex on an edge where the opacity is `least`. The same for both triangles of the edge.
fn point_on_edge(
    part: &mut Part,
    alphas: &mut Vec<f32>,
    on_edges: &mut HashMap<(u32, u32), u32>,
    from: u32,
    to: u32,
    least: f32,
) -> u32 {
    let key = (from.min(to), from.max(to));
    if let Some(&known) = on_edges.get(&key) {
        return known;
    }
    let (i, j) = (key.0 as usize, key.1 as usize);
    let (low, high) = (f64::from(alphas[i]), f64::from(alphas[j]));
    let t = ((f64::from(least) - low) / (high - low)).clamp(0.0, 1.0);
    let new = part.positions.len() as u32;
    part.positions.push(DVec3::from(part.positions[i]).lerp(DVec3::from(part.positions[j]), t).to_array());
    let t = t as f32;
    let mix = |a: [f32; 3], b: [f32; 3]| Vec3::from(a).lerp(Vec3::from(b), t);
    if let (Some(&a), Some(&b)) = (part.normals.get(i), part.normals.get(j)) {
        // A vertex without a normal stays without: zero.
        let missing = a == [0.0; 3] || b == [0.0; 3];
        part.normals.push(if missing { [0.0; 3] } else { mix(a, b).normalize_or_zero().to_array() });
    }
    if let (Some(&a), Some(&b)) = (part.uvs.get(i), part.uvs.get(j)) {
        part.uvs.push(std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t));
    }
    if let (Some(&a), Some(&b)) = (part.colors.get(i), part.colors.get(j)) {
        part.colors.push(mix(a, b).to_array());
    }
    if let (Some(&[ax, ay, az, aw]), Some(&[bx, by, bz, _])) = (part.tangents.get(i), part.tangents.get(j)) {
        let unit = mix([ax, ay, az], [bx, by, bz]).normalize_or_zero();
        part.tangents.push(if unit == Vec3::ZERO { [0.0; 4] } else { [unit.x, unit.y, unit.z, aw] });
    }
    alphas.push(least);
    on_edges.insert(key, new);
    new
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(part: &Part) -> f64 {
        let corner = |v: u32| DVec3::from(part.positions[v as usize]);
        part.triangles.iter().map(|&[a, b, c]| (corner(b) - corner(a)).cross(corner(c) - corner(a)).z * 0.5).sum()
    }

    #[test]
    fn triangles_are_cut_where_the_opacity_is_the_least() {
        let part = || Part {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            uvs: vec![[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]],
            triangles: vec![[0, 1, 2]],
            ..Part::default()
        };
        for (alphas, seen) in [
            ([1.0, 1.0, 1.0], 0.5),
            ([0.0, 0.25, 0.0], 0.0),
            // One corner, two corners; whatever their order.
            ([1.0, 0.0, 0.0], 0.125),
            ([0.0, 1.0, 0.0], 0.125),
            ([0.0, 1.0, 1.0], 0.375),
            ([1.0, 0.0, 1.0], 0.375),
        ] {
            let found = cut(part(), alphas.to_vec(), 0.5);
            assert!((area(&found.visible) - seen).abs() < 1e-12, "{alphas:?}: {}", area(&found.visible));
            // The winding stays, and nothing is lost.
            assert!((area(&found.visible) + area(&found.hidden) - 0.5).abs() < 1e-12, "{alphas:?}");
            assert_eq!(found.visible.uvs.len(), found.visible.positions.len());
            assert_eq!(found.alphas.len(), found.visible.positions.len());
        }
        let found = cut(part(), vec![0.0, 1.0, 0.0], 0.25);
        assert_eq!(found.visible.positions[3..], [[0.25, 0.75, 0.0], [0.25, 0.0, 0.0]]);
        assert_eq!(found.visible.uvs[3..], [[1.0, 3.0], [1.0, 0.0]]);
    }

    #[test]
    fn neighbours_share_the_new_vertices() {
        let part = Part {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2], [2, 1, 3]],
            ..Part::default()
        };
        // The edge from 1 to 2 is cut once.
        assert_eq!(cut(part, vec![1.0, 1.0, 0.0, 0.0], 0.5).visible.positions.len(), 7);
    }
}
