//! Component attachments: one to four numbers of one format for a voxel, such as its emission or its opacity (spec section
//! 8.7).

use crate::file::attachment;

/// How one number is stored. Numbers of formats with a name in `unorm` stand for 0 to 1.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum NumberFormat {
    /// A byte.
    U8 = 1,
    /// A byte divided by 255.
    Unorm8 = 2,
    /// Two bytes.
    U16 = 3,
    /// Two bytes divided by 65535.
    Unorm16 = 4,
    /// IEEE 754 binary16, finite.
    F16 = 5,
    /// Four bytes.
    U32 = 6,
    /// IEEE 754 binary32, finite.
    F32 = 7,
    /// Three numbers in one word: mantissas of 9 bits each, the first lowest, and a common exponent of 5 bits.
    Rgb9e5 = 8,
}

/// Number of components of a value, and how each is stored.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, serde::Serialize, serde::Deserialize)]
pub struct ComponentFormat {
    /// 1 to 4; 3 for [`NumberFormat::Rgb9e5`].
    pub components: u8,
    /// The format of each.
    pub number: NumberFormat,
}

/// How the values of a block are stored.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Form {
    /// An entry for each slot of the descriptor array, then values.
    Entries,
    /// One value, which all voxels of the block have.
    Constant,
}

/// Words of the head of an attachment, before entries and values.
pub(crate) const HEAD_WORDS: usize = 2;
/// Largest value of [`NumberFormat::Rgb9e5`]: a mantissa of 511 with the exponent 31.
pub const MAX_RGB9E5: f64 = 65408.0;
/// Largest finite value of [`NumberFormat::F16`].
const MAX_F16: f64 = 65504.0;

/// The numbers of a voxel. Those from the number of components on are 0.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Components {
    /// How they are stored.
    pub format: ComponentFormat,
    /// The numbers.
    pub numbers: [f64; 4],
}

impl Components {
    /// The numbers that there are.
    pub fn used(&self) -> &[f64] {
        &self.numbers[..usize::from(self.format.components)]
    }
}

impl NumberFormat {
    const ALL: [Self; 8] =
        [Self::U8, Self::Unorm8, Self::U16, Self::Unorm16, Self::F16, Self::U32, Self::F32, Self::Rgb9e5];

    /// Bits of one number.
    fn bits(self) -> u32 {
        match self {
            Self::U8 | Self::Unorm8 => 8,
            Self::U16 | Self::Unorm16 | Self::F16 => 16,
            Self::U32 | Self::F32 | Self::Rgb9e5 => 32,
        }
    }

    /// The name in the specification.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::Unorm8 => "unorm8",
            Self::U16 => "u16",
            Self::Unorm16 => "unorm16",
            Self::F16 => "f16",
            Self::U32 => "u32",
            Self::F32 => "f32",
            Self::Rgb9e5 => "rgb9e5",
        }
    }

    fn encode(self, number: f64) -> u32 {
        // A conversion to an unsigned type clamps, and takes NaN for 0.
        match self {
            Self::U8 => number.round() as u8 as u32,
            Self::Unorm8 => (number * 255.0).round() as u8 as u32,
            Self::U16 => number.round() as u16 as u32,
            Self::Unorm16 => (number * 65535.0).round() as u16 as u32,
            Self::F16 => u32::from(to_f16(number)),
            Self::U32 => number.round() as u32,
            Self::F32 => {
                let number = if number.is_nan() { 0.0 } else { number };
                (number.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32).to_bits()
            }
            Self::Rgb9e5 => 0,
        }
    }

    fn decode(self, bits: u32) -> f64 {
        match self {
            Self::U8 | Self::U16 | Self::U32 | Self::Rgb9e5 => f64::from(bits),
            Self::Unorm8 => f64::from(bits) / 255.0,
            Self::Unorm16 => f64::from(bits) / 65535.0,
            Self::F16 => from_f16(bits as u16),
            Self::F32 => f64::from(f32::from_bits(bits)),
        }
    }
}

impl ComponentFormat {
    /// Emission as the builder stores it.
    pub const EMISSION: Self = Self { components: 3, number: NumberFormat::Rgb9e5 };
    /// Roughness and metalness as the builder stores them.
    pub const ROUGHNESS_METALNESS: Self = Self { components: 2, number: NumberFormat::Unorm8 };
    /// Opacity as the builder stores it.
    pub const OPACITY: Self = Self { components: 1, number: NumberFormat::Unorm8 };
    /// Material ids of up to 65536 materials.
    pub const MATERIAL: Self = Self { components: 1, number: NumberFormat::U16 };

