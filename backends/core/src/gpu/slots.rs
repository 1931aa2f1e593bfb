//! Where a kernel finds the slots of an octree: in storage buffers, or in a texture.

use std::fmt::Write as _;

use super::kernel::GROUP_OCTREE;

/// Where a kernel finds the slots of an octree: the bindings of group [`GROUP_OCTREE`].
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Slots {
    /// Storage buffers of `vec2<u32>`.
    Buffers {
        /// Number of bindings, at least 1.
        parts: u32,
        /// With several bindings, each except the last holds `2^part_shift` slots.
        part_shift: u32,
    },
    /// A storage texture that is read, of the format `rg32uint`. Slot `s` is the texel in column `s % 2^row_shift` of row
    /// `s >> row_shift`.
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
    /// A texture, for octrees that fit one.
    Texture,
}

/// Most bytes of a texture: the limit of the software driver llvmpipe.
pub const MAX_TEXTURE_BYTES: u64 = (1 << 30) - 1;

impl Slots {
    /// One buffer.
    pub const ONE_BUFFER: Self = Self::Buffers { parts: 1, part_shift: 31 };

    /// How `slots` slots are split over buffers of at most `max_bytes` each; `None` if it takes more than `max_parts`.
    pub fn split(slots: usize, max_bytes: u64, max_parts: u32) -> Option<Self> {
        let max_slots = (max_bytes / 8).max(1);
        if slots as u64 <= max_slots {
            return (max_parts > 0).then_some(Self::ONE_BUFFER);
        }
        let part_shift = max_slots.ilog2().min(31);
        let parts = u32::try_from((slots as u64).div_ceil(1 << part_shift)).ok()?;
        (parts <= max_parts).then_some(Self::Buffers { parts, part_shift })
    }

    /// A texture for `slots` slots, about as wide as high; `None` if it would be larger than `max_edge` texels or
    /// [`MAX_TEXTURE_BYTES`].
    pub fn texture(slots: usize, max_edge: u32) -> Option<Self> {
        // At least 32 columns, so that a row is a multiple of 256 bytes.
        let row_shift = (slots.max(1).next_power_of_two().ilog2().div_ceil(2)).max(5);
        let rows = slots.div_ceil(1 << row_shift).max(1) as u64;
        let fits = rows.max(1 << row_shift) <= u64::from(max_edge) && (rows << row_shift) * 8 <= MAX_TEXTURE_BYTES;
        fits.then_some(Self::Texture { row_shift })
    }

    /// Number of bindings.
    pub fn bindings(self) -> u32 {
        match self {
            Self::Buffers { parts, .. } => parts,
            Self::Texture { .. } => 1,
        }
    }

    /// WGSL: the bindings and the function `slot_at`.
    pub(super) fn declare(self, text: &mut String) {
        match self {
            Self::Buffers { parts, part_shift } => declare_buffers(parts, part_shift, text),
            Self::Texture { row_shift } => {
                let columns = (1u32 << row_shift) - 1;
                let _ = write!(
                    text,
                    "@group({GROUP_OCTREE}) @binding(0) var texels: texture_storage_2d<rg32uint, read>;\n\
                     fn slot_at(slot: u32) -> vec2<u32> {{\n    \
                         return textureLoad(texels, vec2<u32>(slot & {columns}u, slot >> {row_shift}u)).xy;\n}}\n"
                );
            }
        }
    }
}

fn declare_buffers(parts: u32, part_shift: u32, text: &mut String) {
    for part in 0..parts {
        let _ =
            writeln!(text, "@group({GROUP_OCTREE}) @binding({part}) var<storage, read> part_{part}: array<vec2<u32>>;");
    }
    text.push_str("fn slot_at(slot: u32) -> vec2<u32> {\n");
    if parts == 1 {
        text.push_str("    return part_0[slot];\n}\n");
        return;
    }
    let _ = writeln!(text, "    let within = slot & {}u;", (1u32 << part_shift) - 1);
    let _ = writeln!(text, "    switch slot >> {part_shift}u {{");
    for part in 0..parts - 1 {
        let _ = writeln!(text, "        case {part}u: {{ return part_{part}[within]; }}");
    }
    let _ = writeln!(text, "        default: {{ return part_{}[within]; }}\n    }}\n}}", parts - 1);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octrees_are_split_only_when_they_must_be() {
        let buffers = |parts, part_shift| Some(Slots::Buffers { parts, part_shift });
        assert_eq!(Slots::split(1000, 8000, 4), buffers(1, 31));
        assert_eq!(Slots::split(1001, 8000, 4), buffers(2, 9));
        assert_eq!(Slots::split(2048, 8000, 4), buffers(4, 9));
        assert_eq!(Slots::split(2049, 8000, 4), None);
        assert_eq!(Slots::split(1 << 24, 1 << 27, 1), buffers(1, 31));
        assert_eq!(Slots::split((1 << 24) + 1, 1 << 27, 2), buffers(2, 24));
        assert_eq!(Slots::split(1, 8, 0), None);
    }

    #[test]
    fn textures_hold_every_slot_and_stay_within_the_limits() {
        let texture = |row_shift| Some(Slots::Texture { row_shift });
        assert_eq!(Slots::texture(0, 8192), texture(5));
        assert_eq!(Slots::texture(1024, 8192), texture(5));
        assert_eq!(Slots::texture(1025, 8192), texture(6));
        assert_eq!(Slots::texture(1 << 26, 8192), texture(13));
        assert_eq!(Slots::texture((1 << 26) + 1, 8192), None, "wider than the limit");
        assert_eq!(Slots::texture((1 << 27) - (1 << 14), 16384), texture(14));
        assert_eq!(Slots::texture(1 << 27, 16384), None, "more than the most bytes");
        assert_eq!(Slots::texture(1, 16), None);
        for slots in [1usize, 2, 1000, 1024, 65_537, 1 << 20, 12_345_678] {
            let Some(Slots::Texture { row_shift }) = Slots::texture(slots, 16384) else { panic!("{slots}") };
            assert!(slots.div_ceil(1 << row_shift) <= 16384);
        }
    }
}
