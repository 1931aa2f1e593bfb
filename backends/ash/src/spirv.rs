//! From WGSL to SPIR-V whose arithmetic is rounded as it is written.

use naga::back::spv;
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// SPIR-V 1.3 (Vulkan 1.1) for one entry point of a WGSL source.
///
/// There are no bounds checks: the caster checks an octree before it is loaded, and the kernel gives up after a fixed
/// number of steps.
///
/// # Errors
/// What naga says of the source.
pub fn module(source: &str, entry: &str) -> Result<Vec<u32>, String> {
    let module = naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .map_err(|error| error.emit_to_string(source))?;
    let unchecked = BoundsCheckPolicies {
        index: BoundsCheckPolicy::Unchecked,
        buffer: BoundsCheckPolicy::Unchecked,
        image_load: BoundsCheckPolicy::Unchecked,
        binding_array: BoundsCheckPolicy::Unchecked,
    };
    let options = spv::Options {
        lang_version: (1, 3),
        flags: spv::WriterFlags::empty(),
        bounds_check_policies: unchecked,
        force_loop_bounding: false,
        ..spv::Options::default()
    };
    let entry = spv::PipelineOptions { shader_stage: naga::ShaderStage::Compute, entry_point: entry.to_owned() };
    let words = spv::write_vec(&module, &info, &options, Some(&entry)).map_err(|error| error.to_string())?;
    Ok(forbid_contraction(&words))
}

/// Words before the first instruction.
const HEADER_WORDS: usize = 5;
// Opcodes and the decoration, as the SPIR-V specification numbers them.
const OP_DECORATE: u32 = 71;
const OP_DECORATE_ID: u32 = 332;
const OP_MEMBER_DECORATE: u32 = 72;
const OP_F_ADD: u32 = 129;
const OP_F_SUB: u32 = 131;
const OP_F_MUL: u32 = 133;
const OP_VECTOR_TIMES_SCALAR: u32 = 142;
const OP_DOT: u32 = 148;
const FIRST_OP_TYPE: u32 = 19;
const LAST_OP_TYPE: u32 = 39;
const NO_CONTRACTION: u32 = 42;

/// Decorates the result of every addition, subtraction and multiplication of floating-point numbers with
/// `NoContraction`, which forbids to fuse them. What is not SPIR-V comes back as it is.
pub fn forbid_contraction(words: &[u32]) -> Vec<u32> {
    let mut decorations = Vec::new();
    let mut after_annotations = None;
    let mut before_types = None;
    let mut at = HEADER_WORDS;
    while let Some(&head) = words.get(at) {
        let (opcode, length) = (head & 0xffff, (head >> 16) as usize);
        if length == 0 || at + length > words.len() {
            return words.to_vec();
        }
        match opcode {
            OP_DECORATE | OP_MEMBER_DECORATE | OP_DECORATE_ID => after_annotations = Some(at + length),
            FIRST_OP_TYPE..=LAST_OP_TYPE if before_types.is_none() => before_types = Some(at),
            OP_F_ADD | OP_F_SUB | OP_F_MUL | OP_VECTOR_TIMES_SCALAR | OP_DOT if length >= 3 => {
                decorations.extend([3 << 16 | OP_DECORATE, words[at + 2], NO_CONTRACTION]);
            }
            _ => {}
        }
        at += length;
    }
    let Some(insert) = after_annotations.or(before_types) else { return words.to_vec() };
    [&words[..insert], &decorations, &words[insert..]].concat()
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use esvo_core::gpu::kernel::{ENTRY_CAST, ENTRY_COARSE, ENTRY_TIME, Variant};

    use super::*;

    /// (opcode, operands) of every instruction.
    fn instructions(words: &[u32]) -> Vec<(u32, &[u32])> {
        let mut all = Vec::new();
        let mut rest = &words[HEADER_WORDS..];
        while let Some(&head) = rest.first() {
            let (now, later) = rest.split_at((head >> 16) as usize);
            all.push((head & 0xffff, &now[1..]));
            rest = later;
        }
        all
    }

    #[test]
    fn every_sum_and_product_is_decorated_and_nothing_else_changes() {
        let source = "
            @group(0) @binding(0) var<storage, read_write> x: array<vec4<f32>>;
            @compute @workgroup_size(1) fn main() {
                let a = x[0];
                x[1] = a * x[2] + x[3];
                x[2].x = a.x - x[1].y / a.z;
                x[3] = a * a.x;
            }";
        let module_info = naga::front::wgsl::parse_str(source).expect("parses");
        let info =
            Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module_info).expect("is valid");
        let plain = spv::write_vec(&module_info, &info, &spv::Options::default(), None).expect("writes");
        let ours = forbid_contraction(&plain);

        let decorated: HashSet<u32> = instructions(&ours)
            .iter()
            .filter(|(opcode, operands)| *opcode == OP_DECORATE && operands.get(1) == Some(&NO_CONTRACTION))
            .map(|(_, operands)| operands[0])
            .collect();
        let arithmetic: HashSet<u32> = instructions(&plain)
            .iter()
            .filter(|(opcode, _)| [129, 131, 133, 142, 148].contains(opcode))
            .map(|(_, operands)| operands[1])
            .collect();
        assert_eq!(decorated, arithmetic);
        assert_eq!(arithmetic.len(), 4);
        let others = |words| {
            let mut all = instructions(words);
            all.retain(|(opcode, operands)| *opcode != OP_DECORATE || operands.get(1) != Some(&NO_CONTRACTION));
            all.into_iter().map(|(opcode, operands)| (opcode, operands.to_vec())).collect::<Vec<_>>()
        };
        assert_eq!(others(&ours), others(&plain));
        // Annotations come before types.
        let opcodes: Vec<u32> = instructions(&ours).iter().map(|(opcode, _)| *opcode).collect();
        let last_annotation = opcodes.iter().rposition(|opcode| *opcode == OP_DECORATE);
        let first_type = opcodes.iter().position(|opcode| (19..=39).contains(opcode));
        assert!(last_annotation < first_type);
    }

    #[test]
    fn what_is_not_spirv_comes_back() {
        for words in [&[][..], &[1, 2, 3], &[0, 0, 0, 0, 0, 0], &[0, 0, 0, 0, 0, 9 << 16 | 129, 1]] {
            assert_eq!(forbid_contraction(words), words);
        }
    }

    #[test]
    fn errors_quote_the_source() {
        let error = module("fn main() { oops }", "main").expect_err("does not parse");
        assert!(error.contains("oops"), "{error}");
    }

    #[test]
    fn all_variants_compile() {
        for bits in 0..16u32 {
            for (levels, parts) in [(1, 1), (12, 2), (23, 30)] {
                let variant = Variant {
                    contours: bits & 1 != 0,
                    far_pointers: bits & 2 != 0,
                    lod: bits & 4 != 0,
                    beam: bits & 8 != 0,
                    levels,
                    parts,
                    part_shift: 24,
                    workgroup: (8, 8),
                };
                for entry in [ENTRY_CAST, ENTRY_TIME] {
                    module(&variant.source(), entry).expect("compiles");
                }
                module(&variant.of_coarse_pass().source(), ENTRY_COARSE).expect("compiles");
            }
        }
    }
}