    /// Whether there is such a format.
    pub fn is_valid(self) -> bool {
        match self.number {
            NumberFormat::Rgb9e5 => self.components == 3,
            _ => (1..=4).contains(&self.components),
        }
    }

    /// Words of a value, 1 to 4.
    pub fn words(self) -> usize {
        match self.number {
            NumberFormat::Rgb9e5 => 1,
            number => (u32::from(self.components) * number.bits()).div_ceil(32) as usize,
        }
    }

    /// The words of a value: each number rounded to the nearest that the format has. The words from [`words`](Self::words) on
    /// are 0.
    pub fn encode(self, numbers: &[f64]) -> [u32; 4] {
        let mut words = [0; 4];
        if self.number == NumberFormat::Rgb9e5 {
            words[0] = to_rgb9e5(std::array::from_fn(|k| numbers.get(k).copied().unwrap_or(0.0)));
            return words;
        }
        let bits = self.number.bits();
        for (k, number) in numbers.iter().take(usize::from(self.components).min(4)).enumerate() {
            let at = k as u32 * bits;
            words[(at / 32) as usize] |= self.number.encode(*number) << (at % 32);
        }
        words
    }

    /// The value of these words. Words that are missing count as 0.
    pub fn decode(self, words: &[u32]) -> Components {
        let word = |k: u32| words.get(k as usize).copied().unwrap_or(0);
        let mut numbers = [0.0; 4];
        if self.number == NumberFormat::Rgb9e5 {
            numbers[..3].copy_from_slice(&from_rgb9e5(word(0)));
            return Components { format: self, numbers };
        }
        let bits = self.number.bits();
        for (k, number) in numbers.iter_mut().take(usize::from(self.components)).enumerate() {
            let at = k as u32 * bits;
            let mask = u32::MAX >> (32 - bits);
            *number = self.number.decode(word(at / 32) >> (at % 32) & mask);
        }
        Components { format: self, numbers }
    }

    /// Whether the words of a value are those of finite numbers, and their unused bits zero (A010).
    pub(crate) fn is_value(self, words: &[u32]) -> bool {
        let value = self.decode(words);
        // Infinite and NaN have the largest exponent. Unused bits come back as zero.
        value.used().iter().all(|x| x.is_finite()) && (self.number == NumberFormat::Rgb9e5 || self.packs(words))
    }

    /// Whether only the bits of the components are set.
    fn packs(self, words: &[u32]) -> bool {
        let used = u32::from(self.components) * self.number.bits();
        let last = used % 32;
        last == 0 || words.get((used / 32) as usize).is_none_or(|word| word >> last == 0)
    }

    /// The words of the default of a type: roughness and opacity 1, all else 0 (spec section 8.7).
    pub fn default_of(self, kind: u32) -> [u32; 4] {
        let first = f64::from(u8::from(matches!(kind, attachment::ROUGHNESS_METALNESS | attachment::OPACITY)));
        self.encode(&[first, 0.0, 0.0, 0.0])
    }

    /// Whether the values of a type can have this format (A009).
    pub(crate) fn fits(self, kind: u32) -> bool {
        use NumberFormat::*;
        let of =
            |components: u8, numbers: &[NumberFormat]| self.components == components && numbers.contains(&self.number);
        self.is_valid()
            && match kind {
                attachment::EMISSION => of(3, &[Rgb9e5, F16, F32]),
                attachment::ROUGHNESS_METALNESS => of(2, &[Unorm8, Unorm16]),
                attachment::OPACITY => of(1, &[Unorm8, Unorm16]),
                attachment::MATERIAL => of(1, &[U8, U16, U32]),
                _ => true,
            }
    }

    /// The head of an attachment.
    pub(crate) fn head(self, form: Form) -> [u32; HEAD_WORDS] {
        let form = if form == Form::Constant { 1 } else { 0 };
        [u32::from_le_bytes([self.components, self.number as u8, form, 0]), 0]
    }

