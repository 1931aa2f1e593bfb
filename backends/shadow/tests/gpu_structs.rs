//! Structs of kernels against those of the crate: sizes and offsets, read from the sources.

use esvo_shadow::trace::{Ray, Steps};
use naga::front::wgsl;

/// The span in bytes of a struct of the kernels, and the offset of each of its members.
fn layout(rest: &str, name: &str) -> (u32, Vec<(String, u32)>) {
    let source = [include_str!("../kernels/trace.wgsl"), rest].concat();
    let module = wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(&source)));
    let (_, found) = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name)).unwrap();
    let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
    (*span, members.iter().map(|member| (member.name.clone().unwrap(), member.offset)).collect())
}

fn expect(name: &str, size: usize, members: &[(&str, u32)]) {
    expect_in(include_str!("../kernels/list.wgsl"), name, size, members);
}

fn expect_in(rest: &str, name: &str, size: usize, members: &[(&str, u32)]) {
    let (span, found) = layout(rest, name);
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

/// Their structs of the crate are not public: src/gpu/effects.rs has the same members in this order, without gaps, and `Lamp` with three more numbers at its end.
#[test]
fn structs_of_effects_have_the_sizes_that_are_uploaded() {
    let effects = include_str!("../kernels/effects.wgsl");
    let picture = ["eye", "width", "right", "height", "up", "half_width", "forward", "half_height", "origin", "voxel"];
    let offsets = (0..5).flat_map(|row| [16 * row, 16 * row + 12]);
    expect_in(effects, "Picture", 80, &picture.into_iter().zip(offsets).collect::<Vec<_>>());
    let mut job: Vec<(&str, u32)> = vec![("rays", 0), ("seed", 4), ("lamps", 8), ("in_picture", 12)];
    job.extend([("reach", 16), ("roughness", 20), ("tolerance", 24), ("density", 28)]);
    job.extend([("apart", 32), ("distance", 36), ("cosine", 40), ("step", 44), ("sky", 48), ("ambient", 60)]);
    job.extend([("coarsest", 64), ("fine_until", 68), ("share", 72), ("longest", 76)]);
    expect_in(effects, "Job", 80, &job);
    let lamp =
        [("position", 0), ("radius", 12), ("color", 16), ("reach", 28), ("axis", 32), ("inner", 44), ("outer", 48)];
    expect_in(effects, "Lamp", 64, &lamp);
}
