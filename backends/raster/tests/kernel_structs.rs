//! Structs of kernels against those of the crate: size and names, read from the sources.

use naga::front::wgsl;

/// The span in bytes of a struct of a kernel's source, and the offset of each of its members.
fn layout(source: &str, name: &str) -> (u32, Vec<(String, u32)>) {
    let module = wgsl::parse_str(source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(source)));
    let (_, found) = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name)).unwrap();
    let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
    (*span, members.iter().map(|member| (member.name.clone().unwrap(), member.offset)).collect())
}

const ERRORS: &str = "const EDGE_ERROR: f32 = 1.0;\nconst PLANE_ERROR: f32 = 1.0;\nconst BOX_ERROR: f32 = 1.0;\n";

#[test]
fn structs_have_the_sizes_that_are_uploaded() {
    let common = [ERRORS, include_str!("../kernels/params.wgsl"), include_str!("../kernels/common.wgsl")].concat();
    let sum = [&common, include_str!("../kernels/emit_sum.wgsl")].concat();
    let (span, members) = layout(&common, "Record");
    assert_eq!((span, members[3].1, members[4].1, members[13].1, members[15].1), (76, 12, 16, 52, 60));
    let (span, params) = layout(&common, "Params");
    assert_eq!(span, 48);
    assert_eq!(params.iter().find(|(name, _)| name == "end_x").unwrap().1, 32);
    let (span, members) = layout(&sum, "Look");
    assert_eq!((span, members.last().unwrap().1), (104, 100));
    assert_eq!(layout(&sum, "Material").0, 32);
}
