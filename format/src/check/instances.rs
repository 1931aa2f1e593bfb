//! The table of instances (spec 3.1, rules N001 to N004).

use crate::check::tables::is_usable;
use crate::file::*;
use crate::{Broken, ids};

/// Reads the section, which begins at `offset`, of a file with so many objects.
pub(crate) fn read(bytes: &[u8], objects: usize, offset: u64) -> Result<Vec<InstanceEntry>, Broken> {
    let count = bytes.len() as u64 / INSTANCE_BYTES;
    if bytes.is_empty() || !(bytes.len() as u64).is_multiple_of(INSTANCE_BYTES) || count > MAX_INSTANCES {
        let what = format!(
            "the table of instances has {} bytes, expected 1 to {MAX_INSTANCES} entries of {INSTANCE_BYTES}",
            bytes.len()
        );
        return Err(Broken::new(ids::INSTANCE_TABLE, offset, what));
    }
    let entries: Vec<InstanceEntry> = bytes.chunks_exact(INSTANCE_BYTES as usize).filter_map(from_bytes).collect();
    check(&entries, objects, offset)?;
    Ok(entries)
}

/// Checks instances of so many objects. The first is at byte `at`.
pub(crate) fn check(entries: &[InstanceEntry], objects: usize, at: u64) -> Result<(), Broken> {
    if entries.len() as u64 > MAX_INSTANCES {
        let what = format!("there are {} instances, expected at most {MAX_INSTANCES}", entries.len());
        return Err(Broken::new(ids::INSTANCE_TABLE, at, what));
    }
    for (index, entry) in entries.iter().enumerate() {
        let broken = |rule, field, what: String| {
            Err(Broken::new(rule, at + index as u64 * INSTANCE_BYTES + field, format!("instance {index}: {what}")))
        };
        if entry.object as usize >= objects {
            let what = format!("there is no object {}: the file has {objects}, counted from 0", entry.object);
            return broken(ids::INSTANCE_OBJECT, 0, what);
        }
        if entry.reserved != 0 {
            return broken(ids::INSTANCE_RESERVED, 4, "the reserved field is not zero".into());
        }
        if !is_usable(&entry.matrix().to_cols_array()) {
            let what = format!("the matrix {:?} is not finite and invertible", entry.mesh_to_scene);
            return broken(ids::INSTANCE_MATRIX, 8, what);
        }
    }
    Ok(())
}
