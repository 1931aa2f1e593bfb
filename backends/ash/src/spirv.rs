//! Translates WGSL to SPIR-V whose arithmetic is rounded as it is written.

use naga::back::spv;
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use spirv::{Decoration, Op};

/// SPIR-V 1.3 (Vulkan 1.1) for one entry point of a WGSL source.
///
/// The module has no bounds checks. It needs none: an octree is checked before it is loaded, a root before it is cast
/// from, and the kernel gives up after a fixed number of steps.
///
/// # Errors
/// The source is not valid WGSL, or has no such entry point; naga's text, with the line of the source.
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
/// `OpDecorate` of one id with one decoration: three words.
const DECORATE: u32 = 3 << 16 | Op::Decorate as u32;
const NO_CONTRACTION: u32 = Decoration::NoContraction as u32;

/// The opcode of an instruction, if this version of SPIR-V knows it, and its length in words.
fn opcode(first_word: u32) -> (Option<Op>, usize) {
    (Op::from_u32(first_word & 0xffff), (first_word >> 16) as usize)
}

/// Whether the result of an instruction is a sum, difference or product of floating-point numbers.
fn is_sum_or_product(op: Op) -> bool {
    matches!(op, Op::FAdd | Op::FSub | Op::FMul | Op::VectorTimesScalar | Op::Dot)
}

/// Decorates the result of every addition, subtraction and multiplication of floating-point numbers with
/// `NoContraction`, which forbids the driver to fuse them. Returns the words unchanged if they are not SPIR-V.
pub fn forbid_contraction(words: &[u32]) -> Vec<u32> {
    let mut decorations = Vec::new();
    let mut after_annotations = None;
    let mut before_types = None;
    let mut at = HEADER_WORDS;
    while let Some(&head) = words.get(at) {
        let (op, length) = opcode(head);
        if length == 0 || at + length > words.len() {
            return words.to_vec();
        }
        match op {
            Some(op) if op.is_annotation() => after_annotations = Some(at + length),
            Some(op) if op.is_type() && before_types.is_none() => before_types = Some(at),
            Some(op) if is_sum_or_product(op) && length >= 3 => {
                decorations.extend([DECORATE, words[at + 2], NO_CONTRACTION]);
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

    use esvo_core::gpu::arithmetic::Arithmetic;
    use esvo_core::gpu::kernel::{ENTRY_CAST, ENTRY_COARSE, ENTRY_INSTANCES, ENTRY_RAYS, ENTRY_TIME, Variant};
    use esvo_core::gpu::slots::Slots;

    use super::*;

    /// Opcode and operands of every instruction.
    fn instructions(words: &[u32]) -> Vec<(Op, &[u32])> {
        let mut all = Vec::new();
        let mut rest = &words[HEADER_WORDS..];
        while let Some(&head) = rest.first() {
            let (op, length) = opcode(head);
            let (now, later) = rest.split_at(length);
            all.push((op.expect("naga writes known instructions"), &now[1..]));
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
            .filter(|(op, operands)| *op == Op::Decorate && operands.get(1) == Some(&NO_CONTRACTION))
            .map(|(_, operands)| operands[0])
            .collect();
        let arithmetic: HashSet<u32> = instructions(&plain)
            .iter()
            .filter(|(op, _)| [Op::FAdd, Op::FSub, Op::FMul, Op::VectorTimesScalar, Op::Dot].contains(op))
            .map(|(_, operands)| operands[1])
            .collect();
        assert_eq!(decorated, arithmetic);
        assert_eq!(arithmetic.len(), 4);
        let others = |words| {
            let mut all = instructions(words);
            all.retain(|(op, operands)| *op != Op::Decorate || operands.get(1) != Some(&NO_CONTRACTION));
            all.into_iter().map(|(op, operands)| (op, operands.to_vec())).collect::<Vec<_>>()
        };
        assert_eq!(others(&ours), others(&plain));
        // Annotations come before types.
        let ops: Vec<Op> = instructions(&ours).iter().map(|(op, _)| *op).collect();
        let last_annotation = ops.iter().rposition(|op| *op == Op::Decorate);
        let first_type = ops.iter().position(|op| op.is_type());
        assert!(last_annotation.is_some() && last_annotation < first_type);
    }

    #[test]
    fn what_is_not_spirv_comes_back() {
        let cut_off = 9 << 16 | Op::FAdd as u32;
        for words in [&[][..], &[1, 2, 3], &[0, 0, 0, 0, 0, 0], &[0, 0, 0, 0, 0, cut_off, 1]] {
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
            let several = |parts| Slots::Buffers { parts, part_shift: 24 };
            for (levels, slots) in
                [(1, Slots::ONE_BUFFER), (12, several(2)), (23, several(30)), (12, Slots::Texture { row_shift: 11 })]
            {
                let variant = Variant {
                    contours: bits & 1 != 0,
                    far_pointers: bits & 2 != 0,
                    lod: bits & 4 != 0,
                    beam: bits & 8 != 0,
                    rays: false,
                    instances: false,
                    levels,
                    beam_block: 4 + 4 * (bits & 1),
                    slots,
                    workgroup: (8, 8),
                    arithmetic: if bits & 1 != 0 { Arithmetic::EXACT } else { Arithmetic::PLAIN },
                };
                for entry in [ENTRY_CAST, ENTRY_TIME] {
                    module(&variant.source(), entry).expect("compiles");
                }
                module(&variant.of_coarse_pass().source(), ENTRY_COARSE).expect("compiles");
                module(&Variant { rays: true, beam: false, ..variant }.source(), ENTRY_RAYS).expect("compiles");
                let instances = Variant { instances: true, beam: false, ..variant };
                module(&instances.source(), ENTRY_INSTANCES).expect("compiles");
            }
        }
    }
}
