//! Where a kernel finds what it only reads, the slots of an octree or a hierarchy of triangles: in storage buffers, or in a texture.

use std::fmt::Write as _;

use super::kernel::GROUP_OCTREE;

/// What a slot is.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum SlotKind {
    /// 8 bytes, `vec2<u32>`: a slot of an octree.
    Pair,
    /// 16 bytes, `vec4<u32>`: a part of a node or of a triangle.
    Quad,
}

impl SlotKind {
    /// Bytes of a slot.
    pub fn bytes(self) -> u64 {
        match self {
            Self::Pair => 8,
            Self::Quad => 16,
        }
    }

    /// WGSL: the type of a slot, the format of texels, and what of a texel is the slot.
    fn wgsl(self) -> (&'static str, &'static str, &'static str) {
        match self {
            Self::Pair => ("vec2<u32>", "rg32uint", ".xy"),
            Self::Quad => ("vec4<u32>", "rgba32uint", ""),
        }
    }
}

/// Names in a kernel for what the bindings hold.
pub(super) struct Names {
    /// What a slot is.
    pub(super) kind: SlotKind,
    /// The function that reads a slot.
    pub(super) read: &'static str,
    /// What the names of the bindings start with.
    pub(super) prefix: &'static str,
}

/// Those of an octree.
pub(super) const OCTREE: Names = Names { kind: SlotKind::Pair, read: "slot_at", prefix: "" };

/// Where a kernel finds slots: bindings of group [`GROUP_OCTREE`].
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Slots {
    /// Storage buffers of slots.
    Buffers {
        /// Number of bindings, at least 1.
        parts: u32,
        /// With several bindings, each except the last holds `2^part_shift` slots.
        part_shift: u32,
    },
    /// A storage texture that is read, of the format `rg32uint` for pairs and `rgba32uint` for quads. Slot `s` is the texel in column
    /// `s % 2^row_shift` of row `s >> row_shift`.
    ///
    /// It needs WGSL's language feature `readonly_and_readwrite_storage_textures`. Drivers that run on the processor read texels
    /// of eight invocations at once, but words of a buffer one by one.
    Texture {
        /// Each row holds `2^row_shift` slots.
        row_shift: u32,
    },
}

/// Which of the [`Slots`] a caster takes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum SlotsIn {
    /// Storage buffers.
    Buffers,
    /// A texture, for what fits one.
    Texture,
}

/// Most bytes of a texture: the limit of the software driver llvmpipe.
pub const MAX_TEXTURE_BYTES: u64 = (1 << 30) - 1;

impl Slots {
    /// One buffer.
    pub const ONE_BUFFER: Self = Self::Buffers { parts: 1, part_shift: 31 };

    /// How `slots` slots are split over buffers of at most `max_bytes` each; `None` if it takes more than `max_parts`.
    pub fn split(slots: usize, kind: SlotKind, max_bytes: u64, max_parts: u32) -> Option<Self> {
        let max_slots = (max_bytes / kind.bytes()).max(1);
        if slots as u64 <= max_slots {
            return (max_parts > 0).then_some(Self::ONE_BUFFER);
        }
        let part_shift = max_slots.ilog2().min(31);
        let parts = u32::try_from((slots as u64).div_ceil(1 << part_shift)).ok()?;
        (parts <= max_parts).then_some(Self::Buffers { parts, part_shift })
    }

    /// A texture for `slots` slots, about as wide as high; `None` if it would be larger than `max_edge` texels or
    /// [`MAX_TEXTURE_BYTES`].
    pub fn texture(slots: usize, kind: SlotKind, max_edge: u32) -> Option<Self> {
        // At least 32 columns, so that a row is a multiple of 256 bytes.
        let row_shift = (slots.max(1).next_power_of_two().ilog2().div_ceil(2)).max(5);
        let rows = slots.div_ceil(1 << row_shift).max(1) as u64;
        let fits =
            rows.max(1 << row_shift) <= u64::from(max_edge) && (rows << row_shift) * kind.bytes() <= MAX_TEXTURE_BYTES;
        fits.then_some(Self::Texture { row_shift })
    }

    /// Number of bindings.
    pub fn bindings(self) -> u32 {
        match self {
            Self::Buffers { parts, .. } => parts,
            Self::Texture { .. } => 1,
        }
    }

    /// Number of bindings that are storage buffers.
    pub fn storage_buffers(self) -> u32 {
        match self {
            Self::Buffers { parts, .. } => parts,
            Self::Texture { .. } => 0,
        }
    }

