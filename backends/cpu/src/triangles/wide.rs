//! Triangles for a GPU: the eight-wide hierarchy of `obvhs`, and the rays that the GPU leaves undecided.

use esvo_core::exact::{CameraRays, ExactRay, TriangleHit};
use esvo_core::gpu::triangles::{
    HierarchySpace, MISS, TriangleRecord, UNDECIDED, WideNode, WideTriangle, WideTriangles,
};
use glam::{DVec3, Vec3A};
use obvhs::Boundable;
use obvhs::BvhBuildParams;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ploc::PlocBuilder;
use obvhs::splits::split_aabbs_preset;
use obvhs::triangle::Triangle;
use rayon::prelude::*;

use super::TriangleScene;
use super::bvh::Placement;
use super::exact::Sheared;

/// Most triangles of a leaf: nodes have three bits for their number.
const LEAF: u32 = 3;

const _: () = assert!(size_of::<CwBvhNode>() == size_of::<WideNode>());

/// Hits that a GPU and the processor found together.
#[derive(Clone, PartialEq, Debug)]
pub struct Decided {
    /// Those of [`TriangleScene::cast_exact`].
    pub hits: Vec<TriangleHit>,
    /// Rays that the processor decided.
    pub undecided: usize,
}

impl TriangleScene {
    /// The triangles for a GPU. Those with two corners in the same place are left out: rays never hit them.
    ///
    /// Large triangles are split over several boxes, as for the fast caster.
    pub fn wide(&self) -> WideTriangles {
        wide(self.triangles(), &self.placement)
    }

    /// The hits of a picture from a GPU's answers, with `t` in double precision.
    ///
    /// # Panics
    /// There are not as many records as pixels.
    pub fn decide(&self, rays: &CameraRays, records: &[TriangleRecord]) -> Decided {
        assert_eq!(records.len(), rays.pixels(), "one record per pixel");
        self.decide_each(|index| rays.ray_at(index), records)
    }

    /// The closest hits of rays from a GPU's answers, with `t` in double precision.
    ///
    /// # Panics
    /// There are not as many records as rays.
    pub fn decide_rays(&self, rays: &[ExactRay], records: &[TriangleRecord]) -> Decided {
        assert_eq!(records.len(), rays.len(), "one record per ray");
        self.decide_each(|index| rays[index], records)
    }

    /// Whether each ray hits something, from a GPU's answers to `Question::Any`. Returns also how many the processor decided.
    ///
    /// # Panics
    /// There are not as many records as rays.
    pub fn decide_any(&self, rays: &[ExactRay], records: &[TriangleRecord]) -> (Vec<bool>, usize) {
        assert_eq!(records.len(), rays.len(), "one record per ray");
        let decide = |(ray, record): (&ExactRay, &TriangleRecord)| match record.triangle {
            UNDECIDED => !self.cast_exact_ray(ray).is_miss(),
            triangle => triangle != MISS,
        };
        (rays.par_iter().zip(records).map(decide).collect(), undecided(records))
    }

    fn decide_each(&self, ray: impl Fn(usize) -> ExactRay + Sync, records: &[TriangleRecord]) -> Decided {
        let decide = |(index, record): (usize, &TriangleRecord)| match record.triangle {
            MISS => TriangleHit::MISS,
            UNDECIDED => self.cast_exact_ray(&ray(index)),
            triangle => {
                let corners = self.triangles().get(triangle as usize);
                let t = corners.and_then(|corners| Sheared::new(&ray(index))?.meet(corners));
                // The exact caster does hit what the kernel says. If the kernel is wrong, so is the hit.
                TriangleHit { t: t.unwrap_or(record.t.into()), triangle }
            }
        };
        Decided { hits: records.par_iter().enumerate().map(decide).collect(), undecided: undecided(records) }
    }
}

fn undecided(records: &[TriangleRecord]) -> usize {
    records.iter().filter(|record| record.triangle == UNDECIDED).count()
}

fn wide(triangles: &[[DVec3; 3]], placement: &Placement) -> WideTriangles {
    let space = HierarchySpace { centre: placement.centre, scale: placement.scale };
    let solid = |t: &[DVec3; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    let indices: Vec<u32> = (0u32..).zip(triangles).filter(|(_, t)| solid(t)).map(|(index, _)| index).collect();
    if indices.is_empty() {
        return WideTriangles { nodes: Vec::new(), triangles: Vec::new(), stack: 0, space };
    }
    let placed = |index: u32| {
        let [v0, v1, v2] = triangles[index as usize].map(|p| Vec3A::from(placement.point(p).as_vec3()));
        Triangle { v0, v1, v2 }
    };
    let corners: Vec<Triangle> = indices.iter().map(|&index| placed(index)).collect();

    // The steps of `build_cwbvh_from_tris` of `obvhs`, without its checks in debug builds, which take all trees to be shallow.
    let params = BvhBuildParams::very_slow_build();
    let mut boxes: Vec<_> = corners.iter().map(Boundable::aabb).collect();
    let mut leaves: Vec<u32> = (0..corners.len() as u32).collect();
    let areas = || boxes.iter().map(|b| b.half_area());
    let (mean, largest) = (areas().sum::<f32>() / boxes.len() as f32, areas().fold(0.0, f32::max));
    split_aabbs_preset(&mut boxes, &mut leaves, &corners, mean, largest);
    let mut bvh2 = PlocBuilder::with_capacity(boxes.len()).build(
        params.ploc_search_distance,
        &boxes,
        leaves,
        params.sort_precision,
        params.search_depth_threshold,
    );
    bvh2.uses_spatial_splits = true;
    ReinsertionOptimizer::default().run(&mut bvh2, params.reinsertion_batch_ratio, None);
    let bvh = bvh2_to_cwbvh(&bvh2, LEAF, true, false);

    let nodes: Vec<WideNode> = bvh.nodes.iter().map(node).collect();
    let triangle = |&at: &u32| {
        let Triangle { v0, v1, v2 } = corners[at as usize];
        let index = indices[at as usize];
        WideTriangle { a: v0.into(), index, b: v1.into(), unused: 0, c: v2.into(), unused_too: 0 }
    };
    WideTriangles {
        stack: depth(&nodes),
        triangles: bvh.primitive_indices.iter().map(triangle).collect(),
        nodes,
        space,
    }
}

fn node(node: &CwBvhNode) -> WideNode {
    let words = |bytes: [u8; 8]| {
        let bits = u64::from_le_bytes(bytes);
        [bits as u32, (bits >> 32) as u32]
    };
    WideNode {
        origin: node.p.into(),
        exponents: u32::from_le_bytes([node.e[0], node.e[1], node.e[2], node.imask]),
        first_child: node.child_base_idx,
        first_triangle: node.primitive_base_idx,
        kinds: words(node.child_meta),
        min_x: words(node.child_min_x),
        max_x: words(node.child_max_x),
        min_y: words(node.child_min_y),
        max_y: words(node.child_max_y),
        min_z: words(node.child_min_z),
        max_z: words(node.child_max_z),
    }
}

/// Nodes on the longest path below the root.
fn depth(nodes: &[WideNode]) -> u32 {
    let mut depth = 0;
    let mut waiting = vec![(0u32, 0u32)];
    while let Some((at, level)) = waiting.pop() {
        depth = depth.max(level);
        let node = &nodes[at as usize];
        waiting.extend((0..node.inner().count_ones()).map(|child| (node.first_child + child, level + 1)));
    }
    depth
}
