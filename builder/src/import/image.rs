//! Image files and embedded images as textures.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::{DynamicImage, ImageFormat, ImageReader, Limits, RgbaImage};

use super::error::{ImportError, one_line};
use super::file::read_file;
use crate::mesh::maps::LinearTexture;
use crate::mesh::{MAX_TEXTURE_SIDE, Texture, Wrap};

/// Most texels that all textures of a mesh may have in total (without their mip levels).
pub const MAX_TEXTURE_TEXELS: u64 = 1 << 29;

/// Which channel of an image holds heights (`-imfchan` of MTL).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(super) enum Channel {
    Red,
    Green,
    Blue,
    Alpha,
    #[default]
    Luminance,
}

/// The textures read so far, shared by all materials that use the same file, and the number of texels still allowed.
#[derive(Debug)]
pub(super) struct TextureStore {
    by_path: HashMap<(PathBuf, [Wrap; 2]), Arc<Texture>>,
    normals: HashMap<(PathBuf, [Wrap; 2]), Arc<LinearTexture<3>>>,
    heights: HashMap<(PathBuf, Channel), Arc<LinearTexture<1>>>,
    /// Whether an image that should hold heights holds normals.
    disguised: HashMap<PathBuf, bool>,
    texels_left: u64,
}

impl Default for TextureStore {
    fn default() -> Self {
        Self {
            by_path: HashMap::new(),
            normals: HashMap::new(),
            heights: HashMap::new(),
            disguised: HashMap::new(),
            texels_left: MAX_TEXTURE_TEXELS,
        }
    }
}

impl TextureStore {
    /// The texture in the file `image`, which repeats, or `None` if there is no such file.
    pub(super) fn load(&mut self, mesh: &Path, image: &Path) -> Result<Option<Arc<Texture>>, ImportError> {
        self.load_wrapped(mesh, image, [Wrap::Repeat; 2])
    }

    /// The texture in the file `image`, read by `wrap` outside of 0..=1, or `None` if there is no such file.
    pub(super) fn load_wrapped(
        &mut self,
        mesh: &Path,
        image: &Path,
        wrap: [Wrap; 2],
    ) -> Result<Option<Arc<Texture>>, ImportError> {
        // The canonical path: different spellings of a path share the texture.
        let Ok(path) = image.canonicalize() else { return Ok(None) };
        let key = (path, wrap);
        if let Some(texture) = self.by_path.get(&key) {
            return Ok(Some(texture.clone()));
        }
        let pixels = self.load_pixels(mesh, image)?;
        let texture = texture_of(mesh, &image.display().to_string(), &pixels)?;
        let texture = Arc::new(Arc::unwrap_or_clone(texture).with_wrap(wrap));
        self.by_path.insert(key, texture.clone());
        Ok(Some(texture))
    }

    /// The normals in the file `image`, read by `wrap` outside of 0..=1, or `None` if there is no such file.
    pub(super) fn load_normals(
        &mut self,
        mesh: &Path,
        image: &Path,
        wrap: [Wrap; 2],
    ) -> Result<Option<Arc<LinearTexture<3>>>, ImportError> {
        let Ok(path) = image.canonicalize() else { return Ok(None) };
        let key = (path, wrap);
        if let Some(texture) = self.normals.get(&key) {
            return Ok(Some(texture.clone()));
        }
        let decoded = self.load_image(mesh, image)?;
        let texture = normals_of(mesh, &image.display().to_string(), decoded)?;
        let texture = Arc::new(Arc::unwrap_or_clone(texture).with_wrap(wrap));
        self.normals.insert(key, texture.clone());
        Ok(Some(texture))
    }

