//! How nodes and triangles lie in bindings, and the kernel for them.

use super::{MAX_STACK, TRIANGLES_WGSL, TriangleLimits, WideTriangles};
use crate::gpu::kernel::{OTHER_STORAGE_BUFFERS, workgroup_of};
use crate::gpu::slots::{Names, SlotKind, Slots};

const NODES: Names = Names { kind: SlotKind::Quad, read: "node_at", prefix: "node_" };
const TRIANGLES: Names = Names { kind: SlotKind::Quad, read: "triangle_at", prefix: "triangle_" };

/// How the nodes and triangles of a hierarchy lie in bindings of group [`GROUP_OCTREE`](crate::gpu::kernel::GROUP_OCTREE): those of
/// the nodes from 0 on, and behind them those of the triangles.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct TrianglePlacement {
    /// Where the [slots of the nodes](WideTriangles::node_slots) are.
    pub nodes: Slots,
    /// Where the [slots of the triangles](WideTriangles::triangle_slots) are.
    pub triangles: Slots,
    /// Frames of the stack.
    pub stack: u32,
    /// Width and height of a workgroup in pixels.
    pub workgroup: (u32, u32),
}

impl TrianglePlacement {
    /// Places nodes and triangles each in a texture if there may be one and they fit, else in buffers.
    ///
    /// # Errors
    /// What does not fit, and what to do: more than bindings or the device's memory hold, or a hierarchy too deep for the kernel. The
    /// caster puts the device's name in front of the text.
    pub fn new(triangles: &WideTriangles, limits: &TriangleLimits) -> Result<Self, String> {
        if triangles.stack > MAX_STACK {
            return Err(format!(
                "the hierarchy is {} nodes deep and the kernel's stack has {MAX_STACK} frames: cast these triangles on the processor",
                triangles.stack
            ));
        }
        let slot_limits = &limits.slots;
        let bytes = triangles.bytes();
        if let Some(memory) = slot_limits.memory_bytes.filter(|memory| *memory < bytes) {
            return Err(format!(
                "nodes and triangles of the hierarchy take {bytes} bytes, more than the device's memory of {memory} bytes: cast these \
                 triangles on the processor"
            ));
        }
        let max_parts = slot_limits.storage_buffers.saturating_sub(OTHER_STORAGE_BUFFERS).min(32);
        let place = |slots: &[[u32; 4]], parts| {
            let texture = slot_limits.texture_edge.and_then(|edge| Slots::texture(slots.len(), SlotKind::Quad, edge));
            texture.or_else(|| Slots::split(slots.len(), SlotKind::Quad, slot_limits.binding_bytes, parts))
        };
        let places = place(triangles.node_slots(), max_parts)
            .and_then(|nodes| Some((nodes, place(triangles.triangle_slots(), max_parts - nodes.storage_buffers())?)));
        let stack = triangles.stack;
        let (nodes, triangles) = places.ok_or_else(|| {
            format!(
                "nodes and triangles of the hierarchy take {} and {} bytes, more than {max_parts} bindings of {} bytes: cast these \
                 triangles on the processor",
                size_of_val(triangles.node_slots()),
                size_of_val(triangles.triangle_slots()),
                slot_limits.binding_bytes
            )
        })?;
        Ok(Self { nodes, triangles, stack, workgroup: workgroup_of(limits.workgroup)? })
    }

    /// The kernel.
    pub fn source(&self) -> String {
        self.source_with(TRIANGLES_WGSL)
    }

    /// The same with another text than [`TRIANGLES_WGSL`], for experiments and for tests with a broken kernel.
    pub fn source_with(&self, body: &str) -> String {
        let (stack, (width, height)) = (self.stack.clamp(1, MAX_STACK), self.workgroup);
        let mut text =
            format!("const STACK: u32 = {stack}u;\nconst WIDTH: u32 = {width}u;\nconst HEIGHT: u32 = {height}u;\n");
        self.nodes.declare(&NODES, 0, &mut text);
        self.triangles.declare(&TRIANGLES, self.nodes.bindings(), &mut text);
        text + body
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;
    use glam::DVec3;

    use super::super::{HierarchySpace, WideNode, WideTriangle};
    use super::*;
    use crate::gpu::kernel::SlotLimits;

    fn placed(nodes: usize, triangles: usize, limits: SlotLimits) -> Result<TrianglePlacement, String> {
        let space = HierarchySpace { centre: DVec3::ZERO, scale: 1.0 };
        let (nodes, triangles) = (vec![WideNode::zeroed(); nodes], vec![WideTriangle::zeroed(); triangles]);
        let wide = WideTriangles { nodes, triangles, stack: 3, space };
        let limits = TriangleLimits { slots: limits, groups: 65535, rays: None, workgroup: None };
        TrianglePlacement::new(&wide, &limits)
    }

    #[test]
    fn nodes_and_triangles_share_the_bindings() {
        let limits = SlotLimits { binding_bytes: 1024, storage_buffers: 8, texture_edge: None, memory_bytes: None };
        let buffers = |parts, part_shift| Slots::Buffers { parts, part_shift };
        let places = |nodes, triangles| placed(nodes, triangles, limits).map(|placed| (placed.nodes, placed.triangles));
        assert_eq!(places(12, 21), Ok((Slots::ONE_BUFFER, Slots::ONE_BUFFER)));
        // 65 slots and 66 slots, 64 in a binding.
        assert_eq!(places(13, 22), Ok((buffers(2, 6), buffers(2, 6))));
        assert_eq!(places(13, 85), Ok((buffers(2, 6), buffers(4, 6))));
        let error = places(13, 86).expect_err("seven bindings");
        assert!(error.contains("take 1040 and 4128 bytes, more than 6 bindings of 1024 bytes"), "{error}");
        assert!(places(80, 1).is_err(), "no binding is left for the triangles");

        let source = placed(13, 22, limits).expect("fits").source();
        assert!(source.contains("@group(1) @binding(1) var<storage, read> node_part_1: array<vec4<u32>>;"), "{source}");
        assert!(
            source.contains("@group(1) @binding(3) var<storage, read> triangle_part_1: array<vec4<u32>>;"),
            "{source}"
        );

        let small = SlotLimits { memory_bytes: Some(1000), ..limits };
        assert!(placed(13, 22, small).expect_err("too large").contains("memory of 1000 bytes"));
    }

    #[test]
    fn what_fits_no_texture_is_in_buffers() {
        let limits =
            SlotLimits { binding_bytes: 1 << 20, storage_buffers: 4, texture_edge: Some(32), memory_bytes: None };
        let placed = placed(205, 341, limits).expect("fits");
        assert_eq!((placed.nodes, placed.triangles), (Slots::ONE_BUFFER, Slots::Texture { row_shift: 5 }));
        let source = placed.source();
        assert!(source.contains("@binding(0) var<storage, read> node_part_0: array<vec4<u32>>;"), "{source}");
        assert!(source.contains("@binding(1) var triangle_texels: texture_storage_2d<rgba32uint, read>;"), "{source}");
    }
}
