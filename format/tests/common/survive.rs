//! Reading untrusted bytes.

use esvo_format::{
    FormatError, IndexReader, Octree, OpenOptions, Region, StreamReader, stats, stream_stats, validate_bytes_with,
};

/// The largest image of a vector has 0.3 MiB. Damaged compressed files may claim any size.
const OPTIONS: OpenOptions = OpenOptions { memory_limit: 16 << 20, verify: true };

/// Applies all functions that accept untrusted bytes. Returns whether the bytes are refused.
pub(crate) fn survive(bytes: &[u8]) -> bool {
    let report = match validate_bytes_with(bytes, &OPTIONS) {
        Ok(report) => report,
        Err(FormatError::Limit(_)) => {
            assert!(matches!(Octree::from_bytes_with(bytes, &OPTIONS), Err(FormatError::Limit(_))));
            return true;
        }
        Err(other) => panic!("{other}"),
    };
    match Octree::from_bytes_with(bytes, &OPTIONS) {
        Ok(octree) => {
            let counted = stats(&octree);
            assert_eq!(counted.bytes.total(), counted.image_bytes);
            octree.needs();
            match octree.sound() {
                // Every sound octree can be walked to its end.
                Ok(()) => {
                    visit(&octree);
                    // Damage that no pointer leads to does not hinder the walk, but is found by the checksums.
                    if report.is_ok() {
                        let reader = StreamReader::open_with(bytes, &OPTIONS).unwrap();
                        assert_eq!(stream_stats(&reader).unwrap(), counted);
                    }
                }
                Err(broken) => assert!(!report.is_ok(), "{broken}"),
            }
        }
        Err(FormatError::Broken(broken)) => assert!(report.findings.iter().any(|f| f.broken == broken)),
        Err(other) => panic!("{other}"),
    }
    if let Ok(reader) = StreamReader::open_with(bytes, &OPTIONS)
        && let Ok(counted) = stream_stats(&reader)
    {
        assert_eq!(counted.bytes.total(), counted.image_bytes);
    }
    served(bytes);
    !report.is_ok()
}

/// Reads a file in parts, by its tables and by its index. Whatever opens gives octrees that can be walked.
fn served(bytes: &[u8]) {
    if let Ok(reader) = StreamReader::open_with(bytes, &OPTIONS) {
        for level in [1, 3, 23] {
            let octree = reader.partial_parts(&reader.parts_for(0, &Region::ALL, level));
            octree.iter().for_each(visit);
        }
    }
    if let Ok(mut reader) = IndexReader::open_with(bytes, &OPTIONS) {
        for level in [1, 3, 23] {
            reader.octree(0, &Region::ALL, level).iter().for_each(visit);
        }
    }
}

/// Visits every voxel.
pub(crate) fn visit(octree: &Octree) {
    let mut stack: Vec<u32> = octree.objects().iter().map(|o| o.root_slot as u32).collect();
    while let Some(slot) = stack.pop() {
        for child in 0..8 {
            octree.contour(slot, child).map(|contour| contour.decode());
            octree.color(slot, child);
            octree.normal(slot, child);
            octree.plain_color(slot, child);
            octree.plain_normal(slot, child);
            octree.ambient(slot, child);
            octree.corners(slot, child).map(|cell| cell.middle());
            stack.extend(octree.child(slot, child));
        }
    }
}
