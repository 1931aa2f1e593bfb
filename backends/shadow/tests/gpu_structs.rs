//! Structs of kernels against those of the crate: sizes and offsets, read from the sources.

use esvo_shadow::trace::{Ray, Steps};
use naga::front::wgsl;

/// The span in bytes of a struct of the kernels, and the offset of each of its members.
fn layout(name: &str) -> (u32, Vec<(String, u32)>) {
    let source = [include_str!("../kernels/trace.wgsl"), include_str!("../kernels/list.wgsl")].concat();
    let module = wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(&source)));
    let (_, found) = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name)).unwrap();
    let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
    (*span, members.iter().map(|member| (member.name.clone().unwrap(), member.offset)).collect())
}

fn expect(name: &str, size: usize, members: &[(&str, u32)]) {
    let (span, found) = layout(name);
    assert_eq!(span as usize, size, "{name}");
    let found: Vec<(&str, u32)> = found.iter().map(|(name, offset)| (name.as_str(), *offset)).collect();
    assert_eq!(found, members, "{name}");
}

#[test]
fn structs_have_the_sizes_that_are_uploaded() {
    expect("Ray", size_of::<Ray>(), &[("origin", 0), ("major", 12), ("direction", 16), ("end", 28)]);
    expect("Steps", size_of::<Steps>(), &[("step", 0), ("samples", 12)]);
    expect("ShadowVolume", 16, &[("voxels", 0), ("coarsest", 12)]);
    expect("Fidelity", 8, &[("coarsest", 0), ("fine_until", 4)]);
    let answer = [("cell", 0), ("level", 12), ("numerator", 16), ("denominator", 20), ("looks", 24), ("is_hit", 28)];
    expect("Answer", 32, &answer);
}
