//! The instruction sets that there is code for.

use std::fmt;

use super::scene::Scene;
use super::task::Task;
use super::{shared, single};
use crate::vectors::Vectors;

/// Instructions that an octree caster is compiled for.
///
/// All but `Scalar` cast pictures in packets of sixteen rays that go through the tree together. NEON, AVX2 and AVX-512 cast lists
/// of rays and fans in packets, too, while their rays stay together, and in lockstep where they do not; the others cast them one
/// ray at a time. The [`iterations`](esvo_core::Hit::iterations) of a packet's hits are those of the packet; all else equals
/// the reference's hits.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[non_exhaustive]
pub enum InstructionSet {
    /// Packets of sixteen rays in plain arrays, on every processor.
    Arrays,
    /// One ray at a time, on every processor; with AVX2 and BMI where the processor has them.
    Scalar,
    /// Packets of sixteen rays, four to a vector; pictures in tiles.
    Neon,
    /// Packets of sixteen rays, four to a vector, on every x86-64 processor; pictures in tiles.
    Sse2,
    /// Packets of sixteen rays, eight to a vector; pictures in tiles.
    Avx2,
    /// Packets of sixteen rays in one vector; pictures in tiles.
    Avx512,
}

impl InstructionSet {
    /// All of them, the fastest last.
    pub const ALL: [Self; 6] = [Self::Arrays, Self::Scalar, Self::Neon, Self::Sse2, Self::Avx2, Self::Avx512];

    /// Those that this processor has, the fastest last.
    pub fn available() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|set| set.is_available())
    }

    /// The fastest that this processor has.
    pub fn best() -> Self {
        Self::available().last().unwrap_or(Self::Scalar)
    }

    /// Whether this processor has it.
    pub fn is_available(self) -> bool {
        self.vectors().is_none_or(Vectors::are_available)
    }

    /// Its name: `arrays`, `scalar`, `NEON`, `SSE2`, `AVX2`, `AVX-512`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scalar => "scalar",
            Self::Arrays => "arrays",
            Self::Neon => "NEON",
            Self::Sse2 => "SSE2",
            Self::Avx2 => "AVX2",
            Self::Avx512 => "AVX-512",
        }
    }

    /// What the description of a device says about it.
    pub(super) fn detail(self) -> &'static str {
        match self {
            Self::Scalar => single::detail(),
            Self::Arrays => "arrays of 16",
            Self::Neon => "NEON, 4 lanes",
            Self::Sse2 => "SSE2, 4 lanes",
            Self::Avx2 => "AVX2, 8 lanes",
            Self::Avx512 => "AVX-512, 16 lanes",
        }
    }

    /// The vectors of its packets, if it has packets.
    fn vectors(self) -> Option<Vectors> {
        match self {
            Self::Scalar => None,
            Self::Arrays => Some(Vectors::Arrays),
            Self::Neon => Some(Vectors::Neon),
            Self::Sse2 => Some(Vectors::Sse2),
            Self::Avx2 => Some(Vectors::Avx2),
            Self::Avx512 => Some(Vectors::Avx512),
        }
    }

    /// Does a task.
    pub(super) fn run(self, scene: &Scene, task: Task) {
        let left = match self.vectors() {
            Some(vectors) => shared::run(vectors, scene, task),
            None => Some(task),
        };
        if let Some(task) = left {
            single::run(scene, task);
        }
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
