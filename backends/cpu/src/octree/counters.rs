//! Counts what octree casters do, in runs of their own: with the feature `counters`. Without it, counting compiles to nothing.

use esvo_core::reference::MAX_SCALE;

/// What is counted.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(usize)]
#[non_exhaustive]
pub enum What {
    /// Children that a tile of 16 x 16 pixels was tested against.
    TileTests,
    /// Nodes that a tile entered.
    TilePushes,
    /// Blocks of 4 x 4 pixels that were tested against a child that their tile did not enter, or only in part.
    BlockTests,
    /// Blocks that left their tile at such a child.
    BlockWalks,
    /// Children that a packet of sixteen rays, or a ray that is cast alone, was tested against.
    Visits,
    /// Nodes that a packet or a ray entered.
    Pushes,
    /// Steps of a ray that is cast alone to a neighbour.
    Advances,
    /// Steps of a ray that is cast alone out of a node. A packet leaves nodes when their children are done.
    Pops,
    /// Contours that a packet or a ray was clipped against.
    ContourTests,
    /// Contours that a tile was clipped against.
    TileContours,
    /// Rays of packets that rounding may lead elsewhere and that were cast again alone.
    CastAgain,
    /// Bytes of descriptors, far pointers and contours that were read.
    Bytes,
}

impl What {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::TileTests,
        Self::TilePushes,
        Self::BlockTests,
        Self::BlockWalks,
        Self::Visits,
        Self::Pushes,
        Self::Advances,
        Self::Pops,
        Self::ContourTests,
        Self::TileContours,
        Self::CastAgain,
        Self::Bytes,
    ];

    /// Its name in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::TileTests => "tile tests",
            Self::TilePushes => "tile pushes",
            Self::BlockTests => "block tests",
            Self::BlockWalks => "block walks",
            Self::Visits => "visits",
            Self::Pushes => "pushes",
            Self::Advances => "advances",
            Self::Pops => "pops",
            Self::ContourTests => "contour tests",
            Self::TileContours => "tile contours",
            Self::CastAgain => "cast again",
            Self::Bytes => "bytes",
        }
    }
}

/// Levels that [`Counts::alive`] tells apart.
const LEVELS: usize = MAX_SCALE as usize + 1;

/// What was counted.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Counts {
    totals: [u64; What::ALL.len()],
    /// For each level of a voxel, 1 for the children of the root: visits of packets, and rays that were alive in them.
    pub alive: [(u64, u64); LEVELS],
}

impl Counts {
    /// How often this was counted.
    pub fn get(&self, what: What) -> u64 {
        self.totals[what as usize]
    }
}

#[cfg(feature = "counters")]
mod shared {
    use std::sync::atomic::AtomicU64;

    use super::{LEVELS, What};

    pub(super) static TOTALS: [AtomicU64; What::ALL.len()] = [const { AtomicU64::new(0) }; What::ALL.len()];
    pub(super) static ALIVE: [[AtomicU64; 2]; LEVELS] = [const { [const { AtomicU64::new(0) }; 2] }; LEVELS];
}

/// What all threads of the process have counted since the last call. `None` without the feature `counters`.
pub fn take() -> Option<Counts> {
    #[cfg(feature = "counters")]
    return Some(Counts {
        totals: shared::TOTALS.each_ref().map(|total| total.swap(0, std::sync::atomic::Ordering::Relaxed)),
        alive: shared::ALIVE.each_ref().map(|level| {
            let [visits, rays] = level.each_ref().map(|n| n.swap(0, std::sync::atomic::Ordering::Relaxed));
            (visits, rays)
        }),
    });
    #[cfg(not(feature = "counters"))]
    None
}

/// Counts.
#[inline(always)]
pub(super) fn count(_what: What, _by: u32) {
    #[cfg(feature = "counters")]
    shared::TOTALS[_what as usize].fetch_add(u64::from(_by), std::sync::atomic::Ordering::Relaxed);
}

/// Counts a visit of a packet to a voxel of this scale, and the rays that are alive.
#[inline(always)]
pub(super) fn count_alive(_scale: u32, _rays: u32) {
    #[cfg(feature = "counters")]
    {
        let [visits, rays] = &shared::ALIVE[(MAX_SCALE - _scale.min(MAX_SCALE)) as usize];
        visits.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        rays.fetch_add(u64::from(_rays), std::sync::atomic::Ordering::Relaxed);
    }
}
