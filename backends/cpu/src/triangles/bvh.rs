//! A bounding volume hierarchy in the layout that both triangle casters walk: built by `obvhs`, stored as pairs of siblings
//! in one cache line.

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::{build_bvh2, build_bvh2_from_tris};
use obvhs::triangle::Triangle;
use obvhs::{BvhBuildParams, bvh2::node::Bvh2Node};

/// One node, 32 bytes. Siblings are neighbours, the first at an even place.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Node {
    pub(super) lo: [f32; 3],
    /// Triangles of a leaf; 0 for an inner node.
    pub(super) count: u32,
    pub(super) hi: [f32; 3],
    /// First triangle of a leaf in [`Bvh::order`]; first of the two children of an inner node.
    pub(super) first: u32,
}

/// The hierarchy. Node 0 is the root and node 1 is unused, so that every pair of siblings shares a cache line of 64 bytes.
#[derive(Default)]
pub(super) struct Bvh {
    pub(super) nodes: Vec<Node>,
    /// Triangles in the order of the leaves. One that was split into several boxes occurs several times.
    pub(super) order: Vec<u32>,
    /// Inner nodes on the longest path from the root: the most siblings that a traversal keeps on its stack.
    pub(super) depth: usize,
}

impl Bvh {
    /// Of single-precision triangles, with large ones split: the fastest to cast, the slowest to build.
    ///
    /// Of the presets of `obvhs` 0.4, "very slow" gave the most primary rays per second. In Mrays/s, with the traversal of
    /// `obvhs`, one core (2-core EPYC, Zen 5), 1024x768, mean of four interior cameras, on SIBENIK and CONFERENCE:
    ///
    /// | preset | CWBVH | BVH2 |
    /// |---|---|---|
    /// | medium | 4.8, 6.6 | 5.4, 7.7 |
    /// | slow | 4.4, 7.4 | 5.6, 8.2 |
    /// | very slow | 4.4, 7.8 | 6.7, 8.7 |
    pub(super) fn fastest(triangles: &[[Vec3A; 3]], indices: &[u32]) -> Self {
        if triangles.is_empty() {
            return Self::default();
        }
        let plain: Vec<_> = triangles.iter().map(|&[v0, v1, v2]| Triangle { v0, v1, v2 }).collect();
        let params = BvhBuildParams { max_prims_per_leaf: 4, ..BvhBuildParams::very_slow_build() };
        Self::from_obvhs(&build_bvh2_from_tris(&plain, params, &mut Default::default()), indices)
    }

    /// Of boxes, one per entry of `indices`. Inner boxes are exact unions, so that what a box contains is contained in the
    /// boxes of its ancestors.
    pub(super) fn over_boxes(boxes: &[Aabb], indices: &[u32]) -> Self {
        if boxes.is_empty() {
            return Self::default();
        }
        let params = BvhBuildParams { pre_split: false, max_prims_per_leaf: 4, ..BvhBuildParams::medium_build() };
        Self::from_obvhs(&build_bvh2(boxes, params, &mut Default::default()), indices)
    }

    fn from_obvhs(bvh: &Bvh2, indices: &[u32]) -> Self {
        let order = bvh.primitive_indices.iter().map(|&i| indices[i as usize]).collect();
        let node = |node: &Bvh2Node, first: u32| Node {
            lo: node.aabb().min.into(),
            count: node.prim_count,
            hi: node.aabb().max.into(),
            first,
        };
        // Depth first, so that a subtree is contiguous in memory and a descent moves forward.
        let mut nodes = vec![node(&bvh.nodes[0], 0); 2];
        nodes[1].count = 0;
        let mut depth = 0;
        let mut waiting = vec![(0usize, 0usize, 1usize)];
        while let Some((from, to, level)) = waiting.pop() {
            let source = &bvh.nodes[from];
            if source.is_leaf() {
                nodes[to].first = source.first_index;
                continue;
            }
            depth = depth.max(level);
            let first = nodes.len();
            nodes[to].first = first as u32;
            for sibling in 0..2 {
                let child = source.first_index as usize + sibling;
                nodes.push(node(&bvh.nodes[child], 0));
                waiting.push((child, first + sibling, level + 1));
            }
        }
        Self { nodes, order, depth }
    }

    /// Bytes of the nodes and the order.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice()) + size_of_val(self.order.as_slice())
    }
}

/// From mesh units to the space of the hierarchies, where the mesh lies in `[-1, 1]`: single precision then does not depend
/// on the place of the mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    pub(super) centre: DVec3,
    /// A power of two.
    pub(super) scale: f64,
}

impl Placement {
    /// For a mesh between two corners.
    pub(super) fn of(lo: DVec3, hi: DVec3) -> Self {
        let half = ((hi - lo) * 0.5).max_element();
        let scale = if half > 0.0 { half.log2().ceil().clamp(-1000.0, 1000.0).exp2().recip() } else { 1.0 };
        Self { centre: (lo + hi) * 0.5, scale }
    }

    pub(super) fn point(&self, p: DVec3) -> DVec3 {
        (p - self.centre) * self.scale
    }
}
