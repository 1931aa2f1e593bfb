//! How textures are read at coordinates outside 0..=1.

/// How a texture is read along one axis at coordinates outside 0..=1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The image repeats.
    #[default]
    Repeat,
    /// The image repeats, and every second copy is mirrored.
    Mirror,
    /// The texels at the edge continue without end.
    Clamp,
}

impl Wrap {
    /// The coordinate in 0..=1 whose texels are read at `x`; 0 for coordinates that are infinite or NaN.
    #[inline]
    pub(crate) fn fold(self, x: f32) -> f32 {
        if !x.is_finite() {
            return 0.0;
        }
        match self {
            Self::Repeat => x - x.floor(),
            Self::Mirror => {
                let twice = x - 2.0 * (x * 0.5).floor();
                if twice > 1.0 { 2.0 - twice } else { twice }
            }
            Self::Clamp => x.clamp(0.0, 1.0),
        }
    }

    /// Bounds of the folded coordinates of a range, for modes other than `Repeat`, whose ranges stay as they are: the
    /// folded range of a repeated image could consist of two parts.
    pub(crate) fn fold_range(self, low: f32, high: f32) -> (f32, f32) {
        match self {
            Self::Repeat => (low, high),
            Self::Clamp => (self.fold(low), self.fold(high)),
            Self::Mirror => {
                let (a, b) = (self.fold(low), self.fold(high));
                let (least, most) = (a.min(b), a.max(b));
                // The direction turns at each integer: at 0 where it is even, at 1 where it is odd.
                let (first, last) = (low.ceil(), high.floor());
                if last < first {
                    (least, most)
                } else if last > first || !(high - low).is_finite() {
                    (0.0, 1.0)
                } else if first.rem_euclid(2.0) == 0.0 {
                    (0.0, most)
                } else {
                    (least, 1.0)
                }
            }
        }
    }

    /// The texel at place `at` of an axis of `size` texels. For modes other than `Repeat`, `at` follows from folded
    /// coordinates: it lies outside the image by at most the width of the filter.
    #[inline]
    pub(crate) fn texel(self, at: i64, size: u32) -> u32 {
        match self {
            Self::Repeat => at.rem_euclid(i64::from(size)) as u32,
            // A mirrored image continues with the texel at its edge, too.
            Self::Mirror | Self::Clamp => at.clamp(0, i64::from(size) - 1) as u32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_fold_into_the_image() {
        let cases = [
            (Wrap::Repeat, [(0.25, 0.25), (1.25, 0.25), (-0.25, 0.75), (-3.5, 0.5)]),
            (Wrap::Mirror, [(0.25, 0.25), (1.25, 0.75), (-0.25, 0.25), (-3.5, 0.5)]),
            (Wrap::Clamp, [(0.25, 0.25), (1.25, 1.0), (-0.25, 0.0), (-3.5, 0.0)]),
        ];
        for (wrap, pairs) in cases {
            for (x, expected) in pairs {
                assert_eq!(wrap.fold(x), expected, "{wrap:?} {x}");
            }
            for odd in [f32::NAN, f32::INFINITY, f32::MAX, -f32::MAX, -1e-30] {
                assert!((0.0..=1.0).contains(&wrap.fold(odd)), "{wrap:?} {odd}");
            }
        }
    }

    #[test]
    fn folded_ranges_contain_their_points() {
        for wrap in [Wrap::Mirror, Wrap::Clamp] {
            for i in -40..40 {
                for width in 0..30 {
                    let (low, high) = (i as f32 * 0.125, i as f32 * 0.125 + width as f32 * 0.0625);
                    let (least, most) = wrap.fold_range(low, high);
                    for k in 0..=8 {
                        let x = wrap.fold(low + (high - low) * k as f32 / 8.0);
                        assert!((least..=most).contains(&x), "{wrap:?} {low}..{high}: {x} not in {least}..{most}");
                    }
                }
            }
        }
        assert_eq!(Wrap::Mirror.fold_range(0.75, 1.5), (0.5, 1.0));
        assert_eq!(Wrap::Mirror.fold_range(-0.25, 0.5), (0.0, 0.5));
    }
}
