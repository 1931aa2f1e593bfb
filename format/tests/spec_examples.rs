//! The example bytes in the specification are those of its test vectors.

use std::path::Path;

/// Offset and bytes of a line of an example. `None` if the line has no bytes.
fn line(text: &str) -> Option<(usize, Vec<u8>)> {
    let (offset, rest) = text.split_once("  ")?;
    let bytes = rest.split("  ").next()?.split(' ').map(|byte| u8::from_str_radix(byte, 16));
    Some((usize::from_str_radix(offset, 16).ok()?, bytes.collect::<Result<_, _>>().ok()?))
}

#[test]
fn the_examples_are_test_vectors() {
    let mut seen = Vec::new();
    for example in esvo_spec::TEXT_V1.split("```hex ").skip(1) {
        let (title, rest) = example.split_once('\n').unwrap();
        let (name, extent) = title.split_once(' ').unwrap();
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../spec/v1/vectors/valid");
        let vector = std::fs::read(folder.join(name)).unwrap();
        let mut shown = vec![0u8; vector.len()];
        let (mut end, mut count) = (0, 0);
        for text in rest.split("```").next().unwrap().lines() {
            let (offset, bytes) = line(text).unwrap_or_else(|| panic!("{name}: not a line of an example: {text}"));
            assert!(offset >= end, "{name}: lines overlap at {offset:#x}");
            end = offset + bytes.len();
            assert_eq!(vector[offset..end], bytes, "{name} at {offset:#x}");
            shown[offset..end].copy_from_slice(&bytes);
            count += bytes.len();
        }
        assert!(count > 100);
        if extent == "complete" {
            assert_eq!(shown, vector, "{name}: bytes that are not shown are zero");
            assert_eq!(end, vector.len(), "{name}: the last line shows the end");
        }
        seen.push((name, extent));
    }
    assert_eq!(
        seen,
        [("single_voxel.esvo", "complete"), ("written_blocks.esvo", "part"), ("written_plain.esvo", "part")]
    );
}
