//! The structs that the kernel shares with Rust: every member has the name, the offset and the size of its twin.

use std::collections::BTreeMap;
use std::mem::offset_of;

use esvo_core::filter::kernel::{FILTER_WGSL, Params};
use esvo_core::gpu::kernel::{CAST_WGSL, INSTANCES_WGSL, NearestHit};
use esvo_core::gpu::triangles::{TRIANGLES_WGSL, TriangleRay, TriangleRecord, TriangleView, WideNode, WideTriangle};
use esvo_core::instances::Node;
use esvo_core::{Hit, Ray, View};

/// Offset and size in bytes of each member, and the size of the whole.
#[derive(PartialEq, Eq, Debug)]
struct Layout {
    members: BTreeMap<String, (usize, usize)>,
    size: usize,
}

/// Fields of a Rust struct. The pattern names every field: one that is left out does not compile.
macro_rules! rust_layout {
    ($name:ident { $($field:ident),* }) => {{
        let size_of_field = |value: $name| {
            let $name { $($field),* } = value;
            [$((stringify!($field), size_of_val(&$field))),*]
        };
        let offsets = [$(offset_of!($name, $field)),*];
        let fields = size_of_field(bytemuck::Zeroable::zeroed());
        let members = fields.iter().zip(offsets).map(|((name, size), offset)| (name.to_string(), (offset, *size)));
        Layout { members: members.collect(), size: size_of::<$name>() }
    }};
}

/// Members of a struct of the kernel. Its structs stand before its bindings; only they are parsed, so that a struct can be
/// changed without the functions that use it.
fn kernel_layout(kernel: &str, name: &str) -> Layout {
    let (structs, _) = kernel.split_once("@group").expect("the kernel has bindings");
    let module = naga::front::wgsl::parse_str(structs).expect("the structs are WGSL");
    let mut layouter = naga::proc::Layouter::default();
    layouter.update(module.to_ctx()).expect("every type has a layout");
    let (_, found) = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name)).expect("the kernel has it");
    let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
    let members = members.iter().map(|member| {
        let name = member.name.clone().expect("members have names");
        (name, (member.offset as usize, layouter[member.ty].size as usize))
    });
    Layout { members: members.collect(), size: *span as usize }
}

/// WGSL rounds the size of a struct up, where Rust has a field for that.
fn without_padding(at: usize, mut layout: Layout) -> Layout {
    assert_eq!(layout.members.remove("padding"), Some((at, 12)));
    layout
}

fn rust_view() -> Layout {
    without_padding(
        84,
        rust_layout!(View {
            origin,
            t_near,
            base,
            pixel_size,
            dx,
            max_voxel_pixels,
            dy,
            t_per_depth,
            width,
            height,
            root,
            flags,
            first_row,
            padding
        }),
    )
}

fn rust_hit() -> Layout {
    rust_layout!(Hit { raw_t, slot, voxel, iterations })
}

fn rust_params() -> Layout {
    let layout = rust_layout!(Params { width, rows, margin, input_rows, adapted, padding, samples, radii });
    without_padding(20, layout)
}

fn rust_ray() -> Layout {
    rust_layout!(Ray { origin, direction, t_min, t_max, size_at_origin, size_per_t })
}

#[test]
fn the_kernel_s_structs_are_those_of_rust() {
    assert_eq!(kernel_layout(CAST_WGSL, "View"), rust_view());
    assert_eq!(kernel_layout(CAST_WGSL, "Hit"), rust_hit());
    assert_eq!(kernel_layout(CAST_WGSL, "RayRecord"), rust_ray());
    assert_eq!(kernel_layout(FILTER_WGSL, "Params"), rust_params());
    let (structs, _) = CAST_WGSL.split_once("@group").expect("the kernel has bindings");
    let both = structs.to_owned() + INSTANCES_WGSL;
    assert_eq!(kernel_layout(&both, "Node"), rust_layout!(Node { low, high, t, skip, number, padding, view }));
    assert_eq!(kernel_layout(&both, "NearestHit"), rust_layout!(NearestHit { hit, number }));
}

#[test]
fn the_structs_of_triangles_are_those_of_rust() {
    let of = |name| kernel_layout(TRIANGLES_WGSL, name);
    assert_eq!(
        of("View"),
        rust_layout!(TriangleView {
            eye,
            t_min,
            middle,
            t_max,
            dx,
            direction_error,
            dy,
            width,
            height,
            first_row,
            count,
            padding
        })
    );
    assert_eq!(of("Ray"), rust_layout!(TriangleRay { origin, t_min, direction, t_max }));
    let node = rust_layout!(WideNode {
        origin,
        exponents,
        first_child,
        first_triangle,
        kinds,
        min_x,
        max_x,
        min_y,
        max_y,
        min_z,
        max_z
    });
    assert_eq!(of("Node"), node);
    assert_eq!(of("Triangle"), rust_layout!(WideTriangle { a, index, b, unused, c, unused_too }));
    assert_eq!(of("Hit"), rust_layout!(TriangleRecord { t, triangle }));
    let swapped = TRIANGLES_WGSL.replacen(
        "    first_child: u32,\n    first_triangle: u32,\n",
        "    first_triangle: u32,\n    first_child: u32,\n",
        1,
    );
    assert_ne!(kernel_layout(&swapped, "Node"), node);
}

/// The negative control: members that are swapped, renamed, missing or of another size are noticed.
#[test]
fn a_struct_that_differs_is_noticed() {
    for (name, right, wrong) in [
        ("View", "    width: u32,\n    height: u32,\n", "    height: u32,\n    width: u32,\n"),
        (
            "View",
            "    dx: vec3<f32>,\n    max_voxel_pixels: f32,\n",
            "    max_voxel_pixels: f32,\n    dx: vec3<f32>,\n",
        ),
        ("View", "    first_row: u32,\n", "    first_row: u32,\n    last_row: u32,\n"),
        ("View", "    origin: vec3<f32>,\n    t_near: f32,\n", "    origin: vec4<f32>,\n    t_near: f32,\n"),
        ("Hit", "    slot: u32,\n    voxel: u32,\n", "    voxel: u32,\n    slot: u32,\n"),
        ("RayRecord", "    origin: array<f32, 3>,\n", "    origin: vec3<f32>,\n"),
        ("RayRecord", "    t_min: f32,\n    t_max: f32,\n", "    t_max: f32,\n    t_min: f32,\n"),
    ] {
        assert!(CAST_WGSL.contains(right), "{right}");
        let broken = kernel_layout(&CAST_WGSL.replacen(right, wrong, 1), name);
        let rust = match name {
            "View" => rust_view(),
            "Hit" => rust_hit(),
            _ => rust_ray(),
        };
        assert_ne!(broken, rust, "{wrong}");
    }
}