    /// Whether the file `image`, which should hold heights, holds normals: exporters write both with the same statement.
    pub(super) fn holds_normals(&mut self, mesh: &Path, image: &Path) -> Result<bool, ImportError> {
        let Ok(key) = image.canonicalize() else { return Ok(false) };
        if let Some(&found) = self.disguised.get(&key) {
            return Ok(found);
        }
        // This image is not kept, so it does not count as a texture.
        let texels_left = self.texels_left;
        let found = looks_like_normals(&self.load_image(mesh, image)?);
        self.texels_left = texels_left;
        self.disguised.insert(key, found);
        Ok(found)
    }

    /// The heights in the file `image`, or `None` if there is no such file.
    pub(super) fn load_heights(
        &mut self,
        mesh: &Path,
        image: &Path,
        channel: Channel,
    ) -> Result<Option<Arc<LinearTexture<1>>>, ImportError> {
        let Ok(path) = image.canonicalize() else { return Ok(None) };
        let key = (path, channel);
        if let Some(texture) = self.heights.get(&key) {
            return Ok(Some(texture.clone()));
        }
        let decoded = self.load_image(mesh, image)?;
        let texture = heights_of(mesh, &image.display().to_string(), decoded, channel)?;
        self.heights.insert(key, texture.clone());
        Ok(Some(texture))
    }

    /// The pixels of the file `image`.
    pub(super) fn load_pixels(&mut self, mesh: &Path, image: &Path) -> Result<RgbaImage, ImportError> {
        Ok(self.load_image(mesh, image)?.into_rgba8())
    }

    /// The decoded file `image`.
    pub(super) fn load_image(&mut self, mesh: &Path, image: &Path) -> Result<DynamicImage, ImportError> {
        let bytes = read_file(image)?;
        self.decode(mesh, &image.display().to_string(), &bytes, image.extension().and_then(|e| e.to_str()))
    }

    /// Decodes an image file in memory. The content decides the format. `extension` is only used for TGA, which has no
    /// identifier in its content.
    pub(super) fn decode(
        &mut self,
        mesh: &Path,
        name: &str,
        bytes: &[u8],
        extension: Option<&str>,
    ) -> Result<DynamicImage, ImportError> {
        let fail = |what: String| ImportError::Image { path: mesh.into(), image: name.into(), what };
        let format = match image::guess_format(bytes) {
            Ok(format) => format,
            Err(_) if extension.is_some_and(|e| e.eq_ignore_ascii_case("tga")) => ImageFormat::Tga,
            Err(_) if bytes.is_empty() => return Err(fail("it is empty".into())),
            Err(_) => return Err(fail(unknown_format(bytes))),
        };
        let mut limits = Limits::default();
        limits.max_image_width = Some(MAX_TEXTURE_SIDE);
        limits.max_image_height = Some(MAX_TEXTURE_SIDE);
        // Eight bytes per texel: 16-bit images are decoded before they are reduced to 8 bits.
        limits.max_alloc = Some(self.texels_left.saturating_mul(8).min(8 * u64::from(MAX_TEXTURE_SIDE).pow(2)));
        let reader = || {
            let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
            reader.limits(limits.clone());
            reader
        };
        let (width, height) = reader().into_dimensions().map_err(|e| fail(one_line(e)))?;
        let texels = u64::from(width) * u64::from(height);
        self.check_room(mesh, name, texels)?;
        let decoded = reader().decode().map_err(|e| fail(one_line(e)))?;
        self.texels_left -= texels;
        Ok(decoded)
    }

    /// Counts the texels of a texture that is made from others. Called before it is made.
    pub(super) fn charge(&mut self, mesh: &Path, name: &str, texels: u64) -> Result<(), ImportError> {
        self.check_room(mesh, name, texels)?;
        self.texels_left -= texels;
        Ok(())
    }

    fn check_room(&self, mesh: &Path, name: &str, texels: u64) -> Result<(), ImportError> {
        if texels <= self.texels_left {
            return Ok(());
        }
        Err(ImportError::TooLarge {
            path: mesh.into(),
            what: format!("the textures up to {name} have more than {MAX_TEXTURE_TEXELS} texels in all"),
            limit: MAX_TEXTURE_TEXELS,
        })
    }

