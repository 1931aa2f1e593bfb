//! `--compare`: two pictures of one view beside each other, and how different they look.

use clap::ValueEnum;
use esvo_bench::error::image::{PIXELS_PER_DEGREE, flip_map};
use esvo_core::{BEAM_BLOCK, Picture, WIDE_BEAM_BLOCK, shading};
use esvo_engines::EngineId;

use super::draw::Drawn;
use super::look::{Filter, Look, ViewMode};

/// What the sides of a comparison are called, but for view modes and engines.
const VARIANTS: [&str; 8] =
    ["contours", "no-contours", "filter", "own-filter", "no-filter", "beam", "wide-beam", "no-beam"];

/// Pixels between two pictures.
const GAP: u32 = 8;
/// Width of the scale beside the difference, in pixels.
const SCALE: u32 = 12;
/// Bytes for each pixel that a comparison needs: the planes of [`flip_map`], and all three pictures beside each other.
pub(crate) const BYTES_PER_PIXEL: usize = 128;

/// Two sides, as they are called and as they differ from the other options.
#[derive(Clone, Debug)]
pub(crate) struct Comparison {
    pub(crate) sides: [Side; 2],
}

/// One side.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Side {
    pub(crate) name: String,
    engine: Option<EngineId>,
    mode: Option<ViewMode>,
    filter: Option<Filter>,
    contours: Option<bool>,
    beam: Option<Option<u32>>,
}

/// Reads the value of `--compare`: two sides, each of one or more names.
pub(crate) fn parse_comparison(text: &str) -> Result<Comparison, String> {
    match text.split(',').map(str::trim).collect::<Vec<_>>()[..] {
        [a, b] => Ok(Comparison { sides: [Side::parse(a)?, Side::parse(b)?] }),
        _ => Err("expected two sides with a comma between them, e.g. contours,no-contours".into()),
    }
}

impl Side {
    fn parse(text: &str) -> Result<Self, String> {
        let mut side =
            Self { name: text.to_owned(), engine: None, mode: None, filter: None, contours: None, beam: None };
        for name in text.split('+').map(str::trim) {
            let is_new = match name {
                "contours" => side.contours.replace(true).is_none(),
                "no-contours" => side.contours.replace(false).is_none(),
                "filter" => side.filter.replace(Filter::Adapted).is_none(),
                "own-filter" => side.filter.replace(Filter::Own).is_none(),
                "no-filter" => side.filter.replace(Filter::Off).is_none(),
                "beam" => side.beam.replace(Some(BEAM_BLOCK)).is_none(),
                "wide-beam" => side.beam.replace(Some(WIDE_BEAM_BLOCK)).is_none(),
                "no-beam" => side.beam.replace(None).is_none(),
                _ => {
                    if let Ok(mode) = ViewMode::from_str(name, false) {
                        side.mode.replace(mode).is_none()
                    } else if let Some(engine) = EngineId::ALL.iter().find(|id| id.engine().name == name) {
                        side.engine.replace(*engine).is_none()
                    } else {
                        return Err(format!("there is no `{name}`; the names are {}", names().join(", ")));
                    }
                }
            };
            if !is_new {
                return Err(format!("{text}: `{name}` and a name before it exclude each other"));
            }
        }
        Ok(side)
    }

    /// How the picture of this side is made, where the other options say `look`.
    ///
    /// # Errors
    /// A filter for a picture that is not filtered.
    pub(crate) fn look(&self, look: &Look) -> Result<Look, String> {
        let look = Look {
            engine: self.engine.unwrap_or(look.engine),
            mode: self.mode.unwrap_or(look.mode),
            filter: self.filter.unwrap_or(look.filter),
            contours: self.contours.unwrap_or(look.contours),
            beam: self.beam.unwrap_or(look.beam),
        };
        if self.filter.is_some() && look.mode != ViewMode::Shaded {
            return Err(format!("--compare {}: only shaded pictures are filtered", self.name));
        }
        Ok(look)
    }
}

/// All names.
fn names() -> Vec<String> {
    let modes = ViewMode::value_variants().iter().filter_map(ValueEnum::to_possible_value);
    let modes = modes.map(|value| value.get_name().to_owned());
    let engines = EngineId::ALL.iter().map(|id| id.engine().name.to_owned());
    modes.chain(VARIANTS.map(Into::into)).chain(engines).collect()
}

/// How two pictures differ.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub(crate) struct Difference {
    /// Mean FLIP.
    pub(crate) flip: f64,
    pub(crate) pixels: usize,
    /// Pixels whose colours are not equal.
    pub(crate) differ: usize,
    /// The largest difference of a channel, of 255.
    pub(crate) most: u8,
    /// Pixels that show another voxel, or one of another object.
    pub(crate) other_voxel: usize,
}

impl Difference {
    /// The difference over several pictures of one size.
    pub(crate) fn of_all(all: &[Self]) -> Self {
        let sum = |value: fn(&Self) -> usize| all.iter().map(value).sum();
        Self {
            flip: all.iter().map(|one| one.flip).sum::<f64>() / all.len().max(1) as f64,
            pixels: sum(|one| one.pixels),
            differ: sum(|one| one.differ),
            most: all.iter().map(|one| one.most).max().unwrap_or(0),
            other_voxel: sum(|one| one.other_voxel),
        }
    }

    /// One line.
    pub(crate) fn text(&self) -> String {
        format!(
            "FLIP {:.5} (0: equal, 1: like black beside white); {} of {} pixels differ, by {} of 255 at most; {} show another voxel",
            self.flip, self.differ, self.pixels, self.most, self.other_voxel
        )
    }
}