    /// The slots of each buffer, in order; all in one piece for a texture.
    pub fn parts<T>(self, slots: &[T]) -> impl Iterator<Item = &[T]> {
        slots.chunks(match self {
            Self::Buffers { parts: 2.., part_shift } => 1 << part_shift,
            Self::Buffers { .. } | Self::Texture { .. } => slots.len().max(1),
        })
    }

    /// WGSL: the bindings from `first` on, and the function that reads a slot.
    pub(super) fn declare(self, names: &Names, first: u32, text: &mut String) {
        let Names { read, prefix, .. } = names;
        let (slot, format, components) = names.kind.wgsl();
        match self {
            Self::Buffers { parts, part_shift } => {
                for part in 0..parts {
                    let binding = first + part;
                    let _ = writeln!(
                        text,
                        "@group({GROUP_OCTREE}) @binding({binding}) var<storage, read> {prefix}part_{part}: array<{slot}>;"
                    );
                }
                let _ = writeln!(text, "fn {read}(slot: u32) -> {slot} {{");
                if parts == 1 {
                    let _ = writeln!(text, "    return {prefix}part_0[slot];\n}}");
                    return;
                }
                let _ = writeln!(text, "    let within = slot & {}u;", (1u32 << part_shift) - 1);
                let _ = writeln!(text, "    switch slot >> {part_shift}u {{");
                for part in 0..parts - 1 {
                    let _ = writeln!(text, "        case {part}u: {{ return {prefix}part_{part}[within]; }}");
                }
                let last = parts - 1;
                let _ = writeln!(text, "        default: {{ return {prefix}part_{last}[within]; }}\n    }}\n}}");
            }
            Self::Texture { row_shift } => {
                let columns = (1u32 << row_shift) - 1;
                let _ = write!(
                    text,
                    "@group({GROUP_OCTREE}) @binding({first}) var {prefix}texels: texture_storage_2d<{format}, read>;\n\
                     fn {read}(slot: u32) -> {slot} {{\n    \
                         return textureLoad({prefix}texels, vec2<u32>(slot & {columns}u, slot >> {row_shift}u)){components};\n}}\n"
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::SlotKind::{Pair, Quad};
    use super::*;

    #[test]
    fn octrees_are_split_only_when_they_must_be() {
        let buffers = |parts, part_shift| Some(Slots::Buffers { parts, part_shift });
        assert_eq!(Slots::split(1000, Pair, 8000, 4), buffers(1, 31));
        assert_eq!(Slots::split(1001, Pair, 8000, 4), buffers(2, 9));
        assert_eq!(Slots::split(2048, Pair, 8000, 4), buffers(4, 9));
        assert_eq!(Slots::split(2049, Pair, 8000, 4), None);
        assert_eq!(Slots::split(1 << 24, Pair, 1 << 27, 1), buffers(1, 31));
        assert_eq!(Slots::split((1 << 24) + 1, Pair, 1 << 27, 2), buffers(2, 24));
        assert_eq!(Slots::split(1, Pair, 8, 0), None);
        assert_eq!(Slots::split(500, Quad, 8000, 4), buffers(1, 31));
        assert_eq!(Slots::split(501, Quad, 8000, 4), buffers(2, 8));
    }

    #[test]
    fn textures_hold_every_slot_and_stay_within_the_limits() {
        let texture = |row_shift| Some(Slots::Texture { row_shift });
        assert_eq!(Slots::texture(0, Pair, 8192), texture(5));
        assert_eq!(Slots::texture(1024, Pair, 8192), texture(5));
        assert_eq!(Slots::texture(1025, Pair, 8192), texture(6));
        assert_eq!(Slots::texture(1 << 26, Pair, 8192), texture(13));
        assert_eq!(Slots::texture((1 << 26) + 1, Pair, 8192), None, "wider than the limit");
        assert_eq!(Slots::texture((1 << 27) - (1 << 14), Pair, 16384), texture(14));
        assert_eq!(Slots::texture(1 << 27, Pair, 16384), None, "more than the most bytes");
        assert_eq!(Slots::texture((1 << 26) - 1, Quad, 16384), None, "more than the most bytes");
        assert_eq!(Slots::texture((1 << 26) - (1 << 13), Quad, 16384), texture(13));
        assert_eq!(Slots::texture(1, Pair, 16), None);
        for slots in [1usize, 2, 1000, 1024, 65_537, 1 << 20, 12_345_678] {
            let Some(Slots::Texture { row_shift }) = Slots::texture(slots, Pair, 16384) else { panic!("{slots}") };
            assert!(slots.div_ceil(1 << row_shift) <= 16384);
        }
    }
}