    /// Reads the head of an attachment. `None` if it is none.
    pub(crate) fn from_head(words: &[u32]) -> Option<(Self, Form)> {
        let &[low, 0, ..] = words else { return None };
        let [components, number, form, 0] = low.to_le_bytes() else { return None };
        let number = *NumberFormat::ALL.get(usize::from(number).checked_sub(1)?)?;
        let form = [Form::Entries, Form::Constant].get(usize::from(form)).copied()?;
        let format = Self { components, number };
        format.is_valid().then_some((format, form))
    }
}

/// Rounds to the nearest binary16, ties to even. What is too large becomes the largest finite number, NaN becomes 0.
fn to_f16(number: f64) -> u16 {
    if number.is_nan() {
        return 0;
    }
    let size = number.abs().min(MAX_F16);
    let sign = if number.is_sign_negative() { 0x8000 } else { 0 };
    // The exponent of the number, as its bits say; that of subnormal numbers is -14.
    let exponent = ((size.to_bits() >> 52) as i32 - 1023).max(-14);
    let steps = (size * f64::from(10 - exponent).exp2()).round_ties_even() as u16;
    // A mantissa that was rounded up to 2048 carries into the exponent.
    let normal = if steps >= 1024 { (((exponent + 15) as u16) << 10) + (steps - 1024) } else { steps };
    sign | normal
}

fn from_f16(bits: u16) -> f64 {
    let (exponent, mantissa) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let size = match exponent {
        0 => mantissa * (-24f64).exp2(),
        31 if mantissa == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + mantissa) * f64::from(exponent - 25).exp2(),
    };
    if bits >> 15 != 0 { -size } else { size }
}

/// Three numbers with a common exponent: that of the largest, so that no error is above half a unit of its mantissa.
fn to_rgb9e5(rgb: [f64; 3]) -> u32 {
    // Also turns NaN into 0.
    let rgb = rgb.map(|x| if x > 0.0 { x.min(MAX_RGB9E5) } else { 0.0 });
    let largest = rgb.into_iter().fold(0.0, f64::max);
    let floor = (largest.to_bits() >> 52) as i32 - 1023;
    let mut exponent = floor.max(-16) + 16;
    if (largest * f64::from(24 - exponent).exp2()).round() > 511.0 {
        exponent += 1;
    }
    let mantissa = |x: f64| (x * f64::from(24 - exponent).exp2()).round() as u32;
    let [r, g, b] = rgb.map(mantissa);
    r | g << 9 | b << 18 | (exponent as u32) << 27
}

