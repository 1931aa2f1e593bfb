//! Exact ray casting on triangles, enough to judge a viewpoint: a median-split hierarchy in double precision.

use esvo_builder::mesh::Mesh;
use glam::DVec3;

const LEAF: usize = 8;

/// Axis-aligned bounds.
#[derive(Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) min: DVec3,
    pub(crate) max: DVec3,
}

impl Bounds {
    pub(crate) const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    pub(crate) fn grow(&mut self, p: DVec3) {
        self.min = self.min.min(p);
        self.max = self.max.max(p);
    }

    fn hit(&self, origin: DVec3, inverse: DVec3, farthest: f64) -> bool {
        let a = (self.min - origin) * inverse;
        let b = (self.max - origin) * inverse;
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element().min(farthest);
        near <= far
    }
}

struct Node {
    bounds: Bounds,
    /// Leaf: first triangle and their number. Inner: index of the second child (the first follows its parent), and zero.
    start: usize,
    count: usize,
}

pub(crate) struct Bvh {
    corners: Vec<[DVec3; 3]>,
    indices: Vec<usize>,
    nodes: Vec<Node>,
}

impl Bvh {
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let corner = |v: u32| DVec3::from_array(mesh.positions[v as usize]);
        let corners: Vec<[DVec3; 3]> = mesh.triangles.iter().map(|t| t.map(corner)).collect();
        let centres: Vec<DVec3> = corners.iter().map(|c| (c[0] + c[1] + c[2]) / 3.0).collect();
        let mut indices: Vec<usize> = (0..corners.len()).collect();
        let mut nodes = Vec::new();
        build(&corners, &centres, &mut indices, 0, &mut nodes);
        let corners = indices.iter().map(|&i| corners[i]).collect();
        Self { corners, indices, nodes }
    }

    pub(crate) fn bounds(&self) -> Bounds {
        self.nodes.first().map_or(Bounds::EMPTY, |n| n.bounds)
    }

    /// Distance (in lengths of `direction`) and index of the nearest triangle in front of the origin.
    pub(crate) fn cast(&self, origin: DVec3, direction: DVec3) -> Option<(f64, usize)> {
        let inverse = direction.recip();
        let mut best: Option<(f64, usize)> = None;
        let mut stack = vec![0];
        while let Some(at) = stack.pop() {
            let Some(node) = self.nodes.get(at) else { continue };
            if !node.bounds.hit(origin, inverse, best.map_or(f64::INFINITY, |b| b.0)) {
                continue;
            }
            if node.count == 0 {
                stack.push(node.start);
                stack.push(at + 1);
                continue;
            }
            for i in node.start..node.start + node.count {
                if let Some(t) = hit(&self.corners[i], origin, direction)
                    && best.is_none_or(|b| t < b.0)
                {
                    best = Some((t, self.indices[i]));
                }
            }
        }
        best
    }
}

fn build(corners: &[[DVec3; 3]], centres: &[DVec3], indices: &mut [usize], start: usize, nodes: &mut Vec<Node>) {
    let mut bounds = Bounds::EMPTY;
    let mut middle = Bounds::EMPTY;
    for &i in indices.iter() {
        corners[i].iter().for_each(|&p| bounds.grow(p));
        middle.grow(centres[i]);
    }
    let at = nodes.len();
    nodes.push(Node { bounds, start, count: indices.len() });
    if indices.len() <= LEAF {
        return;
    }
    let size = middle.max - middle.min;
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let half = indices.len() / 2;
    indices.select_nth_unstable_by(half, |&a, &b| centres[a][axis].total_cmp(&centres[b][axis]));
    let (left, right) = indices.split_at_mut(half);
    build(corners, centres, left, start, nodes);
    nodes[at].start = nodes.len();
    nodes[at].count = 0;
    build(corners, centres, right, start + half, nodes);
}

/// Moeller-Trumbore, both sides.
fn hit(c: &[DVec3; 3], origin: DVec3, direction: DVec3) -> Option<f64> {
    let (e1, e2) = (c[1] - c[0], c[2] - c[0]);
    let p = direction.cross(e2);
    let det = e1.dot(p);
    if det == 0.0 {
        return None;
    }
    let s = origin - c[0];
    let u = s.dot(p) / det;
    let q = s.cross(e1);
    let v = direction.dot(q) / det;
    let t = e2.dot(q) / det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}