    /// A store that may hold this many texels.
    #[cfg(test)]
    pub(super) fn of_budget(texels: u64) -> Self {
        Self { texels_left: texels, ..Self::default() }
    }
}

/// Why an image in no format that can be read is refused.
fn unknown_format(bytes: &[u8]) -> String {
    let known = [(&b"\xabKTX 20\xbb"[..], "KTX2"), (b"\xabKTX 11\xbb", "KTX"), (b"sB", "Basis")];
    let found = known.iter().find(|(start, _)| bytes.starts_with(start));
    let found = found.map_or("it is none of PNG, JPEG, WebP, TGA, BMP and DDS".to_owned(), |(_, name)| {
        format!("it is a {name} image, which is not supported")
    });
    format!("{found}; convert it to PNG, JPEG or WebP")
}

/// Makes a texture from decoded pixels.
pub(super) fn texture_of(mesh: &Path, name: &str, pixels: &RgbaImage) -> Result<Arc<Texture>, ImportError> {
    Texture::from_rgba8(pixels.width(), pixels.height(), pixels.as_raw())
        .map(Arc::new)
        .map_err(|e| ImportError::Image { path: mesh.into(), image: name.into(), what: e.to_string() })
}

/// Makes the texture of a normal map from a decoded image.
pub(super) fn normals_of(mesh: &Path, name: &str, decoded: DynamicImage) -> Result<Arc<LinearTexture<3>>, ImportError> {
    let (width, height) = (decoded.width(), decoded.height());
    let texels = decoded.into_rgb16().into_raw().as_chunks::<3>().0.to_vec();
    linear_texture(mesh, name, width, height, texels)
}

/// Makes the texture of a height map from one channel of a decoded image.
pub(super) fn heights_of(
    mesh: &Path,
    name: &str,
    decoded: DynamicImage,
    channel: Channel,
) -> Result<Arc<LinearTexture<1>>, ImportError> {
    let (width, height) = (decoded.width(), decoded.height());
    let of = |c: usize, image: DynamicImage| image.into_rgba16().pixels().map(|p| [p.0[c]]).collect();
    let texels = match channel {
        Channel::Red => of(0, decoded),
        Channel::Green => of(1, decoded),
        Channel::Blue => of(2, decoded),
        Channel::Alpha => of(3, decoded),
        Channel::Luminance => decoded.into_luma16().into_raw().into_iter().map(|x| [x]).collect(),
    };
    linear_texture(mesh, name, width, height, texels)
}

fn linear_texture<const N: usize>(
    mesh: &Path,
    name: &str,
    width: u32,
    height: u32,
    texels: Vec<[u16; N]>,
) -> Result<Arc<LinearTexture<N>>, ImportError> {
    LinearTexture::new(width, height, texels).map(Arc::new).map_err(|e| ImportError::Image {
        path: mesh.into(),
        image: name.into(),
        what: e.to_string(),
    })
}

/// Whether an image that should hold heights holds normals in tangent space: unit vectors that point outwards.
fn looks_like_normals(image: &DynamicImage) -> bool {
    if !image.color().has_color() {
        return false;
    }
    let pixels = image.to_rgb8();
    // Exclude grey images: a grey of 0.79 everywhere has unit length, too.
    let grey = pixels.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]);
    let unit = |p: &&image::Rgb<u8>| {
        let [x, y, z] = p.0.map(|c| f32::from(c) / 127.5 - 1.0);
        z > 0.0 && ((x * x + y * y + z * z).sqrt() - 1.0).abs() < 0.1
    };
    !grey && pixels.pixels().filter(unit).count() * 10 >= pixels.len() / 3 * 9
}

/// Whether the alpha of a texture cuts holes into the surface (leaves, fences) instead of making all of it translucent
/// (glass): some texels are almost transparent and some at least half opaque.
pub(super) fn has_holes(texture: &Texture) -> bool {
    let (low, high) = texture.alpha_range();
    low < 16 && high >= 128
}