/// Both pictures, their FLIP as [heat](shading::heat) and its scale beside each other, and the difference in numbers.
pub(crate) fn compare(a: &Drawn, b: &Drawn) -> Result<(Picture, Difference), String> {
    let (width, height) = (a.picture.width, a.picture.height);
    let flip = flip_map(&a.picture, &b.picture, PIXELS_PER_DEGREE).ok_or("the pictures differ in size")?;
    let off = |(a, b): (&[u8], &[u8])| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
    let offs = || a.picture.rgb8.chunks(3).zip(b.picture.rgb8.chunks(3)).map(off);
    let voxels = a.nearest.hits.iter().zip(&a.nearest.views).zip(b.nearest.hits.iter().zip(&b.nearest.views));
    let difference = Difference {
        flip: flip.iter().map(|value| f64::from(*value)).sum::<f64>() / flip.len() as f64,
        pixels: flip.len(),
        differ: offs().filter(|off| *off > 0).count(),
        most: offs().max().unwrap_or(0),
        other_voxel: voxels.filter(|((a, of_a), (b, of_b))| !a.same_voxel(b) || of_a != of_b).count(),
    };
    let seen = |picture: &Picture, x: u32, y: u32| picture.pixel(x, y).map(|byte| f32::from(byte) / 255.0);
    let (second, third, scale) = (width + GAP, 2 * (width + GAP), 3 * width + 2 * GAP + GAP / 2);
    let whole = Picture::from_fn((scale + SCALE, height), |x, y| match x {
        _ if x < width => seen(&a.picture, x, y),
        _ if (second..second + width).contains(&x) => seen(&b.picture, x - second, y),
        _ if (third..third + width).contains(&x) => {
            shading::heat(flip[y as usize * width as usize + (x - third) as usize])
        }
        _ if x >= scale => shading::heat(1.0 - (y as f32 + 0.5) / height as f32),
        _ => [0.5; 3],
    });
    Ok((whole, difference))
}

#[cfg(test)]
mod tests {
    use super::*;
    use esvo_core::{Hit, Nearest};
    use std::time::Duration;

    fn drawn(color: impl Fn(u32, u32) -> [f32; 3], hits: Vec<Hit>) -> Drawn {
        let picture = Picture::from_fn((40, 30), color);
        let nearest = Nearest { views: vec![0; hits.len()], hits };
        Drawn { picture, nearest, casting: Duration::ZERO, shading: Duration::ZERO, filtering: Duration::ZERO }
    }

    #[test]
    fn names_are_read() {
        for name in names() {
            let Comparison { sides: [a, b] } = parse_comparison(&format!("{name},{name}")).unwrap();
            assert_eq!(a, b);
            let set =
                [a.engine.is_some(), a.mode.is_some(), a.filter.is_some(), a.contours.is_some(), a.beam.is_some()];
            assert_eq!(set.iter().filter(|set| **set).count(), 1, "{name}");
        }
        let both = parse_comparison(" wgpu + no-contours+beam, cpu").unwrap().sides;
        assert_eq!(
            (both[0].engine, both[0].contours, both[0].beam),
            (Some(EngineId::Wgpu), Some(false), Some(Some(4)))
        );
        for (bad, what) in [
            ("filter", "expected two sides"),
            ("", "expected two sides"),
            ("a,b,c", "expected two sides"),
            ("filter,", "there is no ``"),
            ("filter,nofilter", "there is no `nofilter`; the names are shaded, iterations, "),
            ("filter+no-filter,beam", "`no-filter` and a name before it exclude each other"),
            ("depth+normals,beam", "`normals` and a name before it exclude each other"),
        ] {
            let error = parse_comparison(bad).unwrap_err();
            assert!(error.contains(what), "{bad}: {error}");
        }
    }

    #[test]
    fn differences_are_counted_and_shown() {
        let hits = || vec![Hit::new(0.5, 1, 0, 20, 3); 40 * 30];
        let grey = |_, _| [0.4; 3];
        let one_pixel = |x: u32, y: u32| if (x, y) == (7, 11) { [0.8, 0.4, 0.4] } else { [0.4; 3] };
        let (whole, none) = compare(&drawn(grey, hits()), &drawn(grey, hits())).unwrap();
        assert!(none.flip.abs() < 1e-6);
        assert_eq!(Difference { flip: 0.0, ..none }, Difference { pixels: 1200, ..Difference::default() });
        assert_eq!((whole.width, whole.height), (3 * 40 + 2 * 8 + 4 + 12, 30));
        assert_eq!((whole.pixel(2 * 48 + 7, 11), whole.pixel(40, 3)), ([0; 3], [128; 3]));

        let mut other = hits();
        (other[5].slot, other[6].raw_t) = (2, 0.75);
        // The same voxel of another object, too.
        let mut changed = drawn(one_pixel, other);
        changed.nearest.views[9] = 1;
        let (whole, one) = compare(&drawn(grey, hits()), &changed).unwrap();
        assert_eq!((one.differ, one.most, one.other_voxel), (1, 102, 2));
        assert!(one.flip > 1e-4);
        assert_eq!((whole.pixel(7, 11), whole.pixel(48 + 7, 11)), ([102; 3], [204, 102, 102]));
        assert!(whole.pixel(2 * 48 + 7, 11)[0] > whole.pixel(2 * 48 + 30, 25)[0]);
        // The scale: nearly white on top, nearly black below.
        assert!(whole.pixel(whole.width - 1, 0)[2] > 230 && whole.pixel(whole.width - 1, 29)[0] < 10);

        let both = Difference::of_all(&[none, one]);
        assert_eq!((both.pixels, both.differ, both.most, both.other_voxel), (2400, 1, 102, 2));
        assert!((both.flip - (none.flip + one.flip) / 2.0).abs() < 1e-12);
    }
}
