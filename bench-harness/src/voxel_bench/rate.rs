//! Comparing what a method finds with the exact voxels.

use std::collections::BTreeSet;

use esvo_builder::cells::{PreparedMesh, morton, morton_place};
use esvo_raster::{Method, bounds};

use crate::BenchError;
use crate::voxel_bench::surface::failed;

/// Two ascending lists: what is only in the first, and what is only in the second.
pub(crate) fn differences(first: &[u64], second: &[u64]) -> (Vec<u64>, Vec<u64>) {
    let (mut only_first, mut only_second) = (Vec::new(), Vec::new());
    let (mut i, mut j) = (0, 0);
    while i < first.len() || j < second.len() {
        match (first.get(i), second.get(j)) {
            (Some(a), Some(b)) if a == b => (i, j) = (i + 1, j + 1),
            (Some(a), b) if b.is_none_or(|b| a < b) => {
                only_first.push(*a);
                i += 1;
            }
            (_, Some(b)) => {
                only_second.push(*b);
                j += 1;
            }
            _ => break,
        }
    }
    (only_first, only_second)
}

/// Of the voxels in which a method that tests differs from the exact ones: how many no triangle is so close to that single precision
/// could not say whether it meets them.
///
/// # Errors
/// None but of codes that are not ascending.
pub(crate) fn beyond_bound(prepared: &PreparedMesh, level: u32, codes: &[u64]) -> Result<u64, BenchError> {
    if codes.is_empty() {
        return Ok(0);
    }
    // Triangles of the voxel and of those around it: one that just misses the voxel meets one of them.
    let edge = 1i64 << level;
    let around = |code: u64| -> Vec<u64> {
        let at = morton_place(code).map(i64::from);
        let mut all = Vec::with_capacity(27);
        for step in 0..27i64 {
            let cell = [at[0] + step % 3 - 1, at[1] + step / 3 % 3 - 1, at[2] + step / 9 - 1];
            if cell.iter().all(|x| (0..edge).contains(x)) {
                all.push(morton(cell.map(|x| x as u32)));
            }
        }
        all
    };
    let mut outside = 0;
    // In parts, so that the lists of triangles stay small.
    for part in codes.chunks(100_000) {
        let asked: Vec<u64> = part.iter().flat_map(|&code| around(code)).collect::<BTreeSet<_>>().into_iter().collect();
        let triangles = prepared.triangles_in(level, &asked).map_err(|e| failed("voxels", e))?;
        let scale = edge as f64;
        for &code in part {
            let cell = morton_place(code).map(i64::from);
            let near = around(code).into_iter().any(|neighbour| {
                let index = asked.partition_point(|&code| code < neighbour);
                triangles.of(index).iter().any(|&triangle| {
                    let corners = prepared.corners()[triangle as usize].map(|corner| corner * scale);
                    bounds::may_differ(&corners, cell)
                })
            });
            outside += u64::from(!near);
        }
    }
    Ok(outside)
}

/// The methods of these names or letters; all, if there are none.
///
/// # Errors
/// A name that no method has.
pub(crate) fn methods(names: &[String]) -> Result<Vec<Method>, BenchError> {
    if names.is_empty() {
        return Ok(Method::ALL.to_vec());
    }
    names.iter().map(|name| name.parse().map_err(|e: String| BenchError::option("--methods", e))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_away_from_triangles_are_beyond_the_bound() {
        let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 1.0, 0.7]];
        let mesh = esvo_builder::Mesh::from_triangles(positions, vec![[0, 1, 2]]).unwrap();
        let prepared = PreparedMesh::new(&mesh, 5).unwrap();
        let exact = prepared.cells(5).unwrap();
        let sure: Vec<u64> = (0..1 << 15)
            .filter(|code| {
                let corners = prepared.corners()[0].map(|corner| corner * 32.0);
                !bounds::may_differ(&corners, morton_place(*code).map(i64::from))
            })
            .collect();
        assert!(sure.len() > 30_000);
        // Those that the triangle clearly meets count as well: missing ones would be wrong.
        assert_eq!(beyond_bound(&prepared, 5, &sure).unwrap(), sure.len() as u64);
        // Corners in borders of the grid are too close to say.
        let close: Vec<u64> = exact.iter().copied().filter(|code| sure.binary_search(code).is_err()).collect();
        assert!(!close.is_empty());
        assert_eq!(beyond_bound(&prepared, 5, &close).unwrap(), 0);
    }

    #[test]
    fn differences_of_lists() {
        assert_eq!(differences(&[1, 3, 4, 9], &[2, 3, 9, 10]), (vec![1, 4], vec![2, 10]));
        assert_eq!(differences(&[], &[5]), (vec![], vec![5]));
        assert_eq!(differences(&[5], &[]), (vec![5], vec![]));
    }
}
