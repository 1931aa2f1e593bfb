//! The instruction sets that there is code for.

use std::fmt;

use super::scene::Scene;
use super::tiles::Task;
#[cfg(target_arch = "x86_64")]
use super::{gather, packet};
use super::{shared, single};
use crate::vectors::Vectors;

/// Instructions that an octree caster is compiled for.
///
/// All but `Scalar` cast pictures in packets of sixteen rays that go through the tree together, and all but `Scalar` and
/// `Arrays` lists of rays and fans, too, while their rays stay together. The [`iterations`](esvo_core::Hit::iterations) of
/// such hits are those of the packet; all else equals the reference's hits. Other rays are cast one at a time, with AVX-512 in
/// lockstep.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[non_exhaustive]
pub enum InstructionSet {
    /// Packets of sixteen rays in plain arrays, on every processor, for pictures; other rays one at a time.
    Arrays,
    /// One ray at a time, on every processor; with AVX2 and BMI where the processor has them.
    Scalar,
    /// Packets of sixteen rays, four to a vector; pictures in tiles.
    Neon,
    /// Packets of sixteen rays, eight to a vector; pictures in tiles.
    Avx2,
    /// Packets of sixteen rays in one vector; pictures in tiles; rays that do not stay together in lockstep.
    Avx512,
}

impl InstructionSet {
    /// All of them, the fastest last.
    pub const ALL: [Self; 5] = [Self::Arrays, Self::Scalar, Self::Neon, Self::Avx2, Self::Avx512];

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
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => packet::is_available() && Vectors::Avx512.are_available(),
            _ => self.vectors().is_none_or(Vectors::are_available),
        }
    }

    /// Its name: `arrays`, `scalar`, `NEON`, `AVX2`, `AVX-512`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scalar => "scalar",
            Self::Arrays => "arrays",
            Self::Neon => "NEON",
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
            Self::Avx2 => "AVX2, 8 lanes",
            Self::Avx512 => "AVX-512, 16 lanes",
        }
    }

    /// 32-bit words of the largest image that its code can address.
    pub(super) fn max_words(self) -> usize {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => gather::Image::MAX_WORDS,
            _ => usize::MAX,
        }
    }

    /// The vectors of its packets, if it has packets.
    fn vectors(self) -> Option<Vectors> {
        match self {
            Self::Scalar => None,
            Self::Arrays => Some(Vectors::Arrays),
            Self::Neon => Some(Vectors::Neon),
            Self::Avx2 => Some(Vectors::Avx2),
            Self::Avx512 => Some(Vectors::Avx512),
        }
    }

    /// Does a task.
    pub(super) fn run(self, scene: &Scene, task: Task) {
        let apart = match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => lockstep,
            _ => single::run,
        };
        let left = match self.vectors() {
            Some(vectors) => shared::run(vectors, scene, task, apart),
            None => Some(task),
        };
        if let Some(task) = left {
            apart(scene, task);
        }
    }
}

/// Does a task with sixteen rays in lockstep. It can cast every scene that `CpuCaster` pairs with AVX-512.
#[cfg(target_arch = "x86_64")]
fn lockstep(scene: &Scene, task: Task) {
    match packet::Packets::new(scene) {
        Some(packets) => packets.run(task),
        None => single::run(scene, task),
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