fn from_rgb9e5(word: u32) -> [f64; 3] {
    let unit = f64::from((word >> 27) as i32 - 24).exp2();
    [0, 9, 18].map(|at| f64::from(word >> at & 511) * unit)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn formats() -> impl Strategy<Value = ComponentFormat> {
        (1u8..=4, 0usize..8).prop_map(|(components, number)| {
            let number = NumberFormat::ALL[number];
            let components = if number == NumberFormat::Rgb9e5 { 3 } else { components };
            ComponentFormat { components, number }
        })
    }

    /// Largest error of a number that the format can hold.
    fn error(number: NumberFormat, x: f64, largest: f64) -> f64 {
        match number {
            NumberFormat::U8 | NumberFormat::U16 | NumberFormat::U32 => 0.5,
            NumberFormat::Unorm8 => 0.5001 / 255.0,
            NumberFormat::Unorm16 => 0.5001 / 65535.0,
            NumberFormat::F16 => (x / 2048.0).max((-25f64).exp2()),
            NumberFormat::F32 => x * (-24f64).exp2() + 1e-45,
            // The mantissa of the largest is at least 256 unless the exponent is the least.
            NumberFormat::Rgb9e5 => (largest / 510.0).max((-25f64).exp2()),
        }
    }

    proptest! {
        #[test]
        fn numbers_come_back(format in formats(), numbers in prop::array::uniform4(0.0f64..1.0), scale in -30i32..18) {
            let scale = match format.number {
                NumberFormat::Unorm8 | NumberFormat::Unorm16 => 1.0,
                NumberFormat::U8 => 255.0,
                NumberFormat::U16 => 65535.0,
                NumberFormat::F16 | NumberFormat::Rgb9e5 => f64::from(scale.min(15)).exp2(),
                _ => f64::from(scale).exp2(),
            };
            let numbers = numbers.map(|x| x * scale);
            let words = format.encode(&numbers);
            prop_assert!(format.is_value(&words));
            prop_assert!(words[format.words()..].iter().all(|word| *word == 0));
            let found = format.decode(&words);
            let given = &numbers[..usize::from(format.components)];
            let largest = given.iter().copied().fold(0.0, f64::max);
            for (a, b) in found.used().iter().zip(given) {
                prop_assert!((a - b).abs() <= error(format.number, *b, largest), "{format:?}: {b} became {a}");
            }
            // What was decoded is encoded without a change.
            prop_assert_eq!(format.decode(&format.encode(&found.numbers)), found);
        }

        #[test]
        fn any_bits_are_decoded(format in formats(), words in prop::array::uniform4(any::<u32>()), head in any::<[u32; 2]>()) {
            let value = format.decode(&words);
            if format.is_value(&words) && format.number != NumberFormat::Rgb9e5 {
                let again = format.encode(&value.numbers);
                // A negative zero is kept, too.
                prop_assert_eq!(&again[..format.words()], &words[..format.words()]);
            }
            if let Some((format, form)) = ComponentFormat::from_head(&head) {
                prop_assert_eq!(format.head(form), head);
            }
        }
    }

    #[test]
    fn every_head_is_read() {
        for number in NumberFormat::ALL {
            for components in 0..=5 {
                let format = ComponentFormat { components, number };
                for form in [Form::Entries, Form::Constant] {
                    let expected = format.is_valid().then_some((format, form));
                    assert_eq!(ComponentFormat::from_head(&format.head(form)), expected);
                }
            }
        }
        assert_eq!(ComponentFormat::from_head(&[0x0002_0203, 0]), None, "form 2");
        assert_eq!(ComponentFormat::from_head(&[0x0100_0203, 0]), None, "a byte that is not zero");
        assert_eq!(ComponentFormat::from_head(&[0x0000_0203, 1]), None, "a word that is not zero");
        assert_eq!(ComponentFormat::from_head(&[0x0000_0903, 0]), None, "format 9");
        assert_eq!(ComponentFormat::from_head(&[0x0000_0203]), None, "half a head");
    }

    #[test]
    fn values_at_the_ends_of_ranges() {
        let emission = ComponentFormat::EMISSION;
        let through = |rgb: [f64; 3]| emission.decode(&emission.encode(&rgb)).numbers;
        assert_eq!(through([1.0, 0.5, 0.0]), [1.0, 0.5, 0.0, 0.0]);
        assert_eq!(through([f64::INFINITY, 1e9, -1.0]), [MAX_RGB9E5, MAX_RGB9E5, 0.0, 0.0]);
        assert_eq!(through([f64::NAN, 1.0, 2.0]), [0.0, 1.0, 2.0, 0.0]);
        // 511.5 units round to 512, which takes the next exponent.
        assert_eq!(through([1.998_046_875 + 1e-9, 0.0, 0.0]), [2.0, 0.0, 0.0, 0.0]);
        assert_eq!(through([(-24f64).exp2(), 0.0, (-26f64).exp2()]), [(-24f64).exp2(), 0.0, 0.0, 0.0]);
        assert_eq!([1.0, -2.0, 65504.0, 65520.0, f64::INFINITY].map(to_f16), [0x3c00, 0xc000, 0x7bff, 0x7bff, 0x7bff]);
        // Ties to even, a carry into the exponent, subnormal numbers.
        assert_eq!([1.0 + 2f64.powi(-11), 1.0 + 3.0 * 2f64.powi(-11)].map(to_f16), [0x3c00, 0x3c02]);
        assert_eq!(
            [2.0 - 2f64.powi(-12), 2f64.powi(-24), 2f64.powi(-25), 2f64.powi(-14)].map(to_f16),
            [0x4000, 1, 0, 0x400]
        );
        assert_eq!(
            [0x7bff, 1, 0x8001, 0xfc00].map(from_f16),
            [65504.0, 2f64.powi(-24), -2f64.powi(-24), f64::NEG_INFINITY]
        );
        assert!(from_f16(0x7c01).is_nan());
        let two = ComponentFormat { components: 3, number: NumberFormat::U16 };
        assert!(two.is_value(&[u32::MAX, 0xffff]) && !two.is_value(&[0, 0x1_0000]));
        let real = ComponentFormat { components: 1, number: NumberFormat::F32 };
        assert!(real.is_value(&[1]) && !real.is_value(&[f32::INFINITY.to_bits()]) && !real.is_value(&[u32::MAX]));
    }
}
