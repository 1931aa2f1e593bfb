//! The hierarchy over the footprints of instances.

use bytemuck::{Pod, Zeroable};

use super::footprint::Footprint;
use crate::View;

/// A node of the hierarchy, as the kernels read it: 128 bytes. A test compares it with the kernel's struct of the same name.
///
/// Nodes are in the order in which they are visited, each before what it holds. Of two nodes that a third one holds, the one
/// that begins nearer comes first: the rays of a picture are parallel in its space, so that this order is right for all.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct Node {
    /// First column and row of the pixels whose rays can hit something in it.
    pub low: [u32; 2],
    /// Last column and row.
    pub high: [u32; 2],
    /// No hit in it has a smaller `t`.
    pub t: f32,
    /// The node to go on with where this one is passed by; the number of nodes after the last.
    pub skip: u32,
    /// Number of the instance; [`NO_INSTANCE`] if this node holds the next one and others up to `skip`.
    pub number: u32,
    /// Zero.
    pub padding: u32,
    /// The view of the instance; zeros without one.
    pub view: View,
}

/// [`Node::number`] of a node that holds others.
pub const NO_INSTANCE: u32 = u32::MAX;

/// The nodes over these views; a view that nothing can be seen in has none.
pub(super) fn build(views: &[View]) -> Vec<Node> {
    let mut seen: Vec<(u32, Footprint)> =
        (0..).zip(views).filter_map(|(number, view)| Some((number, Footprint::of(view)?))).collect();
    let mut nodes = Vec::with_capacity((2 * seen.len()).saturating_sub(1));
    if !seen.is_empty() {
        add(&mut nodes, views, &mut seen);
    }
    nodes
}

/// Adds the node that holds these instances, at least one, and all nodes in it.
fn add(nodes: &mut Vec<Node>, views: &[View], seen: &mut [(u32, Footprint)]) {
    let at = nodes.len();
    let around = around(seen);
    let (number, view) = match seen {
        [(number, _)] => (*number, views[*number as usize]),
        _ => (NO_INSTANCE, View::zeroed()),
    };
    let Footprint { low, high, t } = around;
    nodes.push(Node { low, high, t, skip: 0, number, padding: 0, view });
    if seen.len() > 1 {
        let (first, second) = {
            let half = partition(seen);
            seen.split_at_mut(half)
        };
        let order = if self::around(second).t < self::around(first).t { [second, first] } else { [first, second] };
        order.into_iter().for_each(|half| add(nodes, views, half));
    }
    nodes[at].skip = nodes.len() as u32;
}

fn around(seen: &[(u32, Footprint)]) -> Footprint {
    let mut all = seen[0].1;
    for (_, one) in &seen[1..] {
        for axis in 0..2 {
            all.low[axis] = all.low[axis].min(one.low[axis]);
            all.high[axis] = all.high[axis].max(one.high[axis]);
        }
        all.t = all.t.min(one.t);
    }
    all
}

/// Brings the instances into two halves, by their place in the picture while they lie beside each other, then by depth. Returns the
/// number of those in the first.
fn partition(seen: &mut [(u32, Footprint)]) -> usize {
    // Twice the middle, and the edge.
    let middle = |one: &Footprint, axis: usize| u64::from(one.low[axis]) + u64::from(one.high[axis]);
    let edge = |one: &Footprint, axis: usize| u64::from(one.high[axis] - one.low[axis] + 1);
    // How far the middles are apart, in edges of a mean footprint.
    let spread = |axis: usize| {
        let (mut low, mut high, mut edges) = (u64::MAX, 0, 0);
        for (_, one) in seen.iter() {
            (low, high) = (low.min(middle(one, axis)), high.max(middle(one, axis)));
            edges += edge(one, axis);
        }
        (high - low) as f64 * 0.5 * seen.len() as f64 / edges as f64
    };
    let (x, y) = (spread(0), spread(1));
    let half = seen.len() / 2;
    if x.max(y) < 1.0 {
        seen.select_nth_unstable_by(half, |a, b| a.1.t.total_cmp(&b.1.t).then(a.0.cmp(&b.0)));
    } else {
        let axis = usize::from(y > x);
        seen.select_nth_unstable_by_key(half, |(number, one)| (middle(one, axis), *number));
    }
    half
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CastOptions;
    use crate::testing::instances::{camera, moving, views};
    use crate::testing::sample::two_objects;

    #[test]
    fn every_instance_in_the_picture_is_in_one_leaf_and_nodes_hold_what_follows() {
        let octree = two_objects().unwrap();
        for inside in [false, true] {
            let options = CastOptions::default();
            let views = views(&octree, &moving(300, 1), &camera(inside), (200, 100), &options).unwrap();
            let nodes = build(&views);
            let mut leaves: Vec<u32> = nodes.iter().map(|node| node.number).filter(|n| *n != NO_INSTANCE).collect();
            leaves.sort_unstable();
            let seen = (0..).zip(&views).filter(|(_, view)| Footprint::of(view).is_some()).map(|(number, _)| number);
            assert_eq!(leaves, seen.collect::<Vec<u32>>());
            assert_eq!(nodes.len(), 2 * leaves.len() - 1);
            assert_eq!(inside, leaves.len() < 250, "a camera among them does not see all");
            for (at, node) in nodes.iter().enumerate() {
                let skip = node.skip as usize;
                assert!(skip > at && skip <= nodes.len());
                assert_eq!(node.number != NO_INSTANCE, skip == at + 1);
                for below in &nodes[at + 1..skip] {
                    assert!(below.skip <= node.skip && below.t >= node.t);
                    assert!(
                        (0..2).all(|axis| below.low[axis] >= node.low[axis] && below.high[axis] <= node.high[axis])
                    );
                }
                if skip > at + 1 {
                    let second = nodes[at + 1].skip as usize;
                    assert!(nodes[at + 1].t <= nodes[second].t, "the nearer half comes first");
                }
            }
        }
    }
}
